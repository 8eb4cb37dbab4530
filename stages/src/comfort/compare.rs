//! Two distributions beside each other: how far apart, how much alike.

use super::Weighted;

/// Bars of the histograms whose overlap is taken.
const BARS: usize = 50;

/// What tells two weighted distributions apart.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Comparison {
    /// Means.
    pub means: [f64; 2],
    /// Second mean less the first.
    pub difference: f64,
    /// Difference over the pooled standard deviation (Cohen's d; both distributions count alike);
    /// zero when nothing varies.
    pub effect_size: f64,
    /// Common part of both distributions, 0..1 (Weitzman 1970), in 50 bars between the smallest
    /// and the largest value.
    pub overlap: f64,
}

/// Compares two distributions; `None` when one has no weight.
pub fn compare(first: &[Weighted], second: &[Weighted]) -> Option<Comparison> {
    let both = [first, second];
    let weights = both.map(|all| all.iter().map(|v| v.1).sum::<f64>());
    if weights.iter().any(|weight| *weight <= 0.0) {
        return None;
    }
    let mean = |n: usize| both[n].iter().map(|(v, w)| v * w).sum::<f64>() / weights[n];
    let means = [mean(0), mean(1)];
    let variance = |n: usize| {
        both[n].iter().map(|(v, w)| w * (v - means[n]).powi(2)).sum::<f64>() / weights[n]
    };
    let spread = (0.5 * (variance(0) + variance(1))).sqrt();
    let difference = means[1] - means[0];
    let values = || both.iter().flat_map(|all| all.iter().map(|v| v.0));
    let low = values().fold(f64::INFINITY, f64::min);
    let high = values().fold(f64::NEG_INFINITY, f64::max);
    let width = (high - low) / BARS as f64;
    let histogram = |n: usize| {
        let mut bars = [0.0; BARS];
        for (value, weight) in both[n] {
            let bar = if width > 0.0 { ((value - low) / width) as usize } else { 0 };
            bars[bar.min(BARS - 1)] += weight / weights[n];
        }
        bars
    };
    let overlap = histogram(0).iter().zip(histogram(1)).map(|(a, b)| a.min(b)).sum();
    let effect_size = if spread > 0.0 { difference / spread } else { 0.0 };
    Some(Comparison { means, difference, effect_size, overlap })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shifted_distributions_have_the_effect_and_overlap_that_they_must() {
        let flat = |from: f64| -> Vec<Weighted> {
            (0..10_000).map(|n| (from + f64::from(n) / 10_000.0, 0.5)).collect()
        };
        let same = compare(&flat(0.0), &flat(0.0)).unwrap();
        assert!((same.overlap - 1.0).abs() < 1e-9 && same.effect_size == 0.0);
        let half = compare(&flat(0.0), &flat(0.5)).unwrap();
        // Even distributions of width one: standard deviation 1/√12.
        assert!((half.effect_size - 0.5 * 12f64.sqrt()).abs() < 1e-3, "{half:?}");
        assert!((half.overlap - 0.5).abs() < 0.02, "{half:?}");
        let apart = compare(&flat(0.0), &flat(7.0)).unwrap();
        assert_eq!(apart.overlap, 0.0);
        assert!((apart.difference - 7.0).abs() < 1e-9);
        assert_eq!(compare(&flat(0.0), &[]), None);
        // Weights count: three parts of four at one.
        let weighted = compare(&[(0.0, 1.0), (1.0, 3.0)], &[(0.0, 2.0), (1.0, 2.0)]).unwrap();
        assert!((weighted.overlap - 0.75).abs() < 1e-12 && weighted.means == [0.75, 0.5]);
    }
}
