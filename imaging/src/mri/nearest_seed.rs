//! The nearest seed of every voxel, in linear time.
//!
//! Felzenszwalb & Huttenlocher 2012, Distance transforms of sampled functions,
//! doi:10.4086/toc.2012.v008a019: lower envelopes of parabolas along one axis after the other.

use rayon::prelude::*;

/// No seed at all.
pub const NO_SEED: u32 = u32::MAX;

/// For each voxel of an isotropic grid (i fastest), the index of its nearest seed; of several
/// equally near ones, any, but always the same. [`NO_SEED`] when there is none.
pub fn nearest_seeds(shape: [usize; 3], is_seed: impl Fn(usize) -> bool + Sync) -> Vec<u32> {
    let [ni, nj, nk] = shape;
    let seed = |n: usize| if is_seed(n) { n as u32 } else { NO_SEED };
    let mut nearest: Vec<u32> = (0..ni * nj * nk).into_par_iter().map(seed).collect();
    // Squared distance within the axes done so far, between a voxel and its seed.
    let part = move |n: usize, seed: u32, axes: usize| -> f64 {
        let place = |n: usize| [n % ni, n / ni % nj, n / (ni * nj)];
        let (a, b) = (place(n), place(seed as usize));
        (0..axes).map(|axis| (a[axis] as f64 - b[axis] as f64).powi(2)).sum()
    };
    for axis in 0..3 {
        let stride = [1, ni, ni * nj][axis];
        let length = shape[axis];
        // Lines along the axis: in chunks that hold them whole.
        let lines = |first: usize, chunk: &mut [u32]| {
            let mut line = Line::default();
            for start in
                (0..chunk.len() / length).map(|l| l / stride * stride * length + l % stride)
            {
                let squares = |q: usize| {
                    let n = start + q * stride;
                    let seed = chunk[n];
                    (seed != NO_SEED).then(|| (seed, part(first + n, seed, axis)))
                };
                line.envelope(length, squares);
                line.read(length, |q, seed| chunk[start + q * stride] = seed);
            }
        };
        if axis == 2 {
            // A chunk would be the whole volume: turn so that lines along k are contiguous.
            let mut turned = transpose(&nearest, ni * nj, nk);
            turned.par_chunks_mut(nk).enumerate().for_each(|(column, chunk)| {
                let mut line = Line::default();
                let squares = |q: usize| {
                    let seed = chunk[q];
                    (seed != NO_SEED).then(|| (seed, part(q * ni * nj + column, seed, axis)))
                };
                line.envelope(length, squares);
                line.read(length, |q, seed| chunk[q] = seed);
            });
            nearest = transpose(&turned, nk, ni * nj);
        } else {
            let chunk = ni * nj;
            let slices = nearest.par_chunks_mut(chunk).enumerate();
            slices.for_each(|(k, slice)| lines(k * chunk, slice));
        }
    }
    nearest
}

/// Rows of `width` become columns.
pub(super) fn transpose<T: Copy + Default + Send + Sync>(
    values: &[T],
    width: usize,
    height: usize,
) -> Vec<T> {
    // Some columns at a time: a row's values of these lie side by side.
    const TOGETHER: usize = 16;
    let mut turned = vec![T::default(); values.len()];
    turned.par_chunks_mut(height * TOGETHER).enumerate().for_each(|(part, to)| {
        for row in 0..height {
            for column in 0..to.len() / height {
                to[column * height + row] = values[row * width + part * TOGETHER + column];
            }
        }
    });
    turned
}

/// Lower envelope of the parabolas of one line.
#[derive(Default)]
struct Line {
    /// Place, seed and height of each parabola, and where it begins to be the lowest.
    parabolas: Vec<(f64, u32, f64, f64)>,
}

impl Line {
    fn envelope(&mut self, length: usize, at: impl Fn(usize) -> Option<(u32, f64)>) {
        self.parabolas.clear();
        for q in 0..length {
            let Some((seed, height)) = at(q) else { continue };
            let place = q as f64;
            let mut begin = f64::NEG_INFINITY;
            while let Some(&(other, _, low, since)) = self.parabolas.last() {
                begin =
                    ((height + place * place) - (low + other * other)) / (2.0 * (place - other));
                if begin > since {
                    break;
                }
                self.parabolas.pop();
                begin = f64::NEG_INFINITY;
            }
            self.parabolas.push((place, seed, height, begin));
        }
    }

    fn read(&self, length: usize, mut write: impl FnMut(usize, u32)) {
        let mut n = 0;
        for q in 0..length {
            while n + 1 < self.parabolas.len() && self.parabolas[n + 1].3 < q as f64 {
                n += 1;
            }
            write(q, self.parabolas.get(n).map_or(NO_SEED, |p| p.1));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    #[test]
    fn agrees_with_trying_all_seeds() {
        let shape = [13, 9, 11];
        let mut rng = ChaCha8Rng::seed_from_u64(7);
        for density in [0.0, 0.002, 0.02, 0.3] {
            let seeds: Vec<bool> =
                (0..13 * 9 * 11).map(|_| rng.random::<f64>() < density).collect();
            let found = nearest_seeds(shape, |n| seeds[n]);
            let place = |n: usize| [n % 13, n / 13 % 9, n / 117].map(|v| v as i64);
            let square = |a: usize, b: usize| -> i64 {
                (0..3).map(|axis| (place(a)[axis] - place(b)[axis]).pow(2)).sum()
            };
            for n in 0..seeds.len() {
                let best = (0..seeds.len()).filter(|&m| seeds[m]).map(|m| square(n, m)).min();
                let got = (found[n] != NO_SEED).then(|| square(n, found[n] as usize));
                assert_eq!(got, best);
            }
        }
    }
}
