//! Directions in which something that no effect explains would be seen.

use super::record::{Channel, Record};
use nalgebra::DVector;

/// Highest power of the thickness.
const POWERS: i32 = 4;

/// Polynomials of the thickness for the forces, every other reading by itself; rows for offset and
/// stiffness follow.
pub(super) fn shapes(record: &Record) -> Vec<DVector<f64>> {
    let readings = &record.0;
    let zero = || DVector::zeros(readings.len() + 2);
    let mut all = Vec::new();
    for power in 0..=POWERS {
        let mut column = zero();
        for (n, reading) in readings.iter().enumerate() {
            if reading.channel == Channel::Force {
                // About the middle of usual thicknesses, in their size.
                column[n] = ((reading.thickness_mm - 70.0) / 30.0).powi(power);
            }
        }
        all.push(column);
    }
    for (n, reading) in readings.iter().enumerate() {
        if reading.channel != Channel::Force {
            let mut column = zero();
            column[n] = 1.0;
            all.push(column);
        }
    }
    all
}
