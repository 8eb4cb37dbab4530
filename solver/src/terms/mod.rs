//! Energy terms: each physical effect is one term, and equilibrium is the minimum of their sum.
//!
//! A term is a list of *elements* that touch one to four nodes each. It gives the energy of an
//! element with its derivatives with respect to the node positions; the model sums them. A term
//! of nearly incompressible tissue gives its dilatation besides (see [`bulk`]).

pub mod bulk;
pub mod cable;
pub mod gravity;
pub mod grid_distance;
pub mod membrane;
pub mod plate;
pub mod sliding;
pub mod target;
pub mod testing;
#[cfg(test)]
mod tests;

pub use bulk::Bulk;
pub use cable::{Cable, Cables};
pub use gravity::Gravity;
pub use grid_distance::GridDistance;
pub use membrane::Membrane;
pub use sliding::Sliding;
pub use target::Target;

use crate::materials::MaterialError;
use mammotwin_data::{Mat3, Vec3, solution::Solution};
use nalgebra::{SMatrix, SVector};

/// What is switched on, and how far, at one moment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Load {
    /// Fraction of gravity, 0..=1.
    pub gravity: f64,
    /// Position of the receptor along the direction of compression (mm).
    pub receptor_mm: f64,
    /// Distance of the plates (mm).
    pub thickness_mm: f64,
}

impl Load {
    /// All of gravity and no plate near.
    pub const GRAVITY: Self = Self { gravity: 1.0, receptor_mm: -1e6, thickness_mm: 2e6 };
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

/// Energy of one element and its derivatives, for up to four nodes.
#[derive(Debug, Clone, Copy)]
pub struct Block {
    /// Energy (µJ).
    pub energy: f64,
    /// ∂energy/∂position (mN), by node.
    pub gradient: [Vec3; 4],
    /// Second derivatives (mN/mm); only blocks with column <= row are set.
    pub hessian: [[Mat3; 4]; 4],
    /// ∫ θ N dV of each node (mm³): the same for all nodes of a linear tetrahedron.
    pub dilatation: f64,
    /// ∂dilatation/∂position (mm²).
    pub dilatation_gradient: [Vec3; 4],
}

impl Block {
    /// All zero.
    pub const ZERO: Self = Self {
        energy: 0.0,
        gradient: [ZERO3; 4],
        hessian: [[ZERO33; 4]; 4],
        dilatation: 0.0,
        dilatation_gradient: [ZERO3; 4],
    };

    /// Makes the second derivatives of `nodes` nodes positive semi-definite by raising negative
    /// eigenvalues to zero.
    pub fn project(&mut self, nodes: usize) {
        match nodes {
            1 => self.project_sized::<3>(),
            2 => self.project_sized::<6>(),
            3 => self.project_sized::<9>(),
            _ => self.project_sized::<12>(),
        }
    }

    fn project_sized<const N: usize>(&mut self) {
        let whole = SMatrix::<f64, N, N>::from_fn(|r, c| {
            let (r, c) = if r >= c { (r, c) } else { (c, r) };
            self.hessian[r / 3][c / 3][(r % 3, c % 3)]
        });
        let Some((values, vectors)) = eigen(&whole) else { return };
        if values.min() >= 0.0 {
            return;
        }
        let raised = SMatrix::<f64, N, N>::from_diagonal(&values.map(|v| v.max(0.0)));
        let whole = vectors * raised * vectors.transpose();
        for a in 0..N / 3 {
            for b in 0..=a {
                self.hessian[a][b] = whole.fixed_view::<3, 3>(3 * a, 3 * b).into_owned();
            }
        }
    }
}

const ZERO3: Vec3 = Vec3::new(0.0, 0.0, 0.0);
const ZERO33: Mat3 = Mat3::new(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0);

/// Eigenvalues and eigenvectors of a symmetric matrix by Jacobi rotations; `None` for NaN.
fn eigen<const N: usize>(
    matrix: &SMatrix<f64, N, N>,
) -> Option<(SVector<f64, N>, SMatrix<f64, N, N>)> {
    if !matrix.iter().all(|v| v.is_finite()) {
        return None;
    }
    let (mut a, mut v) = (*matrix, SMatrix::<f64, N, N>::identity());
    let scale = a.norm();
    for _ in 0..40 {
        let mut off = 0.0;
        for p in 0..N {
            for q in 0..p {
                off += a[(p, q)] * a[(p, q)];
            }
        }
        if off.sqrt() <= 1e-13 * scale {
            break;
        }
        for p in 0..N {
            for q in 0..p {
                if a[(p, q)].abs() > 1e-300 {
                    rotate(&mut a, &mut v, p, q);
                }
            }
        }
    }
    Some((a.diagonal(), v))
}

/// One Jacobi rotation that zeroes a[(p, q)].
fn rotate<const N: usize>(
    a: &mut SMatrix<f64, N, N>,
    v: &mut SMatrix<f64, N, N>,
    p: usize,
    q: usize,
) {
    let ratio = (a[(q, q)] - a[(p, p)]) / (2.0 * a[(p, q)]);
    let t = ratio.signum() / (ratio.abs() + (ratio * ratio + 1.0).sqrt());
    let c = 1.0 / (t * t + 1.0).sqrt();
    let s = t * c;
    for k in 0..N {
        let (x, y) = (a[(k, p)], a[(k, q)]);
        (a[(k, p)], a[(k, q)]) = (c * x - s * y, s * x + c * y);
    }
    for k in 0..N {
        let (x, y) = (a[(p, k)], a[(q, k)]);
        (a[(p, k)], a[(q, k)]) = (c * x - s * y, s * x + c * y);
        let (x, y) = (v[(k, p)], v[(k, q)]);
        (v[(k, p)], v[(k, q)]) = (c * x - s * y, s * x + c * y);
    }
}

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
}

impl ContactCheck {
    /// The worse of two.
    pub fn worst(self, other: Self) -> Self {
        Self {
            penetration_mm: self.penetration_mm.max(other.penetration_mm),
            gap_mm: self.gap_mm.max(other.gap_mm),
        }
    }
}

/// One physical effect.
pub trait Term: Send + Sync {
    /// As written in reports; unique in a model.
    fn name(&self) -> &str;

    /// Number of elements.
    fn elements(&self) -> usize;

    /// Nodes that an element touches, one to four.
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

    /// What the term remembers before anything has happened, with the nodes at `points`.
    fn first_memory(&self, _points: &[Vec3]) -> Vec<f64> {
        Vec::new()
    }

    /// How well the contact holds; `None` for terms that are no contact.
    fn contact(&self, _at: &At) -> Option<ContactCheck> {
        None
    }

    /// Updates the multipliers of a contact after a minimum has been found.
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

    /// Makes a surface's reactions balance what of `gradient` (mN, by node; the sum of the other
    /// terms) is normal to it, with the nodes at `points` on the surface.
    fn react(&self, _points: &[Vec3], _gradient: &[Vec3], _memory: &mut [f64]) {}

    /// Raises the shear modulus (kPa) of each node to that of the term's tissue there.
    fn raise_shear(&self, _shear_kpa: &mut [f64]) {}

    /// Stores what the next load step must know of this one.
    fn accept(&self, _points: &[Vec3], _load: Load, _memory: &mut [f64]) {}

    /// Fills the fields of a solution that this term knows.
    fn report(&self, _at: &At, _solution: &mut Solution) {}
}
