//! Surfaces painted by a number at each vertex, seen from a few sides.

use super::{
    palette::Palette,
    raster::{Cutout, Raster, Rgb},
};
use mammotwin_data::{Vec3, surface::TriMesh};

/// From where one looks. The person stands upright in the picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Camera {
    /// From the front; the person's right is on the left.
    Front,
    /// From the person's right; the front is on the right.
    Right,
    /// From the person's left; the front is on the left.
    Left,
    /// From the feet; the front is up, the person's right is on the left.
    Below,
    /// From the head; the front is up, the person's right is on the right.
    Above,
}

impl Camera {
    /// Words under the picture.
    pub fn title(self) -> &'static str {
        match self {
            Self::Front => "front",
            Self::Right => "right",
            Self::Left => "left",
            Self::Below => "below",
            Self::Above => "above",
        }
    }

    /// Letters of the person's axes at the left and right of the picture.
    pub fn marks(self) -> [&'static str; 2] {
        match self {
            Self::Front | Self::Below => ["R", "L"],
            Self::Above => ["L", "R"],
            Self::Right => ["P", "A"],
            Self::Left => ["A", "P"],
        }
    }

    /// Width (mm) of the picture of a surface, border included.
    pub fn width_mm(self, surface: &TriMesh) -> f64 {
        let [low, high] = extent(surface, &self.axes()[0]);
        if low <= high { high - low + 2.0 * BORDER } else { 0.0 }
    }

    /// Unit vectors of the picture: to the right, up, towards the viewer.
    fn axes(self) -> [Vec3; 3] {
        let (x, y, z) = (Vec3::x(), Vec3::y(), Vec3::z());
        match self {
            Self::Front => [-x, z, y],
            Self::Right => [y, z, x],
            Self::Left => [-y, z, -x],
            Self::Below => [-x, y, -z],
            Self::Above => [x, y, z],
        }
    }
}

const PAPER: Rgb = [255, 255, 255];
/// Colour of the bar: seen on light and dark ground.
const BAR: Rgb = [125, 125, 125];
/// Empty border (mm).
const BORDER: f64 = 6.0;

/// Draws a surface on white; see [`cut`].
pub fn draw(
    surface: &TriMesh,
    values: &[f64],
    scale: (Palette, [f64; 2]),
    camera: Camera,
    mm_per_pixel: f64,
    bar_mm: f64,
) -> Raster {
    cut(surface, values, scale, camera, mm_per_pixel, bar_mm).on(PAPER)
}

/// Draws a surface with a number at each vertex. Hidden parts are hidden by a depth buffer; edges
/// are smoothed. A bar of `bar_mm` lies at the lower left.
///
/// `values` has one number a vertex; NaN is drawn grey.
pub fn cut(
    surface: &TriMesh,
    values: &[f64],
    (palette, range): (Palette, [f64; 2]),
    camera: Camera,
    mm_per_pixel: f64,
    bar_mm: f64,
) -> Cutout {
    let [right, up, toward] = camera.axes();
    let [left, rightmost] = extent(surface, &right);
    let [bottom, top] = extent(surface, &up);
    if !(rightmost - left).is_finite() || !(top - bottom).is_finite() {
        return Cutout::empty(2, 2);
    }
    // Twice too large, then halved.
    let scale = 2.0 / mm_per_pixel;
    let pixels = |length: f64| (((length + 2.0 * BORDER) * scale).ceil() as usize + 1) & !1;
    let [width, height] = [pixels(rightmost - left), pixels(top - bottom)];
    let mut picture = Cutout::empty(width, height);
    let mut depth = vec![f64::NEG_INFINITY; width * height];
    let normals = surface.vertex_normals();

    for triangle in &surface.triangles {
        let corners = triangle.map(|n| {
            let p = surface.points[n as usize];
            let x = (p.dot(&right) - left + BORDER) * scale;
            let y = (top + BORDER - p.dot(&up)) * scale;
            let facing = normals[n as usize].dot(&toward);
            Vertex { x, y, z: p.dot(&toward), facing, value: values[n as usize] }
        });
        fill(&mut picture, &mut depth, &corners, palette, range);
    }
    let mut picture = picture.halved();
    bar(&mut picture, (bar_mm / mm_per_pixel).round() as usize);
    picture
}

/// Smallest and largest coordinate of the drawn vertices along `axis` (mm).
fn extent(surface: &TriMesh, axis: &Vec3) -> [f64; 2] {
    let drawn = surface.triangles.iter().flatten();
    drawn.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], &n| {
        let at = surface.points[n as usize].dot(axis);
        [low.min(at), high.max(at)]
    })
}

struct Vertex {
    x: f64,
    y: f64,
    z: f64,
    facing: f64,
    value: f64,
}

/// Fills one triangle where it is nearest to the viewer.
fn fill(
    Cutout { picture, cover }: &mut Cutout,
    depth: &mut [f64],
    [a, b, c]: &[Vertex; 3],
    palette: Palette,
    range: [f64; 2],
) {
    let doubled = (b.x - a.x) * (c.y - a.y) - (c.x - a.x) * (b.y - a.y);
    if doubled == 0.0 || !doubled.is_finite() {
        return;
    }
    let span = |u: f64, v: f64, w: f64, end: usize| {
        let from = u.min(v).min(w).max(0.0) as usize;
        let to = (u.max(v).max(w).ceil().max(0.0) as usize).min(end);
        from..to
    };
    for row in span(a.y, b.y, c.y, picture.height) {
        for column in span(a.x, b.x, c.x, picture.width) {
            let (x, y) = (column as f64 + 0.5, row as f64 + 0.5);
            let v = ((x - a.x) * (c.y - a.y) - (c.x - a.x) * (y - a.y)) / doubled;
            let w = ((b.x - a.x) * (y - a.y) - (x - a.x) * (b.y - a.y)) / doubled;
            let u = 1.0 - v - w;
            if u < 0.0 || v < 0.0 || w < 0.0 {
                continue;
            }
            let z = u * a.z + v * b.z + w * c.z;
            let at = row * picture.width + column;
            if z > depth[at] {
                depth[at] = z;
                let color = palette.color(u * a.value + v * b.value + w * c.value, range);
                let light = 0.7 + 0.3 * (u * a.facing + v * b.facing + w * c.facing).abs().min(1.0);
                cover[at] = 255;
                picture.pixels[at] = color.map(|part| (f64::from(part) * light).round() as u8);
            }
        }
    }
}

/// A horizontal bar at the lower left.
fn bar(Cutout { picture, cover }: &mut Cutout, length: usize) {
    let rows = picture.height.saturating_sub(5)..picture.height.saturating_sub(2);
    for row in rows {
        for column in 4..(4 + length).min(picture.width) {
            cover[row * picture.width + column] = 255;
            picture.pixels[row * picture.width + column] = BAR;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A square facing the front at depth `y`, of the value `value`.
    fn square(y: f64, half: f64) -> TriMesh {
        let corner = |x: f64, z: f64| Vec3::new(x * half, y, z * half);
        let points = vec![corner(-1., -1.), corner(1., -1.), corner(1., 1.), corner(-1., 1.)];
        TriMesh { points, triangles: vec![[0, 2, 1], [0, 3, 2]] }
    }

    #[test]
    fn what_is_nearer_hides_what_is_behind() {
        let (near, far) = (square(10.0, 10.0), square(0.0, 30.0));
        let mut both = far.clone();
        both.points.extend(near.points);
        both.triangles.extend(near.triangles.iter().map(|t| t.map(|n| n + 4)));
        let values = [0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0];
        let scale = (Palette::Sequential, [0.0, 1.0]);
        let front = draw(&both, &values, scale, Camera::Front, 1.0, 10.0);
        let center = front.pixels[front.height / 2 * front.width + front.width / 2];
        let side = front.pixels[front.height / 2 * front.width + front.width / 2 + 20];
        assert_eq!(center, Palette::Sequential.color(1.0, [0.0, 1.0]));
        assert_eq!(side, Palette::Sequential.color(0.0, [0.0, 1.0]));
        assert_eq!(front.pixels[0], PAPER);
        // 60 mm and two borders of 6 mm at 1 mm a pixel.
        assert!(front.width.abs_diff(72) <= 1 && front.height.abs_diff(72) <= 1);
    }

    #[test]
    fn the_right_side_of_the_person_is_left_seen_from_the_front() {
        let mut surface = square(0.0, 20.0);
        // Only the person's right (+x) has the value one.
        let values: Vec<f64> = surface.points.iter().map(|p| f64::from(p.x > 0.0)).collect();
        surface.points.push(Vec3::zeros());
        let values = [values, vec![0.0]].concat();
        let scale = (Palette::Sequential, [0.0, 1.0]);
        let front = draw(&surface, &values, scale, Camera::Front, 1.0, 0.0);
        let row = front.height / 2 * front.width;
        let [left, right] = [10, front.width - 11].map(|column| front.pixels[row + column]);
        // Yellow is one, violet is zero.
        assert!(left[1] > 150 && right[1] < 80, "{left:?} {right:?}");
    }

    #[test]
    fn an_empty_surface_is_an_empty_picture() {
        let scale = (Palette::Sequential, [0.0, 1.0]);
        let picture = draw(&TriMesh::default(), &[], scale, Camera::Front, 1.0, 10.0);
        assert_eq!((picture.width, picture.height), (2, 2));
    }
}
