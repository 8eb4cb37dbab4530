//! Maps over the chest: one value for each (angle, height) about the thorax' axis.

use mammotwin_data::Vec3;

/// Directions from a line along z inside the thorax. Angle 0 is the person's right (+x), a right
/// angle is to the front.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Polar {
    /// x and y of the axis in the body's axes (mm).
    pub axis: [f64; 2],
    /// First height (mm).
    pub low_z: f64,
    /// Number of angles and heights.
    pub shape: [usize; 2],
}

/// First angle (rad): some way behind the person's right side.
const FIRST: f64 = -20.0 * std::f64::consts::PI / 180.0;
/// Step of the angle (rad).
const STEP: f64 = 1.25 * std::f64::consts::PI / 180.0;
/// Number of angles: as far behind the left side.
const N_ANGLES: usize = 177;
/// Step of the height (mm).
pub(super) const STEP_Z: f64 = 2.5;

impl Polar {
    pub(super) fn new(axis: [f64; 2], low_z: f64, high_z: f64) -> Self {
        let n_z = ((high_z - low_z) / STEP_Z).floor() as usize + 1;
        Self { axis, low_z, shape: [N_ANGLES, n_z] }
    }

    /// Number of columns.
    pub(super) fn len(&self) -> usize {
        self.shape[0] * self.shape[1]
    }

    /// Angle (rad) of a column.
    pub(super) fn angle(&self, column: usize) -> f64 {
        FIRST + STEP * (column % self.shape[0]) as f64
    }

    /// Height (mm) of a column.
    pub(super) fn height(&self, column: usize) -> f64 {
        self.low_z + STEP_Z * (column / self.shape[0]) as f64
    }

    /// Point (mm, body's axes) at a radius in a column.
    pub(super) fn point(&self, column: usize, radius: f64) -> Vec3 {
        let (sin, cos) = self.angle(column).sin_cos();
        Vec3::new(self.axis[0] + radius * cos, self.axis[1] + radius * sin, self.height(column))
    }

    /// Radius (mm) of a point, and where in the map its column lies.
    pub(super) fn locate(&self, p: &Vec3) -> (f64, [f64; 2]) {
        let (x, y) = (p.x - self.axis[0], p.y - self.axis[1]);
        let mut angle = y.atan2(x);
        if angle < -std::f64::consts::FRAC_PI_2 {
            angle += 2.0 * std::f64::consts::PI;
        }
        (x.hypot(y), [(angle - FIRST) / STEP, (p.z - self.low_z) / STEP_Z])
    }

    /// Whether the angle of a place in the map is one of its own.
    pub(super) fn holds(&self, at: [f64; 2]) -> bool {
        at[0] >= 0.0 && at[0] <= (self.shape[0] - 1) as f64
    }

    /// Bilinear value of a map; its border continues outwards.
    pub(super) fn value(&self, map: &[f32], at: [f64; 2]) -> f32 {
        let [n_u, n_v] = self.shape;
        let u = at[0].clamp(0.0, (n_u - 1) as f64);
        let v = at[1].clamp(0.0, (n_v - 1) as f64);
        let (i, j) = ((u as usize).min(n_u - 2), (v as usize).min(n_v.saturating_sub(2)));
        let (a, b) = ((u - i as f64) as f32, (v - j as f64) as f32);
        let up = if n_v > 1 { n_u } else { 0 };
        let n = j * n_u + i;
        let low = map[n] + a * (map[n + 1] - map[n]);
        let high = map[n + up] + a * (map[n + up + 1] - map[n + up]);
        low + b * (high - low)
    }

    /// Length (mm) of one step of angle at a radius, and of one step of height.
    pub(super) fn steps_mm(&self, radius: f64) -> [f64; 2] {
        [STEP * radius, STEP_Z]
    }
}
