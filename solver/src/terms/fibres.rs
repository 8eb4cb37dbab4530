//! Fibres that run through the tissue, such as Cooper's ligaments: they pull but never push.
//!
//! With the stretch λ = |F a| of a rest direction a (unit vector), the energy of a volume at rest is ½ E (λ - 1)²
//! where the fibre is taut and 0 where it is slack; over the first 1 % of the strain the stiffness rises
//! linearly from 0 to E, so that second derivatives are continuous. Beside a matrix without fibres the tissue is
//! then transversely isotropic in tension.

use super::{At, Block, Order, Term, cable::taut};
use crate::materials::MaterialError;
use crate::model::ModelError;
use mammotwin_data::{Mat3, Vec3, mesh::TetMesh};

/// Strain at which a fibre is fully taut.
const SMOOTHING: f64 = 0.01;

/// One direction in each linear tetrahedron.
#[derive(Debug, Clone)]
pub struct Fibres {
    name: String,
    tets: Vec<[u32; 4]>,
    /// Volumes at rest (mm³).
    volumes: Vec<f64>,
    /// ∇Nₙ · a (1/mm): the positions weighted with these sum to F a.
    along: Vec<[f64; 4]>,
    young_kpa: f64,
}

impl Fibres {
    /// Fibres of a modulus (kPa, over the whole section of the tissue) along a unit vector for each tetrahedron of
    /// `mesh`, whose points are at rest.
    ///
    /// # Errors
    /// A modulus that is not positive, a number of directions that does not match, or a tetrahedron without volume.
    pub fn new(
        name: &str,
        mesh: &TetMesh,
        directions: &[Vec3],
        young_kpa: f64,
    ) -> Result<Self, ModelError> {
        let term = || name.to_owned();
        if !(young_kpa > 0.0 && young_kpa.is_finite()) {
            let (what, remedy) = ("Young's modulus of fibres (kPa)", "give a positive one");
            return Err(ModelError::Value { term: term(), what, value: young_kpa, remedy });
        }
        let (got, wanted) = (directions.len(), mesh.tets.len());
        if got != wanted {
            return Err(ModelError::Count { term: term(), what: "directions", wanted, got });
        }
        let (mut volumes, mut along) = (Vec::new(), Vec::new());
        for (element, (tet, direction)) in mesh.tets.iter().zip(directions).enumerate() {
            let size = TetMesh::tet_volume(&mesh.points, tet);
            let [o, a, b, c] = tet.map(|n| mesh.points[n as usize]);
            let edges = Mat3::from_columns(&[a - o, b - o, c - o]);
            let flat = ModelError::Flat { term: term(), element, size };
            let inverse = edges.try_inverse().filter(|_| size > 0.0).ok_or(flat)?;
            let part = inverse * direction;
            volumes.push(size);
            along.push([-part.sum(), part.x, part.y, part.z]);
        }
        Ok(Self { name: term(), tets: mesh.tets.clone(), volumes, along, young_kpa })
    }
}

impl Term for Fibres {
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
        let weights = &self.along[element];
        let nodes = self.tets[element].iter().zip(weights);
        let fibre: Vec3 = nodes.map(|(&n, w)| *w * at.points[n as usize]).sum();
        let stretch = fibre.norm();
        let [energy, tension, stiffness] = taut(stretch - 1.0, SMOOTHING);
        let scale = self.young_kpa * self.volumes[element];
        block.energy = scale * energy;
        if order < Order::Gradient || tension == 0.0 {
            return Ok(());
        }
        let unit = fibre / stretch;
        let outer = unit * unit.transpose();
        let second = stiffness * outer + tension / stretch * (Mat3::identity() - outer);
        for (a, wa) in weights.iter().enumerate() {
            block.gradient[a] = scale * tension * *wa * unit;
            for (b, wb) in weights.iter().enumerate().take(a + 1) {
                block.hessian[a][b] = scale * wa * wb * second;
            }
        }
        Ok(())
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)] // a test may fail at once
mod tests {
    use super::*;
    use mammotwin_data::labels::Tissue;

    /// Verifies: fibres in tissue, uniform strain | ½ E (λ - 1)² of its volume, nothing in compression | 1e-12
    #[test]
    fn stretched_fibres_are_springs_and_pressed_ones_nothing() {
        let points = [[0.0, 0.0, 0.0], [6.0, 1.0, 0.0], [0.0, 5.0, 1.0], [1.0, 0.0, 7.0]];
        let points: Vec<Vec3> = points.map(Vec3::from).into();
        let mesh = TetMesh {
            points,
            tets: vec![[0, 1, 2, 3]],
            tissues: vec![Tissue::AdiposeLeft],
            ..TetMesh::default()
        };
        let volume = mesh.volume_mm3();
        let fibres = Fibres::new("fibres", &mesh, &[Vec3::z()], 3.0).unwrap();
        let energy = |stretch: Vec3| {
            let points: Vec<Vec3> = mesh.points.iter().map(|p| p.component_mul(&stretch)).collect();
            let mut block = Block::ZERO;
            let at = At {
                points: &points,
                pressure: &[],
                memory: &[],
                shear_kpa: &[],
                load: super::super::Load::GRAVITY,
                curvature: super::super::Curvature::Exact,
            };
            fibres.block(0, &at, Order::Hessian, &mut block).unwrap();
            let pull: Vec3 = block.gradient.iter().sum();
            assert!(pull.norm() < 1e-12);
            block.energy
        };
        let expected = 3.0 * volume * (0.5 * 0.195_f64.powi(2) + 1e-4 / 24.0);
        assert!((energy(Vec3::new(0.9, 0.9, 1.2)) / expected - 1.0).abs() < 1e-12);
        assert_eq!(energy(Vec3::new(1.1, 1.1, 0.8)), 0.0);
        assert_eq!(energy(Vec3::new(1.0, 1.0, 1.0)), 0.0);
    }

    #[test]
    fn a_modulus_or_directions_without_meaning_are_refused() {
        let mesh = TetMesh::default();
        for young_kpa in [0.0, -1.0, f64::NAN] {
            let refused = Fibres::new("fibres", &mesh, &[], young_kpa);
            assert!(matches!(refused, Err(ModelError::Value { .. })));
        }
        let refused = Fibres::new("fibres", &mesh, &[Vec3::z()], 1.0);
        assert!(matches!(refused, Err(ModelError::Count { got: 1, wanted: 0, .. })));
    }
}
