//! Whether breasts moved as gravity is said to have pulled: a pose that is called by the wrong name is seen before
//! anything is fitted to it.

use crate::{pose::PoseTarget, shape::Shape};
use mammotwin_data::{Failure, Vec3};
use nalgebra::DVector;

/// Change of the unit vectors of gravity from which breasts have to follow it, and below which gravity is the same
/// (0.1: 6°).
const CLEAR: f64 = 0.5;
const SAME: f64 = 0.1;
/// Skin that moved farther than this (mm) against the change of gravity did not follow it. Errors of the registration and
/// of the chest wall are 1 - 3 mm.
const AGAINST_MM: f64 = 3.0;
/// Skin that changed its shape by more than this (mm rms) had another gravity: five times what chest walls change by.
const CHANGED_MM: f64 = 5.0;

/// Refuses a pose whose skin moved against what is stated of its gravity. `reference` is the skin of the reference pose at
/// the nodes that are compared, `gravity` its gravity there.
///
/// # Errors
/// [`Failure::BadInput`] that names the pose, [`Failure::Numerics`] when distances cannot be measured.
pub fn refuse_wrong(
    target: &PoseTarget,
    name: &str,
    reference: &Shape,
    gravity: &Vec3,
) -> Result<(), Failure> {
    let signed_mm = target.signed_mm(&reference.points)?;
    let (pose, change) = (&target.pose, target.gravity - gravity);
    let mend = "correct posture or gravity_in_image, or the registration";
    let why = if change.norm() > CLEAR {
        let along_mm = moved_along(reference, &signed_mm, &change.normalize());
        (along_mm < -AGAINST_MM).then(|| {
            format!("the breasts moved by {:.0} mm against the change of gravity from {name} that is stated", -along_mm)
        })
    } else if change.norm() < SAME {
        let changed_mm = reference.without_rigid_mm(&DVector::from_vec(signed_mm));
        (changed_mm > CHANGED_MM).then(|| {
            format!("gravity is stated to be that of {name}, but the skin changed by {changed_mm:.0} mm (rms)")
        })
    } else {
        None
    };
    match why {
        Some(why) => Err(Failure::BadInput(format!("poses.{pose}: {why}; {mend}"))),
        None => Ok(()),
    }
}

/// Translation (mm) of a skin along a unit vector that explains best its signed distances to another skin, which are
/// positive where it lies outside of that.
fn moved_along(skin: &Shape, signed_mm: &[f64], along: &Vec3) -> f64 {
    let (mut sum, mut squares) = (0.0, 0.0);
    for (normal, signed) in skin.normals.iter().zip(signed_mm) {
        let facing = normal.dot(along);
        sum -= facing * signed;
        squares += facing * facing;
    }
    sum / f64::max(squares, f64::MIN_POSITIVE)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ball_that_is_moved_has_moved_by_so_much() {
        let turn = |n: usize| (0.7 * n as f64, 2.4 * n as f64);
        let normals: Vec<Vec3> = (0..40)
            .map(|n| turn(n))
            .map(|(a, b)| Vec3::new(a.sin() * b.cos(), a.sin() * b.sin(), a.cos()))
            .collect();
        let skin = Shape { points: normals.iter().map(|n| 50.0 * n).collect(), normals };
        let shift = Vec3::new(0.0, 0.3, -0.4);
        // Distances of the unmoved to the moved ball.
        let signed: Vec<f64> = skin.points.iter().map(|p| (p - shift).norm() - 50.0).collect();
        let along = moved_along(&skin, &signed, &shift.normalize());
        assert!((along - 0.5).abs() < 0.02, "{along}");
        assert!((moved_along(&skin, &signed, &-shift.normalize()) + 0.5).abs() < 0.02);
    }
}
