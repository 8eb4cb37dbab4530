//! What an energy of the principal stretches adds to an element, solid or sheet.

use super::{Block, Order};
use crate::materials::stretches::{Jet3, Principal, Stiffness, StretchEnergy};
use mammotwin_data::{Mat3, Vec3};
use nalgebra::Matrix3x2;

/// Adds energy and derivatives of `volume` (mm³) with the energy density `jet`, whose shape
/// functions have these `gradients` (1/mm).
pub(super) fn add(
    principal: &Principal,
    jet: &Jet3,
    gradients: &[Vec3],
    volume: f64,
    order: Order,
    block: &mut Block,
) {
    block.energy += volume * jet.value;
    if order == Order::Value {
        return;
    }
    let stress = volume * principal.tensor(&jet.d1);
    for (a, gradient) in gradients.iter().enumerate() {
        block.gradient[a] += stress * gradient;
    }
    if order == Order::Gradient {
        return;
    }
    let stiffness = Stiffness::new(principal, jet);
    for (a, gradient) in gradients.iter().enumerate() {
        let row = volume * stiffness.turned(gradient);
        for (b, column) in gradients[..=a].iter().enumerate() {
            block.hessian[a][b] += stiffness.between(&row, &stiffness.turned(column));
        }
    }
}

/// Principal stretches of an incompressible sheet with the deformation `f` in its plane. The third
/// is zero: nothing of the sheet's energy moves along it, which is right for tangents.
pub(super) fn of_sheet(f: &Matrix3x2<f64>) -> Option<Principal> {
    let square = Mat3::from_columns(&[f.column(0).into(), f.column(1).into(), Vec3::zeros()]);
    let mut principal = Principal::of(&square)?;
    principal.stretches.z = 0.0;
    let (one, two) = (principal.left.column(0), principal.left.column(1));
    let normal = one.cross(&two);
    principal.left.set_column(2, &normal);
    Some(principal)
}

/// Energy of an incompressible sheet by its two stretches, relaxed where it wrinkles.
pub(super) fn sheet_energy(law: &dyn StretchEnergy, stretches: &Vec3) -> Jet3 {
    let (along, across) = if stretches.x >= stretches.y { (0, 1) } else { (1, 0) };
    let long = stretches[along];
    let mut sheet = Jet3 { value: 0.0, d1: Vec3::zeros(), d2: Mat3::zeros() };
    let natural = long.powf(-0.5);
    if stretches[across] >= natural {
        let (l, m) = (stretches.x, stretches.y);
        let thin = 1.0 / (l * m);
        let jet = law.of_stretches(&Vec3::new(l, m, thin));
        let slope = [-thin / l, -thin / m];
        for i in 0..2 {
            sheet.d1[i] = jet.d1[i] + jet.d1.z * slope[i];
            for j in 0..2 {
                let bend = slope[i] * slope[j] / thin * if i == j { 2.0 } else { 1.0 };
                sheet.d2[(i, j)] = jet.d2[(i, j)]
                    + jet.d2[(i, 2)] * slope[j]
                    + jet.d2[(j, 2)] * slope[i]
                    + jet.d2[(2, 2)] * slope[i] * slope[j]
                    + jet.d1.z * bend;
            }
        }
        sheet.value = jet.value;
    } else if long > 1.0 {
        let jet = law.of_stretches(&Vec3::new(long, natural, natural));
        let (slope, bend) = (-0.5 * natural / long, 0.75 * natural / (long * long));
        let (side, sides) = (jet.d1.y + jet.d1.z, jet.d2.fixed_view::<2, 2>(1, 1).sum());
        sheet.value = jet.value;
        sheet.d1[along] = jet.d1.x + side * slope;
        sheet.d2[(along, along)] = jet.d2.m11
            + 2.0 * (jet.d2.m12 + jet.d2.m13) * slope
            + sides * slope * slope
            + side * bend;
    }
    sheet
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::materials::mooney_rivlin::MooneyRivlin;

    const SKIN: MooneyRivlin = MooneyRivlin { shear_kpa: 3.0, bulk_kpa: 1e3, second_share: 0.25 };

    #[test]
    fn derivatives_of_a_sheet_are_differences() {
        let h = 1e-5;
        for (l, m) in [(1.3, 1.2), (1.2, 1.2), (1.4, 0.7), (0.7, 1.4), (0.9, 0.8)] {
            let at = |l, m| sheet_energy(&SKIN, &Vec3::new(l, m, 0.0));
            let here = at(l, m);
            for (axis, plus, minus) in
                [(0, at(l + h, m), at(l - h, m)), (1, at(l, m + h), at(l, m - h))]
            {
                let slope = (plus.value - minus.value) / (2.0 * h);
                assert!((slope - here.d1[axis]).abs() < 1e-8, "{l} {m}: {slope} {}", here.d1);
                let bend = (plus.d1 - minus.d1) / (2.0 * h);
                assert!((bend - here.d2.column(axis)).norm() < 1e-6, "{l} {m}: {bend} {}", here.d2);
            }
        }
    }

    /// Verifies: wrinkled sheet of a law of stretches | pure tension | 1e-12
    #[test]
    fn a_sheet_carries_no_compression_and_wrinkles_to_pure_tension() {
        let slack = sheet_energy(&SKIN, &Vec3::new(0.9, 0.8, 0.0));
        assert_eq!((slack.value, slack.d1), (0.0, Vec3::zeros()));
        for narrow in [0.2, 0.6, 1.5f64.powf(-0.5) - 1e-12] {
            let tension = sheet_energy(&SKIN, &Vec3::new(narrow, 1.5, 0.0));
            assert_eq!(tension.d1.x, 0.0);
            // Nominal stress of a bar: Cauchy stress over stretch.
            let bar = (1.5 * 1.5 - 1.0 / 1.5) * 3.0 * (0.75 + 0.25 / 1.5) / 1.5;
            assert!((tension.d1.y - bar).abs() < 1e-12 * bar, "{} {bar}", tension.d1.y);
        }
    }
}
