//! Cuts through volumes, with outlines of labels, and two volumes on top of each other.

use super::raster::{Raster, Rgb};
use mammotwin_data::{
    Vec3,
    labels::{LabelMap, Tissue},
    volume::{Grid, Volume},
};

/// Direction of a cut, in the person's axes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Plane {
    /// Across; the front is up, the person's right is on the left.
    Axial,
    /// From ear to ear; the head is up, the person's right is on the left.
    Coronal,
    /// From front to back; the head is up, the front is on the left.
    Sagittal,
}

impl Plane {
    /// All planes.
    pub const ALL: [Self; 3] = [Self::Axial, Self::Coronal, Self::Sagittal];

    /// Unit vectors of the picture, to the right and down, and the axis that is cut.
    fn axes(self) -> (Vec3, Vec3, usize) {
        match self {
            Self::Axial => (-Vec3::x(), -Vec3::y(), 2),
            Self::Coronal => (-Vec3::x(), -Vec3::z(), 1),
            Self::Sagittal => (-Vec3::y(), -Vec3::z(), 0),
        }
    }

    /// Letters at the left, right, top and bottom of the picture.
    pub fn marks(self) -> [&'static str; 4] {
        match self {
            Self::Axial => ["R", "L", "A", "P"],
            Self::Coronal => ["R", "L", "S", "I"],
            Self::Sagittal => ["A", "P", "S", "I"],
        }
    }

    fn title(self) -> &'static str {
        match self {
            Self::Axial => "Axial",
            Self::Coronal => "Coronal",
            Self::Sagittal => "Sagittal",
        }
    }
}

/// One cut.
#[derive(Debug, Clone, PartialEq)]
pub struct SlicePicture {
    /// "Axial, z = 12 mm".
    pub title: String,
    /// The plane.
    pub plane: Plane,
    /// The picture, in square pixels.
    pub picture: Raster,
}

/// Outline colours and what they mean.
pub const OUTLINES: [(&str, Rgb); 5] = [
    ("right breast", [255, 122, 69]),
    ("left breast", [64, 186, 255]),
    ("fibroglandular", [255, 214, 61]),
    ("pectoral muscle", [236, 92, 196]),
    ("thorax", [118, 214, 118]),
];

/// Air (mm) that is left around the body.
pub const BORDER_MM: f64 = 10.0;

/// Exponent of the grey scale: lifts the dark parts far from the coil.
const GAMMA: f32 = 0.7;

/// Which outline a tissue belongs to: an index into [`OUTLINES`].
fn outline(tissue: Tissue, side: bool) -> Option<usize> {
    match tissue {
        Tissue::AdiposeRight => Some(0),
        Tissue::AdiposeLeft => Some(1),
        Tissue::FibroglandularRight | Tissue::FibroglandularLeft => Some(2),
        // Skin and nipple belong to the breast that they cover.
        Tissue::Skin | Tissue::NippleAreola => Some(usize::from(!side)),
        Tissue::PectoralMuscle => Some(3),
        Tissue::Thorax => Some(4),
        Tissue::Background | Tissue::Other => None,
    }
}

/// Cuts `volume` at `point` (mm), with the outlines of `labels`.
///
/// The picture has square pixels of `mm_per_pixel`, on any grid; with labels it ends
/// [`BORDER_MM`] beyond the body. The grey scale runs from the 1st
/// to the 99.5th percentile of the cut.
pub fn slice(
    volume: &Volume<f32>,
    labels: Option<&LabelMap>,
    plane: Plane,
    point: &Vec3,
    mm_per_pixel: f64,
) -> SlicePicture {
    let frame = Frame::new(&volume.grid, plane, point, mm_per_pixel);
    let mut picture = grey(volume, &frame);
    if let Some(labels) = labels {
        let to_voxel = labels.grid.to_voxel();
        let tissues = frame.map(|p| {
            let tissue = labels.nearest(&to_voxel.apply(p)).unwrap_or(Tissue::Background);
            (tissue, p.x > 0.0)
        });
        let kinds: Vec<_> = tissues.iter().map(|&(tissue, side)| outline(tissue, side)).collect();
        draw_outlines(&mut picture, &kinds);
        let body = |at: usize| tissues[at].0 != Tissue::Background;
        picture = cropped(&picture, body, (BORDER_MM / mm_per_pixel) as usize);
    }
    SlicePicture { title: frame.title(plane, point), plane, picture }
}

/// Two registered volumes cut at the same place: the fixed one, the moved one (already in the
/// frame of the fixed one), and both as a checkerboard.
#[derive(Debug, Clone, PartialEq)]
pub struct OverlayPicture {
    /// "Axial, z = 12 mm".
    pub title: String,
    /// The plane.
    pub plane: Plane,
    /// The fixed volume.
    pub fixed: Raster,
    /// The moved volume, on the same pixels.
    pub moved: Raster,
    /// Fields of both in turn.
    pub checkerboard: Raster,
}

/// Cuts two volumes at `point` (mm) on the pixels of the fixed one.
///
/// `back` carries a point of the fixed frame into the frame of `moving` (mm).
pub fn overlay(
    fixed: &Volume<f32>,
    moving: &Volume<f32>,
    back: impl Fn(&Vec3) -> Vec3,
    plane: Plane,
    point: &Vec3,
    mm_per_pixel: f64,
) -> OverlayPicture {
    let frame = Frame::new(&fixed.grid, plane, point, mm_per_pixel);
    let to_voxel = moving.grid.to_voxel();
    let moved = frame.map(|p| moving.linear(&to_voxel.apply(&back(p))));
    let (fixed, moved) = (grey(fixed, &frame), shade(&moved, &frame));
    let field = (20.0 / mm_per_pixel).round().max(1.0) as usize;
    let mut checkerboard = fixed.clone();
    for at in 0..checkerboard.pixels.len() {
        if (at % fixed.width / field + at / fixed.width / field) % 2 == 1 {
            checkerboard.pixels[at] = moved.pixels[at];
        }
    }
    OverlayPicture { title: frame.title(plane, point), plane, fixed, moved, checkerboard }
}

/// Square pixels in a plane.
struct Frame {
    corner: Vec3,
    right: Vec3,
    down: Vec3,
    width: usize,
    height: usize,
}

impl Frame {
    /// The part of a plane through `point` that a grid covers.
    fn new(grid: &Grid, plane: Plane, point: &Vec3, mm_per_pixel: f64) -> Self {
        let (right, down, cut) = plane.axes();
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for corner in 0..8 {
            let at = |axis: usize| (corner >> axis & 1) * (grid.shape[axis].max(1) - 1);
            let p = grid.center([at(0), at(1), at(2)]);
            for (axis, at) in [p.dot(&right), p.dot(&down)].into_iter().enumerate() {
                low[axis] = low[axis].min(at);
                high[axis] = high[axis].max(at);
            }
        }
        let mut corner = right * low[0] + down * low[1];
        corner[cut] = point[cut];
        let pixels = |axis: usize| ((high[axis] - low[axis]) / mm_per_pixel) as usize + 1;
        let (right, down) = (right * mm_per_pixel, down * mm_per_pixel);
        Self { corner, right, down, width: pixels(0), height: pixels(1) }
    }

    fn map<T>(&self, mut f: impl FnMut(&Vec3) -> T) -> Vec<T> {
        let at = |n: usize| {
            let (column, row) = ((n % self.width) as f64, (n / self.width) as f64);
            self.corner + self.right * column + self.down * row
        };
        (0..self.width * self.height).map(|n| f(&at(n))).collect()
    }

    fn title(&self, plane: Plane, point: &Vec3) -> String {
        let cut = plane.axes().2;
        format!("{}, {} = {:.0} mm", plane.title(), ["x", "y", "z"][cut], point[cut])
    }
}

fn grey(volume: &Volume<f32>, frame: &Frame) -> Raster {
    let to_voxel = volume.grid.to_voxel();
    shade(&frame.map(|p| volume.linear(&to_voxel.apply(p))), frame)
}

/// Grey values between two percentiles; black where there is nothing.
fn shade(values: &[Option<f32>], frame: &Frame) -> Raster {
    let mut sorted: Vec<f32> = values.iter().flatten().copied().filter(|v| v.is_finite()).collect();
    sorted.sort_by(f32::total_cmp);
    let last = sorted.len().saturating_sub(1) as f64;
    let at = |part: f64| sorted.get((last * part) as usize).copied().unwrap_or(0.0);
    let (low, high) = (at(0.01), at(0.995));
    let level = |value: &Option<f32>| {
        let part = value.map_or(0.0, |value| (value - low) / (high - low).max(f32::MIN_POSITIVE));
        // NaN becomes black, too.
        let grey = (part.clamp(0.0, 1.0).powf(GAMMA) * 255.0).round() as u8;
        [grey; 3]
    };
    let pixels = values.iter().map(level).collect();
    Raster { width: frame.width, height: frame.height, pixels }
}

/// The part of a picture where `inside` holds, and a border.
fn cropped(picture: &Raster, inside: impl Fn(usize) -> bool, border: usize) -> Raster {
    let Raster { width, height, .. } = *picture;
    let (mut low, mut high) = ([width, height], [0, 0]);
    for at in (0..width * height).filter(|&at| inside(at)) {
        for (axis, place) in [at % width, at / width].into_iter().enumerate() {
            low[axis] = low[axis].min(place.saturating_sub(border));
            high[axis] = high[axis].max(place + border + 1);
        }
    }
    let [columns, rows] = [low[0]..high[0].min(width), low[1]..high[1].min(height)];
    if columns.is_empty() || rows.is_empty() {
        return picture.clone();
    }
    let row = |row: usize| &picture.pixels[row * width..][columns.clone()];
    let pixels = rows.clone().flat_map(row).copied().collect();
    Raster { width: columns.len(), height: rows.len(), pixels }
}

/// Draws a line where a pixel and its right or lower neighbour differ.
fn draw_outlines(picture: &mut Raster, kinds: &[Option<usize>]) {
    let width = picture.width;
    for at in 0..kinds.len() {
        let right = (at % width + 1 < width).then(|| kinds[at + 1]);
        let below = kinds.get(at + width).copied();
        let other = [right, below].into_iter().flatten().find(|kind| *kind != kinds[at]);
        if let Some(other) = other {
            // The inner tissue gives the colour: gland before fat, muscle before thorax.
            let inner = match (kinds[at], other) {
                (Some(2), _) | (_, Some(2)) => Some(2),
                (Some(3), _) | (_, Some(3)) => Some(3),
                (here, there) => here.or(there),
            };
            if let Some(kind) = inner {
                picture.pixels[at] = OUTLINES[kind].1;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mammotwin_data::Mat3;

    /// Bright on the person's right (+x), brighter still in front (+y).
    fn phantom(axes: Mat3) -> Volume<f32> {
        let center = axes * Vec3::new(19.5, 19.5, 9.5);
        let grid = Grid { shape: [40, 40, 20], axes, origin: -center };
        let value = |p: Vec3| if p.x > 0.0 { 100.0 + p.y as f32 } else { 10.0 };
        let values = (0..grid.len()).map(|n| value(grid.center(grid.voxel(n)))).collect();
        Volume { grid, values }
    }

    #[test]
    fn right_is_left_and_front_is_up_whatever_the_axes_of_the_grid() {
        // Voxel axes along +x, -y, +z and then -y, +z, -x: other memory order, same world.
        let plain = Mat3::new(1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, 2.0);
        let turned = Mat3::new(0.0, 0.0, -2.0, -1.0, 0.0, 0.0, 0.0, 1.0, 0.0);
        for axes in [plain, turned] {
            let cut = slice(&phantom(axes), None, Plane::Axial, &Vec3::zeros(), 0.5).picture;
            let at = |x: usize, y: usize| {
                cut.pixels[cut.height * y / 100 * cut.width + cut.width * x / 100][0]
            };
            assert!(at(10, 50) > 150 && at(90, 50) < 50, "right is left: {axes}");
            assert!(at(10, 10) > at(10, 90), "front is up: {axes}");
            assert!(cut.width.abs_diff(78) <= 1 && cut.height.abs_diff(78) <= 1, "aspect");
        }
    }

    #[test]
    fn an_outline_follows_the_label() {
        let image = phantom(Mat3::identity());
        let at = |n: usize| image.grid.center(image.grid.voxel(n));
        let inside = |p: Vec3| p.x.abs() < 8.0 && p.y.abs() < 8.0;
        let label = |n| if inside(at(n)) { Tissue::PectoralMuscle } else { Tissue::Background };
        let values = (0..image.grid.len()).map(label).collect();
        let labels = Volume { grid: image.grid.clone(), values };
        let cut = slice(&image, Some(&labels), Plane::Axial, &Vec3::zeros(), 1.0).picture;
        let drawn = cut.pixels.iter().filter(|&&pixel| pixel == OUTLINES[3].1).count();
        // 16 pixels a side and 10 mm of air.
        assert!(cut.width.abs_diff(36) <= 1 && cut.height.abs_diff(36) <= 1);
        // A line has one pixel each.
        assert!((60..=68).contains(&drawn), "{drawn}");
    }

    #[test]
    fn a_checkerboard_of_equal_volumes_is_the_volume() {
        let image = phantom(Mat3::identity());
        let both = overlay(&image, &image, |p| *p, Plane::Coronal, &Vec3::zeros(), 1.0);
        assert_eq!(both.checkerboard, both.fixed);
        let moved = |p: &Vec3| p + Vec3::new(5.0, 0.0, 0.0);
        let both = overlay(&image, &image, moved, Plane::Coronal, &Vec3::zeros(), 1.0);
        assert_ne!(both.checkerboard, both.fixed);
    }
}
