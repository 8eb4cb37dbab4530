//! Where a surface passes through itself.

use mammotwin_data::{Vec3, surface::TriMesh};
use parry3d_f64::{
    bounding_volume::Aabb,
    math::Vector,
    partitioning::{Bvh, BvhBuildStrategy},
};
use rayon::prelude::*;

/// Pairs of triangles that pass through each other, ascending; the lower index first.
///
/// Triangles with a common corner may touch there, those with a common edge all along it: only a
/// passage elsewhere counts. Touching without a passage does not: of two triangles in one plane none
/// passes through the other. Points must be finite.
pub fn crossings(surface: &TriMesh) -> Vec<[u32; 2]> {
    let vector = |p: Vec3| Vector::new(p.x, p.y, p.z);
    let of = |t: usize| {
        let [a, b, c] = surface.corners(t);
        Aabb::new(vector(a.inf(&b).inf(&c)), vector(a.sup(&b).sup(&c)))
    };
    let boxes: Vec<Aabb> = (0..surface.triangles.len()).map(of).collect();
    let tree = Bvh::from_leaves(BvhBuildStrategy::default(), &boxes);
    let pairs = |t: usize| -> Vec<[u32; 2]> {
        let others = tree.intersect_aabb(&boxes[t]).filter(|&other| other as usize > t);
        let mut found: Vec<[u32; 2]> = others
            .filter(|&other| cross(surface, t, other as usize))
            .map(|other| [t as u32, other])
            .collect();
        found.sort_unstable();
        found
    };
    (0..boxes.len()).into_par_iter().flat_map_iter(pairs).collect()
}

/// Whether an edge of one triangle passes through the inside of the other. Edges that have a corner
/// in common with it end on it and do not pass.
fn cross(surface: &TriMesh, a: usize, b: usize) -> bool {
    let pierces = |from: usize, into: usize| {
        let (edges, face) = (surface.triangles[from], surface.triangles[into]);
        [[0, 1], [1, 2], [2, 0]].iter().map(|edge| edge.map(|n: usize| edges[n])).any(|edge| {
            edge.iter().all(|n| !face.contains(n))
                && passes(edge.map(|n| surface.points[n as usize]), &surface.corners(into))
        })
    };
    pierces(a, b) || pierces(b, a)
}

/// Whether a segment passes through the inside of a triangle.
fn passes([p, q]: [Vec3; 2], [a, b, c]: &[Vec3; 3]) -> bool {
    // Six times the volume of a tetrahedron: its sign is the side.
    let side = |a: &Vec3, b: &Vec3, c: &Vec3, d: &Vec3| (b - a).cross(&(c - a)).dot(&(d - a));
    if side(a, b, c, &p) * side(a, b, c, &q) >= 0.0 {
        return false;
    }
    let around = [side(&p, &q, a, b), side(&p, &q, b, c), side(&p, &q, c, a)];
    around.iter().all(|&v| v > 0.0) || around.iter().all(|&v| v < 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    fn soup(corners: &[[f64; 3]], triangles: &[[u32; 3]]) -> TriMesh {
        let points = corners.iter().map(|&p| Vec3::from(p)).collect();
        TriMesh { points, triangles: triangles.to_vec() }
    }

    #[test]
    fn a_passage_counts_and_a_touch_does_not() {
        let floor = [[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [0.0, 4.0, 0.0]];
        let with = |other: [[f64; 3]; 3]| {
            let surface = soup(&[floor, other].concat(), &[[0, 1, 2], [3, 4, 5]]);
            crossings(&surface).len()
        };
        // An edge through the inside, then only its end on it, then beside it, then in its plane.
        assert_eq!(with([[1.0, 1.0, -1.0], [1.0, 1.0, 1.0], [9.0, 9.0, 0.5]]), 1);
        assert_eq!(with([[1.0, 1.0, 0.0], [1.0, 1.0, 1.0], [9.0, 9.0, 0.5]]), 0);
        assert_eq!(with([[3.0, 3.0, -1.0], [3.0, 3.0, 1.0], [9.0, 9.0, 0.5]]), 0);
        assert_eq!(with([[1.0, 1.0, 0.0], [2.0, 1.0, 0.0], [1.0, 2.0, 0.0]]), 0);
        // The floor's edges through the inside of the other.
        assert_eq!(with([[-9.0, 1.0, -9.0], [9.0, 1.0, -9.0], [0.0, 1.0, 9.0]]), 1);
    }

    #[test]
    fn triangles_of_one_corner_may_pass_elsewhere() {
        let points =
            [[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [0.0, 4.0, 0.0], [2.0, 2.0, -1.0], [1.0, 1.0, 1.0]];
        assert_eq!(crossings(&soup(&points, &[[0, 1, 2], [0, 3, 4]])), [[0, 1]]);
        let mut beside = points;
        beside[3] = [-1.0, -1.0, -1.0];
        assert!(crossings(&soup(&beside, &[[0, 1, 2], [0, 3, 4]])).is_empty());
        // A common edge, folded to a sharp angle.
        let mut folded = points;
        folded[3] = [1.0, 1.0, 0.01];
        assert!(crossings(&soup(&folded, &[[0, 1, 2], [1, 0, 3]])).is_empty());
    }

    /// Against the plain search over all pairs, by the line in which two planes meet (Möller 1997,
    /// doi:10.1080/10867651.1997.10487472).
    #[test]
    fn a_random_soup_agrees_with_another_method() {
        let mut rng = ChaCha8Rng::seed_from_u64(4);
        let corner = |_| std::array::from_fn(|_| rng.random_range(-1.0..1.0));
        let points: Vec<[f64; 3]> = (0..240).map(corner).collect();
        let triangles: Vec<[u32; 3]> = (0..80).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
        let surface = soup(&points, &triangles);
        let mut expected = Vec::new();
        for a in 0..80 {
            for b in a + 1..80 {
                if by_intervals(&surface.corners(a), &surface.corners(b)) {
                    expected.push([a as u32, b as u32]);
                }
            }
        }
        assert!(expected.len() > 100, "{}", expected.len());
        assert_eq!(crossings(&surface), expected);
    }

    fn by_intervals(one: &[Vec3; 3], two: &[Vec3; 3]) -> bool {
        let normal = |t: &[Vec3; 3]| (t[1] - t[0]).cross(&(t[2] - t[0]));
        let line = normal(one).cross(&normal(two));
        let interval = |t: &[Vec3; 3], plane: &[Vec3; 3]| {
            let height = t.map(|p| normal(plane).dot(&(p - plane[0])));
            let mut ends = Vec::new();
            for [i, j] in [[0, 1], [1, 2], [2, 0]] {
                if height[i] * height[j] < 0.0 {
                    let part = height[i] / (height[i] - height[j]);
                    ends.push(line.dot(&t[i].lerp(&t[j], part)));
                }
            }
            (ends.len() == 2).then(|| [ends[0].min(ends[1]), ends[0].max(ends[1])])
        };
        match (interval(one, two), interval(two, one)) {
            (Some(a), Some(b)) => a[0] < b[1] && b[0] < a[1],
            _ => false,
        }
    }
}
