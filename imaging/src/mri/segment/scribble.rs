//! What a person marked in an image: it teaches the brightness of the tissues, and it holds.
//!
//! Marks do three things. Where fat is not brighter than muscle and gland (fat suppression, silent
//! sequences) the image is recoloured first, to the contrast that the rest of this folder knows: the
//! brightness of each class and a smooth shading are fitted to the marked voxels, and each voxel becomes
//! the mean of the classes' nominal brightnesses, weighted by how likely each class is. Marks of gland
//! and fat replace the clustering. And no surface of the chest wall passes a mark on its wrong side.

use super::error::SegmentError;
use super::filter;
use super::frame::Frame;
use super::polar::Polar;
use super::tissue::Classes;
use mammotwin_data::{
    Vec3,
    labels::{Scribbles, Tissue},
    volume::{Grid, Volume},
};
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

/// A class of brightness.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Class {
    Air,
    Fat,
    Gland,
    Skin,
    Muscle,
}

impl Class {
    const ALL: [Self; 5] = [Self::Air, Self::Fat, Self::Gland, Self::Skin, Self::Muscle];
    /// Those that are shaded by the coil.
    const SHADED: [Self; 4] = [Self::Fat, Self::Gland, Self::Skin, Self::Muscle];

    fn of(tissue: Tissue) -> Option<Self> {
        use Tissue::*;
        Some(match tissue {
            Background => Self::Air,
            AdiposeRight | AdiposeLeft => Self::Fat,
            FibroglandularRight | FibroglandularLeft => Self::Gland,
            Skin | NippleAreola => Self::Skin,
            PectoralMuscle => Self::Muscle,
            // Anything may be marked as other tissue, and behind the muscle there is bone, lung and heart.
            Other | Thorax => return None,
        })
    }

    /// Brightness in a T2 weighted image without fat suppression, in units of fat. That of air is not
    /// zero: its logarithm is taken.
    fn nominal(self) -> f64 {
        match self {
            Self::Air => 0.02,
            Self::Fat => 1.0,
            Self::Gland => 0.42,
            Self::Skin => 0.36,
            Self::Muscle => 0.17,
        }
    }
}

/// Marked voxels of a class below this number tell nothing of it.
const LEAST_MARKS: usize = 5;
/// ln of fat over muscle, and of fat over gland, from which on the image shows fat as bright.
const BRIGHT_FAT: [f64; 2] = [0.26, 0.14];
/// Least standard deviation of ln(brightness) of a class.
const LEAST_SPREAD: f64 = 0.08;
/// Value of fat in a recoloured image.
const FAT: f64 = 1000.0;
/// Keeps the shading flat where few marks tell of it.
const FLAT: f64 = 1e-3;

/// An image in the contrast that the segmentation knows.
pub(super) struct Recoloured {
    /// All of it.
    pub image: Volume<f32>,
    /// Between fat and gland alone, in units of fat: a voxel that shares in both is no muscle there.
    pub breast: Volume<f32>,
}

/// The marked voxels.
pub(super) struct Marks {
    grid: Grid,
    /// Position in the values, what is there, and its place in the body's axes (mm).
    voxels: Vec<(usize, Tissue, Vec3)>,
}

impl Marks {
    /// The marks of `scribbles`, which must lie on the image's grid; none without scribbles.
    pub(super) fn new(
        scribbles: Option<&Scribbles>,
        image: &Volume<f32>,
        frame: &Frame,
    ) -> Result<Self, SegmentError> {
        let grid = image.grid.clone();
        let Some(Scribbles(marked)) = scribbles else {
            return Ok(Self { grid, voxels: Vec::new() });
        };
        let end = |grid: &Grid| grid.center(grid.shape.map(|n| n - 1));
        let [least, apart] = [
            grid.spacing_mm().into_iter().fold(f64::INFINITY, f64::min),
            (grid.origin - marked.grid.origin).norm().max((end(&grid) - end(&marked.grid)).norm()),
        ];
        if marked.grid.shape != grid.shape || apart > 0.1 * least {
            return Err(SegmentError::ScribblesElsewhere);
        }
        let place =
            |n: usize| frame.body_from_voxel.apply(&Vec3::from(grid.voxel(n).map(|v| v as f64)));
        let mark = |(n, tissue): (usize, &Option<Tissue>)| Some((n, (*tissue)?, place(n)));
        let voxels: Vec<_> = marked.values.iter().enumerate().filter_map(mark).collect();
        if voxels.is_empty() {
            return Err(SegmentError::ScribblesEmpty);
        }
        Ok(Self { grid, voxels })
    }

    /// ln(value) and place of the marked voxels of a class.
    fn of<'a>(
        &'a self,
        image: &'a Volume<f32>,
        class: Class,
    ) -> impl Iterator<Item = (f64, &'a Vec3)> {
        let floor = f64::from(image.values.iter().copied().fold(0.0, f32::max)) * 1e-4;
        let own = self.voxels.iter().filter(move |mark| Class::of(mark.1) == Some(class));
        own.map(move |(n, _, p)| (f64::from(image.values[*n]).max(floor).ln(), p))
    }

    /// The image with the contrast that the segmentation knows, when the marks show another one; `None`
    /// when fat is bright in it anyway, or the marks do not tell.
    pub(super) fn recoloured(
        &self,
        image: &Volume<f32>,
        frame: &Frame,
    ) -> Result<Option<Recoloured>, SegmentError> {
        if self.voxels.is_empty() {
            return Ok(None);
        }
        let shading = Shading::fitted(self, image, frame);
        // Noise of air is no darker than air, and its mean over neighbours is less noisy.
        let mut calm = image.values.clone();
        filter::box_blur(&mut calm, image.grid.shape, [1; 3]);
        let calm = |n: usize| f64::from(calm[n].min(image.values[n]).max(1e-6)).ln();
        let marks_of =
            |class: Class| self.voxels.iter().filter(move |mark| Class::of(mark.1) == Some(class));
        let level = |class: Class| match class {
            Class::Air => Level::above(marks_of(class).map(|mark| calm(mark.0)).collect()),
            _ => Level::of(self.of(image, class).map(|(value, p)| value - shading.at(p)).collect()),
        };
        let levels = Class::ALL.map(level);
        let [air, fat, gland, _, muscle] = levels;
        let bright = |dark: Option<Level>, least: f64| match (fat, dark) {
            (Some(fat), Some(dark)) => fat.mean - dark.mean >= least,
            _ => true,
        };
        if bright(muscle, BRIGHT_FAT[0]) && bright(gland, BRIGHT_FAT[1]) {
            return Ok(None);
        }
        let (Some(fat), Some(gland), Some(_), Some(_)) = (fat, gland, muscle, air) else {
            let wanted = [(air, "air (10)"), (gland, "gland (3, 4)"), (muscle, "muscle (6)")];
            let missing = wanted.iter().filter(|(level, _)| level.is_none());
            let missing: Vec<&str> = missing.map(|(_, words)| *words).collect();
            return Err(SegmentError::ScribblesMissing { missing: missing.join(", ") });
        };
        let known: Vec<(Class, Level)> =
            Class::ALL.into_iter().zip(levels).filter_map(|(c, l)| Some((c, l?))).collect();
        let brightest = known.iter().map(|(_, l)| l.mean).fold(f64::NEG_INFINITY, f64::max);
        let [dark, bright] = [fat.mean.exp(), gland.mean.exp()];
        let apart = (gland.mean - fat.mean).abs() > BRIGHT_FAT[1];
        let slice = self.grid.shape[0] * self.grid.shape[1];
        let mut values = image.values.clone();
        let mut breast = image.values.clone();
        let slices = values.par_chunks_mut(slice).zip(breast.par_chunks_mut(slice)).enumerate();
        slices.for_each(|(k, (values, breast))| {
            for (n, (value, inner)) in values.iter_mut().zip(breast).enumerate() {
                let n = k * slice + n;
                let voxel = self.grid.voxel(n).map(|v| v as f64);
                let p = frame.body_from_voxel.apply(&Vec3::from(voxel));
                let even = f64::from(value.max(1e-6)).ln() - shading.at(&p);
                let (mut sum, mut total) = (0.0, 1e-30);
                for (class, level) in &known {
                    let x = match class {
                        Class::Air => calm(n).max(level.mean),
                        _ => even.min(brightest),
                    };
                    let likely = level.density(x);
                    sum += likely * class.nominal();
                    total += likely;
                }
                *value = (FAT * sum / total).max(FAT * Class::Air.nominal()) as f32;
                *inner = if apart {
                    let share = ((even.exp() - dark) / (bright - dark)).clamp(-0.5, 1.5);
                    (1.0 - share * (1.0 - Class::Gland.nominal())) as f32
                } else {
                    *value / FAT as f32
                };
            }
        });
        let volume = |values| Volume { grid: image.grid.clone(), values };
        Ok(Some(Recoloured { image: volume(values), breast: volume(breast) }))
    }

    /// Places (mm, body's axes) that are marked as muscle or what lies behind it.
    pub(super) fn behind(&self) -> impl Iterator<Item = &Vec3> {
        self.voxels.iter().filter(|mark| mark.1.is_chest_wall()).map(|mark| &mark.2)
    }

    /// `found`, but for what marks of gland and fat say; `brightness` in units of fat.
    pub(super) fn classes(&self, brightness: &Volume<f32>, found: Classes) -> Classes {
        let mean = |class: Class| {
            let own = self.voxels.iter().filter(|mark| Class::of(mark.1) == Some(class));
            Level::of(own.map(|mark| f64::from(brightness.values[mark.0])).collect())
        };
        let (gland, fat) = (mean(Class::Gland), mean(Class::Fat));
        if gland.is_none() && fat.is_none() {
            return found;
        }
        let usual = |mean: f64| Level { mean, spread: LEAST_SPREAD };
        let (gland, fat) = (gland.unwrap_or(usual(found.gland)), fat.unwrap_or(usual(found.fat)));
        if gland.mean >= fat.mean {
            return found;
        }
        // As many standard deviations from the one as from the other.
        let threshold =
            (gland.mean * fat.spread + fat.mean * gland.spread) / (gland.spread + fat.spread);
        Classes { gland: gland.mean, fat: fat.mean, threshold }
    }

    /// Writes the marks over the labels.
    pub(super) fn hold(&self, labels: &mut [Tissue]) {
        for &(n, tissue, _) in &self.voxels {
            labels[n] = tissue;
        }
    }

    /// Between which radii front and rear of the muscle have to pass.
    pub(super) fn bounds(&self, polar: &Polar) -> Bounds {
        let mut bounds = Bounds::none(polar.len());
        for (_, tissue, p) in &self.voxels {
            let (radius, at) = polar.locate(p);
            let [n_u, n_v] = polar.shape;
            if !polar.holds(at) || at[1] < -0.5 || at[1] > n_v as f64 - 0.5 {
                continue;
            }
            // The columns between which a map is interpolated there.
            for corner in 0..4 {
                let column = |value: f64, n: usize, up: bool| {
                    (if up { value.ceil() } else { value.floor() }).clamp(0.0, n as f64 - 1.0)
                        as usize
                };
                let u = column(at[0], n_u, corner & 1 == 1);
                let v = column(at[1], n_v, corner & 2 == 2);
                bounds.add(v * n_u + u, radius as f32, *tissue);
            }
        }
        bounds.agree();
        bounds
    }
}

/// Mean and standard deviation of a class.
#[derive(Debug, Clone, Copy)]
struct Level {
    mean: f64,
    spread: f64,
}

impl Level {
    /// `None` of too few.
    fn of(values: Vec<f64>) -> Option<Self> {
        if values.len() < LEAST_MARKS {
            return None;
        }
        let count = values.len() as f64;
        let mean = values.iter().sum::<f64>() / count;
        let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / count;
        Some(Self { mean, spread: variance.sqrt().max(LEAST_SPREAD) })
    }

    /// The same, with the deviation of those above the mean alone: zeros have no logarithm.
    fn above(values: Vec<f64>) -> Option<Self> {
        let mean = Self::of(values.clone())?.mean;
        let above: Vec<f64> = values.into_iter().filter(|v| *v > mean).collect();
        let square = above.iter().map(|v| (v - mean).powi(2)).sum::<f64>();
        let spread = (square / above.len().max(1) as f64).sqrt().max(LEAST_SPREAD);
        Some(Self { mean, spread })
    }

    fn density(&self, x: f64) -> f64 {
        let z = (x - self.mean) / self.spread;
        // A floor, so that far from all classes the nearest still decides.
        ((-0.5 * z * z).exp() + 1e-9 / (1.0 + z * z)) / self.spread
    }
}

/// ln of the coils' shading: a quadratic polynomial of the place.
struct Shading {
    middle: Vec3,
    half: Vec3,
    coefficients: Vec<f64>,
    /// Least and greatest at the marks: nothing is known beyond.
    range: [f64; 2],
}

impl Shading {
    const TERMS: usize = 9;

    fn terms(&self, p: &Vec3) -> [f64; Self::TERMS] {
        let [x, y, z] = (p - self.middle).component_div(&self.half).into();
        [x, y, z, x * x, y * y, z * z, x * y, x * z, y * z]
    }

    fn at(&self, p: &Vec3) -> f64 {
        let sum: f64 = self.terms(p).iter().zip(&self.coefficients).map(|(a, b)| a * b).sum();
        sum.clamp(self.range[0], self.range[1])
    }

    /// Least squares: each class has one brightness, and all share the polynomial.
    fn fitted(marks: &Marks, image: &Volume<f32>, frame: &Frame) -> Self {
        let half = (0.5 * (frame.high - frame.low)).map(|v| v.max(1.0));
        let middle = 0.5 * (frame.high + frame.low);
        let range = [f64::NEG_INFINITY, f64::INFINITY];
        let mut shading = Self { middle, half, coefficients: vec![0.0; Self::TERMS], range };
        let size = Self::TERMS + Class::SHADED.len();
        let mut normal = DMatrix::<f64>::zeros(size, size);
        let mut right = DVector::<f64>::zeros(size);
        let mut count = 0.0;
        for (n, class) in Class::SHADED.into_iter().enumerate() {
            for (value, p) in marks.of(image, class) {
                let mut row = DVector::<f64>::zeros(size);
                row.as_mut_slice()[..Self::TERMS].copy_from_slice(&shading.terms(p));
                row[Self::TERMS + n] = 1.0;
                normal.ger(1.0, &row, &row, 1.0);
                right.axpy(value, &row, 1.0);
                count += 1.0;
            }
        }
        for n in 0..size {
            normal[(n, n)] += if n < Self::TERMS { FLAT * count + 1e-9 } else { 1e-9 };
        }
        if let Some(solved) = normal.cholesky().map(|factor| factor.solve(&right)) {
            shading.coefficients = solved.as_slice()[..Self::TERMS].to_vec();
            let marked = Class::SHADED.into_iter().flat_map(|class| marks.of(image, class));
            let range = marked
                .map(|(_, p)| shading.at(p))
                .fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], value| {
                    [low.min(value), high.max(value)]
                });
            if range[0] <= range[1] {
                shading.range = range;
            }
        }
        shading
    }
}

/// Radii (mm) between which surfaces have to pass, one for each column of a map.
#[derive(Debug, Clone)]
pub(super) struct Bounds {
    /// Of the front of the muscle: least and greatest.
    front: [Vec<f32>; 2],
    /// Of its rear.
    rear: [Vec<f32>; 2],
}

/// A surface passes a marked voxel at least this far (mm) from its centre.
const BESIDE_MM: f32 = 0.5;

impl Bounds {
    pub(super) fn none(columns: usize) -> Self {
        let free = || [vec![f32::NEG_INFINITY; columns], vec![f32::INFINITY; columns]];
        Self { front: free(), rear: free() }
    }

    fn add(&mut self, column: usize, radius: f32, tissue: Tissue) {
        let [least, greatest] = [radius + BESIDE_MM, radius - BESIDE_MM];
        if tissue.is_chest_wall() {
            let low = &mut self.front[0][column];
            *low = low.max(least);
        } else if tissue.is_soft() {
            let high = &mut self.front[1][column];
            *high = high.min(greatest);
        }
        match tissue {
            Tissue::PectoralMuscle => {
                let high = &mut self.rear[1][column];
                *high = high.min(greatest);
            }
            Tissue::Thorax => {
                let low = &mut self.rear[0][column];
                *low = low.max(least);
            }
            _ => {}
        }
    }

    /// Where neighbouring marks contradict each other between columns, muscle holds.
    fn agree(&mut self) {
        for [low, high] in [&mut self.front, &mut self.rear] {
            high.iter_mut().zip(low.iter()).for_each(|(high, low)| *high = high.max(*low));
        }
    }

    /// The front of the muscle, brought between its bounds.
    pub(super) fn front(&self, column: usize, radius: f32) -> f32 {
        radius.max(self.front[0][column]).min(self.front[1][column])
    }

    /// Whether marks say something of the front in a column.
    pub(super) fn tells(&self, column: usize) -> bool {
        self.front[0][column].is_finite() || self.front[1][column].is_finite()
    }

    /// The rear of the muscle, brought between its bounds.
    pub(super) fn rear(&self, column: usize, radius: f32) -> f32 {
        radius.max(self.rear[0][column]).min(self.rear[1][column])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mammotwin_data::rigid::RigidTransform;

    /// Layers of air, fat, gland and muscle whose contrast is that of fat suppression.
    fn layers() -> (Volume<f32>, Volume<Option<Tissue>>) {
        let grid = Grid::aligned([12, 12, 24], [2.0; 3], Vec3::zeros());
        let layer = |n: usize| grid.voxel(n)[2] / 6;
        let value = |n: usize| [5.0, 200.0, 1000.0, 500.0][layer(n)] + (n % 7) as f32;
        let tissues = [
            Tissue::Background,
            Tissue::AdiposeRight,
            Tissue::FibroglandularRight,
            Tissue::PectoralMuscle,
        ];
        let mark = |n: usize| (n.is_multiple_of(5)).then(|| tissues[layer(n)]);
        let image = Volume { values: (0..grid.len()).map(value).collect(), grid: grid.clone() };
        (image, Volume { values: (0..grid.len()).map(mark).collect(), grid })
    }

    /// `other` may be anything: a vessel, an arm, an implant. It is not taken for fat.
    #[test]
    fn marks_of_other_tissue_teach_no_brightness() {
        let (image, marks) = layers();
        let frame = Frame::new(&image.grid, &RigidTransform::identity()).unwrap();
        let taught = |marks: Volume<Option<Tissue>>| {
            let marks = Marks::new(Some(&Scribbles(marks)), &image, &frame).unwrap();
            let classes = Classes { gland: 0.4, fat: 1.0, threshold: 0.7 };
            let level = marks.classes(&image.map(|v| 1.0 / v), classes);
            (marks.recoloured(&image, &frame).unwrap().unwrap(), level)
        };
        let (alone, level) = taught(marks.clone());
        let mut with_other = marks;
        let free = with_other
            .values
            .iter_mut()
            .enumerate()
            .filter(|(n, mark)| mark.is_none() && image.values[*n] > 900.0);
        free.for_each(|(_, mark)| *mark = Some(Tissue::Other));
        let (beside, other_level) = taught(with_other);
        // No assert_eq: it would print all voxels.
        assert!(alone.image == beside.image, "another contrast was learnt");
        assert!(alone.breast == beside.breast);
        assert_eq!(level, other_level);
    }
}
