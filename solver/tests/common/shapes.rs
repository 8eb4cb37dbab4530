//! Meshes of simple shapes: a triangulated base in layers, and what is on their outside.

use mammotwin_data::{Vec3, labels::Tissue, mesh::Patch, mesh::TetMesh};
use std::collections::BTreeMap;

/// A mesh of `layers` layers on the triangles of a base; `place(vertex, layer)` puts the nodes.
/// The bottom is the chest wall, the top is the skin; sides are in no patch.
fn layered(
    vertices: usize,
    triangles: &[[u32; 3]],
    layers: usize,
    place: impl Fn(usize, usize) -> Vec3,
) -> TetMesh {
    let points =
        (0..=layers).flat_map(|l| (0..vertices).map(move |v| (v, l))).map(|(v, l)| place(v, l));
    let points: Vec<Vec3> = points.collect();
    let mut tets = Vec::new();
    for layer in 0..layers {
        let [low, high] = [layer, layer + 1].map(|l| (l * vertices) as u32);
        for triangle in triangles {
            // In ascending order, so that prisms cut their common sides along one diagonal.
            let mut t = *triangle;
            t.sort_unstable();
            let [a, b, c] = t;
            for tet in [
                [a + low, b + low, c + low, c + high],
                [a + low, b + low, b + high, c + high],
                [a + low, a + high, b + high, c + high],
            ] {
                let [p, q, r, s] = tet;
                let right = TetMesh::tet_volume(&points, &tet) > 0.0;
                tets.push(if right { tet } else { [p, r, q, s] });
            }
        }
    }
    let top = triangles.iter().map(|t| t.map(|v| v + (layers * vertices) as u32)).collect();
    let bottom = triangles.iter().map(|&[a, b, c]| [a, c, b]).collect();
    TetMesh {
        points,
        tissues: vec![Tissue::AdiposeRight; tets.len()],
        tets,
        patches: BTreeMap::from([(Patch::ChestWall, bottom), (Patch::Skin, top)]),
    }
}

/// A grid of `nx` by `ny` squares, `layers` thick; `place(i, j, layer)` puts the nodes.
pub fn brick([nx, ny, layers]: [usize; 3], place: impl Fn(usize, usize, usize) -> Vec3) -> TetMesh {
    let at = |i: usize, j: usize| (i * (ny + 1) + j) as u32;
    let mut triangles = Vec::new();
    for i in 0..nx {
        for j in 0..ny {
            let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            // Diagonals in turn, so that the mesh has no direction of its own.
            triangles.extend(if (i + j) % 2 == 0 {
                [[a, b, c], [a, c, d]]
            } else {
                [[a, b, d], [b, c, d]]
            });
        }
    }
    let vertices = (nx + 1) * (ny + 1);
    layered(vertices, &triangles, layers, |v, l| place(v / (ny + 1), v % (ny + 1), l))
}

/// The eighth x, y, z >= 0 of a hollow sphere, `n` elements along an edge of each eighth of a
/// surface and `layers` through the wall.
pub fn hollow_sphere(n: usize, layers: usize, inner_mm: f64, outer_mm: f64) -> TetMesh {
    let mut corners = Vec::new();
    let mut index = BTreeMap::new();
    for i in 0..=n {
        for j in 0..=n - i {
            index.insert((i, j), corners.len() as u32);
            corners.push(Vec3::new(i as f64, j as f64, (n - i - j) as f64).normalize());
        }
    }
    let mut triangles = Vec::new();
    for i in 0..n {
        for j in 0..n - i {
            let at = |i: usize, j: usize| index[&(i, j)];
            triangles.push([at(i, j), at(i + 1, j), at(i, j + 1)]);
            if i + j + 1 < n {
                triangles.push([at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)]);
            }
        }
    }
    layered(corners.len(), &triangles, layers, |v, l| {
        let part = l as f64 / layers as f64;
        corners[v] * (inner_mm + part * (outer_mm - inner_mm))
    })
}
