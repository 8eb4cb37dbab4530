//! What the measured skin may be off without any effect: the covariance of all errors.
//!
//! Residuals are signed normal distances at the compared nodes of all poses, stacked pose after
//! pose. Rigid motion of a pose is left open: a registration error must not look like physics.

use super::observe::rows;
use crate::shape::Shape;
use mammotwin_data::Vec3;
use nalgebra::{Cholesky, DMatrix, DVector, Dyn};
use serde::{Deserialize, Serialize};

/// Standard deviations (mm) and lengths (mm) of the errors.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Budget {
    /// Independent from node to node: noise of the segmentation, as the residuals show it.
    pub white_mm: f64,
    /// Segmentation of either image, correlated along the skin ...
    pub segmentation_mm: f64,
    /// ... over this length.
    pub segmentation_length_mm: f64,
    /// Change of the chest wall between poses, along each axis ...
    pub chest_mm: f64,
    /// ... over this length.
    pub chest_length_mm: f64,
    /// A surface that lies too far out or in as a whole.
    pub offset_mm: f64,
}

/// Least noise from node to node (mm).
const LEAST_WHITE_MM: f64 = 0.25;
/// Errors (mm, radians) of the rigid motion of a pose, along and about each axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RigidError {
    /// Of the translation (mm).
    pub shift_mm: f64,
    /// Of the rotation (rad).
    pub turn: f64,
}

/// Leaves the rigid motion open: so much is as likely as none.
const OPEN: RigidError = RigidError { shift_mm: 10.0, turn: 0.1 };

impl Budget {
    /// The budget of the residuals (mm) of all poses at nodes that `edges` join: their noise from node
    /// to node is measured where they differ from the mean of their neighbours, robustly. The chest
    /// wall's 1 - 2.4 mm rms over waves of 160 - 320 mm is what people differ by between poses
    /// (Mîra 2018, § 3.1; measured ±5 mm).
    pub fn of(edges: &[[u32; 2]], nodes: usize, residual: &DVector<f64>) -> Self {
        let mut rough: Vec<f64> = Vec::new();
        for pose in residual.as_slice().chunks(nodes.max(1)) {
            let mut around = vec![(0.0, 0.0); nodes];
            for &[a, b] in edges {
                for (at, near) in [(a as usize, b as usize), (b as usize, a as usize)] {
                    around[at].0 += pose[near];
                    around[at].1 += 1.0;
                }
            }
            for ((sum, count), own) in around.into_iter().zip(pose) {
                if count >= 3.0 {
                    // Independent noise: the difference has (1 + 1/n) of its variance.
                    rough.push((own - sum / count).abs() / f64::sqrt(1.0 + 1.0 / count));
                }
            }
        }
        rough.sort_unstable_by(f64::total_cmp);
        // The median of |x| is 0.6745 standard deviations.
        let white = rough.get(rough.len() / 2).copied().unwrap_or(0.0) / 0.6745;
        let white_mm = f64::max(LEAST_WHITE_MM, white);
        Self {
            white_mm,
            segmentation_mm: white_mm,
            segmentation_length_mm: 12.0,
            chest_mm: 1.05,
            chest_length_mm: 60.0,
            offset_mm: 0.3,
        }
    }

    /// Covariance (mm²) of the residuals of all poses, whose simulated skins are `shapes`; their rigid
    /// motions are open. `meshings` are differences (mm) to the same model on other meshes, whose
    /// mean was taken from the residuals.
    pub fn covariance(
        &self,
        reference: &Shape,
        shapes: &[Shape],
        meshings: &[DVector<f64>],
        growth: &DVector<f64>,
    ) -> DMatrix<f64> {
        self.measured(reference, shapes, growth, OPEN) + of_meshes(shapes, meshings)
    }

    /// Covariance (mm²) of the errors of what was measured, with errors of the rigid motions. Those of the
    /// reference pose reach the residuals `growth` times as large.
    pub fn measured(
        &self,
        reference: &Shape,
        shapes: &[Shape],
        growth: &DVector<f64>,
        rigid_error: RigidError,
    ) -> DMatrix<f64> {
        let RigidError { shift_mm, turn } = rigid_error;
        let (poses, nodes) = (shapes.len(), reference.points.len());
        let bell = |a: &Vec3, b: &Vec3, length: f64| {
            (-0.5 * (a - b).norm_squared() / (length * length)).exp()
        };
        let mut sum = DMatrix::zeros(poses * nodes, poses * nodes);
        let segmentation = self.segmentation_mm.powi(2);
        let shared = DMatrix::from_fn(nodes, nodes, |i, j| {
            let facing = reference.normals[i].dot(&reference.normals[j]).max(0.0);
            let (a, b) = (&reference.points[i], &reference.points[j]);
            segmentation * bell(a, b, self.segmentation_length_mm) * facing
        });
        for p in 0..poses {
            for q in 0..poses {
                let mut block = sum.view_mut((p * nodes, q * nodes), (nodes, nodes));
                let [to, from] = [p, q].map(|pose| growth.rows(pose * nodes, nodes));
                block += DMatrix::from_fn(nodes, nodes, |i, j| to[i] * from[j] * shared[(i, j)]);
                if p != q {
                    continue;
                }
                let pose = &shapes[p];
                let rigid = pose.rigid_modes();
                for i in 0..nodes {
                    for j in 0..nodes {
                        let (a, b) = (&pose.points[i], &pose.points[j]);
                        let facing = pose.normals[i].dot(&pose.normals[j]);
                        let own = segmentation * bell(a, b, self.segmentation_length_mm);
                        let chest = self.chest_mm.powi(2) * bell(a, b, self.chest_length_mm);
                        let mut error = own * facing.max(0.0) + chest * facing;
                        error += self.offset_mm.powi(2);
                        for (n, mode) in rigid.iter().enumerate() {
                            let size = if n < 3 { shift_mm } else { turn };
                            error += (size * size) * mode[i] * mode[j];
                        }
                        block[(i, j)] += error;
                    }
                    block[(i, i)] += self.white_mm.powi(2);
                }
            }
        }
        sum
    }
}

/// Length (mm) over which the errors of a mesh are alike, and over which their size is.
const MESH_LENGTH_MM: f64 = 20.0;
const MESH_SIZE_LENGTH_MM: f64 = 30.0;
/// Part of the mesh's covariance that is the scatter of the meshes itself; the rest has its size, but
/// any shape: a few meshes do not span all errors.
const MESH_SCATTER: f64 = 0.5;

/// Mean of columns.
pub(super) fn mean(columns: &[DVector<f64>]) -> DVector<f64> {
    let rows = columns.first().map_or(0, DVector::len);
    columns.iter().fold(DVector::zeros(rows), |sum, c| sum + c) / columns.len().max(1) as f64
}

/// Covariance (mm²) of what the mesh is off, its mean known from `meshings` alone: their scatter about
/// it, once for the truth and a part for the mean.
fn of_meshes(shapes: &[Shape], meshings: &[DVector<f64>]) -> DMatrix<f64> {
    let count = meshings.len() as f64;
    let rows = shapes.iter().map(|shape| shape.points.len()).sum();
    let mut sum = DMatrix::zeros(rows, rows);
    if meshings.len() < 2 {
        return sum;
    }
    let mean = mean(meshings);
    let mut variance: DVector<f64> = DVector::zeros(rows);
    for column in meshings {
        let off = column - &mean;
        sum.ger(MESH_SCATTER / (count - 1.0), &off, &off, 1.0);
        variance += off.component_mul(&off) / (count - 1.0);
    }
    let mut at = 0;
    for shape in shapes {
        let nodes = shape.points.len();
        let alike = |i: usize, j: usize, length: f64| {
            let far = (shape.points[i] - shape.points[j]).norm_squared();
            (-0.5 * far / (length * length)).exp()
        };
        let size: Vec<f64> = (0..nodes)
            .map(|i| {
                let weight = |j: usize| alike(i, j, MESH_SIZE_LENGTH_MM);
                let all: f64 = (0..nodes).map(weight).sum();
                let square: f64 = (0..nodes).map(|j| weight(j) * variance[at + j]).sum();
                (square / all).sqrt()
            })
            .collect();
        for i in 0..nodes {
            for j in 0..nodes {
                let facing = shape.normals[i].dot(&shape.normals[j]).max(0.0);
                let any = size[i] * size[j] * alike(i, j, MESH_LENGTH_MM) * facing;
                sum[(at + i, at + j)] += (1.0 - MESH_SCATTER) * any;
            }
        }
        at += nodes;
    }
    sum * (1.0 + 1.0 / count)
}

/// Turns residuals into independent ones of variance 1.
pub struct Whitener(Cholesky<f64, Dyn>);

impl Whitener {
    /// Of a covariance, for the rows of the given poses of `nodes` each; `None` when the
    /// covariance is not positive.
    pub fn new(covariance: &DMatrix<f64>, poses: &[usize], nodes: usize) -> Option<Self> {
        let rows = rows(poses, nodes);
        Cholesky::new(covariance.select_rows(&rows).select_columns(&rows)).map(Self)
    }

    /// Whitened residuals.
    pub fn whiten(&self, residual: &DVector<f64>) -> DVector<f64> {
        let mut whitened = residual.clone();
        self.0.l_dirty().solve_lower_triangular_mut(&mut whitened);
        whitened
    }
}
