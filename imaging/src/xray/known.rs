//! Bodies whose path lengths are known in closed form, to measure the projection by.

use crate::xray::{
    calcification::sphere,
    geometry::Geometry,
    raster::{RasterError, Window, path_lengths},
    shapes::{cuboid, half_cylinder, half_cylinder_path, prism},
};
use mammotwin_data::{Vec3, radiograph::Radiograph, surface::TriMesh};

/// Heights (mm) between which bodies lie.
const BOTTOM: f64 = 20.0;
const TOP: f64 = 66.0;
/// Half width (mm) of slab and wedge, and their range along y.
const HALF_WIDTH: f64 = 80.0;
const FRONT: f64 = 120.0;
const BEHIND: f64 = 40.0;
/// How much the wedge's upper side sinks per mm away from the chest wall: a paddle that tilts by 5.7°.
const SLOPE: f64 = 0.1;
/// Radius (mm) of the half cylinder, and its facets.
const RADIUS: f64 = 100.0;
const FACETS: usize = 720;
/// Centre (mm) and radius of the sphere.
const CENTER: Vec3 = Vec3::new(12.0, 60.0, 43.0);
const BALL: f64 = 23.0;

/// A body with known path lengths, in the frame of the detector.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Known {
    /// 46 mm between level sides.
    Slab,
    /// A slab whose upper side is tilted.
    Wedge,
    /// A sphere of 46 mm.
    Sphere,
    /// Dance's half cylinder: 46 mm high, 100 mm in radius.
    HalfCylinder,
}

impl Known {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Slab, Self::Wedge, Self::Sphere, Self::HalfCylinder];

    /// What files and tables call it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Slab => "slab",
            Self::Wedge => "wedge",
            Self::Sphere => "sphere",
            Self::HalfCylinder => "half_cylinder",
        }
    }

    /// Its closed surface. Round ones are faceted: 720 facets of the half cylinder, 80 k of the sphere.
    pub fn surface(self) -> TriMesh {
        let outline = [
            [-HALF_WIDTH, -BEHIND],
            [HALF_WIDTH, -BEHIND],
            [HALF_WIDTH, FRONT],
            [-HALF_WIDTH, FRONT],
        ];
        match self {
            Self::Slab => cuboid([-HALF_WIDTH, -BEHIND, BOTTOM], [HALF_WIDTH, FRONT, TOP]),
            Self::Wedge => prism(&outline, |_| BOTTOM, |p| TOP - SLOPE * p[1]),
            Self::Sphere => {
                let ball = sphere(6);
                let points = ball.points.iter().map(|p| CENTER + BALL * p).collect();
                TriMesh { points, triangles: ball.triangles }
            }
            Self::HalfCylinder => half_cylinder(RADIUS, BOTTOM, TOP, FACETS),
        }
    }

    /// Path (mm) from a source at (0, 0, height) to a point of the detector.
    pub fn path_mm(self, height: f64, at: [f64; 2]) -> f64 {
        let ray = (at[0] * at[0] + at[1] * at[1] + height * height).sqrt();
        // The ray is (s x, s y, height (1 - s)).
        let level = |z: f64| 1.0 - z / height;
        match self {
            Self::HalfCylinder => half_cylinder_path(RADIUS, BOTTOM, TOP, height, at),
            Self::Sphere => {
                let along = Vec3::new(at[0], at[1], -height) / ray;
                let to = CENTER - Vec3::new(0.0, 0.0, height);
                let beside2 = to.norm_squared() - to.dot(&along).powi(2);
                2.0 * (BALL * BALL - beside2).max(0.0).sqrt()
            }
            Self::Slab | Self::Wedge => {
                let slope = if self == Self::Wedge { SLOPE } else { 0.0 };
                let upper = (height - TOP) / (height - slope * at[1]);
                // Where the ray is between the sides and between front and rear.
                let mut inside = [upper.max(0.0), level(BOTTOM)];
                let walls = [(at[0], -HALF_WIDTH, HALF_WIDTH), (at[1], -BEHIND, FRONT)];
                for (step, low, high) in walls {
                    if step != 0.0 {
                        let (a, b) = (low / step, high / step);
                        inside = [inside[0].max(a.min(b)), inside[1].min(a.max(b))];
                    }
                }
                (inside[1] - inside[0]).max(0.0) * ray
            }
        }
    }
}

/// Path lengths (mm) inside a closed surface (mm, in the frame of the detector) on a detector.
///
/// # Errors
/// [`RasterError::Open`].
pub fn shadow(surface: &TriMesh, geometry: &Geometry) -> Result<Radiograph, RasterError> {
    let window = Window {
        left_mm: geometry.left_mm(),
        first_row_mm: geometry.first_row_mm(),
        pitch_mm: geometry.pitch_mm,
        columns: geometry.columns,
        rows: geometry.rows,
    };
    let paths = path_lengths(surface, geometry.source_height_mm, &window)?;
    Ok(geometry.picture(paths, "path length (mm)"))
}

/// Path lengths (mm) of a body on a detector: those of its surface, and root mean square and largest of
/// their difference from the closed form, over the root mean square of the closed form.
///
/// # Errors
/// None for these bodies on a detector below them.
pub fn measure(body: Known, geometry: &Geometry) -> Result<(Radiograph, [f64; 2]), RasterError> {
    let height = geometry.source_height_mm;
    let picture = shadow(&body.surface(), geometry)?;
    let (mut squares, mut exact2, mut largest, mut count) = (0.0, 0.0, 0f64, 0.0);
    for (n, &path) in picture.pixels.iter().enumerate() {
        let at = geometry.pixel_mm(n / geometry.columns, n % geometry.columns);
        let exact = body.path_mm(height, at);
        if exact > 0.0 || path != 0.0 {
            let off = f64::from(path) - exact;
            squares += off * off;
            exact2 += exact * exact;
            largest = largest.max(off.abs());
            count += 1.0;
        }
    }
    let scale = (exact2 / f64::max(count, 1.0)).sqrt();
    let rms = (squares / f64::max(exact2, f64::MIN_POSITIVE)).sqrt();
    Ok((picture, [rms, largest / scale]))
}
