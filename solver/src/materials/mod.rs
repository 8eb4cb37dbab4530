//! Hyperelastic materials.
//!
//! A new isotropic material is one file that implements [`InvariantEnergy`], calls
//! [`testing::check`] in its tests and has a variant in [`Law`]; stress and tangent are derived
//! here, once, for all.
//!
//! ψ(F) = w(I₁, J) + v(λ₁, λ₂, λ₃) + ½ K θ(J)², with I₁ = tr FᵀF, J = det F and the principal
//! stretches λᵢ. Most laws have the quick w alone; those that need another invariant or the
//! stretches themselves have v alone. Writing the volumetric energy as a square of a *dilatation*
//! θ loses nothing (θ = ± √(2U/K) is smooth, since U has a double root at J = 1) and lets the
//! mixed tetrahedron keep one constant compliance for every law.

mod dilatation;
pub mod exponential;
pub mod gent;
pub mod gent_coupled;
mod law;
pub mod linear;
pub mod mooney_rivlin;
pub mod neo_hookean;
pub mod neo_hookean_coupled;
pub mod ogden;
pub mod stretches;
pub mod testing;
pub mod yeoh;

pub use law::{Law, LawError};

use mammotwin_data::Mat3;
use stretches::{Principal, Stiffness, StretchEnergy};

/// Why a material has no answer at some deformation. The solver shortens its step on either.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum MaterialError {
    /// det F is zero or negative.
    #[error("element turned inside out: det F = {j:.3e}")]
    Inverted {
        /// det F.
        j: f64,
    },
    /// The chains of a Gent material are fully stretched.
    #[error("stretched past the material's limit: I1 - 3 = {strain:.3} >= {limit:.3}")]
    Locked {
        /// Ī₁ - 3.
        strain: f64,
        /// Jₘ.
        limit: f64,
    },
}

/// Value and derivatives of an energy w(I₁, J), in kPa.
#[derive(Debug, Clone, Copy, Default)]
pub struct Jet2 {
    /// w.
    pub w: f64,
    /// ∂w/∂I₁.
    pub w1: f64,
    /// ∂w/∂J.
    pub wj: f64,
    /// ∂²w/∂I₁².
    pub w11: f64,
    /// ∂²w/∂I₁∂J.
    pub w1j: f64,
    /// ∂²w/∂J².
    pub wjj: f64,
}

/// Value and derivatives of a function of one number.
#[derive(Debug, Clone, Copy, Default)]
pub struct Jet1 {
    /// Value.
    pub value: f64,
    /// First derivative.
    pub d1: f64,
    /// Second derivative.
    pub d2: f64,
}

/// An isotropic energy ψ = w(I₁, J) + v(λ₁, λ₂, λ₃) + ½ K θ(J)², per rest volume, in kPa.
pub trait InvariantEnergy {
    /// w(I₁, J), what is not volumetric. J > 0.
    ///
    /// # Errors
    /// [`MaterialError::Locked`] beyond a limiting stretch.
    fn distortion(&self, _i1: f64, _j: f64) -> Result<Jet2, MaterialError> {
        Ok(Jet2::default())
    }
    /// v, for the laws that have one.
    fn stretch_energy(&self) -> Option<&dyn StretchEnergy> {
        None
    }
    /// θ(J), with θ(1) = 0 and θ'(1) = 1. J > 0.
    fn dilatation(&self, j: f64) -> Jet1;
    /// Initial shear modulus (kPa).
    fn shear_kpa(&self) -> f64;
    /// K, the factor of ½ θ² (kPa).
    fn volumetric_kpa(&self) -> f64;
}

/// Makes an isochoric energy w̄(Ī₁), Ī₁ = J^(-2/3) I₁, a function of (I₁, J).
///
/// # Errors
/// Those of `energy`.
pub fn isochoric(
    i1: f64,
    j: f64,
    energy: impl FnOnce(f64) -> Result<Jet1, MaterialError>,
) -> Result<Jet2, MaterialError> {
    let scale = 1.0 / (j.cbrt() * j.cbrt());
    let bar = scale * i1;
    let w = energy(bar)?;
    let bar_j = -2.0 / 3.0 * bar / j;
    Ok(Jet2 {
        w: w.value,
        w1: w.d1 * scale,
        wj: w.d1 * bar_j,
        w11: w.d2 * scale * scale,
        w1j: w.d2 * scale * bar_j - 2.0 / 3.0 * w.d1 * scale / j,
        wjj: w.d2 * bar_j * bar_j + 10.0 / 9.0 * w.d1 * bar / (j * j),
    })
}

/// What a point of a body answers to a deformation gradient; per rest volume, in kPa.
pub trait Material {
    /// Strain energy density ψ(F).
    ///
    /// # Errors
    /// A deformation that the material cannot have.
    fn energy(&self, f: &Mat3) -> Result<f64, MaterialError>;
    /// First Piola-Kirchhoff stress P = ∂ψ/∂F.
    ///
    /// # Errors
    /// A deformation that the material cannot have.
    fn stress(&self, f: &Mat3) -> Result<Mat3, MaterialError>;
    /// Directional derivative of the stress, ∂P/∂F : dF.
    ///
    /// # Errors
    /// A deformation that the material cannot have.
    fn tangent(&self, f: &Mat3, df: &Mat3) -> Result<Mat3, MaterialError>;
}

/// Cofactor of F: ∂(det F)/∂F.
pub fn cofactor(f: &Mat3) -> Mat3 {
    let (a, b, c) = (f.column(0), f.column(1), f.column(2));
    Mat3::from_columns(&[b.cross(&c), c.cross(&a), a.cross(&b)])
}

/// det F.
///
/// # Errors
/// [`MaterialError::Inverted`] unless it is positive.
pub fn jacobian(f: &Mat3) -> Result<f64, MaterialError> {
    let j = f.determinant();
    // The negation also catches a NaN.
    if j > 0.0 { Ok(j) } else { Err(MaterialError::Inverted { j }) }
}

/// Principal stretches and directions of F, whose determinant `j` is positive.
///
/// # Errors
/// [`MaterialError::Inverted`] for numbers that overflow.
pub fn principal(f: &Mat3, j: f64) -> Result<Principal, MaterialError> {
    Principal::of(f).ok_or(MaterialError::Inverted { j })
}

impl<T: InvariantEnergy> Material for T {
    fn energy(&self, f: &Mat3) -> Result<f64, MaterialError> {
        let j = jacobian(f)?;
        let theta = self.dilatation(j).value;
        let mut energy =
            self.distortion(f.norm_squared(), j)?.w + 0.5 * self.volumetric_kpa() * theta * theta;
        if let Some(law) = self.stretch_energy() {
            energy += law.of_stretches(&principal(f, j)?.stretches).value;
        }
        Ok(energy)
    }

    fn stress(&self, f: &Mat3) -> Result<Mat3, MaterialError> {
        let j = jacobian(f)?;
        let (w, theta) = (self.distortion(f.norm_squared(), j)?, self.dilatation(j));
        let by_j = w.wj + self.volumetric_kpa() * theta.value * theta.d1;
        let mut stress = 2.0 * w.w1 * f + by_j * cofactor(f);
        if let Some(law) = self.stretch_energy() {
            let principal = principal(f, j)?;
            stress += principal.tensor(&law.of_stretches(&principal.stretches).d1);
        }
        Ok(stress)
    }

    fn tangent(&self, f: &Mat3, df: &Mat3) -> Result<Mat3, MaterialError> {
        let j = jacobian(f)?;
        let (w, theta) = (self.distortion(f.norm_squared(), j)?, self.dilatation(j));
        let bulk = self.volumetric_kpa();
        let by_j = w.wj + bulk * theta.value * theta.d1;
        let by_jj = w.wjj + bulk * (theta.d1 * theta.d1 + theta.value * theta.d2);
        let cof = cofactor(f);
        let (d1, dj) = (2.0 * f.dot(df), cof.dot(df));
        // The cofactor is quadratic in F, hence its derivative is this polar form.
        let dcof = cofactor(&(f + df)) - cof - cofactor(df);
        let mut change = 2.0 * w.w1 * df
            + 2.0 * (w.w11 * d1 + w.w1j * dj) * f
            + (w.w1j * d1 + by_jj * dj) * cof
            + by_j * dcof;
        if let Some(law) = self.stretch_energy() {
            let principal = principal(f, j)?;
            let jet = law.of_stretches(&principal.stretches);
            change += Stiffness::new(&principal, &jet).tangent(df);
        }
        Ok(change)
    }
}
