//! Whether something smooth is left that no effect explains.

use super::{budget::Whitener, evidence::Evidence};
use crate::span::orthonormal;
use nalgebra::{DMatrix, DVector};

/// Smooth shapes in which something left over is looked for, per pose, and their length (mm).
const SMOOTH_SHAPES: usize = 12;
const SMOOTH_LENGTH_MM: f64 = 35.0;
/// A shape that is worth less than this part of the smoothest one is none.
const LEAST_SMOOTH: f64 = 0.01;
/// A direction of which less than this part (the sine of its angle) lies beside what is fitted anyway tells nothing.
const LEAST_LEFT: f64 = 0.3;
/// Quantile 99.9 % of the normal distribution.
pub(crate) const RARE: f64 = 3.09;

/// The smoothest shapes (mm) beside rigid motions that the residuals of the seen poses may have, pose by pose, and their
/// rigid motions, as columns.
#[derive(Debug, Clone)]
pub(super) struct Rest {
    shapes: Vec<DVector<f64>>,
    rigid: Vec<DVector<f64>>,
}

impl Rest {
    pub fn new(evidence: &Evidence, seen: &[usize]) -> Self {
        let nodes = evidence.nodes();
        let (mut shapes, mut rigid) = (Vec::new(), Vec::new());
        for (block, &p) in seen.iter().enumerate() {
            let pose = &evidence.shapes[p];
            let whole = |part: &DVector<f64>| {
                let mut column = DVector::zeros(nodes * seen.len());
                column.rows_mut(block * nodes, nodes).copy_from(part);
                column
            };
            let modes = pose.rigid_modes();
            let motions = orthonormal(&DMatrix::from_columns(&modes));
            let alike = pose.alike(SMOOTH_LENGTH_MM);
            let bent = &alike - &motions * (motions.transpose() * &alike);
            let bent = &bent - (&bent * &motions) * motions.transpose();
            let eigen = bent.symmetric_eigen();
            let mut order: Vec<usize> = (0..nodes).collect();
            order.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]));
            let least = order.first().map_or(0.0, |&k| LEAST_SMOOTH * eigen.eigenvalues[k]);
            let smooth =
                order.iter().take(SMOOTH_SHAPES).filter(|&&k| eigen.eigenvalues[k] > least);
            shapes.extend(smooth.map(|&k| whole(&eigen.eigenvectors.column(k).into_owned())));
            rigid.extend(modes.iter().map(whole));
        }
        Self { shapes, rigid }
    }

    /// Square of what seen residuals (mm) have in smooth shapes beyond rigid motions and `fitted` (mm), in standard
    /// deviations, and the value that errors exceed once in a thousand times, with a part of size `systematic` that
    /// is no error of the budget.
    pub fn of(
        &self,
        whitener: &Whitener,
        fitted: &[DVector<f64>],
        residual: &DVector<f64>,
        systematic: f64,
    ) -> [f64; 2] {
        let directions = self.directions(whitener, fitted);
        if directions.ncols() == 0 {
            return [0.0; 2];
        }
        let left = directions.transpose() * whitener.whiten(residual);
        [left.norm_squared(), rare(directions.ncols() as f64, systematic.powi(2))]
    }

    /// Orthonormal directions of whitened residuals in which something smooth shows beside rigid motions and `fitted` (mm).
    ///
    /// They are of the space that the shapes span, not of the shapes, by the sines of its angles to what is fitted (Björck &
    /// Golub, *Math. Comput.* 27 (1973) 579): one of which little is left tells nothing.
    fn directions(&self, whitener: &Whitener, fitted: &[DVector<f64>]) -> DMatrix<f64> {
        let white = |columns: &[DVector<f64>]| -> Vec<DVector<f64>> {
            columns.iter().map(|column| whitener.whiten(column)).collect()
        };
        let span = |columns: &[DVector<f64>]| match columns {
            [] => DMatrix::zeros(whitener.rows(), 0),
            _ => orthonormal(&DMatrix::from_columns(columns)),
        };
        let mut known = white(&self.rigid);
        known.extend(white(fitted));
        let (known, shapes) = (span(&known), span(&white(&self.shapes)));
        let beside = &shapes - &known * (known.transpose() * &shapes);
        let eigen = (beside.transpose() * &beside).symmetric_eigen();
        let squares = eigen.eigenvalues.iter().zip(eigen.eigenvectors.column_iter());
        let kept: Vec<DVector<f64>> = squares
            .filter(|(square, _)| **square > LEAST_LEFT * LEAST_LEFT)
            .map(|(square, direction)| &beside * direction / square.sqrt())
            .collect();
        if kept.is_empty() {
            DMatrix::zeros(whitener.rows(), 0)
        } else {
            DMatrix::from_columns(&kept)
        }
    }
}

/// The value that the sum of `count` squares of normal numbers, whose means have the squared sum `noncentral`, exceeds
/// once in a thousand times (Patnaik, *Biometrika* 36 (1949) 202; Wilson & Hilferty, *PNAS* 17 (1931) 684).
pub(super) fn rare(count: f64, noncentral: f64) -> f64 {
    let (mean, spread) = (count + noncentral, count + 2.0 * noncentral);
    let freedom = mean * mean / spread;
    let third = 2.0 / (9.0 * freedom);
    mean * (1.0 - third + RARE * third.sqrt()).powi(3)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)] // a test may fail at once
mod tests {
    use super::{
        super::{
            observe::{part, rows},
            tests::{evidence as known, nothing},
        },
        *,
    };
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    #[test]
    fn one_sum_of_squares_in_a_thousand_is_rarer() {
        // Tables of chi-square.
        for (count, table) in [(3.0, 16.27), (9.0, 27.88), (24.0, 51.18)] {
            assert!((rare(count, 0.0) / table - 1.0).abs() < 0.02, "{count}");
        }
        let mut random = ChaCha8Rng::seed_from_u64(3);
        let (count, mean) = (9, 2.0);
        let limit = rare(f64::from(count), mean * mean);
        let mut over = 0;
        for _ in 0..200_000 {
            let normal = |n: i32| -> f64 {
                let x: f64 = StandardNormal.sample(&mut random);
                if n == 0 { x + mean } else { x }
            };
            over += usize::from((0..count).map(normal).map(|x| x * x).sum::<f64>() > limit);
        }
        assert!((140..=270).contains(&over), "{over} of 200 000");
    }

    /// Whitened residuals of two poses: what `of` says of their draws, and what it has to say it with.
    struct Drawn {
        evidence: Evidence,
        whitener: Whitener,
        factor: DMatrix<f64>,
        fitted: Vec<DVector<f64>>,
    }

    impl Drawn {
        fn new() -> Self {
            let evidence = known(nothing());
            let (seen, nodes) = ([0, 2], evidence.nodes());
            let all = evidence.budget.covariance(&evidence.places(), &evidence.meshings);
            let rows = rows(&seen, nodes);
            let factor = all.select_rows(&rows).select_columns(&rows).cholesky().unwrap().unpack();
            let whitener = Whitener::new(&all, &seen, nodes).unwrap();
            let slopes = evidence.slopes().map(|slope| part(slope, &seen, nodes));
            Self { fitted: slopes.to_vec(), evidence, whitener, factor }
        }

        fn rest(&self) -> Rest {
            Rest::new(&self.evidence, &[0, 2])
        }

        fn errors(&self, random: &mut ChaCha8Rng) -> DVector<f64> {
            let normal = |_, _| StandardNormal.sample(random);
            &self.factor * DVector::from_fn(self.factor.nrows(), normal)
        }

        fn of(&self, rest: &Rest, residual: &DVector<f64>) -> [f64; 2] {
            rest.of(&self.whitener, &self.fitted, residual, 0.0)
        }
    }

    #[test]
    fn what_is_left_depends_on_the_space_of_the_shapes_alone() {
        let drawn = Drawn::new();
        let rest = drawn.rest();
        let mut random = ChaCha8Rng::seed_from_u64(11);
        let count = rest.shapes.len() / 2;
        let mut turned = rest.clone();
        for pose in 0..2 {
            let normal = |_: usize, _: usize| -> f64 { StandardNormal.sample(&mut random) };
            let turn = DMatrix::from_fn(count, count, normal).qr().q();
            let own = DMatrix::from_columns(&rest.shapes[pose * count..(pose + 1) * count]);
            let own = own * turn;
            for n in 0..count {
                turned.shapes[pose * count + n] = own.column(n).into_owned();
            }
        }
        for _ in 0..20 {
            let residual = drawn.errors(&mut random);
            let [[one, limit], [two, same]] = [&rest, &turned].map(|r| drawn.of(r, &residual));
            assert!((one - two).abs() < 1e-8 * one && limit == same, "{one} {two} {limit} {same}");
        }
        // Rigid motions and moduli are no rest.
        let rigid =
            DMatrix::from_columns(&rest.rigid) * DVector::from_fn(12, |n, _| n as f64 - 4.0);
        let [left, _] = drawn.of(&rest, &(rigid + 3.0 * &drawn.fitted[0] - &drawn.fitted[1]));
        assert!(left < 1e-12, "{left}");
    }

    #[test]
    fn errors_leave_as_many_squares_as_there_are_directions() {
        let drawn = Drawn::new();
        let rest = drawn.rest();
        let mut random = ChaCha8Rng::seed_from_u64(12);
        let draws = 20_000;
        let directions = rest.directions(&drawn.whitener, &drawn.fitted).transpose();
        let count = directions.nrows() as f64;
        let left = |residual: &DVector<f64>| {
            (&directions * drawn.whitener.whiten(residual)).norm_squared()
        };
        let [_, limit] = drawn.of(&rest, &drawn.errors(&mut random));
        assert_eq!(limit, rare(count, 0.0));
        let (mut sum, mut over) = (0.0, 0);
        for _ in 0..draws {
            let squares = left(&drawn.errors(&mut random));
            sum += squares / f64::from(draws);
            over += usize::from(squares > limit);
        }
        println!("{count} directions: mean {sum:.2}, {over} of {draws} over {limit:.1}");
        assert!(count >= 12.0 && (sum / count - 1.0).abs() < 0.01, "{count}: {sum}");
        assert!((10..=34).contains(&over), "{over} of {draws}");
        // A smooth shape of some standard deviations on top.
        let shape = &rest.shapes[4];
        let size = left(shape).sqrt();
        let seen = |sigma: f64, random: &mut ChaCha8Rng| {
            let found = (0..1000).filter(|_| {
                let residual = drawn.errors(random) + (sigma / size) * shape;
                left(&residual) > limit
            });
            found.count() as f64 / 1000.0
        };
        let power = [5.0, 10.0].map(|sigma| seen(sigma, &mut random));
        println!("found at 5 and 10 standard deviations: {power:.2?}");
        assert!(power[0] > 0.2 && power[1] > 0.98, "{power:?}");
    }
}
