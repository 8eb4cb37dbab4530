//! A rigid flat plate with rounded edges: along the chest wall, or all around where it is finite.

use super::{Bend, Outline, Place};
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
    /// Radius of the rounded edges (mm).
    pub radius_mm: f64,
    /// Coordinate of the plate's middle along `away` × `into` (mm).
    pub middle_mm: f64,
    /// Where the plate ends; its corners are no sharper than `radius_mm`.
    pub outline: Outline,
}

impl RoundedPlate {
    /// Unit vector along the chest-wall edge.
    pub fn along(&self) -> Vec3 {
        self.away.cross(&self.into)
    }

    /// Place of a point (mm) on the plate.
    pub fn place(&self, point: &Vec3) -> Place {
        [self.along().dot(point) - self.middle_mm, self.away.dot(point) - self.edge_mm]
    }

    /// Signed distance (mm, negative inside of the plate) of a point from the plate whose surface
    /// is at `level_mm` along `into`, its gradient, and its second derivatives (1/mm). With `a` from
    /// the outline moved inwards by the radius, and `b` from the surface moved so, the plate is what
    /// the radius reaches from there: exact for every outline whose own distance is.
    pub fn distance(&self, point: &Vec3, level_mm: f64) -> (f64, Vec3, Mat3) {
        let r = self.radius_mm;
        let border = self.outline.distance(self.place(point));
        let (along, away) = (self.along(), self.away);
        let outwards = border.slope[0] * along + border.slope[1] * away;
        let [uu, uv, vv] = border.curvature;
        let curved = || in_plane(&along, &away, [uu, uv, vv]);
        let a = border.value + r;
        let b = level_mm + r - self.into.dot(point);
        if a > 0.0 && b > 0.0 {
            let reach = a.hypot(b);
            let normal = (a * outwards - b * self.into) / reach;
            let across = (b * outwards + a * self.into) / reach;
            let rounded = across * across.transpose() / reach;
            (reach - r, normal, rounded + a / reach * curved())
        } else if a > b {
            (a - r, outwards, curved())
        } else {
            (b - r, -self.into, Mat3::zeros())
        }
    }

    /// The same with the surface lifted by `bend`, whose derivatives are along `away × into` and
    /// along `away`. The gradient is longer than one by what the lift is inclined.
    pub fn lifted_distance(&self, point: &Vec3, level_mm: f64, bend: &Bend) -> (f64, Vec3, Mat3) {
        let (distance, normal, curvature) = self.distance(point, level_mm + bend.value);
        let (along, away) = (self.along(), self.away);
        let slope = bend.slope[0] * along + bend.slope[1] * away;
        let bent = in_plane(&along, &away, bend.curvature);
        let outwards = -normal.dot(&self.into);
        let moved = Mat3::identity() - self.into * slope.transpose();
        let curvature = moved.transpose() * curvature * moved + outwards * bent;
        (distance, normal + outwards * slope, curvature)
    }
}

/// Second derivatives in space of a function of the place.
fn in_plane(along: &Vec3, away: &Vec3, [uu, uv, vv]: [f64; 3]) -> Mat3 {
    uu * along * along.transpose()
        + uv * (along * away.transpose() + away * along.transpose())
        + vv * away * away.transpose()
}

#[cfg(test)]
mod tests {
    use super::*;

    use crate::paddles::RoundedRectangle;

    fn plate(outline: Outline) -> RoundedPlate {
        let (into, away) = (Vec3::y(), Vec3::z());
        RoundedPlate { into, away, edge_mm: 20.0, radius_mm: 10.0, middle_mm: 3.0, outline }
    }

    #[test]
    fn distance_has_the_derivatives_it_claims() {
        let small = RoundedRectangle::new([60.0, 50.0], 12.0, 0.0, 0.0);
        let window = RoundedRectangle::new([50.0, 40.0], 12.0, 0.0, 25.0);
        let outlines = [
            Outline::ENDLESS,
            Outline { plate: Some(small), window: None },
            Outline { window: Some(window), plate: None },
        ];
        let places = [
            [3.0, 24.0, 50.0],
            [0.0, 50.0, 19.0],
            [1.0, 28.0, 22.0],
            [0.0, 33.0, 27.0],
            // At a corner of the small plate, beside it and under its rear, and in the window.
            [-30.0, 26.0, 21.0],
            [31.0, 40.0, 40.0],
            [5.0, 27.0, 69.0],
            [-20.0, 27.0, 48.0],
            [21.0, 31.0, 81.0],
        ];
        for shape in outlines.map(plate) {
            for place in places {
                let p = Vec3::from(place);
                let (_, gradient, hessian) = shape.distance(&p, 25.0);
                assert!((gradient.norm() - 1.0).abs() < 1e-12);
                for axis in 0..3 {
                    let h = 1e-5;
                    let mut step = Vec3::zeros();
                    step[axis] = h;
                    let up = shape.distance(&(p + step), 25.0);
                    let down = shape.distance(&(p - step), 25.0);
                    assert!(((up.0 - down.0) / (2.0 * h) - gradient[axis]).abs() < 1e-8);
                    let slope = (up.1 - down.1) / (2.0 * h);
                    assert!((slope - hessian.column(axis)).norm() < 1e-8, "{place:?}");
                }
            }
            assert!((shape.distance(&Vec3::new(-3.0, 24.0, 33.0), 25.0).0 - 1.0).abs() < 1e-12);
        }
    }
}
