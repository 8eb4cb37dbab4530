//! A flat paddle on a gimbal: it tilts about an axis along the chest-wall edge and rolls about the
//! one across it, as the body turns it.
//!
//! Standard flex paddles tilt in the medio-lateral direction too, by 0.04 to 0.69 degrees (Ma et al.
//! 2016, Br J Radiol 89:20150715). The planes are exact; torques are those of small angles.

use super::{AT_REST, Bend, Lift, Place, Pose};

/// Coordinates are the lift at this distance from the axes (mm).
const ARM_MM: f64 = 100.0;

/// A gimbal with a spring about each axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gimbal {
    /// Distance of the tilt's axis from the chest-wall edge (mm).
    pub axis_mm: f64,
    /// Torque by tilt (mN mm/rad).
    pub tilt_mn_mm: f64,
    /// Torque by roll (mN mm/rad).
    pub roll_mn_mm: f64,
}

impl Gimbal {
    fn arms(&self, [along, away]: Place) -> [f64; 2] {
        [(away - self.axis_mm) / ARM_MM, along / ARM_MM]
    }
}

impl Lift for Gimbal {
    fn coordinates(&self) -> usize {
        2
    }

    fn bend(&self, place: Place, pose: &Pose) -> Bend {
        let [tilt, roll] = self.arms(place);
        Bend {
            value: pose[0] * tilt + pose[1] * roll,
            slope: [pose[1] / ARM_MM, pose[0] / ARM_MM],
            curvature: [0.0; 3],
        }
    }

    fn weights(&self, place: Place) -> Pose {
        let [tilt, roll] = self.arms(place);
        let mut weights = AT_REST;
        (weights[0], weights[1]) = (tilt, roll);
        weights
    }

    fn resistance(&self, pose: &Pose) -> (Pose, Pose) {
        let (mut force, mut stiffness) = (AT_REST, AT_REST);
        for (n, torque) in [self.tilt_mn_mm, self.roll_mn_mm].into_iter().enumerate() {
            stiffness[n] = torque / (ARM_MM * ARM_MM);
            force[n] = stiffness[n] * pose[n];
        }
        (force, stiffness)
    }

    fn angles(&self, pose: &Pose) -> [f64; 2] {
        [(-pose[0] / ARM_MM).atan(), (pose[1] / ARM_MM).atan()]
    }
}
