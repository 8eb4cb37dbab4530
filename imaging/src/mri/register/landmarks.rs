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

/// Iterative closest points (Besl and McKay 1992): for landmarks that nobody named.
///
/// Starts from `start` and from turns of it by up to 60 degrees about each axis, and keeps the
/// best fit; of equally good ones the smallest turn, since chests are nearly symmetric.
///
/// # Errors
/// As [`fit`].
pub fn icp(
    moving: &[Vec3],
    reference: &[Vec3],
    start: &RigidTransform,
) -> Result<Fit, RegisterError> {
    let count = moving.len().min(reference.len());
    if count < 3 {
        return Err(RegisterError::Landmarks { count });
    }
    for points in [moving, reference] {
        if let Some(index) = points.iter().position(|p| !p.iter().all(|x| x.is_finite())) {
            return Err(RegisterError::NotFinite { index });
        }
    }
    let center = moving.iter().sum::<Vec3>() / moving.len() as f64;
    let target = reference.iter().sum::<Vec3>() / reference.len() as f64;
    let mut turns = vec![Vec3::zeros()];
    for degrees in [20.0f64, 40.0, 60.0] {
        for axis in 0..3 {
            for sign in [1.0, -1.0] {
                turns.push(Vec3::ith(axis, sign * degrees.to_radians()));
            }
        }
    }
    let mut best: Option<Fit> = None;
    for turn in turns {
        let about = start.point(&center);
        let turned = start.then(&RigidTransform::about(&about, &turn, &(target - about)));
        let Ok(fit) = closest_points(moving, reference, turned) else { continue };
        if best.is_none_or(|best| fit.rms_mm < 0.9 * best.rms_mm) {
            best = Some(fit);
        }
    }
    best.ok_or(RegisterError::Landmarks { count })
}

fn closest_points(
    moving: &[Vec3],
    reference: &[Vec3],
    start: RigidTransform,
) -> Result<Fit, RegisterError> {
    let mut transform = start;
    let mut matches: Vec<usize> = Vec::new();
    loop {
        let now = matched(moving, reference, &transform);
        let pairs: Vec<(Vec3, Vec3)> =
            now.iter().enumerate().map(|(n, &m)| pair(moving, reference, n, m)).collect();
        let fit = fit(&pairs)?;
        // Each round lessens the squared distance, so no assignment comes back but the last.
        if now == matches {
            return Ok(fit);
        }
        (transform, matches) = (fit.transform, now);
    }
}

/// For each point of the smaller set, the index of its partner in the larger: nearest pairs
/// first, each partner once.
fn matched(moving: &[Vec3], reference: &[Vec3], transform: &RigidTransform) -> Vec<usize> {
    let moved: Vec<Vec3> = moving.iter().map(|p| transform.point(p)).collect();
    let (few, many) = if moved.len() <= reference.len() {
        (moved.as_slice(), reference)
    } else {
        (reference, moved.as_slice())
    };
    let mut links: Vec<(f64, usize, usize)> = Vec::with_capacity(few.len() * many.len());
    for (f, a) in few.iter().enumerate() {
        links.extend(many.iter().enumerate().map(|(m, b)| ((a - b).norm_squared(), f, m)));
    }
    links.sort_by(|a, b| a.0.total_cmp(&b.0).then((a.1, a.2).cmp(&(b.1, b.2))));
    let mut partner = vec![usize::MAX; few.len()];
    let mut taken = vec![false; many.len()];
    for (_, f, m) in links {
        if partner[f] == usize::MAX && !taken[m] {
            partner[f] = m;
            taken[m] = true;
        }
    }
    partner
}

fn pair(moving: &[Vec3], reference: &[Vec3], few: usize, many: usize) -> (Vec3, Vec3) {
    if moving.len() <= reference.len() {
        (moving[few], reference[many])
    } else {
        (moving[many], reference[few])
    }
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

    #[test]
    fn unnamed_points_find_their_partners_after_a_tilt_of_48_degrees() {
        let moving = chest();
        let mut reference = moving.map(|p| motion().point(&p)).to_vec();
        reference.reverse();
        reference.push(Vec3::new(0.0, 0.0, -150.0));
        let found = icp(&moving, &reference, &RigidTransform::identity()).unwrap();
        assert!(found.rms_mm < 1e-9, "{found:?}");
        let back = icp(&reference, &moving, &RigidTransform::identity()).unwrap();
        let both = found.transform.then(&back.transform);
        assert!(both.translation.norm() < 1e-8 && both.angle() < 1e-8);
    }
}
