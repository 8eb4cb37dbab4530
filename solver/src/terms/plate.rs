//! Frictionless one-sided contact of the skin with a rigid plate.
//!
//! Every node stands for its share of the skin's rest area A. With the distance d from the plate
//! and the multiplier λ >= 0 (kPa), the energy is A/(2k) (max(0, λ - k d)² - λ²): the augmented
//! Lagrangian of d >= 0 (Wriggers, *Computational contact mechanics* (2006), § 6.3). The penalty k
//! only sets the speed; multipliers are updated until the penetration is below tolerance.

use super::sliding::{node_areas, penalty_kpa_per_mm};
use super::{At, Block, ContactCheck, Curvature, Load, Order, Term};
use crate::materials::MaterialError;
use crate::paddles::RoundedPlate;
use mammotwin_data::{Mat3, Vec3};

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
    nodes: Vec<u32>,
    /// Rest area of each node (mm²).
    areas: Vec<f64>,
}

impl Plate {
    /// A plate that touches `faces`; areas are taken with the nodes at `points` (mm).
    pub fn new(kind: PlateKind, shape: RoundedPlate, points: &[Vec3], faces: &[[u32; 3]]) -> Self {
        let areas = node_areas(points, faces);
        let (nodes, areas) = areas.into_iter().filter(|&(_, area)| area > 0.0).unzip();
        Self { kind, shape, nodes, areas }
    }

    /// The same plate, which leaves some nodes alone.
    pub fn without(mut self, left_alone: impl Fn(u32) -> bool) -> Self {
        let touched = |n: &u32| !left_alone(*n);
        let areas = self.nodes.iter().zip(&self.areas).filter(|(n, _)| touched(n));
        self.areas = areas.map(|(_, area)| *area).collect();
        self.nodes.retain(touched);
        self
    }

    fn distance(&self, element: usize, points: &[Vec3], load: &Load) -> (f64, Vec3, Mat3) {
        let level = match self.kind {
            PlateKind::Receptor => -load.receptor_mm,
            PlateKind::Paddle => load.receptor_mm + load.thickness_mm,
        };
        self.shape.distance(&points[self.nodes[element] as usize], level)
    }

    fn penalty(&self, element: usize, shear_kpa: &[f64]) -> f64 {
        penalty_kpa_per_mm(shear_kpa[self.nodes[element] as usize], self.areas[element])
    }

    /// Contact pressure on the rest area (kPa) with the distance, its gradient and curvature.
    fn pressure(&self, element: usize, at: &At) -> (f64, Vec3, Mat3) {
        let (distance, normal, curvature) = self.distance(element, at.points, &at.load);
        let penalty = self.penalty(element, at.shear_kpa);
        ((at.memory[element] - penalty * distance).max(0.0), normal, curvature)
    }

    /// Force (mN) of the plate on each node that it touches.
    pub fn node_forces(&self, at: &At) -> Vec<(u32, Vec3)> {
        let force = |element: usize| {
            let (pressure, normal, _) = self.pressure(element, at);
            (self.nodes[element], self.areas[element] * pressure * normal)
        };
        let touched = (0..self.nodes.len()).map(force);
        touched.filter(|(_, force)| *force != Vec3::zeros()).collect()
    }
}

impl Term for Plate {
    fn name(&self) -> &str {
        match self.kind {
            PlateKind::Receptor => "receptor",
            PlateKind::Paddle => "paddle",
        }
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
        let (pressure, normal, curvature) = self.pressure(element, at);
        let (area, multiplier) = (self.areas[element], at.memory[element]);
        let penalty = self.penalty(element, at.shear_kpa);
        block.energy = 0.5 * area * (pressure * pressure - multiplier * multiplier) / penalty;
        if pressure > 0.0 && order >= Order::Gradient {
            block.gradient[0] = -area * pressure * normal;
            block.hessian[0][0] = area * penalty * normal * normal.transpose();
            if at.curvature == Curvature::Exact {
                block.hessian[0][0] -= area * pressure * curvature;
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
            let distance = self.distance(element, at.points, &at.load).0;
            check.penetration_mm = check.penetration_mm.max(-distance);
            if self.pressure(element, at).0 > 0.0 {
                check.gap_mm = check.gap_mm.max(distance);
            }
        }
        Some(check)
    }

    fn update_multipliers(
        &self,
        points: &[Vec3],
        shear_kpa: &[f64],
        load: Load,
        memory: &mut [f64],
    ) {
        for (element, multiplier) in memory.iter_mut().enumerate() {
            let push = self.penalty(element, shear_kpa) * self.distance(element, points, &load).0;
            *multiplier = (*multiplier - push).max(0.0);
        }
    }
}
