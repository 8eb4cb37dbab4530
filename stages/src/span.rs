//! Spans of columns.

use nalgebra::{DMatrix, DVector};

/// A column of which this part is left beside the others adds nothing.
pub(crate) const FLAT: f64 = 1e-6;

/// A vector without its part in the span of orthonormal columns.
pub(crate) fn without(basis: &DMatrix<f64>, vector: &DVector<f64>) -> DVector<f64> {
    vector - basis * (basis.transpose() * vector)
}

/// Orthonormal columns of the same span; columns that add nothing are dropped.
pub(crate) fn orthonormal(columns: &DMatrix<f64>) -> DMatrix<f64> {
    let mut kept: Vec<DVector<f64>> = Vec::new();
    for column in columns.column_iter() {
        let whole = column.norm();
        let mut rest = column.into_owned();
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
    if kept.is_empty() { DMatrix::zeros(columns.nrows(), 0) } else { DMatrix::from_columns(&kept) }
}

/// The numbers x that make |residual + columns x| least. What the columns do not tell, as the number of a column of
/// zeros, is zero.
pub(crate) fn least_squares(columns: &DMatrix<f64>, residual: &DVector<f64>) -> DVector<f64> {
    let inverse = |column: f64| if column > 0.0 { 1.0 / column } else { 0.0 };
    let lengths: Vec<f64> = columns.column_iter().map(|column| column.norm()).collect();
    let scales = DVector::from_iterator(lengths.len(), lengths.into_iter().map(inverse));
    let unit = columns * DMatrix::from_diagonal(&scales);
    let eigen = (unit.transpose() * &unit).symmetric_eigen();
    let side = unit.transpose() * residual;
    let mut found = DVector::zeros(columns.ncols());
    for (value, vector) in eigen.eigenvalues.iter().zip(eigen.eigenvectors.column_iter()) {
        if *value > FLAT {
            found.axpy(-vector.dot(&side) / value, &vector, 1.0);
        }
    }
    found.component_mul(&scales)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_that_add_nothing_are_dropped() {
        let columns =
            DMatrix::from_column_slice(3, 3, &[1.0, 1.0, 0.0, 2.0, 2.0, 0.0, 0.0, 1.0, 1.0]);
        let basis = orthonormal(&columns);
        assert_eq!(basis.ncols(), 2);
        assert!((basis.transpose() * &basis - DMatrix::identity(2, 2)).norm() < 1e-12);
        for column in columns.column_iter() {
            assert!(without(&basis, &column.into_owned()).norm() < 1e-12);
        }
    }

    #[test]
    fn a_column_of_zeros_does_not_hinder_the_fit_of_the_others() {
        let columns =
            DMatrix::from_column_slice(3, 3, &[1e3, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 0.0]);
        let wanted = DVector::from_row_slice(&[0.002, 0.0, -3.0]);
        let found = least_squares(&columns, &-(&columns * &wanted));
        assert!((found - wanted).norm() < 1e-12);
    }
}
