//! The front that a surface glides on, and which of its faces bear a point.
//!
//! The front is smooth where the body rests, and made of flat pieces where it is deformed: where two of them meet in a
//! valley each presses a point across the edge. The point then rests on the edge, borne by both. Their shares are found
//! from one minimisation to the next: the face that the point is found over gains, half as much where it is another one
//! than before, more where it is the same. So may three faces bear a point at a node.

use crate::model::ModelError;
use crate::terms::target::Target;
use mammotwin_data::{Mat3, Vec3};
use std::collections::BTreeMap;
use std::sync::Arc;

/// Barycentric coordinate on a face of the front down to which a point stays with it: less would send points on an edge
/// to and fro.
const STAYS: f64 = -0.05;
/// The same down to which faces that share a point keep it.
const LEFT: f64 = -0.5;
/// The same down to which a minimisation may lead it.
const AWAY: f64 = -1.0;
/// Most faces that a point crosses on the way to its own.
const LONGEST_WAY: usize = 100;
/// Most faces that bear one point.
pub(super) const MOST_FACES: usize = 3;
/// A point that has come back so often is borne by both faces.
const RETURNS: u8 = 2;
/// Least share of a face, and least change of shares.
const LEAST_SHARE: f64 = 0.1;
const LEAST_GAIN: f64 = 1.0 / 64.0;
/// How much more a face gains that gains again.
const GROWS: f64 = 1.5;

/// The front of a body, where it is smooth.
pub struct Front {
    pub(super) target: Arc<dyn Target>,
    /// Places of all nodes (mm) there.
    pub(super) places: Vec<Vec3>,
    /// Tetrahedra with a face on the front: its three nodes first.
    pub(super) tets: Vec<[u32; 4]>,
    /// Across the edge opposite of each node of the face.
    next: Vec<[Option<u32>; 3]>,
}

impl Front {
    /// The front with `faces`, each a face of one of `tets`, of a body with its nodes at `places` (mm);
    /// `target` is its smooth surface there.
    ///
    /// # Errors
    /// A face of no tetrahedron.
    pub fn new(
        target: Arc<dyn Target>,
        places: &[Vec3],
        faces: &[[u32; 3]],
        tets: &[[u32; 4]],
    ) -> Result<Self, ModelError> {
        let sorted = |mut face: [u32; 3]| {
            face.sort_unstable();
            face
        };
        let mut inner = BTreeMap::new();
        for &[a, b, c, d] in tets {
            for (face, node) in [([b, c, d], a), ([a, c, d], b), ([a, b, d], c), ([a, b, c], d)] {
                inner.insert(sorted(face), node);
            }
        }
        let mut own = Vec::with_capacity(faces.len());
        let mut across: BTreeMap<[u32; 2], Vec<u32>> = BTreeMap::new();
        for (number, &[a, b, c]) in faces.iter().enumerate() {
            let Some(&d) = inner.get(&sorted([a, b, c])) else {
                return Err(ModelError::Value {
                    term: "front".into(),
                    what: "face without a tetrahedron, number",
                    value: number as f64,
                    remedy: "give faces of the tetrahedra",
                });
            };
            own.push([a, b, c, d]);
            for edge in [[b, c], [c, a], [a, b]] {
                across.entry(ends(edge)).or_default().push(number as u32);
            }
        }
        let beside = |number: usize, edge: [u32; 2]| {
            let both = across.get(&ends(edge));
            both.and_then(|both| both.iter().copied().find(|&other| other as usize != number))
        };
        let next = own.iter().enumerate();
        let next = next.map(|(n, &[a, b, c, _])| [[b, c], [c, a], [a, b]].map(|e| beside(n, e)));
        Ok(Self { target, places: places.to_vec(), next: next.collect(), tets: own })
    }

    pub(super) fn corners(&self, face: u32, points: &[Vec3]) -> [Vec3; 4] {
        self.tets[face as usize].map(|n| points[n as usize])
    }

    /// What the body has of the point `x` (mm) in a tetrahedron that is now where `points` are.
    pub(super) fn look(&self, face: u32, x: &Vec3, points: &[Vec3]) -> Option<Look> {
        let edges = |[a, b, c, d]: [Vec3; 4]| Mat3::from_columns(&[b - a, c - a, d - a]);
        let (now, smooth) = (self.corners(face, points), self.corners(face, &self.places));
        let inverse = edges(now).try_inverse()?;
        let inner = inverse * (x - now[0]);
        let rows = [0, 1, 2].map(|r| inverse.row(r).transpose());
        Some(Look {
            place: smooth[0] + edges(smooth) * inner,
            pull: edges(smooth) * inverse,
            weights: [1.0 - inner.sum(), inner.x, inner.y, inner.z],
            gradients: [-(rows[0] + rows[1] + rows[2]), rows[0], rows[1], rows[2]],
        })
    }

    /// Barycentric coordinates on a face of the foot of a point (mm) at `x`; `None` over a flat tetrahedron.
    fn parts(&self, face: u32, x: &Vec3, points: &[Vec3]) -> Option<[f64; 3]> {
        let look = self.look(face, x, points)?;
        let [a, b, c, _] = self.corners(face, &self.places);
        Some(over_face([a, b, c], &look.place))
    }

    /// Whether a point (mm) at `x` is over all faces that bear it, none left by more than `least`.
    fn is_over(&self, over: &Over, x: &Vec3, points: &[Vec3], least: f64) -> bool {
        over.bearing().all(|(face, _)| {
            let parts = self.parts(face, x, points);
            parts.is_none_or(|parts| parts.iter().all(|part| *part > least))
        })
    }

    /// Whether a point (mm) at `x` is near to what bears it.
    pub fn is_near(&self, over: &Over, x: &Vec3, points: &[Vec3]) -> bool {
        over.beyond || self.is_over(over, x, points, AWAY)
    }

    /// The face that a point (mm) at `x` is over, and whether it is beyond the rim there, on the way from `face`.
    fn reach(&self, mut face: u32, x: &Vec3, points: &[Vec3]) -> (u32, bool) {
        for _ in 0..LONGEST_WAY {
            let Some(parts) = self.parts(face, x, points) else { break };
            let left = |n: &usize| parts[*n] < STAYS;
            let next = (0..3).filter(left).filter_map(|n| Some((n, self.next[face as usize][n]?)));
            match next.min_by(|(m, _), (n, _)| parts[*m].total_cmp(&parts[*n])) {
                Some((_, next)) => face = next,
                None => return (face, (0..3).any(|n| left(&n))),
            }
        }
        (face, false)
    }

    /// What bears a point (mm) at `x`, from what bore it.
    pub fn walk(&self, from: &Over, x: &Vec3, points: &[Vec3]) -> Over {
        let own = from.main();
        let (face, beyond) = self.reach(own, x, points);
        if (face, beyond) == (own, from.beyond) && from.is_single() {
            return *from;
        }
        if beyond || from.beyond || from.is_single() {
            return from.passed_on(face, beyond);
        }
        if self.is_over(from, x, points, STAYS) {
            return *from;
        }
        if self.is_over(from, x, points, LEFT) { from.shifted(face) } else { Over::face(face) }
    }
}

/// What bears a point: one face of the front, or several that meet where it rests.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Over {
    /// Faces and their shares, which add up to one; the last face before the rim where the point is beyond that.
    faces: [(u32, f64); MOST_FACES],
    pub beyond: bool,
    /// The faces before, the latest first.
    past: [u32; 2],
    /// How often the point has come back to one of them.
    pub returns: u8,
    /// The face that it was last found over, and the share that this one gains when that happens again.
    last: u32,
    gain: f64,
}

impl Over {
    pub fn face(face: u32) -> Self {
        let mut faces = [(face, 0.0); MOST_FACES];
        faces[0].1 = 1.0;
        Self { faces, beyond: false, past: [face; 2], returns: 0, last: face, gain: 0.5 }
    }

    /// Faces that bear, and their shares.
    pub fn bearing(&self) -> impl Iterator<Item = (u32, f64)> {
        self.faces.into_iter().filter(|(_, share)| *share > 0.0)
    }

    fn is_single(&self) -> bool {
        self.bearing().count() == 1
    }

    /// The face that bears most.
    pub fn main(&self) -> u32 {
        let most = |best: (u32, f64), next: (u32, f64)| if next.1 > best.1 { next } else { best };
        self.bearing().fold((self.last, 0.0), most).0
    }

    /// On to another face; one that has come back several times is borne by both from here on.
    fn passed_on(&self, face: u32, beyond: bool) -> Self {
        let own = self.main();
        let returns = self.returns + u8::from(self.past.contains(&face) && face != own);
        let mut next = Self { beyond, past: [own, self.past[0]], returns, ..Self::face(face) };
        if !beyond && !self.beyond && returns >= RETURNS && face != own {
            (next.faces[0], next.faces[1]) = ((own, 0.5), (face, 0.5));
        }
        next
    }

    /// The face that the point is found over bears more.
    fn shifted(&self, face: u32) -> Self {
        let gain = if face == self.last { (GROWS * self.gain).min(0.5) } else { 0.5 * self.gain };
        if gain < LEAST_GAIN {
            return *self;
        }
        let mut next = Self { gain, last: face, ..*self };
        next.faces.iter_mut().for_each(|(_, share)| *share *= 1.0 - gain);
        let least = |faces: &[(u32, f64)]| {
            (0..faces.len()).min_by(|&m, &n| faces[m].1.total_cmp(&faces[n].1)).unwrap_or(0)
        };
        let known = next.faces.iter().position(|&(f, share)| f == face && share > 0.0);
        let at = known.unwrap_or_else(|| {
            let at = least(&next.faces);
            next.faces[at] = (face, 0.0);
            at
        });
        next.faces[at].1 += gain;
        next.faces.iter_mut().filter(|(_, share)| *share < LEAST_SHARE).for_each(|f| f.1 = 0.0);
        let sum: f64 = next.bearing().map(|(_, share)| share).sum();
        next.faces.iter_mut().for_each(|(_, share)| *share /= sum);
        if next.is_single() {
            return Self { past: [self.last, self.past[0]], ..Self::face(next.main()) };
        }
        next
    }
}

/// An edge, the smaller node first.
fn ends([a, b]: [u32; 2]) -> [u32; 2] {
    [a.min(b), a.max(b)]
}

/// Barycentric coordinates of the foot of a point on a triangle's plane.
fn over_face([a, b, c]: [Vec3; 3], point: &Vec3) -> [f64; 3] {
    let normal = (b - a).cross(&(c - a));
    let size = normal.norm_squared().max(f64::MIN_POSITIVE);
    let part = |from: &Vec3, to: &Vec3| (to - from).cross(&(point - from)).dot(&normal) / size;
    [part(&b, &c), part(&c, &a), part(&a, &b)]
}

/// A point as a tetrahedron has it.
pub(super) struct Look {
    /// Place in the smooth shape (mm).
    pub place: Vec3,
    /// Its derivative by the point.
    pub pull: Mat3,
    /// Barycentric coordinates of the point.
    pub weights: [f64; 4],
    /// Their derivatives by the point (1/mm).
    pub gradients: [Vec3; 4],
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What bears a point at last that is found over face 1 as long as that bears less than `balance`, else over
    /// face 2; and after how many rounds it stays so.
    fn settled(balance: f64) -> (Over, usize) {
        let mut over = Over::face(1);
        for face in [2, 1, 2, 1] {
            if over.is_single() {
                over = over.passed_on(face, false);
            }
        }
        assert_eq!(over.bearing().count(), 2, "{over:?}");
        for round in 0..40 {
            let first: f64 = over.bearing().filter(|(face, _)| *face == 1).map(|(_, s)| s).sum();
            let next = over.shifted(if first < balance { 1 } else { 2 });
            assert!((next.bearing().map(|(_, share)| share).sum::<f64>() - 1.0).abs() < 1e-12);
            if next.is_single() || next == over {
                return (next, round);
            }
            over = next;
        }
        panic!("{over:?}");
    }

    #[test]
    fn shares_come_to_where_a_point_rests_on_the_edge() {
        for balance in [0.2, 0.35, 0.5, 0.62, 0.8] {
            let (over, rounds) = settled(balance);
            let first: f64 = over.bearing().filter(|(face, _)| *face == 1).map(|(_, s)| s).sum();
            println!("{first:.3} for {balance} in {rounds} rounds");
            assert!((first - balance).abs() < 0.05, "{first} for {balance}");
        }
        // One that leaves the edge is borne by its own face alone.
        for (balance, own) in [(2.0, 1), (-1.0, 2)] {
            let (over, rounds) = settled(balance);
            assert!(over.is_single() && over.main() == own && rounds < 6, "{over:?} {rounds}");
        }
    }
}
