//! Tissue as linear tetrahedra that do not lock.
//!
//! Displacement and a continuous nodal pressure are both linear (P1-P1), stabilised by pressure
//! projection (Dohrmann & Bochev, *Int. J. Numer. Meth. Fluids* 46 (2004) 183; Karabelas et al.,
//! *Comput. Mech.* 65 (2020) 193, <https://doi.org/10.1007/s00466-019-01760-w>). Condensed, the
//! energy depends on the positions alone:
//!
//! E(u) = Σ V (w(I₁, J) + ½ s θ²) + ½ gᵀ M⁻¹ g,  gₐ = Σ V/4 θ(J),
//!
//! M = Σ (consistent mass)/(K - s) + (mass - mean)/μ,
//!
//! with the law's dilatation θ, so that M is constant for every law. The element's own share s of
//! the bulk stiffness is a multiple of μ, not of K: it keeps very soft tissue from collapsing
//! between pressure nodes without bringing back the locking.

use super::{At, Block, Order, Term};
use crate::materials::{InvariantEnergy, Law, Material, MaterialError, cofactor, jacobian};
use crate::model::ModelError;
use mammotwin_data::{Mat3, Vec3, mesh::TetMesh, solution::Solution};
use nalgebra::{Matrix4, SMatrix};

/// The element's own share of the bulk stiffness, in units of its shear modulus.
const OWN_SHARE: f64 = 2.5;
/// The largest part of the bulk stiffness that an element may keep for itself.
const LARGEST_SHARE: f64 = 0.5;

/// Nearly incompressible tissue, one law for each tetrahedron.
#[derive(Debug, Clone)]
pub struct Bulk {
    name: String,
    tets: Vec<[u32; 4]>,
    laws: Vec<Law>,
    /// Rest volumes (mm³).
    volumes: Vec<f64>,
    /// Gradients of the shape functions at rest (1/mm).
    gradients: Vec<[Vec3; 4]>,
}

impl Bulk {
    /// Tissue that fills `mesh`, stress-free with the nodes at `mesh.points`.
    ///
    /// # Errors
    /// Another number of laws than tetrahedra, or a tetrahedron without volume.
    pub fn new(name: &str, mesh: &TetMesh, laws: Vec<Law>) -> Result<Self, ModelError> {
        if laws.len() != mesh.tets.len() {
            return Err(ModelError::Count {
                term: name.into(),
                what: "laws",
                wanted: mesh.tets.len(),
                got: laws.len(),
            });
        }
        let mut volumes = Vec::with_capacity(laws.len());
        let mut gradients = Vec::with_capacity(laws.len());
        for (element, tet) in mesh.tets.iter().enumerate() {
            let [a, b, c, d] = tet.map(|n| mesh.points[n as usize]);
            let edges = Mat3::from_columns(&[b - a, c - a, d - a]);
            let volume = edges.determinant() / 6.0;
            let (true, Some(inverse)) = (volume > 0.0, edges.try_inverse()) else {
                return Err(ModelError::Flat { term: name.into(), element, size: volume });
            };
            let rows = [0, 1, 2].map(|r| inverse.row(r).transpose());
            volumes.push(volume);
            gradients.push([-(rows[0] + rows[1] + rows[2]), rows[0], rows[1], rows[2]]);
        }
        Ok(Self { name: name.into(), tets: mesh.tets.clone(), laws, volumes, gradients })
    }

    /// Deformation gradient of a tetrahedron.
    fn deformation(&self, element: usize, points: &[Vec3]) -> Mat3 {
        let (tet, gradients) = (&self.tets[element], &self.gradients[element]);
        let a = points[tet[0] as usize];
        (1..4).map(|n| (points[tet[n] as usize] - a) * gradients[n].transpose()).sum()
    }

    /// Stiffness of the element's own share (kPa).
    fn share(&self, element: usize) -> f64 {
        let law = &self.laws[element];
        (OWN_SHARE * law.shear_kpa()).min(LARGEST_SHARE * law.volumetric_kpa())
    }

    /// Pressure (kPa, positive in tension) that works against dθ: the mean of the nodal
    /// pressures and the element's own share.
    fn tension(&self, element: usize, theta: f64, pressure: &[f64]) -> f64 {
        let nodal: f64 = self.tets[element].iter().map(|&n| pressure[n as usize]).sum();
        0.25 * nodal + self.share(element) * theta
    }
}

impl Term for Bulk {
    fn name(&self) -> &str {
        &self.name
    }

    fn elements(&self) -> usize {
        self.tets.len()
    }

    fn nodes(&self, element: usize) -> &[u32] {
        &self.tets[element]
    }

    fn block(
        &self,
        element: usize,
        at: &At,
        order: Order,
        block: &mut Block,
    ) -> Result<(), MaterialError> {
        let (law, volume) = (&self.laws[element], self.volumes[element]);
        let f = self.deformation(element, at.points);
        let j = jacobian(&f)?;
        let w = law.distortion(f.norm_squared(), j)?;
        let theta = law.dilatation(j);
        let share = self.share(element);
        block.energy = volume * (w.w + 0.5 * share * theta.value * theta.value);
        block.dilatation = 0.25 * volume * theta.value;
        if order == Order::Value {
            return Ok(());
        }
        let tension = self.tension(element, theta.value, at.pressure);
        let by_j = w.wj + tension * theta.d1;
        let gradients = &self.gradients[element];
        let cof = cofactor(&f);
        let along_f = gradients.map(|g| f * g);
        let along_j = gradients.map(|g| cof * g);
        for n in 0..4 {
            block.gradient[n] = volume * (2.0 * w.w1 * along_f[n] + by_j * along_j[n]);
            block.dilatation_gradient[n] = 0.25 * volume * theta.d1 * along_j[n];
        }
        if order == Order::Gradient {
            return Ok(());
        }
        let by_jj = w.wjj + share * theta.d1 * theta.d1 + tension * theta.d2;
        for a in 0..4 {
            // Both columns of the outer products, scaled once.
            let left_f = volume * (4.0 * w.w11 * along_f[a] + 2.0 * w.w1j * along_j[a]);
            let left_j = volume * (2.0 * w.w1j * along_f[a] + by_jj * along_j[a]);
            for b in 0..=a {
                let stretch = 2.0 * volume * w.w1 * gradients[a].dot(&gradients[b]);
                let turn = volume * by_j * (f * gradients[a].cross(&gradients[b]));
                block.hessian[a][b] = left_f * along_f[b].transpose()
                    + left_j * along_j[b].transpose()
                    + Mat3::from_diagonal_element(stretch)
                    - turn.cross_matrix();
            }
        }
        Ok(())
    }

    fn is_mixed(&self) -> bool {
        true
    }

    fn compliance(&self, element: usize) -> SMatrix<f64, 4, 4> {
        let law = &self.laws[element];
        let (one, id) = (Matrix4::repeat(1.0), Matrix4::identity());
        let mass = (one + id) / 20.0;
        let projection = (id - 0.25 * one) / 20.0;
        let bulk = law.volumetric_kpa() - self.share(element);
        self.volumes[element] * (mass / bulk + projection / law.shear_kpa())
    }

    fn shift(&self, element: usize) -> SMatrix<f64, 4, 4> {
        let gradients = &self.gradients[element];
        let stiffness = self.laws[element].shear_kpa() * self.volumes[element];
        Matrix4::from_fn(|a, b| stiffness * gradients[a].dot(&gradients[b]))
    }

    fn raise_shear(&self, shear_kpa: &mut [f64]) {
        for (tet, law) in self.tets.iter().zip(&self.laws) {
            for &n in tet {
                let shear = &mut shear_kpa[n as usize];
                *shear = shear.max(law.shear_kpa());
            }
        }
    }

    fn report(&self, at: &At, solution: &mut Solution) {
        let mut weights = vec![0.0; at.points.len()];
        solution.pressure_kpa = vec![0.0; at.points.len()];
        solution.deformation_gradient = Vec::with_capacity(self.tets.len());
        solution.cauchy_kpa = Vec::with_capacity(self.tets.len());
        for (element, tet) in self.tets.iter().enumerate() {
            let f = self.deformation(element, at.points);
            let law = &self.laws[element];
            let j = f.determinant();
            let theta = law.dilatation(j);
            // The law's own volumetric stress makes room for the mixed one.
            let extra = self.tension(element, theta.value, at.pressure)
                - law.volumetric_kpa() * theta.value;
            let stress = law.stress(&f).unwrap_or_else(|_| Mat3::repeat(f64::NAN));
            let cauchy = stress * f.transpose() / j + Mat3::from_diagonal_element(extra * theta.d1);
            let weight = self.volumes[element];
            for &n in tet {
                solution.pressure_kpa[n as usize] += weight * cauchy.trace() / 3.0;
                weights[n as usize] += weight;
            }
            solution.deformation_gradient.push(f);
            solution.cauchy_kpa.push(cauchy);
        }
        for (pressure, weight) in solution.pressure_kpa.iter_mut().zip(weights) {
            *pressure /= f64::max(weight, f64::MIN_POSITIVE);
        }
    }
}
