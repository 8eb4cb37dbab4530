//! Skin and fascia: thin sheets that share nodes with the tissue.
//!
//! A sheet has no bending stiffness and is incompressible: its thickness shrinks as its area
//! grows, and its stress across the thickness is zero. With the in-plane deformation F (3×2) and
//! D = det FᵀF, the first invariant is I₁ = tr FᵀF + 1/D, and the energy per rest area is the
//! thickness times the law's energy at J = 1 (Holzapfel, *Nonlinear solid mechanics* (2000),
//! § 6.5; plane stress).

use super::{At, Block, Order, Term};
use crate::materials::{InvariantEnergy, Law, MaterialError};
use crate::model::ModelError;
use mammotwin_data::{Mat3, Vec3};
use nalgebra::{Matrix2, Matrix3x2, Vector2};

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

    fn block(
        &self,
        element: usize,
        at: &At,
        order: Order,
        block: &mut Block,
    ) -> Result<(), MaterialError> {
        let volume = self.volumes[element];
        let gradients = &self.gradients[element];
        let x = self.faces[element].map(|n| at.points[n as usize]);
        let f: Matrix3x2<f64> =
            (x[1] - x[0]) * gradients[1].transpose() + (x[2] - x[0]) * gradients[2].transpose();
        let (f1, f2): (Vec3, Vec3) = (f.column(0).into(), f.column(1).into());
        let normal = f1.cross(&f2);
        let d = normal.norm_squared();
        // A face squeezed to a line: the negation also catches a NaN.
        if !(d > 0.0) {
            return Err(MaterialError::Inverted { j: d.sqrt() });
        }
        let w = self.laws[element].distortion(f.norm_squared() + 1.0 / d, 1.0)?;
        block.energy = volume * w.w;
        if order == Order::Value {
            return Ok(());
        }
        // Moving node a by u turns the normal by u × wₐ.
        let turn = gradients.map(|g| g.x * f2 - g.y * f1);
        let d_area = turn.map(|w| 2.0 * w.cross(&normal));
        let mut d_i1 = [Vec3::zeros(); 3];
        for a in 0..3 {
            d_i1[a] = 2.0 * (f * gradients[a]) - d_area[a] / (d * d);
            block.gradient[a] = volume * w.w1 * d_i1[a];
        }
        if order == Order::Gradient {
            return Ok(());
        }
        for a in 0..3 {
            for b in 0..=a {
                let crossed = gradients[a].x * gradients[b].y - gradients[a].y * gradients[b].x;
                let dd_area = 2.0
                    * (Mat3::from_diagonal_element(turn[a].dot(&turn[b]))
                        - turn[b] * turn[a].transpose()
                        - crossed * normal.cross_matrix());
                let dd_i1 = Mat3::from_diagonal_element(2.0 * gradients[a].dot(&gradients[b]))
                    + 2.0 / (d * d * d) * d_area[a] * d_area[b].transpose()
                    - dd_area / (d * d);
                block.hessian[a][b] =
                    volume * (w.w1 * dd_i1 + w.w11 * d_i1[a] * d_i1[b].transpose());
            }
        }
        Ok(())
    }
}
