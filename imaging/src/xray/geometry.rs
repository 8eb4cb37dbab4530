//! Where the focal spot and the pixels are.

use mammotwin_data::{Vec3, radiograph::Radiograph};

/// A point source above a flat detector whose edge touches the chest wall.
#[derive(Debug, Clone, PartialEq)]
pub struct Geometry {
    /// Height (mm) of the focal spot above the centre of the detector's chest-wall edge.
    pub source_height_mm: f64,
    /// Pixels along x.
    pub columns: usize,
    /// Pixels away from the chest wall.
    pub rows: usize,
    /// Distance of pixel centres (mm), both ways.
    pub pitch_mm: f64,
}

impl Geometry {
    /// Senographe Pristina as simulators describe it: focus at 660 mm, 2850 x 2394 pixels of
    /// 0.1 mm over 285 x 239.4 mm. Another pixel size covers the same field.
    pub fn pristina(pixel_mm: f64) -> Self {
        Self::covering(660.0, [285.0, 239.4], pixel_mm)
    }

    /// Pixels of this size on a field (mm) along the chest wall and away from it, a focal spot at this
    /// height (mm).
    pub fn covering(source_height_mm: f64, field_mm: [f64; 2], pixel_mm: f64) -> Self {
        let [columns, rows] = field_mm.map(|extent| (extent / pixel_mm).round().max(1.0) as usize);
        Self { source_height_mm, columns, rows, pitch_mm: pixel_mm }
    }

    /// x (mm) of the centre of column 0.
    pub fn left_mm(&self) -> f64 {
        -0.5 * (self.columns as f64 - 1.0) * self.pitch_mm
    }

    /// y (mm) of the centre of row 0.
    pub fn first_row_mm(&self) -> f64 {
        0.5 * self.pitch_mm
    }

    /// Point (x, y) in mm on the detector behind a point of the body.
    pub fn shadow_mm(&self, point: &Vec3) -> [f64; 2] {
        let magnification = self.source_height_mm / (self.source_height_mm - point.z);
        [point.x * magnification, point.y * magnification]
    }

    /// Length (mm) of the ray from the focal spot to a point (x, y) of the detector.
    pub fn ray_mm(&self, [x, y]: [f64; 2]) -> f64 {
        (x * x + y * y + self.source_height_mm * self.source_height_mm).sqrt()
    }

    /// Photons per detector area without object, over those below the focal spot: inverse square
    /// of the distance and slant of the surface, (h/r)³.
    pub fn relative_fluence(&self, point: [f64; 2]) -> f64 {
        (self.source_height_mm / self.ray_mm(point)).powi(3)
    }

    /// Photons per area at a height above the detector, over those on the detector.
    pub fn closer(&self, height_mm: f64) -> f64 {
        (self.source_height_mm / (self.source_height_mm - height_mm)).powi(2)
    }

    /// (x, y) in mm of a pixel's centre.
    pub fn pixel_mm(&self, row: usize, column: usize) -> [f64; 2] {
        [
            self.left_mm() + column as f64 * self.pitch_mm,
            self.first_row_mm() + row as f64 * self.pitch_mm,
        ]
    }

    /// A picture of these pixels.
    pub fn picture(&self, pixels: Vec<f32>, quantity: &str) -> Radiograph {
        Radiograph {
            columns: self.columns,
            rows: self.rows,
            pitch_mm: self.pitch_mm,
            left_mm: self.left_mm(),
            first_row_mm: self.first_row_mm(),
            pixels,
            quantity: quantity.into(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pristina_covers_its_field_at_any_pixel_size() {
        let fine = Geometry::pristina(0.1);
        assert_eq!((fine.columns, fine.rows), (2850, 2394));
        assert!((fine.left_mm() + 142.45).abs() < 1e-9);
        let coarse = Geometry::pristina(0.5);
        assert_eq!((coarse.columns, coarse.rows), (570, 479));
    }

    #[test]
    fn shadows_grow_away_from_the_foot_of_the_source() {
        let geometry = Geometry::pristina(0.1);
        let [x, y] = geometry.shadow_mm(&Vec3::new(-30.0, 60.0, 110.0));
        assert!((x + 36.0).abs() < 1e-12 && (y - 72.0).abs() < 1e-12);
        assert!((geometry.relative_fluence([0.0, 0.0]) - 1.0).abs() < 1e-15);
        assert!((geometry.closer(330.0) - 4.0).abs() < 1e-15);
    }
}
