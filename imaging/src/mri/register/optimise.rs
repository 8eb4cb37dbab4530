//! Levenberg-Marquardt ascent of the similarity.

use super::{
    samples::{Block, Sample, covered},
    similarity::{Evaluation, evaluate, stepped},
};
use mammotwin_data::{Vec3, rigid::RigidTransform, volume::Volume};
use nalgebra::{Matrix6, Vector6};

/// Distance (mm) from the pivot at which a rotation is measured as a path.
const LEVER_MM: f64 = 100.0;

/// What is compared on a level.
pub(super) struct Level {
    pub samples: Vec<Sample>,
    pub moving: Volume<f32>,
    /// Centre of the mask (mm, reference).
    pub center: Vec3,
    /// Distance of points (mm).
    pub spacing_mm: f64,
}

/// Where the ascent ended.
pub(super) struct Optimum {
    /// From reference to moving.
    pub motion: RigidTransform,
    pub evaluation: Evaluation,
    /// Covered part of the samples, by weight.
    pub overlap: f64,
    pub iterations: usize,
}

impl Level {
    /// Similarity at a motion (reference to moving), about the moved centre.
    fn evaluate(&self, blocks: &[Block], motion: &RigidTransform) -> Evaluation {
        evaluate(blocks, &self.moving, motion, &motion.point(&self.center))
    }

    /// The motion as it is.
    pub fn stay(&self, motion: &RigidTransform) -> Optimum {
        self.climb(motion, 0)
    }

    /// Climbs from `start` until a step is shorter than a five-hundredth of the spacing.
    ///
    /// The points that are compared are those that the moving image covers at the start.
    pub fn climb(&self, start: &RigidTransform, most: usize) -> Optimum {
        let blocks = covered(&self.samples, &self.moving, start);
        let overlap = blocks.iter().map(|block| block.weight).sum();
        let evaluation = self.evaluate(&blocks, start);
        let mut best = Optimum { motion: *start, evaluation, overlap, iterations: 0 };
        let mut damping = 1e-3;
        while best.iterations < most {
            best.iterations += 1;
            let Some(step) = self.step(&best.evaluation, damping) else { break };
            let motion = stepped(&best.motion, &best.motion.point(&self.center), &step);
            let evaluation = self.evaluate(&blocks, &motion);
            if evaluation.similarity > best.evaluation.similarity {
                (best.motion, best.evaluation) = (motion, evaluation);
                damping = (damping * 0.2).max(1e-9);
            } else {
                damping *= 8.0;
            }
            if path_mm(&step) < 0.002 * self.spacing_mm {
                break;
            }
        }
        best
    }

    /// How far two motions are from each other: the path (mm) of a point on a sphere of
    /// [`LEVER_MM`] about the centre, at most.
    pub fn path_mm(&self, a: &RigidTransform, b: &RigidTransform) -> f64 {
        let turn = a.inverse().then(b).angle();
        LEVER_MM * turn + (a.point(&self.center) - b.point(&self.center)).norm()
    }

    fn step(&self, here: &Evaluation, damping: f64) -> Option<Vector6<f64>> {
        let diagonal = Matrix6::from_diagonal(&here.curvature.diagonal());
        let matrix = here.curvature + damping * diagonal;
        let step = matrix.cholesky()?.solve(&here.gradient);
        let most = 4.0 * self.spacing_mm;
        Some(step * (most / path_mm(&step)).min(1.0))
    }
}

/// Longest path (mm) of a point on a sphere of [`LEVER_MM`] about the pivot, at most.
fn path_mm(step: &Vector6<f64>) -> f64 {
    LEVER_MM * step.fixed_rows::<3>(0).norm() + step.fixed_rows::<3>(3).norm()
}
