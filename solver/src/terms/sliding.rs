//! Two-sided contact without separation: a surface of the body glides on a smooth target.
//!
//! Every node of the surface stands for its share of the area. Its distance d is driven to zero
//! by an augmented Lagrangian, A (λ d + ½ k d²) per node with the multiplier λ (kPa, positive
//! where the surface is held back, negative where it is pressed on). The penalty k only sets the
//! speed: the multipliers are updated until the gap is below tolerance (Wriggers, *Computational
//! contact mechanics* (2006), § 10.3).

use super::{At, Block, ContactCheck, Curvature, Load, Order, Term, target::Target};
use crate::materials::MaterialError;
use crate::model::ModelError;
use mammotwin_data::{Mat3, Vec3};
use std::{collections::BTreeMap, sync::Arc};

/// Penalty in units of the tissue's shear modulus over the node's own width.
const PENALTY: f64 = 1000.0;

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

/// Penalty (kPa/mm) of a contact node.
pub(crate) fn penalty_kpa_per_mm(shear_kpa: f64, area_mm2: f64) -> f64 {
    PENALTY * shear_kpa / area_mm2.sqrt()
}

/// A surface that glides on a target and never leaves it.
#[derive(Clone)]
pub struct Sliding {
    name: String,
    nodes: Vec<u32>,
    /// Area of each node (mm²).
    areas: Vec<f64>,
    target: Arc<dyn Target>,
}

impl Sliding {
    /// Glides the nodes of `faces` on `target`; areas are taken with the nodes at `points` (mm).
    ///
    /// # Errors
    /// A friction coefficient other than zero: friction is not available yet.
    pub fn new(
        name: &str,
        points: &[Vec3],
        faces: &[[u32; 3]],
        target: Arc<dyn Target>,
        friction: f64,
    ) -> Result<Self, ModelError> {
        if friction != 0.0 {
            return Err(ModelError::Value {
                term: name.into(),
                what: "friction coefficient",
                value: friction,
                remedy: "sliding is frictionless so far; set it to 0",
            });
        }
        let areas = node_areas(points, faces);
        let (nodes, areas) = areas.into_iter().filter(|&(_, area)| area > 0.0).unzip();
        Ok(Self { name: name.into(), nodes, areas, target })
    }

    fn distance(&self, element: usize, points: &[Vec3]) -> (f64, Vec3, Mat3) {
        self.target.distance(&points[self.nodes[element] as usize])
    }

    fn penalty(&self, element: usize, shear_kpa: &[f64]) -> f64 {
        penalty_kpa_per_mm(shear_kpa[self.nodes[element] as usize], self.areas[element])
    }
}

impl Term for Sliding {
    fn name(&self) -> &str {
        &self.name
    }

    fn elements(&self) -> usize {
        self.nodes.len()
    }

    fn nodes(&self, element: usize) -> &[u32] {
        std::slice::from_ref(&self.nodes[element])
    }

    fn block(
        &self,
        element: usize,
        at: &At,
        order: Order,
        block: &mut Block,
    ) -> Result<(), MaterialError> {
        let (distance, normal, curvature) = self.distance(element, at.points);
        let (area, multiplier) = (self.areas[element], at.memory[element]);
        let penalty = self.penalty(element, at.shear_kpa);
        let traction = multiplier + penalty * distance;
        block.energy = area * (multiplier + 0.5 * penalty * distance) * distance;
        if order >= Order::Gradient {
            block.gradient[0] = area * traction * normal;
        }
        if order >= Order::Hessian {
            block.hessian[0][0] = area * penalty * normal * normal.transpose();
            if at.curvature == Curvature::Exact || traction > 0.0 {
                block.hessian[0][0] += area * traction * curvature;
            }
        }
        Ok(())
    }

    fn first_memory(&self, _points: &[Vec3]) -> Vec<f64> {
        vec![0.0; self.nodes.len()]
    }

    fn contact(&self, at: &At) -> Option<ContactCheck> {
        let mut check = ContactCheck::default();
        for element in 0..self.nodes.len() {
            let distance = self.distance(element, at.points).0;
            check.gap_mm = check.gap_mm.max(distance);
            check.penetration_mm = check.penetration_mm.max(-distance);
        }
        Some(check)
    }

    fn update_multipliers(
        &self,
        points: &[Vec3],
        shear_kpa: &[f64],
        _load: Load,
        memory: &mut [f64],
    ) {
        for (element, multiplier) in memory.iter_mut().enumerate() {
            *multiplier += self.penalty(element, shear_kpa) * self.distance(element, points).0;
        }
    }

    fn surface(&self) -> Option<&dyn Target> {
        Some(self.target.as_ref())
    }

    fn react(&self, points: &[Vec3], gradient: &[Vec3], memory: &mut [f64]) {
        for (element, multiplier) in memory.iter_mut().enumerate() {
            let normal = self.distance(element, points).1;
            let force = gradient[self.nodes[element] as usize].dot(&normal);
            *multiplier = -force / (self.areas[element] * normal.norm_squared());
        }
    }
}
