//! Directions in which something that no effect explains would be seen.

use super::record::{Channel, Record};
use nalgebra::{DMatrix, DVector};

/// Columns that hardly anything is left of are none.
const FLAT: f64 = 1e-6;
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

/// A vector without its part in the span of orthonormal columns.
pub(super) fn without(basis: &DMatrix<f64>, vector: &DVector<f64>) -> DVector<f64> {
    vector - basis * (basis.transpose() * vector)
}

/// Orthonormal columns of the same span; columns that add nothing are dropped.
pub(super) fn orthonormal(columns: &[DVector<f64>], rows: usize) -> DMatrix<f64> {
    let mut kept: Vec<DVector<f64>> = Vec::new();
    for column in columns {
        let whole = column.norm();
        let mut rest = column.clone();
        // Twice, for rounding.
        for _ in 0..2 {
            for unit in &kept {
                let part = unit.dot(&rest);
                rest.axpy(-part, unit, 1.0);
            }
        }
        if rest.norm() > FLAT * whole {
            kept.push(rest.normalize());
        }
    }
    if kept.is_empty() { DMatrix::zeros(rows, 0) } else { DMatrix::from_columns(&kept) }
}
