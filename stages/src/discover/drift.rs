//! Before any effect is asked for: do the poses, each for itself, want the same moduli?

use super::{budget::Whitener, evidence::Evidence, observe::part, rest::rare};
use crate::span::{orthonormal, without};
use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};

/// The moduli that one pose asks for.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PoseModuli {
    /// Its name.
    pub pose: String,
    /// Young's moduli (kPa), right and left.
    pub moduli_kpa: [f64; 2],
    /// Standard deviations of their logarithms.
    pub log_error: [f64; 2],
}

/// Moduli pose by pose. A model that lacks nothing has the same ones in all poses.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Drift {
    /// Of each pose that the search sees, the errors that poses share considered.
    pub poses: Vec<PoseModuli>,
    /// Fall of the squared misfit when each pose may have its own.
    pub fall: f64,
    /// What errors exceed once in a thousand times; `None` for one pose, which cannot disagree.
    pub limit: Option<f64>,
}

impl Drift {
    /// Of the residuals (mm, all poses) of a calibrated model, linear in the moduli's logarithms.
    pub(super) fn of(
        evidence: &Evidence,
        whitener: &Whitener,
        seen: &[usize],
        residual: &DVector<f64>,
    ) -> Self {
        let nodes = evidence.nodes();
        let slopes = evidence.slopes().map(|slope| part(slope, seen, nodes));
        let own: Vec<DVector<f64>> = (0..seen.len())
            .flat_map(|block| slopes.each_ref().map(|slope| alone(slope, block, nodes)))
            .map(|column| whitener.whiten(&column))
            .collect();
        let joint = slopes.map(|slope| whitener.whiten(&slope));
        let (own, joint) = (DMatrix::from_columns(&own), DMatrix::from_columns(&joint));
        let white = whitener.whiten(&part(residual, seen, nodes));
        let left = |columns: &DMatrix<f64>| without(&orthonormal(columns), &white).norm_squared();
        let Some(covariance) = (own.transpose() * &own).try_inverse() else {
            return Self::default();
        };
        let at = -(&covariance * (own.transpose() * &white));
        let kpa = [evidence.moduli.right_kpa, evidence.moduli.left_kpa];
        let one = |(block, &p): (usize, &usize)| {
            let place = |side: usize| 2 * block + side;
            PoseModuli {
                pose: evidence.poses[p].clone(),
                moduli_kpa: [0, 1].map(|side| kpa[side] * at[place(side)].exp()),
                log_error: [0, 1].map(|side| covariance[(place(side), place(side))].sqrt()),
            }
        };
        let free = own.ncols() - joint.ncols();
        let systematic = evidence.budget.systematic().powi(2);
        Self {
            poses: seen.iter().enumerate().map(one).collect(),
            fall: left(&joint) - left(&own),
            limit: (free > 0).then(|| rare(free as f64, systematic)),
        }
    }

    /// Whether the poses want other moduli than each other, beyond what errors do.
    pub fn differs(&self) -> bool {
        self.limit.is_some_and(|limit| self.fall > limit)
    }
}

/// A column of several poses, zero but in one of them.
fn alone(column: &DVector<f64>, block: usize, nodes: usize) -> DVector<f64> {
    DVector::from_fn(column.len(), |n, _| if n / nodes == block { column[n] } else { 0.0 })
}
