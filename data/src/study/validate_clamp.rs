//! Refuses clamping that cannot be meant.

use super::ClampPlan;
use super::validate::{Checked, refuse, within};

/// Most exponentials of a relaxation function.
const MOST_TERMS: usize = 8;

/// Durations, times and shares of `compress.clamp`.
pub(super) fn clamp(plan: &ClampPlan) -> Checked {
    within("compress.clamp.ramp_s", plan.ramp_s, 0.1, 600.0)?;
    within("compress.clamp.clamp_s", plan.clamp_s, 0.0, 3600.0)?;
    within("compress.clamp.release_s", plan.release_s, 0.1, 600.0)?;
    let (times, shares) = (&plan.times_s, &plan.shares);
    if times.is_empty() || times.len() > MOST_TERMS {
        let why = format!("has {} times; give one to {MOST_TERMS}", times.len());
        return refuse("compress.clamp.times_s", why);
    }
    for (n, time) in times.iter().enumerate() {
        let path = format!("compress.clamp.times_s[{n}]");
        within(&path, *time, 0.001, 100_000.0)?;
        if n > 0 && *time <= times[n - 1] {
            let why = format!("{time} follows {}; write the times rising", times[n - 1]);
            return refuse(path, why);
        }
    }
    if shares.len() != times.len() {
        let why = format!(
            "has {} shares for {} of times_s; give one for each",
            shares.len(),
            times.len()
        );
        return refuse("compress.clamp.shares", why);
    }
    for (n, share) in shares.iter().enumerate() {
        within(&format!("compress.clamp.shares[{n}]"), *share, 0.0, 100.0)?;
    }
    Ok(())
}
