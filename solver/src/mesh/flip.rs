//! Other elements between the same nodes: edges and faces removed, short edges contracted.
//!
//! Klincsek's dynamic programme finds the best tetrahedra in place of those around an edge
//! (Klingner & Shewchuk 2007, doi:10.1007/978-3-540-75103-8_1).

use super::{clip::Draft, domain::PatchSet, quality::equivolume, topology::faces};
use mammotwin_data::Vec3;

/// Elements worse than this (1 - skewness) are operated on.
const OPERATE: f64 = 0.4;
/// Elements worse than this may be contracted or peeled off the surface.
const REMOVE: f64 = 0.3;
/// An operation must raise the worst shape by this.
const GAIN: f64 = 1e-3;
/// Largest number of nodes around an edge that is removed.
const MOST_AROUND: usize = 9;
/// Cosine between old and new outer faces that an operation may not undercut.
const FLAT: f64 = 0.85;

/// Operates once on each bad element, the worst first.
pub fn flip(draft: &mut Draft) {
    let mut surgeon = Surgeon::new(draft);
    let mut bad: Vec<(f64, u32)> = (0..)
        .zip(&surgeon.tets)
        .map(|(t, tet)| (surgeon.shape(tet), t))
        .filter(|(shape, _)| *shape < OPERATE)
        .collect();
    bad.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    for (shape, t) in bad {
        let done = !surgeon.alive[t as usize] || surgeon.remove_edge(t) || surgeon.remove_face(t);
        if !done && shape < REMOVE {
            surgeon.contract(t);
        }
    }
    let mut alive = surgeon.alive.into_iter();
    let mut tets = surgeon.tets;
    tets.retain(|_| alive.next().unwrap_or(false));
    draft.tets = tets;
}

/// The elements while they change.
struct Surgeon<'a> {
    points: &'a [Vec3],
    on: &'a [PatchSet],
    tets: Vec<[u32; 4]>,
    alive: Vec<bool>,
    around: Vec<Vec<u32>>,
}

const PAIRS: [[usize; 2]; 6] = [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]];

impl<'a> Surgeon<'a> {
    fn new(draft: &'a Draft) -> Self {
        let mut around = vec![Vec::new(); draft.points.len()];
        for (t, tet) in (0..).zip(&draft.tets) {
            tet.iter().for_each(|&n| around[n as usize].push(t));
        }
        Self {
            points: &draft.points,
            on: &draft.on,
            tets: draft.tets.clone(),
            alive: vec![true; draft.tets.len()],
            around,
        }
    }

    fn shape(&self, tet: &[u32; 4]) -> f64 {
        equivolume(&tet.map(|n| self.points[n as usize]))
    }

    fn worst(&self, tets: &[u32]) -> f64 {
        let shapes = tets.iter().map(|&t| self.shape(&self.tets[t as usize]));
        shapes.fold(f64::INFINITY, f64::min)
    }

    fn replace(&mut self, old: &[u32], new: &[[u32; 4]]) {
        for &t in old {
            self.alive[t as usize] = false;
            for n in self.tets[t as usize] {
                self.around[n as usize].retain(|&other| other != t);
            }
        }
        for tet in new {
            let t = self.tets.len() as u32;
            tet.iter().for_each(|&n| self.around[n as usize].push(t));
            self.tets.push(*tet);
            self.alive.push(true);
        }
    }

    /// Elements that have all of some nodes.
    fn sharing(&self, nodes: &[u32]) -> Vec<u32> {
        let has = |t: &&u32| nodes.iter().all(|n| self.tets[**t as usize].contains(n));
        self.around[nodes[0] as usize].iter().filter(has).copied().collect()
    }

    /// Elements around an edge and the nodes around it, in turning order.
    fn ring(&self, a: u32, b: u32) -> Option<Ring> {
        let tets = self.sharing(&[a, b]);
        let steps: Vec<[u32; 2]> =
            tets.iter().map(|&t| across(&self.tets[t as usize], a, b)).collect();
        let after = |n: u32| steps.iter().find(|step| step[0] == n).map(|step| step[1]);
        let first = steps.iter().map(|step| step[0]).find(|&n| steps.iter().all(|s| s[1] != n));
        let closed = first.is_none();
        let start = first.or(steps.first().map(|step| step[0]))?;
        let mut nodes = vec![start];
        let mut at = start;
        while let Some(next) = after(at).filter(|&n| n != start) {
            if nodes.len() > steps.len() {
                return None;
            }
            nodes.push(next);
            at = next;
        }
        // Several fans around one edge make no ring.
        let whole = nodes.len() == steps.len() + usize::from(!closed);
        whole.then_some(Ring { tets, nodes, closed })
    }

    /// Replaces the elements around one of the edges of `t` by the best ones without that edge.
    fn remove_edge(&mut self, t: u32) -> bool {
        let tet = self.tets[t as usize];
        let mut best: Option<(f64, Vec<u32>, Vec<[u32; 4]>)> = None;
        for [i, j] in PAIRS {
            let (a, b) = (tet[i], tet[j]);
            let Some(ring) = self.ring(a, b) else { continue };
            if ring.nodes.len() > MOST_AROUND || !(ring.closed || self.may_open(a, b, &ring)) {
                continue;
            }
            let old = self.worst(&ring.tets);
            let least = best.as_ref().map_or(old + GAIN, |(shape, ..)| shape.max(old + GAIN));
            let (shape, new) = self.fill(a, b, &ring.nodes);
            if shape > least {
                best = Some((shape, ring.tets, new));
            }
        }
        let Some((_, old, new)) = best else { return false };
        self.replace(&old, &new);
        true
    }

    /// Whether a surface edge may go: its outer faces lie in one patch, nearly in one plane, and the
    /// edge that takes its place is not there yet.
    fn may_open(&self, a: u32, b: u32, ring: &Ring) -> bool {
        let (Some(&first), Some(&last)) = (ring.nodes.first(), ring.nodes.last()) else {
            return false;
        };
        let set = |n: u32| self.on[n as usize];
        let common = set(a).and(set(b)).and(set(first)).and(set(last));
        if common.len() != 1 || set(a).and(set(b)) != common {
            return false;
        }
        let normal = |p: u32, q: u32, r: u32| {
            let [p, q, r] = [p, q, r].map(|n| self.points[n as usize]);
            (q - p).cross(&(r - p)).try_normalize(0.0).unwrap_or_else(Vec3::zeros)
        };
        // Outer faces, seen from outside, before and after.
        let old = [normal(b, a, first), normal(a, b, last)];
        let new = [normal(first, b, last), normal(last, a, first)];
        if old.iter().any(|m| new.iter().any(|n| m.dot(n) < FLAT)) {
            return false;
        }
        if ring.nodes.len() > 2 {
            return self.sharing(&[first, last]).is_empty();
        }
        // One element, to be peeled off: the opposite edge must be inside.
        let bad = self.worst(&ring.tets) < REMOVE;
        bad && self.ring(first, last).is_some_and(|other| other.closed)
            && [a, b].iter().all(|&n| self.around[n as usize].len() > 1)
    }

    /// The best elements between `a`, `b` and the polygon of `nodes`, without the edge.
    fn fill(&self, a: u32, b: u32, nodes: &[u32]) -> (f64, Vec<[u32; 4]>) {
        let n = nodes.len();
        let pair = |i: usize, m: usize, j: usize| {
            let [p, q, r] = [nodes[i], nodes[m], nodes[j]];
            [[p, q, r, b], [p, r, q, a]]
        };
        let mut best = [[f64::INFINITY; MOST_AROUND]; MOST_AROUND];
        let mut apex = [[0usize; MOST_AROUND]; MOST_AROUND];
        for span in 2..n {
            for i in 0..n - span {
                let j = i + span;
                best[i][j] = f64::NEG_INFINITY;
                for m in i + 1..j {
                    let mut shape = best[i][m].min(best[m][j]);
                    for tet in pair(i, m, j) {
                        if shape > best[i][j] {
                            shape = shape.min(self.shape(&tet));
                        }
                    }
                    if shape > best[i][j] {
                        (best[i][j], apex[i][j]) = (shape, m);
                    }
                }
            }
        }
        let mut tets = Vec::with_capacity(2 * n);
        let mut open = vec![(0, n - 1)];
        while let Some((i, j)) = open.pop() {
            if j > i + 1 && best[i][j] > f64::NEG_INFINITY {
                let m = apex[i][j];
                tets.extend(pair(i, m, j));
                open.extend([(i, m), (m, j)]);
            }
        }
        (best[0][n - 1], tets)
    }

    /// Replaces `t` and a neighbour by three elements around a new edge.
    fn remove_face(&mut self, t: u32) -> bool {
        let tet = self.tets[t as usize];
        let mut best: Option<(f64, [u32; 2], [[u32; 4]; 3])> = None;
        for (corner, face) in faces(&tet).iter().enumerate() {
            let pair = self.sharing(face);
            let Some(&other) = pair.iter().find(|&&other| other != t) else { continue };
            let far = self.tets[other as usize].into_iter().find(|n| !face.contains(n));
            let Some(far) = far else { continue };
            let near = tet[corner];
            if !self.sharing(&[near, far]).is_empty() {
                continue;
            }
            let [p, q, r] = *face;
            let new = [[near, p, q, far], [near, q, r, far], [near, r, p, far]];
            let shape = new.iter().map(|tet| self.shape(tet)).fold(f64::INFINITY, f64::min);
            let least = self.worst(&[t, other]) + GAIN;
            let least = best.map_or(least, |(shape, ..)| shape.max(least));
            if shape > least {
                best = Some((shape, [t, other], new));
            }
        }
        let Some((_, old, new)) = best else { return false };
        self.replace(&old, &new);
        true
    }

    /// Contracts the edge of `t` whose removal leaves the best elements.
    fn contract(&mut self, t: u32) {
        let tet = self.tets[t as usize];
        let mut best: Option<(f64, u32, Vec<[u32; 4]>)> = None;
        for [i, j] in PAIRS {
            for (gone, stays) in [(tet[i], tet[j]), (tet[j], tet[i])] {
                if !self.may_contract(gone, stays) {
                    continue;
                }
                let star = &self.around[gone as usize];
                let kept = star.iter().filter(|&&t| !self.tets[t as usize].contains(&stays));
                let new: Vec<[u32; 4]> = kept
                    .map(|&t| self.tets[t as usize].map(|n| if n == gone { stays } else { n }))
                    .collect();
                let shape = new.iter().map(|tet| self.shape(tet)).fold(f64::INFINITY, f64::min);
                let least = self.worst(star) + GAIN;
                let least = best.as_ref().map_or(least, |(shape, ..)| shape.max(least));
                if !new.is_empty() && shape > least {
                    best = Some((shape, gone, new));
                }
            }
        }
        if let Some((_, gone, new)) = best {
            let old = self.around[gone as usize].clone();
            self.replace(&old, &new);
        }
    }

    /// Whether contracting keeps the body's topology (link condition) and its surfaces.
    fn may_contract(&self, gone: u32, stays: u32) -> bool {
        let (from, to) = (self.on[gone as usize], self.on[stays as usize]);
        if !from.within(to) {
            return false;
        }
        let Some(ring) = self.ring(gone, stays) else { return false };
        // Both on the surface, but the edge inside: the body would be pinched.
        if ring.closed && !from.is_empty() {
            return false;
        }
        let mut near = self.neighbors(gone);
        let far = self.neighbors(stays);
        near.retain(|n| far.binary_search(n).is_ok());
        let mut around = ring.nodes.clone();
        around.sort_unstable();
        near == around && self.keeps_outer_faces(gone, stays)
    }

    /// Whether the outer faces at `gone` hardly turn when it moves to `stays`.
    fn keeps_outer_faces(&self, gone: u32, stays: u32) -> bool {
        if self.on[gone as usize].is_empty() {
            return true;
        }
        let normal = |face: &[u32; 3]| {
            let [p, q, r] = face.map(|n| self.points[n as usize]);
            (q - p).cross(&(r - p)).try_normalize(0.0).unwrap_or_else(Vec3::zeros)
        };
        let outer = |face: &[u32; 3]| {
            face.contains(&gone) && !face.contains(&stays) && self.sharing(face).len() == 1
        };
        self.around[gone as usize].iter().all(|&t| {
            faces(&self.tets[t as usize]).iter().filter(|face| outer(face)).all(|face| {
                let moved = face.map(|n| if n == gone { stays } else { n });
                normal(face).dot(&normal(&moved)) > FLAT
            })
        })
    }

    /// Nodes that share an element with `node`, ascending.
    fn neighbors(&self, node: u32) -> Vec<u32> {
        let corners = self.around[node as usize].iter().flat_map(|&t| self.tets[t as usize]);
        let mut nodes: Vec<u32> = corners.filter(|&n| n != node).collect();
        nodes.sort_unstable();
        nodes.dedup();
        nodes
    }
}

/// What is around an edge.
struct Ring {
    tets: Vec<u32>,
    /// In turning order; from outer face to outer face when not closed.
    nodes: Vec<u32>,
    closed: bool,
}

/// The other two nodes p, q of a tetrahedron with the edge a, b, so that (a, b, p, q) is positive.
fn across(tet: &[u32; 4], a: u32, b: u32) -> [u32; 2] {
    let place = |node: u32| tet.iter().position(|&n| n == node).unwrap_or(0);
    let (i, j) = (place(a), place(b));
    let mut others = (0..4).filter(|&n| n != i && n != j);
    let (k, l) = (others.next().unwrap_or(0), others.next().unwrap_or(0));
    // Even permutation of (0, 1, 2, 3), or not.
    let order = [i, j, k, l];
    let swaps = PAIRS.iter().filter(|[m, n]| order[*m] > order[*n]).count();
    if swaps % 2 == 0 { [tet[k], tet[l]] } else { [tet[l], tet[k]] }
}
