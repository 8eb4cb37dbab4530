//! Tetrahedra with a node in the middle of each edge: for verification, and where linear ones are not
//! accurate enough.

use super::domain::{Domain, PatchSet, project};
use mammotwin_data::{
    Mat3, Vec3,
    labels::Tissue,
    mesh::{Patch, TetMesh},
};
use nalgebra::Vector4;
use std::collections::BTreeMap;

/// Edges of a tetrahedron by its corners, in the order of the nodes 4 to 9.
pub const TET_EDGES: [[usize; 2]; 6] = [[0, 1], [1, 2], [2, 0], [0, 3], [1, 3], [2, 3]];
/// Edges of a triangle by its corners, in the order of the nodes 3 to 5.
pub const FACE_EDGES: [[usize; 2]; 3] = [[0, 1], [1, 2], [2, 0]];

/// Parts of a ten-node tetrahedron: its corners, then the four around the diagonal from node 6 to
/// node 8 (Bey, *Computing* 55 (1995) 355).
pub const CHILDREN: [[usize; 4]; 8] = [
    [0, 4, 6, 7],
    [4, 1, 5, 8],
    [6, 5, 2, 9],
    [7, 8, 9, 3],
    [4, 8, 6, 7],
    [4, 5, 6, 8],
    [7, 8, 6, 9],
    [5, 6, 8, 9],
];
/// Parts of a six-node triangle.
pub const FACE_CHILDREN: [[usize; 3]; 4] = [[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]];

/// Farthest way of an edge's node to the surface, in lengths of the edge.
const FARTHEST: f64 = 0.25;
/// Least volume ratio anywhere in a curved element.
const LEAST_SHRINKAGE: f64 = 0.2;

/// Values of the ten shape functions.
pub(crate) fn shapes(l: &Vector4<f64>) -> [f64; 10] {
    std::array::from_fn(|n| match n {
        0..4 => l[n] * (2.0 * l[n] - 1.0),
        _ => 4.0 * l[TET_EDGES[n - 4][0]] * l[TET_EDGES[n - 4][1]],
    })
}

/// Derivatives of the ten shape functions by the barycentric coordinates.
pub(crate) fn slopes(l: &Vector4<f64>) -> [Vector4<f64>; 10] {
    std::array::from_fn(|n| {
        let mut slope = Vector4::zeros();
        match n {
            0..4 => slope[n] = 4.0 * l[n] - 1.0,
            _ => {
                let [a, b] = TET_EDGES[n - 4];
                (slope[a], slope[b]) = (4.0 * l[b], 4.0 * l[a]);
            }
        }
        slope
    })
}

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

    /// The mesh with the nodes of its outer edges on the surfaces of the domain that it was made of,
    /// so that its outside is curved as that is. Elements that this would distort keep straight edges.
    pub fn fitted(mesh: &TetMesh, domain: &dyn Domain) -> Self {
        let mut fine = Self::new(mesh);
        let straight = fine.points.clone();
        let mut outer: BTreeMap<u32, PatchSet> = BTreeMap::new();
        for (&patch, faces) in &fine.patches {
            for node in faces.iter().flat_map(|face| &face[3..]) {
                let set = outer.entry(*node).or_default();
                *set = set.with(patch);
            }
        }
        let mut lengths = BTreeMap::new();
        for tet in &fine.tets {
            for (node, [a, b]) in tet[4..].iter().zip(TET_EDGES) {
                let (a, b) = (straight[tet[a] as usize], straight[tet[b] as usize]);
                lengths.insert(*node, (a - b).norm());
            }
        }
        for (node, set) in outer {
            let reach_mm = FARTHEST * lengths[&node];
            if let Some(place) = project(domain, &straight[node as usize], set, reach_mm) {
                fine.points[node as usize] = place;
            }
        }
        // An edge that is made straight changes all elements around it.
        loop {
            let unsound = |tet: &&[u32; 10]| !fine.is_sound(tet, &straight);
            let edges: Vec<u32> =
                fine.tets.iter().filter(unsound).flat_map(|tet| &tet[4..]).copied().collect();
            let bent = |node: &&u32| fine.points[**node as usize] != straight[**node as usize];
            if !edges.iter().any(|node| bent(&node)) {
                return fine;
            }
            for node in edges {
                fine.points[node as usize] = straight[node as usize];
            }
        }
    }

    /// Whether the map from the straight element to the curved one shrinks volumes little at corners
    /// and edge nodes.
    fn is_sound(&self, tet: &[u32; 10], straight: &[Vec3]) -> bool {
        let x = tet.map(|n| self.points[n as usize]);
        let corner = |n: usize| straight[tet[n] as usize];
        let edges = |o: Vec3| Mat3::from_columns(&[corner(1) - o, corner(2) - o, corner(3) - o]);
        let whole = edges(corner(0)).determinant();
        let at = |l: Vector4<f64>| {
            let slopes = slopes(&l);
            let by = |k: usize| (0..10).map(|n| (slopes[n][k] - slopes[n][0]) * x[n]).sum::<Vec3>();
            Mat3::from_columns(&[by(1), by(2), by(3)]).determinant()
        };
        let corners = (0..4).map(|n| Vector4::from_fn(|m, _| f64::from(u8::from(m == n))));
        let half =
            |edge: [usize; 2]| Vector4::from_fn(|m, _| if edge.contains(&m) { 0.5 } else { 0.0 });
        let middles = TET_EDGES.into_iter().map(half);
        corners.chain(middles).all(|l| at(l) > LEAST_SHRINKAGE * whole)
    }

    /// Each tetrahedron split into eight linear ones, and each outer triangle into four, on the same
    /// nodes; children follow each other. `tissues` is one for each tetrahedron.
    pub fn split(&self, tissues: &[Tissue]) -> TetMesh {
        let child = |tet: &[u32; 10]| CHILDREN.map(|four| four.map(|n| tet[n]));
        let part = |face: &[u32; 6]| FACE_CHILDREN.map(|three| three.map(|n| face[n]));
        let patches = self.patches.iter();
        TetMesh {
            points: self.points.clone(),
            tets: self.tets.iter().flat_map(child).collect(),
            tissues: tissues.iter().flat_map(|&tissue| [tissue; CHILDREN.len()]).collect(),
            patches: patches.map(|(&p, f)| (p, f.iter().flat_map(part).collect())).collect(),
        }
    }

    /// The mesh that [`QuadraticMesh::split`] made `parts` of, and its straight tetrahedra (no points).
    pub fn of_parts(parts: &TetMesh) -> (Self, TetMesh) {
        let ten = |c: &[[u32; 4]]| {
            [
                c[0][0], c[1][1], c[2][2], c[3][3], c[0][1], c[1][2], c[0][2], c[0][3], c[1][3],
                c[2][3],
            ]
        };
        let six = |c: &[[u32; 3]]| [c[0][0], c[1][1], c[2][2], c[0][1], c[1][2], c[0][2]];
        let tets: Vec<[u32; 10]> = parts.tets.chunks_exact(CHILDREN.len()).map(ten).collect();
        let faces = |faces: &[[u32; 3]]| -> Vec<[u32; 6]> {
            faces.chunks_exact(FACE_CHILDREN.len()).map(six).collect()
        };
        let patches: BTreeMap<Patch, Vec<[u32; 6]>> =
            parts.patches.iter().map(|(&patch, all)| (patch, faces(all))).collect();
        let straight = TetMesh {
            points: Vec::new(),
            tets: tets.iter().map(|t| [t[0], t[1], t[2], t[3]]).collect(),
            tissues: parts.tissues.iter().step_by(CHILDREN.len()).copied().collect(),
            patches: patches
                .iter()
                .map(|(&patch, all)| (patch, all.iter().map(|f| [f[0], f[1], f[2]]).collect()))
                .collect(),
        };
        (Self { points: parts.points.clone(), tets, patches }, straight)
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
    use crate::mesh::domain::PatchDistances;
    use crate::mesh::tetrahedralize::{Meshing, tetrahedralize};

    /// A ball.
    struct Ball(f64);

    impl Domain for Ball {
        fn distances(&self, p: &Vec3) -> PatchDistances {
            PatchDistances::none().with(Patch::Skin, p.norm() - self.0)
        }

        fn bounds(&self) -> (Vec3, Vec3) {
            (Vec3::repeat(-self.0), Vec3::repeat(self.0))
        }
    }

    #[test]
    fn parts_fill_the_whole_and_curved_edges_lie_on_the_ball() {
        let radius = 30.0;
        let tissue = |_: &Vec3| Tissue::AdiposeLeft;
        let mesh = tetrahedralize(&Ball(radius), &Meshing::of_size(9.0), tissue).unwrap();
        let volume = |mesh: &TetMesh| {
            let parts = mesh.tets.iter().map(|tet| TetMesh::tet_volume(&mesh.points, tet));
            assert!(parts.clone().all(|v| v > 0.0));
            parts.sum::<f64>()
        };
        let straight = QuadraticMesh::new(&mesh).split(&mesh.tissues);
        assert_eq!(straight.tets.len(), 8 * mesh.tets.len());
        assert!((volume(&straight) / volume(&mesh) - 1.0).abs() < 1e-12);
        let curved = QuadraticMesh::fitted(&mesh, &Ball(radius));
        for node in curved.patch_nodes(Patch::Skin) {
            assert!((curved.points[node as usize].norm() - radius).abs() < 0.01);
        }
        // Chords of half the length miss a quarter of the volume.
        let ball = 4.0 / 3.0 * std::f64::consts::PI * radius.powi(3);
        let missing = |mesh: &TetMesh| ball - volume(mesh);
        let ratio = missing(&curved.split(&mesh.tissues)) / missing(&mesh);
        assert!((ratio - 0.25).abs() < 0.03, "{ratio}");
        let (back, corners) = QuadraticMesh::of_parts(&curved.split(&mesh.tissues));
        assert_eq!(back, curved);
        assert_eq!((corners.tets, corners.patches), (mesh.tets.clone(), mesh.patches.clone()));
        // Outer triangles look outward, as those of the mesh.
        let surface = curved.split(&mesh.tissues).patch_surface(Patch::Skin);
        for (t, corners) in surface.triangles.iter().enumerate() {
            assert!(surface.area_vector(t).dot(&surface.points[corners[0] as usize]) > 0.0);
        }
    }

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
