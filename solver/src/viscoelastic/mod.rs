//! Quasi-linear viscoelasticity (Fung) of a body between plates: its force in time, from the elastic
//! curve of force against thickness and one relaxation function.
//!
//! The calibrated moduli are the long-term ones (gravity acts for minutes), so the relaxation function
//! ends at one, G(t) = 1 + Σ aᵢ exp(-t/τᵢ), and the force of the plates is
//!
//! F(t) = ∫ G(t - s) dFₑ(h(s))/ds ds
//!
//! with the elastic force Fₑ(h) at the thickness h (Fung 1993, § 7.6). This is exact when every part of the body has
//! the same G in its first Piola-Kirchhoff stress, h(s) alone says where all of it is, and nothing that
//! touches a plate lets go of it: equilibrium is linear in that stress, so each state of the elastic
//! path balances with convolved stresses and convolved forces. It neglects inertia, tissues that relax differently,
//! parts that leave the plates one after the other in a release, and what the first and the second
//! Piola-Kirchhoff stress make of it differently where the body turns.

mod course;
mod curve;
mod relaxation;

pub use course::{Held, Instant, Phases, TimeCourse, course};
pub use curve::{ElasticCurve, MonotoneCubic};
pub use relaxation::{Decay, Memory, Relaxation};
