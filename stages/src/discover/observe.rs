//! Residuals of simulated poses at material points of the skin.

use crate::{calibrate::Fit, mesh::BreastMesh, pose::PoseFit};
use mammotwin_data::{Failure, Vec3, mesh::Patch, surface::TriMesh};
use mammotwin_solver::distance::SurfaceIndex;
use nalgebra::{DMatrix, DVector};
use std::collections::BTreeMap;

/// The compared nodes of the skin, in the reference pose.
pub struct Frame {
    /// Positions (mm).
    pub reference: Vec<Vec3>,
    /// Outward unit normals.
    pub normals: Vec<Vec3>,
    /// Compared neighbours of each.
    pub neighbours: Vec<Vec<usize>>,
    faces: Vec<[u32; 3]>,
    active: Vec<u32>,
}

/// One simulated pose at the compared nodes.
pub struct ObservedPose {
    /// Simulated positions (mm).
    pub points: Vec<Vec3>,
    /// Outward unit normals of the simulated skin.
    pub normals: Vec<Vec3>,
    /// Signed distance (mm) to the measured skin, positive outside of it.
    pub signed_mm: Vec<f64>,
    surface: TriMesh,
}

/// All poses but the reference pose.
pub struct Observed {
    /// In the order of the experiment.
    pub poses: Vec<ObservedPose>,
}

impl Frame {
    /// The frame of a mesh, for the nodes that a fit compares.
    pub fn new(mesh: &BreastMesh, fit: &Fit) -> Result<Self, Failure> {
        let active = match fit.poses.first() {
            Some(pose) if !pose.active.is_empty() => pose.active.clone(),
            _ => return Err(Failure::BadInput("discover: no skin is compared".into())),
        };
        let faces = mesh.mesh.patch(Patch::Skin).to_vec();
        let skin = TriMesh { points: mesh.mesh.points.clone(), triangles: faces.clone() };
        let normals = skin.vertex_normals();
        let place: BTreeMap<u32, usize> =
            active.iter().enumerate().map(|(at, &node)| (node, at)).collect();
        let mut neighbours = vec![Vec::new(); active.len()];
        for face in &faces {
            for n in 0..3 {
                let (a, b) = (place.get(&face[n]), place.get(&face[(n + 1) % 3]));
                if let (Some(&a), Some(&b)) = (a, b) {
                    neighbours[a].push(b);
                    neighbours[b].push(a);
                }
            }
        }
        for near in &mut neighbours {
            near.sort_unstable();
            near.dedup();
        }
        Ok(Self {
            reference: active.iter().map(|&n| mesh.mesh.points[n as usize]).collect(),
            normals: active.iter().map(|&n| normals[n as usize]).collect(),
            neighbours,
            faces,
            active,
        })
    }

    /// The poses of a fit, without the reference pose.
    pub fn observe(&self, fit: &Fit) -> Observed {
        Observed { poses: fit.poses[1..].iter().map(|pose| self.pose(pose)).collect() }
    }

    fn pose(&self, pose: &PoseFit) -> ObservedPose {
        let points = pose.solution.points.clone();
        let surface = TriMesh { points, triangles: self.faces.clone() };
        let normals = surface.vertex_normals();
        ObservedPose {
            points: self.active.iter().map(|&n| surface.points[n as usize]).collect(),
            normals: self.active.iter().map(|&n| normals[n as usize]).collect(),
            signed_mm: pose.signed_mm.clone(),
            surface,
        }
    }
}

impl Observed {
    /// The residuals (mm) of some poses, one after the other.
    pub fn residual(&self, poses: &[usize]) -> DVector<f64> {
        let all = poses.iter().flat_map(|&p| self.poses[p].signed_mm.iter().copied());
        DVector::from_vec(all.collect())
    }

    /// Signed distances (mm) of the nodes of all poses to the skin of the same poses on another mesh.
    pub fn differences(
        &self,
        other: &[PoseFit],
        faces: &[[u32; 3]],
    ) -> Result<DVector<f64>, Failure> {
        let wrong = |cause: &dyn std::fmt::Display| Failure::Numerics(format!("discover: {cause}"));
        let mut all = Vec::new();
        for (pose, other) in self.poses.iter().zip(other) {
            let points = other.solution.points.clone();
            let surface = TriMesh { points, triangles: faces.to_vec() };
            let index = SurfaceIndex::new(&surface).map_err(|c| wrong(&c))?;
            let closest = index.closest_of(&pose.points).map_err(|c| wrong(&c))?;
            all.extend(closest.iter().zip(&pose.points).map(|(c, p)| c.signed_mm(p)));
        }
        Ok(DVector::from_vec(all))
    }
}

impl ObservedPose {
    /// What small translations (1 mm) and turns (1 rad about the centre) of the measured skin add to
    /// the residuals.
    pub fn rigid_modes(&self) -> [DVector<f64>; 6] {
        let center = self.points.iter().sum::<Vec3>() / self.points.len().max(1) as f64;
        std::array::from_fn(|mode| {
            let one = |(p, n): (&Vec3, &Vec3)| match mode {
                0..3 => n[mode],
                _ => (p - center).cross(n)[mode - 3],
            };
            DVector::from_iterator(
                self.points.len(),
                self.points.iter().zip(&self.normals).map(one),
            )
        })
    }

    /// Root mean square (mm) of residuals after the rigid motion that makes it least.
    pub fn without_rigid_mm(&self, residual: &DVector<f64>) -> f64 {
        let left = residual - self.rigid_part(residual);
        (left.norm_squared() / left.len().max(1) as f64).sqrt()
    }

    /// The part of residuals that a rigid motion explains (mm).
    pub fn rigid_part(&self, residual: &DVector<f64>) -> DVector<f64> {
        let basis = DMatrix::from_columns(&self.rigid_modes()).qr().q();
        &basis * (basis.transpose() * residual)
    }

    /// Root mean square (mm) that errors of a covariance leave after the best rigid motion.
    pub fn floor_mm(&self, covariance: &DMatrix<f64>) -> f64 {
        let basis = DMatrix::from_columns(&self.rigid_modes()).qr().q();
        let left = covariance - &basis * (basis.transpose() * covariance);
        let left = &left - (&left * &basis) * basis.transpose();
        (left.trace() / covariance.nrows().max(1) as f64).max(0.0).sqrt()
    }

    /// The simulated skin.
    pub fn surface(&self) -> &TriMesh {
        &self.surface
    }
}
