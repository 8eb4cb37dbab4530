//! Energies of the principal stretches, and what they add to stress and stiffness.
//!
//! With F = U diag(λ) Vᵀ, an isotropic energy v(λ₁, λ₂, λ₃) has the stress P = U diag(v,ᵢ) Vᵀ. In
//! the frames U and V its tangent couples the diagonal by v,ᵢⱼ, and each pair of off-diagonal
//! entries by two numbers,
//!
//! Aᵢⱼᵢⱼ = ½ (d + s), Aᵢⱼⱼᵢ = ½ (d - s), d = (v,ᵢ - v,ⱼ)/(λᵢ - λⱼ), s = (v,ᵢ + v,ⱼ)/(λᵢ + λⱼ),
//!
//! where d has the limit ½ (v,ᵢᵢ + v,ⱼⱼ) - v,ᵢⱼ at equal stretches (Ogden, *Non-linear elastic
//! deformations* (1984), § 6.1).

use crate::eigen::eigen;
use mammotwin_data::{Mat3, Vec3};

/// Value and derivatives of an energy of three numbers (kPa).
#[derive(Debug, Clone, Copy)]
pub struct Jet3 {
    /// Value.
    pub value: f64,
    /// First derivatives.
    pub d1: Vec3,
    /// Second derivatives.
    pub d2: Mat3,
}

impl Jet3 {
    /// Σ φ(eᵢ), from value and derivatives of φ.
    pub(super) fn sum(e: &Vec3, phi: impl Fn(f64) -> super::Jet1) -> Self {
        let each = [phi(e.x), phi(e.y), phi(e.z)];
        Self {
            value: each.iter().map(|p| p.value).sum(),
            d1: Vec3::from(each.map(|p| p.d1)),
            d2: Mat3::from_diagonal(&Vec3::from(each.map(|p| p.d2))),
        }
    }
}

/// A distortional energy of the principal stretches, by their logarithms.
pub trait StretchEnergy {
    /// Energy at the isochoric logarithmic stretches eᵢ = ln λᵢ - ⅓ ln J. Only its derivatives
    /// along changes that keep Σ eᵢ = 0 have a meaning.
    fn of_logarithms(&self, e: &Vec3) -> Jet3;

    /// The same energy and its derivatives by the stretches λᵢ > 0 themselves.
    fn of_stretches(&self, stretches: &Vec3) -> Jet3 {
        let logarithms = stretches.map(f64::ln);
        let Jet3 { value, d1, d2 } = self.of_logarithms(&logarithms.add_scalar(-logarithms.mean()));
        // Projection on changes of shape, then d ln λ = dλ/λ.
        let tau = d1.add_scalar(-d1.mean());
        let shape = Mat3::identity() - Mat3::repeat(1.0 / 3.0);
        let by_logarithm = shape * d2 * shape - Mat3::from_diagonal(&tau);
        let inverse = stretches.map(|l| 1.0 / l);
        Jet3 {
            value,
            d1: tau.component_mul(&inverse),
            d2: by_logarithm.component_mul(&(inverse * inverse.transpose())),
        }
    }
}

/// F = U diag(λ) Vᵀ.
#[derive(Debug, Clone, Copy)]
pub struct Principal {
    /// U, orthonormal.
    pub left: Mat3,
    /// λ, in no order.
    pub stretches: Vec3,
    /// V, orthonormal.
    pub right: Mat3,
}

impl Principal {
    /// Of a deformation gradient with a positive determinant; `None` for NaN.
    pub fn of(f: &Mat3) -> Option<Self> {
        let (squares, right) = eigen(&(f.transpose() * f))?;
        let stretches = squares.map(f64::sqrt);
        let mut left = f * right;
        for (mut column, stretch) in left.column_iter_mut().zip(&stretches) {
            column /= *stretch;
        }
        Some(Self { left, stretches, right })
    }

    /// U diag(d) Vᵀ.
    pub fn tensor(&self, d: &Vec3) -> Mat3 {
        self.left * Mat3::from_diagonal(d) * self.right.transpose()
    }
}

/// Two stretches closer than this, relative to their sum, are treated as equal: the limit of d is
/// off by the square of it, the quotient by rounding over it.
const EQUAL: f64 = 1e-5;

/// The tangent ∂P/∂F in the principal frames.
#[derive(Debug, Clone, Copy)]
pub struct Stiffness {
    principal: Principal,
    /// v,ᵢⱼ.
    d2: Mat3,
    /// Aᵢⱼᵢⱼ, and v,ᵢᵢ on the diagonal.
    same: Mat3,
    /// Aᵢⱼⱼᵢ.
    swapped: Mat3,
}

impl Stiffness {
    /// Of an energy with the derivatives `jet` by the stretches of `principal`.
    pub fn new(principal: &Principal, jet: &Jet3) -> Self {
        let (l, d1, d2) = (&principal.stretches, &jet.d1, &jet.d2);
        let (mut same, mut swapped) = (Mat3::from_diagonal(&d2.diagonal()), Mat3::zeros());
        for (i, j) in [(0, 1), (0, 2), (1, 2)] {
            let (sum, difference) = (l[i] + l[j], l[i] - l[j]);
            let d = if difference.abs() > EQUAL * sum {
                (d1[i] - d1[j]) / difference
            } else {
                0.5 * (d2[(i, i)] + d2[(j, j)]) - d2[(i, j)]
            };
            let s = (d1[i] + d1[j]) / sum;
            for at in [(i, j), (j, i)] {
                same[at] = 0.5 * (d + s);
                swapped[at] = 0.5 * (d - s);
            }
        }
        Self { principal: *principal, d2: *d2, same, swapped }
    }

    /// ∂P/∂F : dF.
    pub fn tangent(&self, df: &Mat3) -> Mat3 {
        let Principal { left, right, .. } = &self.principal;
        let df = left.transpose() * df * right;
        let mut dp = self.same.component_mul(&df) + self.swapped.component_mul(&df.transpose());
        dp.set_diagonal(&(self.d2 * df.diagonal()));
        left * dp * right.transpose()
    }

    /// A gradient of the rest body in the frame V.
    pub fn turned(&self, gradient: &Vec3) -> Vec3 {
        self.principal.right.transpose() * gradient
    }

    /// Matrix of Aᵢⱼₖₗ aⱼ bₗ for two *turned* gradients a and b.
    pub fn between(&self, a: &Vec3, b: &Vec3) -> Mat3 {
        let outer = a * b.transpose();
        let mut block =
            self.d2.component_mul(&outer) + self.swapped.component_mul(&outer.transpose());
        block.set_diagonal(&(self.same * a.component_mul(b)));
        let left = &self.principal.left;
        left * block * left.transpose()
    }
}

/// eˣ - 1 - x without loss of digits near zero.
pub(super) fn exp_above_tangent(x: f64) -> f64 {
    if x.abs() > 0.03 {
        return x.exp_m1() - x;
    }
    let tail = (3..=9).rev().fold(1.0, |sum, n| 1.0 + x / f64::from(n) * sum);
    0.5 * x * x * tail
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exponential_above_its_tangent_keeps_its_digits() {
        for x in [-2.0, -0.0301, -0.0299, 1e-3, 0.0299, 0.0301, 1.5f64] {
            let want = if x.abs() > 0.1 { x.exp() - 1.0 - x } else { series(x) };
            assert!((exp_above_tangent(x) / want - 1.0).abs() < 1e-13, "{x}");
        }
    }

    fn series(x: f64) -> f64 {
        let mut term = x;
        (2..20)
            .map(|n| {
                term *= x / f64::from(n);
                term
            })
            .sum()
    }
}
