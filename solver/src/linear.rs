//! Sparse symmetric systems: supernodal LDLᵀ with an analysis that is kept.
//!
//! The matrix may be quasi-definite (positive and negative pivots); it needs no pivoting then,
//! for any order (Vanderbei, *SIAM J. Optim.* 5 (1995) 100). The order of the unknowns is the
//! caller's, see [`crate::ordering`].

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::ldlt::factor::LdltRegularization;
use faer::sparse::linalg::SupernodalThreshold;
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, LdltRef, SymbolicCholesky, SymbolicCholeskyRaw, SymmetricOrdering,
    factorize_symbolic_cholesky, supernodal::SupernodalLdltRef,
};
use faer::sparse::{SparseColMatRef, SymbolicSparseColMatRef};
use faer::{Conj, MatMut, Par, Side};
use std::sync::Arc;

/// Results are the same bits for equal degrees of parallelism, hence it depends on the size of the
/// system and not on the machine: a small one loses more by waiting than it gains.
const PARALLEL_DEGREE: usize = 2;
const PARALLEL_UNKNOWNS: usize = 10_000;
/// Refinement ends when the residual is this small against the right-hand side.
const RESIDUAL: f64 = 1e-12;
/// Rounds of refinement.
const REFINEMENTS: usize = 3;

/// Why a system has no usable solution.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum LinearError {
    /// A pivot vanished.
    #[error("the stiffness is singular")]
    Singular,
    /// The factors do not fit in memory.
    #[error("out of memory for the factors of the stiffness; use a coarser mesh")]
    Memory,
    /// The solution misses the right-hand side.
    #[error("the stiffness is nearly singular: relative residual {0:.1e}")]
    Inaccurate(f64),
}

/// Lower triangle, diagonal included, of a symmetric sparsity, as compressed columns with
/// ascending rows.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Pattern {
    /// Start of each column; one more than columns.
    pub starts: Vec<usize>,
    /// Rows.
    pub rows: Vec<usize>,
}

impl Pattern {
    /// Number of unknowns.
    pub fn len(&self) -> usize {
        self.starts.len() - 1
    }

    /// Whether there is no unknown.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Position of an entry among the values; row >= column.
    pub fn position(&self, row: usize, column: usize) -> Option<usize> {
        let (start, end) = (self.starts[column], self.starts[column + 1]);
        self.rows[start..end].binary_search(&row).ok().map(|at| start + at)
    }

    /// The same entries as an upper triangle in compressed columns.
    fn transposed(&self) -> Self {
        let mut starts = vec![0; self.starts.len()];
        for &row in &self.rows {
            starts[row + 1] += 1;
        }
        for n in 1..starts.len() {
            starts[n] += starts[n - 1];
        }
        let mut next = starts.clone();
        let mut rows = vec![0; self.rows.len()];
        for column in 0..self.len() {
            for &row in &self.rows[self.starts[column]..self.starts[column + 1]] {
                rows[next[row]] = column;
                next[row] += 1;
            }
        }
        Self { starts, rows }
    }

    /// y = A x, with the symmetric matrix of these lower `values`.
    fn multiply(&self, values: &[f64], x: &[f64], y: &mut [f64]) {
        y.fill(0.0);
        for column in 0..self.len() {
            let mut sum = 0.0;
            for at in self.starts[column]..self.starts[column + 1] {
                let row = self.rows[at];
                y[row] += values[at] * x[column];
                if row != column {
                    sum += values[at] * x[row];
                }
            }
            y[column] += sum;
        }
    }
}

/// Where the factors of matrices of one sparsity are non-zero.
pub struct Symbolic {
    pattern: Pattern,
    symbolic: SymbolicCholesky<usize>,
    parallel: Par,
}

impl Symbolic {
    /// Of matrices of this sparsity.
    ///
    /// # Errors
    /// [`LinearError::Memory`].
    pub fn of(pattern: Pattern) -> Result<Self, LinearError> {
        let upper = pattern.transposed();
        let n = pattern.len();
        let view = SymbolicSparseColMatRef::new_checked(n, n, &upper.starts, None, &upper.rows);
        let parallel = if n < PARALLEL_UNKNOWNS { Par::Seq } else { Par::rayon(PARALLEL_DEGREE) };
        let params = CholeskySymbolicParams {
            supernodal_flop_ratio_threshold: SupernodalThreshold::FORCE_SUPERNODAL,
            ..CholeskySymbolicParams::default()
        };
        let symbolic =
            factorize_symbolic_cholesky(view, Side::Upper, SymmetricOrdering::Identity, params)
                .map_err(|_| LinearError::Memory)?;
        Ok(Self { pattern, symbolic, parallel })
    }

    /// The sparsity.
    pub fn pattern(&self) -> &Pattern {
        &self.pattern
    }
}

/// Factors of a symmetric matrix.
pub struct Ldlt {
    shared: Arc<Symbolic>,
    values: Vec<f64>,
    factors: Vec<f64>,
    scratch: MemBuffer,
}

impl Ldlt {
    /// Finds where the factors of matrices of this sparsity are non-zero.
    ///
    /// # Errors
    /// [`LinearError::Memory`].
    pub fn analyse(pattern: Pattern) -> Result<Self, LinearError> {
        Self::new(Arc::new(Symbolic::of(pattern)?))
    }

    /// Room for the factors of matrices that were analysed.
    ///
    /// # Errors
    /// [`LinearError::Memory`].
    pub fn new(shared: Arc<Symbolic>) -> Result<Self, LinearError> {
        let Symbolic { symbolic, parallel, .. } = &*shared;
        let need = symbolic
            .factorize_numeric_ldlt_scratch::<f64>(*parallel, faer::Spec::default())
            .or(symbolic.solve_in_place_scratch::<f64>(1, Par::Seq));
        let scratch = MemBuffer::try_new(need).map_err(|_| LinearError::Memory)?;
        let factors = vec![0.0; symbolic.len_val()];
        Ok(Self { shared, values: Vec::new(), factors, scratch })
    }

    /// The sparsity.
    pub fn pattern(&self) -> &Pattern {
        self.shared.pattern()
    }

    /// Factorises the matrix of these lower values.
    ///
    /// # Errors
    /// [`LinearError::Singular`] on a vanishing pivot.
    pub fn factor(&mut self, values: &[f64]) -> Result<(), LinearError> {
        self.factor_sum(values, 0.0, &[])
    }

    /// Factorises `values` + `share` `more`, lower values of two matrices; of the first alone when
    /// the share is zero.
    ///
    /// # Errors
    /// [`LinearError::Singular`] on a vanishing pivot.
    pub fn factor_sum(
        &mut self,
        values: &[f64],
        share: f64,
        more: &[f64],
    ) -> Result<(), LinearError> {
        self.values.clear();
        self.values.extend_from_slice(values);
        if share != 0.0 {
            self.values.iter_mut().zip(more).for_each(|(value, more)| *value += share * more);
        }
        let Symbolic { pattern, symbolic, parallel } = &*self.shared;
        let n = pattern.len();
        let view = SymbolicSparseColMatRef::new_checked(n, n, &pattern.starts, None, &pattern.rows);
        let factored = symbolic.factorize_numeric_ldlt(
            &mut self.factors,
            SparseColMatRef::new(view, &self.values),
            Side::Lower,
            LdltRegularization::default(),
            *parallel,
            MemStack::new(&mut self.scratch),
            faer::Spec::default(),
        );
        factored.map(|_| ()).map_err(|_| LinearError::Singular)
    }

    /// Number of negative pivots of the last factors: the number of negative eigenvalues.
    pub fn negative_pivots(&self) -> usize {
        let SymbolicCholeskyRaw::Supernodal(symbolic) = self.shared.symbolic.raw() else {
            return 0;
        };
        let factors = SupernodalLdltRef::new(symbolic, &self.factors);
        let negative = |supernode: usize| {
            let block = factors.supernode(supernode).val();
            (0..block.ncols()).filter(|&column| block[(column, column)] < 0.0).count()
        };
        (0..symbolic.n_supernodes()).map(negative).sum()
    }

    /// Solves A x = `rhs` with the last factors and iterative refinement.
    ///
    /// # Errors
    /// [`LinearError::Inaccurate`] when the residual stays above 1e-6 of the right-hand side.
    pub fn solve(&mut self, rhs: &[f64], x: &mut Vec<f64>) -> Result<(), LinearError> {
        x.clear();
        x.extend_from_slice(rhs);
        self.substitute(x);
        let scale = norm(rhs).max(f64::MIN_POSITIVE);
        let mut product = vec![0.0; rhs.len()];
        let mut best = f64::INFINITY;
        for _ in 0..=REFINEMENTS {
            self.shared.pattern.multiply(&self.values, x, &mut product);
            let mut left: Vec<f64> = rhs.iter().zip(&product).map(|(b, ax)| b - ax).collect();
            let residual = norm(&left) / scale;
            // Also ends when refinement no longer helps, or on a NaN.
            if residual <= RESIDUAL || !(residual < 0.5 * best) {
                best = if residual.is_nan() { residual } else { best.min(residual) };
                break;
            }
            best = residual;
            self.substitute(&mut left);
            x.iter_mut().zip(&left).for_each(|(x, dx)| *x += dx);
        }
        if best < 1e-6 { Ok(()) } else { Err(LinearError::Inaccurate(best)) }
    }

    fn substitute(&mut self, x: &mut [f64]) {
        let n = x.len();
        LdltRef::new(&self.shared.symbolic, &self.factors).solve_in_place_with_conj(
            Conj::No,
            MatMut::from_column_major_slice_mut(x, n, 1),
            Par::Seq,
            MemStack::new(&mut self.scratch),
        );
    }
}

fn norm(x: &[f64]) -> f64 {
    x.iter().map(|v| v * v).sum::<f64>().sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// [[4, 1, 2], [1, 3, 0], [2, 0, -5]]: quasi-definite.
    fn small() -> (Pattern, Vec<f64>) {
        let pattern = Pattern { starts: vec![0, 3, 4, 5], rows: vec![0, 1, 2, 1, 2] };
        (pattern, vec![4.0, 1.0, 2.0, 3.0, -5.0])
    }

    #[test]
    fn a_quasi_definite_system_is_solved() {
        let (pattern, values) = small();
        let mut ldlt = Ldlt::analyse(pattern).unwrap();
        ldlt.factor(&values).unwrap();
        assert_eq!(ldlt.negative_pivots(), 1);
        let mut x = Vec::new();
        ldlt.solve(&[12.0, 7.0, -13.0], &mut x).unwrap();
        for (got, want) in x.iter().zip([1.0, 2.0, 3.0]) {
            assert!((got - want).abs() < 1e-13, "{x:?}");
        }
    }

    #[test]
    fn a_singular_system_is_refused() {
        let (pattern, _) = small();
        let mut ldlt = Ldlt::analyse(pattern).unwrap();
        // The first two rows are equal.
        let values = [1.0, 1.0, 0.0, 1.0, -5.0];
        let mut x = Vec::new();
        let solved = ldlt.factor(&values).and_then(|()| ldlt.solve(&[1.0, 2.0, 3.0], &mut x));
        assert!(solved.is_err(), "{x:?}");
    }
}
