//! The way of photons.

use crate::xray::transport::{
    grid::Grid,
    media::{At, CUTOFF_KEV, Event, MAX_MEDIA},
    scene::{Body, Place, Scene},
    source::{Emitter, Source, SourceError},
    tally::{Batch, Receptor, Scoring, Tally},
};
use mammotwin_data::Vec3;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, Exp1};
use rayon::prelude::*;
use std::f64::consts::TAU;

/// Batches of a run: errors come from their spread, 5 % sure of themselves.
const BATCHES: u64 = 200;

/// How many photons.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Histories {
    /// Photons to emit; rounded up to a multiple of 200.
    pub photons: u64,
    /// Seed. Each batch has its own stream of it, so that neither their number at a time nor
    /// their order matters.
    pub seed: u64,
}

/// Follows photons from a source through a scene until they are absorbed, caught or lost.
///
/// In boxes of one material flights are drawn from its attenuation. In the body they are drawn
/// from the largest attenuation of its materials, and a collision is real with the share of the
/// material that is there (Woodcock 1965). Energies absorbed in scoring boxes are estimated at
/// every such collision, real or not, as E µ_tr / µ_max; all others where photons lose energy.
pub fn transport<B: Body>(
    scene: &Scene<B>,
    source: &Source,
    scoring: &Scoring,
    grid: Option<&Grid>,
    histories: Histories,
) -> Result<Tally, SourceError> {
    source.check()?;
    let emitter = Emitter::of(source);
    let each = histories.photons.div_ceil(BATCHES).max(1);
    let media = scene.media.materials().len();
    let batches: Vec<Batch> = (0..BATCHES)
        .into_par_iter()
        .map(|number| {
            let mut random = ChaCha8Rng::seed_from_u64(histories.seed);
            random.set_stream(number);
            let mut batch = Batch::new(each, media, scoring, grid.is_some());
            let run = Run { scene, scoring, grid };
            for _ in 0..each {
                let (direction, energy_kev) = emitter.draw(&mut random);
                let photon = Photon {
                    at: source.position,
                    direction,
                    energy_kev,
                    scattered: false,
                    entered: false,
                };
                batch.emitted += energy_kev;
                run.follow(photon, &mut random, &mut batch);
            }
            batch
        })
        .collect();
    Ok(Tally::of(&batches))
}

#[derive(Debug, Clone, Copy)]
struct Photon {
    at: Vec3,
    direction: Vec3,
    energy_kev: f64,
    scattered: bool,
    entered: bool,
}

struct Run<'a, B> {
    scene: &'a Scene<B>,
    scoring: &'a Scoring,
    grid: Option<&'a Grid>,
}

impl<B: Body> Run<'_, B> {
    fn follow(&self, mut photon: Photon, random: &mut ChaCha8Rng, batch: &mut Batch) {
        let Scene { media, air, .. } = self.scene;
        // After a scatter the direction and the coefficients are others.
        loop {
            let inverse = photon.direction.map(|d| 1.0 / d);
            let at = media.at(photon.energy_kev);
            let (medium, in_body) = loop {
                let ahead = self.scene.ahead(&photon.at, &inverse);
                if ahead.entry > 0.0 {
                    let caught = self.caught(&photon, &inverse);
                    let stop = caught.map_or(f64::INFINITY, |c| c.0);
                    let open = ahead.entry.min(stop);
                    if collides(&mut photon, media.total(at, *air), open, random) {
                        break (*air, false);
                    }
                    if let Some((_, cell)) = caught.filter(|_| stop <= ahead.entry) {
                        self.catch(&photon, cell, batch);
                        return;
                    }
                }
                let length = ahead.exit - ahead.entry.max(0.0);
                match ahead.place {
                    None => {
                        batch.lost += photon.energy_kev;
                        return;
                    }
                    Some(Place::Block(medium)) => {
                        if collides(&mut photon, media.total(at, medium), length, random) {
                            break (medium, false);
                        }
                    }
                    Some(Place::Body) => {
                        let met = self.search(&mut photon, at, length, random, batch);
                        if let Some(medium) = met {
                            break (medium, true);
                        }
                    }
                }
            };
            let before = photon.energy_kev;
            let event = media.event(at, medium, random.random());
            let angles = media.angles(medium);
            let cosine = match event {
                Event::Photoelectric => 0.0,
                Event::Coherent => angles.coherent(before, random),
                Event::Incoherent => {
                    let (cosine, after) = angles.incoherent(before, random);
                    photon.energy_kev = after;
                    cosine
                }
            };
            let ends = event == Event::Photoelectric || photon.energy_kev < CUTOFF_KEV;
            let given = if ends { before } else { before - photon.energy_kev };
            if given > 0.0 {
                if in_body {
                    batch.body[medium] += given;
                    if photon.at.y >= self.scoring.from_y_mm {
                        batch.gland += given * media.gland(at, medium);
                    }
                } else {
                    batch.elsewhere += given;
                }
            }
            if ends {
                return;
            }
            photon.direction = turned(&photon.direction, cosine, random);
            photon.scattered = true;
        }
    }

    /// Distance (mm) to the receptor and its cell, if the photon flies towards it.
    #[inline]
    fn caught(&self, photon: &Photon, inverse: &Vec3) -> Option<(f64, usize)> {
        let receptor: &Receptor = self.scoring.receptor.as_ref()?;
        let distance = (receptor.z - photon.at.z) * inverse.z;
        if !(distance > 0.0) {
            return None;
        }
        let at = photon.at + distance * photon.direction;
        Some((distance, receptor.cell(at.x, at.y)?))
    }

    fn catch(&self, photon: &Photon, cell: usize, batch: &mut Batch) {
        let energy = photon.energy_kev;
        let bare = if photon.scattered { &mut batch.scatter } else { &mut batch.primary };
        bare[cell] += energy;
        if let Some(grid) = self.grid {
            let passed = energy * grid.transmission(&photon.at, &photon.direction, energy);
            let behind = if photon.scattered {
                &mut batch.scatter_behind
            } else {
                &mut batch.primary_behind
            };
            behind[cell] += passed;
        }
    }

    /// Flies through the box of the body, at most a length (mm): the material of the collision.
    #[inline]
    fn search(
        &self,
        photon: &mut Photon,
        at: At,
        length: f64,
        random: &mut ChaCha8Rng,
        batch: &mut Batch,
    ) -> Option<usize> {
        let Scene { media, body, air, .. } = self.scene;
        let mut totals = [0.0; MAX_MEDIA];
        let mut largest = 0.0;
        for &medium in body.media() {
            totals[medium] = media.total(at, medium);
            largest = f64::max(largest, totals[medium]);
        }
        let (start, mut flown) = (photon.at, 0.0);
        loop {
            let step: f64 = Exp1.sample(random);
            flown += step / largest;
            if flown >= length {
                photon.at = start + length * photon.direction;
                return None;
            }
            photon.at = start + flown * photon.direction;
            let medium = body.medium(&photon.at);
            if medium != *air && !photon.entered {
                photon.entered = true;
                batch.entered += 1;
            }
            for (bounds, sum) in self.scoring.boxes.iter().zip(&mut batch.boxes) {
                if bounds.contains(&photon.at) {
                    *sum += photon.energy_kev * media.transfer(at, medium) / largest;
                }
            }
            if random.random::<f64>() * largest < totals[medium] {
                return Some(medium);
            }
            if medium == *air {
                // Nothing but air around: one flight through it instead of many steps.
                let clear = body.clear_mm(&photon.at).min(length - flown);
                if clear * largest > 1.0 {
                    let depth: f64 = Exp1.sample(random);
                    let free = depth / totals[*air];
                    flown += free.min(clear);
                    photon.at = start + flown * photon.direction;
                    if free < clear {
                        return Some(*air);
                    }
                }
            }
        }
    }
}

/// Flies through one material, at most a length (mm); whether it ends in a collision.
#[inline]
fn collides(photon: &mut Photon, mu: f64, length: f64, random: &mut ChaCha8Rng) -> bool {
    let depth: f64 = Exp1.sample(random);
    let free = depth / mu;
    photon.at += free.min(length) * photon.direction;
    free < length
}

/// A direction at an angle to another, turned at random about it.
#[inline]
fn turned(direction: &Vec3, cosine: f64, random: &mut ChaCha8Rng) -> Vec3 {
    let sine = (1.0 - cosine * cosine).max(0.0).sqrt();
    let (s, c) = (TAU * random.random::<f64>()).sin_cos();
    // Frisvad's frame: no square root, fails only at the lower pole.
    let d = direction;
    let (a, b) = if d.z < -0.999_999 {
        (Vec3::new(0.0, -1.0, 0.0), Vec3::new(-1.0, 0.0, 0.0))
    } else {
        let scale = 1.0 / (1.0 + d.z);
        let cross = -d.x * d.y * scale;
        (
            Vec3::new(1.0 - d.x * d.x * scale, cross, -d.x),
            Vec3::new(cross, 1.0 - d.y * d.y * scale, -d.y),
        )
    };
    (cosine * d + sine * (c * a + s * b)).normalize()
}
