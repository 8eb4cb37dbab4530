//! What the measured skin may be off without any effect: the covariance of all errors.
//!
//! Residuals are signed normal distances at the compared nodes of all poses, stacked pose after
//! pose. Rigid motion of a pose is left open: a registration error must not look like physics.

use super::observe::rows;
use crate::shape::{CHEST_LENGTH_MM, CHEST_MM, Shape};
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
    /// Edge of the voxels that the surfaces were made of.
    pub voxel_mm: f64,
}

/// Scores (standard deviations) that volunteers without any effect have by what no budget knows, per mm of
/// voxel and at least: the surfaces of voxels are too flat where skin is round, and the truth lies on another
/// mesh. Without noise the largest were 2.5 and 1.7 with voxels of 2.5 mm (`tiny`, seeds 3 and 7), 1.9 with
/// 1.25 mm (seed 3).
const SYSTEMATIC_PER_MM: f64 = 0.8;
const LEAST_SYSTEMATIC: f64 = 1.0;

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

/// The weighed nodes of all poses.
#[derive(Debug, Clone, Copy)]
pub struct Nodes<'a> {
    /// Pairs of neighbours.
    pub edges: &'a [[u32; 2]],
    /// In the reference pose.
    pub reference: &'a Shape,
    /// In the simulated poses.
    pub shapes: &'a [Shape],
    /// By how much errors of the reference pose grow on their way into the residuals.
    pub growth: &'a DVector<f64>,
}

/// Length (mm) over which errors of a segmentation are alike.
const SEGMENTATION_LENGTH_MM: f64 = 12.0;

fn bell(a: &Vec3, b: &Vec3, length: f64) -> f64 {
    (-0.5 * (a - b).norm_squared() / (length * length)).exp()
}

impl Nodes<'_> {
    /// Correlation of the segmentation's errors at two nodes of a shape.
    fn alike(shape: &Shape, i: usize, j: usize) -> f64 {
        let facing = shape.normals[i].dot(&shape.normals[j]).max(0.0);
        bell(&shape.points[i], &shape.points[j], SEGMENTATION_LENGTH_MM) * facing
    }

    /// Covariance at two nodes of a pose, of noise from node to node and of the segmentation of both
    /// images, each of size 1.
    fn unit(&self, pose: usize, i: usize, j: usize) -> f64 {
        let at = pose * self.reference.points.len();
        let white = if i == j { 1.0 } else { 0.0 };
        let grown = self.growth[at + i] * self.growth[at + j];
        white + Self::alike(&self.shapes[pose], i, j) + grown * Self::alike(self.reference, i, j)
    }

    /// How far residuals (mm, all poses) of some poses differ from the mean of their neighbours, over what errors of size 1
    /// would make them differ.
    fn roughness(&self, residual: &DVector<f64>, seen: &[usize]) -> Vec<f64> {
        let nodes = self.reference.points.len();
        let mut near = vec![Vec::new(); nodes];
        for &[a, b] in self.edges {
            near[a as usize].push(b as usize);
            near[b as usize].push(a as usize);
        }
        let mut rough = Vec::new();
        for &pose in seen {
            let values = &residual.as_slice()[pose * nodes..(pose + 1) * nodes];
            for (own, near) in near.iter().enumerate().filter(|(_, near)| near.len() >= 3) {
                let part = 1.0 / near.len() as f64;
                let mean = part * near.iter().map(|&n| values[n]).sum::<f64>();
                let with: f64 = near.iter().map(|&n| self.unit(pose, own, n)).sum();
                let among = near.iter().flat_map(|&n| near.iter().map(move |&m| (n, m)));
                let among: f64 = among.map(|(n, m)| self.unit(pose, n, m)).sum();
                let variance = self.unit(pose, own, own) - 2.0 * part * with + part * part * among;
                rough.push((values[own] - mean).abs() / variance.max(f64::MIN_POSITIVE).sqrt());
            }
        }
        rough
    }
}

impl Budget {
    /// The budget of the residuals (mm) of all poses, by those that are `seen`: noise from node to node and errors of the
    /// segmentation are taken for alike in size, and measured where residuals differ from the mean
    /// of their neighbours, robustly. The chest wall's is what people differ by
    /// (1.05 mm an axis over 60 mm). `voxel_mm` is the edge of the images' voxels.
    pub fn of(nodes: &Nodes, residual: &DVector<f64>, seen: &[usize], voxel_mm: f64) -> Self {
        let mut rough = nodes.roughness(residual, seen);
        rough.sort_unstable_by(f64::total_cmp);
        // The median of |x| is 0.6745 standard deviations.
        let white = rough.get(rough.len() / 2).copied().unwrap_or(0.0) / 0.6745;
        let white_mm = f64::max(LEAST_WHITE_MM, white);
        Self {
            white_mm,
            segmentation_mm: white_mm,
            segmentation_length_mm: SEGMENTATION_LENGTH_MM,
            chest_mm: CHEST_MM,
            chest_length_mm: CHEST_LENGTH_MM,
            offset_mm: 0.3,
            voxel_mm,
        }
    }

    /// The score (standard deviations) that stands for nothing: what no covariance here knows of.
    pub fn systematic(&self) -> f64 {
        f64::max(LEAST_SYSTEMATIC, SYSTEMATIC_PER_MM * self.voxel_mm)
    }

    /// Covariance (mm²) of the residuals of all poses; their rigid motions are open. `meshings` are differences (mm) to the same
    /// model on those other meshes whose mean was taken from the residuals.
    pub fn covariance(&self, nodes: &Nodes, meshings: &[DVector<f64>]) -> DMatrix<f64> {
        self.measured(nodes, OPEN) + of_meshes(nodes.shapes, meshings)
    }

    /// Covariance (mm²) of the errors of what was measured, with errors of the rigid motions. Those of the
    /// reference pose have grown on their way.
    pub fn measured(&self, places: &Nodes, rigid_error: RigidError) -> DMatrix<f64> {
        let Nodes { reference, shapes, growth, .. } = *places;
        let RigidError { shift_mm, turn } = rigid_error;
        let (poses, nodes) = (shapes.len(), reference.points.len());
        let mut sum = DMatrix::zeros(poses * nodes, poses * nodes);
        let segmentation = self.segmentation_mm.powi(2);
        let shared =
            DMatrix::from_fn(nodes, nodes, |i, j| segmentation * Nodes::alike(reference, i, j));
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
                        let own = segmentation * Nodes::alike(pose, i, j);
                        let chest = self.chest_mm.powi(2) * bell(a, b, self.chest_length_mm);
                        let mut error = own + chest * facing;
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
/// it, once for the truth, as if it were one of them, and a part for the mean. Others, of which the mean does not know,
/// must not be among them: their scatter is about another mean.
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

    /// Of a covariance, for all its rows; `None` when it is not positive.
    pub fn all(covariance: &DMatrix<f64>) -> Option<Self> {
        Cholesky::new(covariance.clone()).map(Self)
    }

    /// Number of the residuals that it takes.
    pub fn rows(&self) -> usize {
        self.0.l_dirty().nrows()
    }

    /// The inverse of the covariance times columns.
    pub fn solve(&self, columns: &DMatrix<f64>) -> DMatrix<f64> {
        self.0.solve(columns)
    }

    /// Whitened residuals.
    pub fn whiten(&self, residual: &DVector<f64>) -> DVector<f64> {
        let mut whitened = residual.clone();
        self.0.l_dirty().solve_lower_triangular_mut(&mut whitened);
        whitened
    }
}
