//! One-sided contact of the skin with a rigid plate, with or without friction.

use super::contact::{Contact, Touch};
use super::{At, Block, ContactCheck, Load, NodeForce, Opening, Order, Slip, Term, Touching};
use crate::materials::MaterialError;
use crate::model::ModelError;
use crate::paddles::{AT_REST, Cushion, Lift, Pose, RoundedPlate, hinge::Tilted};
use mammotwin_data::{Mat3, Vec3};
use std::sync::Arc;

/// Which of the two plates.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PlateKind {
    /// Below the breast, at [`Load::receptor_mm`].
    Receptor,
    /// Above it, [`Load::thickness_mm`] from the receptor.
    Paddle,
}

/// A plate that presses on some faces of the body.
#[derive(Debug, Clone)]
pub struct Plate {
    kind: PlateKind,
    shape: RoundedPlate,
    contact: Contact,
    /// Distance (mm) of the axis that the plate tilts about from its edge.
    axis_mm: f64,
    lift: Option<Arc<dyn Lift>>,
    cushion: Option<Cushion>,
}

impl Plate {
    /// A plate that touches `faces`, without friction; areas are taken with the nodes at `points`
    /// (mm).
    pub fn new(kind: PlateKind, shape: RoundedPlate, points: &[Vec3], faces: &[[u32; 3]]) -> Self {
        let contact = Contact::new(points, faces, Opening::Free);
        Self { kind, shape, contact, axis_mm: 0.0, lift: None, cushion: None }
    }

    /// The same plate, which resists slip from where the nodes are at the first load.
    ///
    /// # Errors
    /// A friction coefficient that is negative or no number.
    pub fn slip(mut self, slip: Slip) -> Result<Self, ModelError> {
        self.contact.set_slip(self.kind.name(), slip)?;
        Ok(self)
    }

    /// The same plate, which tilts with [`Load::tilt_rad`] about a line at this distance (mm) from
    /// its edge, when it is the paddle.
    pub fn tilting(mut self, axis_mm: f64) -> Self {
        self.axis_mm = axis_mm;
        self
    }

    /// The same plate, whose surface is lifted by [`Load::pose`] when it is the paddle.
    pub fn lifted(mut self, lift: Arc<dyn Lift>) -> Self {
        self.lift = Some(lift);
        self
    }

    /// The same plate under a layer of foam that `faces` press on.
    pub fn cushioned(mut self, cushion: Cushion, faces: &[[u32; 3]]) -> Self {
        self.contact.set_foam(cushion.stiffness_kpa_per_mm(), faces);
        self.cushion = Some(cushion);
        self
    }

    /// The same plate, which leaves some nodes alone.
    pub fn without(mut self, left_alone: impl Fn(u32) -> bool) -> Self {
        self.contact.leave(left_alone);
        self
    }

    fn level(&self, load: &Load) -> f64 {
        match self.kind {
            PlateKind::Receptor => -load.receptor_mm,
            PlateKind::Paddle => load.receptor_mm + load.thickness_mm,
        }
    }

    fn touch(&self, element: usize, points: &[Vec3], load: &Load) -> Touch {
        let point = &points[self.contact.nodes[element] as usize];
        let (distance, normal, curvature) = self.distance(point, load);
        // Points of a plate that tilts or bends move along its normal, to first order: slip knows
        // not of it.
        let place = point - self.level(load) * self.shape.into;
        Touch { distance, normal, curvature, place }
    }

    fn distance(&self, point: &Vec3, load: &Load) -> (f64, Vec3, Mat3) {
        let level = self.level(load);
        match (self.tilted(load), self.bent()) {
            (Some(Tilted { shape, level_mm, .. }), _) => shape.distance(point, level_mm),
            (None, Some(lift)) => {
                let bend = lift.bend(self.shape.place(point), &load.pose);
                self.shape.lifted_distance(point, level, &bend)
            }
            (None, None) => self.shape.distance(point, level),
        }
    }

    fn tilted(&self, load: &Load) -> Option<Tilted> {
        let tilts = self.kind == PlateKind::Paddle && load.tilt_rad != 0.0;
        let tilted = || Tilted::new(&self.shape, self.level(load), self.axis_mm, load.tilt_rad);
        tilts.then(tilted)
    }

    fn bent(&self) -> Option<&dyn Lift> {
        self.lift.as_deref().filter(|_| self.kind == PlateKind::Paddle)
    }

    /// Force (mN) of the body on the plate along each of its coordinates.
    pub fn push(&self, at: &At) -> Pose {
        let mut push = AT_REST;
        let Some(lift) = self.bent() else { return push };
        for force in self.node_forces(at) {
            let point = &at.points[force.node as usize];
            let place = self.shape.place(point);
            let (level, bend) = (self.level(&at.load), lift.bend(place, &at.load.pose));
            // The force is along the gradient of the distance, whose length is not one.
            let gradient = self.shape.lifted_distance(point, level, &bend).1;
            let flat = self.shape.distance(point, level + bend.value).1;
            let size = force.normal.dot(&gradient) / gradient.norm_squared();
            let outwards = -size * flat.dot(&self.shape.into);
            for (sum, weight) in push.iter_mut().zip(lift.weights(place)) {
                *sum += outwards * weight;
            }
        }
        push
    }

    /// How far (mm) bending, tilt, roll and foam give way at a point's place on the plate.
    pub fn deflection(&self, point: &Vec3, load: &Load) -> f64 {
        let rest = Load { tilt_rad: 0.0, pose: AT_REST, ..*load };
        self.rise(point, load) - self.rise(point, &rest) + self.indentation(point, load)
    }

    /// Distance (mm) of paddle and receptor at a point's place on the plates.
    pub fn gap(&self, point: &Vec3, load: &Load) -> f64 {
        load.thickness_mm + self.rise(point, load) + self.indentation(point, load)
    }

    /// How far (mm) the surface lies above the plate's level.
    fn rise(&self, point: &Vec3, load: &Load) -> f64 {
        let place = self.shape.place(point);
        let lift = self.bent().map_or(0.0, |lift| lift.bend(place, &load.pose).value);
        lift - (place[1] - self.axis_mm) * load.tilt_rad.tan()
    }

    /// How far (mm) a point lies in the foam.
    pub fn indentation(&self, point: &Vec3, load: &Load) -> f64 {
        if self.cushion.is_none() {
            return 0.0;
        }
        (-self.distance(point, load).0).max(0.0)
    }

    /// How far (mm) a point stands out beyond the surface beside the plate or in its window; zero
    /// elsewhere.
    pub fn bulge(&self, point: &Vec3, load: &Load) -> f64 {
        if !self.shape.outline.is_open(self.shape.place(point)) {
            return 0.0;
        }
        let height = self.shape.into.dot(point) - self.level(load);
        (height - self.rise(point, load)).max(0.0)
    }

    /// Torque (mN mm) of the body on the plate about its axis, positive when it turns the side of
    /// the nipple down, and the sum of the sizes of its parts.
    pub fn torque(&self, at: &At) -> (f64, f64) {
        let axis = (self.axis_mm, at.load.tilt_rad);
        let tilted = Tilted::new(&self.shape, self.level(&at.load), axis.0, axis.1);
        let parts = self.node_forces(at).into_iter().map(|force| {
            let turning = tilted.turning(&at.points[force.node as usize]);
            -(force.normal + force.friction).dot(&turning)
        });
        parts.fold((0.0, 0.0), |(sum, size), part| (sum + part, size + part.abs()))
    }

    /// Force (mN) of the plate on each node that it touches.
    pub fn node_forces(&self, at: &At) -> Vec<NodeForce> {
        self.contact.forces(at, |element| self.touch(element, at.points, &at.load))
    }
}

impl PlateKind {
    fn name(self) -> &'static str {
        match self {
            Self::Receptor => "receptor",
            Self::Paddle => "paddle",
        }
    }
}

impl Term for Plate {
    fn name(&self) -> &str {
        self.kind.name()
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
        let touch = self.touch(element, at.points, &at.load);
        self.contact.block(element, at, order, block, &touch);
        Ok(())
    }

    fn first_memory(&self, points: &[Vec3], load: Load) -> Vec<f64> {
        self.contact.first_memory(points, 0.0, |element| self.touch(element, points, &load))
    }

    fn ties(&self) -> bool {
        true
    }

    fn contact(&self, at: &At) -> Option<ContactCheck> {
        Some(self.contact.check(at, |element| self.touch(element, at.points, &at.load)))
    }

    fn keep_to_surface(&self, from: &At, step: &[Vec3], points: &mut [Vec3]) {
        let touch = |element: usize, points: &[Vec3]| self.touch(element, points, &from.load);
        self.contact.keep_to_surface(from, step, points, touch);
    }

    fn update_multipliers(
        &self,
        points: &[Vec3],
        shear_kpa: &[f64],
        load: Load,
        memory: &mut [f64],
    ) {
        self.contact
            .update(points, shear_kpa, memory, |element| self.touch(element, points, &load));
    }

    fn accept(&self, points: &[Vec3], load: Load, memory: &mut [f64]) {
        self.contact.accept(memory, |element| self.touch(element, points, &load));
    }

    fn lags(&self) -> bool {
        self.contact.lags()
    }

    fn touching(&self, at: &At) -> Vec<Touching> {
        self.contact.touching(at, |element| self.touch(element, at.points, &at.load))
    }

    fn may_open(&self) -> bool {
        true
    }
}
