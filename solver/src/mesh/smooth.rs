//! Moving nodes towards better elements.

use super::{
    clip::Draft,
    domain::{Domain, project},
    quality::equivolume,
    topology::Adjacency,
};
use mammotwin_data::Vec3;

/// Moving a node to the middle of its neighbours may cost its worst element shape (1 - skewness)
/// down to this.
const GOOD: f64 = 0.6;
/// A node with a worse element than this searches for a better place.
const SEARCH: f64 = 0.4;
/// A search that gains less than this goes on with smaller steps: a node that creeps along a
/// degenerate element would not come to an end.
const LEAST_GAIN: f64 = 1e-3;

/// Visits all nodes once. No move makes the worst element around a node worse, unless it stays good
/// and the mean gets better.
pub fn smooth(draft: &mut Draft, domain: &dyn Domain, size_mm: f64) {
    let adjacency = Adjacency::new(draft.points.len(), &draft.tets);
    for node in 0..draft.points.len() {
        let star = adjacency.of(node);
        if star.is_empty() || draft.on[node].len() > 2 {
            continue;
        }
        let mut mover = Mover { draft: &mut *draft, domain, star, node, size_mm };
        let mut worst = mover.towards_middle();
        let mut step = 0.2;
        while worst < SEARCH && step > 0.02 {
            let better = mover.search(worst, step);
            if better < worst + LEAST_GAIN {
                step *= 0.4;
            }
            worst = better;
        }
    }
}

/// One node on the move.
struct Mover<'a> {
    draft: &'a mut Draft,
    domain: &'a dyn Domain,
    star: &'a [u32],
    node: usize,
    size_mm: f64,
}

impl Mover<'_> {
    /// Worst and mean shape of the elements around the node.
    fn shapes(&self) -> (f64, f64) {
        let (mut worst, mut sum) = (f64::INFINITY, 0.0);
        for &t in self.star {
            let tet = self.draft.tets[t as usize];
            let shape = equivolume(&tet.map(|n| self.draft.points[n as usize]));
            worst = worst.min(shape);
            sum += shape;
        }
        (worst, sum / self.star.len() as f64)
    }

    /// Back on the node's surfaces.
    fn settled(&self, p: &Vec3) -> Option<Vec3> {
        let set = self.draft.on[self.node];
        if set.is_empty() { Some(*p) } else { project(self.domain, p, set, 0.3 * self.size_mm) }
    }

    /// Tries the middle of the neighbours on the same surfaces; returns the worst shape then.
    fn towards_middle(&mut self) -> f64 {
        let set = self.draft.on[self.node];
        let (mut sum, mut count) = (Vec3::zeros(), 0.0);
        for &t in self.star {
            for n in self.draft.tets[t as usize].map(|n| n as usize) {
                if n != self.node && set.within(self.draft.on[n]) {
                    sum += self.draft.points[n];
                    count += 1.0;
                }
            }
        }
        let (worst, mean) = self.shapes();
        if count < 2.0 {
            return worst;
        }
        let old = self.draft.points[self.node];
        let Some(new) = self.settled(&(sum / count)) else { return worst };
        self.draft.points[self.node] = new;
        let (new_worst, new_mean) = self.shapes();
        if new_mean > mean && new_worst >= worst.min(GOOD) {
            return new_worst;
        }
        self.draft.points[self.node] = old;
        worst
    }

    /// Takes the best of some steps of `step` edge lengths; returns the worst shape then.
    fn search(&mut self, worst: f64, step: f64) -> f64 {
        let start = self.draft.points[self.node];
        let (mut best, mut place) = (worst, start);
        for direction in self.directions().into_iter().flatten() {
            for sign in [1.0, -1.0] {
                let aim = start + sign * step * self.size_mm * direction;
                let Some(new) = self.settled(&aim) else { continue };
                self.draft.points[self.node] = new;
                let (shape, _) = self.shapes();
                if shape > best {
                    (best, place) = (shape, new);
                }
            }
        }
        self.draft.points[self.node] = place;
        best
    }

    /// Directions along the node's surfaces: seven in space, four on a surface, one on a crease.
    fn directions(&self) -> [Option<Vec3>; 7] {
        let at = &self.draft.points[self.node];
        let surfaces = self.draft.on[self.node].iter();
        let normals: Vec<Vec3> = surfaces.map(|patch| self.domain.gradient(at, patch)).collect();
        let mut directions = [None; 7];
        match normals.len() {
            0 => {
                let [x, y, z] = [Vec3::x(), Vec3::y(), Vec3::z()];
                let all = [x, y, z, x + y + z, x + y - z, x - y + z, -x + y + z];
                directions = all.map(|v| Some(v.normalize()));
            }
            1 => {
                let side = if normals[0].x.abs() < 0.7 { Vec3::x() } else { Vec3::y() };
                let u = normals[0].cross(&side).try_normalize(1e-9);
                let v = u.and_then(|u| normals[0].cross(&u).try_normalize(1e-9));
                if let (Some(u), Some(v)) = (u, v) {
                    let some = [u, v, (u + v).normalize(), (u - v).normalize()];
                    directions.iter_mut().zip(some).for_each(|(slot, v)| *slot = Some(v));
                }
            }
            _ => directions[0] = normals[0].cross(&normals[1]).try_normalize(1e-9),
        }
        directions
    }
}
