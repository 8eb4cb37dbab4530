//! Sparse symmetric systems: supernodal LDLᵀ with an analysis that is kept.
//!
//! The factors may be of single precision: they then are the preconditioner of generalised minimal residuals on the
//! matrix, which is of double precision always. The matrix may be quasi-definite (positive and negative pivots); it needs no pivoting then,
//! for any order (Vanderbei, *SIAM J. Optim.* 5 (1995) 100). The order of the unknowns is the
//! caller's, see [`crate::ordering`].

mod factors;
mod gmres;
mod pattern;

use factors::Factors;
use faer::sparse::SymbolicSparseColMatRef;
use faer::sparse::linalg::SupernodalThreshold;
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, SymbolicCholesky, SymmetricOrdering, factorize_symbolic_cholesky,
};
use faer::{Par, Side};
pub(crate) use gmres::gmres;
use gmres::norm;
pub use pattern::Pattern;
use std::sync::Arc;

/// Results are the same bits for equal degrees of parallelism, hence it depends on the size of the
/// system and not on the machine: a small one loses more by waiting than it gains.
const PARALLEL_DEGREE: usize = 2;
const PARALLEL_UNKNOWNS: usize = 100_000;
/// A residual that is this small against the right-hand side is rounding, and no better is asked for.
const RESIDUAL: f64 = 1e-12;
/// The same of solutions with factors in single precision.
const RESIDUAL_OF_SINGLE: f64 = 1e-8;
/// Largest residual that is taken for a solution.
const LARGEST_RESIDUAL: f64 = 1e-6;
/// Most products with the matrix in one solution: with factors in single precision two are usual.
const PRODUCTS: usize = 20;

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

/// Of the numbers of the factors.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Precision {
    /// Half of the memory and less time: for directions of Newton's method, to 1e-8. Where the matrix is too near to a
    /// singular one for these factors, double ones take their place.
    Single,
    /// For solutions to rounding.
    Double,
}

/// Factors of a symmetric matrix.
pub struct Ldlt {
    shared: Arc<Symbolic>,
    values: Vec<f64>,
    factors: Either,
}

/// Factors in one of the two precisions.
enum Either {
    /// Of the matrix S A S, with the powers of two S that bring its diagonal near to one: numbers of
    /// single precision have a narrow range.
    Single {
        factors: Factors<f32>,
        scale: Vec<f64>,
        rounded: Vec<f32>,
    },
    Double(Factors<f64>),
}

impl Ldlt {
    /// Finds where the factors of matrices of this sparsity are non-zero.
    ///
    /// # Errors
    /// [`LinearError::Memory`].
    pub fn analyse(pattern: Pattern) -> Result<Self, LinearError> {
        Self::new(Arc::new(Symbolic::of(pattern)?), Precision::Double)
    }

    /// Room for the factors of matrices that were analysed.
    ///
    /// # Errors
    /// [`LinearError::Memory`].
    pub fn new(shared: Arc<Symbolic>, precision: Precision) -> Result<Self, LinearError> {
        let factors = match precision {
            Precision::Double => Either::Double(Factors::new(&shared)?),
            Precision::Single => Either::Single {
                factors: Factors::new(&shared)?,
                scale: Vec::new(),
                rounded: Vec::new(),
            },
        };
        Ok(Self { shared, values: Vec::new(), factors })
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
        match self.refactor() {
            Err(LinearError::Singular) if matches!(self.factors, Either::Single { .. }) => {
                self.doubled()
            }
            done => done,
        }
    }

    fn refactor(&mut self) -> Result<(), LinearError> {
        let Self { shared, values, factors } = self;
        match factors {
            Either::Double(factors) => factors.factor(shared, values),
            Either::Single { factors, scale, rounded } => {
                shared.pattern.scale(values, scale);
                rounded.clear();
                let columns = shared.pattern.entries().zip(&*values);
                rounded.extend(
                    columns.map(|((row, column), v)| (scale[row] * v * scale[column]) as f32),
                );
                factors.factor(shared, rounded)
            }
        }
    }

    /// Factorises in double precision from here on.
    fn doubled(&mut self) -> Result<(), LinearError> {
        tracing::debug!("factors in double precision");
        self.factors = Either::Double(Factors::new(&self.shared)?);
        self.refactor()
    }

    /// Number of negative pivots of the last factors: the number of negative eigenvalues.
    pub fn negative_pivots(&self) -> usize {
        match &self.factors {
            Either::Single { factors, .. } => factors.negative_pivots(&self.shared),
            Either::Double(factors) => factors.negative_pivots(&self.shared),
        }
    }

    /// Solves A x = `rhs` with the last factors as the preconditioner of generalised minimal residuals.
    ///
    /// # Errors
    /// [`LinearError::Inaccurate`] when the residual stays above 1e-6 of the right-hand side.
    pub fn solve(&mut self, rhs: &[f64], x: &mut Vec<f64>) -> Result<(), LinearError> {
        let mut left = self.improve(rhs, x);
        if !(left < LARGEST_RESIDUAL) && matches!(self.factors, Either::Single { .. }) {
            self.doubled()?;
            left = self.improve(rhs, x);
        }
        if left < LARGEST_RESIDUAL { Ok(()) } else { Err(LinearError::Inaccurate(left)) }
    }

    /// Solves with the last factors, whatever they are worth, and returns the relative residual.
    fn improve(&mut self, rhs: &[f64], x: &mut Vec<f64>) -> f64 {
        let Self { shared, values, factors } = self;
        let wanted = match factors {
            Either::Single { .. } => RESIDUAL_OF_SINGLE,
            Either::Double(_) => RESIDUAL,
        };
        let product = |x: &[f64]| {
            let mut y = vec![0.0; x.len()];
            shared.pattern.multiply(values, x, &mut y);
            y
        };
        let found =
            gmres(|v| factors.substitute(shared, v), |x| Some(product(x)), rhs, wanted, PRODUCTS);
        *x = found.solution;
        let left: Vec<f64> = rhs.iter().zip(product(x)).map(|(b, ax)| b - ax).collect();
        norm(&left) / norm(rhs).max(f64::MIN_POSITIVE)
    }
}

impl Either {
    fn substitute(&mut self, shared: &Symbolic, v: &[f64]) -> Vec<f64> {
        match self {
            Self::Double(factors) => {
                let mut x = v.to_vec();
                factors.substitute(shared, &mut x);
                x
            }
            Self::Single { factors, scale, .. } => {
                let mut x: Vec<f32> = v.iter().zip(&*scale).map(|(v, s)| (v * s) as f32).collect();
                factors.substitute(shared, &mut x);
                x.iter().zip(&*scale).map(|(x, s)| f64::from(*x) * s).collect()
            }
        }
    }
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

    /// A chain of springs, an end held, in units that bring numbers beyond single precision into its matrix, and
    /// forces in the same units.
    fn chain(softest: f64) -> (Pattern, Vec<f64>, Vec<f64>) {
        let n = 200;
        let spring = |k: usize| if k % 7 == 3 { softest } else { 1e3 / (1.0 + k as f64) };
        let unit = |k: usize| 10f64.powi((k % 3) as i32 * 21 - 21);
        let (mut starts, mut rows, mut values) = (vec![0], Vec::new(), Vec::new());
        for k in 0..n {
            let beyond = if k + 1 < n { spring(k + 1) } else { 0.0 };
            rows.push(k);
            values.push((spring(k) + beyond) * unit(k) * unit(k));
            if k + 1 < n {
                rows.push(k + 1);
                values.push(-beyond * unit(k) * unit(k + 1));
            }
            starts.push(rows.len());
        }
        let rhs = (0..n).map(|k| unit(k) * ((k % 11) as f64 - 5.0)).collect();
        (Pattern { starts, rows }, values, rhs)
    }

    #[test]
    fn single_precision_solves_as_double_does() {
        // What is too much for single precision is left to the double one: residuals are the same.
        for (softest, single) in [(1e-3, true), (1e-5, false)] {
            let (pattern, values, rhs) = chain(softest);
            let shared = Arc::new(Symbolic::of(pattern).unwrap());
            let mut ldlt = Ldlt::new(shared.clone(), Precision::Single).unwrap();
            ldlt.factor(&values).unwrap();
            let mut x = Vec::new();
            ldlt.solve(&rhs, &mut x).unwrap();
            assert_eq!(ldlt.negative_pivots(), 0);
            let mut product = vec![0.0; 200];
            shared.pattern.multiply(&values, &x, &mut product);
            let left: Vec<f64> = rhs.iter().zip(&product).map(|(b, ax)| b - ax).collect();
            assert!(norm(&left) < 1e-6 * norm(&rhs), "{} {}", norm(&left), norm(&rhs));
            assert_eq!(matches!(ldlt.factors, Either::Single { .. }), single, "{softest}");
        }
    }
}
