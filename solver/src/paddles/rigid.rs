//! A rigid flat plate with a rounded edge towards the chest wall, endless otherwise.

use super::Bend;
use mammotwin_data::{Mat3, Vec3};

/// Shape of a plate; where its surface is along `into` is given with each question.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RoundedPlate {
    /// Unit normal of the plate's surface, from the body into the plate.
    pub into: Vec3,
    /// Unit vector away from the chest wall, along the plate.
    pub away: Vec3,
    /// Coordinate of the chest-wall edge along `away` (mm).
    pub edge_mm: f64,
    /// Radius of the rounded edge (mm).
    pub radius_mm: f64,
}

impl RoundedPlate {
    /// Signed distance (mm, negative inside of the plate) of a point from the plate whose surface
    /// is at `level_mm` along `into`, its gradient, and its second derivatives (1/mm).
    pub fn distance(&self, point: &Vec3, level_mm: f64) -> (f64, Vec3, Mat3) {
        let r = self.radius_mm;
        let a = self.edge_mm + r - self.away.dot(point);
        let b = level_mm + r - self.into.dot(point);
        if a > 0.0 && b > 0.0 {
            let reach = a.hypot(b);
            let normal = -(a * self.away + b * self.into) / reach;
            let along = (b * self.away - a * self.into) / reach;
            (reach - r, normal, along * along.transpose() / reach)
        } else if a > b {
            (a - r, -self.away, Mat3::zeros())
        } else {
            (b - r, -self.into, Mat3::zeros())
        }
    }

    /// The same with the surface lifted by `bend`, whose derivatives are along `away × into` and
    /// along `away`. The gradient is longer than one by what the lift is inclined.
    pub fn lifted_distance(&self, point: &Vec3, level_mm: f64, bend: &Bend) -> (f64, Vec3, Mat3) {
        let (distance, normal, curvature) = self.distance(point, level_mm + bend.value);
        let (along, away) = (self.away.cross(&self.into), self.away);
        let slope = bend.slope[0] * along + bend.slope[1] * away;
        let [uu, uv, vv] = bend.curvature;
        let bent = uu * along * along.transpose()
            + uv * (along * away.transpose() + away * along.transpose())
            + vv * away * away.transpose();
        let outwards = -normal.dot(&self.into);
        let moved = Mat3::identity() - self.into * slope.transpose();
        let curvature = moved.transpose() * curvature * moved + outwards * bent;
        (distance, normal + outwards * slope, curvature)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distance_has_the_derivatives_it_claims() {
        let plate =
            RoundedPlate { into: Vec3::y(), away: Vec3::z(), edge_mm: 20.0, radius_mm: 10.0 };
        let places = [[3.0, 24.0, 50.0], [0.0, 50.0, 19.0], [1.0, 28.0, 22.0], [0.0, 33.0, 27.0]];
        for place in places {
            let p = Vec3::from(place);
            let (_, gradient, hessian) = plate.distance(&p, 25.0);
            assert!((gradient.norm() - 1.0).abs() < 1e-12);
            for axis in 0..3 {
                let h = 1e-5;
                let mut step = Vec3::zeros();
                step[axis] = h;
                let up = plate.distance(&(p + step), 25.0);
                let down = plate.distance(&(p - step), 25.0);
                assert!(((up.0 - down.0) / (2.0 * h) - gradient[axis]).abs() < 1e-8);
                let slope = (up.1 - down.1) / (2.0 * h);
                assert!((slope - hessian.column(axis)).norm() < 1e-8);
            }
        }
        assert!((plate.distance(&Vec3::new(0.0, 24.0, 50.0), 25.0).0 - 1.0).abs() < 1e-12);
    }
}
