//! A unit as it is measured: simulated more finely, with errors, and with an effect that the image model
//! lacks.

use super::{
    evidence::{Composition, Exposures, Object, Parameters, QUANTA, UNEVEN, UNEVEN_LENGTH_MM},
    field::{Body, ChainError, Field, Fineness},
    grains::Grains,
    library::{Chain, ImageEffect},
    search::Search,
};
use mammotwin_imaging::xray::{
    shapes::{Rounded, cuboid},
    transport::{
        photon::Histories,
        study::{Outline, Shield, StudyPlan, study},
    },
};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use std::f64::consts::TAU;

/// What is hidden in the measurement.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Hidden {
    /// Nothing.
    None,
    /// An effect of the library, at a usual size.
    Effect(&'static str),
    /// A gain that falls across the paddle, from right to left, by 3 % per 100 mm: no effect of the
    /// library.
    GainGradient,
}

impl Hidden {
    /// Of a word: `none`, `gain_gradient` or an effect.
    pub fn named(word: &str) -> Option<Self> {
        match word {
            "none" => Some(Self::None),
            "gain_gradient" => Some(Self::GainGradient),
            _ => ImageEffect::named(word).map(|effect| Self::Effect(effect.name)),
        }
    }

    /// The image chain of the truth; doses under a wedge come from Monte Carlo instead.
    fn chain(self) -> Chain {
        match self {
            Self::Effect("scatter") => Chain { scatter: 1.0, ..Chain::default() },
            Self::Effect("heel") => Chain { heel: 0.05, ..Chain::default() },
            Self::Effect("beam_spectrum") => Chain { beam_spectrum: 1.0, ..Chain::default() },
            Self::Effect("blur") => Chain { blur: 0.1, ..Chain::default() },
            _ => Chain::default(),
        }
    }
}

/// Loss of gain per 100 mm along x.
const GRADIENT: f64 = 0.03;
/// The person's gland beyond what the model takes (mass fraction).
const MORE_GLAND: f64 = 0.03;
/// Waves of an uneven gain.
const WAVES: usize = 64;

/// Half width and length (mm) of the breast.
const EXTENT_MM: [f64; 2] = [75.0, 90.0];

/// A breast under a paddle that sinks by 2 mm over its length.
fn breast(thickness_mm: f64, [around, up]: [u32; 2]) -> Body {
    let slope = 0.02;
    let shape = Rounded {
        extent_mm: EXTENT_MM,
        thickness_mm,
        top_mm: thickness_mm + 0.5 * slope * EXTENT_MM[1],
        slope,
        behind_mm: 1.45,
    };
    Body { surface: shape.surface(around, up), glandularity: 0.2 }
}

fn slab(thickness_mm: f64) -> Body {
    let surface = cuboid([-130.0, -40.0, 0.0], [130.0, 150.0, thickness_mm]);
    Body { surface, glandularity: 0.2 }
}

/// Thicknesses (mm) of breasts and slabs, and plans of doses, that are seen and held out.
const BREASTS_MM: [f64; 2] = [46.0, 38.0];
const SLABS_MM: [f64; 2] = [46.0, 35.0];
const DOSES: [(&[f64], f64); 2] = [(&[30.0, 45.0, 60.0], 6.0), (&[28.0, 38.0, 52.0], 6.0)];

/// Photons of each dose: 0.25 % of a ratio of two.
const DOSE_PHOTONS: u64 = 1_000_000;

/// Relative wedges of half cylinders of 80 mm under a tilted paddle.
fn wedges((thickness_mm, tilt_deg): (&[f64], f64)) -> Vec<f64> {
    thickness_mm.iter().map(|t| tilt_deg.to_radians().tan() * 80.0 / t).collect()
}

/// The image model of both sets.
///
/// # Errors
/// None with the tables of this program.
pub fn search(photons: u64) -> Result<Search, ChainError> {
    let set = |n: usize| -> Result<Exposures, ChainError> {
        let histories = Histories { photons, seed: 11 + n as u64 };
        let fineness = Fineness { pixel_mm: 0.5, histories, step_mm: 2.0, smooth_mm: 16.0 };
        let breast = Field::new(&breast(BREASTS_MM[n], [120, 24]), fineness, None)?;
        let slab = Field::new(&slab(SLABS_MM[n]), fineness, None)?;
        Exposures::new(vec![
            Object::Field(breast, Composition::Fitted),
            Object::Field(slab, Composition::Known),
            Object::Grains(Grains::new([0.0, 0.0], 3)?),
            Object::Doses(wedges(DOSES[n])),
        ])
    };
    Search::new(set(0)?, set(1)?)
}

/// The unit itself: other pixels, facets, distances, grains and photons than the image model's.
pub struct Truth {
    sets: [Set; 2],
}

/// One set of it: breast and slab, test object, doses by Monte Carlo.
struct Set {
    fields: [Field; 2],
    grains: Grains,
    /// Logarithms of doses under tilted paddles over those under flat ones.
    doses: Vec<f64>,
}

impl Truth {
    /// Computes the unit, and compares at the places of the model.
    ///
    /// # Errors
    /// None with the tables of this program.
    pub fn new(model: &Search, photons: u64) -> Result<Self, ChainError> {
        let set = |n: usize, of: &Exposures| -> Result<Set, ChainError> {
            let histories = Histories { photons, seed: 101 + n as u64 };
            let fineness = Fineness { pixel_mm: 0.2, histories, step_mm: 1.6, smooth_mm: 12.0 };
            let places = |k: usize| match &of.objects[k] {
                Object::Field(field, _) => field.centers.clone(),
                _ => Vec::new(),
            };
            let field = |body: &Body, k: usize| Field::new(body, fineness, Some(&places(k)));
            let (thickness_mm, tilt) = DOSES[n];
            let plan = StudyPlan {
                outlines: vec![Outline::HalfCylinder],
                shields: vec![Shield::Skin],
                thickness_mm: thickness_mm.to_vec(),
                tilt_deg: vec![0.0, tilt],
                glandularity: vec![0.2],
                histories: Histories { photons: DOSE_PHOTONS, ..histories },
            };
            let tilted = study(&plan, &|_| ())?.cases.into_iter().filter(|c| c.tilt_deg != 0.0);
            let shift = [0.043 - 0.06 * n as f64, 0.027];
            Ok(Set {
                fields: [
                    field(&breast(BREASTS_MM[n], [190, 37]), 0)?,
                    field(&slab(SLABS_MM[n]), 1)?,
                ],
                grains: Grains::new(shift, 4)?,
                doses: tilted.map(|case| case.tilted_over_flat.mean.ln()).collect(),
            })
        };
        Ok(Self { sets: [set(0, &model.seen)?, set(1, &model.held_out)?] })
    }

    /// One measurement of the seen and of the held-out set.
    ///
    /// # Errors
    /// None with the tables of this program.
    pub fn measure(&self, hidden: Hidden, seed: u64) -> Result<[Vec<Vec<f64>>; 2], ChainError> {
        let one =
            |n: usize| self.sets[n].measure(hidden, seed.wrapping_mul(2).wrapping_add(n as u64));
        Ok([one(0)?, one(1)?])
    }
}

impl Set {
    fn measure(&self, hidden: Hidden, seed: u64) -> Result<Vec<Vec<f64>>, ChainError> {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let chain = hidden.chain();
        let mut all = Vec::new();
        for (n, field) in self.fields.iter().enumerate() {
            let gland = if n == 0 { MORE_GLAND } else { 0.0 };
            let exposure: f64 = random.random_range(-0.2..0.2);
            let gain = Gain::draw(&mut random);
            let signal = field.signal(&chain, gland)?;
            let brightness = signal.iter().zip(&field.centers).map(|(signal, &at)| {
                let gradient =
                    if hidden == Hidden::GainGradient { GRADIENT * at[0] / 100.0 } else { 0.0 };
                // Quanta of 2500 pixels, about as many as behind the breast in each.
                let noise: f64 = StandardNormal.sample(&mut random);
                signal.ln() + exposure + gain.at(at) - gradient + noise / (2500.0 * QUANTA).sqrt()
            });
            all.push(brightness.collect());
        }
        all.push(self.grains.measured(&chain, QUANTA, seed));
        let wedged = hidden == Hidden::Effect("agd_wedge");
        let doses = self.doses.iter().map(|dose| {
            let noise: f64 = StandardNormal.sample(&mut random);
            0.002 * noise + if wedged { *dose } else { 0.0 }
        });
        all.push(doses.collect());
        Ok(all)
    }
}

/// An uneven gain of the detector: waves of random direction, length and phase.
struct Gain {
    size: f64,
    waves: Vec<[f64; 3]>,
}

impl Gain {
    /// Of 0.7 to 1.2 times the budget's size and 0.8 to 1.3 times its length.
    fn draw(random: &mut ChaCha8Rng) -> Self {
        let size = UNEVEN * random.random_range(0.7..1.2) * (2.0 / WAVES as f64).sqrt();
        let length = UNEVEN_LENGTH_MM * random.random_range(0.8..1.3);
        let mut wave = || {
            let [u, v]: [f64; 2] = [StandardNormal.sample(random), StandardNormal.sample(random)];
            [u / length, v / length, random.random_range(0.0..TAU)]
        };
        let waves = (0..WAVES).map(|_| wave()).collect();
        Self { size, waves }
    }

    fn at(&self, [x, y]: [f64; 2]) -> f64 {
        self.size
            * self.waves.iter().map(|[u, v, phase]| (u * x + v * y + phase).cos()).sum::<f64>()
    }
}

/// Residuals (relative) of one picture by cell: x, y, without and with an effect.
pub type Residuals = Vec<[f64; 4]>;

/// Residuals of the held-out breast, its exposure fitted, without and with a fitted effect.
///
/// # Errors
/// As [`Exposures::predicted`].
pub fn residuals(
    exposures: &Exposures,
    measured: &[Vec<f64>],
    [plain, with]: [&Parameters; 2],
) -> Result<Residuals, ChainError> {
    let Some(Object::Field(field, _)) = exposures.objects.first() else { return Ok(Vec::new()) };
    let of = |from: &Parameters| -> Result<Vec<f64>, ChainError> {
        let start = Parameters { scale: exposures.start().scale, ..from.clone() };
        let (fitted, ..) = exposures.fit(measured, &start, &exposures.scales())?;
        let predicted = exposures.predicted(0, &fitted)?;
        Ok(measured[0].iter().zip(predicted).map(|(m, p)| m - p).collect())
    };
    let (before, after) = (of(plain)?, of(with)?);
    let both = before.into_iter().zip(after).zip(&field.centers);
    Ok(both.map(|((b, a), at)| [at[0], at[1], b, a]).collect())
}
