//! Gland and fat: two classes of brightness inside of the breast.

/// Brightness (in units of fat) of the two tissues, and the value that parts them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Classes {
    /// Mean brightness of fibroglandular tissue.
    pub gland: f64,
    /// Mean brightness of fat.
    pub fat: f64,
    /// Darker is gland.
    pub threshold: f64,
}

const BINS: usize = 160;
/// Brightest value of the histogram, in units of fat.
const BRIGHTEST: f64 = 1.6;

/// Fits two normal distributions to brightnesses by expectation maximisation.
///
/// The threshold is where both classes are equally likely, kept between 0.45 and 0.7 of the
/// brightness of fat: a breast almost without gland must not have its fat split in two.
pub(super) fn classify(values: impl Iterator<Item = f32>) -> Classes {
    let mut histogram = [0.0f64; BINS];
    for v in values {
        let bin = f64::from(v) / BRIGHTEST * BINS as f64;
        histogram[(bin.max(0.0) as usize).min(BINS - 1)] += 1.0;
    }
    let center = |bin: usize| (bin as f64 + 0.5) * BRIGHTEST / BINS as f64;
    let (mut mean, mut deviation, mut share) = ([0.45, 1.0], [0.15, 0.12], [0.2, 0.8]);
    let total: f64 = histogram.iter().sum();
    if total == 0.0 {
        return Classes { gland: mean[0], fat: mean[1], threshold: 0.65 };
    }
    let likelihood = |x: f64, class: usize, mean: &[f64; 2], dev: &[f64; 2], share: &[f64; 2]| {
        let z = (x - mean[class]) / dev[class];
        share[class] / dev[class] * (-0.5 * z * z).exp()
    };
    for _ in 0..60 {
        let (mut n, mut sum, mut square) = ([1e-9; 2], [0.0; 2], [0.0; 2]);
        for bin in 0..BINS {
            let x = center(bin);
            let p = [0, 1].map(|class| likelihood(x, class, &mean, &deviation, &share) + 1e-12);
            for class in 0..2 {
                let part = histogram[bin] * p[class] / (p[0] + p[1]);
                n[class] += part;
                sum[class] += part * x;
                square[class] += part * x * x;
            }
        }
        for class in 0..2 {
            mean[class] = sum[class] / n[class];
            let variance = square[class] / n[class] - mean[class] * mean[class];
            deviation[class] = variance.max(0.0).sqrt().clamp(0.04, 0.25);
            share[class] = (n[class] / total).clamp(0.01, 0.99);
        }
        mean[1] = mean[1].max(0.8);
        mean[0] = mean[0].min(0.7 * mean[1]);
    }
    let more_fat = |x: &f64| {
        likelihood(*x, 1, &mean, &deviation, &share) >= likelihood(*x, 0, &mean, &deviation, &share)
    };
    let equal = (0..BINS).map(center).filter(|x| *x > mean[0]).find(more_fat);
    let threshold = equal.unwrap_or(0.65 * mean[1]).clamp(0.45 * mean[1], 0.7 * mean[1]);
    Classes { gland: mean[0], fat: mean[1], threshold }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_distr::{Distribution, Normal};

    fn mixture(gland: usize, fat: usize) -> Vec<f32> {
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(7);
        let (dark, bright) = (Normal::new(0.4, 0.08).unwrap(), Normal::new(1.0, 0.08).unwrap());
        let mut values: Vec<f32> = (0..gland).map(|_| dark.sample(&mut random) as f32).collect();
        values.extend((0..fat).map(|_| bright.sample(&mut random) as f32));
        values
    }

    #[test]
    fn means_and_threshold_of_a_mixture_are_recovered() {
        let found = classify(mixture(4_000, 16_000).into_iter());
        assert!((found.gland - 0.4).abs() < 0.02 && (found.fat - 1.0).abs() < 0.02);
        assert!((found.threshold - 0.7).abs() < 0.06, "{found:?}");
    }

    #[test]
    fn fat_alone_is_not_split_in_two() {
        let values = mixture(0, 20_000);
        let found = classify(values.iter().copied());
        let gland = values.iter().filter(|v| f64::from(**v) < found.threshold).count();
        assert!(gland < 800, "{gland} of 20000, {found:?}");
    }
}
