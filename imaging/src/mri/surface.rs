//! The zero level of a smooth field as a closed surface.
//!
//! Surface nets (Gibson 1998, doi:10.1007/BFb0056277): one vertex in each cell that the surface
//! passes, one quadrilateral across each edge of the grid that it crosses; then every vertex is put
//! on the zero level, unless triangles would pass through each other there.

pub mod crossings;

use mammotwin_data::{Vec3, surface::TriMesh, volume::Volume};

/// Closed, outward surface where `field` (negative inside) is zero.
///
/// What reaches the border of the grid is closed there. Each edge has exactly two triangles: where
/// the grid cannot tell whether two parts touch, they are joined. No two triangles pass through each
/// other ([`crossings`](crossings::crossings)). Empty when nothing is inside.
pub fn surface(field: &Volume<f32>) -> TriMesh {
    let mut padded = Padded::new(field);
    let cells = padded.join_touching_parts();
    let (mut net, vertex_of) = padded.vertices(&cells);
    for &n in &cells {
        for axis in 0..3 {
            padded.quad(n, axis, &vertex_of, &mut net);
        }
    }
    let centers: Vec<Vec3> = cells.iter().map(|&n| padded.center(n)).collect();
    let projected = super::smooth::project(&net, field);
    untangled(projected, [&net.points, &centers])
}

/// Takes the corners of triangles that pass through each other back, to one set of places after the
/// other, until none do. With all vertices in the middles of their cells, the last set, triangles are
/// halves of the faces between voxels, which have no more than edges in common: this comes to an end.
fn untangled(mut surface: TriMesh, back: [&[Vec3]; 2]) -> TriMesh {
    let mut taken = vec![0; surface.points.len()];
    loop {
        let pairs = crossings::crossings(&surface);
        let triangles = pairs.iter().flatten().map(|&t| surface.triangles[t as usize]);
        let mut tangled: Vec<u32> = triangles.flatten().collect();
        tangled.sort_unstable();
        tangled.dedup();
        tangled.retain(|&n| taken[n as usize] < back.len());
        if tangled.is_empty() {
            return surface;
        }
        tracing::debug!(vertices = tangled.len(), "taken back where a surface passes itself");
        for n in tangled {
            let n = n as usize;
            surface.points[n] = back[taken[n]][n];
            taken[n] += 1;
        }
    }
}

/// A field with one more layer of voxels around, outside of the body.
struct Padded<'a> {
    field: &'a Volume<f32>,
    shape: [usize; 3],
    values: Vec<f32>,
}

impl<'a> Padded<'a> {
    fn new(field: &'a Volume<f32>) -> Self {
        let shape = field.grid.shape.map(|n| n + 2);
        let outside = field.grid.spacing_mm()[0] as f32;
        let mut values = vec![outside; shape.iter().product()];
        for n in 0..field.values.len() {
            let [i, j, k] = field.grid.voxel(n);
            let at = ((k + 1) * shape[1] + j + 1) * shape[0] + i + 1;
            values[at] = field.values[n];
        }
        Self { field, shape, values }
    }

    fn steps(&self) -> [usize; 3] {
        [1, self.shape[0], self.shape[0] * self.shape[1]]
    }

    fn place(&self, n: usize) -> [usize; 3] {
        let [ni, nj, _] = self.shape;
        [n % ni, n / ni % nj, n / (ni * nj)]
    }

    fn inside(&self, n: usize) -> bool {
        self.values[n] < 0.0
    }

    /// Whether voxel `n` has a next one along the axes of `set` (bits).
    fn has_next(&self, n: usize, set: usize) -> bool {
        let place = self.place(n);
        (0..3).all(|axis| set >> axis & 1 == 0 || place[axis] + 1 < self.shape[axis])
    }

    /// Voxel `bits` of the cell, edge or face whose low corner is `n`.
    fn corner(&self, n: usize, bits: usize) -> usize {
        let step = self.steps();
        n + (0..3).filter(|axis| bits >> axis & 1 == 1).map(|axis| step[axis]).sum::<usize>()
    }

    /// Whether the surface passes the cell whose low corner is `n`.
    fn is_mixed(&self, n: usize) -> bool {
        let first = self.inside(n);
        self.has_next(n, 7) && (1..8).any(|bits| self.inside(self.corner(n, bits)) != first)
    }

    /// Low corners of the cells that the surface passes, ascending.
    fn mixed_cells(&self) -> Vec<usize> {
        let row = self.shape[0];
        let rows = self.values.len() / row;
        // Most rows are all inside or all outside, as are those beside them.
        let sign: Vec<Option<bool>> = self
            .values
            .chunks(row)
            .map(|row| row.iter().all(|v| (*v < 0.0) == (row[0] < 0.0)).then_some(row[0] < 0.0))
            .collect();
        let passed = |r: &usize| {
            let beside = [1, self.shape[1], self.shape[1] + 1].map(|step| sign.get(r + step));
            sign[*r].is_none() || beside.iter().any(|s| *s != Some(&sign[*r]))
        };
        let cells = (0..rows).filter(passed).flat_map(|r| r * row..(r + 1) * row);
        cells.filter(|&n| self.is_mixed(n)).collect()
    }

    /// Fills the outside voxel nearest to the surface wherever inside voxels touch only across the
    /// diagonal of a face or of a cell, or outside voxels do: there two sheets would share an edge
    /// or a vertex. Returns the cells that the surface then passes.
    fn join_touching_parts(&mut self) -> Vec<usize> {
        loop {
            let cells = self.mixed_cells();
            let mut fill = Vec::new();
            for &n in &cells {
                for (p, q) in [(1, 2), (2, 4), (1, 4)] {
                    let ring = [0, p, p | q, q].map(|bits| self.corner(n, bits));
                    let inside = ring.map(|m| self.inside(m));
                    if inside[0] == inside[2] && inside[1] == inside[3] && inside[0] != inside[1] {
                        fill.extend(self.nearest_outside(&ring));
                    }
                }
                let cell: [usize; 8] = std::array::from_fn(|bits| self.corner(n, bits));
                let count = cell.iter().filter(|&&m| self.inside(m)).count();
                let alike = |same: bool| {
                    (0..4).any(|bits| {
                        self.inside(cell[bits]) == same && self.inside(cell[7 - bits]) == same
                    })
                };
                if (count == 2 && alike(true)) || (count == 6 && alike(false)) {
                    fill.extend(self.nearest_outside(&cell));
                }
            }
            if fill.is_empty() {
                return cells;
            }
            for n in fill {
                self.values[n] = -f32::MIN_POSITIVE.max(1e-6 * self.values[n].abs());
            }
        }
    }

    fn nearest_outside(&self, voxels: &[usize]) -> Option<usize> {
        let outside = voxels.iter().copied().filter(|&n| !self.inside(n));
        outside.min_by(|&a, &b| self.values[a].total_cmp(&self.values[b]))
    }

    /// A vertex in each cell that the surface passes, at the mean of its crossings with the edges of
    /// the cell; and the vertex of each cell, by the cell's low corner.
    fn vertices(&self, cells: &[usize]) -> (TriMesh, Vec<u32>) {
        let step = self.steps();
        let mut surface = TriMesh::default();
        let mut vertex_of = vec![u32::MAX; self.values.len()];
        for &n in cells {
            let mut sum = Vec3::zeros();
            let mut count = 0.0;
            for edge in 0..12 {
                let (axis, side) = (edge / 4, edge % 4);
                let others = [(axis + 1) % 3, (axis + 2) % 3];
                let mut start = n;
                let mut offset = Vec3::zeros();
                for (bit, &other) in others.iter().enumerate() {
                    if side >> bit & 1 == 1 {
                        start += step[other];
                        offset[other] = 1.0;
                    }
                }
                let (a, b) = (self.values[start], self.values[start + step[axis]]);
                if (a < 0.0) != (b < 0.0) {
                    offset[axis] = f64::from(a / (a - b));
                    sum += offset;
                    count += 1.0;
                }
            }
            vertex_of[n] = surface.points.len() as u32;
            surface.points.push(self.in_cell(n, &(sum / count)));
        }
        (surface, vertex_of)
    }

    /// The middle (mm) of a cell.
    fn center(&self, n: usize) -> Vec3 {
        self.in_cell(n, &Vec3::repeat(0.5))
    }

    /// A place (mm) in a cell, given in edges from its low corner.
    fn in_cell(&self, n: usize, part: &Vec3) -> Vec3 {
        // The padding moved the origin by one voxel.
        let low = Vec3::from(self.place(n).map(|v| v as f64 - 1.0));
        self.field.grid.world(&(low + part))
    }

    /// The quadrilateral across the edge from voxel `n` along `axis`, if the surface crosses it.
    fn quad(&self, n: usize, axis: usize, vertex_of: &[u32], surface: &mut TriMesh) {
        let step = self.steps();
        if !self.has_next(n, 1 << axis) || self.inside(n) == self.inside(n + step[axis]) {
            return;
        }
        let (u, v) = (step[(axis + 1) % 3], step[(axis + 2) % 3]);
        // The padding is all outside: a crossed edge has cells all around it.
        let mut ring = [n - u - v, n - v, n, n - u].map(|cell| vertex_of[cell]);
        let flipped = self.field.grid.axes.determinant() < 0.0;
        if self.inside(n) == flipped {
            ring.reverse();
        }
        let at = |m: usize| surface.points[ring[m] as usize];
        let shorter = (at(0) - at(2)).norm_squared() <= (at(1) - at(3)).norm_squared();
        let [a, b, c, d] = ring;
        let pair = if shorter { [[a, b, c], [a, c, d]] } else { [[b, c, d], [b, d, a]] };
        surface.triangles.extend(pair);
    }
}

#[cfg(test)]
mod tests;
