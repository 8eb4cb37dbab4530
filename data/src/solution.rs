//! A body in equilibrium.

use crate::{Mat3, Vec3, rigid::RigidTransform};
use std::collections::BTreeMap;

/// One converged state of a model.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Solution {
    /// Current node positions (mm).
    pub points: Vec<Vec3>,
    /// Mean stress tr σ / 3 at the nodes (kPa), negative in compression.
    pub mean_stress_kpa: Vec<f64>,
    /// Deformation gradient, one per tetrahedron.
    pub deformation_gradient: Vec<Mat3>,
    /// Cauchy stress (kPa), one per tetrahedron.
    pub cauchy_kpa: Vec<Mat3>,
    /// Total force (mN) of each term on the body, by the term's name.
    pub forces: BTreeMap<String, Vec3>,
    /// What was checked after the solve.
    pub checks: Checks,
}

impl Solution {
    /// The same state in another frame, rest shape and current shape moved alike.
    pub fn moved(&self, motion: &RigidTransform) -> Self {
        let turn = |tensor: &Mat3| motion.rotation * tensor * motion.rotation.transpose();
        let turned = |(name, force): (&String, &Vec3)| (name.clone(), motion.direction(force));
        Self {
            points: self.points.iter().map(|p| motion.point(p)).collect(),
            deformation_gradient: self.deformation_gradient.iter().map(turn).collect(),
            cauchy_kpa: self.cauchy_kpa.iter().map(turn).collect(),
            forces: self.forces.iter().map(turned).collect(),
            ..self.clone()
        }
    }
}

/// Von Mises stress (kPa): √(3/2 s:s) with the deviator s of the Cauchy stress.
pub fn von_mises_kpa(cauchy_kpa: &Mat3) -> f64 {
    let deviator = cauchy_kpa - Mat3::identity() * (cauchy_kpa.trace() / 3.0);
    (1.5 * deviator.norm_squared()).sqrt()
}

/// Largest and smallest principal stress (kPa), positive in tension: the ends of the eigenvalues.
pub fn principal_stresses_kpa(cauchy_kpa: &Mat3) -> [f64; 2] {
    let values = cauchy_kpa.symmetric_eigenvalues();
    [values.max(), values.min()]
}

/// Numbers that say whether a state may be believed.
#[derive(Debug, Clone, Copy, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Checks {
    /// Newton iterations, over all load steps.
    pub iterations: usize,
    /// Load steps, failed attempts included.
    pub steps: usize,
    /// Largest unbalanced nodal force at the end over the largest force of any term (no unit).
    pub residual: f64,
    /// Smallest det F of any tetrahedron.
    pub min_det_f: f64,
    /// Deepest penetration into any contact target (mm, positive).
    pub max_penetration_mm: f64,
    /// Largest opening of a no-separation contact, or slip on a rough one (mm, positive).
    pub max_gap_mm: f64,
    /// Norm of the sum of all forces, reactions included, over the largest of them (no unit).
    pub force_imbalance: f64,
    /// Norm of the sum of all moments about the middle of the nodes, reactions included, over the
    /// most of any term (the sum of the norms of its nodal moments; no unit).
    pub moment_imbalance: f64,
    /// Largest sum of the forces of a term that joins parts of the body alone (tissue, sheets, fibres), over the largest
    /// force of any term, or of its moments over the most of any; these cancel in every state (no unit).
    pub internal_imbalance: f64,
    /// How far friction lags behind the normal pressure: change of its forces by one more round,
    /// over the normal forces (no unit).
    pub friction_lag: f64,
}
