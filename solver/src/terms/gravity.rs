//! Weight of the tissue.

use super::{At, Block, Load, Order, Term, quadratic};
use crate::materials::MaterialError;
use crate::mesh::quadratic::QuadraticMesh;
use crate::model::ModelError;
use mammotwin_data::{Vec3, mesh::TetMesh, units::WEIGHT_OF_G_PER_CM3};

/// A body force of constant direction, on the rest mass of the tissue.
#[derive(Debug, Clone)]
pub struct Gravity {
    name: String,
    nodes: Vec<u32>,
    /// Weight of each node (mN) under full gravity.
    weights: Vec<Vec3>,
    /// Where each node has no potential energy (mm).
    rest: Vec<Vec3>,
}

impl Gravity {
    /// Weight of tissue of `density_g_per_cm3` that fills `mesh` at rest. `direction` points
    /// where things fall; its length is in units of standard gravity.
    pub fn new(name: &str, mesh: &TetMesh, density_g_per_cm3: f64, direction: Vec3) -> Self {
        let force = density_g_per_cm3 * WEIGHT_OF_G_PER_CM3 * direction;
        let mut weights = vec![Vec3::zeros(); mesh.points.len()];
        for tet in &mesh.tets {
            let quarter = 0.25 * TetMesh::tet_volume(&mesh.points, tet);
            for &n in tet {
                weights[n as usize] += quarter * force;
            }
        }
        Self::of_weights(name, weights, &mesh.points)
    }

    /// The same for ten-node tetrahedra.
    ///
    /// # Errors
    /// A tetrahedron that is turned inside out.
    pub fn quadratic(
        name: &str,
        mesh: &QuadraticMesh,
        density_g_per_cm3: f64,
        direction: Vec3,
    ) -> Result<Self, ModelError> {
        let force = density_g_per_cm3 * WEIGHT_OF_G_PER_CM3 * direction;
        Ok(Self::of_weights(name, quadratic::nodal_weights(mesh, force)?, &mesh.points))
    }

    fn of_weights(name: &str, weights: Vec<Vec3>, rest: &[Vec3]) -> Self {
        let nodes = (0..weights.len() as u32).collect();
        Self { name: name.into(), nodes, weights, rest: rest.to_vec() }
    }

    fn force(&self, element: usize, load: &Load) -> Vec3 {
        load.gravity * self.weights[element]
    }
}

impl Term for Gravity {
    fn name(&self) -> &str {
        &self.name
    }

    fn elements(&self) -> usize {
        self.nodes.len()
    }

    fn nodes(&self, element: usize) -> &[u32] {
        std::slice::from_ref(&self.nodes[element])
    }

    fn block(
        &self,
        element: usize,
        at: &At,
        order: Order,
        block: &mut Block,
    ) -> Result<(), MaterialError> {
        let force = self.force(element, &at.load);
        block.energy = -force.dot(&(at.points[element] - self.rest[element]));
        if order >= Order::Gradient {
            block.gradient[0] = -force;
        }
        Ok(())
    }
}
