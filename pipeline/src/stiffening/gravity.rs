//! Which Jₘ the poses ask for, and whether one material explains poses and record.
//!
//! For each Jₘ the moduli are fitted to all poses. What is left of the distances is an error; with N independent ones and a
//! variance that is not known, a Jₘ that leaves the mean square m is as likely as m^(-N/2) (the variance integrated out with
//! Jeffreys' prior).

use super::{Marginal, Posterior, posterior::marginal};

/// What is left of the poses with one Jₘ.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hanging {
    /// Jₘ of breast, skin and fascia.
    pub jm: f64,
    /// Fitted moduli (kPa), right and left.
    pub moduli_kpa: [f64; 2],
    /// Root mean square (mm) of the distances of all poses without rigid motions.
    pub misfit_mm: f64,
    /// Number of independent errors among these distances.
    pub independent: f64,
}

/// What poses say of Jₘ beside a record.
#[derive(Debug, Clone)]
pub struct Both {
    /// Weights of the Jₘ of the record's posterior, by the poses alone.
    pub poses: Vec<f64>,
    /// By the record alone.
    pub record: Vec<f64>,
    /// By both.
    pub joint: Vec<f64>,
    /// Jₘ.
    pub jm: Vec<f64>,
    /// Part of the weights that poses and record have in common: 1 where they say the same, 0 where no Jₘ serves both.
    pub overlap: f64,
}

/// Poses and record that have less in common contradict each other.
const CONTRADICTION: f64 = 0.05;

impl Both {
    /// Of what was left with each Jₘ (rising), the poses having no solution with those that `fell`; `None` when they
    /// have none with any.
    pub fn new(hanging: &[Hanging], fell: &[f64], posterior: &Posterior) -> Option<Self> {
        let log = |jm: &f64| {
            let apart = |other: f64| (jm / other).ln().abs();
            let nearest = hanging.iter().map(|h| apart(h.jm)).fold(f64::INFINITY, f64::min);
            // Nearer to one with which nothing stood than to any that did.
            if fell.iter().any(|fell| apart(*fell) < nearest) {
                return Some(f64::NEG_INFINITY);
            }
            logarithm(hanging, *jm)
        };
        let logs: Vec<f64> = posterior.jm.iter().map(log).collect::<Option<_>>()?;
        let most = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        if most == f64::NEG_INFINITY {
            return None;
        }
        let poses = normal(logs.into_iter().map(|log| (log - most).exp()).collect());
        let record = posterior.sums()[0].clone();
        let joint = normal(poses.iter().zip(&record).map(|(a, b)| a * b).collect());
        let overlap = poses.iter().zip(&record).map(|(a, b)| a.min(*b)).sum();
        Some(Self { poses, record, joint, jm: posterior.jm.clone(), overlap })
    }

    fn marginal(&self, weights: &[f64]) -> Marginal {
        let best = (0..weights.len()).max_by(|a, b| weights[*a].total_cmp(&weights[*b]));
        marginal(&self.jm, weights, best.unwrap_or(0))
    }

    /// The answer in sentences.
    pub fn said(&self) -> Vec<String> {
        let range = |weights: &[f64]| {
            let Marginal { median, interval: [low, high], .. } = self.marginal(weights);
            format!("{median:.2} (90 % between {low:.2} and {high:.2})")
        };
        let poses = format!("Jₘ by the poses alone: {}.", range(&self.poses));
        let answer = if self.overlap < CONTRADICTION {
            format!(
                "No one Jₘ explains poses and record: they have {:.0} % of their weight in common. Gravity and compression ask for \
                 different materials, or the model lacks something (`mammotwin discover`).",
                100.0 * self.overlap
            )
        } else {
            format!(
                "One material may explain both: {:.0} % of their weight is common, Jₘ {}.",
                100.0 * self.overlap,
                range(&self.joint)
            )
        };
        vec![poses, answer]
    }
}

/// Logarithm of the likelihood of a Jₘ; the mean square is linear in 1/Jₘ between those that were tried, and beyond them as at the
/// last.
fn logarithm(hanging: &[Hanging], jm: f64) -> Option<f64> {
    let (first, last) = (hanging.first()?, hanging.last()?);
    let of = |h: &Hanging| h.misfit_mm.powi(2);
    let at = hanging.windows(2).find(|pair| pair[0].jm <= jm && jm <= pair[1].jm);
    let square = match at {
        Some([a, b]) => {
            let part = (jm.recip() - a.jm.recip()) / (b.jm.recip() - a.jm.recip());
            of(a) + part * (of(b) - of(a))
        }
        _ if jm < first.jm => of(first),
        _ => of(last),
    };
    let independent = hanging.iter().map(|h| h.independent).sum::<f64>() / hanging.len() as f64;
    Some(-0.5 * independent * square.max(f64::MIN_POSITIVE).ln())
}

fn normal(mut weights: Vec<f64>) -> Vec<f64> {
    let sum: f64 = weights.iter().sum();
    if sum > 0.0 {
        weights.iter_mut().for_each(|weight| *weight /= sum);
    }
    weights
}

/// All Jₘ that the poses stand, as CSV.
pub fn gravity_table(hanging: &[Hanging]) -> String {
    let head = "jm,right_kpa,left_kpa,misfit_mm,independent_errors\n".to_owned();
    hanging.iter().fold(head, |text, h| {
        let [right, left] = h.moduli_kpa;
        let Hanging { jm, misfit_mm, independent, .. } = h;
        text + &format!("{jm},{right:.4},{left:.4},{misfit_mm:.4},{independent:.1}\n")
    })
}

#[cfg(test)]
#[allow(clippy::unwrap_used)] // a test may fail at once
mod tests {
    use super::*;

    fn hanging(best: f64) -> Vec<Hanging> {
        let one = |jm: f64| Hanging {
            jm,
            moduli_kpa: [0.4; 2],
            misfit_mm: (1.0 + 0.6 * (jm / best).ln().powi(2)).sqrt(),
            independent: 40.0,
        };
        [0.5, 0.7, 1.0, 1.4, 2.0, 3.0, 5.0].map(one).into()
    }

    fn record(best: f64) -> Posterior {
        let jm: Vec<f64> = (0..60).map(|n| 0.5 * 10_f64.powf(n as f64 / 59.0)).collect();
        let weights = jm.iter().map(|jm| (-20.0 * (jm / best).ln().powi(2)).exp()).collect();
        Posterior { jm, distance_mm: vec![15.0], weights: normal(weights), misfit: 1.0 }
    }

    #[test]
    fn one_material_is_found_where_both_ask_for_it() {
        let both = Both::new(&hanging(1.4), &[], &record(1.5)).unwrap();
        let Marginal { median, interval, .. } = both.marginal(&both.joint);
        assert!((median - 1.45).abs() < 0.1, "{median}");
        // Both together are surer than each.
        for alone in [&both.poses, &both.record] {
            let [low, high] = both.marginal(alone).interval;
            assert!(high - low > interval[1] - interval[0]);
        }
        assert!(both.overlap > 0.5 && both.said()[1].starts_with("One material"));
    }

    #[test]
    fn poses_and_record_that_ask_for_two_materials_contradict_each_other() {
        let both = Both::new(&hanging(3.0), &[], &record(0.7)).unwrap();
        assert!(both.overlap < CONTRADICTION, "{}", both.overlap);
        assert!(both.said()[1].starts_with("No one"));
        assert!(Both::new(&[], &[0.5], &record(1.0)).is_none());
    }

    #[test]
    fn what_no_pose_stands_has_no_weight() {
        let stood = &hanging(0.7)[2..];
        let both = Both::new(stood, &[0.5, 0.7], &record(1.0)).unwrap();
        let below: f64 =
            both.jm.iter().zip(&both.poses).filter(|(jm, _)| **jm < 0.83).map(|(_, w)| w).sum();
        assert!(below == 0.0 && both.poses.iter().sum::<f64>() > 0.999, "{below}");
    }

    #[test]
    fn few_errors_tell_less_than_many() {
        let width = |independent: f64| {
            let few: Vec<Hanging> =
                hanging(1.4).into_iter().map(|h| Hanging { independent, ..h }).collect();
            let both = Both::new(&few, &[], &record(1.4)).unwrap();
            let [low, high] = both.marginal(&both.poses).interval;
            high / low
        };
        assert!(width(10.0) > 1.2 * width(80.0));
    }
}
