//! Tetrahedral meshes.

use crate::{Vec3, labels::Tissue, surface::TriMesh};
use std::collections::BTreeMap;

/// What an outer face of the breasts touches.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, serde::Serialize, serde::Deserialize,
)]
#[serde(rename_all = "snake_case")]
pub enum Patch {
    /// Air: the skin.
    Skin,
    /// The anterior surface of the muscle: the deep fascia glides here.
    ChestWall,
    /// The cut below the clavicles (+z).
    Superior,
    /// The cut at the costal margin (-z).
    Inferior,
    /// The cut at the right midaxillary line (+x).
    LateralRight,
    /// The cut at the left midaxillary line (-x).
    LateralLeft,
    /// The cut at the sternal line, when one breast is modelled alone.
    Medial,
}

impl Patch {
    /// All patches.
    pub const ALL: [Self; 7] = [
        Self::Skin,
        Self::ChestWall,
        Self::Superior,
        Self::Inferior,
        Self::LateralRight,
        Self::LateralLeft,
        Self::Medial,
    ];

    /// Name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Skin => "skin",
            Self::ChestWall => "chest_wall",
            Self::Superior => "superior",
            Self::Inferior => "inferior",
            Self::LateralRight => "lateral_right",
            Self::LateralLeft => "lateral_left",
            Self::Medial => "medial",
        }
    }
}

/// Linear tetrahedra, each of positive volume. Points in mm.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct TetMesh {
    /// Nodes (mm).
    pub points: Vec<Vec3>,
    /// Node indices; `(b-a)·((c-a)×(d-a)) > 0`.
    pub tets: Vec<[u32; 4]>,
    /// One per tetrahedron.
    pub tissues: Vec<Tissue>,
    /// Outer faces, outward, by what they touch. Each outer face is in exactly one patch.
    pub patches: BTreeMap<Patch, Vec<[u32; 3]>>,
}

impl TetMesh {
    /// Volume of a tetrahedron (mm³) with the nodes at `points`.
    pub fn tet_volume(points: &[Vec3], tet: &[u32; 4]) -> f64 {
        let [a, b, c, d] = tet.map(|n| points[n as usize]);
        (b - a).dot(&(c - a).cross(&(d - a))) / 6.0
    }

    /// Volume (mm³).
    pub fn volume_mm3(&self) -> f64 {
        self.tets.iter().map(|tet| Self::tet_volume(&self.points, tet)).sum()
    }

    /// Faces of a patch; none when the mesh has no such patch.
    pub fn patch(&self, patch: Patch) -> &[[u32; 3]] {
        self.patches.get(&patch).map_or(&[], Vec::as_slice)
    }

    /// Nodes of a patch, ascending, each once.
    pub fn patch_nodes(&self, patch: Patch) -> Vec<u32> {
        let mut nodes: Vec<u32> = self.patch(patch).iter().flatten().copied().collect();
        nodes.sort_unstable();
        nodes.dedup();
        nodes
    }

    /// A patch as a surface whose vertices are all nodes of the mesh (same indices).
    pub fn patch_surface(&self, patch: Patch) -> TriMesh {
        TriMesh { points: self.points.clone(), triangles: self.patch(patch).to_vec() }
    }

    /// The closed outer surface (all patches), on all nodes of the mesh.
    pub fn outer_surface(&self) -> TriMesh {
        let triangles = self.patches.values().flatten().copied().collect();
        TriMesh { points: self.points.clone(), triangles }
    }
}
