//! Neighbourhoods, outer faces and soundness of tetrahedral meshes.

use std::collections::BTreeMap;

/// Tetrahedra around each node.
pub struct Adjacency {
    starts: Vec<u32>,
    tets: Vec<u32>,
}

impl Adjacency {
    /// For a mesh of `nodes` nodes.
    pub fn new(nodes: usize, tets: &[[u32; 4]]) -> Self {
        let mut starts = vec![0u32; nodes + 1];
        for n in tets.iter().flatten() {
            starts[*n as usize + 1] += 1;
        }
        for n in 0..nodes {
            starts[n + 1] += starts[n];
        }
        let mut next = starts.clone();
        let mut around = vec![0; 4 * tets.len()];
        for (t, tet) in tets.iter().enumerate() {
            for n in tet {
                around[next[*n as usize] as usize] = t as u32;
                next[*n as usize] += 1;
            }
        }
        Self { starts, tets: around }
    }

    /// Tetrahedra that have the node, ascending.
    pub fn of(&self, node: usize) -> &[u32] {
        &self.tets[self.starts[node] as usize..self.starts[node + 1] as usize]
    }
}

/// Faces of a positive tetrahedron, outward; face n is opposite to corner n.
pub fn faces([a, b, c, d]: &[u32; 4]) -> [[u32; 3]; 4] {
    [[*b, *c, *d], [*a, *d, *c], [*a, *b, *d], [*a, *c, *b]]
}

/// A face, whatever its orientation and first corner.
pub fn face_key(face: &[u32; 3]) -> [u32; 3] {
    let mut key = *face;
    key.sort_unstable();
    key
}

/// A face that belongs to one tetrahedron only.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct OuterFace {
    /// Corners, outward.
    pub corners: [u32; 3],
    /// Its tetrahedron.
    pub tet: u32,
}

/// Two tetrahedra share each inner face: pairs of them, and the outer faces, both in the order of
/// the faces' nodes.
pub fn face_neighbors(tets: &[[u32; 4]]) -> (Vec<[u32; 2]>, Vec<OuterFace>) {
    let mut all: Vec<([u32; 3], OuterFace)> = Vec::with_capacity(4 * tets.len());
    for (t, tet) in tets.iter().enumerate() {
        for corners in faces(tet) {
            all.push((face_key(&corners), OuterFace { corners, tet: t as u32 }));
        }
    }
    all.sort_unstable_by_key(|(key, face)| (*key, face.tet));
    let (mut inner, mut outer) = (Vec::new(), Vec::new());
    for group in all.chunk_by(|a, b| a.0 == b.0) {
        match group {
            [(_, face)] => outer.push(*face),
            [(_, a), (_, b), ..] => inner.push([a.tet, b.tet]),
            [] => {}
        }
    }
    (inner, outer)
}

/// Marks the tetrahedra of the largest part that hangs together through faces.
pub fn largest_component(tets: &[[u32; 4]]) -> Vec<bool> {
    let (inner, _) = face_neighbors(tets);
    let mut parent: Vec<u32> = (0..tets.len() as u32).collect();
    let root = |parent: &mut Vec<u32>, mut t: u32| {
        while parent[t as usize] != t {
            parent[t as usize] = parent[parent[t as usize] as usize];
            t = parent[t as usize];
        }
        t
    };
    for [a, b] in inner {
        let (a, b) = (root(&mut parent, a), root(&mut parent, b));
        parent[a.max(b) as usize] = a.min(b);
    }
    let roots: Vec<u32> = (0..tets.len() as u32).map(|t| root(&mut parent, t)).collect();
    let mut sizes = vec![0usize; tets.len()];
    roots.iter().for_each(|&r| sizes[r as usize] += 1);
    let best = (0..tets.len()).rev().max_by_key(|&r| sizes[r]);
    roots.iter().map(|&r| Some(r as usize) == best).collect()
}

/// Nodes where an outer surface is not a surface: ends of edges without exactly two faces, and nodes
/// where two sheets touch. Ascending.
pub fn pinched_nodes(outer: &[OuterFace]) -> Vec<u32> {
    let mut edges: BTreeMap<[u32; 2], u32> = BTreeMap::new();
    let mut fans: BTreeMap<u32, Vec<[u32; 2]>> = BTreeMap::new();
    for face in outer {
        for n in 0..3 {
            let [a, b, c] = [n, (n + 1) % 3, (n + 2) % 3].map(|m| face.corners[m]);
            *edges.entry([a.min(b), a.max(b)]).or_default() += 1;
            fans.entry(a).or_default().push([b, c]);
        }
    }
    let ends = edges.iter().filter(|(_, count)| **count != 2).flat_map(|(edge, _)| *edge);
    let touching = fans.iter().filter(|(_, fan)| !one_loop(fan)).map(|(node, _)| *node);
    let mut nodes: Vec<u32> = ends.chain(touching).collect();
    nodes.sort_unstable();
    nodes.dedup();
    nodes
}

/// Whether the edges opposite to a node close one loop.
fn one_loop(fan: &[[u32; 2]]) -> bool {
    let mut at = fan[0][1];
    let mut steps = 1;
    while at != fan[0][0] && steps <= fan.len() {
        let Some(next) = fan.iter().find(|edge| edge[0] == at) else { return false };
        at = next[1];
        steps += 1;
    }
    steps == fan.len()
}

/// Nodes - edges + faces - tetrahedra: 1 for a ball.
pub fn euler_characteristic(tets: &[[u32; 4]]) -> i64 {
    let mut nodes: Vec<u32> = tets.iter().flatten().copied().collect();
    nodes.sort_unstable();
    nodes.dedup();
    let pairs = [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)];
    let key = |tet: &[u32; 4], (a, b): (usize, usize)| [tet[a].min(tet[b]), tet[a].max(tet[b])];
    let mut edges: Vec<[u32; 2]> =
        tets.iter().flat_map(|tet| pairs.map(|pair| key(tet, pair))).collect();
    edges.sort_unstable();
    edges.dedup();
    let (inner, outer) = face_neighbors(tets);
    let faces = inner.len() + outer.len();
    nodes.len() as i64 - edges.len() as i64 + faces as i64 - tets.len() as i64
}
