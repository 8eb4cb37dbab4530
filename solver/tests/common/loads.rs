//! Loads that only tests need.

#![allow(dead_code)]

use mammotwin_data::Vec3;
use mammotwin_solver::materials::MaterialError;
use mammotwin_solver::terms::{At, Block, Load, Order, Term};

/// Forces that keep their direction.
pub struct DeadForces {
    nodes: Vec<u32>,
    forces: Vec<Vec3>,
}

impl DeadForces {
    /// Forces (mN) on nodes.
    pub fn new(forces: impl IntoIterator<Item = (u32, Vec3)>) -> Self {
        let (nodes, forces) = forces.into_iter().unzip();
        Self { nodes, forces }
    }
}

impl Term for DeadForces {
    fn name(&self) -> &str {
        "forces"
    }

    fn elements(&self) -> usize {
        self.nodes.len()
    }

    fn nodes(&self, element: usize) -> &[u32] {
        &self.nodes[element..=element]
    }

    fn block(
        &self,
        element: usize,
        at: &At,
        order: Order,
        block: &mut Block,
    ) -> Result<(), MaterialError> {
        let force = at.load.gravity * self.forces[element];
        block.energy = -force.dot(&at.points[self.nodes[element] as usize]);
        if order >= Order::Gradient {
            block.gradient[0] = -force;
        }
        Ok(())
    }
}

/// Pressure in a cavity around the origin, of which `faces` are a part, pointing out of it: the
/// energy is minus the pressure times the volume between the faces and the origin.
pub struct Cavity {
    pub faces: Vec<[u32; 3]>,
    pub pressure_kpa: f64,
}

impl Term for Cavity {
    fn name(&self) -> &str {
        "cavity"
    }

    fn elements(&self) -> usize {
        self.faces.len()
    }

    fn nodes(&self, element: usize) -> &[u32] {
        &self.faces[element]
    }

    fn block(
        &self,
        element: usize,
        at: &At,
        order: Order,
        block: &mut Block,
    ) -> Result<(), MaterialError> {
        let [a, b, c] = self.faces[element].map(|n| at.points[n as usize]);
        let p = at.load.gravity * self.pressure_kpa / 6.0;
        block.energy = -p * a.dot(&b.cross(&c));
        if order >= Order::Gradient {
            block.gradient[..3].copy_from_slice(&[
                -p * b.cross(&c),
                -p * c.cross(&a),
                -p * a.cross(&b),
            ]);
        }
        if order >= Order::Hessian {
            // d(a × b) = a × db - b × da.
            block.hessian[1][0] = -p * c.cross_matrix();
            block.hessian[2][0] = p * b.cross_matrix();
            block.hessian[2][1] = -p * a.cross_matrix();
        }
        Ok(())
    }
}

/// Forces that keep their direction and grow with the place of the receptor: full at 1 mm.
pub struct Pull(pub DeadForces);

impl Term for Pull {
    fn name(&self) -> &str {
        "pull"
    }

    fn elements(&self) -> usize {
        self.0.elements()
    }

    fn nodes(&self, element: usize) -> &[u32] {
        self.0.nodes(element)
    }

    fn block(
        &self,
        element: usize,
        at: &At,
        order: Order,
        block: &mut Block,
    ) -> Result<(), MaterialError> {
        let load = Load { gravity: at.load.receptor_mm, ..at.load };
        self.0.block(element, &At { load, ..*at }, order, block)
    }
}
