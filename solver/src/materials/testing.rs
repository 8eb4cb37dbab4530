//! The laws that every material obeys, checked in one call from each material's tests.

use super::Material;
use mammotwin_data::Mat3;

/// Sixth-order central difference of `g` along a line, at 0.
fn derivative(g: impl Fn(f64) -> Mat3) -> Mat3 {
    let h = 1e-3;
    let d = |n: f64| g(n * h) - g(-n * h);
    (45.0 * d(1.0) - 9.0 * d(2.0) + d(3.0)) / (60.0 * h)
}

/// Panics unless `material` is stress-free at rest, frame-indifferent, refuses an inverted
/// element, has the shear and bulk moduli (kPa) that it claims, and its stress and tangent are
/// the derivatives of its energy.
///
/// # Panics
/// When a law is broken.
#[track_caller]
pub fn check(material: &impl Material, shear: f64, bulk: f64) {
    let id = Mat3::identity();
    let f = Mat3::new(1.08, 0.11, -0.05, 0.04, 0.93, 0.09, -0.07, 0.06, 1.02);
    let df = Mat3::new(0.3, -0.7, 0.2, 0.5, 0.1, -0.4, -0.6, 0.8, 0.9);
    let energy = |f: &Mat3| material.energy(f).expect("a moderate deformation");
    let stress = |f: &Mat3| material.stress(f).expect("a moderate deformation");
    let tangent = |f: &Mat3, df: &Mat3| material.tangent(f, df).expect("a moderate deformation");
    let close = |what: &str, got: Mat3, want: Mat3, scale: f64| {
        let error = (got - want).norm() / scale;
        assert!(error < 1e-9, "{what}: relative error {error:.1e}\ngot {got}want {want}");
    };

    close("energy at rest", id * energy(&id), Mat3::zeros(), shear);
    close("stress at rest", stress(&id), Mat3::zeros(), shear);

    let dpsi = derivative(|t| id * energy(&(f + t * df)));
    close("stress = dψ/dF", id * stress(&f).dot(&df), dpsi, bulk);
    let dp = derivative(|t| stress(&(f + t * df)));
    close("tangent = dP/dF", tangent(&f, &df), dp, bulk);

    let shear_strain = Mat3::new(0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0);
    close("initial shear modulus", tangent(&id, &shear_strain), 2.0 * shear * shear_strain, shear);
    close("initial bulk modulus", tangent(&id, &id), 3.0 * bulk * id, bulk);

    let q = *nalgebra::Rotation3::from_euler_angles(0.4, -1.1, 2.0).matrix();
    close("frame indifference", stress(&(q * f)), q * stress(&f), bulk);
    close("isotropy", stress(&(f * q)), stress(&f) * q, bulk);

    let mirrored = Mat3::from_diagonal(&[1.0, 1.0, -1.0].into());
    assert!(material.energy(&mirrored).is_err(), "an inverted element has no energy");
    assert!(material.energy(&(id * f64::NAN)).is_err(), "NaN has no energy");
}
