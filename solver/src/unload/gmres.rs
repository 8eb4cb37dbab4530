//! Generalised minimal residuals on fields of nodal vectors.
//!
//! Saad & Schultz, *SIAM J. Sci. Stat. Comput.* 7 (1986) 856, without restarts: the operators here
//! are preconditioned to be near the identity.

use mammotwin_data::Vec3;

/// An approximate solution.
pub(super) struct Found {
    pub solution: Vec<Vec3>,
    /// Norm of what is left of the right-hand side, over its own.
    pub residual: f64,
    /// Applications of the operator.
    pub products: usize,
}

pub(super) fn dot(a: &[Vec3], b: &[Vec3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a.dot(b)).sum()
}

/// a += factor b
fn add(a: &mut [Vec3], factor: f64, b: &[Vec3]) {
    a.iter_mut().zip(b).for_each(|(a, b)| *a += factor * b);
}

/// Solves `operator`(x) = `rhs` down to a relative `residual`, in at most `products` applications
/// of the operator. An operator that refuses (`None`) ends the search with what there is.
pub(super) fn gmres(
    mut operator: impl FnMut(&[Vec3]) -> Option<Vec<Vec3>>,
    rhs: &[Vec3],
    residual: f64,
    products: usize,
) -> Found {
    let size = dot(rhs, rhs).sqrt();
    let mut basis = vec![rhs.iter().map(|v| v / size.max(f64::MIN_POSITIVE)).collect::<Vec<_>>()];
    // Columns of the triangular factor, the rotations that made it, and the turned right side.
    let mut columns: Vec<Vec<f64>> = Vec::new();
    let mut rotations: Vec<(f64, f64)> = Vec::new();
    let mut turned = vec![size];
    while columns.len() < products && turned[columns.len()].abs() > residual * size {
        let Some(mut next) = operator(&basis[columns.len()]) else { break };
        let mut column = Vec::new();
        for old in &basis {
            let along = dot(&next, old);
            add(&mut next, -along, old);
            column.push(along);
        }
        let rest = dot(&next, &next).sqrt();
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
    let mut solution = vec![Vec3::zeros(); rhs.len()];
    for (weight, vector) in weights.iter().zip(&basis) {
        add(&mut solution, *weight, vector);
    }
    let left = turned[count].abs() / size.max(f64::MIN_POSITIVE);
    Found { solution, residual: left, products: count }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mammotwin_data::Mat3;

    #[test]
    fn an_unsymmetric_system_is_solved() {
        let n = 7;
        let block = |a: usize, b: usize| {
            let x = (1.0 + a as f64, 2.0 + b as f64);
            0.1 * Mat3::from_fn(|r, c| (x.0 * (1.0 + r as f64) + x.1 * c as f64).sin())
        };
        let multiply = |x: &[Vec3]| -> Vec<Vec3> {
            (0..n).map(|a| x[a] + (0..n).map(|b| block(a, b) * x[b]).sum::<Vec3>()).collect()
        };
        let want: Vec<Vec3> = (0..n).map(|a| Vec3::new(a as f64, 1.0, -2.0)).collect();
        let rhs = multiply(&want);
        let found = gmres(|x| Some(multiply(x)), &rhs, 1e-12, 3 * n);
        assert!(found.residual < 1e-12 && found.products <= 3 * n, "{}", found.residual);
        for (got, want) in found.solution.iter().zip(&want) {
            assert!((got - want).norm() < 1e-9, "{got} {want}");
        }
        // Stopped early, it says how much is left.
        let found = gmres(|x| Some(multiply(x)), &rhs, 1e-12, 3);
        let mut left = rhs.clone();
        add(&mut left, -1.0, &multiply(&found.solution));
        let left = (dot(&left, &left) / dot(&rhs, &rhs)).sqrt();
        assert!((left - found.residual).abs() < 1e-9, "{left} {}", found.residual);
    }

    #[test]
    fn nothing_is_asked_for_a_zero_right_side_and_a_refusal_ends_the_search() {
        let found = gmres(|_| None, &[Vec3::zeros(); 2], 0.1, 5);
        assert!(found.products == 0 && found.solution == [Vec3::zeros(); 2]);
        let found = gmres(|_| None, &[Vec3::x(); 2], 0.1, 5);
        assert!(found.products == 0 && found.residual == 1.0);
    }
}
