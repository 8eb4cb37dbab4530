//! Skin and fascia: thin sheets that share nodes with the tissue.
//!
//! A sheet has no bending stiffness and is incompressible: its thickness shrinks as its area
//! grows, and its stress across the thickness is zero. The energy per rest area is the thickness
//! times the law's energy at J = 1 (Holzapfel, *Nonlinear solid mechanics* (2000),
//! § 6.5; plane stress).
//!
//! A sheet without bending stiffness wrinkles instead of carrying compression, in folds finer than
//! the mesh. Its energy is therefore relaxed (tension field: Pipkin, *IMA J. Appl. Math.* 36
//! (1986) 85): with principal stretches λ₁ ≥ λ₂, when λ₂ falls below the width λ₁^(-1/2) that pure
//! tension along λ₁ gives, I₁ is that of pure tension, λ₁² + 2/λ₁; when λ₁ < 1 as well, the sheet is
//! slack and I₁ = 3. The stress is continuous.

use super::{At, Block, Order, Term, sheet};
use crate::materials::{Law, MaterialError};
use crate::model::ModelError;
use mammotwin_data::Vec3;
use nalgebra::{Matrix2, Vector2};

/// An incompressible sheet on the outer faces of the tissue.
#[derive(Debug, Clone)]
pub struct Membrane {
    name: String,
    faces: Vec<[u32; 3]>,
    laws: Vec<Law>,
    /// Rest volume of a face (mm³): area times thickness.
    volumes: Vec<f64>,
    /// Gradients of the shape functions in the face's own frame at rest (1/mm).
    gradients: Vec<[Vector2<f64>; 3]>,
}

impl Membrane {
    /// A sheet on `faces`, stress-free with the nodes at `points`, with one thickness (mm) and one
    /// law for each face. The laws' Young's moduli count; their Poisson's ratios do not.
    ///
    /// # Errors
    /// Other numbers of thicknesses or laws than faces, a thickness that is not positive, or a
    /// face without area.
    pub fn new(
        name: &str,
        points: &[Vec3],
        faces: &[[u32; 3]],
        thickness_mm: &[f64],
        laws: &[Law],
    ) -> Result<Self, ModelError> {
        let term = || name.to_owned();
        for (what, got) in [("thicknesses", thickness_mm.len()), ("laws", laws.len())] {
            if got != faces.len() {
                return Err(ModelError::Count { term: term(), what, wanted: faces.len(), got });
            }
        }
        let mut volumes = Vec::with_capacity(faces.len());
        let mut gradients = Vec::with_capacity(faces.len());
        for (element, face) in faces.iter().enumerate() {
            let thickness = thickness_mm[element];
            if !(thickness > 0.0 && thickness.is_finite()) {
                return Err(ModelError::Thickness { term: term(), element, thickness });
            }
            let [a, b, c] = face.map(|n| points[n as usize]);
            let area = 0.5 * (b - a).cross(&(c - a)).norm();
            let (Some(first), true) = ((b - a).try_normalize(0.0), area > 0.0) else {
                return Err(ModelError::Flat { term: term(), element, size: area });
            };
            let along = first.dot(&(c - a));
            let across = 2.0 * area / (b - a).norm();
            let edges = Matrix2::new((b - a).norm(), along, 0.0, across);
            let inverse = edges.try_inverse().unwrap_or_else(Matrix2::zeros);
            let rows = [0, 1].map(|r| inverse.row(r).transpose());
            volumes.push(area * thickness);
            gradients.push([-(rows[0] + rows[1]), rows[0], rows[1]]);
        }
        let laws = laws.iter().map(|law| law.incompressible()).collect();
        Ok(Self { name: name.into(), faces: faces.to_vec(), laws, volumes, gradients })
    }

    /// A sheet of one thickness (mm) and law.
    ///
    /// # Errors
    /// As [`Membrane::new`].
    pub fn uniform(
        name: &str,
        points: &[Vec3],
        faces: &[[u32; 3]],
        thickness_mm: f64,
        law: Law,
    ) -> Result<Self, ModelError> {
        Self::new(name, points, faces, &vec![thickness_mm; faces.len()], &vec![law; faces.len()])
    }
}

impl Term for Membrane {
    fn name(&self) -> &str {
        &self.name
    }

    fn elements(&self) -> usize {
        self.faces.len()
    }

    fn nodes(&self, element: usize) -> &[u32] {
        &self.faces[element]
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
        let gradients = &self.gradients[element];
        let x = self.faces[element].map(|n| at.points[n as usize]);
        let f = (x[1] - x[0]) * gradients[1].transpose() + (x[2] - x[0]) * gradients[2].transpose();
        sheet::add(&self.laws[element], self.volumes[element], &f, gradients, order, block)
    }
}
