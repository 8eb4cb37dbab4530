//! Rigid motions: rotation, then translation.

use crate::{Mat3, Vec3};

/// `p -> rotation * p + translation`, in mm.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct RigidTransform {
    /// Proper rotation; JSON has its three rows.
    #[serde(with = "rows")]
    pub rotation: Mat3,
    /// Translation (mm), applied after the rotation.
    pub translation: Vec3,
}

/// A matrix as people write it: three rows of three numbers.
mod rows {
    use crate::Mat3;
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    pub fn serialize<S: Serializer>(matrix: &Mat3, to: S) -> Result<S::Ok, S::Error> {
        // An array of a matrix has its columns; those of the transpose are the rows.
        <[[f64; 3]; 3]>::from(matrix.transpose()).serialize(to)
    }

    pub fn deserialize<'a, D: Deserializer<'a>>(from: D) -> Result<Mat3, D::Error> {
        <[[f64; 3]; 3]>::deserialize(from).map(|rows| Mat3::from(rows).transpose())
    }
}

impl RigidTransform {
    /// The motion that moves nothing.
    pub fn identity() -> Self {
        Self { rotation: Mat3::identity(), translation: Vec3::zeros() }
    }

    /// Rotation by a rotation vector (rad) about `center` (mm), then a translation (mm).
    pub fn about(center: &Vec3, rotation_vector: &Vec3, translation: &Vec3) -> Self {
        let rotation = *nalgebra::Rotation3::new(*rotation_vector).matrix();
        Self { rotation, translation: center - rotation * center + translation }
    }

    /// Image of a point.
    pub fn point(&self, p: &Vec3) -> Vec3 {
        self.rotation * p + self.translation
    }

    /// Image of a direction.
    pub fn direction(&self, v: &Vec3) -> Vec3 {
        self.rotation * v
    }

    /// The motion back.
    pub fn inverse(&self) -> Self {
        let rotation = self.rotation.transpose();
        Self { rotation, translation: -(rotation * self.translation) }
    }

    /// This motion first, then `next`.
    pub fn then(&self, next: &Self) -> Self {
        Self {
            rotation: next.rotation * self.rotation,
            translation: next.rotation * self.translation + next.translation,
        }
    }

    /// Angle of the rotation (rad).
    pub fn angle(&self) -> f64 {
        // From sine and cosine together: accurate at small angles, where acos is not.
        let r = &self.rotation;
        let axis = Vec3::new(r[(2, 1)] - r[(1, 2)], r[(0, 2)] - r[(2, 0)], r[(1, 0)] - r[(0, 1)]);
        (0.5 * axis.norm()).atan2(0.5 * (r.trace() - 1.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_motion_and_its_inverse_cancel() {
        let center = Vec3::new(10.0, -20.0, 5.0);
        let motion =
            RigidTransform::about(&center, &Vec3::new(0.1, -0.7, 0.4), &Vec3::new(1.0, 2.0, 3.0));
        let both = motion.then(&motion.inverse());
        assert!((both.rotation - Mat3::identity()).norm() < 1e-14);
        assert!(both.translation.norm() < 1e-12);
        assert!((motion.point(&center) - center - Vec3::new(1.0, 2.0, 3.0)).norm() < 1e-12);
        assert!((motion.angle() - Vec3::new(0.1, -0.7, 0.4).norm()).abs() < 1e-12);
    }
    #[test]
    fn json_has_the_rows_of_a_rotation() {
        // A quarter turn about z: x goes to y, so that the first row is (0, -1, 0).
        let rotation = Mat3::new(0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0);
        let motion = RigidTransform { rotation, translation: Vec3::new(1.0, 2.0, 3.0) };
        let text = serde_json::to_string(&motion).unwrap();
        let rows = "[[0.0,-1.0,0.0],[1.0,0.0,0.0],[0.0,0.0,1.0]]";
        assert_eq!(text, format!("{{\"rotation\":{rows},\"translation\":[1.0,2.0,3.0]}}"));
        assert_eq!(serde_json::from_str::<RigidTransform>(&text).unwrap(), motion);
    }
}
