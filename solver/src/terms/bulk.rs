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

use super::solid::{self, Point};
use super::{At, Block, Order, Term};
use crate::materials::{InvariantEnergy, Law, Material, MaterialError};
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

    /// The one quadrature point of an element.
    fn point(&self, element: usize, pressure_kpa: f64) -> Point<'_, 4> {
        Point {
            law: &self.laws[element],
            volume: self.volumes[element],
            gradients: &self.gradients[element],
            share_kpa: self.share(element),
            pressure_kpa,
        }
    }

    /// Stiffness of the element's own share (kPa).
    fn share(&self, element: usize) -> f64 {
        let law = &self.laws[element];
        (OWN_SHARE * law.shear_kpa()).min(LARGEST_SHARE * law.volumetric_kpa())
    }

    /// Mean of the nodal pressures (kPa, positive in tension).
    fn pressure(&self, element: usize, pressure: &[f64]) -> f64 {
        0.25 * self.tets[element].iter().map(|&n| pressure[n as usize]).sum::<f64>()
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

    fn is_internal(&self) -> bool {
        true
    }

    fn block(
        &self,
        element: usize,
        at: &At,
        order: Order,
        block: &mut Block,
    ) -> Result<(), MaterialError> {
        let volume = self.volumes[element];
        let f = self.deformation(element, at.points);
        let pressure_kpa =
            if order == Order::Value { 0.0 } else { self.pressure(element, at.pressure) };
        let point = self.point(element, pressure_kpa);
        let dilated = point.add(&f, order, block)?;
        block.dilatation = 0.25 * volume * dilated.theta;
        if order >= Order::Gradient {
            block.dilatation_gradient = dilated.gradient.map(|g| 0.25 * volume * g);
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

    fn shift(&self, element: usize, at: &At, block: &mut Block) -> bool {
        let point = self.point(element, self.pressure(element, at.pressure));
        point.add_shift(&self.deformation(element, at.points), block);
        true
    }

    fn raise_shear(&self, shear_kpa: &mut [f64]) {
        solid::raise_shear(&self.tets, &self.laws, shear_kpa);
    }

    /// The fields of a solution are those of the first body of a model.
    fn report(&self, at: &At, solution: &mut Solution) {
        if !solution.deformation_gradient.is_empty() {
            return;
        }
        let mut weights = vec![0.0; at.points.len()];
        solution.mean_stress_kpa = vec![0.0; at.points.len()];
        solution.deformation_gradient = Vec::with_capacity(self.tets.len());
        solution.cauchy_kpa = Vec::with_capacity(self.tets.len());
        for (element, tet) in self.tets.iter().enumerate() {
            let f = self.deformation(element, at.points);
            let law = &self.laws[element];
            let j = f.determinant();
            let theta = law.dilatation(j);
            // The law's own volumetric stress makes room for the mixed one.
            let extra = self.pressure(element, at.pressure)
                + (self.share(element) - law.volumetric_kpa()) * theta.value;
            let stress = law.stress(&f).unwrap_or_else(|_| Mat3::repeat(f64::NAN));
            let cauchy = stress * f.transpose() / j + Mat3::from_diagonal_element(extra * theta.d1);
            let weight = self.volumes[element];
            for &n in tet {
                solution.mean_stress_kpa[n as usize] += weight * cauchy.trace() / 3.0;
                weights[n as usize] += weight;
            }
            solution.deformation_gradient.push(f);
            solution.cauchy_kpa.push(cauchy);
        }
        for (pressure, weight) in solution.mean_stress_kpa.iter_mut().zip(weights) {
            *pressure /= f64::max(weight, f64::MIN_POSITIVE);
        }
    }
}
