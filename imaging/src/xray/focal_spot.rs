//! Where photons leave the target: a point, or points that stand for a focal spot.

use mammotwin_data::study::{FocalSpotPlan, SpotShape};

/// Points (mm beside the middle of the focal spot, along x and y) and the share of the photons that
/// each gives.
#[derive(Debug, Clone, PartialEq)]
pub struct FocalSpot {
    /// Place and share.
    pub points: Vec<([f64; 2], f64)>,
}

/// Nodes and weights of Gauss and Legendre on -1..1: moments up to the ninth are exact.
const LEGENDRE: [[f64; 2]; 5] = [
    [-0.906_179_845_938_664, 0.118_463_442_528_094_5],
    [-0.538_469_310_105_683_1, 0.239_314_335_249_683_2],
    [0.0, 0.284_444_444_444_444_4],
    [0.538_469_310_105_683_1, 0.239_314_335_249_683_2],
    [0.906_179_845_938_664, 0.118_463_442_528_094_5],
];
/// Nodes and weights of Gauss and Hermite for a normal distribution of variance 1, alike.
const HERMITE: [[f64; 2]; 5] = [
    [-2.856_970_013_872_805_7, 0.011_257_411_327_720_69],
    [-1.355_626_179_974_266, 0.222_075_922_005_612_63],
    [0.0, 0.533_333_333_333_333_3],
    [1.355_626_179_974_266, 0.222_075_922_005_612_63],
    [2.856_970_013_872_805_7, 0.011_257_411_327_720_69],
];

impl FocalSpot {
    /// All photons come from one point.
    pub fn point() -> Self {
        Self { points: vec![([0.0; 2], 1.0)] }
    }

    /// Five by five points with the moments of the distribution, alike for the whole field: the
    /// shortening of a spot on a slanted target towards the chest wall is not modelled.
    pub fn of(plan: &FocalSpotPlan) -> Self {
        let (nodes, scale) = match plan.shape {
            SpotShape::Square => (LEGENDRE, 0.5 * plan.width_mm),
            SpotShape::Gaussian => (HERMITE, plan.width_mm / (8.0 * 2.0_f64.ln()).sqrt()),
        };
        let pairs = nodes.iter().flat_map(|x| nodes.iter().map(move |y| (x, y)));
        let point = |(x, y): (&[f64; 2], &[f64; 2])| ([scale * x[0], scale * y[0]], x[1] * y[1]);
        Self { points: pairs.map(point).collect() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spots_have_the_moments_of_their_distribution() {
        let width_mm = 0.3;
        // Variance, and fourth moment over its square.
        for (shape, variance, fourth) in [
            (SpotShape::Square, width_mm * width_mm / 12.0, 1.8),
            (SpotShape::Gaussian, width_mm * width_mm / (8.0 * 2.0_f64.ln()), 3.0),
        ] {
            let spot = FocalSpot::of(&FocalSpotPlan { width_mm, shape });
            let moment = |axis: usize, power: i32| -> f64 {
                spot.points.iter().map(|(at, share)| share * at[axis].powi(power)).sum()
            };
            for axis in 0..2 {
                assert!((moment(axis, 0) - 1.0).abs() < 1e-12 && moment(axis, 1).abs() < 1e-12);
                assert!((moment(axis, 2) / variance - 1.0).abs() < 1e-9);
                assert!((moment(axis, 4) / variance.powi(2) / fourth - 1.0).abs() < 1e-9);
            }
        }
    }
}
