//! Suspensory ligaments: cables that pull but never push.
//!
//! With the extension e of a cable of stiffness k, the energy is ½ k e² when taut and 0 when
//! slack; over the first `SMOOTHING` of its length the stiffness rises linearly from 0 to k, so
//! that second derivatives are continuous.

use super::{At, Block, Order, Term};
use crate::materials::MaterialError;
use crate::model::ModelError;
use mammotwin_data::{Mat3, Vec3};

/// Extension over natural length at which a cable is fully taut.
const SMOOTHING: f64 = 1e-3;

/// From a node to a point that does not move.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cable {
    /// Node of the body.
    pub node: u32,
    /// Fixed end (mm).
    pub anchor: Vec3,
    /// Length without force (mm).
    pub natural_mm: f64,
    /// Stiffness EA/L (mN/mm).
    pub stiffness_mn_per_mm: f64,
}

/// All cables of one kind.
#[derive(Debug, Clone)]
pub struct Cables {
    name: String,
    cables: Vec<Cable>,
}

impl Cables {
    /// Cables that act together under one name.
    ///
    /// # Errors
    /// A length or a stiffness that is not positive.
    pub fn new(name: &str, cables: Vec<Cable>) -> Result<Self, ModelError> {
        for cable in &cables {
            for (what, value) in [
                ("natural length (mm)", cable.natural_mm),
                ("stiffness (mN/mm)", cable.stiffness_mn_per_mm),
            ] {
                if !(value > 0.0 && value.is_finite()) {
                    let remedy = "give a positive one";
                    return Err(ModelError::Value { term: name.into(), what, value, remedy });
                }
            }
        }
        Ok(Self { name: name.into(), cables })
    }

    /// Tension of each cable (mN) with the nodes at `points`.
    pub fn tensions(&self, points: &[Vec3]) -> Vec<f64> {
        let tension = |cable: &Cable| {
            let length = (points[cable.node as usize] - cable.anchor).norm();
            cable.response(length).1
        };
        self.cables.iter().map(tension).collect()
    }
}

/// Energy, tension and stiffness of what pulls with a stiffness of one and never pushes: it rises linearly over
/// the first `soft` of the extension.
pub(super) fn taut(extension: f64, soft: f64) -> [f64; 3] {
    if extension <= 0.0 {
        [0.0; 3]
    } else if extension < soft {
        let x = extension / soft;
        [soft * soft * x * x * x / 6.0, 0.5 * soft * x * x, x]
    } else {
        let taut = extension - 0.5 * soft;
        [0.5 * taut * taut + soft * soft / 24.0, taut, 1.0]
    }
}

impl Cable {
    /// Energy, tension and stiffness at a length.
    fn response(&self, length: f64) -> (f64, f64, f64) {
        let [e, t, s] = taut(length - self.natural_mm, SMOOTHING * self.natural_mm);
        let k = self.stiffness_mn_per_mm;
        (k * e, k * t, k * s)
    }
}

impl Term for Cables {
    fn name(&self) -> &str {
        &self.name
    }

    fn elements(&self) -> usize {
        self.cables.len()
    }

    fn nodes(&self, element: usize) -> &[u32] {
        std::slice::from_ref(&self.cables[element].node)
    }

    fn ties(&self) -> bool {
        true
    }

    fn block(
        &self,
        element: usize,
        at: &At,
        order: Order,
        block: &mut Block,
    ) -> Result<(), MaterialError> {
        let cable = &self.cables[element];
        let arm = at.points[cable.node as usize] - cable.anchor;
        let length = arm.norm();
        let (energy, tension, stiffness) = cable.response(length);
        block.energy = energy;
        if order >= Order::Gradient && tension > 0.0 {
            let along = arm / length;
            let outer = along * along.transpose();
            block.gradient[0] = tension * along;
            block.hessian[0][0] = stiffness * outer + tension / length * (Mat3::identity() - outer);
        }
        Ok(())
    }
}
