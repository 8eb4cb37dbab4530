//! When a compression ends: the first of several limits that is reached.

use super::Step;
use crate::solve::SolveError;
use mammotwin_data::units::NEWTON;

/// Why a compression ended before any of its limits.
#[derive(Debug, thiserror::Error)]
pub enum StoppedEarly {
    /// There is no equilibrium further on.
    #[error(transparent)]
    Solve(#[from] SolveError),
    /// The body leaps over the limit: no state on its way meets it.
    #[error(
        "the body leaps over the limit between {:.2} mm ({:.2} N, {:.0} % of the limit) and {:.2} mm ({:.2} N, {:.0} %); \
         no state there is within 1 % of it; give another limit or a finer mesh",
        thickness_mm[0], force_mn[0] / 1e3, 100.0 * share[0], thickness_mm[1], force_mn[1] / 1e3, 100.0 * share[1]
    )]
    Leap {
        /// Distance of the plates (mm) before and behind it.
        thickness_mm: [f64; 2],
        /// Force of the paddle (mN).
        force_mn: [f64; 2],
        /// Share of the nearest limit.
        share: [f64; 2],
    },
    /// The first state is beyond a limit already, by weight or since it begins between the plates.
    #[error(
        "the first state, at {thickness_mm:.1} mm, has {:.0} % of the limit before the plates close; \
         give a higher limit, or less weight", 100.0 * share
    )]
    Beyond {
        /// Distance of the plates (mm).
        thickness_mm: f64,
        /// Share of the nearest limit.
        share: f64,
    },
    /// No limit is reached at the thinnest gap that is tried.
    #[error(
        "at {thickness_mm:.1} mm, the thinnest that is tried, only {:.0} % of the limit are reached; \
         give a lower one or a final thickness", 100.0 * share
    )]
    Thinnest {
        /// Distance of the plates (mm).
        thickness_mm: f64,
        /// Share of the nearest limit.
        share: f64,
    },
}

/// Limits; those that are `None` do not count.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Stops {
    /// Distance of the plates (mm), at the frame of a paddle that tilts or bends.
    pub thickness_mm: Option<f64>,
    /// Force of the paddle (mN), to 1 %.
    pub force_mn: Option<f64>,
    /// Force of the paddle over the area that it covers (kPa), to 1 %.
    pub mean_pressure_kpa: Option<f64>,
    /// Contact pressure anywhere on either plate (kPa), to 1 %.
    pub peak_pressure_kpa: Option<f64>,
    /// Thickness (mm) that a newton more gains at least, to 1 %: the inverse of [`Step::slope_mn_per_mm`].
    pub least_gain_mm_per_n: Option<f64>,
}

/// One of the limits.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StopRule {
    /// [`Stops::thickness_mm`].
    Thickness,
    /// [`Stops::force_mn`].
    Force,
    /// [`Stops::mean_pressure_kpa`].
    MeanPressure,
    /// [`Stops::peak_pressure_kpa`].
    PeakPressure,
    /// [`Stops::least_gain_mm_per_n`].
    LeastGain,
}

/// Thinnest gap (mm) that is tried.
pub(super) const THINNEST_MM: f64 = 5.0;

impl Stops {
    /// Only at a thickness (mm).
    pub fn at_thickness(thickness_mm: f64) -> Self {
        Self { thickness_mm: Some(thickness_mm), ..Self::default() }
    }

    /// Thickness (mm) beyond which nothing is tried.
    pub(super) fn thinnest_mm(&self) -> f64 {
        self.thickness_mm.unwrap_or(THINNEST_MM)
    }

    /// All limits with a name for messages.
    pub(super) fn named(&self) -> [(&'static str, Option<f64>); 5] {
        [
            ("final thickness (mm)", self.thickness_mm),
            ("final force (mN)", self.force_mn),
            ("final mean pressure (kPa)", self.mean_pressure_kpa),
            ("final peak pressure (kPa)", self.peak_pressure_kpa),
            ("least gain of thickness (mm/N)", self.least_gain_mm_per_n),
        ]
    }

    /// The limit but the thickness that a state is nearest to, or farthest beyond, and the share of
    /// it that is reached; `None` without limits.
    pub(super) fn nearest(&self, step: &Step) -> Option<(StopRule, f64)> {
        let share = |value: f64, limit: Option<f64>, rule| limit.map(|limit| (rule, value / limit));
        [
            share(step.paddle_force_mn, self.force_mn, StopRule::Force),
            share(step.mean_pressure_kpa, self.mean_pressure_kpa, StopRule::MeanPressure),
            share(step.peak_pressure_kpa, self.peak_pressure_kpa, StopRule::PeakPressure),
            self.least_gain_mm_per_n
                .map(|gain| (StopRule::LeastGain, gain * step.slope_mn_per_mm / NEWTON)),
        ]
        .into_iter()
        .flatten()
        .max_by(|a, b| a.1.total_cmp(&b.1))
    }

    /// Share of the nearest limit that a state reaches.
    pub(super) fn share(&self, step: &Step) -> f64 {
        self.nearest(step).map_or(0.0, |(_, share)| share)
    }
}

/// By how much the force (mN) grows for a millimetre less of thickness at the last of up to three states, thickness
/// (mm) and force (mN) each: the slope there of the parabola through them, of the line through two; zero for one.
pub(super) fn slope_mn_per_mm(states: &[[f64; 2]]) -> f64 {
    let chord = |a: [f64; 2], b: [f64; 2]| {
        let closed = a[0] - b[0];
        if closed > 0.0 { (b[1] - a[1]) / closed } else { 0.0 }
    };
    match *states {
        [.., first, before, last] if first[0] > before[0] => {
            let (early, late) = (chord(first, before), chord(before, last));
            let bend = (late - early) / (first[0] - last[0]);
            late + bend * (before[0] - last[0])
        }
        [.., before, last] => chord(before, last),
        _ => 0.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_slope_of_a_curve_is_known_where_it_ends() {
        let force = |h: f64| 30.0 * (60.0 - h) + 4.0 * (60.0 - h).powi(2);
        let states =
            |all: &[f64]| -> Vec<[f64; 2]> { all.iter().map(|h| [*h, force(*h)]).collect() };
        // Exact on a parabola, whatever the steps.
        let slope = slope_mn_per_mm(&states(&[60.0, 57.0, 50.0, 48.5]));
        assert!((slope - (30.0 + 8.0 * 11.5)).abs() < 1e-9, "{slope}");
        assert!((slope_mn_per_mm(&states(&[60.0, 58.0])) - 38.0).abs() < 1e-9);
        assert_eq!(slope_mn_per_mm(&states(&[60.0])), 0.0);
        assert_eq!(slope_mn_per_mm(&[]), 0.0);
        // A force that grows as an exponential of 10 mm, in steps of 2.5 mm: to 3 %.
        let force = |h: f64| 1000.0 * ((60.0 - h) / 10.0).exp();
        let slope = slope_mn_per_mm(&[45.0, 42.5, 40.0].map(|h| [h, force(h)]));
        assert!((slope / (0.1 * force(40.0)) - 1.0).abs() < 0.03, "{slope}");
    }
}
