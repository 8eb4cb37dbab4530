//! Rigid motion from a few points on the chest wall.

use super::RegisterError;
use mammotwin_data::{Mat3, Vec3, rigid::RigidTransform};

/// A rigid motion, and how well it fits.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fit {
    /// From the moving points to the reference points.
    pub transform: RigidTransform,
    /// Root mean square distance after the motion (mm).
    pub rms_mm: f64,
}

/// The rotation and translation with the least squared distance of pairs `(moving, reference)`.
///
/// Never a reflection (Umeyama 1991, doi:10.1109/34.88573).
///
/// # Errors
/// With less than three pairs, or when all points lie on a line.
pub fn fit(pairs: &[(Vec3, Vec3)]) -> Result<Fit, RegisterError> {
    let count = pairs.len();
    let finite = |(a, b): &(Vec3, Vec3)| a.iter().chain(b.iter()).all(|x| x.is_finite());
    if let Some(index) = pairs.iter().position(|pair| !finite(pair)) {
        return Err(RegisterError::NotFinite { index });
    }
    let mean = |side: fn(&(Vec3, Vec3)) -> Vec3| {
        pairs.iter().map(side).sum::<Vec3>() / count.max(1) as f64
    };
    let (from, to) = (mean(|pair| pair.0), mean(|pair| pair.1));
    let cross: Mat3 = pairs.iter().map(|(a, b)| (b - to) * (a - from).transpose()).sum();
    let svd = cross.svd(true, true);
    let (Some(u), Some(v_t)) = (svd.u, svd.v_t) else {
        return Err(RegisterError::Landmarks { count });
    };
    // Singular values are sorted; the second one is 0 for points on a line.
    let s = svd.singular_values;
    if count < 3 || !(s[1] > 1e-6 * s[0] && s[1] > 1e-6) {
        return Err(RegisterError::Landmarks { count });
    }
    let handed = (u * v_t).determinant().signum();
    let rotation = u * Mat3::from_diagonal(&Vec3::new(1.0, 1.0, handed)) * v_t;
    let transform = RigidTransform { rotation, translation: to - rotation * from };
    let squares = pairs.iter().map(|(a, b)| (transform.point(a) - b).norm_squared());
    Ok(Fit { transform, rms_mm: (squares.sum::<f64>() / count as f64).sqrt() })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn chest() -> [Vec3; 5] {
        [[0., 95., 60.], [5., 100., -20.], [95., 40., 10.], [-90., 45., 15.], [60., 70., 70.]]
            .map(Vec3::from)
    }

    fn motion() -> RigidTransform {
        let turn = Vec3::new(0.1, -0.2, 48f64.to_radians());
        RigidTransform::about(&Vec3::new(0.0, 40.0, 0.0), &turn, &Vec3::new(12.0, -20.0, 30.0))
    }

    #[test]
    fn exact_pairs_give_the_motion() {
        let pairs = chest().map(|p| (p, motion().point(&p)));
        let found = fit(&pairs).unwrap();
        assert!(found.rms_mm < 1e-12);
        assert!((found.transform.rotation - motion().rotation).norm() < 1e-13);
        assert!((found.transform.translation - motion().translation).norm() < 1e-11);
    }

    #[test]
    fn the_fit_is_a_minimum_and_never_a_reflection() {
        // Mirrored points: the best rotation is asked for, not the mirror.
        let pairs = chest().map(|p| (p, Vec3::new(-p.x, p.y + p.z * p.x / 200.0, p.z)));
        let found = fit(&pairs).unwrap();
        assert!((found.transform.rotation.determinant() - 1.0).abs() < 1e-12);
        let rms = |t: &RigidTransform| {
            let squares = pairs.iter().map(|(a, b)| (t.point(a) - b).norm_squared());
            (squares.sum::<f64>() / pairs.len() as f64).sqrt()
        };
        assert!((rms(&found.transform) - found.rms_mm).abs() < 1e-12);
        for axis in 0..3 {
            for step in [-1e-3, 1e-3] {
                let turned = RigidTransform::about(
                    &Vec3::new(0.0, 80.0, 0.0),
                    &Vec3::ith(axis, step),
                    &Vec3::zeros(),
                );
                assert!(rms(&found.transform.then(&turned)) > found.rms_mm);
                let shift = RigidTransform {
                    translation: Vec3::ith(axis, step),
                    ..RigidTransform::identity()
                };
                assert!(rms(&found.transform.then(&shift)) > found.rms_mm);
            }
        }
    }

    #[test]
    fn points_on_a_line_are_refused() {
        let line = [0.0, 1.0, 2.0, 5.0].map(|t| (Vec3::new(t, 2.0 * t, 1.0), Vec3::new(1., t, t)));
        assert_eq!(fit(&line), Err(RegisterError::Landmarks { count: 4 }));
        assert_eq!(fit(&line[..2]), Err(RegisterError::Landmarks { count: 2 }));
        assert_eq!(fit(&[]), Err(RegisterError::Landmarks { count: 0 }));
        let odd = [(Vec3::new(f64::NAN, 0.0, 0.0), Vec3::zeros())];
        assert_eq!(fit(&odd), Err(RegisterError::NotFinite { index: 0 }));
    }
}
