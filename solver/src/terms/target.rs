//! Smooth surfaces that a body slides on, by their signed distance.

use mammotwin_data::{Mat3, Vec3};

/// A smooth signed distance (mm), positive on the side where the body is.
pub trait Target: Send + Sync {
    /// Distance (mm), its gradient (no unit) and its second derivatives (1/mm).
    fn distance(&self, point: &Vec3) -> (f64, Vec3, Mat3);
}

/// A plane; the body is on the side of its normal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plane {
    /// A point of the plane (mm).
    pub point: Vec3,
    /// Unit normal.
    pub normal: Vec3,
}

impl Target for Plane {
    fn distance(&self, point: &Vec3) -> (f64, Vec3, Mat3) {
        (self.normal.dot(&(point - self.point)), self.normal, Mat3::zeros())
    }
}

/// An endless cylinder; the body is outside of it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cylinder {
    /// A point of the axis (mm).
    pub point: Vec3,
    /// Unit direction of the axis.
    pub axis: Vec3,
    /// Radius (mm).
    pub radius_mm: f64,
}

impl Target for Cylinder {
    fn distance(&self, point: &Vec3) -> (f64, Vec3, Mat3) {
        let across = Mat3::identity() - self.axis * self.axis.transpose();
        let arm = across * (point - self.point);
        let radius = arm.norm();
        let normal = arm.try_normalize(1e-9).unwrap_or_else(Vec3::zeros);
        let hessian = (across - normal * normal.transpose()) / radius.max(1e-9);
        (radius - self.radius_mm, normal, hessian)
    }
}

/// A sphere; the body is outside of it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sphere {
    /// Centre (mm).
    pub center: Vec3,
    /// Radius (mm).
    pub radius_mm: f64,
}

impl Target for Sphere {
    fn distance(&self, point: &Vec3) -> (f64, Vec3, Mat3) {
        let arm = point - self.center;
        let radius = arm.norm();
        let normal = arm.try_normalize(1e-9).unwrap_or_else(Vec3::zeros);
        let hessian = (Mat3::identity() - normal * normal.transpose()) / radius.max(1e-9);
        (radius - self.radius_mm, normal, hessian)
    }
}

/// A cylinder with round ends, such as an arm; the body is outside of it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Capsule {
    /// Ends of the axis (mm).
    pub ends: [Vec3; 2],
    /// Radius (mm).
    pub radius_mm: f64,
}

impl Target for Capsule {
    fn distance(&self, point: &Vec3) -> (f64, Vec3, Mat3) {
        let [from, to] = self.ends;
        let (axis, radius_mm) = (to - from, self.radius_mm);
        let along = axis.dot(&(point - from));
        if 0.0 < along && along < axis.norm_squared() {
            return Cylinder { point: from, axis: axis.normalize(), radius_mm }.distance(point);
        }
        Sphere { center: if along <= 0.0 { from } else { to }, radius_mm }.distance(point)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Verifies: distance to an arm and its derivatives, beside it and at both ends | cylinder and sphere in closed form; differences | 1e-12, 1e-6
    #[test]
    fn an_arm_is_a_cylinder_with_round_ends() {
        let (from, to) = (Vec3::new(1.0, 2.0, 3.0), Vec3::new(1.0, 2.0, 43.0));
        let arm = Capsule { ends: [from, to], radius_mm: 10.0 };
        for (point, wanted) in [
            (Vec3::new(21.0, 2.0, 20.0), 10.0),
            (Vec3::new(1.0, -4.0, 30.0), -4.0),
            (Vec3::new(4.0, 2.0, -1.0), -5.0),
            (Vec3::new(13.0, 18.0, 58.0), 15.0),
        ] {
            let (distance, slope, curvature) = arm.distance(&point);
            assert!((distance - wanted).abs() < 1e-12, "{point}: {distance}");
            for axis in 0..3 {
                let mut step = Vec3::zeros();
                step[axis] = 1e-5;
                let (ahead, behind) =
                    (arm.distance(&(point + step)), arm.distance(&(point - step)));
                assert!(((ahead.0 - behind.0) / 2e-5 - slope[axis]).abs() < 1e-6);
                assert!(((ahead.1 - behind.1) / 2e-5 - curvature.column(axis)).norm() < 1e-6);
            }
        }
    }
}
