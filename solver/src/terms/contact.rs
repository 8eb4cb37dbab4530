//! Contact of nodes with a smooth surface: what sliding and plates have in common.
//!
//! Every node stands for its share A of a surface. Its distance d from the target, with the
//! multiplier λ (kPa, negative where pressed on), costs A (λ d + ½ k d²) where the contact never
//! opens, and A/(2k) (min(0, λ + k d)² - λ²) where it may: augmented Lagrangians of d = 0 and
//! d >= 0 (Wriggers, *Computational contact mechanics* (2006), § 6.3, § 10.3). The penalty k only
//! sets the speed: the multipliers are updated until gaps and penetrations are below tolerance.
//! Along the surface there is [`super::friction`].
//!
//! A surface under a `Foam` of stiffness k (kPa/mm) is no such constraint: a node that lies in it
//! costs a ½ k d² with `a` the area of it that the skin around the node covers now. That area lags
//! behind, as friction does, until it changes no more.

mod law;

use super::friction::{Hold, Response, Slip};
use super::{At, ContactCheck};
use crate::model::ModelError;
use mammotwin_data::{Mat3, Vec3};
use std::collections::BTreeMap;

/// Area (mm²) of the faces that belongs to each of their nodes.
pub(crate) fn node_areas(points: &[Vec3], faces: &[[u32; 3]]) -> BTreeMap<u32, f64> {
    let mut areas = BTreeMap::new();
    for face in faces {
        let [a, b, c] = face.map(|n| points[n as usize]);
        let third = (b - a).cross(&(c - a)).norm() / 6.0;
        for &n in face {
            *areas.entry(n).or_insert(0.0) += third;
        }
    }
    areas
}

/// What a contact does along its normal.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Opening {
    /// Stays closed.
    Never,
    /// Opens where it would have to pull.
    Free,
}

/// Least part of the skin around a node that a surface is taken to touch.
const LEAST_FACING: f64 = 0.25;

/// Deformed skin (mm²) around a node.
#[derive(Default)]
pub(crate) struct Skin {
    area: f64,
    vector: Vec3,
}

impl Skin {
    /// Area of a surface with this normal that the skin covers. Pressures are those on the surface:
    /// they add up to its force whether or not the skin is folded under it.
    pub fn facing(&self, normal: Vec3) -> f64 {
        self.vector.dot(&normal).max(LEAST_FACING * self.area)
    }
}

/// Skin around each node of some faces.
pub(crate) fn skin_around(points: &[Vec3], faces: &[[u32; 3]]) -> BTreeMap<u32, Skin> {
    let mut skins: BTreeMap<u32, Skin> = BTreeMap::new();
    for face in faces {
        let [a, b, c] = face.map(|n| points[n as usize]);
        let third = (b - a).cross(&(c - a)) / 6.0;
        for &n in face {
            let skin = skins.entry(n).or_default();
            skin.area += third.norm();
            skin.vector += third;
        }
    }
    skins
}

/// A layer of springs on a surface.
#[derive(Debug, Clone)]
struct Foam {
    /// Pressure by indentation (kPa/mm).
    stiffness: f64,
    /// Faces that may press on it.
    faces: Vec<[u32; 3]>,
}

/// Where a node is with respect to the surface that it touches.
pub(super) struct Touch {
    /// Distance (mm), negative inside.
    pub distance: f64,
    /// Its gradient.
    pub normal: Vec3,
    /// Its second derivatives (1/mm).
    pub curvature: Mat3,
    /// Place of the node (mm) as the surface sees it, which may move.
    pub place: Vec3,
}

/// Force (mN) of a contact on a node.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NodeForce {
    /// The node.
    pub node: u32,
    /// Along the surface's normal.
    pub normal: Vec3,
    /// Along the surface.
    pub friction: Vec3,
}

/// A node that a contact may touch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Touching {
    /// The node.
    pub node: u32,
    /// Its distance (mm), negative inside.
    pub distance_mm: f64,
    /// Gradient of the distance.
    pub normal: Vec3,
    /// Area (mm²) of the node.
    pub area_mm2: f64,
    /// Penalty (kPa/mm) of its distance.
    pub penalty_kpa_per_mm: f64,
    /// Whether the contact holds it on the surface.
    pub closed: bool,
    /// Whether friction may hold it along the surface.
    pub rubs: bool,
}

/// Nodes of a body that touch a surface. The memory has the multiplier of each node, or under a foam
/// the area that it covers over its own, and with friction a [`Hold`] of each.
#[derive(Debug, Clone)]
pub(super) struct Contact {
    pub nodes: Vec<u32>,
    /// Area of each node (mm²).
    pub areas: Vec<f64>,
    pub opening: Opening,
    slip: Slip,
    foam: Option<Foam>,
}

impl Contact {
    /// The nodes of `faces`, with their areas when the nodes are at `points` (mm); without friction.
    pub fn new(points: &[Vec3], faces: &[[u32; 3]], opening: Opening) -> Self {
        let areas = node_areas(points, faces);
        let (nodes, areas) = areas.into_iter().filter(|&(_, area)| area > 0.0).unzip();
        Self { nodes, areas, opening, slip: Slip::Free, foam: None }
    }

    /// Leaves some nodes alone.
    pub fn leave(&mut self, left_alone: impl Fn(u32) -> bool) {
        let touched = |n: &u32| !left_alone(*n);
        let areas = self.nodes.iter().zip(&self.areas).filter(|(n, _)| touched(n));
        self.areas = areas.map(|(_, area)| *area).collect();
        self.nodes.retain(touched);
    }

    /// Slips as is said; a coefficient of zero is no friction.
    ///
    /// # Errors
    /// A coefficient that is negative or no number.
    pub fn set_slip(&mut self, term: &str, slip: Slip) -> Result<(), ModelError> {
        self.slip = match slip {
            Slip::Coulomb(friction) if !(friction >= 0.0 && friction.is_finite()) => {
                return Err(ModelError::Value {
                    term: term.into(),
                    what: "friction coefficient",
                    value: friction,
                    remedy: "give one that is not negative",
                });
            }
            Slip::Coulomb(0.0) => Slip::Free,
            slip => slip,
        };
        Ok(())
    }

    /// Lies under a foam of this stiffness (kPa/mm) that `faces` press on.
    pub fn set_foam(&mut self, stiffness: f64, faces: &[[u32; 3]]) {
        self.foam = Some(Foam { stiffness, faces: faces.to_vec() });
    }

    /// Whether there is friction.
    pub fn has_friction(&self) -> bool {
        self.slip != Slip::Free
    }

    /// Whether forces lag behind the state.
    pub fn lags(&self) -> bool {
        self.has_friction() || self.foam.is_some()
    }

    /// All nodes, and which of them are held on the surface.
    pub fn touching(&self, at: &At, touch: impl Fn(usize) -> Touch) -> Vec<Touching> {
        let one = |element: usize| {
            let touch = touch(element);
            let pressed = self.traction(element, at.memory, at.shear_kpa, &touch) < 0.0;
            Touching {
                node: self.nodes[element],
                distance_mm: touch.distance,
                normal: touch.normal,
                area_mm2: self.areas[element],
                penalty_kpa_per_mm: self.penalty(element, at.shear_kpa),
                closed: pressed || self.opening == Opening::Never,
                rubs: self.has_friction(),
            }
        };
        (0..self.nodes.len()).map(one).collect()
    }

    /// Area that each node covers over its own; empty without a foam.
    fn covered(&self, points: &[Vec3], touch: impl Fn(usize) -> Touch) -> Vec<f64> {
        let Some(foam) = &self.foam else { return Vec::new() };
        let skins = skin_around(points, &foam.faces);
        let one = |(element, node): (usize, &u32)| {
            let out = unit(&touch(element).normal);
            skins.get(node).map_or(0.0, |skin| skin.facing(-out)) / self.areas[element]
        };
        self.nodes.iter().enumerate().map(one).collect()
    }

    fn hold(&self, element: usize, memory: &[f64]) -> Hold {
        Hold::read(&memory[self.nodes.len() + Hold::LENGTH * element..])
    }

    fn holds<'a>(&self, memory: &'a mut [f64]) -> std::slice::ChunksExactMut<'a, f64> {
        memory[self.nodes.len()..].chunks_exact_mut(Hold::LENGTH)
    }

    fn friction(&self, element: usize, at: &At, touch: &Touch) -> Response {
        if !self.has_friction() {
            return Response::NONE;
        }
        let stick = self.penalty(element, at.shear_kpa);
        self.slip.response(&self.hold(element, at.memory), &touch.place, stick)
    }

    /// What is remembered before anything has happened: slip counts from where nodes touch, and the
    /// normal pressure is taken for `pressure` (kPa; infinite when not known).
    pub fn first_memory(
        &self,
        points: &[Vec3],
        pressure: f64,
        touch: impl Fn(usize) -> Touch,
    ) -> Vec<f64> {
        let length = if self.has_friction() { Hold::LENGTH } else { 0 };
        let mut memory = vec![0.0; self.nodes.len() * (1 + length)];
        let covered = self.covered(points, &touch);
        memory[..covered.len()].copy_from_slice(&covered);
        if self.has_friction() {
            for (element, memory) in self.holds(&mut memory).enumerate() {
                let touch = touch(element);
                let normal = unit(&touch.normal);
                Hold::first(pressure, normal, touch.place).write(memory);
            }
        }
        memory
    }

    /// How well the contact holds.
    pub fn check(&self, at: &At, touch: impl Fn(usize) -> Touch) -> ContactCheck {
        let mut check = ContactCheck::default();
        let (mut lag, mut pressing, mut most) = (0.0, f64::MIN_POSITIVE, 0.0);
        let covered = self.covered(at.points, &touch);
        for element in 0..self.nodes.len() {
            let before = lag;
            let touch = touch(element);
            let traction = self.traction(element, at.memory, at.shear_kpa, &touch);
            if let Some(covered) = covered.get(element) {
                // The force is in proportion to the area that is covered.
                let share = covered / at.memory[element].max(f64::MIN_POSITIVE);
                let force = self.areas[element] * traction.abs() * touch.normal.norm();
                lag += force * (share - 1.0).abs();
                pressing += force;
            } else {
                let held = self.opening == Opening::Never || traction < 0.0;
                let open = if held { touch.distance.abs() } else { -touch.distance };
                if open > check.open_mm() {
                    check.worst_open = element;
                }
                check.penetration_mm = check.penetration_mm.max(-touch.distance);
                if held {
                    check.gap_mm = check.gap_mm.max(touch.distance);
                }
            }
            if self.has_friction() {
                let (pressure, normal) = pressure(traction, &touch.normal);
                let hold = self.hold(element, at.memory);
                if self.slip == Slip::Never && hold.pressure > 0.0 {
                    let slip = hold.slip(&touch.place).norm();
                    if slip > check.open_mm() {
                        check.worst_open = element;
                    }
                    check.slip_mm = check.slip_mm.max(slip);
                }
                let exact = hold.exact(pressure, normal);
                let stick = self.penalty(element, at.shear_kpa);
                let exact = self.slip.response(&exact, &touch.place, stick).traction;
                let change = exact - self.friction(element, at, &touch).traction;
                lag += self.areas[element] * change.norm();
                pressing += self.areas[element] * traction.abs() * touch.normal.norm();
            }
            if lag - before > most {
                (most, check.worst_lag) = (lag - before, element);
            }
        }
        check.friction_lag = lag / pressing;
        check
    }

    /// Brings nodes to the distances that a straight step foretells, see [`super::Term::keep_to_surface`].
    pub fn keep_to_surface(
        &self,
        from: &At,
        step: &[Vec3],
        points: &mut [Vec3],
        touch: impl Fn(usize, &[Vec3]) -> Touch,
    ) {
        // A foam is no constraint.
        if self.foam.is_some() {
            return;
        }
        for (element, &node) in self.nodes.iter().enumerate() {
            let node = node as usize;
            let (start, end) = (touch(element, from.points), touch(element, points));
            let foretold = start.distance + start.normal.dot(&step[node]);
            points[node] += self.shift(element, from, start.distance, foretold, &end);
        }
    }

    /// Renews multipliers, areas under a foam, and what friction takes of the normal direction.
    pub fn update(
        &self,
        points: &[Vec3],
        shear_kpa: &[f64],
        memory: &mut [f64],
        touch: impl Fn(usize) -> Touch,
    ) {
        let covered = self.covered(points, &touch);
        memory[..covered.len()].copy_from_slice(&covered);
        for element in 0..self.nodes.len() {
            let touch = touch(element);
            let traction = self.traction(element, memory, shear_kpa, &touch);
            if self.foam.is_none() {
                memory[element] = traction;
            }
            let stick = self.penalty(element, shear_kpa);
            self.renew(element, traction, memory, &touch, stick);
        }
    }

    /// Renews what friction takes of the normal direction, at a traction (kPa), and what a rough surface bears by its
    /// slip, at a stiffness (kPa/mm).
    fn renew(
        &self,
        element: usize,
        traction: f64,
        memory: &mut [f64],
        touch: &Touch,
        stick_kpa_per_mm: f64,
    ) {
        if self.has_friction() {
            let (pressure, normal) = pressure(traction, &touch.normal);
            let mut hold = self.hold(element, memory);
            if self.slip == Slip::Never {
                hold.bear(&touch.place, stick_kpa_per_mm);
            }
            hold.renew(pressure, normal);
            hold.write(&mut memory[self.nodes.len() + Hold::LENGTH * element..][..Hold::LENGTH]);
        }
    }

    /// Ends a load step.
    pub fn accept(&self, memory: &mut [f64], touch: impl Fn(usize) -> Touch) {
        if self.has_friction() {
            for (element, memory) in self.holds(memory).enumerate() {
                let mut hold = Hold::read(memory);
                hold.drag(self.slip, &touch(element).place);
                hold.write(memory);
            }
        }
    }

    /// Makes the reactions balance what of `gradient` (mN, by node) is normal to the surface.
    pub fn react(&self, gradient: &[Vec3], memory: &mut [f64], touch: impl Fn(usize) -> Touch) {
        for element in 0..self.nodes.len() {
            let touch = touch(element);
            let force = gradient[self.nodes[element] as usize].dot(&touch.normal);
            memory[element] = -force / (self.areas[element] * touch.normal.norm_squared());
            self.renew(element, memory[element], memory, &touch, 0.0);
        }
    }

    /// Forces (mN) of the surface on each node that it touches.
    pub fn forces(&self, at: &At, touch: impl Fn(usize) -> Touch) -> Vec<NodeForce> {
        let force = |element: usize| {
            let touch = touch(element);
            let traction = self.traction(element, at.memory, at.shear_kpa, &touch);
            let area = self.areas[element];
            let friction = -area * self.friction(element, at, &touch).traction;
            NodeForce {
                node: self.nodes[element],
                normal: -area * traction * touch.normal,
                friction,
            }
        };
        let touched = |f: &NodeForce| f.normal != Vec3::zeros() || f.friction != Vec3::zeros();
        (0..self.nodes.len()).map(force).filter(touched).collect()
    }
}

/// Pressure (kPa) of a traction along a gradient of the distance, and the unit normal.
fn pressure(traction: f64, gradient: &Vec3) -> (f64, Vec3) {
    ((-traction * gradient.norm()).max(0.0), unit(gradient))
}

fn unit(gradient: &Vec3) -> Vec3 {
    gradient.try_normalize(1e-9).unwrap_or_else(Vec3::zeros)
}
