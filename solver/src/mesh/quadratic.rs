//! Tetrahedra with a node in the middle of each edge, for verification.

use mammotwin_data::{
    Vec3,
    mesh::{Patch, TetMesh},
};
use std::collections::BTreeMap;

/// Edges of a tetrahedron by its corners, in the order of the nodes 4 to 9.
pub const TET_EDGES: [[usize; 2]; 6] = [[0, 1], [1, 2], [2, 0], [0, 3], [1, 3], [2, 3]];
/// Edges of a triangle by its corners, in the order of the nodes 3 to 5.
pub const FACE_EDGES: [[usize; 2]; 3] = [[0, 1], [1, 2], [2, 0]];

/// Ten-node tetrahedra and the six-node triangles on their outside.
///
/// The corners are the nodes of the mesh that it was made of, with the same indices; nodes on the
/// edges follow. Elements that share an edge share its node. An edge is curved when its node has
/// been moved.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct QuadraticMesh {
    /// Nodes (mm).
    pub points: Vec<Vec3>,
    /// Corners, then nodes on [`TET_EDGES`].
    pub tets: Vec<[u32; 10]>,
    /// Corners, then nodes on [`FACE_EDGES`].
    pub patches: BTreeMap<Patch, Vec<[u32; 6]>>,
}

impl QuadraticMesh {
    /// The mesh with a node at the middle of each edge.
    pub fn new(mesh: &TetMesh) -> Self {
        let key = |a: u32, b: u32| (a.min(b), a.max(b));
        let mut points = mesh.points.clone();
        let mut middles = BTreeMap::new();
        let mut middle = |a: u32, b: u32| {
            *middles.entry(key(a, b)).or_insert_with(|| {
                points.push(0.5 * (mesh.points[a as usize] + mesh.points[b as usize]));
                points.len() as u32 - 1
            })
        };
        let tets = mesh.tets.iter().map(|tet| {
            let mut ten = [0; 10];
            ten[..4].copy_from_slice(tet);
            for (node, [a, b]) in TET_EDGES.into_iter().enumerate() {
                ten[4 + node] = middle(tet[a], tet[b]);
            }
            ten
        });
        let tets = tets.collect();
        let patches = mesh.patches.iter().map(|(&patch, faces)| {
            let faces = faces.iter().map(|face| {
                let mut six = [0; 6];
                six[..3].copy_from_slice(face);
                for (node, [a, b]) in FACE_EDGES.into_iter().enumerate() {
                    six[3 + node] = middle(face[a], face[b]);
                }
                six
            });
            (patch, faces.collect())
        });
        let patches = patches.collect();
        Self { points, tets, patches }
    }

    /// Nodes of a patch, ascending.
    pub fn patch_nodes(&self, patch: Patch) -> Vec<u32> {
        let mut nodes: Vec<u32> =
            self.patches.get(&patch).into_iter().flatten().flatten().copied().collect();
        nodes.sort_unstable();
        nodes.dedup();
        nodes
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mammotwin_data::labels::Tissue;

    #[test]
    fn neighbours_share_the_nodes_on_their_edges() {
        let points = [[0., 0., 0.], [2., 0., 0.], [0., 2., 0.], [0., 0., 2.], [2., 2., 2.]];
        let mesh = TetMesh {
            points: points.map(Vec3::from).to_vec(),
            tets: vec![[0, 1, 2, 3], [1, 4, 2, 3]],
            tissues: vec![Tissue::AdiposeLeft; 2],
            patches: BTreeMap::from([(Patch::Skin, vec![[1, 2, 4]])]),
        };
        let fine = QuadraticMesh::new(&mesh);
        // Nine edges: six and six, three of them common.
        assert_eq!(fine.points.len(), 5 + 9);
        for (ten, four) in fine.tets.iter().zip(&mesh.tets) {
            assert_eq!(ten[..4], *four);
            for (node, [a, b]) in ten[4..].iter().zip(TET_EDGES) {
                let (a, b) = (mesh.points[four[a] as usize], mesh.points[four[b] as usize]);
                assert_eq!(fine.points[*node as usize], 0.5 * (a + b));
            }
        }
        let on_skin = fine.patch_nodes(Patch::Skin);
        assert_eq!(on_skin.len(), 6);
        assert!(on_skin.iter().all(|n| fine.tets[1].contains(n)));
    }
}
