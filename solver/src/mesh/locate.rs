//! Which tetrahedron holds a point, and where in it.

use mammotwin_data::Vec3;

/// A tetrahedron and barycentric weights of its corners.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Location {
    /// Index of the tetrahedron.
    pub tet: u32,
    /// Weights of its corners: not negative up to rounding, sum 1.
    pub weights: [f64; 4],
}

impl Location {
    /// Value at the point of a field on the nodes: a position in another configuration, say.
    pub fn interpolate(&self, tets: &[[u32; 4]], of_nodes: &[Vec3]) -> Vec3 {
        let corners = tets[self.tet as usize].iter().zip(self.weights);
        corners.map(|(&n, weight)| weight * of_nodes[n as usize]).sum()
    }
}

/// Finds tetrahedra through a grid of bins. Keeps a copy of what it needs of the mesh.
pub struct Locator {
    low: Vec3,
    bin_mm: f64,
    shape: [usize; 3],
    /// Tetrahedra whose box meets each bin.
    starts: Vec<u32>,
    tets: Vec<u32>,
    /// Last corner, and the inverse of the matrix of the edges from it to the others.
    frames: Vec<(Vec3, [Vec3; 3])>,
}

/// Weight that a point just outside may lack: neighbours overlap by rounding, gaps do not open.
const SLACK: f64 = 1e-9;

impl Locator {
    /// For the tetrahedra with their nodes at `points`: of the mesh, or of a deformed state.
    /// Flat or inverted tetrahedra hold no point.
    pub fn new(points: &[Vec3], tets: &[[u32; 4]]) -> Self {
        let boxes: Vec<(Vec3, Vec3)> = tets.iter().map(|tet| tet_box(points, tet)).collect();
        let none = (Vec3::repeat(f64::INFINITY), Vec3::repeat(f64::NEG_INFINITY));
        let (low, high) = boxes.iter().fold(none, |(a, b), (c, d)| (a.inf(c), b.sup(d)));
        let finite = (high - low).iter().all(|v| v.is_finite());
        let (low, extent) = if finite { (low, high - low) } else { (Vec3::zeros(), Vec3::zeros()) };
        // Bins as large as an average box.
        let mean = boxes.iter().map(|(a, b)| (b - a).sum() / 3.0).sum::<f64>();
        let mean = mean / boxes.len().max(1) as f64;
        let bin_mm = if finite && mean > 0.0 { mean.max(extent.max() / 400.0) } else { 1.0 };
        let shape = extent.map(|v| (v / bin_mm) as usize + 1).into();
        let mut locator = Self {
            low,
            bin_mm,
            shape,
            starts: vec![0; shape.iter().product::<usize>() + 1],
            tets: Vec::new(),
            frames: tets.iter().map(|tet| frame(points, tet)).collect(),
        };
        if finite {
            locator.fill(&boxes);
        }
        locator
    }

    fn fill(&mut self, boxes: &[(Vec3, Vec3)]) {
        for (low, high) in boxes {
            self.for_bins(low, high, |starts, bin| starts[bin + 1] += 1);
        }
        for bin in 1..self.starts.len() {
            self.starts[bin] += self.starts[bin - 1];
        }
        let mut next = self.starts.clone();
        let mut tets = vec![0; self.starts[self.starts.len() - 1] as usize];
        for (t, (low, high)) in (0..).zip(boxes) {
            self.for_bins(low, high, |_, bin| {
                tets[next[bin] as usize] = t;
                next[bin] += 1;
            });
        }
        self.tets = tets;
    }

    fn for_bins(&mut self, low: &Vec3, high: &Vec3, mut visit: impl FnMut(&mut [u32], usize)) {
        let place = |p: &Vec3, axis: usize| {
            (((p[axis] - self.low[axis]) / self.bin_mm) as usize).min(self.shape[axis] - 1)
        };
        let [i, j, k] = [0, 1, 2].map(|axis| place(low, axis)..=place(high, axis));
        let [ni, nj, _] = self.shape;
        for k in k {
            for j in j.clone() {
                for i in i.clone() {
                    visit(&mut self.starts, (k * nj + j) * ni + i);
                }
            }
        }
    }

    /// The tetrahedron that holds `p`; of several (a shared face), the one it is deepest in. `None`
    /// outside of the mesh.
    pub fn find(&self, p: &Vec3) -> Option<Location> {
        let mut bin = 0;
        for axis in [2, 1, 0] {
            let place = (p[axis] - self.low[axis]) / self.bin_mm;
            if !(place >= -1e-6 && place < self.shape[axis] as f64) {
                return None;
            }
            bin = bin * self.shape[axis] + place as usize;
        }
        let held = &self.tets[self.starts[bin] as usize..self.starts[bin + 1] as usize];
        let mut best: Option<(f64, Location)> = None;
        for &tet in held {
            let (corner, rows) = &self.frames[tet as usize];
            let q = p - corner;
            let [a, b, c] = [rows[0].dot(&q), rows[1].dot(&q), rows[2].dot(&q)];
            let weights = [a, b, c, 1.0 - a - b - c];
            let least = weights.iter().copied().fold(f64::INFINITY, f64::min);
            if least >= -SLACK && best.is_none_or(|(depth, _)| least > depth) {
                best = Some((least, Location { tet, weights }));
                if least > SLACK {
                    break;
                }
            }
        }
        best.map(|(_, location)| location)
    }
}

fn tet_box(points: &[Vec3], tet: &[u32; 4]) -> (Vec3, Vec3) {
    let [a, b, c, d] = tet.map(|n| points[n as usize]);
    (a.inf(&b).inf(&c).inf(&d), a.sup(&b).sup(&c).sup(&d))
}

fn frame(points: &[Vec3], tet: &[u32; 4]) -> (Vec3, [Vec3; 3]) {
    let [a, b, c, d] = tet.map(|n| points[n as usize]);
    let (u, v, w) = (a - d, b - d, c - d);
    let volume6 = u.dot(&v.cross(&w));
    // An orientation as in TetMesh makes this negative, since the corner is the last.
    let scale = if volume6 < 0.0 { 1.0 / volume6 } else { f64::NAN };
    (d, [v.cross(&w) * scale, w.cross(&u) * scale, u.cross(&v) * scale])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{
        bodies::{Mound, Torso},
        domain::Domain,
        tetrahedralize::{Meshing, tetrahedralize},
    };
    use mammotwin_data::labels::Tissue;
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    #[test]
    fn points_of_tetrahedra_are_found_with_their_weights() {
        let mesh = tetrahedralize(&Mound, &Meshing::of_size(8.0), |_| Tissue::Skin).unwrap();
        let locator = Locator::new(&mesh.points, &mesh.tets);
        let mut rng = ChaCha8Rng::seed_from_u64(11);
        for tet in 0..mesh.tets.len() as u32 {
            let raw: [f64; 4] = std::array::from_fn(|_| 0.01 + rng.random::<f64>());
            let sum: f64 = raw.iter().sum();
            let made = Location { tet, weights: raw.map(|w| w / sum) };
            let p = made.interpolate(&mesh.tets, &mesh.points);
            let found = locator.find(&p).unwrap();
            assert_eq!(found.tet, tet);
            assert!(found.weights.iter().zip(made.weights).all(|(a, b)| (a - b).abs() < 1e-9));
        }
        for p in &mesh.points {
            let found = locator.find(p).expect("a node is in the mesh");
            assert!((found.interpolate(&mesh.tets, &mesh.points) - p).norm() < 1e-9);
        }
    }

    #[test]
    fn inside_and_outside_agree_with_the_domain_on_a_deformed_torso() {
        let body = Torso::small();
        let mesh = tetrahedralize(&body, &Meshing::of_size(10.0), |_| Tissue::Skin).unwrap();
        let deform = |p: &Vec3| Vec3::new(p.x + 0.2 * p.y, p.y - 0.1 * p.z, 1.1 * p.z);
        let deformed: Vec<Vec3> = mesh.points.iter().map(deform).collect();
        let locator = Locator::new(&deformed, &mesh.tets);
        let (low, high) = body.bounds();
        let mut rng = ChaCha8Rng::seed_from_u64(12);
        let mut inside = 0;
        for _ in 0..20_000 {
            let p = low + (high - low).map(|v| v * rng.random::<f64>());
            let depth = body.distances(&p).max();
            let found = locator.find(&deform(&p));
            if depth.abs() > 2.0 {
                assert_eq!(found.is_some(), depth < 0.0, "{p:?}");
            }
            if let Some(location) = found {
                // The deformation is linear: interpolation in the tetrahedron undoes it.
                assert!((location.interpolate(&mesh.tets, &mesh.points) - p).norm() < 1e-9);
                inside += 1;
            }
        }
        assert!(inside > 1000);
        assert_eq!(locator.find(&Vec3::repeat(f64::NAN)), None);
        assert_eq!(Locator::new(&[], &[]).find(&Vec3::zeros()), None);
    }
}
