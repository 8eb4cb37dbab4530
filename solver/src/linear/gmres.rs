//! Generalised minimal residuals.
//!
//! Saad & Schultz, *SIAM J. Sci. Stat. Comput.* 7 (1986) 856, without restarts, in the flexible form of Saad, *SIAM J. Sci.
//! Comput.* 14 (1993) 461: the preconditioner may be rounded. Few products are needed: the operators here are near the
//! identity once they are preconditioned.

/// An approximate solution.
pub(crate) struct Found {
    pub solution: Vec<f64>,
    /// Norm of what is left of the right-hand side, over its own.
    pub residual: f64,
    /// Applications of the operator.
    pub products: usize,
}

/// Euclidean norm.
pub(super) fn norm(x: &[f64]) -> f64 {
    dot(x, x).sqrt()
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// a += factor b
fn add(a: &mut [f64], factor: f64, b: &[f64]) {
    a.iter_mut().zip(b).for_each(|(a, b)| *a += factor * b);
}

/// Solves `operator`(x) = `rhs` down to a relative `residual`, in at most `products` applications of the operator, each
/// to what `precondition` makes of a direction. An operator that refuses (`None`) ends the search with what there is.
pub(crate) fn gmres(
    mut precondition: impl FnMut(&[f64]) -> Vec<f64>,
    mut operator: impl FnMut(&[f64]) -> Option<Vec<f64>>,
    rhs: &[f64],
    residual: f64,
    products: usize,
) -> Found {
    let size = norm(rhs);
    let mut basis = vec![rhs.iter().map(|v| v / size.max(f64::MIN_POSITIVE)).collect::<Vec<_>>()];
    let mut steps: Vec<Vec<f64>> = Vec::new();
    // Columns of the triangular factor, the rotations that made it, and the turned right side.
    let mut columns: Vec<Vec<f64>> = Vec::new();
    let mut rotations: Vec<(f64, f64)> = Vec::new();
    let mut turned = vec![size];
    while columns.len() < products && turned[columns.len()].abs() > residual * size {
        let step = precondition(&basis[columns.len()]);
        let Some(mut next) = operator(&step) else { break };
        let mut column = Vec::new();
        for old in &basis {
            let along = dot(&next, old);
            add(&mut next, -along, old);
            column.push(along);
        }
        let rest = norm(&next);
        for (row, &(c, s)) in rotations.iter().enumerate() {
            let (a, b) = (column[row], column[row + 1]);
            (column[row], column[row + 1]) = (c * a + s * b, c * b - s * a);
        }
        let last = columns.len();
        let length = column[last].hypot(rest);
        if !(length > 0.0 && length.is_finite()) {
            break;
        }
        let (c, s) = (column[last] / length, rest / length);
        column[last] = length;
        rotations.push((c, s));
        let left = turned[last];
        turned[last] = c * left;
        turned.push(-s * left);
        columns.push(column);
        steps.push(step);
        if rest == 0.0 {
            break;
        }
        basis.push(next.iter().map(|v| v / rest).collect());
    }
    let count = columns.len();
    let mut weights = vec![0.0; count];
    for row in (0..count).rev() {
        let known: f64 = (row + 1..count).map(|n| columns[n][row] * weights[n]).sum();
        weights[row] = (turned[row] - known) / columns[row][row];
    }
    let mut solution = vec![0.0; rhs.len()];
    for (weight, step) in weights.iter().zip(&steps) {
        add(&mut solution, *weight, step);
    }
    let left = turned[count].abs() / size.max(f64::MIN_POSITIVE);
    Found { solution, residual: left, products: count }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn multiply(x: &[f64]) -> Vec<f64> {
        let entry = |a: usize, b: usize| {
            0.1 * ((1.0 + a as f64) * (1.0 + (b % 3) as f64) + 2.0 * b as f64).sin()
        };
        (0..x.len()).map(|a| x[a] + (0..x.len()).map(|b| entry(a, b) * x[b]).sum::<f64>()).collect()
    }

    #[test]
    fn an_unsymmetric_system_is_solved() {
        let n = 21;
        let want: Vec<f64> = (0..n).map(|a| f64::from(a % 5) - 2.0).collect();
        let rhs = multiply(&want);
        // Also where the preconditioner is another one each time.
        let mut calls = 0.0;
        let rounded = |v: &[f64]| {
            calls += 1.0;
            v.iter().enumerate().map(|(n, v)| v * (2.0 + 1e-3 * (n as f64 + calls).sin())).collect()
        };
        let found = gmres(rounded, |x| Some(multiply(x)), &rhs, 1e-12, 3 * want.len());
        assert!(found.residual < 1e-12 && found.products <= want.len() + 3, "{}", found.products);
        for (got, want) in found.solution.iter().zip(&want) {
            assert!((got - want).abs() < 1e-9, "{got} {want}");
        }
        // Stopped early, it says how much is left.
        let found = gmres(<[f64]>::to_vec, |x| Some(multiply(x)), &rhs, 1e-12, 3);
        let mut left = rhs.clone();
        add(&mut left, -1.0, &multiply(&found.solution));
        let left = norm(&left) / norm(&rhs);
        assert!((left - found.residual).abs() < 1e-9, "{left} {}", found.residual);
    }

    #[test]
    fn nothing_is_asked_for_a_zero_right_side_and_a_refusal_ends_the_search() {
        let found = gmres(<[f64]>::to_vec, |_| None, &[0.0; 2], 0.1, 5);
        assert!(found.products == 0 && found.solution == [0.0; 2]);
        let found = gmres(<[f64]>::to_vec, |_| None, &[1.0; 2], 0.1, 5);
        assert!(found.products == 0 && found.residual == 1.0);
    }
}
