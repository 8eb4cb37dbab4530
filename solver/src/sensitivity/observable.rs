//! What an equilibrium is asked for, as linear functions of its changes.

use super::{Change, Linearised, Response, SensitivityError};
use crate::terms::{Block, Order};
use mammotwin_data::Vec3;
use std::ops::Range;

/// A number that an equilibrium has.
#[derive(Debug, Clone, PartialEq)]
pub enum Observable {
    /// Sum of the positions (mm) of all nodes, each weighted with its vector.
    Position(Vec<Vec3>),
    /// Force (mN) of a term on the body, along a vector.
    Force {
        /// Name of the term.
        term: String,
        /// The vector.
        along: Vec3,
    },
    /// Force (mN) of all fixed nodes' supports on the body, along a vector.
    Support(Vec3),
    /// Volume (mm³) of some tetrahedra.
    Volume(Vec<[u32; 4]>),
}

/// An observable as a linear function of a response, and what it has of θ itself.
pub(super) struct Functional {
    pub moved: Vec<Vec3>,
    pub pressure: Vec<f64>,
    pub traction: Vec<f64>,
    /// Weights of the forces of the terms from the first to the last.
    explicit: Option<(Range<usize>, Vec<Vec3>)>,
}

impl Functional {
    /// Its part through the response.
    pub fn of(&self, response: &Response) -> f64 {
        let moved = self.moved.iter().zip(&response.moved).map(|(w, u)| w.dot(u));
        let pressure = self.pressure.iter().zip(&response.pressure).map(|(w, p)| w * p);
        let traction = self.traction.iter().zip(&response.traction).map(|(w, t)| w * t);
        moved.sum::<f64>() + pressure.sum::<f64>() + traction.sum::<f64>()
    }

    /// Its part at fixed nodes, pressures and tractions.
    pub fn explicit(&self, change: &Change) -> f64 {
        let Some((terms, weights)) = &self.explicit else { return 0.0 };
        let gradients = change.gradients[terms.clone()].iter();
        gradients.flat_map(|g| g.iter().zip(weights)).map(|(g, w)| g.dot(w)).sum()
    }
}

impl Linearised<'_> {
    /// The linear function that an observable is.
    pub(super) fn functional(
        &self,
        observable: &Observable,
    ) -> Result<Functional, SensitivityError> {
        let nodes = self.state.points.len();
        let mut functional = Functional {
            moved: vec![Vec3::zeros(); nodes],
            pressure: vec![0.0; nodes],
            traction: vec![0.0; self.closed.len()],
            explicit: None,
        };
        match observable {
            Observable::Position(weights) => functional.moved.clone_from(weights),
            Observable::Volume(tets) => {
                for tet in tets {
                    let gradient = volume_gradient(&self.state.points, tet);
                    for (&n, by) in tet.iter().zip(gradient) {
                        functional.moved[n as usize] += by;
                    }
                }
            }
            Observable::Force { term, along } => {
                let named = self.model.terms().iter().position(|t| t.name() == term);
                let index = named.ok_or_else(|| SensitivityError::NoTerm(term.clone()))?;
                // A force is minus the gradient of the energy.
                self.forces(index..index + 1, vec![-along; nodes], &mut functional);
            }
            Observable::Support(along) => {
                let held = |(node, along): (usize, &Vec3)| {
                    let of = |axis: usize| {
                        if self.assembly.is_free(node, axis) { 0.0 } else { along[axis] }
                    };
                    Vec3::new(of(0), of(1), of(2))
                };
                let weights = vec![*along; nodes].iter().enumerate().map(held).collect();
                self.forces(0..self.memories(), weights, &mut functional);
            }
        }
        Ok(functional)
    }

    /// Makes a functional that of the weighted gradients of some terms: their second derivatives
    /// times the weights, by symmetry.
    fn forces(&self, terms: Range<usize>, weights: Vec<Vec3>, functional: &mut Functional) {
        let mut block = Block::ZERO;
        for index in terms.clone() {
            let term = &self.model.terms()[index];
            for element in 0..term.elements() {
                let nodes = term.nodes(element);
                block.clear(nodes.len());
                // The state is admissible: its tangent was assembled.
                if term.block(element, &self.state.at(index), Order::Hessian, &mut block).is_err() {
                    continue;
                }
                for (a, &row) in nodes.iter().enumerate() {
                    for (b, &column) in nodes[..=a].iter().enumerate() {
                        let part = &block.hessian[a][b];
                        functional.moved[row as usize] += part * weights[column as usize];
                        if a != b {
                            functional.moved[column as usize] +=
                                part.transpose() * weights[row as usize];
                        }
                    }
                }
                if term.is_mixed() {
                    let swelling = |(a, &n): (usize, &u32)| {
                        block.dilatation_gradient[a].dot(&weights[n as usize])
                    };
                    let swelling: f64 = nodes.iter().enumerate().map(swelling).sum();
                    for &n in nodes {
                        functional.pressure[n as usize] += swelling;
                    }
                }
            }
        }
        for (traction, (index, contact)) in functional.traction.iter_mut().zip(&self.closed) {
            if terms.contains(index) {
                let weight = weights[contact.node as usize];
                *traction += contact.area_mm2 * contact.normal.dot(&weight);
            }
        }
        functional.explicit = Some((terms, weights));
    }
}

/// ∂(volume)/∂(position) of a tetrahedron's nodes (mm²).
fn volume_gradient(points: &[Vec3], tet: &[u32; 4]) -> [Vec3; 4] {
    let [a, b, c, d] = tet.map(|n| points[n as usize]);
    let (b, c, d) = (b - a, c - a, d - a);
    let others = [c.cross(&d) / 6.0, d.cross(&b) / 6.0, b.cross(&c) / 6.0];
    [-others.iter().sum::<Vec3>(), others[0], others[1], others[2]]
}
