//! Better shaped elements: rounds of moving nodes, flipping and removing elements.

use super::{clip::Draft, domain::Domain, flip, smooth};

/// Rounds of smoothing and flipping.
const ROUNDS: usize = 4;

/// Improves the worst elements; nodes stay on their surfaces, patches keep their extent.
pub fn improve(draft: &mut Draft, domain: &dyn Domain, size_mm: f64) {
    for _ in 0..ROUNDS {
        smooth::smooth(draft, domain, size_mm);
        flip::flip(draft);
    }
    smooth::smooth(draft, domain, size_mm);
    draft.compact();
}
