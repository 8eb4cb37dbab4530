//! Whether breasts moved as gravity is said to have pulled: a pose that is called by the wrong name is seen before
//! anything is fitted to it.

use crate::{pose::PoseTarget, shape::Shape};
use mammotwin_data::{Failure, Vec3};
use nalgebra::DVector;

/// Change of the unit vectors of gravity from which breasts have to follow it (0.6: 35°), and below which gravity is the
/// same (0.1: 6°).
const CLEAR: f64 = 0.6;
const SAME: f64 = 0.1;
/// Correlation of how far skin went outward with its place along the change of gravity, below which breasts moved against
/// it. Of six digital volunteers, each of two tissues, it is 0.56 to 0.73 prone and 0.45 to 0.85 upright, beside supine; of
/// three, tilted by 48°, 0.37 to 0.59, and -0.35 to -0.61 where the tilt is stated to the other side.
const AGAINST: f64 = -0.2;
/// Skin that changed its shape by more than this (mm rms) had another gravity. Chest walls and labels leave up to 1.2 mm,
/// prone beside supine 4 to 7 mm remain of the smallest breasts that were tried.
const CHANGED_MM: f64 = 3.0;

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
        let follows = follows(reference, &signed_mm, &change);
        (follows < AGAINST).then(|| {
            format!("the breasts moved against the change of gravity from {name} that is stated (correlation {follows:.2})")
        })
    } else if change.norm() < SAME {
        let changed_mm = reference.without_rigid_mm(&DVector::from_vec(signed_mm));
        (changed_mm > CHANGED_MM).then(|| {
            format!(
                "gravity is stated to be that of {name}, but the skin changed by {changed_mm:.1} mm (rms)"
            )
        })
    } else {
        None
    };
    match why {
        Some(why) => Err(Failure::BadInput(format!("{pose}: {why}; {mend}"))),
        None => Ok(()),
    }
}

/// Correlation of how far a skin has to go outward to another one (less its signed distances, positive where it lies outside
/// of that) with its place along the change of gravity.
///
/// The centre of mass X of an elastic body moves along the change of gravity, whatever it is made of: each pose has the least
/// energy under its own gravity, and the sum of both inequalities is m (g₁ - g₀) · (X₁ - X₀) ≥ 0. At constant volume, X moves
/// to where skin goes outward.
fn follows(skin: &Shape, signed_mm: &[f64], change: &Vec3) -> f64 {
    let count = skin.points.len().max(1) as f64;
    let place: Vec<f64> = skin.points.iter().map(|p| p.dot(change)).collect();
    let [middle, outward] =
        [place.iter().sum::<f64>() / count, -signed_mm.iter().sum::<f64>() / count];
    let (mut both, mut places, mut ways) = (0.0, 0.0, 0.0);
    for (place, signed) in place.iter().zip(signed_mm) {
        let (place, way) = (place - middle, -signed - outward);
        both += place * way;
        places += place * place;
        ways += way * way;
    }
    both / f64::max((places * ways).sqrt(), f64::MIN_POSITIVE)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ball_that_sags_has_followed_and_one_that_rose_has_not() {
        // The 26 directions of a cube's corners, edges and faces.
        let place = |n: usize| [n % 3, n / 3 % 3, n / 9].map(|k| k as f64 - 1.0);
        let normals: Vec<Vec3> =
            (0..27).filter_map(|n| Vec3::from(place(n)).try_normalize(0.5)).collect();
        let skin = Shape { points: normals.iter().map(|n| 50.0 * n).collect(), normals };
        let shift = Vec3::new(0.0, 0.3, -0.4);
        // Distances of the unmoved to the moved ball: outward where it faces along the motion.
        let signed: Vec<f64> = skin.points.iter().map(|p| (p - shift).norm() - 50.0).collect();
        assert!(follows(&skin, &signed, &shift) > 0.999);
        assert!(follows(&skin, &signed, &-shift) < -0.999);
        let across = Vec3::new(0.0, 0.4, 0.3);
        assert!(follows(&skin, &signed, &across).abs() < 0.01);
        // Swollen alike everywhere: no direction.
        assert_eq!(follows(&skin, &[-1.0; 26], &shift), 0.0);
    }
}
