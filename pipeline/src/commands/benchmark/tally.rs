//! Verdicts, counted.

use mammotwin_stages::discover::{Budget, Evidence, Verdict, VerdictName};

/// Half of a 90 % interval of a normal number, in standard deviations.
const NINETY: f64 = 1.645;

/// Kinds of trials.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Tier {
    /// Nothing hidden.
    Null,
    /// Nothing hidden, larger errors than the budget's.
    Decoy,
    /// One effect hidden.
    Single,
    /// One effect hidden, no errors drawn, nonlinear fits.
    Refit,
    /// One effect hidden, a library that lacks it.
    Outside,
    /// Through images, segmentation and registration.
    Images,
}

/// One verdict beside the truth.
#[derive(Debug, Clone)]
pub struct Trial {
    /// Its kind.
    pub tier: Tier,
    /// Of the volunteer.
    pub seed: u64,
    /// What is hidden.
    pub truth: Option<&'static str>,
    /// Its severity (standard deviations).
    pub sigma: f64,
    /// The answer.
    pub verdict: VerdictName,
    /// Fitted effects, the best first.
    pub ranked: Vec<String>,
    /// Effects that are not told apart.
    pub set: Vec<String>,
    /// Weight of the best.
    pub weight: f64,
    /// Fitted over hidden amplitude, when the right effect was fitted.
    pub amplitude: Option<f64>,
    /// Whether the 90 % interval of its amplitude holds the hidden one.
    pub covered: Option<bool>,
    /// Root mean square (mm) of the held-out pose with less that without the best effect.
    pub held_out_mm: Option<f64>,
    /// Part of the held-out gap above the floor that the best effect closes; `None` where no gap is above it.
    pub shrink: Option<f64>,
}

impl Trial {
    /// A verdict on a volunteer with a hidden effect of an amplitude.
    pub fn new(
        tier: Tier,
        seed: u64,
        truth: Option<(&'static str, f64)>,
        sigma: f64,
        verdict: &Verdict,
    ) -> Self {
        let of_truth = truth.and_then(|(name, amplitude)| {
            let fitted =
                verdict.candidates.iter().find(|c| c.effect == name && c.unsettled.is_none())?;
            Some((fitted.amplitude, amplitude))
        });
        let covered = of_truth
            .map(|([found, deviation], hidden)| (found - hidden).abs() < NINETY * deviation);
        let shrink = verdict.chosen().and_then(|best| {
            let gap = best.held_out.before_mm - best.held_out.floor_mm;
            (gap > 0.0).then(|| (best.held_out.before_mm - best.held_out.after_mm) / gap)
        });
        Self {
            tier,
            seed,
            truth: truth.map(|(name, _)| name),
            sigma,
            verdict: verdict.verdict,
            ranked: verdict.candidates.iter().map(|c| c.effect.clone()).collect(),
            set: verdict.set.clone(),
            weight: verdict.weight,
            amplitude: of_truth.map(|([found, _], hidden)| found / hidden),
            covered,
            held_out_mm: verdict
                .chosen()
                .map(|best| best.held_out.after_mm - best.held_out.before_mm),
            shrink,
        }
    }

    /// Whether anything was found.
    pub fn detected(&self) -> bool {
        self.verdict != VerdictName::NoDiscrepancy
    }

    /// Whether an effect was called physics, alone or in a set.
    pub fn names_physics(&self) -> bool {
        matches!(self.verdict, VerdictName::Named | VerdictName::Ambiguous)
    }

    /// Whether the truth is among the `n` best.
    pub fn within(&self, n: usize) -> bool {
        self.ranked.iter().take(n).any(|name| Some(name.as_str()) == self.truth)
    }

    /// Whether the set holds the truth.
    pub fn set_holds(&self) -> bool {
        self.set.iter().any(|name| Some(name.as_str()) == self.truth)
    }

    /// One effect was named, and it is not the truth.
    pub fn wrong(&self) -> bool {
        self.verdict == VerdictName::Named && !self.within(1)
    }
}

/// All trials.
#[derive(Debug, Default)]
pub struct Results {
    /// Verdicts.
    pub trials: Vec<Trial>,
    /// Effects and severities that no plausible amplitude has.
    pub untestable: Vec<(String, f64)>,
    /// Sizes (standard deviations of a trial) of effects hidden at a severity, by the models of the cases.
    pub sizes: Vec<(String, f64, f64)>,
    /// Cases without an equilibrium: effect, severity, why.
    pub failed: Vec<(String, f64, String)>,
    /// Cases for which the time did not last: effect, severity, what of it.
    pub skipped: Vec<(String, f64, &'static str)>,
    /// Error budgets of the cases that went through images.
    pub budgets: Vec<(u64, Budget)>,
}

impl Results {
    /// Adds trials.
    pub fn extend(&mut self, trials: impl IntoIterator<Item = Trial>) {
        self.trials.extend(trials);
    }

    /// Notes a severity that no plausible amplitude has.
    pub fn untestable(&mut self, effect: &str, sigma: f64) {
        self.untestable.push((effect.into(), sigma));
    }

    /// Notes the size that a hidden effect has for the model of its case.
    pub fn sized(&mut self, effect: &str, sigma: f64, size: f64) {
        self.sizes.push((effect.into(), sigma, size));
    }

    /// Median size of an effect hidden at a severity, by the models of the cases.
    pub fn size(&self, effect: &str, sigma: f64) -> Option<f64> {
        let of = self.sizes.iter().filter(|(e, s, _)| e == effect && *s == sigma);
        crate::page::median(of.map(|(.., size)| *size).collect())
    }

    /// Notes a case that could not be computed.
    pub fn failed(&mut self, effect: &str, sigma: f64, why: &str) {
        self.failed.push((effect.into(), sigma, why.into()));
    }

    /// Notes a case for which the time did not last.
    pub fn skipped(&mut self, effect: &str, sigma: f64, what: &'static str) {
        self.skipped.push((effect.into(), sigma, what));
    }

    /// Notes the errors of a case that went through images.
    pub fn measured(&mut self, seed: u64, evidence: &Evidence) {
        self.budgets.push((seed, evidence.budget));
    }

    /// The trials of a kind.
    pub fn of(&self, tier: Tier) -> impl Iterator<Item = &Trial> {
        self.trials.iter().filter(move |trial| trial.tier == tier)
    }

    /// Severities of the single effects, rising.
    pub fn sigmas(&self) -> Vec<f64> {
        let mut all: Vec<f64> = self.of(Tier::Single).map(|trial| trial.sigma).collect();
        all.sort_by(f64::total_cmp);
        all.dedup();
        all
    }

    /// The trials of one effect and severity.
    pub fn cell(&self, tier: Tier, effect: &str, sigma: f64) -> Vec<&Trial> {
        self.of(tier).filter(|t| t.truth == Some(effect) && t.sigma == sigma).collect()
    }

    /// Expected calibration error of the weights of named effects, in bins of 0.1, and how many there are of all kinds.
    pub fn calibration_error(&self) -> (Option<f64>, usize) {
        let named: Vec<&Trial> =
            self.trials.iter().filter(|t| t.verdict == VerdictName::Named).collect();
        let mut error = 0.0;
        for bin in 0..10 {
            let inside = |t: &&&Trial| (10.0 * t.weight).min(9.0) as usize == bin;
            let bin: Vec<&&Trial> = named.iter().filter(inside).collect();
            let right = bin.iter().filter(|t| t.within(1)).count() as f64;
            let said: f64 = bin.iter().map(|t| t.weight).sum();
            error += (said - right).abs();
        }
        ((!named.is_empty()).then(|| error / named.len() as f64), named.len())
    }
}

/// Part of trials for which something holds; `None` of none.
pub fn share(trials: &[&Trial], holds: impl Fn(&Trial) -> bool) -> Option<f64> {
    let count = trials.iter().filter(|t| holds(t)).count();
    (!trials.is_empty()).then(|| count as f64 / trials.len() as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_are_judged_on_all_that_are_named_and_on_no_other() {
        let trial = |tier: Tier, verdict: VerdictName, best: &str, weight: f64| Trial {
            tier,
            seed: 1,
            truth: Some("friction"),
            sigma: 5.0,
            verdict,
            ranked: vec![best.into()],
            set: Vec::new(),
            weight,
            amplitude: None,
            covered: None,
            held_out_mm: None,
            shrink: None,
        };
        let mut results = Results::default();
        assert_eq!(results.calibration_error(), (None, 0));
        results.extend([
            trial(Tier::Single, VerdictName::Named, "friction", 0.9),
            trial(Tier::Refit, VerdictName::Named, "density", 0.5),
            trial(Tier::Single, VerdictName::Ambiguous, "friction", 0.1),
        ]);
        let (error, count) = results.calibration_error();
        assert_eq!(count, 2);
        assert!((error.unwrap() - 0.5 * (0.1 + 0.5)).abs() < 1e-12, "{error:?}");
    }
}
