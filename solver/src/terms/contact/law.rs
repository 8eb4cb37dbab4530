//! What a contact says along the normal of one node: energy, traction, and the arc of a step along the surface.

use super::{Contact, Opening, Touch};
use crate::terms::{At, Block, Curvature, Order};
use mammotwin_data::{Mat3, Vec3};

/// Penalty in units of the tissue's shear modulus over the node's own width.
const PENALTY: f64 = 1000.0;

/// A node that a step brings to the surface lies this deep (mm) beyond where it bears nothing, so
/// that the next step knows of the contact.
const NUDGE_MM: f64 = 1e-4;
/// Square of the gradient of a distance below which it has no direction.
const LEAST_SLOPE: f64 = 1e-6;

/// Along the normal of a node, over its area.
struct Normal {
    /// Energy by area (kPa mm).
    energy: f64,
    /// Traction (kPa), negative where pressed on.
    traction: f64,
    /// Its derivative by the distance (kPa/mm).
    stiffness: f64,
    /// Whether the surface holds the node.
    closed: bool,
}

impl Contact {
    /// Penalty (kPa/mm) of a node.
    pub(super) fn penalty(&self, element: usize, shear_kpa: &[f64]) -> f64 {
        PENALTY * shear_kpa[self.nodes[element] as usize] / self.areas[element].sqrt()
    }

    /// Multiplier (kPa) and stiffness (kPa/mm) along the normal, both over the node's own area.
    fn normal_law(&self, element: usize, memory: &[f64], shear_kpa: &[f64]) -> (f64, f64) {
        match &self.foam {
            Some(foam) => (0.0, foam.stiffness * memory[element]),
            None => (memory[element], self.penalty(element, shear_kpa)),
        }
    }

    /// Traction along the normal (kPa, negative where pressed on).
    pub(super) fn traction(
        &self,
        element: usize,
        memory: &[f64],
        shear_kpa: &[f64],
        touch: &Touch,
    ) -> f64 {
        let (multiplier, stiffness) = self.normal_law(element, memory, shear_kpa);
        let traction = multiplier + stiffness * touch.distance;
        match self.opening {
            Opening::Never => traction,
            Opening::Free => traction.min(0.0),
        }
    }

    fn normal(&self, element: usize, at: &At, touch: &Touch) -> Normal {
        let (multiplier, stiffness) = self.normal_law(element, at.memory, at.shear_kpa);
        let traction = self.traction(element, at.memory, at.shear_kpa, touch);
        let mm = touch.distance;
        let energy = match self.opening {
            Opening::Never => (multiplier + 0.5 * stiffness * mm) * mm,
            Opening::Free => 0.5 * (traction * traction - multiplier * multiplier) / stiffness,
        };
        // What just touches is closed: a body that lies on the surface has a stiffness there.
        let touches = traction < 0.0 || (mm, multiplier) == (0.0, 0.0);
        Normal { energy, traction, stiffness, closed: self.opening == Opening::Never || touches }
    }

    /// Energy of a node on a surface that rests or moves by itself, and its derivatives.
    pub fn block(&self, element: usize, at: &At, order: Order, block: &mut Block, touch: &Touch) {
        let Normal { energy, traction, stiffness, closed } = self.normal(element, at, touch);
        let (area, normal) = (self.areas[element], &touch.normal);
        block.energy = area * energy;
        if closed && order >= Order::Gradient {
            block.gradient[0] = area * traction * normal;
        }
        if closed && order >= Order::Hessian {
            block.hessian[0][0] = area * stiffness * normal * normal.transpose();
            if at.curvature == Curvature::Exact || traction > 0.0 {
                block.hessian[0][0] += area * traction * touch.curvature;
            }
        }
        if self.has_friction() {
            let friction = self.friction(element, at, touch);
            block.energy += area * friction.energy;
            block.gradient[0] += area * friction.traction;
            block.hessian[0][0] += area * friction.stiffness;
        }
    }

    /// The same, without friction, on a surface of the body itself: `slopes` are the derivatives of the distance by
    /// the nodes of the element, `curvature` its second ones (1/mm).
    pub fn shared_block(
        &self,
        element: usize,
        at: &At,
        order: Order,
        block: &mut Block,
        touch: &Touch,
        slopes: &[Vec3],
        curvature: impl Fn(usize, usize) -> Mat3,
    ) {
        let Normal { energy, traction, stiffness, closed } = self.normal(element, at, touch);
        let area = self.areas[element];
        block.energy = area * energy;
        if !closed || order < Order::Gradient {
            return;
        }
        for (gradient, slope) in block.gradient.iter_mut().zip(slopes) {
            *gradient = area * traction * slope;
        }
        if order < Order::Hessian {
            return;
        }
        for r in 0..slopes.len() {
            for s in 0..=r {
                let mut second = stiffness * slopes[r] * slopes[s].transpose();
                if at.curvature == Curvature::Exact {
                    second += traction * curvature(r, s);
                }
                block.hessian[r][s] = area * second;
            }
        }
    }

    /// What brings a node, where it is at the end of a straight step, along the normal to the distance (mm) that the
    /// step foretold from its start, or where nothing was foretold, out of the surface.
    pub fn shift(
        &self,
        element: usize,
        from: &At,
        start_mm: f64,
        foretold_mm: f64,
        end: &Touch,
    ) -> Vec3 {
        let size = end.normal.norm_squared();
        if !(size > LEAST_SLOPE) {
            return Vec3::zeros();
        }
        let wanted = match self.opening {
            Opening::Never => foretold_mm,
            Opening::Free => {
                let (multiplier, stiffness) = self.normal_law(element, from.memory, from.shear_kpa);
                let loose = -multiplier / stiffness;
                if start_mm < loose && foretold_mm < loose {
                    foretold_mm
                } else {
                    end.distance.max(loose - NUDGE_MM)
                }
            }
        };
        (wanted - end.distance) / size * end.normal
    }
}
