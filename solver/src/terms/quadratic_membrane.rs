//! Skin and fascia as six-node triangles, which fit the faces of ten-node tetrahedra.

use super::{At, Block, Order, Term, sheet};
use crate::materials::{Law, MaterialError};
use crate::mesh::quadratic::FACE_EDGES;
use crate::model::ModelError;
use mammotwin_data::Vec3;
use nalgebra::{Matrix2, Matrix3x2, Vector2, Vector3};

/// Weight and barycentric coordinates of a rule that is exact for functions of fourth order
/// (Strang & Fix 1973).
fn rule() -> impl Iterator<Item = (f64, Vector3<f64>)> {
    let rings = [
        (0.109_951_743_655_321_85, 0.091_576_213_509_770_74),
        (0.223_381_589_678_011_46, 0.445_948_490_915_964_9),
    ];
    rings.into_iter().flat_map(|(weight, b)| {
        (0..3).map(move |n| {
            let mut at = Vector3::repeat(b);
            at[n] = 1.0 - 2.0 * b;
            (weight, at)
        })
    })
}

/// Derivatives of the six shape functions as the second and third coordinate grow at the expense
/// of the first.
fn slopes(l: &Vector3<f64>) -> [Vector2<f64>; 6] {
    std::array::from_fn(|n| {
        let mut slope = Vector3::zeros();
        match n {
            0..3 => slope[n] = 4.0 * l[n] - 1.0,
            _ => {
                let [a, b] = FACE_EDGES[n - 3];
                (slope[a], slope[b]) = (4.0 * l[b], 4.0 * l[a]);
            }
        }
        Vector2::new(slope[1] - slope[0], slope[2] - slope[0])
    })
}

/// A quadrature point of a rest face.
#[derive(Debug, Clone)]
struct Sample {
    /// Rest volume (mm³).
    volume: f64,
    /// Gradients of the shape functions in a frame of the face there (1/mm).
    gradients: [Vector2<f64>; 6],
}

/// An incompressible sheet on the outer faces of ten-node tetrahedra.
#[derive(Debug, Clone)]
pub struct QuadraticMembrane {
    name: String,
    faces: Vec<[u32; 6]>,
    laws: Vec<Law>,
    samples: Vec<Vec<Sample>>,
}

impl QuadraticMembrane {
    /// A sheet on `faces`, stress-free with the nodes at `points`, with one thickness (mm) and one
    /// law for each face. The laws' Young's moduli count; their Poisson's ratios do not.
    ///
    /// # Errors
    /// Other numbers of thicknesses or laws than faces, a thickness that is not positive, or a
    /// face without area.
    pub fn new(
        name: &str,
        points: &[Vec3],
        faces: &[[u32; 6]],
        thickness_mm: &[f64],
        laws: &[Law],
    ) -> Result<Self, ModelError> {
        let term = || name.to_owned();
        for (what, got) in [("thicknesses", thickness_mm.len()), ("laws", laws.len())] {
            if got != faces.len() {
                return Err(ModelError::Count { term: term(), what, wanted: faces.len(), got });
            }
        }
        let one = |(element, (face, &thickness)): (usize, (&[u32; 6], &f64))| {
            if !(thickness > 0.0 && thickness.is_finite()) {
                return Err(ModelError::Thickness { term: term(), element, thickness });
            }
            let x = face.map(|n| points[n as usize]);
            samples(&x, thickness).ok_or(ModelError::Flat { term: term(), element, size: 0.0 })
        };
        let samples =
            faces.iter().zip(thickness_mm).enumerate().map(one).collect::<Result<_, _>>()?;
        let laws = laws.iter().map(|law| law.incompressible()).collect();
        Ok(Self { name: name.into(), faces: faces.to_vec(), laws, samples })
    }

    /// A sheet of one thickness (mm) and law.
    ///
    /// # Errors
    /// As [`QuadraticMembrane::new`].
    pub fn uniform(
        name: &str,
        points: &[Vec3],
        faces: &[[u32; 6]],
        thickness_mm: f64,
        law: Law,
    ) -> Result<Self, ModelError> {
        Self::new(name, points, faces, &vec![thickness_mm; faces.len()], &vec![law; faces.len()])
    }
}

/// The points of a face with its nodes at `x`; `None` when it has no area.
fn samples(x: &[Vec3; 6], thickness_mm: f64) -> Option<Vec<Sample>> {
    let one = |(weight, at): (f64, Vector3<f64>)| {
        let slopes = slopes(&at);
        let tangents: Matrix3x2<f64> = (0..6).map(|n| x[n] * slopes[n].transpose()).sum();
        let (t1, t2): (Vec3, Vec3) = (tangents.column(0).into(), tangents.column(1).into());
        let area = 0.5 * t1.cross(&t2).norm();
        let first = t1.try_normalize(0.0)?;
        let along = first.dot(&t2);
        let edges = Matrix2::new(t1.norm(), along, 0.0, 2.0 * area / t1.norm());
        let inverse = edges.try_inverse()?.transpose();
        let gradients = slopes.map(|s| inverse * s);
        (area > 0.0).then_some(Sample { volume: weight * area * thickness_mm, gradients })
    };
    rule().map(one).collect()
}

impl Term for QuadraticMembrane {
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
        let x = self.faces[element].map(|n| at.points[n as usize]);
        for Sample { volume, gradients } in &self.samples[element] {
            let f = (0..6).map(|n| x[n] * gradients[n].transpose()).sum();
            sheet::add(&self.laws[element], *volume, &f, gradients, order, block)?;
        }
        Ok(())
    }
}
