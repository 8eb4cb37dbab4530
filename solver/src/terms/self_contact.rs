//! Skin that touches skin, without friction: the fold under a breast.
//!
//! A node x of the skin is over a face (a, b, c) of it that looks at it; d is its distance from the plane
//! of that face. Along the normal all is as in [`super::contact`]; force and tangent on the four nodes are
//! exact, forces and moments on them cancel, since d does not change with a rigid motion. Every node is
//! held out of the faces, those of either side out of the other: no side leads.
//!
//! The face of a node is kept during a minimisation and looked for anew after it ([`Term::moved_on`]): a
//! node that comes near to a face, or has come through one, is held out of it from then on. What has
//! come through is told from what merely lies behind a face by the tissue that it is in.

mod plane;
mod search;

use super::contact::{Contact, Touch};
use super::{At, Block, ContactCheck, Load, NodeForce, Opening, Order, Term, Touching};
use crate::materials::MaterialError;
use mammotwin_data::{Mat3, Vec3, mesh::TetMesh};
use search::Skin;
use std::sync::Arc;

/// Skin that goes farther (mm) in one load step may have gone through other skin unseen: less than half of what is
/// looked through.
const LEASH_MM: f64 = 10.0;
/// Distance (mm) of a node that is over no face.
const AWAY_MM: f64 = 1e6;

/// Skin that does not pass through skin.
#[derive(Clone)]
pub struct SelfContact {
    name: String,
    contact: Contact,
    skin: Arc<Skin>,
    /// The face that each node is over.
    over: Vec<Option<u32>>,
    /// Each node and those of the face that it is over.
    touched: Vec<Vec<u32>>,
}

impl SelfContact {
    /// Keeps `faces` of a body out of each other; areas are those of the mesh.
    pub fn new(name: &str, mesh: &TetMesh, faces: &[[u32; 3]]) -> Self {
        let contact = Contact::new(&mesh.points, faces, Opening::Free);
        let skin = Arc::new(Skin::new(faces, &mesh.tets, &contact.nodes));
        let over = vec![None; contact.nodes.len()];
        Self { name: name.into(), contact, skin, over, touched: Vec::new() }.with_nodes()
    }

    /// Its elements for the faces that the nodes are over.
    fn with_nodes(mut self) -> Self {
        let one = |(&node, &face): (&u32, &Option<u32>)| {
            let corners = face.map(|face| self.skin.faces[face as usize]);
            std::iter::once(node).chain(corners.into_iter().flatten()).collect()
        };
        self.touched = self.contact.nodes.iter().zip(&self.over).map(one).collect();
        self
    }

    /// The node that is deepest behind a face through which it has come, with the nodes at `points` (mm), and how
    /// deep (mm); `None` where none has.
    pub fn deepest(&self, points: &[Vec3]) -> Option<(u32, f64)> {
        let over = self.skin.over(points, &self.over);
        let deep = |(element, face): (usize, Option<u32>)| {
            let pair = self.skin.pair(element, face?, points);
            Some((self.contact.nodes[element], -plane::distance_mm(&pair)))
        };
        let deep = over.into_iter().enumerate().filter_map(deep);
        deep.filter(|(_, mm)| *mm > 0.0).max_by(|a, b| a.1.total_cmp(&b.1))
    }

    fn look(&self, element: usize, points: &[Vec3]) -> Option<plane::Distance> {
        self.over[element].and_then(|face| plane::distance(&self.skin.pair(element, face, points)))
    }

    /// What the contact's law sees of a node.
    fn touch(&self, element: usize, points: &[Vec3]) -> Touch {
        let place = points[self.contact.nodes[element] as usize];
        let curvature = Mat3::zeros();
        match self.look(element, points) {
            Some(look) => Touch { distance: look.mm, normal: look.gradient[0], curvature, place },
            None => Touch { distance: AWAY_MM, normal: Vec3::zeros(), curvature, place },
        }
    }

    /// Force (mN) of the skin on each node that touches it; the corners of its face bear the opposite.
    pub fn node_forces(&self, at: &At) -> Vec<NodeForce> {
        self.contact.forces(at, |element| self.touch(element, at.points))
    }
}

impl Term for SelfContact {
    fn name(&self) -> &str {
        &self.name
    }

    fn elements(&self) -> usize {
        self.touched.len()
    }

    fn nodes(&self, element: usize) -> &[u32] {
        &self.touched[element]
    }

    fn is_internal(&self) -> bool {
        true
    }

    fn block(
        &self,
        element: usize,
        at: &At,
        order: Order,
        block: &mut Block,
    ) -> Result<(), MaterialError> {
        if let Some(look) = self.look(element, at.points) {
            let touch = self.touch(element, at.points);
            let curvature = |r: usize, s: usize| look.curvature[r][s];
            self.contact.shared_block(element, at, order, block, &touch, &look.gradient, curvature);
        }
        Ok(())
    }

    fn first_memory(&self, _points: &[Vec3], _load: Load) -> Vec<f64> {
        vec![0.0; self.contact.nodes.len()]
    }

    fn contact(&self, at: &At) -> Option<ContactCheck> {
        Some(self.contact.check(at, |element| self.touch(element, at.points)))
    }

    fn keep_to_surface(&self, from: &At, step: &[Vec3], points: &mut [Vec3]) {
        for (element, nodes) in self.touched.iter().enumerate() {
            let Some(start) = self.look(element, from.points) else { continue };
            let slopes = nodes.iter().zip(start.gradient);
            let change: f64 = slopes.map(|(&n, slope)| slope.dot(&step[n as usize])).sum();
            let end = self.touch(element, points);
            let shift = self.contact.shift(element, from, start.mm, start.mm + change, &end);
            points[nodes[0] as usize] += shift;
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
        let over = self.skin.over(points, &self.over);
        (over != self.over).then(|| Arc::new(Self { over, ..self.clone() }.with_nodes()) as Arc<_>)
    }

    fn leash_mm(&self) -> Option<f64> {
        Some(LEASH_MM)
    }
}
