//! The biopsy paddle: a plate with a rectangular window for the needle, into which tissue bulges.

use super::{Outline, RoundedRectangle};

/// A plate with a window.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Biopsy {
    /// The plate.
    pub plate: RoundedRectangle,
    /// Its window; what is left around it is wider than two radii of the edges.
    pub window: RoundedRectangle,
}

impl Biopsy {
    /// What it fills of its plane.
    pub fn outline(&self) -> Outline {
        Outline { plate: Some(self.plate), window: Some(self.window) }
    }
}
