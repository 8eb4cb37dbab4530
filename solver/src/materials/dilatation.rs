//! The dilatations θ(J) whose half squares are the volumetric energies in use.

use super::Jet1;

/// θ = J - 1, for U = ½ K (J - 1)².
pub(super) fn linear(j: f64) -> Jet1 {
    Jet1 { value: j - 1.0, d1: 1.0, d2: 0.0 }
}

/// θ = ln J, for U = ½ K ln² J.
pub(super) fn logarithmic(j: f64) -> Jet1 {
    Jet1 { value: j.ln(), d1: 1.0 / j, d2: -1.0 / (j * j) }
}

/// θ = ± √((J² - 1)/2 - ln J), for U = ½ K ((J² - 1)/2 - ln J).
///
/// With e = J - 1 this is e √(1 - e/3 + e²/4 - e³/5 + ...), smooth through J = 1.
pub(super) fn square_and_logarithm(j: f64) -> Jet1 {
    let e = j - 1.0;
    if e.abs() < 0.05 {
        return near_one(e);
    }
    let value = e.signum() * (0.5 * (j * j - 1.0) - j.ln()).sqrt();
    let d1 = 0.5 * (j - 1.0 / j) / value;
    let d2 = (0.5 * (1.0 + 1.0 / (j * j)) - d1 * d1) / value;
    Jet1 { value, d1, d2 }
}

/// Terms of the series: 0.05^12 is below rounding.
const TERMS: i32 = 12;

fn near_one(e: f64) -> Jet1 {
    // f = 1 + Σ (-e)^n / (n + 2), n >= 1, by Horner's rule with its derivatives.
    let (mut f, mut df, mut ddf) = (0.0, 0.0, 0.0);
    for n in (0..=TERMS).rev() {
        let sign = if n % 2 == 0 { 1.0 } else { -1.0 };
        let coefficient = if n == 0 { 1.0 } else { sign / f64::from(n + 2) };
        ddf = ddf * e + 2.0 * df;
        df = df * e + f;
        f = f * e + coefficient;
    }
    e_root([f, df, ddf], e)
}

/// θ = e √(1 + e² + ... + e^(2N-2)), e = J - 1, for U = ½ K Σ (J - 1)^(2k), k = 1..=N.
pub(super) fn even_powers(j: f64, terms: usize) -> Jet1 {
    let e = j - 1.0;
    let (mut f, mut df, mut ddf) = (0.0, 0.0, 0.0);
    for _ in 0..terms {
        // f -> 1 + e² f.
        ddf = e * e * ddf + 4.0 * e * df + 2.0 * f;
        df = e * e * df + 2.0 * e * f;
        f = 1.0 + e * e * f;
    }
    e_root([f, df, ddf], e)
}

/// e √f, from f and its two derivatives.
fn e_root([f, df, ddf]: [f64; 3], e: f64) -> Jet1 {
    let root = f.sqrt();
    Jet1 {
        value: e * root,
        d1: root + 0.5 * e * df / root,
        d2: df / root + e * (0.5 * ddf / root - 0.25 * df * df / (f * root)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn even_powers_square_to_their_sum() {
        for j in [0.3, 0.9, 1.0, 1.4, 2.5f64] {
            let e = j - 1.0;
            let linear = even_powers(j, 1);
            assert_eq!((linear.value, linear.d1, linear.d2), (e, 1.0, 0.0));
            let three = even_powers(j, 3);
            let sum = e.powi(2) + e.powi(4) + e.powi(6);
            let slope = 2.0 * e + 4.0 * e.powi(3) + 6.0 * e.powi(5);
            let bend = 2.0 + 12.0 * e.powi(2) + 30.0 * e.powi(4);
            for (got, want) in [
                (three.value.powi(2), sum),
                (2.0 * three.value * three.d1, slope),
                (2.0 * (three.d1.powi(2) + three.value * three.d2), bend),
            ] {
                assert!((got - want).abs() < 1e-13 * (1.0 + want.abs()), "J = {j}: {got} {want}");
            }
        }
    }

    #[test]
    fn half_the_square_is_the_volumetric_energy_and_its_derivatives() {
        for j in [0.4, 0.9, 0.949, 0.951, 0.999, 1.0, 1.0 + 1e-9, 1.02, 1.049, 1.051, 1.3, 2.0] {
            let t = square_and_logarithm(j);
            let close = |got: f64, want: f64| {
                assert!((got - want).abs() < 1e-12 * (1.0 + want.abs()), "J = {j}: {got} {want}");
            };
            // (J² - 1)/2 - ln J loses digits near 1; its derivatives do not.
            close(t.value * t.d1, 0.5 * (j - 1.0 / j));
            close(t.d1 * t.d1 + t.value * t.d2, 0.5 * (1.0 + 1.0 / (j * j)));
            if (j - 1.0).abs() > 0.04 {
                close(t.value * t.value, 0.5 * (j * j - 1.0) - j.ln());
            }
        }
    }
}
