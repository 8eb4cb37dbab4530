//! How well fitted numbers are known.

use super::Parameter;
use crate::{
    model::Moduli,
    shape::{CHEST_LENGTH_MM, CHEST_MM, Shape},
};
use mammotwin_data::labels::Side;
use nalgebra::{DMatrix, DVector};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use serde::{Deserialize, Serialize};

/// Length (mm) over which errors of segmentation and mesh are alike along the skin.
const ALIKE_MM: f64 = 20.0;
/// Seed of the draws.
const DRAWS_SEED: u64 = 1;

/// How well the fitted numbers are known: covariance of their logarithms, as the distances that are left have it. It
/// knows nothing of effects that the model lacks.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Precision {
    /// Keys of what was fitted, of which the distances tell something; breasts first.
    pub keys: Vec<String>,
    /// Covariance of the logarithms, row after row.
    pub covariance: Vec<f64>,
    /// How many independent errors there are among the distances of the fitted poses; zero when nothing was fitted.
    pub independent: f64,
}

impl Precision {
    /// Standard deviation of the logarithm of a number; `None` when it was not fitted.
    pub fn of(&self, parameter: Parameter) -> Option<f64> {
        let place = self.place(parameter)?;
        Some(self.covariance[place * (self.keys.len() + 1)].max(0.0).sqrt())
    }

    /// Of the modulus of a side.
    pub fn of_side(&self, side: Side) -> Option<f64> {
        self.of(Parameter::of_side(side))
    }

    /// Correlation of two logarithms; `None` when one was not fitted.
    pub fn correlation(&self, one: Parameter, other: Parameter) -> Option<f64> {
        let both = self.of(one)? * self.of(other)?;
        let at = self.place(one)? * self.keys.len() + self.place(other)?;
        Some(self.covariance[at] / both.max(f64::MIN_POSITIVE))
    }

    fn place(&self, parameter: Parameter) -> Option<usize> {
        self.keys.iter().position(|key| key == parameter.key())
    }

    /// Draws numbers from what the distances leave open: logarithms are normal about `moduli`, with this covariance.
    /// What was not fitted stays. None where nothing was fitted.
    pub fn draws(&self, moduli: Moduli, count: usize) -> Vec<Moduli> {
        let known = Parameter::named(&self.keys);
        let covariance = DMatrix::from_row_slice(known.len(), known.len(), &self.covariance);
        let Some(factor) = covariance.cholesky().filter(|_| !known.is_empty()) else {
            return Vec::new();
        };
        let mut random = ChaCha8Rng::seed_from_u64(DRAWS_SEED);
        let mut draw = || {
            let normal = DVector::from_fn(known.len(), |_, _| StandardNormal.sample(&mut random));
            let logs: DVector<f64> = factor.l() * normal;
            let mut drawn = moduli;
            for (parameter, log) in known.iter().zip(logs.iter()) {
                parameter.scale(&mut drawn, log.exp());
            }
            drawn
        };
        (0..count).map(|_| draw()).collect()
    }
}

/// Errors of the distances, pose after pose: as much of what is left as people's chest walls change between poses is a
/// change of the chest wall, alike over [`CHEST_LENGTH_MM`], the rest an error that is alike over [`ALIKE_MM`].
pub(super) struct Spread {
    /// JᵀCJ of the columns.
    pub of_columns: DMatrix<f64>,
    /// (tr C)² over the sum of squares of C.
    pub independent: f64,
}

impl Spread {
    /// Of errors whose mean square is `misfit` (mm²) when the motions of the orthonormal columns `rigid` are fitted.
    pub fn new(
        shapes: &[Shape],
        rigid: &DMatrix<f64>,
        columns: &DMatrix<f64>,
        misfit: f64,
    ) -> Self {
        let lengths = [CHEST_LENGTH_MM, ALIKE_MM];
        let width = columns.ncols();
        let mut rigid_left = [0.0; 2];
        let mut of_columns = [DMatrix::zeros(width, width), DMatrix::zeros(width, width)];
        // Far by far, far by near, near by near.
        let mut products = [0.0; 3];
        let mut at = 0;
        for shape in shapes {
            let nodes = shape.points.len();
            let [rigid, columns] = [rigid, columns].map(|all| all.rows(at, nodes));
            for i in 0..nodes {
                let mut rows = [DVector::zeros(width), DVector::zeros(width)];
                let mut of_rigid = [0.0; 2];
                for j in 0..nodes {
                    let alike = lengths.map(|length_mm| shape.alike_of(i, j, length_mm));
                    let motion = rigid.row(i).dot(&rigid.row(j));
                    for k in 0..2 {
                        of_rigid[k] += alike[k] * motion;
                        for (row, value) in rows[k].iter_mut().zip(columns.row(j).iter()) {
                            *row += alike[k] * value;
                        }
                    }
                    let [far, near] = alike;
                    for (sum, product) in
                        products.iter_mut().zip([far * far, far * near, near * near])
                    {
                        *sum += product;
                    }
                }
                for k in 0..2 {
                    rigid_left[k] += 1.0 - of_rigid[k];
                    of_columns[k] += columns.row(i).transpose() * rows[k].transpose();
                }
            }
            at += nodes;
        }
        let [chest_left, local_left] = rigid_left.map(|sum| (sum / at.max(1) as f64).max(1e-9));
        let chest = f64::min(CHEST_MM * CHEST_MM, misfit / chest_left);
        let local = (misfit - chest * chest_left) / local_left;
        let trace = (chest + local) * at as f64;
        let squares = chest * chest * products[0]
            + 2.0 * chest * local * products[1]
            + local * local * products[2];
        let [far, near] = of_columns;
        Self {
            of_columns: chest * far + local * near,
            independent: trace * trace / squares.max(f64::MIN_POSITIVE),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mammotwin_data::Vec3;

    fn precision() -> Precision {
        Precision {
            keys: [Parameter::Right, Parameter::Left, Parameter::Skin]
                .map(|p| p.key().into())
                .into(),
            covariance: vec![0.0025, 0.003, 0.0, 0.003, 0.01, -0.01, 0.0, -0.01, 0.04],
            independent: 40.0,
        }
    }

    #[test]
    fn draws_have_the_deviations_and_the_correlation_they_are_made_of() {
        let precision = precision();
        assert_eq!(precision.of_side(Side::Left), Some(0.1));
        let shared = precision.correlation(Parameter::Left, Parameter::Right).unwrap();
        assert!((shared - 0.6).abs() < 1e-12 && precision.of(Parameter::Fascia).is_none());
        let mut moduli = Moduli::new(0.3, 0.2);
        moduli.shared.skin_kpa = Some(4.0);
        let draws = precision.draws(moduli, 20_000);
        let logs: [Vec<f64>; 3] = [
            draws.iter().map(|draw| (draw.right_kpa / 0.3).ln()).collect(),
            draws.iter().map(|draw| (draw.left_kpa / 0.2).ln()).collect(),
            draws.iter().map(|draw| (draw.shared.skin_kpa.unwrap() / 4.0).ln()).collect(),
        ];
        for i in 0..3 {
            for j in 0..3 {
                let product = logs[i].iter().zip(&logs[j]).map(|(a, b)| a * b).sum::<f64>();
                let (found, want) = (product / 20_000.0, precision.covariance[3 * i + j]);
                let scale = (precision.covariance[4 * i] * precision.covariance[4 * j]).sqrt();
                assert!((found - want).abs() < 0.03 * scale, "{i} {j}: {found} {want}");
            }
        }
        assert!(Precision::default().draws(moduli, 10).is_empty());
    }

    /// The same from the whole covariance.
    #[test]
    fn errors_spread_as_their_covariance_does() {
        let at = |n: usize| {
            let turn = 0.7 * n as f64;
            Vec3::new(60.0 * turn.cos(), 10.0 * n as f64, 40.0 * turn.sin())
        };
        let shape = |from: usize, count: usize| Shape {
            points: (from..from + count).map(at).collect(),
            normals: (from..from + count).map(|n| at(n).normalize()).collect(),
        };
        let shapes = [shape(0, 9), shape(20, 7)];
        let any = |rows: usize, columns: usize| {
            DMatrix::from_fn(rows, columns, |i, j| ((3 * i + 7 * j) as f64).sin())
        };
        let (rigid, columns) = (any(16, 4).qr().q(), any(16, 2));
        let misfit = 2.3;
        let found = Spread::new(&shapes, &rigid, &columns, misfit);
        let whole = |length_mm: f64| {
            let mut all = DMatrix::zeros(16, 16);
            all.view_mut((0, 0), (9, 9)).copy_from(&shapes[0].alike(length_mm));
            all.view_mut((9, 9), (7, 7)).copy_from(&shapes[1].alike(length_mm));
            all
        };
        let [far, near] = [CHEST_LENGTH_MM, ALIKE_MM].map(whole);
        let left = |all: &DMatrix<f64>| {
            // Of each pose its own part of the motions.
            let own = [(0, 9), (9, 7)].map(|(at, nodes)| {
                let rigid = rigid.rows(at, nodes);
                (rigid.transpose() * all.view((at, at), (nodes, nodes)) * rigid).trace()
            });
            (all.trace() - own[0] - own[1]) / 16.0
        };
        let chest = f64::min(CHEST_MM * CHEST_MM, misfit / left(&far));
        let covariance = chest * &far + (misfit - chest * left(&far)) / left(&near) * &near;
        let want = columns.transpose() * &covariance * &columns;
        assert!((found.of_columns - &want).norm() < 1e-12 * want.norm());
        let independent = covariance.trace().powi(2) / covariance.norm_squared();
        assert!((found.independent / independent - 1.0).abs() < 1e-12);
    }
}
