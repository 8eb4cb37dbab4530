//! The elastic force against the thickness, between the states that a compression recorded.

/// A curve through points that rises and falls only where they do: cubic pieces with limited slopes
/// (Fritsch and Butland 1984).
#[derive(Debug, Clone, PartialEq)]
pub struct MonotoneCubic {
    x: Vec<f64>,
    y: Vec<f64>,
    slope: Vec<f64>,
}

impl MonotoneCubic {
    /// Through points of rising `x`; a point that does not lie beyond the one before is left out.
    /// `None` for fewer than two points.
    pub fn through(points: impl IntoIterator<Item = (f64, f64)>) -> Option<Self> {
        let (mut x, mut y): (Vec<f64>, Vec<f64>) = (Vec::new(), Vec::new());
        for (at, value) in points {
            if x.last().is_none_or(|last| at > *last) {
                x.push(at);
                y.push(value);
            }
        }
        let last = x.len().checked_sub(1).filter(|last| *last > 0)?;
        let width = |n: usize| x[n + 1] - x[n];
        let rise = |n: usize| (y[n + 1] - y[n]) / width(n);
        let inner = |n: usize| {
            let [before, after] = [rise(n - 1), rise(n)];
            if before * after <= 0.0 {
                return 0.0;
            }
            let weights = [2.0 * width(n) + width(n - 1), width(n) + 2.0 * width(n - 1)];
            (weights[0] + weights[1]) / (weights[0] / before + weights[1] / after)
        };
        // A parabola through three points, as far as it does not turn.
        let end = |n: usize, next: usize| {
            if last == 1 {
                return rise(n);
            }
            let slope = ((2.0 * width(n) + width(next)) * rise(n) - width(n) * rise(next))
                / (width(n) + width(next));
            match slope * rise(n) {
                turned if turned <= 0.0 => 0.0,
                _ if slope.abs() > 3.0 * rise(n).abs() => 3.0 * rise(n),
                _ => slope,
            }
        };
        let mut slope = vec![end(0, 1.min(last - 1))];
        slope.extend((1..last).map(inner));
        slope.push(end(last - 1, last.saturating_sub(2)));
        Some(Self { x, y, slope })
    }

    /// The value at `x`; beyond the ends that of the end.
    pub fn at(&self, x: f64) -> f64 {
        let n = self.x.partition_point(|start| *start <= x).clamp(1, self.x.len() - 1) - 1;
        let width = self.x[n + 1] - self.x[n];
        let s = ((x - self.x[n]) / width).clamp(0.0, 1.0);
        let (s2, s3) = (s * s, s * s * s);
        let blend = 3.0 * s2 - 2.0 * s3;
        self.y[n] * (1.0 - blend)
            + self.y[n + 1] * blend
            + width * self.slope[n] * (s3 - 2.0 * s2 + s)
            + width * self.slope[n + 1] * (s3 - s2)
    }

    /// The first `x` at which the curve has come up to `y`; the last one when it never does.
    pub fn first_at(&self, y: f64) -> f64 {
        let Some(n) = self.y.iter().position(|value| *value >= y) else {
            return self.x[self.x.len() - 1];
        };
        let Some(before) = n.checked_sub(1) else { return self.x[0] };
        let [mut low, mut high] = [self.x[before], self.x[n]];
        for _ in 0..80 {
            let middle = 0.5 * (low + high);
            if self.at(middle) >= y {
                high = middle;
            } else {
                low = middle;
            }
        }
        high
    }

    /// First and last `x`.
    pub fn ends(&self) -> [f64; 2] {
        [self.x[0], self.x[self.x.len() - 1]]
    }
}

/// Elastic force of the paddle by the distance of the plates.
#[derive(Debug, Clone, PartialEq)]
pub struct ElasticCurve {
    /// Force (mN) over the way that the plates have come together (mm).
    by_way: MonotoneCubic,
    /// Distance of the plates at the start (mm).
    start_mm: f64,
}

impl ElasticCurve {
    /// Through states of a compression: falling thickness (mm) and force (mN), the first one without
    /// pressure. `None` for fewer than two.
    pub fn through(thickness_mm: &[f64], force_mn: &[f64]) -> Option<Self> {
        let start_mm = *thickness_mm.first()?;
        let states = thickness_mm.iter().zip(force_mn).map(|(h, f)| (start_mm - h, f.max(0.0)));
        Some(Self { by_way: MonotoneCubic::through(states)?, start_mm })
    }

    /// Distance of the plates (mm) at the first and at the last state.
    pub fn ends_mm(&self) -> [f64; 2] {
        self.by_way.ends().map(|way| self.start_mm - way)
    }

    /// Force (mN) at a distance of the plates (mm).
    pub fn force_mn(&self, thickness_mm: f64) -> f64 {
        self.by_way.at(self.start_mm - thickness_mm)
    }

    /// The largest distance of the plates (mm) at which the force is this one (mN); the last one of the
    /// compression for a force that it does not reach.
    pub fn thickness_mm(&self, force_mn: f64) -> f64 {
        self.start_mm - self.by_way.first_at(force_mn)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_goes_through_its_points_and_turns_only_with_them() {
        let points = [(0.0, 0.0), (5.0, 0.1), (10.0, 0.1), (12.0, 3.0), (13.0, 2.0), (20.0, 9.0)];
        let curve = MonotoneCubic::through(points).unwrap();
        for (x, y) in points {
            assert!((curve.at(x) - y).abs() < 1e-14);
        }
        for pair in points.windows(2) {
            let [(from, a), (to, b)] = [pair[0], pair[1]];
            let mut before = a;
            for n in 1..=50 {
                let value = curve.at(from + (to - from) * f64::from(n) / 50.0);
                assert!((value - before) * (b - a) >= -1e-14, "{from} {value} {before}");
                before = value;
            }
        }
        assert_eq!((curve.at(-1.0), curve.at(25.0)), (0.0, 9.0));
        assert!(MonotoneCubic::through([(1.0, 2.0), (1.0, 3.0)]).is_none());
    }

    #[test]
    fn lines_are_exact_and_stiffening_curves_nearly() {
        let line = MonotoneCubic::through([(0.0, 1.0), (1.0, 3.0), (5.0, 11.0)]).unwrap();
        assert!((line.at(3.3) - 7.6).abs() < 1e-13);
        // Steps of 5 mm on a force that doubles every 8 mm.
        let force = |x: f64| (x / 8.0).exp2() - 1.0;
        let states = (0..=10).map(|n| (5.0 * f64::from(n), force(5.0 * f64::from(n))));
        let curve = MonotoneCubic::through(states).unwrap();
        let error = (0..=500).map(|n| f64::from(n) / 10.0).map(|x| (curve.at(x) - force(x)).abs());
        let worst = error.fold(0.0, f64::max) / force(50.0);
        assert!(worst < 0.003, "{worst}");
    }

    #[test]
    fn a_force_is_found_where_it_is_first_reached() {
        let curve =
            ElasticCurve::through(&[80.0, 75.0, 70.0, 65.0], &[-0.0, 4.0, 2.0, 9.0]).unwrap();
        for force in [1.0, 3.0, 7.0] {
            let thickness = curve.thickness_mm(force);
            assert!((curve.force_mn(thickness) - force).abs() < 1e-12);
        }
        assert!(curve.thickness_mm(3.0) > 75.0);
        assert_eq!((curve.thickness_mm(0.0), curve.thickness_mm(10.0)), (80.0, 65.0));
    }
}
