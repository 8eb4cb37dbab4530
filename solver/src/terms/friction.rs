//! Coulomb friction as a potential: slip costs energy.
//!
//! For a normal pressure p and a tangent plane that are held while the energy is minimised,
//! friction is the convex potential μ p f(|s|) of the slip s in that plane, with f quadratic and
//! cubic below [`SMOOTHING_MM`] and straight beyond, so that second derivatives are continuous
//! (Li et al., *ACM Trans. Graph.* 39 (2020) 49, <https://doi.org/10.1145/3386569.3392425>). The
//! pressure, max(0, -tₙ), and the plane lag behind: they are renewed after each minimum until
//! the forces of friction change no more. A surface that is held back carries none.
//!
//! A rough surface ([`Slip::Never`]) has no limit: a multiplier along it is updated, as that of the normal direction is,
//! until the slip is below tolerance, and its anchor stays.
//!
//! Slip counts from an anchor on the target. Else a node sticks within [`SMOOTHING_MM`] of its anchor;
//! one that slipped in a load step drags it along at that distance. Friction is so continued from
//! step to step, without creep, and depends on the path alone.

use mammotwin_data::{Mat3, Vec3};

/// Slip (mm) at which friction reaches its limit; nodes that stick move by less.
pub const SMOOTHING_MM: f64 = 0.05;

/// What a contact does along its surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Slip {
    /// Slips without resistance.
    Free,
    /// Slips where the tangential traction reaches this coefficient times the normal pressure.
    Coulomb(f64),
    /// Does not slip where it is pressed on.
    Never,
}

/// What a node remembers of its friction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Hold {
    /// Normal pressure (kPa) that lags behind; infinite while it is not known: then nodes stick.
    pub pressure: f64,
    /// Unit normal of the tangent plane, which lags behind, too.
    pub normal: Vec3,
    /// Place on the target (mm) from which slip counts.
    pub anchor: Vec3,
    /// Last change of the pressure at this load (kPa).
    change: f64,
    /// Multiplier along the surface (kPa): traction of a rough one without slip.
    pull: Vec3,
}

/// Energy (kPa mm), traction (kPa) and stiffness (kPa/mm) of friction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Response {
    pub energy: f64,
    pub traction: Vec3,
    pub stiffness: Mat3,
}

impl Response {
    pub const NONE: Self =
        Self { energy: 0.0, traction: Vec3::new(0.0, 0.0, 0.0), stiffness: NO_STIFFNESS };
}

const NO_STIFFNESS: Mat3 = Mat3::new(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0);

impl Hold {
    /// Numbers of a node in the memory of its term.
    pub const LENGTH: usize = 11;

    /// Before anything has happened.
    pub fn first(pressure: f64, normal: Vec3, anchor: Vec3) -> Self {
        Self { pressure, normal, anchor, change: 0.0, pull: Vec3::zeros() }
    }

    /// From [`Hold::LENGTH`] numbers.
    pub fn read(memory: &[f64]) -> Self {
        let vector = |at: usize| Vec3::new(memory[at], memory[at + 1], memory[at + 2]);
        Self {
            pressure: memory[0],
            normal: vector(1),
            anchor: vector(4),
            change: memory[7],
            pull: vector(8),
        }
    }

    /// Into [`Hold::LENGTH`] numbers.
    pub fn write(&self, memory: &mut [f64]) {
        memory[0] = self.pressure;
        memory[1..4].copy_from_slice(self.normal.as_slice());
        memory[4..7].copy_from_slice(self.anchor.as_slice());
        memory[7] = self.change;
        memory[8..11].copy_from_slice(self.pull.as_slice());
    }

    /// Slip (mm) of a node at `place` on the target.
    pub fn slip(&self, place: &Vec3) -> Vec3 {
        along(&self.normal, place - self.anchor)
    }

    /// The same with pressure and plane as they are now.
    pub fn exact(&self, pressure: f64, normal: Vec3) -> Self {
        Self { pressure, normal, pull: along(&normal, self.pull), ..*self }
    }

    /// Lets the multiplier of a rough surface bear what the slip of a node at `place` bears, at a stiffness (kPa/mm); one
    /// that was not pressed on bore nothing.
    pub fn bear(&mut self, place: &Vec3, stick_kpa_per_mm: f64) {
        if self.pressure > 0.0 {
            self.pull += stick_kpa_per_mm * self.slip(place);
        }
    }

    /// Renews pressure and plane; a pressure that goes to and fro goes half the way.
    pub fn renew(&mut self, pressure: f64, normal: Vec3) {
        let change = pressure - self.pressure;
        let part = if change * self.change < 0.0 { 0.5 } else { 1.0 };
        let known = change.is_finite();
        self.change = if known { part * change } else { 0.0 };
        self.pressure = if known { self.pressure + self.change } else { pressure };
        self.normal = normal;
        self.pull = if self.pressure > 0.0 { along(&normal, self.pull) } else { Vec3::zeros() };
    }

    /// Drags the anchor behind a node that is now at `place`, on a rough surface only one that is not pressed on.
    pub fn drag(&mut self, slip: Slip, place: &Vec3) {
        self.change = 0.0;
        if !(self.pressure > 0.0) {
            self.anchor = *place;
            return;
        }
        let is_rough = slip == Slip::Never;
        let slip = self.slip(place);
        let length = slip.norm();
        if !is_rough && length > SMOOTHING_MM {
            self.anchor = place - SMOOTHING_MM / length * slip;
        }
    }
}

/// The part of a vector in the plane of a unit normal.
fn along(normal: &Vec3, vector: Vec3) -> Vec3 {
    vector - normal * normal.dot(&vector)
}

impl Slip {
    /// The response of a node at `place` on the target, on its area of one; `stick_kpa_per_mm` is
    /// the stiffness where it does not slip.
    pub(super) fn response(self, hold: &Hold, place: &Vec3, stick_kpa_per_mm: f64) -> Response {
        let limit = match self {
            Self::Free => return Response::NONE,
            _ if !(hold.pressure > 0.0) => return Response::NONE,
            Self::Coulomb(friction) if hold.pressure.is_finite() => friction * hold.pressure,
            Self::Coulomb(_) | Self::Never => f64::INFINITY,
        };
        let slip = hold.slip(place);
        let plane = Mat3::identity() - hold.normal * hold.normal.transpose();
        if limit.is_infinite() {
            let k = stick_kpa_per_mm;
            let energy = hold.pull.dot(&slip) + 0.5 * k * slip.norm_squared();
            return Response { energy, traction: hold.pull + k * slip, stiffness: k * plane };
        }
        let (y, e) = (slip.norm(), SMOOTHING_MM);
        // Energy, slope over the slip, and curvature of f.
        let (f, secant, tangent) = if y < e {
            (y * y / e - y * y * y / (3.0 * e * e), (2.0 - y / e) / e, 2.0 * (1.0 - y / e) / e)
        } else {
            (y - e / 3.0, 1.0 / y, 0.0)
        };
        let along = if y > 0.0 { slip / y } else { Vec3::zeros() };
        let stiffness = secant * plane + (tangent - secant) * along * along.transpose();
        Response {
            energy: limit * f,
            traction: limit * secant * slip,
            stiffness: limit * stiffness,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_node_sticks_slips_and_drags_its_anchor() {
        let law = Slip::Coulomb(0.3);
        let mut hold = Hold::first(2.0, Vec3::z(), Vec3::zeros());
        let force = |hold: &Hold, x: f64| law.response(hold, &Vec3::new(x, 0.0, 0.4), 1e3).traction;
        assert!(force(&hold, 0.2 * SMOOTHING_MM).x < 0.6 && force(&hold, 0.0).x == 0.0);
        assert!((force(&hold, 7.0) - Vec3::new(0.6, 0.0, 0.0)).norm() < 1e-14);
        hold.drag(law, &Vec3::new(7.0, 0.0, 0.4));
        // The same traction where the step ended, and the opposite one after a way back.
        assert!((force(&hold, 7.0).x - 0.6).abs() < 1e-12);
        assert!((force(&hold, 7.0 - 2.0 * SMOOTHING_MM).x + 0.6).abs() < 1e-12);
        let mut stuck = hold;
        stuck.drag(law, &Vec3::new(7.0 - 0.5 * SMOOTHING_MM, 0.0, 0.4));
        assert_eq!(stuck.anchor, hold.anchor);
    }

    #[test]
    fn a_rough_surface_keeps_its_anchor_and_bears_without_slip() {
        let (law, stick) = (Slip::Never, 10.0);
        let mut hold = Hold::first(2.0, Vec3::z(), Vec3::zeros());
        let place = Vec3::new(0.3, 0.0, 0.4);
        let before = law.response(&hold, &place, stick).traction;
        hold.drag(law, &place);
        assert_eq!(hold.anchor, Vec3::zeros());
        assert_eq!(law.response(&hold, &place, stick).traction, before);
        hold.bear(&place, stick);
        hold.renew(1.5, Vec3::z());
        assert_eq!(law.response(&hold, &Vec3::zeros(), stick).traction, before);
        // Where it is not pressed on it bears nothing, and begins anew.
        hold.renew(0.0, Vec3::z());
        assert_eq!(law.response(&hold, &place, stick), Response::NONE);
        hold.drag(law, &place);
        assert_eq!((hold.anchor, hold.pull), (place, Vec3::zeros()));
        // The way that it went then is none that the surface held back.
        hold.bear(&Vec3::new(2.0, 0.0, 0.4), stick);
        hold.renew(1.5, Vec3::z());
        assert_eq!(hold.pull, Vec3::zeros());
    }

    #[test]
    fn a_surface_that_is_held_back_carries_none() {
        let hold = Hold::first(0.0, Vec3::z(), Vec3::zeros());
        for law in [Slip::Free, Slip::Coulomb(0.5), Slip::Never] {
            assert_eq!(law.response(&hold, &Vec3::x(), 1e3), Response::NONE);
        }
    }

    #[test]
    fn the_memory_of_a_node_reads_back() {
        let pull = Vec3::new(0.5, -2.0, 3.0);
        let hold = Hold { pressure: 2.0, normal: Vec3::z(), anchor: Vec3::x(), change: -1.0, pull };
        let mut memory = [0.0; Hold::LENGTH];
        hold.write(&mut memory);
        assert_eq!(Hold::read(&memory), hold);
    }

    #[test]
    fn a_pressure_that_swings_settles() {
        // A pressure that answers to friction with more than its own change.
        let mut hold = Hold::first(f64::INFINITY, Vec3::z(), Vec3::zeros());
        hold.renew(2.0, Vec3::z());
        for _ in 0..20 {
            hold.renew(1.0 - 1.3 * (hold.pressure - 1.0), Vec3::z());
        }
        assert!((hold.pressure - 1.0).abs() < 1e-6, "{}", hold.pressure);
    }
}
