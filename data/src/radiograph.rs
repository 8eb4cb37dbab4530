//! An X-ray picture.

/// Pixels of a flat detector, row by row from the chest wall outward.
///
/// Row 0 lies at the chest-wall edge; columns run from the person's left (-x) to right (+x).
#[derive(Debug, Clone, PartialEq)]
pub struct Radiograph {
    /// Pixels along x.
    pub columns: usize,
    /// Pixels away from the chest wall.
    pub rows: usize,
    /// Distance of pixel centres (mm), both ways.
    pub pitch_mm: f64,
    /// x (mm) of the centre of column 0.
    pub left_mm: f64,
    /// Distance (mm) of the centre of row 0 from the chest-wall edge.
    pub first_row_mm: f64,
    /// Detector signal; its meaning is in `quantity`.
    pub pixels: Vec<f32>,
    /// What a pixel says: "path length (mm)", "photons per pixel", ...
    pub quantity: String,
}

impl Radiograph {
    /// Pixel in a row and column.
    pub fn at(&self, row: usize, column: usize) -> f32 {
        self.pixels[row * self.columns + column]
    }
}
