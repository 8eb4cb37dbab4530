//! Skin and fascia: thin sheets that share nodes with the tissue.
//!
//! A sheet has no bending stiffness and is incompressible: its thickness shrinks as its area
//! grows, and its stress across the thickness is zero. With the in-plane deformation F (3×2) and
//! D = det FᵀF, the first invariant is I₁ = tr FᵀF + 1/D, and the energy per rest area is the
//! thickness times the law's energy at J = 1 (Holzapfel, *Nonlinear solid mechanics* (2000),
//! § 6.5; plane stress).
//!
//! A sheet without bending stiffness wrinkles instead of carrying compression, in folds finer than
//! the mesh. Its energy is therefore relaxed (tension field: Pipkin, *IMA J. Appl. Math.* 36
//! (1986) 85): with principal stretches λ₁ ≥ λ₂, when λ₂ falls below the width λ₁^(-1/2) that pure
//! tension along λ₁ gives, I₁ is that of pure tension, λ₁² + 2/λ₁; when λ₁ < 1 as well, the sheet is
//! slack and I₁ = 3. The stress is continuous.

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
        let sheet = Sheet::of(f.norm_squared(), d);
        let w = self.laws[element].distortion(sheet.i1, 1.0)?;
        block.energy = volume * w.w;
        if order == Order::Value {
            return Ok(());
        }
        // Moving node a by u turns the normal by u × wₐ.
        let turn = gradients.map(|g| g.x * f2 - g.y * f1);
        let d_area = turn.map(|w| 2.0 * w.cross(&normal));
        let d_trace = gradients.map(|g| 2.0 * (f * g));
        let d_i1: [Vec3; 3] =
            std::array::from_fn(|a| sheet.by_trace * d_trace[a] + sheet.by_area * d_area[a]);
        for a in 0..3 {
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
                let dd_trace = Mat3::from_diagonal_element(2.0 * gradients[a].dot(&gradients[b]));
                let [tt, ta, aa] = sheet.second;
                let (ta_1, ta_2) =
                    (d_trace[a] * d_area[b].transpose(), d_area[a] * d_trace[b].transpose());
                let dd_i1 = sheet.by_trace * dd_trace
                    + sheet.by_area * dd_area
                    + tt * d_trace[a] * d_trace[b].transpose()
                    + ta * (ta_1 + ta_2)
                    + aa * d_area[a] * d_area[b].transpose();
                block.hessian[a][b] =
                    volume * (w.w1 * dd_i1 + w.w11 * d_i1[a] * d_i1[b].transpose());
            }
        }
        Ok(())
    }
}

/// The relaxed first invariant as a function of the trace of FᵀF and D = det FᵀF.
struct Sheet {
    i1: f64,
    by_trace: f64,
    by_area: f64,
    /// Second derivatives: by the trace twice, by both, by D twice.
    second: [f64; 3],
}

impl Sheet {
    fn of(trace: f64, d: f64) -> Self {
        // λ₁² is the larger root of c² - trace c + D = 0.
        let root = (0.25 * trace * trace - d).max(0.0).sqrt();
        let c = 0.5 * trace + root;
        if d >= c.sqrt() {
            // Taut: λ₂² = D/c is at least 1/λ₁.
            let (by_area, aa) = (-1.0 / (d * d), 2.0 / (d * d * d));
            return Self { i1: trace + 1.0 / d, by_trace: 1.0, by_area, second: [0.0, 0.0, aa] };
        }
        if c <= 1.0 {
            return Self { i1: 3.0, by_trace: 0.0, by_area: 0.0, second: [0.0; 3] };
        }
        let (i1, slope, bend) = (c + 2.0 / c.sqrt(), 1.0 - c.powf(-1.5), 1.5 * c.powf(-2.5));
        // From (2c - trace) dc = c d(trace) - dD, and once more.
        let gap = 2.0 * root;
        let (c_t, c_d) = (c / gap, -1.0 / gap);
        let c_tt = 2.0 * c_t * (1.0 - c_t) / gap;
        let c_td = c_d * (1.0 - 2.0 * c_t) / gap;
        let c_dd = -2.0 * c_d * c_d / gap;
        Self {
            i1,
            by_trace: slope * c_t,
            by_area: slope * c_d,
            second: [
                bend * c_t * c_t + slope * c_tt,
                bend * c_t * c_d + slope * c_td,
                bend * c_d * c_d + slope * c_dd,
            ],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sheet_pulled_one_way_carries_the_stress_of_pure_tension_however_narrow_it_is() {
        for (long, narrow) in [(1.3f64, 0.5f64), (1.3, 0.85), (2.0, 0.3)] {
            let (c, n) = (long * long, narrow * narrow);
            let sheet = Sheet::of(c + n, c * n);
            assert!((sheet.i1 - (c + 2.0 / long)).abs() < 1e-12);
            // Stretching across costs nothing: d i1 = by_trace d(n) + by_area d(c n).
            assert!((sheet.by_trace + sheet.by_area * c).abs() < 1e-12);
            let along = sheet.by_trace + sheet.by_area * n;
            assert!((along - (1.0 - c.powf(-1.5))).abs() < 1e-12);
        }
    }

    #[test]
    fn a_sheet_that_shrinks_both_ways_is_slack_and_one_that_grows_is_taut() {
        let slack = Sheet::of(0.9 + 0.8, 0.9 * 0.8);
        assert_eq!((slack.i1, slack.by_trace, slack.by_area), (3.0, 0.0, 0.0));
        let taut = Sheet::of(1.5 + 1.2, 1.5 * 1.2);
        assert!((taut.i1 - (2.7 + 1.0 / 1.8)).abs() < 1e-12);
    }

    #[test]
    fn derivatives_of_the_invariant_are_differences() {
        for (t, d) in [(2.7, 1.8), (1.9, 0.55), (2.4, 0.7)] {
            let h = 1e-5;
            let diff = |plus: f64, minus: f64| (plus - minus) / (2.0 * h);
            let at = Sheet::of;
            let here = at(t, d);
            assert!((diff(at(t + h, d).i1, at(t - h, d).i1) - here.by_trace).abs() < 1e-8);
            assert!((diff(at(t, d + h).i1, at(t, d - h).i1) - here.by_area).abs() < 1e-8);
            let tt = diff(at(t + h, d).by_trace, at(t - h, d).by_trace);
            let td = diff(at(t, d + h).by_trace, at(t, d - h).by_trace);
            let dd = diff(at(t, d + h).by_area, at(t, d - h).by_area);
            for (got, want) in here.second.into_iter().zip([tt, td, dd]) {
                assert!((got - want).abs() < 1e-6 * (1.0 + want.abs()), "{t} {d}: {got} {want}");
            }
        }
    }
}
