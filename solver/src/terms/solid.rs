//! The energy at one point of a solid element, with its derivatives by the nodes.

use super::{Block, Order, stretched};
use crate::materials::{InvariantEnergy, Law, MaterialError, cofactor, jacobian, principal};
use mammotwin_data::{Mat3, Vec3};

/// A quadrature point of an element with `N` nodes.
pub(super) struct Point<'a, const N: usize> {
    pub law: &'a Law,
    /// Rest volume that it stands for (mm³).
    pub volume: f64,
    /// Gradients of the shape functions at rest (1/mm).
    pub gradients: &'a [Vec3; N],
    /// The bulk stiffness that the element keeps for itself: ½ s θ² is part of its energy.
    pub share_kpa: f64,
    /// Pressure from elsewhere that works against θ, positive in tension.
    pub pressure_kpa: f64,
}

/// Raises the shear modulus (kPa) of each node to that of the stiffest element around it.
pub(super) fn raise_shear<const N: usize>(tets: &[[u32; N]], laws: &[Law], shear_kpa: &mut [f64]) {
    for (tet, law) in tets.iter().zip(laws) {
        for &n in tet {
            let shear = &mut shear_kpa[n as usize];
            *shear = shear.max(law.shear_kpa());
        }
    }
}

/// Dilatation of a point.
pub(super) struct Dilated<const N: usize> {
    /// θ(J).
    pub theta: f64,
    /// ∂θ/∂position (1/mm), zero unless derivatives were asked for.
    pub gradient: [Vec3; N],
}

impl<const N: usize> Point<'_, N> {
    /// Adds the energy at the deformation gradient `f` and its derivatives to `block`.
    #[inline]
    pub fn add(
        &self,
        f: &Mat3,
        order: Order,
        block: &mut Block,
    ) -> Result<Dilated<N>, MaterialError> {
        let (law, volume, gradients) = (self.law, self.volume, self.gradients);
        let j = jacobian(f)?;
        let w = law.distortion(f.norm_squared(), j)?;
        let theta = law.dilatation(j);
        let mut dilated = Dilated { theta: theta.value, gradient: [Vec3::zeros(); N] };
        block.energy += volume * (w.w + 0.5 * self.share_kpa * theta.value * theta.value);
        if let Some(stretches) = law.stretch_energy() {
            let principal = principal(f, j)?;
            let jet = stretches.of_stretches(&principal.stretches);
            stretched::add(&principal, &jet, gradients, volume, order, block);
        }
        if order == Order::Value {
            return Ok(dilated);
        }
        let tension = self.pressure_kpa + self.share_kpa * theta.value;
        let by_j = w.wj + tension * theta.d1;
        let cof = cofactor(f);
        let along_f = gradients.map(|g| f * g);
        let along_j = gradients.map(|g| cof * g);
        for n in 0..N {
            block.gradient[n] += volume * (2.0 * w.w1 * along_f[n] + by_j * along_j[n]);
        }
        dilated.gradient = along_j.map(|a| theta.d1 * a);
        if order == Order::Gradient {
            return Ok(dilated);
        }
        let by_jj = w.wjj + self.share_kpa * theta.d1 * theta.d1 + tension * theta.d2;
        for a in 0..N {
            // Both columns of the outer products, scaled once.
            let left_f = volume * (4.0 * w.w11 * along_f[a] + 2.0 * w.w1j * along_j[a]);
            let left_j = volume * (2.0 * w.w1j * along_f[a] + by_jj * along_j[a]);
            let row = &mut block.hessian[a];
            for b in 0..=a {
                let stretch = 2.0 * volume * w.w1 * gradients[a].dot(&gradients[b]);
                let turn = volume * by_j * (f * gradients[a].cross(&gradients[b]));
                row[b] += left_f * along_f[b].transpose()
                    + left_j * along_j[b].transpose()
                    + Mat3::from_diagonal_element(stretch)
                    - turn.cross_matrix();
            }
        }
        Ok(dilated)
    }

    /// Adds ∫ c ∇Nₐ·∇N_b dV to the second derivatives, c being the shear modulus and a bound of
    /// the negative curvature of the energy's part in det F: |∂w/∂J| ‖F‖.
    pub fn add_shift(&self, f: &Mat3, block: &mut Block) {
        let (law, gradients) = (self.law, self.gradients);
        let by_j = jacobian(f).and_then(|j| {
            let w = law.distortion(f.norm_squared(), j)?;
            let theta = law.dilatation(j);
            Ok(w.wj + (self.pressure_kpa + self.share_kpa * theta.value) * theta.d1)
        });
        let stiffness = law.shear_kpa() + by_j.unwrap_or(0.0).abs() * f.norm();
        for a in 0..N {
            for b in 0..=a {
                let along = self.volume * stiffness * gradients[a].dot(&gradients[b]);
                block.hessian[a][b] += Mat3::from_diagonal_element(along);
            }
        }
    }
}
