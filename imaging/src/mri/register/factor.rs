//! Dense positive definite systems of some hundred unknowns.

use faer::{
    MatMut, MatRef, Par,
    dyn_stack::{MemBuffer, MemStack},
    linalg::cholesky::llt::{factor, solve},
};
use nalgebra::{DMatrix, Dim, Dyn, OMatrix};

/// A Cholesky factor, in the lower triangle. One thread makes it: the same bits for any number of them.
pub(super) struct Factor(DMatrix<f64>);

impl Factor {
    /// Of the matrix with this lower triangle; `None` when it is not positive definite.
    pub fn of(mut matrix: DMatrix<f64>) -> Option<Self> {
        let n = matrix.nrows();
        let parameters = Default::default();
        let scratch = factor::cholesky_in_place_scratch::<f64>(n, Par::Seq, parameters);
        factor::cholesky_in_place(
            MatMut::from_column_major_slice_mut(matrix.as_mut_slice(), n, n),
            Default::default(),
            Par::Seq,
            MemStack::new(&mut MemBuffer::new(scratch)),
            parameters,
        )
        .ok()?;
        Some(Self(matrix))
    }

    /// Solutions of as many systems as `right` has columns.
    pub fn solve<C: Dim>(&self, mut right: OMatrix<f64, Dyn, C>) -> OMatrix<f64, Dyn, C>
    where
        nalgebra::DefaultAllocator: nalgebra::allocator::Allocator<Dyn, C>,
    {
        let (n, columns) = right.shape();
        solve::solve_in_place(
            MatRef::from_column_major_slice(self.0.as_slice(), n, n),
            MatMut::from_column_major_slice_mut(right.as_mut_slice(), n, columns),
            Par::Seq,
            MemStack::new(&mut []),
        );
        right
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)] // a test may fail at once
mod tests {
    use super::*;

    #[test]
    fn a_system_is_solved_by_the_lower_triangle_alone() {
        let n = 400;
        let root = DMatrix::from_fn(n, n, |i, j| ((3 * i + 7 * j * j) as f64).sin());
        let matrix = &root * root.transpose() + DMatrix::identity(n, n);
        let x = DMatrix::from_fn(n, 2, |i, j| (i as f64 - 40.0 * j as f64).cos());
        let right = &matrix * &x;
        let mut lower = matrix.lower_triangle();
        lower.fill_upper_triangle(f64::NAN, 1);
        let found = Factor::of(lower).unwrap().solve(right);
        assert!((found - x).amax() < 1e-9);
        assert!(Factor::of(-matrix).is_none());
        assert!(Factor::of(DMatrix::from_element(3, 3, f64::NAN)).is_none());
    }
}
