//! Radiographs as a reader hangs them.

use super::raster::Raster;
use mammotwin_data::{labels::Side, radiograph::Radiograph};

/// What a pixel of the radiograph says, hence how it becomes light.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Tone {
    /// Detector signal: more signal is darker, on a logarithmic scale.
    Signal,
    /// Path length or another quantity that grows with the tissue: more is lighter.
    Attenuation,
}

/// A part of a radiograph, in pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Region {
    /// First row, counted from the chest wall.
    pub row: usize,
    /// First column.
    pub column: usize,
    /// Rows and columns.
    pub size: usize,
}

/// The whole picture with at most `longest` pixels a side, each the mean of the detector pixels
/// under it.
///
/// Hung as usual: lateral is up; the chest wall is on the right for the right breast and on the
/// left for the left breast.
pub fn whole(radiograph: &Radiograph, tone: Tone, side: Side, longest: usize) -> Raster {
    let Radiograph { rows, columns, .. } = *radiograph;
    let factor = rows.max(columns).div_ceil(longest.max(1)).max(1);
    let (rows, columns) = (rows / factor, columns / factor);
    let mean = |row: usize, column: usize| {
        let mut sum = 0.0;
        for n in 0..factor * factor {
            sum += radiograph.at(row * factor + n / factor, column * factor + n % factor);
        }
        sum / (factor * factor) as f32
    };
    picture(rows, columns, mean, (tone, open_signal(radiograph)), side)
}

/// A part of the picture, pixel by pixel.
pub fn detail(radiograph: &Radiograph, tone: Tone, side: Side, region: Region) -> Raster {
    let rows = region.size.min(radiograph.rows.saturating_sub(region.row));
    let columns = region.size.min(radiograph.columns.saturating_sub(region.column));
    let at = |row: usize, column: usize| radiograph.at(region.row + row, region.column + column);
    picture(rows, columns, at, (tone, open_signal(radiograph)), side)
}

/// Largest signal of the radiograph: that of the open beam.
fn open_signal(radiograph: &Radiograph) -> f32 {
    radiograph.pixels.iter().copied().filter(|v| v.is_finite()).fold(0.0, f32::max)
}

fn picture(
    rows: usize,
    columns: usize,
    at: impl Fn(usize, usize) -> f32,
    (tone, open): (Tone, f32),
    side: Side,
) -> Raster {
    let mut values: Vec<f32> = (0..rows * columns).map(|n| at(n / columns, n % columns)).collect();
    if tone == Tone::Signal {
        let least = open * 1e-4;
        values.iter_mut().for_each(|v| *v = (open / v.max(least)).ln());
    }
    let [low, high] = window(&values);
    let level = |value: f32| {
        let part = (value - low) / (high - low).max(f32::MIN_POSITIVE);
        [(part.clamp(0.0, 1.0) * 255.0).round() as u8; 3]
    };
    // Rows become columns; x grows to the person's right, which is lateral on the right side.
    let pixel = |n: usize| {
        let (down, across) = (n / rows, n % rows);
        let (row, column) = match side {
            Side::Right => (rows - 1 - across, columns - 1 - down),
            Side::Left => (across, down),
        };
        level(values[row * columns + column])
    };
    Raster { width: rows, height: columns, pixels: (0..rows * columns).map(pixel).collect() }
}

/// Values that become black and white: tissue gets the lighter part of the scale, so that its
/// structure is seen; the air around it is black.
fn window(values: &[f32]) -> [f32; 2] {
    let mut sorted: Vec<f32> = values.iter().copied().filter(|v| v.is_finite()).collect();
    sorted.sort_by(f32::total_cmp);
    let percentile = |sorted: &[f32], part: f64| {
        let last = sorted.len().saturating_sub(1) as f64;
        sorted.get((last * part) as usize).copied().unwrap_or(0.0)
    };
    let high = percentile(&sorted, 0.9995);
    let tissue = &sorted[sorted.partition_point(|v| *v < 0.5 * high)..];
    // A slab has no structure but noise: do not stretch that over the whole scale.
    let span = (high - percentile(tissue, 0.02)).max(0.15 * high);
    [high - 1.5 * span, high]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_chest_wall_is_right_and_lateral_is_up_for_the_right_breast() {
        // Signal is lowest (most tissue) in the corner at the chest wall and lateral (+x) end.
        let (rows, columns) = (40, 60);
        let signal = |n: usize| 1e4 / (1.0 + (n % columns) as f32 + (rows - n / columns) as f32);
        let pixels = (0..rows * columns).map(signal).collect();
        let radiograph = Radiograph {
            columns,
            rows,
            pitch_mm: 0.1,
            left_mm: 20.0,
            first_row_mm: 0.05,
            pixels,
            quantity: "photons per pixel".into(),
        };
        let right = whole(&radiograph, Tone::Signal, Side::Right, 1000);
        assert_eq!((right.width, right.height), (rows, columns));
        let [top_right, bottom_left] = [right.width - 1, (right.height - 1) * right.width];
        assert!(right.pixels[top_right][0] > 240 && right.pixels[bottom_left][0] < 20);
        let left = whole(&radiograph, Tone::Signal, Side::Left, 1000);
        assert!(left.pixels[(left.height - 1) * left.width][0] > 240, "chest wall is left");
        let small = whole(&radiograph, Tone::Signal, Side::Right, 30);
        assert_eq!((small.width, small.height), (20, 30));
        let region = Region { row: 30, column: 50, size: 20 };
        let part = detail(&radiograph, Tone::Signal, Side::Right, region);
        assert_eq!((part.width, part.height), (10, 10));
    }
}
