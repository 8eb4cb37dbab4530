//! The body-centred cubic lattice: space filled with one well-shaped tetrahedron.
//!
//! Labelle & Shewchuk 2007, Isosurface stuffing, doi:10.1145/1276377.1276448.

use mammotwin_data::{Mat3, Vec3};
use nalgebra::Rotation3;

/// How the lattice lies in space. Meshes of one body on two placements share no node.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Placement {
    /// Rotation vector (rad).
    pub rotation: [f64; 3],
    /// Offset, in cells.
    pub offset: [f64; 3],
}

impl Default for Placement {
    /// Turned a little, so that no lattice plane lies in a cut of the body.
    fn default() -> Self {
        Self { rotation: [0.11, 0.17, 0.07], offset: [0.13, 0.29, 0.41] }
    }
}

/// A box of cells, each with a point at its low corner and one at its centre.
pub struct Lattice {
    cells: [usize; 3],
    cell_mm: f64,
    rotation: Mat3,
    origin: Vec3,
}

impl Lattice {
    /// Lattice whose tetrahedra have edges of `size_mm` on average, and that covers a box.
    pub fn covering((low, high): (Vec3, Vec3), size_mm: f64, placement: &Placement) -> Self {
        // A tetrahedron has two edges of one cell and four of √3/2 cells.
        let cell_mm = size_mm * 6.0 / (2.0 + 4.0 * 0.75f64.sqrt());
        let rotation = *Rotation3::new(Vec3::from(placement.rotation)).matrix();
        let mut first = Vec3::repeat(f64::INFINITY);
        let mut last = -first;
        for corner in 0..8 {
            let of = |axis: usize| if corner >> axis & 1 == 1 { high[axis] } else { low[axis] };
            let cells = rotation.transpose() * Vec3::from_fn(|axis, _| of(axis)) / cell_mm;
            (first, last) = (first.inf(&cells), last.sup(&cells));
        }
        let shift = Vec3::from(placement.offset).map(|offset| offset.rem_euclid(1.0));
        let start = first.map(f64::floor).add_scalar(-2.0) + shift;
        let cells = (last - start).map(|extent| extent.ceil() as usize + 2);
        Self { cells: cells.into(), cell_mm, rotation, origin: rotation * start * cell_mm }
    }

    /// Length of a cell (mm): the longer of the two edge lengths.
    pub fn cell_mm(&self) -> f64 {
        self.cell_mm
    }

    /// Points (mm): low corners of all cells, then centres of all cells.
    pub fn points(&self) -> Vec<Vec3> {
        let [ni, nj, nk] = self.cells;
        let mut points = Vec::with_capacity(2 * ni * nj * nk);
        for half in [0.0, 0.5] {
            for n in 0..ni * nj * nk {
                let cell = Vec3::new((n % ni) as f64, (n / ni % nj) as f64, (n / ni / nj) as f64);
                let at = cell.add_scalar(half) * self.cell_mm;
                points.push(self.origin + self.rotation * at);
            }
        }
        points
    }

    /// Tetrahedra that `keep` wants, positively oriented. Four stand on each face of a cell, each
    /// between an edge of the face and the centres of the two cells.
    pub fn tets(&self, keep: impl Fn(&[u32; 4]) -> bool) -> Vec<[u32; 4]> {
        let [ni, nj, nk] = self.cells;
        let corner = |[i, j, k]: [usize; 3]| ((k * nj + j) * ni + i) as u32;
        let center = |cell: [usize; 3]| corner(cell) + (ni * nj * nk) as u32;
        let mut tets = Vec::new();
        for n in 0..ni * nj * nk {
            let cell = [n % ni, n / ni % nj, n / ni / nj];
            if (0..3).any(|axis| cell[axis] == 0 || cell[axis] + 1 == self.cells[axis]) {
                continue;
            }
            for axis in 0..3 {
                let mut below = cell;
                below[axis] -= 1;
                let up = |steps: [usize; 2]| {
                    let mut at = cell;
                    at[(axis + 1) % 3] += steps[0];
                    at[(axis + 2) % 3] += steps[1];
                    corner(at)
                };
                let ring = [[0, 0], [1, 0], [1, 1], [0, 1]].map(up);
                for side in 0..4 {
                    let tet = [center(below), ring[side], ring[(side + 1) % 4], center(cell)];
                    if keep(&tet) {
                        tets.push(tet);
                    }
                }
            }
        }
        tets
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mammotwin_data::mesh::TetMesh;

    #[test]
    fn all_tetrahedra_are_positive_alike_and_fill_the_box() {
        let bounds = (Vec3::new(-20.0, -10.0, 0.0), Vec3::new(20.0, 15.0, 30.0));
        let lattice = Lattice::covering(bounds, 4.0, &Placement::default());
        let points = lattice.points();
        let tets = lattice.tets(|_| true);
        let expected = lattice.cell_mm().powi(3) / 12.0;
        let mut edges = 0.0;
        for tet in &tets {
            assert!((TetMesh::tet_volume(&points, tet) - expected).abs() < 1e-9);
            for (a, b) in [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)] {
                edges += (points[tet[a] as usize] - points[tet[b] as usize]).norm() / 6.0;
            }
        }
        assert!((edges / tets.len() as f64 - 4.0).abs() < 1e-9);
        // A point of the box is in exactly one tetrahedron: no gap, no overlap.
        for p in [bounds.0, bounds.1, Vec3::new(1.234, 5.678, 9.1011)] {
            let inside = |tet: &&[u32; 4]| {
                (0..4).all(|corner| {
                    let mut replaced = tet.map(|n| points[n as usize]);
                    replaced[corner] = p;
                    TetMesh::tet_volume(&replaced, &[0, 1, 2, 3]) > 0.0
                })
            };
            assert_eq!(tets.iter().filter(inside).count(), 1);
        }
    }
}
