//! Colours for numbers.

use super::raster::Rgb;

/// How numbers become colours.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Palette {
    /// From dark to light, for quantities that begin at zero: viridis (Smith and van der Walt
    /// 2015, CC0).
    Sequential,
    /// Blue below zero, light grey at zero, red above.
    Diverging,
}

/// Nine equally spaced colours of viridis.
const VIRIDIS: [Rgb; 9] = [
    [68, 1, 84],
    [71, 44, 122],
    [59, 81, 139],
    [44, 113, 142],
    [33, 144, 141],
    [39, 173, 129],
    [92, 200, 99],
    [170, 220, 50],
    [253, 231, 37],
];

/// Nine equally spaced colours from blue over light grey to red, of equal steps in lightness.
const BLUE_RED: [Rgb; 9] = [
    [33, 72, 159],
    [67, 114, 189],
    [116, 158, 213],
    [173, 201, 230],
    [236, 234, 230],
    [241, 189, 165],
    [226, 132, 104],
    [199, 73, 63],
    [155, 20, 38],
];

/// Where there is no number.
pub const NO_VALUE: Rgb = [201, 199, 194];

impl Palette {
    /// Colour of `value` when the scale runs over `low..=high`; grey for NaN.
    pub fn color(self, value: f64, [low, high]: [f64; 2]) -> Rgb {
        if !value.is_finite() {
            return NO_VALUE;
        }
        let part = if high > low { ((value - low) / (high - low)).clamp(0.0, 1.0) } else { 0.0 };
        let stops = self.stops();
        let at = part * (stops.len() - 1) as f64;
        let below = (at as usize).min(stops.len() - 2);
        let up = at - below as f64;
        [0, 1, 2].map(|c| {
            let [a, b] = [stops[below][c], stops[below + 1][c]].map(f64::from);
            (a + (b - a) * up).round() as u8
        })
    }

    /// Equally spaced colours from low to high.
    pub fn stops(self) -> &'static [Rgb] {
        match self {
            Self::Sequential => &VIRIDIS,
            Self::Diverging => &BLUE_RED,
        }
    }

    /// A scale for these values: from zero to the 99th percentile, or symmetric about zero. Both
    /// ends are round numbers.
    pub fn range(self, values: &[f64]) -> [f64; 2] {
        let mut sizes: Vec<f64> =
            values.iter().filter(|v| v.is_finite()).map(|v| v.abs()).collect();
        sizes.sort_by(f64::total_cmp);
        let last = sizes.len().saturating_sub(1);
        let largest = sizes.get((last as f64 * 0.99).ceil() as usize).copied().unwrap_or(1.0);
        let high = round_up(largest);
        match self {
            Self::Sequential => [0.0, high],
            Self::Diverging => [-high, high],
        }
    }
}

/// The next of 1, 1.5, 2, 3, 4, 5, 6, 8, 10 times a power of ten; 1 for what is not positive.
fn round_up(value: f64) -> f64 {
    if !(value > 0.0 && value.is_finite()) {
        return 1.0;
    }
    let power = 10f64.powf(value.log10().floor());
    let steps = [1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0];
    let step = steps.into_iter().find(|step| step * power >= value * (1.0 - 1e-9));
    step.unwrap_or(10.0) * power
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_scale_ends_at_round_numbers_and_its_ends_have_the_end_colours() {
        let values: Vec<f64> = (0..=100).map(|n| f64::from(n) * 0.0231).collect();
        assert_eq!(Palette::Sequential.range(&values), [0.0, 3.0]);
        assert_eq!(Palette::Diverging.range(&[-0.7, 0.2, f64::NAN]), [-0.8, 0.8]);
        assert_eq!(Palette::Sequential.range(&[]), [0.0, 1.0]);
        assert_eq!(Palette::Sequential.color(9.0, [0.0, 3.0]), VIRIDIS[8]);
        assert_eq!(Palette::Diverging.color(0.0, [-2.0, 2.0]), BLUE_RED[4]);
        assert_eq!(Palette::Diverging.color(f64::NAN, [-2.0, 2.0]), NO_VALUE);
    }
}
