//! Residuals of simulated poses at material points of the skin.

use crate::{
    calibrate::Fit, mesh::BreastMesh, model::BreastBase, pose::PoseFit, shape::Shape,
    span::orthonormal,
};
use mammotwin_data::{
    Failure, Vec3,
    mesh::Patch,
    surface::{TriMesh, barycentric},
};
use mammotwin_solver::distance::SurfaceIndex;
use nalgebra::{DMatrix, DVector};
use std::collections::{BTreeMap, BTreeSet};

/// Nodes this near (mm) to the nipple are not weighed: the mesh does not resolve it, so that normal
/// distances there are those of its bump.
const NIPPLE_MM: f64 = 15.0;

/// Places, among the nodes that a fit compares, of those that are weighed: corners of elements beside
/// the nipples.
pub(super) fn weighed(mesh: &BreastMesh, active: &[u32]) -> Vec<u32> {
    let corners = mesh.corners().points.len();
    let smooth = |node: u32| {
        let point = &mesh.mesh.points[node as usize];
        let near = |base: &BreastBase| (base.nipple - point).norm() < NIPPLE_MM;
        (node as usize) < corners && !mesh.anatomy.breasts.iter().any(near)
    };
    (0..).zip(active).filter(|(_, node)| smooth(**node)).map(|(place, _)| place).collect()
}

/// Edges of the skin between some of its nodes, as places among these.
pub(super) fn edges(mesh: &BreastMesh, nodes: &[u32]) -> Vec<[u32; 2]> {
    let place: BTreeMap<u32, u32> = nodes.iter().zip(0..).map(|(&node, at)| (node, at)).collect();
    let mut edges = BTreeSet::new();
    for face in mesh.corners().patch(Patch::Skin) {
        for n in 0..3 {
            let (a, b) = (place.get(&face[n]), place.get(&face[(n + 1) % 3]));
            if let (Some(&a), Some(&b)) = (a, b) {
                edges.insert([a.min(b), a.max(b)]);
            }
        }
    }
    edges.into_iter().collect()
}

/// The skin of a mesh with its nodes at `points`.
pub(super) fn skin(mesh: &BreastMesh, points: &[Vec3]) -> TriMesh {
    TriMesh { points: points.to_vec(), triangles: mesh.mesh.patch(Patch::Skin).to_vec() }
}

/// The residuals (mm) of all poses but the reference pose, one after the other, at the places among
/// the compared nodes that are weighed.
pub(super) fn residual(fit: &Fit, weighed: &[u32]) -> DVector<f64> {
    let one = |pose: &PoseFit| {
        let signed_mm = pose.signed_mm.clone();
        weighed.iter().map(move |&place| signed_mm[place as usize])
    };
    DVector::from_vec(fit.poses[1..].iter().flat_map(one).collect())
}

/// The residuals (mm) of a fit on another mesh, all poses, at the places of nodes of the reference pose.
///
/// Residuals are smooth along the skin, faces are chords of it: the skins of two meshes would differ by
/// these chords where they are the same.
pub(super) fn carried(
    reference: &Shape,
    other: &BreastMesh,
    fit: &Fit,
) -> Result<DVector<f64>, Failure> {
    let wrong = |cause: &dyn std::fmt::Display| Failure::Numerics(format!("discover: {cause}"));
    let skin = skin(other, &other.mesh.points);
    let index = SurfaceIndex::new(&skin).map_err(|c| wrong(&c))?;
    let closest = index.closest_of(&reference.points).map_err(|c| wrong(&c))?;
    let mut all = Vec::new();
    for pose in &fit.poses[1..] {
        let known: BTreeMap<u32, f64> =
            pose.active.iter().copied().zip(pose.signed_mm.iter().copied()).collect();
        for found in &closest {
            let corners = skin.triangles[found.triangle];
            let weights = barycentric(corners.map(|n| skin.points[n as usize]), &found.point);
            let (mut sum, mut weight) = (0.0, 0.0);
            for (node, part) in corners.iter().zip(weights) {
                if let Some(signed_mm) = known.get(node) {
                    sum += part * signed_mm;
                    weight += part;
                }
            }
            if weight < LEAST_KNOWN {
                // Beside what that mesh compares: its nearest node that it does.
                let far = |n: &u32| (skin.points[*n as usize] - found.point).norm_squared();
                let near = known.keys().min_by(|a, b| far(a).total_cmp(&far(b)));
                let near = near.ok_or_else(|| wrong(&"another mesh compares no skin"))?;
                (sum, weight) = (known[near], 1.0);
            }
            all.push(sum / weight);
        }
    }
    Ok(DVector::from_vec(all))
}

/// Weight of compared corners with which a residual is interpolated.
const LEAST_KNOWN: f64 = 0.3;

/// Rows of some poses among those of all, of `nodes` each.
pub(super) fn rows(poses: &[usize], nodes: usize) -> Vec<usize> {
    poses.iter().flat_map(|p| p * nodes..(p + 1) * nodes).collect()
}

/// The residuals of some poses.
pub(super) fn part(all: &DVector<f64>, poses: &[usize], nodes: usize) -> DVector<f64> {
    all.select_rows(&rows(poses, nodes))
}

/// What is left of a covariance (mm²) of residuals when the columns `fitted` (mm) are fitted.
pub(super) fn leftover(covariance: &DMatrix<f64>, fitted: &[DVector<f64>]) -> DMatrix<f64> {
    let basis = orthonormal(&DMatrix::from_columns(fitted));
    let left = covariance - &basis * (basis.transpose() * covariance);
    &left - (&left * &basis) * basis.transpose()
}
