//! One side of a mesh: the breast that is compressed, without the other.

use super::topology::{Adjacency, face_key, face_neighbors, largest_component, pinched_nodes};
use mammotwin_data::{
    Vec3,
    labels::Side,
    mesh::{Patch, TetMesh},
};
use std::collections::BTreeMap;

/// A part of a mesh.
#[derive(Debug, Clone, PartialEq)]
pub struct Cropped {
    /// The part; faces that were inside of the whole are in [`Patch::Medial`].
    pub mesh: TetMesh,
    /// For each node of the part, its index in the whole.
    pub nodes: Vec<u32>,
    /// For each tetrahedron of the part, its index in the whole.
    pub tets: Vec<u32>,
}

impl Cropped {
    /// Values of the whole's nodes, for the nodes of the part.
    pub fn take<T: Copy>(&self, of_whole: &[T]) -> Vec<T> {
        self.nodes.iter().map(|&n| of_whole[n as usize]).collect()
    }
}

/// Tetrahedra whose centroid is on `side` of the sternal plane x = `sternum_mm`, and those less than
/// `margin_mm` beyond it. Of several parts that do not hang together, the largest. Where the cut
/// would touch itself at a node or an edge, all tetrahedra around it stay.
pub fn crop(mesh: &TetMesh, side: Side, sternum_mm: f64, margin_mm: f64) -> Cropped {
    let centroid_x =
        |tet: &[u32; 4]| tet.iter().map(|&n| mesh.points[n as usize].x).sum::<f64>() / 4.0;
    let keep = |tet: &[u32; 4]| side.sign() * (centroid_x(tet) - sternum_mm) > -margin_mm;
    let mut kept: Vec<u32> =
        (0..mesh.tets.len() as u32).filter(|&t| keep(&mesh.tets[t as usize])).collect();
    let corners = |kept: &[u32]| kept.iter().map(|&t| mesh.tets[t as usize]).collect::<Vec<_>>();
    let mut largest = largest_component(&corners(&kept)).into_iter();
    kept.retain(|_| largest.next().unwrap_or(false));
    let adjacency = Adjacency::new(mesh.points.len(), &mesh.tets);
    loop {
        let before = kept.len();
        let pinched = pinched_nodes(&face_neighbors(&corners(&kept)).1);
        kept.extend(pinched.iter().flat_map(|&n| adjacency.of(n as usize)));
        kept.sort_unstable();
        kept.dedup();
        if kept.len() == before {
            return part(mesh, kept);
        }
    }
}

/// The given tetrahedra of a mesh, with patches of their own.
fn part(mesh: &TetMesh, kept: Vec<u32>) -> Cropped {
    let mut new = vec![u32::MAX; mesh.points.len()];
    kept.iter().flat_map(|&t| mesh.tets[t as usize]).for_each(|n| new[n as usize] = 0);
    let nodes: Vec<u32> = (0..new.len() as u32).filter(|&n| new[n as usize] == 0).collect();
    nodes.iter().zip(0..).for_each(|(&n, to)| new[n as usize] = to);

    let mut patch_of = BTreeMap::new();
    for (&patch, faces) in &mesh.patches {
        patch_of.extend(faces.iter().map(|face| (face_key(face), patch)));
    }
    let renamed = |n: u32| new[n as usize];
    let tets: Vec<[u32; 4]> = kept.iter().map(|&t| mesh.tets[t as usize].map(renamed)).collect();
    let mut patches: BTreeMap<Patch, Vec<[u32; 3]>> = BTreeMap::new();
    for face in face_neighbors(&tets).1 {
        let before = face_key(&face.corners.map(|n| nodes[n as usize]));
        let patch = patch_of.get(&before).copied().unwrap_or(Patch::Medial);
        patches.entry(patch).or_default().push(face.corners);
    }
    let points: Vec<Vec3> = nodes.iter().map(|&n| mesh.points[n as usize]).collect();
    let tissues = kept.iter().map(|&t| mesh.tissues[t as usize]).collect();
    Cropped { mesh: TetMesh { points, tets, tissues, patches }, nodes, tets: kept }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{
        bodies::Torso,
        tetrahedralize::{Meshing, tetrahedralize},
        topology::euler_characteristic,
    };
    use mammotwin_data::labels::Tissue;

    #[test]
    fn the_sides_make_up_the_whole() {
        let tissue = |p: &Vec3| if p.x > 0.0 { Tissue::AdiposeRight } else { Tissue::AdiposeLeft };
        let whole = tetrahedralize(&Torso::small(), &Meshing::of_size(10.0), tissue).unwrap();
        let right = crop(&whole, Side::Right, 0.0, 0.0);
        let left = crop(&whole, Side::Left, 0.0, 0.0);
        let of_left = |t: &&u32| whole.tissues[**t as usize] == Tissue::AdiposeLeft;
        assert_eq!(
            left.tets.iter().filter(of_left).count(),
            whole.tissues.iter().filter(|&&t| t == Tissue::AdiposeLeft).count()
        );
        let twice = right.tets.len() + left.tets.len() - whole.tets.len();
        assert!(twice < 20, "{twice} tetrahedra kept where the cut would touch itself");
        let edges = whole.tets.iter().flat_map(|&[a, b, c, d]| {
            [[a, b], [a, c], [a, d], [b, c], [b, d], [c, d]]
                .map(|e| e.map(|n| whole.points[n as usize]))
        });
        let longest = edges.map(|[a, b]| (a - b).norm()).fold(0.0, f64::max);
        for half in [&right, &left] {
            assert_eq!(half.take(&whole.points), half.mesh.points);
            assert_eq!(euler_characteristic(&half.mesh.tets), 1);
            let (_, outer) = face_neighbors(&half.mesh.tets);
            assert!(pinched_nodes(&outer).is_empty());
            let outside: f64 = half.mesh.outer_surface().volume_mm3();
            assert!((outside / half.mesh.volume_mm3() - 1.0).abs() < 1e-9);
            // A corner lies up to three quarters of an edge beyond the centroid; what stays where the
            // cut would touch itself, an edge more.
            let medial = half.mesh.patch_nodes(Patch::Medial);
            let beyond = medial.iter().map(|&n| half.mesh.points[n as usize].x.abs());
            let farthest = beyond.fold(0.0, f64::max);
            assert!(farthest < 1.75 * longest, "{farthest} mm, edges up to {longest} mm");
        }
        assert!(right.mesh.patch(Patch::LateralLeft).is_empty());
        assert_eq!(
            right.mesh.patch(Patch::LateralRight).len(),
            whole.patch(Patch::LateralRight).len()
        );
    }

    #[test]
    fn a_margin_keeps_more() {
        let whole =
            tetrahedralize(&Torso::small(), &Meshing::of_size(12.0), |_| Tissue::Skin).unwrap();
        let least = crop(&whole, Side::Left, 0.0, 0.0);
        let more = crop(&whole, Side::Left, 0.0, 20.0);
        assert!(more.tets.len() > least.tets.len());
        assert!(least.tets.iter().all(|t| more.tets.contains(t)));
    }
}
