//! Whether two samples differ: Welch's t and Mann and Whitney's U.

use std::f64::consts::PI;

/// A test of two samples.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Test {
    /// t of Welch, or U of Mann and Whitney (of the first sample).
    pub statistic: f64,
    /// Chance of a difference at least as large between samples of one population, both ways.
    pub p: f64,
}

fn mean_and_variance(values: &[f64]) -> (f64, f64) {
    let count = values.len() as f64;
    let mean = values.iter().sum::<f64>() / count;
    let squares: f64 = values.iter().map(|value| (value - mean).powi(2)).sum();
    (mean, squares / (count - 1.0))
}

/// Welch's test of equal means (Biometrika 34 (1947) 28), variances unknown and not alike. `None` with
/// fewer than two values in a sample or without any spread.
pub fn welch(a: &[f64], b: &[f64]) -> Option<Test> {
    if a.len() < 2 || b.len() < 2 {
        return None;
    }
    let [(mean_a, va), (mean_b, vb)] = [a, b].map(mean_and_variance);
    let [na, nb] = [a.len() as f64, b.len() as f64];
    let [ea, eb] = [va / na, vb / nb];
    let t = (mean_a - mean_b) / (ea + eb).sqrt();
    let freedom = (ea + eb).powi(2) / (ea * ea / (na - 1.0) + eb * eb / (nb - 1.0));
    let p = incomplete_beta(0.5 * freedom, 0.5, freedom / (freedom + t * t));
    (t.is_finite() && p.is_finite()).then_some(Test { statistic: t, p })
}

/// Mann and Whitney's test (Ann. Math. Stat. 18 (1947) 50): normal approximation with corrections
/// for ties and continuity, good from about 8 values in each sample. `None` with an empty sample or
/// when all values are alike.
pub fn mann_whitney(a: &[f64], b: &[f64]) -> Option<Test> {
    if a.is_empty() || b.is_empty() {
        return None;
    }
    let first = a.iter().map(|&value| (value, true));
    let mut all: Vec<(f64, bool)> = first.chain(b.iter().map(|&value| (value, false))).collect();
    all.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (mut ranks, mut ties, mut start) = (0.0, 0.0, 0);
    while start < all.len() {
        let end = start + all[start..].iter().take_while(|v| v.0 == all[start].0).count();
        let count = (end - start) as f64;
        let rank = 0.5 * (start + 1 + end) as f64;
        ranks += rank * all[start..end].iter().filter(|v| v.1).count() as f64;
        ties += count * count * count - count;
        start = end;
    }
    let [na, nb, n] = [a.len(), b.len(), all.len()].map(|n| n as f64);
    let u = ranks - 0.5 * na * (na + 1.0);
    let variance = na * nb / 12.0 * (n + 1.0 - ties / (n * (n - 1.0)));
    let away = ((u - 0.5 * na * nb).abs() - 0.5).max(0.0);
    let p = two_sided(away / variance.sqrt());
    (variance > 0.0).then_some(Test { statistic: u, p: p.min(1.0) })
}

/// By how many standard errors a mean of `freedom` + 1 values is within its two-sided interval of chance `inside`
/// (Student, Biometrika 6 (1908) 1): 12.706 for 0.95 of two values, 1.96 of very many.
///
/// # Panics
/// Unless `freedom` > 0 and 0 < `inside` < 1.
pub fn student(inside: f64, freedom: f64) -> f64 {
    assert!(freedom > 0.0 && inside > 0.0 && inside < 1.0, "a chance and degrees of freedom");
    let outside = |t: f64| incomplete_beta(0.5 * freedom, 0.5, freedom / (freedom + t * t));
    let (mut low, mut high) = (0.0, 1.0);
    while outside(high) > 1.0 - inside {
        high *= 2.0;
    }
    // Halved down to the last digit.
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if outside(middle) > 1.0 - inside { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

/// Chance that a standard normal number is farther from zero than `z`.
pub fn two_sided(z: f64) -> f64 {
    complementary_error(z.abs() / 2f64.sqrt())
}

/// erfc(x), x >= 0: series below 2, continued fraction above.
fn complementary_error(x: f64) -> f64 {
    if x < 2.0 {
        let (mut term, mut sum) = (x, x);
        for n in 1..200 {
            term *= -x * x / n as f64;
            sum += term / (2 * n + 1) as f64;
        }
        1.0 - 2.0 / PI.sqrt() * sum
    } else {
        let tail = (1..=120).rev().fold(x, |below, n| x + 0.5 * n as f64 / below);
        (-x * x).exp() / (PI.sqrt() * tail)
    }
}

/// ln Γ(x), x > 0 (Lanczos, g = 7, 9 terms; 15 digits).
fn ln_gamma(x: f64) -> f64 {
    const TERMS: [f64; 9] = [
        0.999_999_999_999_809_9,
        676.520_368_121_885_1,
        -1_259.139_216_722_402_8,
        771.323_428_777_653_1,
        -176.615_029_162_140_6,
        12.507_343_278_686_905,
        -0.138_571_095_265_720_12,
        9.984_369_578_019_572e-6,
        1.505_632_735_149_311_6e-7,
    ];
    let x = x - 1.0;
    let tail = TERMS.iter().enumerate().skip(1);
    let sum = tail.fold(TERMS[0], |sum, (n, term)| sum + term / (x + n as f64));
    let t = x + 7.5;
    0.5 * (2.0 * PI).ln() + (x + 0.5) * t.ln() - t + sum.ln()
}

/// Regularised incomplete beta function I_x(a, b) by Lentz's continued fraction.
fn incomplete_beta(a: f64, b: f64, x: f64) -> f64 {
    if x > (a + 1.0) / (a + b + 2.0) {
        return 1.0 - incomplete_beta(b, a, 1.0 - x);
    }
    if x <= 0.0 {
        return 0.0;
    }
    const TINY: f64 = 1e-300;
    let front =
        (a * x.ln() + b * (1.0 - x).ln() + ln_gamma(a + b) - ln_gamma(a) - ln_gamma(b)).exp() / a;
    let (mut c, mut d, mut value) = (1.0, 0.0, 1.0);
    for n in 0..500 {
        let m = f64::from(n / 2);
        let coefficient = match n {
            0 => 1.0,
            n if n % 2 == 0 => m * (b - m) * x / ((a + 2.0 * m - 1.0) * (a + 2.0 * m)),
            _ => -(a + m) * (a + b + m) * x / ((a + 2.0 * m) * (a + 2.0 * m + 1.0)),
        };
        let nonzero = |v: f64| if v.abs() < TINY { TINY } else { v };
        d = 1.0 / nonzero(1.0 + coefficient * d);
        c = nonzero(1.0 + coefficient / c);
        value *= c * d;
        if (c * d - 1.0).abs() < 1e-15 {
            break;
        }
    }
    front * (value - 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// SciPy 1.17: `ttest_ind(equal_var=False)`, `mannwhitneyu(method="asymptotic")`.
    #[test]
    fn p_values_are_those_of_scipy() {
        let a = [82.9, 126.9, 137.2, 44.1, 99.5, 101.3, 88.8, 73.0];
        let b = [83.7, 137.2, 120.0, 150.1, 131.9, 140.4, 99.5, 128.8, 133.1];
        let c = [1.0, 2.0, 2.0, 3.0, 5.0, 8.0, 8.0, 8.0];
        let d = [8.0, 8.0, 9.0, 11.0, 12.0, 30.0, 31.0];
        let row: Vec<f64> = (0..30).map(f64::from).collect();
        let shifted: Vec<f64> = row.iter().map(|v| v + 25.0).collect();
        let near = |got: Option<Test>, statistic: f64, p: f64| {
            let got = got.unwrap();
            assert!((got.statistic / statistic - 1.0).abs() < 1e-12, "{got:?} {statistic}");
            assert!((got.p / p - 1.0).abs() < 1e-10, "{got:?} {p}");
        };
        near(welch(&a, &b), -2.4457796200592297, 0.03012417248880221);
        near(mann_whitney(&a, &b), 14.0, 0.03832344074035729);
        near(welch(&c, &d), -2.7092880669906045, 0.030640722625861493);
        near(mann_whitney(&c, &d), 3.0, 0.003852052065784784);
        near(welch(&row, &shifted), -10.998533626601494, 8.108573011694179e-16);
        near(mann_whitney(&row, &shifted), 12.5, 1.0384657790343385e-10);
    }

    /// Fisher and Yates, Statistical Tables (1963), table III; of one and two degrees in closed form.
    #[test]
    fn students_t_is_that_of_the_tables() {
        let turn = PI * 0.475;
        assert!((student(0.95, 1.0) / turn.tan() - 1.0).abs() < 1e-12);
        let two = 0.95 * (2.0 / (1.0 - 0.95f64.powi(2))).sqrt();
        assert!((student(0.95, 2.0) / two - 1.0).abs() < 1e-12);
        for (inside, freedom, t) in
            [(0.95, 9.0, 2.262), (0.99, 9.0, 3.250), (0.9, 30.0, 1.697), (0.95, 120.0, 1.980)]
        {
            assert!((student(inside, freedom) - t).abs() < 5e-4, "{inside} {freedom}");
        }
    }

    #[test]
    fn samples_without_an_answer_have_none() {
        assert_eq!(welch(&[1.0], &[1.0, 2.0]), None);
        assert_eq!(welch(&[1.0, 1.0], &[1.0, 1.0]), None);
        assert_eq!(mann_whitney(&[], &[1.0]), None);
        assert_eq!(mann_whitney(&[1.0, 1.0], &[1.0]), None);
    }
}
