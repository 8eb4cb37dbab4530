//! Carries material points between the stress-free and the deformed body.

use super::{field::Field, torso::Limits};
use mammotwin_data::{Mat3, Vec3};

/// The same tetrahedra in two shapes.
#[derive(Debug, Clone, Copy)]
pub struct Shapes<'a> {
    /// Node indices.
    pub tets: &'a [[u32; 4]],
    /// Nodes of the stress-free body (mm).
    pub rest: &'a [Vec3],
    /// Nodes of the deformed body (mm).
    pub deformed: &'a [Vec3],
}

/// Barycentric coordinates in one tetrahedron.
struct Barycentric {
    first: Vec3,
    /// Rows: gradients of the coordinates of the second to fourth node (1/mm).
    inverse: Mat3,
    /// Height over the opposite face (mm) of each node.
    heights: [f64; 4],
}

impl Barycentric {
    fn of(points: &[Vec3], tet: &[u32; 4]) -> Option<Self> {
        let [a, b, c, d] = tet.map(|n| points[n as usize]);
        let inverse = Mat3::from_columns(&[b - a, c - a, d - a]).try_inverse()?;
        let rows = [0, 1, 2].map(|r| inverse.row(r).transpose());
        let all = [-(rows[0] + rows[1] + rows[2]), rows[0], rows[1], rows[2]];
        Some(Self { first: a, inverse, heights: all.map(|g| 1.0 / g.norm()) })
    }

    fn at(&self, p: &Vec3) -> [f64; 4] {
        let l = self.inverse * (p - self.first);
        [1.0 - l.x - l.y - l.z, l.x, l.y, l.z]
    }

    /// How far a place is outside (mm): the largest distance behind a face, negative inside.
    fn outside(&self, coordinates: &[f64; 4]) -> f64 {
        (0..4).map(|n| -coordinates[n] * self.heights[n]).fold(f64::MIN, f64::max)
    }
}

fn mix(points: &[Vec3], tet: &[u32; 4], weights: &[f64; 4]) -> Vec3 {
    tet.iter().zip(weights).map(|(&n, w)| points[n as usize] * *w).sum()
}

impl Shapes<'_> {
    /// Where a stress-free place goes. A place outside of the body follows the nearest
    /// tetrahedron.
    pub fn forward(&self, p: &Vec3) -> Vec3 {
        let mut best = (f64::MAX, *p);
        for tet in self.tets {
            let Some(inside) = Barycentric::of(self.rest, tet) else { continue };
            let coordinates = inside.at(p);
            let outside = inside.outside(&coordinates);
            if outside < best.0 {
                best = (outside, mix(self.deformed, tet, &coordinates));
            }
        }
        best.1
    }

    /// The displacement (mm) from a place of the deformed body back to its stress-free place, on
    /// a lattice over the box from `low` to `high`.
    ///
    /// Within two steps of the body each lattice point follows the nearest tetrahedron. Farther
    /// away the displacement is continued: in the air as it is, so that nothing of the body
    /// appears there twice; beyond the breast limits, in tissue that the mesh does not hold,
    /// fading over [`FADE_MM`].
    pub fn backward(&self, low: Vec3, high: Vec3, step_mm: f64, limits: &Limits) -> Field {
        let mut field = Field::still(low, high, step_mm);
        let reach = 2.0 * step_mm;
        let mut outside = vec![f32::INFINITY; field.len()];
        for tet in self.tets {
            let Some(inside) = Barycentric::of(self.deformed, tet) else { continue };
            let corners = tet.map(|n| self.deformed[n as usize]);
            let (mut least, mut most) = (corners[0], corners[0]);
            for corner in &corners {
                (least, most) = (least.inf(corner), most.sup(corner));
            }
            let grown = [least.add_scalar(-reach), most.add_scalar(reach)];
            for n in field.points_within(&grown[0], &grown[1]) {
                let place = field.place(n);
                let coordinates = inside.at(&place);
                let here = inside.outside(&coordinates) as f32;
                if here < outside[n] && f64::from(here) < reach {
                    outside[n] = here;
                    field.set(n, &(mix(self.rest, tet, &coordinates) - place));
                }
            }
        }
        let known = outside.iter().map(|v| v.is_finite()).collect();
        continue_outward(&mut field, known, step_mm, limits);
        field
    }
}

/// Distance (mm) over which displacements fade beyond the breast limits.
const FADE_MM: f64 = 30.0;

/// Layer after layer, unknown lattice points take the mean of their known neighbours.
fn continue_outward(field: &mut Field, mut known: Vec<bool>, step_mm: f64, limits: &Limits) {
    let mut front: Vec<usize> = (0..field.len()).filter(|&n| known[n]).collect();
    let mut layer = 0;
    while !front.is_empty() {
        layer += 1;
        let gone = f64::from(layer) * step_mm / FADE_MM;
        let before = ((f64::from(layer) - 1.0) * step_mm / FADE_MM).min(1.0);
        let fade = if gone < 1.0 { (1.0 - gone) / (1.0 - before) } else { 0.0 };
        let mut next: Vec<usize> =
            front.iter().flat_map(|&n| field.neighbors(n)).filter(|&n| !known[n]).collect();
        next.sort_unstable();
        next.dedup();
        let values: Vec<Vec3> = next
            .iter()
            .map(|&n| {
                let (sum, count) = field
                    .neighbors(n)
                    .filter(|&m| known[m])
                    .fold((Vec3::zeros(), 0.0), |(sum, count), m| {
                        (sum + field.get(m), count + 1.0)
                    });
                let keep = if limits.contain(&field.place(n)) { 1.0 } else { fade };
                sum * (keep / f64::max(count, 1.0))
            })
            .collect();
        for (&n, value) in next.iter().zip(&values) {
            field.set(n, value);
            known[n] = true;
        }
        front = next;
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// A box of tetrahedra of 32 mm, sheared and stretched, and the gradient.
    pub(crate) fn block() -> (Vec<[u32; 4]>, Vec<Vec3>, Vec<Vec3>, Mat3) {
        let n = 5;
        let at = |i: usize, j: usize, k: usize| ((k * n + j) * n + i) as u32;
        let mut rest = Vec::new();
        for k in 0..n {
            for j in 0..n {
                for i in 0..n {
                    rest.push(8.0 * Vec3::new(i as f64, j as f64, k as f64));
                }
            }
        }
        let mut tets = Vec::new();
        // Kuhn's six tetrahedra around the diagonal of each cube.
        let paths = [[0, 1, 2], [1, 2, 0], [2, 0, 1], [0, 2, 1], [2, 1, 0], [1, 0, 2]];
        for k in 0..n - 1 {
            for j in 0..n - 1 {
                for i in 0..n - 1 {
                    for (p, path) in paths.iter().enumerate() {
                        let mut corner = [i, j, k];
                        let mut tet = vec![at(corner[0], corner[1], corner[2])];
                        for &axis in path {
                            corner[axis] += 1;
                            tet.push(at(corner[0], corner[1], corner[2]));
                        }
                        if p >= 3 {
                            tet.swap(2, 3);
                        }
                        tets.push([tet[0], tet[1], tet[2], tet[3]]);
                    }
                }
            }
        }
        let gradient = Mat3::new(1.2, 0.3, 0.0, -0.1, 0.8, 0.1, 0.0, 0.2, 1.1);
        let shift = Vec3::new(3.0, -2.0, 1.0);
        let deformed = rest.iter().map(|p| gradient * p + shift).collect();
        (tets, rest, deformed, gradient)
    }

    #[test]
    fn an_affine_motion_is_undone_exactly_in_and_near_the_body() {
        let (tets, rest, deformed, gradient) = block();
        let shapes = Shapes { tets: &tets, rest: &rest, deformed: &deformed };
        let limits = Limits { least_y_mm: -500.0, least_z_mm: -500.0, greatest_z_mm: 500.0 };
        let (low, high) = (Vec3::repeat(-40.0), Vec3::repeat(80.0));
        let field = shapes.backward(low, high, 2.5, &limits);
        for p in [Vec3::new(1.0, 16.0, 30.0), Vec3::new(17.1, 11.3, 2.2), Vec3::new(31.9, 0.1, 9.0)]
        {
            let moved = shapes.forward(&p);
            assert!((moved - (gradient * p + Vec3::new(3.0, -2.0, 1.0))).norm() < 1e-9);
            assert!((moved + field.at(&moved) - p).norm() < 1e-4, "{p}");
        }
    }

    #[test]
    fn displacements_fade_beyond_the_limits_and_stay_in_the_air() {
        let (tets, rest, _, _) = block();
        let deformed: Vec<Vec3> = rest.iter().map(|p| p + Vec3::new(0.0, -6.0, 0.0)).collect();
        let shapes = Shapes { tets: &tets, rest: &rest, deformed: &deformed };
        let limits = Limits { least_y_mm: -500.0, least_z_mm: -500.0, greatest_z_mm: 32.0 };
        let field = shapes.backward(Vec3::repeat(-60.0), Vec3::repeat(120.0), 2.5, &limits);
        let back = Vec3::new(0.0, 6.0, 0.0);
        assert!((field.at(&Vec3::new(16.0, 80.0, 16.0)) - back).norm() < 1e-4);
        assert!(field.at(&Vec3::new(16.0, 10.0, 100.0)).norm() < 1e-6);
        let half_way = field.at(&Vec3::new(16.0, 10.0, 32.0 + 20.0)).norm();
        assert!(half_way > 0.5 && half_way < 5.5, "{half_way}");
    }
}
