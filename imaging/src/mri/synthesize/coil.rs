//! Receive sensitivity of surface coils, which stay with the scanner and not with the person.

use mammotwin_data::Vec3;

/// Coil elements; the sensitivity is the sum of theirs over a uniform floor.
#[derive(Debug, Clone, PartialEq)]
pub struct Coil {
    /// Centre (mm, image frame) of each element.
    pub centers: Vec<Vec3>,
    /// Distance (mm) at which an element has half of its sensitivity.
    pub reach_mm: f64,
    /// Sensitivity far away from all elements, as a part of that at an element.
    pub floor: f64,
}

impl Coil {
    /// Relative sensitivity at a place of the image frame: about 1 near the elements.
    pub fn sensitivity(&self, place: &Vec3) -> f64 {
        let reach2 = self.reach_mm * self.reach_mm;
        let near: f64 =
            self.centers.iter().map(|c| reach2 / (reach2 + (place - c).norm_squared())).sum();
        // Root of the sum of squares saturates softly where elements overlap.
        self.floor + (1.0 - self.floor) * (2.0 * near / (1.0 + near))
    }
}
