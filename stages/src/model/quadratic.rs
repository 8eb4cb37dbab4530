//! Tissue of a body on quadratic elements: what the linear ones converge to.

use super::{Recipe, TissueError, recipe, relaxed};
use mammotwin_data::{Mat3, Vec3, mesh::TetMesh, solution::Solution};
use mammotwin_solver::{
    mesh::{
        domain::Domain,
        quadratic::{CHILDREN, QuadraticMesh},
    },
    model::Model,
    terms::{Gravity, QuadraticBulk, QuadraticMembrane, quadratic::Rule},
};

/// Ten-node tetrahedra and six-node triangles on the nodes of a finer linear mesh.
#[derive(Debug, Clone)]
pub struct Quadratic {
    /// Corners of the elements, on all nodes, in the reference pose.
    pub parents: TetMesh,
    elements: QuadraticMesh,
}

impl Quadratic {
    /// Quadratic elements on `mesh`, curved as the domain that it was made of, and the linear mesh of
    /// their parts.
    pub fn fitted(mesh: TetMesh, domain: &dyn Domain) -> (Self, TetMesh) {
        let elements = QuadraticMesh::fitted(&mesh, domain);
        let parts = elements.split(&mesh.tissues);
        let parents = TetMesh { points: parts.points.clone(), ..mesh };
        (Self { parents, elements }, parts)
    }

    /// Quadratic elements of which `parts` are the parts.
    pub fn of_parts(parts: &TetMesh) -> Self {
        let (elements, corners) = QuadraticMesh::of_parts(parts);
        Self { parents: TetMesh { points: parts.points.clone(), ..corners }, elements }
    }

    /// Straight tetrahedra between the corners, and these alone.
    pub fn corners(&self) -> TetMesh {
        let count = self.parents.tets.iter().flatten().max().map_or(0, |&last| last as usize + 1);
        let mut corners = self.parents.clone();
        corners.points.truncate(count);
        corners
    }

    /// A state with fields by element, for the parts of these.
    pub fn spread(&self, mut state: Solution) -> Solution {
        let parts = |fields: &[Mat3]| -> Vec<Mat3> {
            fields.iter().flat_map(|field| [*field; CHILDREN.len()]).collect()
        };
        state.deformation_gradient = parts(&state.deformation_gradient);
        state.cauchy_kpa = parts(&state.cauchy_kpa);
        state
    }

    /// The same with the nodes at `points` (mm) in the reference pose.
    pub fn with_points(&self, points: &[Vec3]) -> Self {
        let mut moved = self.clone();
        moved.parents.points = points.to_vec();
        moved
    }

    /// Tissue, sheets and weight.
    pub(super) fn tissues(
        &self,
        model: &mut Model,
        rest: &[Vec3],
        recipe: &Recipe,
    ) -> Result<(), TissueError> {
        let mesh = QuadraticMesh { points: rest.to_vec(), ..self.elements.clone() };
        model.add(QuadraticBulk::new("breast", &mesh, recipe.laws()?, Rule::Four)?)?;
        for (name, sheet, patch, stretch) in recipe.sheets() {
            let rest = relaxed(rest, stretch);
            let (laws, thickness_mm) = recipe::of_sheet(sheet)?;
            let faces = mesh.patches.get(&patch).map_or(&[][..], Vec::as_slice);
            model.add(QuadraticMembrane::new(name, &rest, faces, &thickness_mm, &laws)?)?;
        }
        if recipe.gravity != Vec3::zeros() {
            let density = recipe.density_g_per_cm3;
            model.add(Gravity::quadratic("gravity", &mesh, density, recipe.gravity)?)?;
        }
        Ok(())
    }
}
