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
//! face ends the minimisation: what a tetrahedron far away says of it is wrong. Where the deformed front has a valley
//! between its flat pieces several tetrahedra bear a point (see `front`); its distance is the mean of theirs, by
//! their shares. Beyond the rim, where there is no next one, the front goes on as its smooth shape does, at rest:
//! d = φ(x). Held at its rim, it has no step there.

mod front;

use super::contact::{Contact, Touch};
use super::{At, Block, ContactCheck, Load, MOST_NODES, NodeForce, Opening, Order, Term, Touching};
use crate::materials::MaterialError;
pub use front::Front;
use front::{Look, MOST_FACES, Over};
use mammotwin_data::{Mat3, Vec3};
use std::sync::Arc;

/// A surface that glides without friction on the front of another body and never leaves it.
#[derive(Clone)]
pub struct Gliding {
    name: String,
    contact: Contact,
    front: Arc<Front>,
    /// What bears each node.
    over: Vec<Over>,
    touched: Vec<Touched>,
}

/// Nodes of an element.
#[derive(Clone)]
struct Touched {
    /// The gliding node, and those of the tetrahedra that bear it.
    nodes: Vec<u32>,
    /// The gliding node and those of each tetrahedron among these.
    own: [[usize; 5]; MOST_FACES],
}

impl Touched {
    fn new(node: u32, over: &Over, front: &Front) -> Self {
        let (mut nodes, mut own) = (vec![node], [[0; 5]; MOST_FACES]);
        for ((face, _), own) in over.bearing().zip(&mut own).filter(|_| !over.beyond) {
            for (corner, own) in front.tets[face as usize].iter().zip(&mut own[1..]) {
                *own = nodes.iter().position(|n| n == corner).unwrap_or(nodes.len());
                if *own == nodes.len() {
                    nodes.push(*corner);
                }
            }
        }
        Self { nodes, own }
    }
}

/// A node as one of the tetrahedra that bear it has it.
struct Seen {
    share: f64,
    look: Look,
    /// Of the distance, by the place in the smooth shape.
    slope: Vec3,
    curvature: Mat3,
    distance: f64,
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
            front.walk(&Over::face(nearest.unwrap_or(0) as u32), x, &front.places)
        };
        let over = contact.nodes.iter().map(over).collect();
        Self::borne(name, contact, front, over)
    }

    fn borne(name: &str, contact: Contact, front: Arc<Front>, over: Vec<Over>) -> Self {
        let touched = contact.nodes.iter().zip(&over);
        let touched = touched.map(|(&node, over)| Touched::new(node, over, &front)).collect();
        Self { name: name.into(), contact, front, over, touched }
    }

    /// A point at `x` as each of the tetrahedra that bear it has it; a flat one, which its own tissue refuses, has none.
    fn seen<'a>(
        &'a self,
        over: &'a Over,
        x: &'a Vec3,
        points: &'a [Vec3],
    ) -> impl Iterator<Item = Option<Seen>> + 'a {
        over.bearing().map(move |(face, share)| {
            let look = self.front.look(face, x, points)?;
            let (distance, slope, curvature) = self.front.target.distance(&look.place);
            Some(Seen { share, look, slope, curvature, distance })
        })
    }

    /// What the contact's law sees of a point at `x`: distance and its derivatives by the point alone.
    fn touch_at(&self, over: &Over, x: &Vec3, points: &[Vec3]) -> Touch {
        let place = *x;
        if over.beyond {
            let (distance, normal, curvature) = self.front.target.distance(x);
            return Touch { distance, normal, curvature, place };
        }
        let nothing =
            Touch { distance: 0.0, normal: Vec3::zeros(), curvature: Mat3::zeros(), place };
        self.seen(over, x, points).flatten().fold(nothing, |mut sum, seen| {
            let pull = &seen.look.pull;
            sum.distance += seen.share * seen.distance;
            sum.normal += seen.share * pull.transpose() * seen.slope;
            sum.curvature += seen.share * pull.transpose() * seen.curvature * pull;
            sum
        })
    }

    fn touch(&self, element: usize, points: &[Vec3]) -> Touch {
        let x = &points[self.contact.nodes[element] as usize];
        self.touch_at(&self.over[element], x, points)
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
        &self.touched[element].nodes
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
        let Touched { nodes, own } = &self.touched[element];
        let x = &at.points[nodes[0] as usize];
        // How the distance to the place that a tetrahedron has of the point answers to each node, summed over those
        // that bear it.
        let mut slopes = [Vec3::zeros(); MOST_NODES];
        let mut bends = [[Mat3::zeros(); MOST_NODES]; MOST_NODES];
        for (seen, own) in self.seen(&self.over[element], x, at.points).zip(own) {
            let Some(Seen { share, look, slope, curvature, .. }) = seen else { return Ok(()) };
            let [a, b, c, d] = look.weights;
            let parts = [1.0, -a, -b, -c, -d];
            let normal = look.pull.transpose() * slope;
            let curvature = look.pull.transpose() * curvature * look.pull;
            let nabla = |n: usize| if n == 0 { Vec3::zeros() } else { look.gradients[n - 1] };
            for (r, &row) in own.iter().enumerate() {
                slopes[row] += share * parts[r] * normal;
                for (s, &column) in own.iter().enumerate().filter(|_| order >= Order::Hessian) {
                    let bend = parts[r] * parts[s] * curvature
                        - parts[r] * nabla(s) * normal.transpose()
                        - parts[s] * normal * nabla(r).transpose();
                    bends[row][column] += share * bend;
                }
            }
        }
        let slopes = &slopes[..nodes.len()];
        self.contact.shared_block(element, at, order, block, &touch, slopes, |r, s| bends[r][s]);
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
            let node = self.contact.nodes[element] as usize;
            let (start, end) = (self.touch(element, from.points), self.touch(element, points));
            let over = &self.over[element];
            let foretold = if over.beyond {
                start.normal.dot(&step[node])
            } else {
                let seen = self.seen(over, &from.points[node], from.points).zip(over.bearing());
                let along = seen.filter_map(|(seen, (face, share))| {
                    let Seen { look, slope, .. } = seen?;
                    let corners = self.front.tets[face as usize].iter().zip(look.weights);
                    let carried: Vec3 = corners.map(|(&n, weight)| weight * step[n as usize]).sum();
                    Some(share * slope.dot(&(look.pull * (step[node] - carried))))
                });
                along.sum()
            };
            let foretold = start.distance + foretold;
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
        let on = |(&node, over)| self.front.walk(over, &points[node as usize], points);
        let over: Vec<Over> = self.contact.nodes.iter().zip(&self.over).map(on).collect();
        let others = over.iter().zip(&self.over).zip(&self.contact.nodes);
        let mut others = others.filter(|((now, before), _)| now != before);
        let ((to, from), &node) = others.next()?;
        let [from, to] = [from, to].map(|over| over.bearing().collect::<Vec<_>>());
        let place_mm = points[node as usize];
        tracing::debug!(nodes = 1 + others.count(), node, ?place_mm, ?from, ?to, "moved on");
        let Self { name, contact, front, .. } = self;
        Some(Arc::new(Self::borne(name, contact.clone(), front.clone(), over)))
    }

    fn is_near(&self, from: &[Vec3], to: &[Vec3]) -> bool {
        let near = |node: usize, over: &Over, points: &[Vec3]| {
            self.front.is_near(over, &points[node], points)
        };
        let mut each = self.contact.nodes.iter().zip(&self.over);
        each.all(|(&node, over)| near(node as usize, over, to) || !near(node as usize, over, from))
    }

    fn gives_way(&self) -> bool {
        true
    }

    fn above(&self, element: usize, points: &[Vec3]) -> Option<(f64, Vec3)> {
        let x = &points[self.contact.nodes[element] as usize];
        let over = self.front.walk(&self.over[element], x, points);
        let touch = self.touch_at(&over, x, points);
        Some((touch.distance, touch.normal))
    }
}
