//! The course of a simulated compression, between its states.

use super::record::Channel;
use crate::compress::Compression;
use serde::{Deserialize, Serialize};

/// Forces are interpolated as ln(1 + F / this); N.
const SMALL_N: f64 = 1.0;

/// What a compression gives at falling thicknesses.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Pressed {
    /// Distance of the plates (mm), falling.
    pub thickness_mm: Vec<f64>,
    /// By [`Channel::place`] and thickness.
    pub values: [Vec<f64>; 4],
}

impl Pressed {
    /// Of a compression, as far as it goes before the breast leaps to another equilibrium: what is behind a leap
    /// depends on where it happens, which mesh and steps decide.
    pub fn of(made: &Compression) -> Self {
        let reach =
            |points: &[[f32; 3]]| points.iter().map(|p| f64::from(p[1])).fold(0.0, f64::max);
        let curve = &made.curve;
        let states = curve.leaps().first().map_or(curve.thickness_mm.len(), |leap| leap.state);
        let until = |values: &[f64]| values.iter().take(states).copied().collect();
        let steps = made.steps.iter().take(states);
        Self {
            thickness_mm: until(&curve.thickness_mm),
            values: [
                curve.force_n.iter().take(states).map(|f| f.max(0.0)).collect(),
                until(&curve.contact_area_mm2),
                steps.map(|step| reach(&step.points)).collect(),
                until(&curve.tilt_deg),
            ],
        }
    }

    /// Smallest thickness (mm); infinite for a compression without states.
    pub fn thinnest_mm(&self) -> f64 {
        self.thickness_mm.last().copied().unwrap_or(f64::INFINITY)
    }

    /// A quantity at a thickness (mm). Before the first state nothing is touched; behind the last one the curve
    /// goes on with its slope, of a force that of its logarithm.
    pub fn at(&self, channel: Channel, thickness_mm: f64) -> f64 {
        let known = &self.values[channel.place()];
        let value = |n: usize| bent(channel, known[n]);
        let h = &self.thickness_mm;
        let last = h.len() - 1;
        if last == 0 || thickness_mm >= h[0] {
            return known[0];
        }
        let n = h[1..].iter().position(|next| *next <= thickness_mm).unwrap_or(last - 1);
        let step = h[n] - h[n + 1];
        let slope = |n: usize| tangent(h, &value, n);
        let found = if thickness_mm < h[last] {
            value(last) + slope(last) * (thickness_mm - h[last])
        } else {
            let t = (h[n] - thickness_mm) / step;
            // Hermite's cubic.
            let (a, b) = (value(n), value(n + 1));
            let (da, db) = (-step * slope(n), -step * slope(n + 1));
            let (t2, t3) = (t * t, t * t * t);
            a * (2.0 * t3 - 3.0 * t2 + 1.0)
                + da * (t3 - 2.0 * t2 + t)
                + b * (3.0 * t2 - 2.0 * t3)
                + db * (t3 - t2)
        };
        straight(channel, found)
    }
}

/// The scale on which a quantity is interpolated.
pub(super) fn bent(channel: Channel, value: f64) -> f64 {
    if channel == Channel::Force { (value.max(0.0) / SMALL_N).ln_1p() } else { value }
}

/// Back from that scale.
pub(super) fn straight(channel: Channel, value: f64) -> f64 {
    if channel == Channel::Force { SMALL_N * value.exp_m1() } else { value }
}

/// Slope at a point of a curve that does not overshoot (Fritsch and Butland, SIAM J. Sci. Stat. Comput. 5
/// (1984) 300); `x` rises or falls.
pub(super) fn tangent(x: &[f64], y: &impl Fn(usize) -> f64, n: usize) -> f64 {
    let last = x.len() - 1;
    let secant = |k: usize| (y(k + 1) - y(k)) / (x[k + 1] - x[k]);
    if n == 0 {
        return secant(0);
    }
    if n == last {
        return secant(last - 1);
    }
    let (before, after) = (secant(n - 1), secant(n));
    if before * after <= 0.0 {
        return 0.0;
    }
    let (near, far) = ((x[n] - x[n - 1]).abs(), (x[n + 1] - x[n]).abs());
    let (a, b) = (2.0 * far + near, far + 2.0 * near);
    (a + b) / (a / before + b / after)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{compress::Course, load_steps::LoadStep};

    /// A course of 60 to 50 mm of which the last step moves a node by `moved_mm`.
    fn pressed(moved_mm: f64) -> Pressed {
        let reach = |y: f32| LoadStep { points: vec![[0.0, y, 0.0]], ..LoadStep::default() };
        let curve = Course {
            thickness_mm: vec![60.0, 55.0, 50.0],
            force_n: vec![-0.01, 12.0, 20.6],
            contact_area_mm2: vec![0.0, 4000.0, 5000.0],
            tilt_deg: vec![0.0; 3],
            moved_mm: vec![0.0, 6.0, moved_mm],
            ..Course::default()
        };
        let steps = [70.0, 74.0, 78.0].map(reach).to_vec();
        Pressed::of(&Compression { steps, ..Compression::of_course(curve) })
    }

    #[test]
    fn a_course_ends_before_the_breast_leaps() {
        let whole = pressed(6.0);
        assert_eq!((whole.thinnest_mm(), whole.values[0][0]), (50.0, 0.0));
        let cut = pressed(19.0);
        assert_eq!(cut.thickness_mm, [60.0, 55.0]);
        assert_eq!(
            cut.values,
            [vec![0.0, 12.0], vec![0.0, 4000.0], vec![70.0, 74.0], vec![0.0; 2]]
        );
    }
}
