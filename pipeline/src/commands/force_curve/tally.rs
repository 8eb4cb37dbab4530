//! Trials of the benchmark and what they add up to.

use mammotwin_stages::{discover::VerdictName, force_curve::verdict::CurveVerdict};

/// Kinds of trials.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Tier {
    /// Nothing hidden.
    Null,
    /// One effect of the library.
    Single,
    /// A measurement that is off, and no effect.
    Decoy,
    /// One effect that the library was made to lack.
    Outside,
}

impl Tier {
    /// Its word in tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Null => "null",
            Self::Single => "single",
            Self::Decoy => "decoy",
            Self::Outside => "outside",
        }
    }
}

/// One record, judged.
#[derive(Debug, Clone)]
pub struct Trial {
    /// Kind.
    pub tier: Tier,
    /// Which person.
    pub seed: u64,
    /// What is hidden, or the word of a decoy.
    pub hidden: String,
    /// Its amplitude.
    pub amplitude: f64,
    /// Severity that was asked for (standard deviations).
    pub sigma: f64,
    /// Which quantities were measured.
    pub data: &'static str,
    /// Whether a score passed the limit.
    pub detected: bool,
    /// The two best effects.
    pub best: [Option<&'static str>; 2],
    /// The set, or the named effect.
    pub set: Vec<&'static str>,
    /// Kind of answer.
    pub verdict: VerdictName,
    /// The named effect.
    pub named: Option<&'static str>,
    /// Fitted over true amplitude of the hidden effect, where it was fitted.
    pub ratio: Option<f64>,
    /// Misfit of the held-out forces without and with the best effect.
    pub held_out: Option<[f64; 2]>,
}

impl Trial {
    /// Of a verdict; `true_amplitude` is that of this record.
    pub fn new(
        (tier, seed, data): (Tier, u64, &'static str),
        (hidden, amplitude, sigma): (&str, f64, f64),
        true_amplitude: f64,
        found: &CurveVerdict,
    ) -> Self {
        let fitted: Vec<&'static str> = found.candidates.iter().map(|c| c.effect).collect();
        let screened = found.scores.iter().filter(|s| s.testable).map(|s| s.effect);
        let ranked: Vec<&'static str> =
            if fitted.is_empty() { screened.collect() } else { fitted.clone() };
        let own = found.candidates.iter().find(|c| c.effect == hidden);
        Self {
            tier,
            seed,
            hidden: hidden.into(),
            amplitude,
            sigma,
            data,
            detected: found.scores.iter().any(|s| s.testable && s.z > found.limit),
            best: [ranked.first().copied(), ranked.get(1).copied()],
            set: found.set.clone(),
            verdict: found.verdict,
            named: if found.verdict == VerdictName::Named { found.effect } else { None },
            ratio: own.map(|c| c.amplitude[0] / true_amplitude),
            held_out: found.candidates.first().map(|c| c.held_out),
        }
    }

    /// Whether another effect than the hidden one is named.
    pub fn wrong(&self) -> bool {
        self.named.is_some_and(|name| self.tier != Tier::Single || name != self.hidden)
    }
}

/// Counts over trials.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Counts {
    /// Trials.
    pub all: usize,
    /// Detected.
    pub detected: usize,
    /// Of those: the hidden effect is the best.
    pub first: usize,
    /// Of those: it is one of the best two.
    pub second: usize,
    /// Answers with a set or a name.
    pub sets: usize,
    /// Of those: the set holds the hidden effect.
    pub held: usize,
    /// Members of the sets, all together.
    pub members: usize,
    /// The hidden effect is named.
    pub named: usize,
    /// Another one is.
    pub wrong: usize,
    /// Answers `unknown`.
    pub unknown: usize,
    /// Answers `ambiguous`.
    pub ambiguous: usize,
    /// Answers `measurement_artifact`.
    pub artifact: usize,
}

/// Counts trials.
pub fn count<'a>(trials: impl IntoIterator<Item = &'a Trial>) -> Counts {
    let mut sum = Counts::default();
    for trial in trials {
        let is = |name: Option<&str>| usize::from(name == Some(trial.hidden.as_str()));
        sum.all += 1;
        sum.wrong += usize::from(trial.wrong());
        sum.named += is(trial.named);
        sum.unknown += usize::from(trial.verdict == VerdictName::Unknown);
        sum.ambiguous += usize::from(trial.verdict == VerdictName::Ambiguous);
        sum.artifact += usize::from(trial.verdict == VerdictName::MeasurementArtifact);
        if !trial.detected {
            continue;
        }
        sum.detected += 1;
        sum.first += is(trial.best[0]);
        sum.second += is(trial.best[0]).max(is(trial.best[1]));
        if !trial.set.is_empty() {
            sum.sets += 1;
            sum.members += trial.set.len();
            sum.held += usize::from(trial.set.iter().any(|name| *name == trial.hidden));
        }
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    fn trial(named: Option<&'static str>, set: &[&'static str], tier: Tier) -> Trial {
        Trial {
            tier,
            seed: 1,
            hidden: "limit_chain".into(),
            amplitude: 0.2,
            sigma: 10.0,
            data: "force",
            detected: true,
            best: [set.first().copied(), set.get(1).copied()],
            set: set.to_vec(),
            verdict: VerdictName::Named,
            named,
            ratio: None,
            held_out: None,
        }
    }

    #[test]
    fn right_and_wrong_names_are_told_apart() {
        let trials = [
            trial(Some("limit_chain"), &["limit_chain"], Tier::Single),
            trial(Some("paddle_hinge"), &["paddle_hinge"], Tier::Single),
            trial(None, &["paddle_hinge", "limit_chain"], Tier::Single),
            // Named although the library was to lack it: by another's name.
            trial(Some("paddle_hinge"), &["paddle_hinge"], Tier::Outside),
        ];
        let sum = count(&trials[..3]);
        assert_eq!((sum.first, sum.second, sum.held, sum.members), (1, 2, 2, 4));
        assert_eq!((sum.named, sum.wrong), (1, 1));
        assert_eq!(count(&trials[3..]).wrong, 1);
    }
}
