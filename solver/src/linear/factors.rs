//! Numeric factors in one precision.

use super::{LinearError, Symbolic};
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::ldlt::factor::LdltRegularization;
use faer::sparse::linalg::cholesky::{LdltRef, SymbolicCholeskyRaw, supernodal::SupernodalLdltRef};
use faer::sparse::{SparseColMatRef, SymbolicSparseColMatRef};
use faer::traits::RealField;
use faer::{Conj, MatMut, Par, Side};

/// Factors L D Lᵀ of a matrix, in `f32` or `f64`.
pub(super) struct Factors<T> {
    values: Vec<T>,
    scratch: MemBuffer,
}

impl<T: RealField + Copy> Factors<T> {
    /// Room for them.
    ///
    /// # Errors
    /// [`LinearError::Memory`].
    pub fn new(shared: &Symbolic) -> Result<Self, LinearError> {
        let Symbolic { symbolic, parallel, .. } = shared;
        let need = symbolic
            .factorize_numeric_ldlt_scratch::<T>(*parallel, faer::Spec::default())
            .or(symbolic.solve_in_place_scratch::<T>(1, Par::Seq));
        let scratch = MemBuffer::try_new(need).map_err(|_| LinearError::Memory)?;
        let mut values = Vec::new();
        values.try_reserve_exact(symbolic.len_val()).map_err(|_| LinearError::Memory)?;
        values.resize(symbolic.len_val(), T::zero_impl());
        Ok(Self { values, scratch })
    }

    /// Factorises the matrix of these lower values.
    ///
    /// # Errors
    /// [`LinearError::Singular`] on a vanishing pivot.
    pub fn factor(&mut self, shared: &Symbolic, values: &[T]) -> Result<(), LinearError> {
        let Symbolic { pattern, symbolic, parallel } = shared;
        let n = pattern.len();
        let view = SymbolicSparseColMatRef::new_checked(n, n, &pattern.starts, None, &pattern.rows);
        let factored = symbolic.factorize_numeric_ldlt(
            &mut self.values,
            SparseColMatRef::new(view, values),
            Side::Lower,
            LdltRegularization::default(),
            *parallel,
            MemStack::new(&mut self.scratch),
            faer::Spec::default(),
        );
        factored.map(|_| ()).map_err(|_| LinearError::Singular)
    }

    /// Number of negative pivots.
    pub fn negative_pivots(&self, shared: &Symbolic) -> usize {
        let SymbolicCholeskyRaw::Supernodal(symbolic) = shared.symbolic.raw() else { return 0 };
        let factors = SupernodalLdltRef::new(symbolic, &self.values);
        let negative = |supernode: usize| {
            let block = factors.supernode(supernode).val();
            (0..block.ncols()).filter(|&column| block[(column, column)] < T::zero_impl()).count()
        };
        (0..symbolic.n_supernodes()).map(negative).sum()
    }

    /// Solves with the factors, in place.
    pub fn substitute(&mut self, shared: &Symbolic, x: &mut [T]) {
        let n = x.len();
        LdltRef::new(&shared.symbolic, &self.values).solve_in_place_with_conj(
            Conj::No,
            MatMut::from_column_major_slice_mut(x, n, 1),
            Par::Seq,
            MemStack::new(&mut self.scratch),
        );
    }
}
