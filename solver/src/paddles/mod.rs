//! Plates that press: one file each.
//!
//! Every paddle is a rigid flat plate with rounded edges, or that plate with its surface lifted by
//! a few millimetres as a function of the place on it: by its own shape, and by coordinates that
//! the body pushes at, such as a bending or a tilt. Lifts are small against the plate. Where a plate
//! ends is no lift: [`Outline`] has an exact distance, for the surface is upright there.

pub mod biopsy;
pub mod cad;
pub mod curved;
pub mod cushion;
pub mod elastic;
pub mod hinge;
pub mod outline;
pub mod rigid;
pub mod spot;
pub mod tilting;

pub use biopsy::Biopsy;
pub use cad::{CadError, CadPaddle, HeightField};
pub use curved::CurvedPlate;
pub use cushion::Cushion;
pub use elastic::{ElasticPlate, PlateError, Sheet, Support};
pub use hinge::Hinge;
pub use outline::{Outline, RoundedRectangle};
pub use rigid::RoundedPlate;
pub use spot::{Spot, SpotShape};
pub use tilting::Gimbal;

use std::{fmt::Debug, sync::Arc};

/// Most coordinates that a paddle may have.
pub const COORDINATES: usize = 25;

/// Where a paddle is besides its height: its coordinates, in about the millimetres that they lift
/// its surface by.
// The number is written out: the compiler stumbles over the named constant in closures (rustc 1.95,
// "broken MIR", in incremental builds).
pub type Pose = [f64; 25];

/// A pose at rest.
pub const AT_REST: Pose = [0.0; COORDINATES];

/// A place on a plate: along its chest-wall edge from its middle, and away from that edge (mm).
pub type Place = [f64; 2];

/// How far (mm) the surface lies outwards, away from the body, with its derivatives by the place.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Bend {
    /// Lift (mm).
    pub value: f64,
    /// First derivatives.
    pub slope: [f64; 2],
    /// Second derivatives (1/mm): twice along the edge, mixed, twice away from it.
    pub curvature: [f64; 3],
}

/// A paddle that is not a flat rigid plate.
pub trait Lift: Debug + Send + Sync {
    /// Number of coordinates, at most [`COORDINATES`].
    fn coordinates(&self) -> usize;

    /// The surface at a place in a pose.
    fn bend(&self, place: Place, pose: &Pose) -> Bend;

    /// By how much each coordinate lifts a place.
    fn weights(&self, place: Place) -> Pose;

    /// Force (mN) that the paddle resists with along each coordinate, and its derivative (mN/mm,
    /// positive).
    fn resistance(&self, pose: &Pose) -> (Pose, Pose);

    /// Tilt, positive when the side of the nipple sinks, and roll about the other axis (rad).
    fn angles(&self, _pose: &Pose) -> [f64; 2] {
        [0.0, 0.0]
    }
}

/// Which paddle.
#[derive(Debug, Clone, Default)]
pub enum Paddle {
    /// Flat, does not bend or tilt.
    #[default]
    Rigid,
    /// Flat, tilts about an axis along the chest-wall edge.
    Flex(Hinge),
    /// Flat, under a layer of foam.
    Cushioned(Cushion),
    /// Anything else.
    Lifted(Arc<dyn Lift>),
}

impl Paddle {
    /// The hinge of a flex paddle.
    pub fn hinge(&self) -> Option<Hinge> {
        match self {
            Self::Flex(hinge) => Some(*hinge),
            Self::Rigid | Self::Cushioned(_) | Self::Lifted(_) => None,
        }
    }

    /// The foam on it.
    pub fn cushion(&self) -> Option<Cushion> {
        match self {
            Self::Cushioned(cushion) => Some(*cushion),
            Self::Rigid | Self::Flex(_) | Self::Lifted(_) => None,
        }
    }

    /// Whether the body moves it in more than one direction.
    pub fn gives_way(&self) -> bool {
        self.hinge().is_some() || self.lift().is_some_and(|lift| lift.coordinates() > 0)
    }

    /// What lifts the surface.
    pub fn lift(&self) -> Option<&Arc<dyn Lift>> {
        match self {
            Self::Lifted(lift) => Some(lift),
            Self::Rigid | Self::Flex(_) | Self::Cushioned(_) => None,
        }
    }
}
