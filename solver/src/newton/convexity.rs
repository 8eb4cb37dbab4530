//! How much convex stiffness Newton's method adds, and how far it goes with it.

use mammotwin_data::Vec3;

/// Least and greatest share of the convex stiffness that is added, and how it grows and fades.
const LEAST_SHARE: f64 = 1e-3;
pub const GREATEST_SHARE: f64 = 1e5;
const GROWTH: f64 = 4.0;
const MOST_AT_ONCE: usize = 16;
const FADING: f64 = 2.0;
const FAST_FADING: f64 = 16.0;
/// Most iterations with the least share before none is tried again.
const LONGEST_WAIT: usize = 8;

/// The share of the convex stiffness that is added, from one iteration to the next.
#[derive(Debug, Clone, Copy, Default)]
pub struct Convexity {
    pub share: f64,
    /// The share that the last step beyond the convex needed.
    needed: f64,
    /// Iterations until none is tried again, and how many there were the last time.
    wait: usize,
    waited: usize,
}

impl Convexity {
    /// After a direction that does not go down; of a body with many directions in which it is not
    /// convex (`excess`) the worst needs more.
    pub fn raise(&mut self, excess: usize) {
        let more = excess.clamp(1, MOST_AT_ONCE) as f64;
        if self.share == 0.0 {
            self.share = f64::max(more * LEAST_SHARE, self.needed / GROWTH);
            self.waited = (2 * self.waited).clamp(1, LONGEST_WAIT);
            self.wait = self.waited;
        } else {
            self.share *= more * GROWTH;
        }
    }

    /// After a step down, of full length or shortened.
    pub fn lower(&mut self, full: bool) {
        if self.share == 0.0 {
            (self.needed, self.waited) = (self.needed / FADING, 0);
            return;
        }
        self.needed = self.share;
        self.share /= if full { FAST_FADING } else { FADING };
        if self.share < LEAST_SHARE {
            self.share = if self.wait == 0 { 0.0 } else { LEAST_SHARE };
        }
        self.wait = self.wait.saturating_sub(1);
    }
}

/// Where the energy is not convex, no node goes farther than this (mm) in one step, so that a body
/// past a point of buckling comes to the next minimum and not to one beyond.
const STRIDE_MM: f64 = 4.0;

/// Length of a step along a direction that brings the node that goes farthest to the limit.
pub fn stride(direction: &[Vec3]) -> f64 {
    STRIDE_MM / direction.iter().map(|d| d.norm()).fold(f64::MIN_POSITIVE, f64::max)
}
