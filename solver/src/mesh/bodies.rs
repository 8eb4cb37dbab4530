//! Bodies with closed forms, for tests.

use super::domain::{Domain, PatchDistances};
use mammotwin_data::{Vec3, mesh::Patch};

/// A ball.
pub struct Ball {
    /// Radius (mm), about the origin.
    pub radius: f64,
}

impl Domain for Ball {
    fn distances(&self, p: &Vec3) -> PatchDistances {
        PatchDistances::none().with(Patch::Skin, p.norm() - self.radius)
    }

    fn bounds(&self) -> (Vec3, Vec3) {
        (Vec3::repeat(-self.radius), Vec3::repeat(self.radius))
    }
}

/// Distance to an ellipsoid (or to an elliptic cylinder, with an infinite half axis), exact to first
/// order at its surface.
pub fn ellipsoid(p: &Vec3, half_axes: &Vec3) -> f64 {
    let scaled = p.component_div(half_axes);
    let slope = scaled.component_div(half_axes).norm();
    if slope == 0.0 { -half_axes.min() } else { (scaled.norm() - 1.0) * scaled.norm() / slope }
}

/// A quarter shell of fat on an elliptic chest, with two half ellipsoids on it: the digital
/// volunteers' proportions.
pub struct Torso {
    /// Half axes x and y of the chest wall (mm).
    pub chest: [f64; 2],
    /// Half extent in z (mm).
    pub half_height: f64,
    /// Thickness of the fat (mm).
    pub fat: f64,
    /// Half axes of a breast along the wall, away from it, and along z (mm).
    pub breast: [f64; 3],
    /// Angle of the breasts from the sternal line (rad).
    pub angle: f64,
}

impl Torso {
    /// About the smaller volunteer.
    pub fn small() -> Self {
        let breast = [58.0, 38.0, 55.0];
        Self { chest: [158.0, 115.0], half_height: 130.0, fat: 8.0, breast, angle: 0.55 }
    }

    /// About the larger volunteer.
    pub fn large() -> Self {
        let breast = [80.0, 88.0, 78.0];
        Self { chest: [173.0, 125.0], half_height: 165.0, fat: 12.0, breast, angle: 0.55 }
    }
}

impl Domain for Torso {
    fn distances(&self, p: &Vec3) -> PatchDistances {
        let [a, b] = self.chest;
        let wall = ellipsoid(p, &Vec3::new(a, b, 1e9));
        let layer = wall - self.fat;
        let mut skin = layer;
        for side in [1.0, -1.0] {
            let (sin, cos) = (side * self.angle).sin_cos();
            let center = Vec3::new(a * sin, b * cos, 0.0);
            let out = Vec3::new(b * sin, a * cos, 0.0).normalize();
            let q = p - center;
            let local = Vec3::new(out.y * q.x - out.x * q.y, out.dot(&q), q.z);
            let breast = ellipsoid(&local, &Vec3::from(self.breast));
            // Smooth union over 8 mm.
            let blend = (0.5 + 0.5 * (breast - skin) / 8.0).clamp(0.0, 1.0);
            skin = breast + (skin - breast) * blend - 8.0 * blend * (1.0 - blend);
        }
        let lateral = |x: f64| x * 0.2 - p.y * 0.96f64.sqrt() - 10.0;
        PatchDistances::none()
            .with(Patch::Skin, skin)
            .with(Patch::ChestWall, -wall)
            .with(Patch::Superior, p.z - self.half_height)
            .with(Patch::Inferior, -p.z - self.half_height)
            .with(Patch::LateralRight, lateral(p.x))
            .with(Patch::LateralLeft, lateral(-p.x))
    }

    fn bounds(&self) -> (Vec3, Vec3) {
        let reach = self.breast[1] + self.fat;
        let [x, y] = self.chest.map(|axis| axis + reach);
        (Vec3::new(-x, -20.0, -self.half_height), Vec3::new(x, y, self.half_height))
    }
}

/// Half an ellipsoid, cut by the front of an elliptic cylinder: one breast on a round chest.
pub struct Mound;

impl Domain for Mound {
    fn distances(&self, p: &Vec3) -> PatchDistances {
        let chest = ellipsoid(p, &Vec3::new(150.0, 105.0, 1e9));
        let skin = ellipsoid(&(p - Vec3::new(0.0, 105.0, 0.0)), &Vec3::new(58.0, 40.0, 55.0));
        PatchDistances::none().with(Patch::Skin, skin).with(Patch::ChestWall, -chest)
    }

    fn bounds(&self) -> (Vec3, Vec3) {
        (Vec3::new(-60.0, 80.0, -60.0), Vec3::new(60.0, 150.0, 60.0))
    }
}
