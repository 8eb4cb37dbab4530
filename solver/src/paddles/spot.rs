//! The spot paddle: a small plate that presses on a part of the breast.

use super::{Outline, RoundedRectangle};

/// Shape of a spot paddle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum SpotShape {
    /// A disc.
    Round,
    /// A square with corners of this radius (mm).
    Square(f64),
}

/// A spot paddle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spot {
    /// Round or square.
    pub shape: SpotShape,
    /// Diameter, or length of a side (mm).
    pub size_mm: f64,
    /// How far its middle lies beside that of the breast (mm).
    pub along_mm: f64,
    /// How far it begins from the chest-wall edge of the receptor (mm).
    pub away_mm: f64,
}

impl Spot {
    /// What it fills of its plane.
    pub fn outline(&self) -> Outline {
        let corner_mm = match self.shape {
            SpotShape::Round => 0.5 * self.size_mm,
            SpotShape::Square(corner_mm) => corner_mm,
        };
        let size = [self.size_mm; 2];
        let plate = RoundedRectangle::new(size, corner_mm, self.along_mm, self.away_mm);
        Outline { plate: Some(plate), window: None }
    }
}
