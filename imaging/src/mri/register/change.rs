//! What a chest wall that changes its shape adds to the uncertainty of its rigid motion.
//!
//! The change is taken for a random field. Its own rigid part over the places where the motion is
//! asked for cannot be told from the motion, and is larger the fewer patches of the wall change
//! independently.

use mammotwin_data::Vec3;
use nalgebra::{Matrix3x6, Matrix6};
use rayon::prelude::*;

/// So many places at most are compared in pairs.
const PLACES: usize = 600;

/// Covariance of translation (mm) and rotation vector (rad) about `center`, fitted over `places`
/// (mm), when the wall changes by `rms_mm` beyond them: a field with the correlation of cubic
/// B-splines of `spacing_mm` with independent coefficients, alike along each axis.
///
/// `None` when the places leave a motion open.
pub(super) fn covariance(
    places: &[Vec3],
    center: &Vec3,
    rms_mm: f64,
    spacing_mm: f64,
) -> Option<Matrix6<f64>> {
    let some: Vec<Vec3> =
        places.iter().step_by(places.len().div_ceil(PLACES).max(1)).copied().collect();
    let rows: Vec<Matrix3x6<f64>> = some.iter().map(|p| rows(&(p - center))).collect();
    let normal: Matrix6<f64> = rows.iter().map(|row| row.tr_mul(row)).sum();
    // The autocorrelation of a cubic B-spline is the one of degree 7, of variance 2/3: nearly normal.
    let alike = |a: &Vec3, b: &Vec3| (-0.75 * (a - b).norm_squared() / spacing_mm.powi(2)).exp();
    let of = |(p, row): (&Vec3, &Matrix3x6<f64>)| -> Matrix6<f64> {
        let sum: Matrix3x6<f64> =
            some.iter().zip(&rows).map(|(q, other)| alike(p, q) * other).sum();
        row.tr_mul(&sum)
    };
    // One result a place, added in order: the same bits for any number of threads.
    let parts: Vec<Matrix6<f64>> = some.par_iter().zip(&rows).map(of).collect();
    let spread: Matrix6<f64> = parts.iter().sum();
    let inverse = normal.cholesky()?.inverse();
    // Of a field with unit variance along each axis, so much is left beside its rigid part.
    let left = 3.0 - (inverse * spread).trace() / some.len() as f64;
    (left > 0.0).then(|| inverse * spread * inverse * (rms_mm * rms_mm / left))
}

/// Displacement at an arm by translation and rotation vector.
pub(super) fn rows(arm: &Vec3) -> Matrix3x6<f64> {
    let mut rows = Matrix3x6::zeros();
    rows.fixed_view_mut::<3, 3>(0, 0).fill_with_identity();
    rows.fixed_view_mut::<3, 3>(0, 3).copy_from(&-arm.cross_matrix());
    rows
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mri::lattice::Lattice;
    use nalgebra::Vector6;
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};

    /// Rigid parts of drawn fields over a bent wall scatter as told, by what they leave of the fields.
    #[test]
    fn rigid_parts_of_drawn_changes_scatter_as_stated() {
        let spacing_mm = 70.0;
        let bent = |n: usize| {
            let (u, v) = ((n % 20) as f64 / 19.0 - 0.5, (n / 20) as f64 / 14.0 - 0.5);
            Vec3::new(260.0 * u, 60.0 - 200.0 * u * u, 160.0 * v)
        };
        let places: Vec<Vec3> = (0..300).map(bent).collect();
        let center = Vec3::new(0.0, 20.0, 0.0);
        let low = places.iter().fold(places[0], |a, p| a.inf(p));
        let high = places.iter().fold(places[0], |a, p| a.sup(p));
        let lattice = Lattice::covering(&low, &high, spacing_mm);
        let supports: Vec<_> = places.iter().map(|p| lattice.at(p)).collect();
        let rows: Vec<_> = places.iter().map(|p| rows(&(p - center))).collect();
        let normal: Matrix6<f64> = rows.iter().map(|row| row.tr_mul(row)).sum();
        let inverse = normal.try_inverse().unwrap();
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(5);
        let (mut found, mut left) = (Matrix6::zeros(), 0.0);
        let draws = 500;
        for _ in 0..draws {
            let controls: Vec<Vec3> = (0..lattice.count())
                .map(|_| Vec3::from_fn(|_, _| StandardNormal.sample(&mut random)))
                .collect();
            let moved: Vec<Vec3> = supports
                .iter()
                .map(|support| support.iter().map(|s| s.weight * controls[s.index]).sum())
                .collect();
            let right: Vector6<f64> = rows.iter().zip(&moved).map(|(row, u)| row.tr_mul(u)).sum();
            let fit = inverse * right;
            found += fit * fit.transpose() / f64::from(draws);
            let beyond = rows.iter().zip(&moved).map(|(row, u)| (u - row * fit).norm_squared());
            left += beyond.sum::<f64>() / (places.len() as f64 * f64::from(draws));
        }
        let stated = covariance(&places, &center, left.sqrt(), spacing_mm).unwrap();
        for n in 0..6 {
            let ratio = (stated[(n, n)] / found[(n, n)]).sqrt();
            println!("{n}: stated {:.4}, found {:.4}", stated[(n, n)].sqrt(), found[(n, n)].sqrt());
            assert!((0.8..1.25).contains(&ratio), "{n}: {ratio}");
        }
    }

    #[test]
    fn a_change_in_many_small_patches_matters_less() {
        let places: Vec<Vec3> = (0..400)
            .map(|n| {
                Vec3::new(f64::from(n % 20) * 10.0, 0.3 * f64::from(n % 7), f64::from(n / 20) * 8.0)
            })
            .collect();
        let center = places.iter().sum::<Vec3>() / 400.0;
        let of = |spacing: f64| covariance(&places, &center, 1.0, spacing).unwrap()[(1, 1)].sqrt();
        assert!(of(10.0) < 0.4 * of(60.0) && of(60.0) < 1.0, "{} {}", of(10.0), of(60.0));
    }
}
