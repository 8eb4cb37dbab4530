//! The laws that every material obeys, checked in one call from each material's tests.

use super::Material;
use mammotwin_data::{Mat3, Vec3};

/// A moderate deformation without any symmetry.
pub fn moderate() -> Mat3 {
    Mat3::new(1.08, 0.11, -0.05, 0.04, 0.93, 0.09, -0.07, 0.06, 1.02)
}

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
    let f = moderate();
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

    let q = *nalgebra::Rotation3::from_euler_angles(0.4, -1.1, 2.0).matrix();
    let stretched = |a, b, c| q * Mat3::from_diagonal(&[a, b, c].into()) * f / f.norm();
    let bar = |narrow: f64| Mat3::from_diagonal(&[1.1, 0.95, narrow].into()) * q;
    // No, two, and all but two equal stretches.
    for f in [f, stretched(1.9, 1.7, 1.8), bar(0.95), bar(0.95 * (1.0 + 1e-7)), bar(0.9501)] {
        let dpsi = derivative(|t| id * energy(&(f + t * df)));
        close("stress = dψ/dF", id * stress(&f).dot(&df), dpsi, bulk);
        let dp = derivative(|t| stress(&(f + t * df)));
        close("tangent = dP/dF", tangent(&f, &df), dp, bulk);
    }

    let shear_strain = Mat3::new(0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0);
    close("initial shear modulus", tangent(&id, &shear_strain), 2.0 * shear * shear_strain, shear);
    close("initial bulk modulus", tangent(&id, &id), 3.0 * bulk * id, bulk);

    close("frame indifference", stress(&(q * f)), q * stress(&f), bulk);
    close("isotropy", stress(&(f * q)), stress(&f) * q, bulk);
    let cauchy = stress(&f) * f.transpose();
    close("balance of moments", cauchy, cauchy.transpose(), bulk);
    let other = Mat3::new(-0.2, 0.9, 0.4, 0.7, -0.3, 0.1, 0.5, 0.6, -0.8);
    let (one, two) = (tangent(&f, &df).dot(&other), tangent(&f, &other).dot(&df));
    close("symmetry of the tangent", id * one, id * two, bulk);

    let mirrored = Mat3::from_diagonal(&[1.0, 1.0, -1.0].into());
    assert!(material.energy(&mirrored).is_err(), "an inverted element has no energy");
    assert!(material.energy(&(id * f64::NAN)).is_err(), "NaN has no energy");
}

/// Stress (kPa) of a law in motions that keep the volume, in closed form.
pub struct Curves<'a> {
    /// Cauchy stress along a bar of this stretch, free at its sides.
    pub uniaxial: &'a dyn Fn(f64) -> f64,
    /// Cauchy stress in a sheet of this stretch both ways, free at its faces.
    pub equibiaxial: &'a dyn Fn(f64) -> f64,
    /// Shear stress at this amount of simple shear.
    pub shear: &'a dyn Fn(f64) -> f64,
}

/// Panics unless the stress of `material` is that of the closed forms, in stretch and compression.
///
/// # Panics
/// When it is not.
#[track_caller]
pub fn check_curves(material: &impl Material, curves: &Curves) {
    let cauchy = |f: &Mat3| material.stress(f).expect("within the law") * f.transpose();
    let diagonal = |a, b, c| Mat3::from_diagonal(&Vec3::new(a, b, c));
    let close = |what: &str, at: f64, got: f64, want: f64| {
        let scale = want.abs().max(1e-3);
        assert!((got - want).abs() < 1e-11 * scale, "{what} {at}: {got}, closed form {want}");
    };
    for l in [0.7f64, 0.9, 0.999_999, 1.0, 1.02, 1.2, 1.4] {
        let narrow = l.powf(-0.5);
        let bar = cauchy(&diagonal(l, narrow, narrow));
        close("uniaxial", l, bar[(0, 0)] - bar[(1, 1)], (curves.uniaxial)(l));
        let wide = l.sqrt();
        let sheet = cauchy(&diagonal(wide, wide, 1.0 / l));
        close("equibiaxial", wide, sheet[(0, 0)] - sheet[(2, 2)], (curves.equibiaxial)(wide));
    }
    for gamma in [1e-6, 0.1, 0.5, 0.9] {
        let mut f = Mat3::identity();
        f[(0, 1)] = gamma;
        close("shear", gamma, cauchy(&f)[(0, 1)], (curves.shear)(gamma));
    }
}

/// [`check_curves`] for a law of I₁ alone, with `stiffness` = 2 ∂w/∂I₁ (kPa) as a function of I₁ - 3.
///
/// # Panics
/// When its stress is not that of the closed forms.
#[track_caller]
pub fn check_first_invariant(material: &impl Material, stiffness: impl Fn(f64) -> f64) {
    check_curves(
        material,
        &Curves {
            uniaxial: &|l| (l * l - 1.0 / l) * stiffness(l * l + 2.0 / l - 3.0),
            equibiaxial: &|l| {
                (l.powi(2) - l.powi(-4)) * stiffness(2.0 * l.powi(2) + l.powi(-4) - 3.0)
            },
            shear: &|gamma| stiffness(gamma * gamma) * gamma,
        },
    );
}

/// The larger principal stretch in simple shear.
pub fn shear_stretch(gamma: f64) -> f64 {
    0.5 * gamma + (1.0 + 0.25 * gamma * gamma).sqrt()
}

/// Panics unless two laws agree in energy, stress and tangent, to a fraction of the stress.
///
/// # Panics
/// When they do not.
#[track_caller]
pub fn check_equal(a: &impl Material, b: &impl Material, tolerance: f64) {
    let df = Mat3::new(0.3, -0.7, 0.2, 0.5, 0.1, -0.4, -0.6, 0.8, 0.9);
    for f in [moderate(), Mat3::identity(), 1.3 * moderate()] {
        let values = |m: &dyn Material| {
            let known = "within the laws";
            (
                m.energy(&f).expect(known),
                m.stress(&f).expect(known),
                m.tangent(&f, &df).expect(known),
            )
        };
        let (one, two) = (values(a), values(b));
        let scale = two.2.norm();
        assert!((one.0 - two.0).abs() <= tolerance * scale, "energy {} {}", one.0, two.0);
        assert!((one.1 - two.1).norm() <= tolerance * scale, "stress {}{}", one.1, two.1);
        assert!((one.2 - two.2).norm() <= tolerance * scale, "tangent {}{}", one.2, two.2);
    }
}
