//! A surface that glides on the front of another body, which gives way.
//!
//! The front is known in the shape in which it is smooth: the zero of a signed distance φ, with the
//! nodes of its body at the places P. A point x near the front belongs to one of the tetrahedra under it,
//! with barycentric coordinates N: Σ Nᵢ xᵢ = x. What the body has of it in the smooth shape is
//! X = Σ Nᵢ Pᵢ, and d = φ(X) its distance. With G = ∂X/∂x and w = dx - Σ Nᵢ dxᵢ,
//!
//! dX = G w, d²X = -G Σ (∇Nᵢ·w) dxᵢ twice, symmetrised,
//!
//! so that force and tangent on the point and the four nodes are exact. The forces on them add up to
//! nothing, and so do their moments, since x = Σ Nᵢ xᵢ; a rigid motion of both changes nothing. Along
//! the normal all is as in [`super::contact`].
//!
//! The tetrahedron of a point is kept during a minimisation; afterwards a point that has left it by more
//! than a twentieth of a face goes on to the next one (see [`Term::moved_on`]). One that would leave it by a whole
//! face ends the minimisation: what a tetrahedron far away says of it is wrong. Beyond the rim, where there is no
//! next one, the front goes on as its smooth shape does, at rest: d = φ(x). Held at its rim, it has no step there.

use super::contact::{Contact, Touch};
use super::{
    At, Block, ContactCheck, Load, NodeForce, Opening, Order, Term, Touching, target::Target,
};
use crate::materials::MaterialError;
use crate::model::ModelError;
use mammotwin_data::{Mat3, Vec3};
use std::collections::BTreeMap;
use std::sync::Arc;

/// Barycentric coordinate on the front's face down to which a point stays with its tetrahedron: less would send points
/// on an edge to and fro. One that comes back again and again stays longer.
const STAYS: [f64; 4] = [-0.05, -0.05, -0.1, -0.2];
/// The same down to which a minimisation may lead it.
const AWAY: f64 = -1.0;
/// Most faces that a point crosses on the way to its own.
const LONGEST_WAY: usize = 100;

/// The front of a body, where it is smooth.
pub struct Front {
    target: Arc<dyn Target>,
    /// Places of all nodes (mm) there.
    places: Vec<Vec3>,
    /// Tetrahedra with a face on the front: its three nodes first.
    tets: Vec<[u32; 4]>,
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

    fn corners(&self, face: u32, points: &[Vec3]) -> [Vec3; 4] {
        self.tets[face as usize].map(|n| points[n as usize])
    }

    /// What the body has of the point `x` (mm) in a tetrahedron that is now where `points` are.
    fn look(&self, face: u32, x: &Vec3, points: &[Vec3]) -> Option<Look> {
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

    /// What a point (mm) at `x` is over, from what it was over.
    fn walk(&self, from: Over, x: &Vec3, points: &[Vec3]) -> Over {
        let mut at = Over { beyond: false, ..from };
        for _ in 0..LONGEST_WAY {
            let Some(parts) = self.parts(at.face, x, points) else { break };
            let left = |n: &usize| parts[*n] < STAYS[usize::from(from.returns)];
            let next =
                (0..3).filter(left).filter_map(|n| Some((n, self.next[at.face as usize][n]?)));
            match next.min_by(|(m, _), (n, _)| parts[*m].total_cmp(&parts[*n])) {
                Some((_, next)) => at.face = next,
                None => {
                    at.beyond = (0..3).any(|n| left(&n));
                    break;
                }
            }
        }
        if (at.face, at.beyond) == (from.face, from.beyond) {
            return from;
        }
        let returns =
            from.returns + u8::from(at.face == from.before && from.returns < STAYS.len() as u8 - 1);
        Over { before: from.face, returns, ..at }
    }
}

/// What a point is over.
#[derive(Clone, Copy, PartialEq)]
struct Over {
    /// A face of the front, the last one before its rim where the point is beyond that.
    face: u32,
    beyond: bool,
    /// The face before.
    before: u32,
    /// How often the point has come back to the face before, at most what [`STAYS`] tells apart.
    returns: u8,
}

impl Over {
    fn face(face: u32) -> Self {
        Self { face, beyond: false, before: face, returns: 0 }
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
struct Look {
    /// Place in the smooth shape (mm).
    place: Vec3,
    /// Its derivative by the point.
    pull: Mat3,
    /// Barycentric coordinates of the point.
    weights: [f64; 4],
    /// Their derivatives by the point (1/mm).
    gradients: [Vec3; 4],
}

/// A surface that glides without friction on the front of another body and never leaves it.
#[derive(Clone)]
pub struct Gliding {
    name: String,
    contact: Contact,
    front: Arc<Front>,
    /// What each node is over.
    over: Vec<Over>,
    /// Each node and those of the tetrahedron under it, or under the rim that it is beyond.
    touched: Vec<[u32; 5]>,
}

impl Gliding {
    /// Glides the nodes of `faces` that `wanted` names on a front; areas, and the face of the front that
    /// each node is over, are taken with the nodes at the front's places.
    pub fn new(
        name: &str,
        faces: &[[u32; 3]],
        front: Arc<Front>,
        wanted: impl Fn(u32) -> bool,
    ) -> Self {
        let mut contact = Contact::new(&front.places, faces, Opening::Never);
        contact.leave(|node| !wanted(node));
        let middles: Vec<Vec3> = (0..front.tets.len())
            .map(|face| {
                let [a, b, c, _] = front.corners(face as u32, &front.places);
                (a + b + c) / 3.0
            })
            .collect();
        let over = |&node: &u32| {
            let x = &front.places[node as usize];
            let far = |&n: &usize| (middles[n] - x).norm_squared();
            let nearest = (0..middles.len()).min_by(|a, b| far(a).total_cmp(&far(b)));
            front.walk(Over::face(nearest.unwrap_or(0) as u32), x, &front.places)
        };
        let over = contact.nodes.iter().map(over).collect();
        let mut term = Self { name: name.into(), contact, front, over, touched: Vec::new() };
        term.touched = term.touching_nodes();
        term
    }

    fn touching_nodes(&self) -> Vec<[u32; 5]> {
        let one = |(&node, over): (&u32, &Over)| {
            let [a, b, c, d] = self.front.tets[over.face as usize];
            [node, a, b, c, d]
        };
        self.contact.nodes.iter().zip(&self.over).map(one).collect()
    }

    fn look(&self, element: usize, points: &[Vec3]) -> Option<Look> {
        let x = &points[self.contact.nodes[element] as usize];
        self.front.look(self.over[element].face, x, points)
    }

    /// What the contact's law sees: distance and its derivatives by the point alone.
    fn touch(&self, element: usize, points: &[Vec3]) -> Touch {
        let place = points[self.contact.nodes[element] as usize];
        if self.over[element].beyond {
            let (distance, normal, curvature) = self.front.target.distance(&place);
            return Touch { distance, normal, curvature, place };
        }
        match self.look(element, points) {
            Some(look) => {
                let (distance, slope, curvature) = self.front.target.distance(&look.place);
                let normal = look.pull.transpose() * slope;
                let curvature = look.pull.transpose() * curvature * look.pull;
                Touch { distance, normal, curvature, place }
            }
            // A flat tetrahedron, which its own tissue refuses.
            None => Touch { distance: 0.0, normal: Vec3::zeros(), curvature: Mat3::zeros(), place },
        }
    }

    /// Force (mN) of the front on each node that it touches; the front bears the opposite.
    pub fn node_forces(&self, at: &At) -> Vec<NodeForce> {
        self.contact.forces(at, |element| self.touch(element, at.points))
    }
}

impl Term for Gliding {
    fn name(&self) -> &str {
        &self.name
    }

    fn elements(&self) -> usize {
        self.touched.len()
    }

    fn nodes(&self, element: usize) -> &[u32] {
        let nodes = &self.touched[element];
        if self.over[element].beyond { &nodes[..1] } else { nodes }
    }

    fn is_internal(&self) -> bool {
        self.over.iter().all(|over| !over.beyond)
    }

    fn block(
        &self,
        element: usize,
        at: &At,
        order: Order,
        block: &mut Block,
    ) -> Result<(), MaterialError> {
        let touch = self.touch(element, at.points);
        if self.over[element].beyond {
            self.contact.block(element, at, order, block, &touch);
            return Ok(());
        }
        let Some(look) = self.look(element, at.points) else { return Ok(()) };
        // How the distance to the tetrahedron's own place of the point answers to each node.
        let [a, b, c, d] = look.weights;
        let share = [1.0, -a, -b, -c, -d];
        let slope = touch.normal;
        let nabla = |n: usize| if n == 0 { Vec3::zeros() } else { look.gradients[n - 1] };
        let bend = |r: usize, s: usize| {
            share[r] * share[s] * touch.curvature
                - share[r] * nabla(s) * slope.transpose()
                - share[s] * slope * nabla(r).transpose()
        };
        let slopes = share.map(|share| share * slope);
        self.contact.shared_block(element, at, order, block, &touch, &slopes, bend);
        Ok(())
    }

    fn first_memory(&self, _points: &[Vec3], _load: Load) -> Vec<f64> {
        vec![0.0; self.contact.nodes.len()]
    }

    fn contact(&self, at: &At) -> Option<ContactCheck> {
        Some(self.contact.check(at, |element| self.touch(element, at.points)))
    }

    fn keep_to_surface(&self, from: &At, step: &[Vec3], points: &mut [Vec3]) {
        for element in 0..self.touched.len() {
            let (nodes, look) = (self.nodes(element), self.look(element, from.points));
            let Some(look) = look else { continue };
            let (start, end) = (self.touch(element, from.points), self.touch(element, points));
            let carried: Vec3 =
                nodes[1..].iter().zip(look.weights).map(|(&n, w)| w * step[n as usize]).sum();
            let node = nodes[0] as usize;
            let foretold = start.distance + start.normal.dot(&(step[node] - carried));
            points[node] += self.contact.shift(element, from, start.distance, foretold, &end);
        }
    }

    fn update_multipliers(
        &self,
        points: &[Vec3],
        shear_kpa: &[f64],
        _load: Load,
        memory: &mut [f64],
    ) {
        self.contact.update(points, shear_kpa, memory, |element| self.touch(element, points));
    }

    fn touching(&self, at: &At) -> Vec<Touching> {
        self.contact.touching(at, |element| self.touch(element, at.points))
    }

    fn moved_on(&self, points: &[Vec3]) -> Option<Arc<dyn Term>> {
        let on =
            |(&node, over): (&u32, &Over)| self.front.walk(*over, &points[node as usize], points);
        let over: Vec<Over> = self.contact.nodes.iter().zip(&self.over).map(on).collect();
        if over == self.over {
            return None;
        }
        let mut moved = Self { over, ..self.clone() };
        moved.touched = moved.touching_nodes();
        Some(Arc::new(moved))
    }

    fn is_near(&self, points: &[Vec3]) -> bool {
        self.contact.nodes.iter().zip(&self.over).filter(|(_, over)| !over.beyond).all(
            |(&node, over)| {
                let parts = self.front.parts(over.face, &points[node as usize], points);
                parts.is_none_or(|parts| parts.iter().all(|part| *part > AWAY))
            },
        )
    }

    fn gives_way(&self) -> bool {
        true
    }

    fn above(&self, element: usize, points: &[Vec3]) -> Option<(f64, Vec3)> {
        let x = &points[self.contact.nodes[element] as usize];
        let over = self.front.walk(self.over[element], x, points);
        if over.beyond {
            let (distance, normal, _) = self.front.target.distance(x);
            return Some((distance, normal));
        }
        let look = self.front.look(over.face, x, points)?;
        let (distance, slope, _) = self.front.target.distance(&look.place);
        Some((distance, look.pull.transpose() * slope))
    }
}
