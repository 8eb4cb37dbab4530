//! A test object: grains of known size in a slab, and how faint they are by distance from their middle.

use super::{
    field::{Beams, ChainError},
    library::Chain,
};
use mammotwin_data::{Vec3, radiograph::Radiograph, surface::TriMesh};
use mammotwin_imaging::xray::{
    attenuation::Material,
    calcification::sphere,
    calibration::Unit,
    detector::{Detector, draw},
    exposure::transmission,
    geometry::Geometry,
    phantom::{Calcification, Phantom},
    placement::Site,
    project::project,
    shapes::cuboid,
};

/// Grains along each side of their square, and their distance (mm).
const SIDE: usize = 5;
const PITCH_MM: f64 = 4.0;
/// Diameter (mm).
const DIAMETER_MM: f64 = 0.3;
/// Thickness of the slab (mm).
const SLAB_MM: f64 = 46.0;
/// Borders (mm) of the rings around a grain whose contrast is compared.
const RINGS_MM: [f64; 8] = [0.0, 0.08, 0.15, 0.22, 0.3, 0.4, 0.55, 0.75];
/// The ring that they are compared with (mm).
const AROUND_MM: [f64; 2] = [1.0, 1.8];

/// A picture of the test object but for what the image chain does.
#[derive(Debug, Clone)]
pub struct Grains {
    /// Transmission of one energy and of the tube's spectrum.
    passed: [Radiograph; 2],
    /// Middles of the shadows (mm).
    middles: Vec<[f64; 2]>,
}

impl Grains {
    /// The object shifted by a part of a pixel, its grains split so many times.
    ///
    /// # Errors
    /// None with the tables of this program.
    pub fn new(shift_mm: [f64; 2], splits: usize) -> Result<Self, ChainError> {
        let beams = Beams::new()?;
        let pixel_mm = 0.1;
        let geometry = Geometry { columns: 220, rows: 220, ..Geometry::pristina(pixel_mm) };
        let ball = sphere(splits);
        let volume = std::f64::consts::PI / 6.0 * DIAMETER_MM.powi(3);
        let scale = (volume / ball.volume_mm3()).cbrt();
        let grain = |n: usize| {
            let place = |n: usize, shift: f64| PITCH_MM * (n as f64 - 2.0) + shift;
            let x = place(n % SIDE, shift_mm[0]) + 0.037 * (n / SIDE) as f64;
            let y = 10.6 + place(n / SIDE, shift_mm[1]) + 0.041 * (n % SIDE) as f64;
            let center = Vec3::new(x, y, 0.5 * SLAB_MM);
            let points = ball.points.iter().map(|p| center + scale * p).collect();
            let surface = TriMesh { points, triangles: ball.triangles.clone() };
            let site = Site { row: n / SIDE, column: n % SIDE, center };
            Calcification { site, diameter_mm: DIAMETER_MM, surface, around: None }
        };
        let phantom = Phantom {
            surface: cuboid([-60.0, -40.0, 0.0], [60.0, 60.0, SLAB_MM]),
            thickness_mm: SLAB_MM,
            tissue: Material::breast(0.2)?,
            inclusions: vec![],
            calcium: Material::calcification()?,
            calcifications: (0..SIDE * SIDE).map(grain).collect(),
        };
        let projection = project(&phantom, &geometry)?;
        let picture = |spectrum| {
            let unit =
                Unit { geometry: geometry.clone(), spectrum, ..Unit::pristina(pixel_mm, 24.0) };
            transmission(&phantom, &projection, &unit)
        };
        let passed = [picture(beams.mono)?, picture(beams.tube)?];
        let middle = |c: &Calcification| geometry.shadow_mm(&c.site.center);
        Ok(Self { passed, middles: phantom.calcifications.iter().map(middle).collect() })
    }

    /// Mean counted quanta per pixel, so many in the middle of the slab.
    pub fn signal(&self, chain: &Chain, quanta: f64) -> Radiograph {
        let [mono, tube] = &self.passed;
        let share = chain.beam_spectrum as f32;
        let mix = |(a, b): (&f32, &f32)| (1.0 - share) * a + share * b;
        let mut pixels: Vec<f32> = mono.pixels.iter().zip(&tube.pixels).map(mix).collect();
        let level = pixels[0];
        // Scatter behind a slab adds a tenth of the primary, evenly, and takes contrast.
        let veil = 0.1 * chain.scatter as f32 * level;
        let scale = quanta as f32 / (level + veil);
        pixels.iter_mut().for_each(|pixel| *pixel = scale * (*pixel + veil));
        let sharp = Radiograph { pixels, ..mono.clone() };
        match Detector::essential().scintillator {
            Some(light) => light.blurred(chain.blur).spread(sharp.pitch_mm).apply(&sharp),
            None => sharp,
        }
    }

    /// Contrast in each ring, mean over the grains.
    pub fn contrast(&self, picture: &Radiograph) -> Vec<f64> {
        let mut sums = vec![(0.0, 0.0); RINGS_MM.len() - 1];
        for &middle in &self.middles {
            let near = pixels_around(picture, middle);
            let around: Vec<f64> = near
                .iter()
                .filter(|(r, _)| (AROUND_MM[0]..AROUND_MM[1]).contains(r))
                .map(|(_, value)| *value)
                .collect();
            let level = around.iter().sum::<f64>() / around.len() as f64;
            for (r, value) in near {
                let ring = RINGS_MM.partition_point(|&border| border <= r) - 1;
                if let Some((sum, count)) = sums.get_mut(ring) {
                    *sum += 1.0 - value / level;
                    *count += 1.0;
                }
            }
        }
        sums.iter().map(|(sum, count)| sum / f64::max(*count, 1.0)).collect()
    }

    /// Variance of each of them, with so many quanta per pixel.
    pub fn variance(&self, quanta: f64) -> Vec<f64> {
        let mut counts = [0.0; RINGS_MM.len() - 1];
        let mut around = 0.0;
        for &middle in &self.middles {
            for (r, _) in pixels_around(&self.passed[0], middle) {
                let ring = RINGS_MM.partition_point(|&border| border <= r) - 1;
                counts.get_mut(ring).into_iter().for_each(|count| *count += 1.0);
                around += f64::from(u8::from((AROUND_MM[0]..AROUND_MM[1]).contains(&r)));
            }
        }
        counts.map(|count: f64| (1.0 / count.max(1.0) + 1.0 / around) / quanta).to_vec()
    }

    /// One noisy measurement of the contrasts.
    pub fn measured(&self, chain: &Chain, quanta: f64, seed: u64) -> Vec<f64> {
        self.contrast(&draw(&self.signal(chain, quanta), seed))
    }
}

/// Distance (mm) from a place, and value, of the pixels around it.
fn pixels_around(picture: &Radiograph, [x, y]: [f64; 2]) -> Vec<(f64, f64)> {
    let range = |at: f64, first: f64, count: usize| {
        let middle = (at - first) / picture.pitch_mm;
        let reach = AROUND_MM[1] / picture.pitch_mm;
        (middle - reach).max(0.0) as usize..((middle + reach) as usize + 1).min(count)
    };
    let columns = range(x, picture.left_mm, picture.columns);
    range(y, picture.first_row_mm, picture.rows)
        .flat_map(|row| columns.clone().map(move |column| (row, column)))
        .map(|(row, column)| {
            let dx = picture.left_mm + column as f64 * picture.pitch_mm - x;
            let dy = picture.first_row_mm + row as f64 * picture.pitch_mm - y;
            (dx.hypot(dy), f64::from(picture.at(row, column)))
        })
        .collect()
}
