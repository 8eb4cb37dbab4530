//! The energy at one point of a sheet, with its derivatives by the nodes.
//!
//! With the in-plane deformation F (3×2) and D = det FᵀF, the first invariant of a sheet that keeps
//! its volume is I₁ = tr FᵀF + 1/D; where it wrinkles, I₁ is that of pure tension or of rest.

use super::{Block, Order, stretched};
use crate::materials::{InvariantEnergy, Law, MaterialError};
use mammotwin_data::{Mat3, Vec3};
use nalgebra::{Matrix3x2, Vector2};

/// Adds the energy of `volume` (mm³) of a sheet at the deformation `f` in its plane, with shape
/// functions of these `gradients` (1/mm), and its derivatives to `block`.
pub(super) fn add<const N: usize>(
    law: &Law,
    volume: f64,
    f: &Matrix3x2<f64>,
    gradients: &[Vector2<f64>; N],
    order: Order,
    block: &mut Block,
) -> Result<(), MaterialError> {
    let (f1, f2): (Vec3, Vec3) = (f.column(0).into(), f.column(1).into());
    let normal = f1.cross(&f2);
    let d = normal.norm_squared();
    // A face squeezed to a line: the negation also catches a NaN.
    if !(d > 0.0) {
        return Err(MaterialError::Inverted { j: d.sqrt() });
    }
    if let Some(law) = law.stretch_energy() {
        let principal = stretched::of_sheet(f).ok_or(MaterialError::Inverted { j: d.sqrt() })?;
        let jet = stretched::sheet_energy(law, &principal.stretches);
        let gradients = gradients.map(|g| Vec3::new(g.x, g.y, 0.0));
        stretched::add(&principal, &jet, &gradients, volume, order, block);
        return Ok(());
    }
    let sheet = Sheet::of(f.norm_squared(), d);
    let w = law.distortion(sheet.i1, 1.0)?;
    block.energy += volume * w.w;
    if order == Order::Value {
        return Ok(());
    }
    // Moving node a by u turns the normal by u × wₐ.
    let turn = gradients.map(|g| g.x * f2 - g.y * f1);
    let d_area = turn.map(|w| 2.0 * w.cross(&normal));
    let d_trace = gradients.map(|g| 2.0 * (f * g));
    let d_i1: [Vec3; N] =
        std::array::from_fn(|a| sheet.by_trace * d_trace[a] + sheet.by_area * d_area[a]);
    for a in 0..N {
        block.gradient[a] += volume * w.w1 * d_i1[a];
    }
    if order == Order::Gradient {
        return Ok(());
    }
    for a in 0..N {
        for b in 0..=a {
            let crossed = gradients[a].x * gradients[b].y - gradients[a].y * gradients[b].x;
            let dd_area = 2.0
                * (Mat3::from_diagonal_element(turn[a].dot(&turn[b]))
                    - turn[b] * turn[a].transpose()
                    - crossed * normal.cross_matrix());
            let dd_trace = Mat3::from_diagonal_element(2.0 * gradients[a].dot(&gradients[b]));
            let [tt, ta, aa] = sheet.second;
            let (ta_1, ta_2) =
                (d_trace[a] * d_area[b].transpose(), d_area[a] * d_trace[b].transpose());
            let dd_i1 = sheet.by_trace * dd_trace
                + sheet.by_area * dd_area
                + tt * d_trace[a] * d_trace[b].transpose()
                + ta * (ta_1 + ta_2)
                + aa * d_area[a] * d_area[b].transpose();
            block.hessian[a][b] += volume * (w.w1 * dd_i1 + w.w11 * d_i1[a] * d_i1[b].transpose());
        }
    }
    Ok(())
}

/// The relaxed first invariant as a function of the trace of FᵀF and D = det FᵀF.
struct Sheet {
    i1: f64,
    by_trace: f64,
    by_area: f64,
    /// Second derivatives: by the trace twice, by both, by D twice.
    second: [f64; 3],
}

impl Sheet {
    fn of(trace: f64, d: f64) -> Self {
        // λ₁² is the larger root of c² - trace c + D = 0.
        let root = (0.25 * trace * trace - d).max(0.0).sqrt();
        let c = 0.5 * trace + root;
        if d >= c.sqrt() {
            // Taut: λ₂² = D/c is at least 1/λ₁.
            let (by_area, aa) = (-1.0 / (d * d), 2.0 / (d * d * d));
            return Self { i1: trace + 1.0 / d, by_trace: 1.0, by_area, second: [0.0, 0.0, aa] };
        }
        if c <= 1.0 {
            return Self { i1: 3.0, by_trace: 0.0, by_area: 0.0, second: [0.0; 3] };
        }
        let (i1, slope, bend) = (c + 2.0 / c.sqrt(), 1.0 - c.powf(-1.5), 1.5 * c.powf(-2.5));
        // From (2c - trace) dc = c d(trace) - dD, and once more.
        let gap = 2.0 * root;
        let (c_t, c_d) = (c / gap, -1.0 / gap);
        let c_tt = 2.0 * c_t * (1.0 - c_t) / gap;
        let c_td = c_d * (1.0 - 2.0 * c_t) / gap;
        let c_dd = -2.0 * c_d * c_d / gap;
        Self {
            i1,
            by_trace: slope * c_t,
            by_area: slope * c_d,
            second: [
                bend * c_t * c_t + slope * c_tt,
                bend * c_t * c_d + slope * c_td,
                bend * c_d * c_d + slope * c_dd,
            ],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Verifies: wrinkled sheet | pure tension | 1e-12
    #[test]
    fn a_sheet_pulled_one_way_carries_the_stress_of_pure_tension_however_narrow_it_is() {
        for (long, narrow) in [(1.3f64, 0.5f64), (1.3, 0.85), (2.0, 0.3)] {
            let (c, n) = (long * long, narrow * narrow);
            let sheet = Sheet::of(c + n, c * n);
            assert!((sheet.i1 - (c + 2.0 / long)).abs() < 1e-12);
            // Stretching across costs nothing: d i1 = by_trace d(n) + by_area d(c n).
            assert!((sheet.by_trace + sheet.by_area * c).abs() < 1e-12);
            let along = sheet.by_trace + sheet.by_area * n;
            assert!((along - (1.0 - c.powf(-1.5))).abs() < 1e-12);
        }
    }

    /// Verifies: slack and taut sheet | closed form | exact; 1e-12
    #[test]
    fn a_sheet_that_shrinks_both_ways_is_slack_and_one_that_grows_is_taut() {
        let slack = Sheet::of(0.9 + 0.8, 0.9 * 0.8);
        assert_eq!((slack.i1, slack.by_trace, slack.by_area), (3.0, 0.0, 0.0));
        let taut = Sheet::of(1.5 + 1.2, 1.5 * 1.2);
        assert!((taut.i1 - (2.7 + 1.0 / 1.8)).abs() < 1e-12);
    }

    #[test]
    fn derivatives_of_the_invariant_are_differences() {
        for (t, d) in [(2.7, 1.8), (1.9, 0.55), (2.4, 0.7)] {
            let h = 1e-5;
            let diff = |plus: f64, minus: f64| (plus - minus) / (2.0 * h);
            let at = Sheet::of;
            let here = at(t, d);
            assert!((diff(at(t + h, d).i1, at(t - h, d).i1) - here.by_trace).abs() < 1e-8);
            assert!((diff(at(t, d + h).i1, at(t, d - h).i1) - here.by_area).abs() < 1e-8);
            let tt = diff(at(t + h, d).by_trace, at(t - h, d).by_trace);
            let td = diff(at(t, d + h).by_trace, at(t, d - h).by_trace);
            let dd = diff(at(t, d + h).by_area, at(t, d - h).by_area);
            for (got, want) in here.second.into_iter().zip([tt, td, dd]) {
                assert!((got - want).abs() < 1e-6 * (1.0 + want.abs()), "{t} {d}: {got} {want}");
            }
        }
    }
}
