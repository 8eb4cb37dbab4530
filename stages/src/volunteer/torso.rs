//! The stress-free torso as functions of place.
//!
//! Everything is in the person's body frame: x to her right, y to the front, z up, origin on the
//! axis of the chest at the height of the nipples. Functions called *distance* are exact zero
//! sets with a gradient of about 1, positive outward; they are not exact distances far away.

use super::{gland::Lobes, preset::Preset};
use mammotwin_data::{
    Vec3,
    labels::{Side, Tissue},
};
use mammotwin_imaging::mri::synthesize::{Substance, noise};

/// Where the breasts end, for the mesh, for labels and for volumes: from the sternal line to the
/// midaxillary plane, and between the clavicle and the costal margin.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Limits {
    /// The midaxillary plane (mm): breast is in front of it.
    pub least_y_mm: f64,
    /// Costal margin (mm).
    pub least_z_mm: f64,
    /// Below the clavicle (mm).
    pub greatest_z_mm: f64,
}

impl Limits {
    /// Whether a place is between them.
    pub fn contain(&self, place: &Vec3) -> bool {
        place.y > self.least_y_mm && place.z > self.least_z_mm && place.z < self.greatest_z_mm
    }
}

/// Frame of one breast.
#[derive(Debug, Clone)]
pub struct BreastFrame {
    /// Which one.
    pub side: Side,
    /// Centre of the base, on the muscle (mm).
    pub base: Vec3,
    /// Away from the chest.
    pub outward: Vec3,
    /// Across the chest, away from the sternum.
    pub lateral: Vec3,
    /// Tip of the breast under the nipple (mm).
    pub apex: Vec3,
}

/// The person's shape.
#[derive(Debug, Clone)]
pub struct Torso {
    /// Her numbers.
    pub person: Preset,
    /// Right and left breast.
    pub breasts: [BreastFrame; 2],
    /// Where the breasts end.
    pub limits: Limits,
    seed: u64,
    lobes: Lobes,
}

/// Blending width (mm) of breast into torso.
const BLEND_MM: f64 = 24.0;
/// Blending width (mm) of nipple into areola.
const NIPPLE_BLEND_MM: f64 = 4.0;
const NIPPLE_RADIUS_MM: f64 = 5.0;
const NIPPLE_HEIGHT_MM: f64 = 6.0;
const AREOLA_SKIN_MM: f64 = 4.5;

impl Torso {
    /// The shape of a person; `seed` places lobes, septa and irregularities.
    pub fn new(person: Preset, seed: u64) -> Self {
        let breast = &person.breast;
        let breasts = [Side::Right, Side::Left].map(|side| {
            let base = along_muscle(&person, breast.from_sternal_line_mm * side.sign());
            let step = Vec3::new(0.01, 0.0, 0.0);
            let ahead = along_muscle(&person, breast.from_sternal_line_mm * side.sign() + step.x);
            let to_right = (ahead - base).normalize();
            let outward = Vec3::new(-to_right.y, to_right.x, 0.0);
            let apex = base + breast.projection_mm * outward;
            BreastFrame { side, base, outward, lateral: to_right * side.sign(), apex }
        });
        let limits = Limits {
            least_y_mm: 0.0,
            least_z_mm: -(breast.base_z_mm + 12.0),
            greatest_z_mm: breast.base_z_mm + 12.0,
        };
        let mut torso = Self { person, breasts, limits, seed, lobes: Lobes::default() };
        torso.lobes = Lobes::fitted(&torso, seed);
        torso
    }

    /// Distance from the rib cage (mm).
    pub fn rib_cage(&self, p: &Vec3) -> f64 {
        let chest = &self.person.chest;
        ellipse(p.x, p.y, chest.half_axis_x_mm, chest.half_axis_y_mm)
    }

    /// Distance from the anterior surface of the muscle (mm): the chest wall on which the
    /// breasts glide.
    pub fn chest_wall(&self, p: &Vec3) -> f64 {
        self.rib_cage(p) - muscle_mm(&self.person, p)
    }

    /// Distance from the skin surface without nipples (mm).
    pub fn smooth_skin(&self, p: &Vec3) -> f64 {
        let chest_wall = self.chest_wall(p);
        self.skin_over(p, chest_wall)
    }

    fn skin_over(&self, p: &Vec3, chest_wall: f64) -> f64 {
        let fat = self.person.chest.fat_mm * (1.0 - 0.25 * (-(p.x / 28.0).powi(2)).exp());
        let mut skin = chest_wall - fat;
        for frame in &self.breasts {
            skin = smooth_min(skin, self.ellipsoid(frame, p), BLEND_MM);
        }
        skin
    }

    /// Distance from the skin surface, nipples included (mm).
    pub fn skin(&self, p: &Vec3) -> f64 {
        let smooth = self.smooth_skin(p);
        self.with_nipple(p, smooth)
    }

    fn with_nipple(&self, p: &Vec3, smooth: f64) -> f64 {
        let frame = self.nearer(p);
        let from = p - frame.apex;
        if from.norm_squared() > 400.0 {
            return smooth;
        }
        let along = from.dot(&frame.outward).clamp(-10.0, NIPPLE_HEIGHT_MM - NIPPLE_RADIUS_MM);
        let nipple = (from - along * frame.outward).norm() - NIPPLE_RADIUS_MM;
        smooth_min(smooth, nipple, NIPPLE_BLEND_MM)
    }

    /// The breast on the side of a place.
    pub fn nearer(&self, p: &Vec3) -> &BreastFrame {
        &self.breasts[usize::from(p.x < 0.0)]
    }

    /// Distance from the half ellipsoid of a breast, continued as a cylinder behind its base.
    fn ellipsoid(&self, frame: &BreastFrame, p: &Vec3) -> f64 {
        let breast = &self.person.breast;
        let [lateral, up, out] = local(frame, p);
        let radii = [breast.base_x_mm, breast.base_z_mm, breast.projection_mm];
        let [u, v, w] = [lateral / radii[0], up / radii[1], out.max(0.0) / radii[2]];
        let level = (u * u + v * v + w * w).sqrt();
        let slope =
            ((u / radii[0]).powi(2) + (v / radii[1]).powi(2) + (w / radii[2]).powi(2)).sqrt();
        if slope < 1e-9 { -breast.projection_mm } else { level * (level - 1.0) / slope }
    }

    /// Thickness of the skin (mm), by region: 0.83-2.35 mm and thicker in the areola
    /// (Mîra 2018, § 1.1.3), lateral thinnest.
    pub fn skin_mm(&self, p: &Vec3) -> f64 {
        let frame = self.nearer(p);
        let [lateral, up, _] = local(frame, p);
        let breast = &self.person.breast;
        let radius = (p - frame.apex).norm();
        let [u, v] =
            [lateral / breast.base_x_mm, up / breast.base_z_mm].map(|t| t.clamp(-1.3, 1.3));
        let slow = noise::smooth(self.seed ^ 0x51, p, 40.0);
        let regional = (1.55 - 0.4 * u - 0.12 * v + 0.2 * slow).clamp(0.83, 2.35);
        let areola = 1.0 - smooth_step((radius - breast.areola_radius_mm) / 3.0);
        regional + (AREOLA_SKIN_MM - regional) * areola
    }

    /// What the soft tissue in front of the chest wall is at a stress-free place.
    pub fn soft(&self, p: &Vec3, chest_wall: f64) -> (Substance, Tissue) {
        let smooth = self.skin_over(p, chest_wall);
        if smooth > NIPPLE_HEIGHT_MM + NIPPLE_RADIUS_MM {
            return (Substance::Air, Tissue::Background);
        }
        let skin = self.with_nipple(p, smooth);
        if skin > 0.0 {
            return (Substance::Air, Tissue::Background);
        }
        let frame = self.nearer(p);
        if skin > -6.0 && skin > -self.skin_mm(p) {
            let areola = (p - frame.apex).norm() < self.person.breast.areola_radius_mm;
            let tissue = if areola {
                Tissue::NippleAreola
            } else if self.limits.contain(p) {
                Tissue::Skin
            } else {
                Tissue::Other
            };
            return (Substance::Skin, tissue);
        }
        if !self.limits.contain(p) {
            return (Substance::Fat, Tissue::Other);
        }
        let gland = self.lobes.contain(self, frame, p, chest_wall, skin);
        match (gland, frame.side) {
            (true, Side::Right) => (Substance::Gland, Tissue::FibroglandularRight),
            (true, Side::Left) => (Substance::Gland, Tissue::FibroglandularLeft),
            (false, Side::Right) => (Substance::Fat, Tissue::AdiposeRight),
            (false, Side::Left) => (Substance::Fat, Tissue::AdiposeLeft),
        }
    }

    /// Seed of what is drawn at random in the shape.
    pub fn seed(&self) -> u64 {
        self.seed
    }
}

/// Coordinates of a place in a breast (mm): lateral, up, outward, from the centre of the base.
pub fn local(frame: &BreastFrame, p: &Vec3) -> [f64; 3] {
    let from = p - frame.base;
    [from.dot(&frame.lateral), from.z, from.dot(&frame.outward)]
}

/// Thickness of the muscle (mm): thin at the sternum, thickest half-way to the midaxillary
/// plane, thicker above than below, thin over the back.
fn muscle_mm(person: &Preset, p: &Vec3) -> f64 {
    let chest = &person.chest;
    let [u, v] = [p.x / chest.half_axis_x_mm, p.y / chest.half_axis_y_mm];
    let square = (u * u + v * v).max(1e-9);
    let front = v.max(0.0);
    let belly = (2.0 * u * front / square).powi(2);
    let height = 1.0 + 0.2 * (p.z / (0.6 * chest.half_extent_z_mm)).tanh();
    chest.muscle_thin_mm + (chest.muscle_thick_mm - chest.muscle_thin_mm) * belly * height
}

/// The place on the muscle at an arc length (mm) from the sternal line, towards +x, at z = 0.
pub fn along_muscle(person: &Preset, arc_mm: f64) -> Vec3 {
    let chest = &person.chest;
    let on = |angle: f64| {
        let (sin, cos) = angle.sin_cos();
        let rib = Vec3::new(chest.half_axis_x_mm * sin, chest.half_axis_y_mm * cos, 0.0);
        let normal = Vec3::new(sin / chest.half_axis_x_mm, cos / chest.half_axis_y_mm, 0.0);
        rib + normal.normalize() * muscle_mm(person, &rib)
    };
    let (mut angle, mut left) = (0.0, arc_mm.abs());
    let step = 1e-3;
    let mut here = on(0.0);
    while left > 0.0 && angle < std::f64::consts::FRAC_PI_2 {
        let next = on(angle + step);
        let length = (next - here).norm();
        let part = (left / length).min(1.0);
        (angle, here, left) = (angle + step * part, on(angle + step * part), left - length);
    }
    Vec3::new(here.x * arc_mm.signum(), here.y, 0.0)
}

/// First-order distance from an ellipse about the origin; exact on it.
pub(super) fn ellipse(x: f64, y: f64, a: f64, b: f64) -> f64 {
    // These are asked for at every voxel: `hypot`, which minds overflow, takes a seventh of the drawing.
    let level = ((x / a).powi(2) + (y / b).powi(2)).sqrt();
    let slope = ((x / (a * a)).powi(2) + (y / (b * b)).powi(2)).sqrt();
    if slope < 1e-9 { -a.min(b) } else { level * (level - 1.0) / slope }
}

/// Minimum with a C2 blend of width `k` (Quilez, cubic polynomial).
fn smooth_min(a: f64, b: f64, k: f64) -> f64 {
    let h = (k - (a - b).abs()).max(0.0) / k;
    a.min(b) - h * h * h * k / 6.0
}

/// 0 below 0, 1 above 1, C1 between.
pub(super) fn smooth_step(t: f64) -> f64 {
    let t = t.clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}
