//! Eigenvalues of a symmetric matrix by Jacobi rotations.

use mammotwin_data::{Mat3, Vec3};

/// Eigenvalues, in no order, and eigenvectors of a symmetric matrix; `None` for NaN.
pub(crate) fn eigen(matrix: &Mat3) -> Option<(Vec3, Mat3)> {
    if !matrix.iter().all(|v| v.is_finite()) {
        return None;
    }
    let (mut a, mut v) = (*matrix, Mat3::identity());
    let scale = a.norm();
    for _ in 0..40 {
        let mut off = 0.0;
        for p in 0..3 {
            for q in 0..p {
                off += a[(p, q)] * a[(p, q)];
            }
        }
        if off.sqrt() <= 1e-13 * scale {
            break;
        }
        for p in 0..3 {
            for q in 0..p {
                if a[(p, q)].abs() > 1e-300 {
                    rotate(&mut a, &mut v, p, q);
                }
            }
        }
    }
    Some((a.diagonal(), v))
}

/// One Jacobi rotation that zeroes a[(p, q)].
fn rotate(a: &mut Mat3, v: &mut Mat3, p: usize, q: usize) {
    let ratio = (a[(q, q)] - a[(p, p)]) / (2.0 * a[(p, q)]);
    let t = ratio.signum() / (ratio.abs() + (ratio * ratio + 1.0).sqrt());
    let c = 1.0 / (t * t + 1.0).sqrt();
    let s = t * c;
    for k in 0..3 {
        let (x, y) = (a[(k, p)], a[(k, q)]);
        (a[(k, p)], a[(k, q)]) = (c * x - s * y, s * x + c * y);
    }
    for k in 0..3 {
        let (x, y) = (a[(p, k)], a[(q, k)]);
        (a[(p, k)], a[(q, k)]) = (c * x - s * y, s * x + c * y);
        let (x, y) = (v[(k, p)], v[(k, q)]);
        (v[(k, p)], v[(k, q)]) = (c * x - s * y, s * x + c * y);
    }
}
