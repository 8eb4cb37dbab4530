//! The search for the state that meets a limit, between one before it and one beyond it.

/// A limit is met within this part of it.
pub(super) const STOP_TOLERANCE: f64 = 0.01;
/// Most trials to meet a limit.
const STOP_TRIALS: usize = 12;

/// Whether a share of a limit is that limit, within the tolerance.
pub(super) fn is_met(share: f64) -> bool {
    (share - 1.0).abs() <= STOP_TOLERANCE
}

/// A state with what it reaches.
#[derive(Debug, Clone)]
pub(super) struct Reached<S> {
    /// Distance of the plates (mm).
    pub thickness_mm: f64,
    /// Share of the nearest limit.
    pub share: f64,
    /// Force of the paddle (mN).
    pub force_mn: f64,
    /// The state itself.
    pub state: S,
}

/// How a search ends.
#[derive(Debug)]
pub(super) enum Met<S> {
    /// Within the tolerance.
    Limit(S),
    /// No state was found that meets the limit: the nearest before and beyond it.
    Leap([Reached<S>; 2]),
}

/// Looks between `before`, which is below the limit, and `beyond`; `go` gives the state at a
/// thickness (mm), `None` when there is no equilibrium. What lies behind such a thickness is not
/// looked at again: the body would have to come by it.
pub(super) fn meet<S>(
    mut before: Reached<S>,
    mut beyond: Reached<S>,
    mut go: impl FnMut(f64) -> Option<Reached<S>>,
) -> Met<S> {
    if is_met(beyond.share) {
        return Met::Limit(beyond.state);
    }
    let mut narrow_mm = beyond.thickness_mm;
    // The last trial's side of the limit, and whether the one before it was on that side, too.
    let (mut side, mut again) = (None, false);
    for _ in 0..STOP_TRIALS {
        // The force curves upwards: stay away from the ends of the bracket. Where one end stays,
        // halves find a leap sooner.
        let secant = (1.0 - before.share) / (beyond.share - before.share);
        let part = if again { 0.5 } else { secant.clamp(0.1, 0.9) };
        let thickness_mm = before.thickness_mm + part * (narrow_mm - before.thickness_mm);
        let found = go(thickness_mm);
        let is_before = found.as_ref().is_some_and(|found| found.share < 1.0);
        again = side == Some(is_before);
        side = Some(is_before);
        match found {
            Some(found) if is_met(found.share) => return Met::Limit(found.state),
            Some(found) if is_before => before = found,
            Some(found) => {
                narrow_mm = thickness_mm;
                beyond = found;
            }
            None => narrow_mm = thickness_mm,
        }
    }
    // Only the state that the search began with may be so near.
    if is_met(before.share) { Met::Limit(before.state) } else { Met::Leap([before, beyond]) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn reached(share: impl Fn(f64) -> f64, thickness_mm: f64) -> Reached<f64> {
        let share = share(thickness_mm);
        Reached { thickness_mm, share, force_mn: 1e4 * share, state: thickness_mm }
    }

    /// From 50 to 45 mm along a curve that has an equilibrium where `there` says so; with the number of trials.
    fn search(share: impl Fn(f64) -> f64, there: impl Fn(f64) -> bool) -> (Met<f64>, usize) {
        let mut trials = 0;
        let go = |thickness_mm: f64| {
            trials += 1;
            there(thickness_mm).then(|| reached(&share, thickness_mm))
        };
        let found = meet(reached(&share, 50.0), reached(&share, 45.0), go);
        (found, trials)
    }

    #[test]
    fn a_smooth_course_is_met() {
        // From 0.2 to 7.4 of the limit, curved upwards.
        let share = |h: f64| 0.2 * (0.72 * (50.0 - h)).exp();
        let (found, trials) = search(share, |_| true);
        let Met::Limit(state) = found else { panic!("{found:?}") };
        assert!((share(state) - 1.0).abs() <= STOP_TOLERANCE, "{state}");
        assert!(trials <= 8, "{trials}");
    }

    #[test]
    fn a_leap_over_the_limit_is_none_that_meets_it() {
        let share = |h: f64| if h > 47.3 { 0.6 } else { 1.4 } + 0.01 * (50.0 - h);
        let (found, trials) = search(share, |_| true);
        let Met::Leap([before, beyond]) = found else { panic!("{found:?}") };
        assert!(before.share < 1.0 && beyond.share > 1.0, "{before:?} {beyond:?}");
        let [wide, narrow] = [before.thickness_mm, beyond.thickness_mm];
        assert!(wide > 47.3 && narrow <= 47.3 && wide - narrow < 0.1, "{wide} to {narrow} mm");
        assert!(trials <= STOP_TRIALS);
    }

    #[test]
    fn a_trial_without_equilibrium_narrows_the_bracket() {
        // The straight line between 0.5 and 2 of the limit leads into the gap at first.
        let share = |h: f64| 0.5 + 1.5 * ((50.0 - h) / 5.0).powf(0.3);
        let (found, _) = search(share, |h| h > 49.0);
        let Met::Limit(state) = found else { panic!("{found:?}") };
        assert!((share(state) - 1.0).abs() <= STOP_TOLERANCE);
        // Where the limit lies behind the gap, the state before it is the last.
        let share = |h: f64| 0.5 + 1.5 * (50.0 - h) / 5.0;
        let (found, _) = search(share, |h| h > 49.0);
        let Met::Leap([before, beyond]) = found else { panic!("{found:?}") };
        assert!(before.share < 1.0 && before.thickness_mm - 49.0 < 0.1, "{before:?}");
        assert_eq!(beyond.thickness_mm, 45.0);
    }
}
