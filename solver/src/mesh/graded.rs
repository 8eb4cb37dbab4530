//! The lattice with larger cells inside: an octree whose cells near surfaces are the smallest.
//!
//! Between cells of one size stand the tetrahedra of the lattice, halved where an edge has a node in its
//! middle; between cells of two sizes stand pyramids over the smaller one's face, in halves. These are
//! the four shapes of Labelle & Shewchuk 2007, doi:10.1145/1276377.1276448.

use mammotwin_data::Vec3;
use std::collections::HashMap;

/// Three numbers along the axes of the lattice.
type Place = [i64; 3];

/// Cells of several sizes: each is 1, 2, 4 ... of the smallest cells long.
pub(super) struct Octree {
    /// Smallest cells along the axes.
    shape: Place,
    /// Length of the cell that each smallest cell belongs to.
    length: Vec<u8>,
    largest: i64,
}

impl Octree {
    /// Cells up to `2^doublings` long on a box of smallest cells. `divide` says of a cell that is longer
    /// than one whether it is to be divided, by its middle (in smallest cells) and its length. Cells that
    /// touch differ by a factor of two at most.
    pub fn new(
        cells: [usize; 3],
        doublings: u32,
        divide: impl Fn(&Vec3, f64) -> bool + Sync,
    ) -> Self {
        let largest = 1i64 << doublings;
        let shape = cells.map(|n| (n as i64 + largest - 1) / largest * largest);
        let count = shape.iter().product::<i64>() as usize;
        let mut tree = Self { shape, length: vec![largest as u8; count], largest };
        let mut length = largest;
        while length > 1 {
            for low in tree.cells(length) {
                let middle = Vec3::from(low.map(|v| v as f64)).add_scalar(0.5 * length as f64);
                if divide(&middle, length as f64) {
                    tree.divide(low, length);
                }
            }
            length /= 2;
        }
        tree.balance();
        tree
    }

    fn index(&self, [i, j, k]: Place) -> usize {
        ((k * self.shape[1] + j) * self.shape[0] + i) as usize
    }

    /// Length of the cell that holds a smallest cell; `None` outside of the box.
    fn length(&self, place: Place) -> Option<i64> {
        let inside = (0..3).all(|axis| (0..self.shape[axis]).contains(&place[axis]));
        inside.then(|| i64::from(self.length[self.index(place)]))
    }

    /// Low corners of all cells of a length.
    fn cells(&self, length: i64) -> Vec<Place> {
        let [ni, nj, nk] = self.shape.map(|n| n / length);
        let place = |n: i64| [n % ni, n / ni % nj, n / ni / nj].map(|v| v * length);
        (0..ni * nj * nk).map(place).filter(|&low| self.length(low) == Some(length)).collect()
    }

    fn divide(&mut self, low: Place, length: i64) {
        for n in 0..length.pow(3) {
            let step = [n % length, n / length % length, n / length / length];
            let at = self.index([0, 1, 2].map(|axis| low[axis] + step[axis]));
            self.length[at] = (length / 2) as u8;
        }
    }

    /// Divides cells that touch others of less than half their length.
    fn balance(&mut self) {
        loop {
            let mut length = self.largest;
            let mut divided = false;
            while length > 2 {
                for low in self.cells(length) {
                    let reach = length + 2;
                    let around = (0..reach.pow(3)).any(|n| {
                        let step = [n % reach, n / reach % reach, n / reach / reach];
                        let place = [0, 1, 2].map(|axis| low[axis] + step[axis] - 1);
                        self.length(place).is_some_and(|other| 2 * other < length)
                    });
                    if around {
                        self.divide(low, length);
                        divided = true;
                    }
                }
                length /= 2;
            }
            if !divided {
                return;
            }
        }
    }

    /// Nodes (in smallest cells from the corner of the box) and positive tetrahedra between all cells.
    pub fn tets(&self) -> (Vec<Vec3>, Vec<[u32; 4]>) {
        let mut made = Made::default();
        let mut length = self.largest;
        while length > 0 {
            for low in self.cells(length) {
                for axis in 0..3 {
                    for ahead in [false, true] {
                        self.between(low, length, axis, ahead, &mut made);
                    }
                }
            }
            length /= 2;
        }
        (made.points, made.tets)
    }

    /// The tetrahedra between a cell and the one across a face, where that is as large (asked from one
    /// side only) or larger.
    fn between(&self, low: Place, length: i64, axis: usize, ahead: bool, made: &mut Made) {
        let mut across = low;
        across[axis] += if ahead { length } else { -1 };
        let Some(other) = self.length(across) else { return };
        if other < length || (other == length && !ahead) {
            return;
        }
        let across = across.map(|v| v.div_euclid(other) * other);
        // Nodes are counted in half smallest cells: middles of cells are whole there, too.
        let middle = |low: Place, length: i64| low.map(|v| 2 * v + length);
        let (here, there) = (middle(low, length), middle(across, other));
        let [u, v] = [(axis + 1) % 3, (axis + 2) % 3];
        let corner = |[a, b]: [i64; 2]| {
            let mut at = low.map(|v| 2 * v);
            at[axis] += if ahead { 2 * length } else { 0 };
            at[u] += 2 * a * length;
            at[v] += 2 * b * length;
            at
        };
        const RING: [[i64; 2]; 4] = [[0, 0], [1, 0], [1, 1], [0, 1]];
        if other > length {
            // The diagonal begins where four small faces meet, in the middle of the large one.
            let first = RING.iter().position(|&step| {
                let at = corner(step);
                at[u] == there[u] && at[v] == there[v]
            });
            let ring = [0, 1, 2, 3].map(|n| corner(RING[(first.unwrap_or(0) + n) % 4]));
            for apex in [here, there] {
                made.push([apex, ring[0], ring[1], ring[2]]);
                made.push([apex, ring[0], ring[2], ring[3]]);
            }
            return;
        }
        for side in 0..4 {
            let ends = [corner(RING[side]), corner(RING[(side + 1) % 4])];
            // Two more cells have this edge: those beyond it.
            let mut beyond = [low, across];
            let (along, step) = [(v, -1), (u, length), (v, length), (u, -1)][side];
            beyond.iter_mut().for_each(|place| place[along] += step);
            let smaller = |&place: &Place| self.length(place).is_some_and(|n| n < length);
            if beyond.iter().any(smaller) {
                let half = [0, 1, 2].map(|axis| (ends[0][axis] + ends[1][axis]) / 2);
                made.push([here, there, ends[0], half]);
                made.push([here, there, half, ends[1]]);
            } else {
                made.push([here, there, ends[0], ends[1]]);
            }
        }
    }
}

/// Nodes and tetrahedra so far.
#[derive(Default)]
struct Made {
    nodes: HashMap<Place, u32>,
    points: Vec<Vec3>,
    tets: Vec<[u32; 4]>,
}

impl Made {
    /// Adds a tetrahedron, positively oriented.
    fn push(&mut self, corners: [Place; 4]) {
        let mut tet = corners.map(|place| {
            *self.nodes.entry(place).or_insert_with(|| {
                self.points.push(Vec3::from(place.map(|v| 0.5 * v as f64)));
                self.points.len() as u32 - 1
            })
        });
        let [a, b, c, d] = tet.map(|n| self.points[n as usize]);
        if (b - a).dot(&(c - a).cross(&(d - a))) < 0.0 {
            tet.swap(2, 3);
        }
        self.tets.push(tet);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{
        quality::quality,
        topology::{euler_characteristic, face_neighbors, pinched_nodes},
    };
    use mammotwin_data::{mesh::TetMesh, surface::TriMesh};

    /// Fine on a curved sheet: all kinds of neighbours.
    fn sheet(doublings: u32) -> Octree {
        Octree::new([33, 30, 27], doublings, |p, length| {
            let height = p.z - 10.0 - 6.0 * (0.2 * p.x).sin() - 3.0 * (0.3 * p.y).cos();
            height.abs() < 1.5 * length
        })
    }

    #[test]
    fn cells_of_all_sizes_hang_together_and_fill_the_box() {
        for doublings in [1, 2] {
            let tree = sheet(doublings);
            let (points, tets) = tree.tets();
            let lengths: Vec<i64> = (0..=doublings).map(|n| 1 << n).collect();
            assert!(lengths.iter().all(|&length| !tree.cells(length).is_empty()));
            let (_, outer) = face_neighbors(&tets);
            assert!(pinched_nodes(&outer).is_empty());
            assert_eq!(euler_characteristic(&tets), 1);
            // All of the box is filled once, but the pyramids on its sides.
            let volume: f64 = tets.iter().map(|tet| TetMesh::tet_volume(&points, tet)).sum();
            let triangles = outer.iter().map(|face| face.corners).collect();
            let enclosed = TriMesh { points, triangles }.volume_mm3();
            assert!((enclosed / volume - 1.0).abs() < 1e-12);
            let side = |axis: usize| {
                let border = |low: &Place, length: i64| {
                    i64::from(low[axis] == 0) + i64::from(low[axis] + length == tree.shape[axis])
                };
                let missing: i64 = lengths
                    .iter()
                    .flat_map(|&length| {
                        tree.cells(length).into_iter().map(move |low| (low, length))
                    })
                    .map(|(low, length)| border(&low, length) * length.pow(3))
                    .sum();
                missing as f64 / 6.0
            };
            let whole = tree.shape.iter().product::<i64>() as f64;
            let missing: f64 = (0..3).map(side).sum();
            assert!((volume + missing - whole).abs() < 1e-6, "{volume} {missing} {whole}");
        }
    }

    #[test]
    fn no_tetrahedron_is_worse_than_half_a_pyramid() {
        let (points, tets) = sheet(2).tets();
        let shapes = quality(&points, &tets);
        let worst = shapes.summary.max_skewness;
        println!("worst {worst:.3}, mean {:.3}", shapes.summary.mean_skewness);
        // Half a pyramid over a square of 1, 1/2 high: V = 1/12, R = 3/4.
        let exact = 1.0 - (1.0 / 12.0) / (8.0 * 3f64.sqrt() / 27.0 * 0.75f64.powi(3));
        assert!((worst - exact).abs() < 1e-9, "{worst} {exact}");
    }

    #[test]
    fn without_doublings_it_is_the_lattice() {
        let tree = Octree::new([5, 4, 6], 0, |_, _| true);
        let (points, tets) = tree.tets();
        // Four on each face between two of the cells.
        assert_eq!(tets.len(), 4 * (4 * 4 * 6 + 5 * 3 * 6 + 5 * 4 * 5));
        assert!(
            tets.iter().all(|tet| (TetMesh::tet_volume(&points, tet) - 1.0 / 12.0).abs() < 1e-12)
        );
    }
}
