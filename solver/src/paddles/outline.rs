//! Where a plate ends: the outline of finite plates, and the window of a biopsy paddle.

use super::{Bend, Place};

/// A rectangle with round corners; a disc when its corners are as round as it is wide.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RoundedRectangle {
    /// Its middle: along the plate's chest-wall edge, and away from that edge (mm).
    pub middle: Place,
    /// Half of its width along the edge and of its depth away from it (mm).
    pub half: [f64; 2],
    /// Radius of its corners (mm), at most the smaller half.
    pub corner_mm: f64,
}

impl RoundedRectangle {
    /// The rectangle whose side along the chest-wall edge begins `away_mm` from it and whose middle
    /// is `along_mm` beside the plate's.
    pub fn new(size_mm: [f64; 2], corner_mm: f64, along_mm: f64, away_mm: f64) -> Self {
        let half = size_mm.map(|length| 0.5 * length);
        Self { middle: [along_mm, away_mm + half[1]], half, corner_mm }
    }

    /// Signed distance (mm) of a place, negative inside, with its derivatives: exact outside of the
    /// rectangle and within `corner_mm` of its border, where it is smooth.
    pub fn distance(&self, place: Place) -> Bend {
        let mut beyond = [0.0; 2];
        let mut side = [0.0; 2];
        for n in 0..2 {
            let offset = place[n] - self.middle[n];
            side[n] = if offset < 0.0 { -1.0 } else { 1.0 };
            beyond[n] = offset.abs() - self.half[n] + self.corner_mm;
        }
        let [x, y] = beyond;
        if x > 0.0 && y > 0.0 {
            let reach = x.hypot(y);
            let (cos, sin) = (side[0] * x / reach, side[1] * y / reach);
            let curvature = [sin * sin / reach, -sin * cos / reach, cos * cos / reach];
            return Bend { value: reach - self.corner_mm, slope: [cos, sin], curvature };
        }
        let (value, slope) = if x > y { (x, [side[0], 0.0]) } else { (y, [0.0, side[1]]) };
        Bend { value: value - self.corner_mm, slope, curvature: [0.0; 3] }
    }
}

/// What of its plane a plate fills. Both rectangles are given on the plate, by [`Place`].
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Outline {
    /// The plate; endless behind its chest-wall edge when `None`.
    pub plate: Option<RoundedRectangle>,
    /// A hole in it.
    pub window: Option<RoundedRectangle>,
}

impl Outline {
    /// A plate that ends at its chest-wall edge only.
    pub const ENDLESS: Self = Self { plate: None, window: None };

    /// Signed distance (mm) of a place from the plate's border, negative on the plate, with its
    /// derivatives.
    pub fn distance(&self, place: Place) -> Bend {
        let outer = match &self.plate {
            None => Bend { value: -place[1], slope: [0.0, -1.0], curvature: [0.0; 3] },
            Some(plate) => plate.distance(place),
        };
        let Some(window) = &self.window else { return outer };
        let Bend { value, slope, curvature } = window.distance(place);
        if -value > outer.value {
            Bend { value: -value, slope: slope.map(|s| -s), curvature: curvature.map(|c| -c) }
        } else {
            outer
        }
    }

    /// Whether a place is beside the plate or in its window, and not behind its chest-wall edge.
    pub fn is_open(&self, place: Place) -> bool {
        place[1] > 0.0 && self.distance(place).value > 0.0
    }

    /// Border of the plate and of its window as polygons, for pictures; none of an endless plate.
    pub fn polygons(&self) -> Vec<Vec<Place>> {
        [self.plate, self.window].iter().flatten().map(RoundedRectangle::polygon).collect()
    }
}

/// Sides of the polygon that stands for a round corner.
const CORNER_SIDES: usize = 8;

impl RoundedRectangle {
    fn polygon(&self) -> Vec<Place> {
        let signs = [[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]];
        let corner = |(quarter, sign): (usize, [f64; 2])| {
            (0..=CORNER_SIDES).map(move |n| {
                let turn = quarter as f64 + n as f64 / CORNER_SIDES as f64;
                let (sin, cos) = (turn * std::f64::consts::FRAC_PI_2).sin_cos();
                let place = |axis: usize, round: f64| {
                    let straight = self.half[axis] - self.corner_mm;
                    self.middle[axis] + sign[axis] * straight + self.corner_mm * round
                };
                [place(0, cos), place(1, sin)]
            })
        };
        signs.into_iter().enumerate().flat_map(corner).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn biopsy() -> Outline {
        Outline {
            plate: Some(RoundedRectangle::new([240.0, 180.0], 20.0, 0.0, 0.0)),
            window: Some(RoundedRectangle::new([50.0, 40.0], 8.0, 10.0, 45.0)),
        }
    }

    #[test]
    fn distance_has_the_derivatives_it_claims() {
        let disc = Outline {
            plate: Some(RoundedRectangle::new([90.0, 90.0], 45.0, 5.0, 0.0)),
            window: None,
        };
        let places = [[118.0, 3.0], [125.0, 90.0], [-119.0, 178.0], [-13.0, 46.0], [37.0, 86.0]];
        for outline in [biopsy(), disc, Outline::ENDLESS] {
            for place in places {
                let here = outline.distance(place);
                assert!((here.slope[0].hypot(here.slope[1]) - 1.0).abs() < 1e-12);
                for axis in 0..2 {
                    let h = 1e-5;
                    let moved = |step: f64| {
                        let mut place = place;
                        place[axis] += step;
                        outline.distance(place)
                    };
                    let (up, down) = (moved(h), moved(-h));
                    assert!(((up.value - down.value) / (2.0 * h) - here.slope[axis]).abs() < 1e-8);
                    for other in 0..2 {
                        let slope = (up.slope[other] - down.slope[other]) / (2.0 * h);
                        assert!((slope - here.curvature[axis + other]).abs() < 1e-8);
                    }
                }
            }
        }
    }

    #[test]
    fn distances_are_those_to_the_nearest_point_of_the_border() {
        let outline = biopsy();
        let border: Vec<Place> = outline
            .polygons()
            .iter()
            .flat_map(|polygon| {
                let next = polygon.iter().cycle().skip(1);
                polygon.iter().zip(next).flat_map(|(a, b)| {
                    (0..200).map(move |n| {
                        let part = f64::from(n) / 200.0;
                        [0, 1].map(|k| a[k] + part * (b[k] - a[k]))
                    })
                })
            })
            .collect();
        let places =
            [[130.0, -7.0], [0.0, -5.0], [110.0, 170.0], [10.0, 60.0], [-40.0, 60.0], [30.0, 90.0]];
        for place in places {
            let far = |p: &Place| (p[0] - place[0]).hypot(p[1] - place[1]);
            let nearest = border.iter().map(far).fold(f64::INFINITY, f64::min);
            let found = outline.distance(place).value;
            // Chords of the corners lie 0.1 mm inside of them.
            assert!((found.abs() - nearest).abs() < 0.15, "{place:?}: {found} for {nearest}");
        }
        assert!(outline.is_open([10.0, 65.0]) && outline.is_open([150.0, 90.0]));
        assert!(!outline.is_open([-50.0, 90.0]) && !outline.is_open([0.0, -10.0]));
    }
}
