//! Contact of a surface of the body with a smooth target that rests: the chest wall.
//!
//! As it is made, the surface glides without friction and never leaves the target. Whether it may
//! open and what resists its slip (Mîra 2018, table 2.1) is said with [`Sliding::opening`] and
//! [`Sliding::slip`].

use super::contact::{Contact, Touch};
use super::{
    At, Block, ContactCheck, Load, NodeForce, Opening, Order, Slip, Term, Touching, target::Target,
};
use crate::materials::MaterialError;
use crate::model::ModelError;
use mammotwin_data::Vec3;
use std::sync::Arc;

/// A surface that glides on a target.
#[derive(Clone)]
pub struct Sliding {
    name: String,
    contact: Contact,
    target: Arc<dyn Target>,
    /// Place (mm) of each node from which its slip counts.
    anchors: Vec<Vec3>,
}

impl Sliding {
    /// Glides the nodes of `faces` on `target`, never leaving it; areas are taken with the nodes at
    /// `points` (mm).
    pub fn new(name: &str, points: &[Vec3], faces: &[[u32; 3]], target: Arc<dyn Target>) -> Self {
        let contact = Contact::new(points, faces, Opening::Never);
        Self { name: name.into(), contact, target, anchors: Vec::new() }
    }

    /// The same surface, which may open or not.
    pub fn opening(mut self, opening: Opening) -> Self {
        self.contact.opening = opening;
        self
    }

    /// The same surface, which resists slip from where its nodes are at `rest` (mm).
    ///
    /// # Errors
    /// A friction coefficient that is negative or no number.
    pub fn slip(mut self, slip: Slip, rest: &[Vec3]) -> Result<Self, ModelError> {
        self.contact.set_slip(&self.name, slip)?;
        self.anchors = rest.to_vec();
        Ok(self)
    }

    /// The same surface without some of its nodes.
    pub fn without(mut self, left_alone: impl Fn(u32) -> bool) -> Self {
        self.contact.leave(left_alone);
        self
    }

    fn touch(&self, element: usize, points: &[Vec3]) -> Touch {
        let place = points[self.contact.nodes[element] as usize];
        let (distance, normal, curvature) = self.target.distance(&place);
        Touch { distance, normal, curvature, place }
    }

    /// Force (mN) of the target on each node that it touches.
    pub fn node_forces(&self, at: &At) -> Vec<NodeForce> {
        self.contact.forces(at, |element| self.touch(element, at.points))
    }
}

impl Term for Sliding {
    fn name(&self) -> &str {
        &self.name
    }

    fn elements(&self) -> usize {
        self.contact.nodes.len()
    }

    fn nodes(&self, element: usize) -> &[u32] {
        std::slice::from_ref(&self.contact.nodes[element])
    }

    fn block(
        &self,
        element: usize,
        at: &At,
        order: Order,
        block: &mut Block,
    ) -> Result<(), MaterialError> {
        self.contact.block(element, at, order, block, &self.touch(element, at.points));
        Ok(())
    }

    /// At rest nothing is known of the normal pressure: nodes stick until it is.
    fn first_memory(&self, points: &[Vec3], _load: Load) -> Vec<f64> {
        self.contact
            .first_memory(points, f64::INFINITY, |element| self.touch(element, &self.anchors))
    }

    fn ties(&self) -> bool {
        true
    }

    fn contact(&self, at: &At) -> Option<ContactCheck> {
        Some(self.contact.check(at, |element| self.touch(element, at.points)))
    }

    fn keep_to_surface(&self, from: &At, step: &[Vec3], points: &mut [Vec3]) {
        self.contact
            .keep_to_surface(from, step, points, |element, points| self.touch(element, points));
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

    fn accept(&self, points: &[Vec3], _load: Load, memory: &mut [f64]) {
        self.contact.accept(memory, |element| self.touch(element, points));
    }

    fn surface(&self) -> Option<&dyn Target> {
        (self.contact.opening == Opening::Never).then_some(self.target.as_ref())
    }

    fn lags(&self) -> bool {
        self.contact.lags()
    }

    fn touching(&self, at: &At) -> Vec<Touching> {
        self.contact.touching(at, |element| self.touch(element, at.points))
    }

    fn may_open(&self) -> bool {
        self.contact.opening == Opening::Free
    }

    fn react(&self, points: &[Vec3], gradient: &[Vec3], memory: &mut [f64]) {
        self.contact.react(gradient, memory, |element| self.touch(element, points));
    }
}
