//! Root of a falling function of one modulus, found in its logarithm.

/// A bracketing secant search: give it residuals, it proposes the next modulus.
///
/// The residual (mm) is positive when the model is too soft (sags farther than measured), so it
/// falls with the modulus.
#[derive(Debug, Clone)]
pub struct Secant {
    /// (ln E, residual) in the order of evaluation.
    trials: Vec<(f64, f64)>,
    bounds: [f64; 2],
}

/// Largest factor between two trials while no bracket is known.
const STRIDE: f64 = 2.0;

impl Secant {
    /// A search between two moduli (kPa).
    pub fn within(low_kpa: f64, high_kpa: f64) -> Self {
        Self { trials: Vec::new(), bounds: [low_kpa.ln(), high_kpa.ln()] }
    }

    /// Notes the residual (mm) at a modulus (kPa).
    pub fn note(&mut self, young_kpa: f64, residual_mm: f64) {
        self.trials.push((young_kpa.ln(), residual_mm));
    }

    /// The next modulus (kPa) to try; `None` before the first trial.
    pub fn next(&self) -> Option<f64> {
        let &(last, residual) = self.trials.last()?;
        // Nearest trials on both sides of the root.
        let softer = self.trials.iter().filter(|t| t.1 > 0.0).max_by(|a, b| a.0.total_cmp(&b.0));
        let stiffer = self.trials.iter().filter(|t| t.1 <= 0.0).min_by(|a, b| a.0.total_cmp(&b.0));
        let x = match (softer, stiffer) {
            (Some(a), Some(b)) if a.0 < b.0 => {
                let t = (a.1 / (a.1 - b.1)).clamp(0.1, 0.9);
                a.0 + t * (b.0 - a.0)
            }
            _ => {
                let step = self.slope().map_or(residual.signum() * STRIDE.ln(), |s| -residual / s);
                last + step.clamp(-STRIDE.ln(), STRIDE.ln())
            }
        };
        Some(x.clamp(self.bounds[0], self.bounds[1]).exp())
    }

    /// Slope of the residual over the last two trials; `None` when it does not fall.
    fn slope(&self) -> Option<f64> {
        let [.., a, b] = self.trials.as_slice() else { return None };
        let slope = (b.1 - a.1) / (b.0 - a.0);
        (slope.is_finite() && slope < 0.0).then_some(slope)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn finds_the_modulus_of_a_sag_that_goes_with_its_inverse() {
        for (start, truth) in [(0.5, 0.2), (0.5, 3.0), (0.5, 0.5), (0.3, 0.31)] {
            let sag = |e: f64| 10.0 / e;
            let mut search = Secant::within(0.05, 10.0);
            let mut young = start;
            let mut trials = 0;
            let mut off = f64::INFINITY;
            while off.abs() > 0.01 * sag(truth) {
                off = sag(young) - sag(truth);
                search.note(young, off);
                young = search.next().unwrap();
                trials += 1;
                assert!(trials < 9, "{start} -> {truth}: {:?}", search.trials);
            }
        }
    }

    #[test]
    fn stays_within_its_bounds() {
        let mut search = Secant::within(0.1, 6.0);
        search.note(0.15, -50.0);
        assert_eq!(search.next().map(|e| (e * 1e6).round()), Some(1e5));
    }
}
