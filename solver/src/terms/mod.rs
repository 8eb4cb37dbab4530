//! Energy terms: each physical effect is one term, and equilibrium is the minimum of their sum.
//!
//! A term is a list of *elements* that touch one to ten nodes each. It gives the energy of an
//! element with its derivatives with respect to the node positions; the model sums them. A term
//! of nearly incompressible tissue gives its dilatation besides (see [`bulk`]).

pub mod bulk;
pub mod cable;
pub mod contact;
pub mod fibres;
pub mod friction;
pub mod gliding;
pub mod gravity;
pub mod grid_distance;
pub mod membrane;
pub mod plate;
pub mod quadratic;
pub mod quadratic_membrane;
pub mod self_contact;
mod sheet;
pub mod sliding;
mod solid;
mod stretched;
pub mod target;
pub mod testing;
#[cfg(test)]
mod tests;

pub use bulk::Bulk;
pub use cable::{Cable, Cables};
pub use contact::{NodeForce, Opening, Touching};
pub use fibres::Fibres;
pub use friction::Slip;
pub use gliding::{Front, Gliding};
pub use gravity::Gravity;
pub use grid_distance::GridDistance;
pub use membrane::Membrane;
pub use quadratic::QuadraticBulk;
pub use quadratic_membrane::QuadraticMembrane;
pub use self_contact::SelfContact;
pub use sliding::Sliding;
pub use target::Target;

use crate::{
    materials::MaterialError,
    paddles::{AT_REST, Pose},
};
use mammotwin_data::{Mat3, Vec3, solution::Solution};
use nalgebra::{DMatrix, SMatrix};
use std::sync::Arc;

/// What is switched on, and how far, at one moment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Load {
    /// Fraction of gravity, 0..=1.
    pub gravity: f64,
    /// Position of the receptor along the direction of compression (mm).
    pub receptor_mm: f64,
    /// Distance of the plates (mm); at its hinge for a paddle that tilts.
    pub thickness_mm: f64,
    /// Tilt of the paddle (rad), positive when the side of the nipple sinks.
    pub tilt_rad: f64,
    /// Coordinates of a paddle that is not a flat rigid plate.
    pub pose: Pose,
}

impl Load {
    /// All of gravity and no plate near.
    pub const GRAVITY: Self =
        Self { gravity: 1.0, receptor_mm: -1e6, thickness_mm: 2e6, tilt_rad: 0.0, pose: AT_REST };

    /// Part of the way from one load to another.
    pub fn between(from: Self, to: Self, part: f64) -> Self {
        let mix = |a: f64, b: f64| if part >= 1.0 { b } else { a + part * (b - a) };
        Self {
            gravity: mix(from.gravity, to.gravity),
            receptor_mm: mix(from.receptor_mm, to.receptor_mm),
            thickness_mm: mix(from.thickness_mm, to.thickness_mm),
            tilt_rad: mix(from.tilt_rad, to.tilt_rad),
            pose: std::array::from_fn(|n| mix(from.pose[n], to.pose[n])),
        }
    }
}

/// The moment at which a term is evaluated.
#[derive(Debug, Clone, Copy)]
pub struct At<'a> {
    /// Node positions (mm).
    pub points: &'a [Vec3],
    /// Nodal pressure of the dilatation (kPa), positive in tension.
    pub pressure: &'a [f64],
    /// What the term remembers: multipliers, history.
    pub memory: &'a [f64],
    /// Shear modulus (kPa) of the tissue at each node; scales penalties.
    pub shear_kpa: &'a [f64],
    /// What is switched on.
    pub load: Load,
    /// Which second derivatives are wanted.
    pub curvature: Curvature,
}

/// Which second derivatives a term gives.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Curvature {
    /// As they are.
    Exact,
    /// Contacts leave out what makes them unstable: the curvature of a target that is pressed on.
    Convex,
    /// As `Convex`, and every element without its negative eigenvalues.
    Projected,
}

/// How much of a block is wanted; each order includes the ones before.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Order {
    /// Energy and dilatation.
    Value,
    /// First derivatives.
    Gradient,
    /// Second derivatives.
    Hessian,
}

/// Most nodes of an element.
const MOST_NODES: usize = 10;

/// Energy of one element and its derivatives, for up to ten nodes.
#[derive(Debug, Clone, Copy)]
pub struct Block {
    /// Energy (µJ).
    pub energy: f64,
    /// ∂energy/∂position (mN), by node.
    pub gradient: [Vec3; MOST_NODES],
    /// Second derivatives (mN/mm).
    pub hessian: Triangle,
    /// ∫ θ N dV of each node (mm³): the same for all nodes of a linear tetrahedron.
    pub dilatation: f64,
    /// ∂dilatation/∂position (mm²).
    pub dilatation_gradient: [Vec3; 4],
}

/// The blocks of a symmetric matrix with column <= row, row after row: `triangle[row][column]`.
#[derive(Debug, Clone, Copy)]
pub struct Triangle([Mat3; MOST_NODES * (MOST_NODES + 1) / 2]);

impl std::ops::Index<usize> for Triangle {
    type Output = [Mat3];

    #[inline]
    fn index(&self, row: usize) -> &[Mat3] {
        &self.0[row * (row + 1) / 2..][..=row]
    }
}

impl std::ops::IndexMut<usize> for Triangle {
    #[inline]
    fn index_mut(&mut self, row: usize) -> &mut [Mat3] {
        &mut self.0[row * (row + 1) / 2..][..=row]
    }
}

impl Block {
    /// All zero.
    pub const ZERO: Self = Self {
        energy: 0.0,
        gradient: [ZERO3; MOST_NODES],
        hessian: Triangle([ZERO33; MOST_NODES * (MOST_NODES + 1) / 2]),
        dilatation: 0.0,
        dilatation_gradient: [ZERO3; 4],
    };

    /// Makes the second derivatives between `nodes` nodes positive semi-definite by raising negative
    /// eigenvalues to zero.
    pub fn project(&mut self, nodes: usize) {
        let whole = DMatrix::from_fn(3 * nodes, 3 * nodes, |r, c| {
            let (r, c) = if r >= c { (r, c) } else { (c, r) };
            self.hessian[r / 3][c / 3][(r % 3, c % 3)]
        });
        // An eigenvalue iteration would not end on a NaN.
        if !whole.iter().all(|v| v.is_finite()) {
            return;
        }
        let mut eigen = whole.symmetric_eigen();
        if eigen.eigenvalues.min() >= 0.0 {
            return;
        }
        eigen.eigenvalues.apply(|v| *v = v.max(0.0));
        let whole = eigen.recompose();
        for a in 0..nodes {
            for b in 0..=a {
                self.hessian[a][b] = whole.fixed_view::<3, 3>(3 * a, 3 * b).into_owned();
            }
        }
    }

    /// Makes the part zero that an element of `nodes` nodes uses.
    pub fn clear(&mut self, nodes: usize) {
        (self.energy, self.dilatation) = (0.0, 0.0);
        self.gradient[..nodes].fill(ZERO3);
        self.hessian.0[..nodes * (nodes + 1) / 2].fill(ZERO33);
        self.dilatation_gradient = [ZERO3; 4];
    }
}

const ZERO3: Vec3 = Vec3::new(0.0, 0.0, 0.0);
const ZERO33: Mat3 = Mat3::new(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0);

/// The element that refused a deformation, and why.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Refusal {
    /// Element of the term.
    pub element: usize,
    /// Why.
    pub cause: MaterialError,
}

/// How well a contact term holds, at one moment.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct ContactCheck {
    /// Deepest penetration (mm, positive).
    pub penetration_mm: f64,
    /// Largest opening of a contact that must not open (mm, positive).
    pub gap_mm: f64,
    /// Largest slip on a rough surface (mm), which must not be.
    pub slip_mm: f64,
    /// How far friction lags behind the normal pressure: change of its forces by one more round,
    /// over the normal forces (sums of norms).
    pub friction_lag: f64,
    /// Element of the deepest penetration, largest opening or slip.
    pub worst_open: usize,
    /// Element whose friction would change most.
    pub worst_lag: usize,
}

impl ContactCheck {
    /// How far (mm) the contact is from its surface at most.
    pub fn open_mm(&self) -> f64 {
        self.penetration_mm.max(self.gap_mm).max(self.slip_mm)
    }

    /// The worse of two, with the elements that are worst in their own terms.
    pub fn worst(self, other: Self) -> Self {
        let open = if self.open_mm() >= other.open_mm() { self } else { other };
        let lags = if self.friction_lag >= other.friction_lag { self } else { other };
        Self {
            penetration_mm: self.penetration_mm.max(other.penetration_mm),
            gap_mm: self.gap_mm.max(other.gap_mm),
            slip_mm: self.slip_mm.max(other.slip_mm),
            friction_lag: lags.friction_lag,
            worst_open: open.worst_open,
            worst_lag: lags.worst_lag,
        }
    }
}

/// One physical effect.
pub trait Term: Send + Sync {
    /// As written in reports; unique in a model.
    fn name(&self) -> &str;

    /// Number of elements.
    fn elements(&self) -> usize;

    /// Nodes that an element touches, one to ten.
    fn nodes(&self, element: usize) -> &[u32];

    /// Energy of an element and its derivatives up to `order`. `block` comes zeroed.
    ///
    /// # Errors
    /// The cause, when the element cannot be in this state.
    fn block(
        &self,
        element: usize,
        at: &At,
        order: Order,
        block: &mut Block,
    ) -> Result<(), MaterialError>;

    /// Whether the elements are tetrahedra with a dilatation and nodal pressures.
    fn is_mixed(&self) -> bool {
        false
    }

    /// Inverse bulk stiffness between the pressures of an element's four nodes (mm³/kPa); asked
    /// of mixed terms alone.
    fn compliance(&self, _element: usize) -> SMatrix<f64, 4, 4> {
        SMatrix::zeros()
    }

    /// Adds to the second derivatives of `block` the stiffness ∫ c ∇Nₐ·∇N_b dV (mN/mm), alike in
    /// every direction, with about the least c that makes the element convex in this state: what
    /// Newton's method adds where the whole is not convex. `false` when there is none.
    fn shift(&self, _element: usize, _at: &At, _block: &mut Block) -> bool {
        false
    }

    /// What the term remembers before anything has happened, with the nodes at `points`.
    fn first_memory(&self, _points: &[Vec3], _load: Load) -> Vec<f64> {
        Vec::new()
    }

    /// Whether its elements join parts of the body alone, so that their forces and moments cancel in every state.
    fn is_internal(&self) -> bool {
        false
    }

    /// Whether the term ties its nodes to what lies outside of the body, as contacts and cables do: a
    /// body with such nodes need not be fixed elsewhere.
    fn ties(&self) -> bool {
        false
    }

    /// How well the contact holds; `None` for terms that are no contact.
    fn contact(&self, _at: &At) -> Option<ContactCheck> {
        None
    }

    /// Moves the nodes of a contact at `points` (mm), where a `step` from the moment `from` has
    /// brought them on a straight line, along the surface's normal to the distances that the line
    /// foretells, or where nothing is foretold, out of the surface: the line becomes an arc along
    /// the surface with the same beginning.
    fn keep_to_surface(&self, _from: &At, _step: &[Vec3], _points: &mut [Vec3]) {}

    /// Updates the multipliers of a contact, and what friction knows of them, after a minimum has
    /// been found.
    fn update_multipliers(
        &self,
        _points: &[Vec3],
        _shear_kpa: &[f64],
        _load: Load,
        _memory: &mut [f64],
    ) {
    }

    /// The surface that the nodes of all elements glide on and never leave, if there is one.
    fn surface(&self) -> Option<&dyn Target> {
        None
    }

    /// The same contact with its elements on what they touch with the nodes at `points` (mm); `None` while
    /// that is what they have. It has the memory of this one.
    fn moved_on(&self, _points: &[Vec3]) -> Option<Arc<dyn Term>> {
        None
    }

    /// Whether every node that is near to what its element touches with the nodes at `from` (mm) is so at `to`: a
    /// minimisation ends before one is not, and looks anew ([`Term::moved_on`]).
    fn is_near(&self, _from: &[Vec3], _to: &[Vec3]) -> bool {
        true
    }

    /// How far (mm) nodes may go from one look at what they touch to the next; `None` where it does not matter.
    fn leash_mm(&self) -> Option<f64> {
        None
    }

    /// Whether its reactions act on a part of the body, which gives way.
    fn gives_way(&self) -> bool {
        false
    }

    /// Distance (mm) of the first node of an element from the surface that gives way, with the nodes at
    /// `points` (mm), and its gradient; `None` without such a surface.
    fn above(&self, _element: usize, _points: &[Vec3]) -> Option<(f64, Vec3)> {
        None
    }

    /// Whether this is a contact that opens where it would have to pull.
    fn may_open(&self) -> bool {
        false
    }

    /// Makes a surface's reactions balance what of `gradient` (mN, by node; the sum of the other
    /// terms) is normal to it, with the nodes at `points` on the surface.
    fn react(&self, _points: &[Vec3], _gradient: &[Vec3], _memory: &mut [f64]) {}

    /// Raises the shear modulus (kPa) of each node to that of the term's tissue there.
    fn raise_shear(&self, _shear_kpa: &mut [f64]) {}

    /// Whether forces depend on what the term remembers of earlier minima, as friction does.
    fn lags(&self) -> bool {
        false
    }

    /// The nodes that a contact may touch; none for terms that are no contact.
    fn touching(&self, _at: &At) -> Vec<Touching> {
        Vec::new()
    }

    /// Stores what the next load step must know of this one.
    fn accept(&self, _points: &[Vec3], _load: Load, _memory: &mut [f64]) {}

    /// Fills the fields of a solution that this term knows.
    fn report(&self, _at: &At, _solution: &mut Solution) {}
}
