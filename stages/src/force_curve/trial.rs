//! A digital volunteer in the unit: a body whose truth is known, pressed on several meshes, and records of it
//! with drawn errors.

use super::{
    course::Pressed,
    evidence::{Evidence, Ladder, rungs},
    library::CurveEffect,
    record::{Channel, Reading, Record, RecordError},
};
use crate::{
    compress::{Compress, Compression, Start},
    volunteer::{PoseName, Preset, Torso, mechanics::TruthBody, model_plan},
};
use mammotwin_data::{
    Failure, Vec3,
    labels::Side,
    mesh::TetMesh,
    progress::Silent,
    solution::Solution,
    study::{
        CompressLaw, CompressPlan, EDGE_RADIUS_MM, Elements, LawConstants, LawName, MeshPlan,
        ModelPlan, PaddleName, ReceptorName, StopPlan, View,
    },
};
use mammotwin_solver::{Options, mesh::lattice::Placement, solve};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// A person: one of the digital volunteers, all of whose tissues are stiffer by a factor.
///
/// Forces of the volunteers are a tenth of measured ones; with a tenth of the force no effect would be
/// above the error of the unit's force.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Person {
    /// Kind of volunteer.
    pub preset: String,
    /// Which person of that kind.
    pub seed: u64,
    /// Factor of all moduli.
    pub stiffer: f64,
}

/// Edges (mm) of a mesh, and which lattice it is cut from.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Meshed {
    /// Edge length (mm).
    pub size_mm: f64,
    /// Lattice.
    pub placement: Placement,
}

/// Lattices that share no node: of the model, of other meshes, of the truth.
const LATTICES: [[[f64; 3]; 2]; 7] = [
    [[0.11, 0.17, 0.07], [0.13, 0.29, 0.41]],
    [[0.35, -0.21, 0.14], [0.61, 0.17, 0.83]],
    [[-0.27, 0.44, -0.33], [0.37, 0.73, 0.11]],
    [[0.58, 0.09, -0.41], [0.91, 0.47, 0.29]],
    [[-0.13, -0.38, 0.52], [0.23, 0.07, 0.67]],
    [[0.21, 0.63, 0.29], [0.53, 0.87, 0.05]],
    [[-0.52, 0.31, 0.77], [0.71, 0.05, 0.57]],
];

impl Meshed {
    /// A mesh of one of the lattices.
    pub fn new(size_mm: f64, lattice: usize) -> Self {
        let [rotation, offset] = LATTICES[lattice % LATTICES.len()];
        Self { size_mm, placement: Placement { rotation, offset } }
    }

    /// The model's own mesh, five others by which its error is judged, and the truth's, which is none of them.
    pub fn set(size_mm: f64) -> (Self, Vec<Self>, Self) {
        let other = |(n, part): (usize, f64)| Self::new(part * size_mm, n + 1);
        let others = [0.8, 0.87, 0.93, 1.05, 1.15].into_iter().enumerate().map(other);
        (Self::new(size_mm, 0), others.collect(), Self::new(0.7 * size_mm, 6))
    }
}

/// A meshed person, ready for the unit.
pub struct Ready {
    body: TruthBody,
    model: ModelPlan,
    /// Tip of the right breast (mm), stress-free, and the way out of the body there.
    tip: [Vec3; 2],
}

impl Person {
    /// Meshes her.
    ///
    /// # Errors
    /// No such volunteer, no mesh, or no equilibrium.
    pub fn meshed(&self, mesh: Meshed) -> Result<Ready, Failure> {
        let mut person = Preset::named(&self.preset)?.person(self.seed);
        let moduli = &mut person.stiffness;
        for modulus in [
            &mut moduli.breast_right_kpa,
            &mut moduli.breast_left_kpa,
            &mut moduli.skin_kpa,
            &mut moduli.fascia_kpa,
            &mut person.fixed.ligaments_kpa,
        ] {
            *modulus *= self.stiffer;
        }
        let torso = Torso::new(person, self.seed);
        let meshing = MeshPlan { size_mm: mesh.size_mm, elements: Elements::Linear };
        let body = TruthBody::on_lattice(&torso, meshing, mesh.placement, &Silent)?;
        let tip = [torso.breasts[0].apex, torso.breasts[0].outward];
        Ok(Ready { body, model: model_plan(&torso.person), tip })
    }

    /// Her compression: cranio-caudal, rigid paddle, Gent tissue.
    ///
    /// # Errors
    /// No such volunteer.
    pub fn plan(&self, distance_mm: f64, thickness_mm: f64) -> Result<CompressPlan, Failure> {
        let preset = Preset::named(&self.preset)?;
        Ok(CompressPlan {
            side: Side::Right,
            view: View::Cc,
            view_angle_deg: None,
            receptor_lift_mm: 0.0,
            start_pose: None,
            prestress: false,
            paddle: PaddleName::Rigid,
            receptor: ReceptorName::Nipple,
            hinge: None,
            plate: None,
            curve: None,
            gimbal: None,
            outline: None,
            spot: None,
            biopsy: None,
            cushion: None,
            cad: None,
            edge_radius_mm: EDGE_RADIUS_MM,
            chest_wall_distance_mm: distance_mm,
            clamp: None,
            stop: StopPlan {
                thickness_mm: Some(thickness_mm),
                // What no unit reaches; tissue that locks would be pressed for long.
                force_n: Some(LARGEST_N),
                ..StopPlan::default()
            },
            law: CompressLaw {
                name: LawName::Gent,
                jm: Some(preset.compression.jm),
                constants: LawConstants::default(),
                poisson: 0.499,
            },
            friction: 0.0,
            gravity_share: 0.0,
            rate_stiffening: 0.0,
        })
    }
}

/// Largest force (N) of a compression of the model.
pub const LARGEST_N: f64 = 400.0;

impl Ready {
    /// Her stress-free mesh.
    pub fn mesh(&self) -> &TetMesh {
        &self.body.mesh
    }

    /// A place (mm) so deep (mm) under the tip of her right breast, in the stress-free shape.
    pub fn tip(&self, depth_mm: f64) -> Vec3 {
        self.tip[0] - depth_mm * self.tip[1]
    }

    /// She lies or stands.
    ///
    /// # Errors
    /// No equilibrium.
    pub fn posed(&self, pose: PoseName) -> Result<Solution, Failure> {
        self.body.deform(pose, &Silent)
    }

    /// Presses her.
    ///
    /// # Errors
    /// As [`Compress::press`].
    pub fn press(&self, plan: &CompressPlan) -> Result<Pressed, Failure> {
        Ok(Pressed::of(&self.compressed(plan)?))
    }

    /// The same, with all that a compression has.
    ///
    /// # Errors
    /// As [`Compress::press`].
    pub fn compressed(&self, plan: &CompressPlan) -> Result<Compression, Failure> {
        let compress = Compress { model: self.model.clone(), plan: plan.clone() };
        let (body, start) = (self.body.body(&self.model), Start::free(&self.body.mesh.points));
        compress.press(&body, &start, self.body.moduli(), None, &Silent)
    }

    /// Presses her from where she hangs, by the unit vector of gravity: with its stress and weight, or
    /// as if that shape were free of them, as `plan.prestress` says.
    ///
    /// # Errors
    /// No equilibrium, or as [`Compress::press`].
    pub fn hanging(&self, plan: &CompressPlan, gravity: Vec3) -> Result<Compression, Failure> {
        let compress = Compress { model: self.model.clone(), plan: plan.clone() };
        let (body, rest) = (self.body.body(&self.model), &self.body.mesh.points);
        let moduli = self.body.moduli();
        let model = body.model(rest, moduli, gravity, None)?;
        let hangs = solve(&model, rest, &Options::default(), &Silent)
            .map_err(|cause| Failure::Numerics(format!("hanging: {cause}")))?;
        let start = match plan.prestress {
            true => Start { rest, hanging: Some((&hangs.points, gravity)) },
            false => Start::free(&hangs.points),
        };
        compress.press(&body, &start, moduli, None, &Silent)
    }
}

/// One compression that the evidence needs.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Way {
    /// What files call it.
    pub label: String,
    /// On which mesh.
    pub mesh: Meshed,
    /// How.
    pub plan: CompressPlan,
}

/// The compressions of the evidence: the study's own, each effect's ladder, other meshes.
pub fn ways(
    plan: &CompressPlan,
    effects: &[&'static CurveEffect],
    mesh: Meshed,
    others: &[Meshed],
) -> Vec<Way> {
    let mut all = vec![Way { label: "plain".into(), mesh, plan: plan.clone() }];
    for (effect, amplitude) in switched(plan, effects) {
        let label = format!("{}_{amplitude:.3}", effect.name);
        all.push(Way { label, mesh, plan: effect.switched(plan, amplitude) });
    }
    for (n, other) in others.iter().enumerate() {
        all.push(Way { label: format!("mesh_{}", n + 1), mesh: *other, plan: plan.clone() });
    }
    all
}

/// Effects that a compression can have, with the amplitudes of their ladders.
pub fn switched(
    plan: &CompressPlan,
    effects: &[&'static CurveEffect],
) -> Vec<(&'static CurveEffect, f64)> {
    let of = |effect: &&'static CurveEffect| {
        let effect = *effect;
        let amplitudes = (effect.range)(plan).map(rungs).unwrap_or_default();
        amplitudes.into_iter().map(move |amplitude| (effect, amplitude))
    };
    effects.iter().flat_map(of).collect()
}

/// The evidence of what was pressed, in the order of [`ways`]; `None` for a way that could not be gone.
///
/// # Errors
/// [`Failure::Numerics`] when the study itself could not be pressed so far.
pub fn gathered(
    plan: &CompressPlan,
    effects: &[&'static CurveEffect],
    pressed: Vec<Option<Pressed>>,
    thinnest_mm: f64,
    error: RecordError,
) -> Result<Evidence, Failure> {
    let mut pressed = pressed.into_iter();
    let plain = pressed.next().flatten().filter(|p| p.thinnest_mm() <= thinnest_mm + 1e-6);
    let Some(plain) = plain else {
        return Err(Failure::Numerics(format!(
            "the compression of the study does not reach {thinnest_mm} mm, or leaps to another equilibrium before"
        )));
    };
    let rungs = switched(plan, effects);
    let mut solved: Vec<_> = rungs.into_iter().zip(&mut pressed).collect();
    let others = pressed.flatten().filter(|p| p.thinnest_mm() <= thinnest_mm + 1e-6).collect();
    let mut ladders = Vec::new();
    for &effect in effects.iter().filter(|effect| (effect.range)(plan).is_some()) {
        let own = solved.iter_mut().filter(|((e, _), _)| e.name == effect.name);
        let own = own.filter_map(|((_, amplitude), course)| Some((*amplitude, course.take()?)));
        ladders.push(Ladder::new(effect, &plain, own, thinnest_mm));
    }
    Ok(Evidence { plain, ladders, others, error })
}

/// What is told of each way that is done.
pub type Keep<'a> = dyn Fn(&Way, &Option<Pressed>) -> Result<(), Failure> + Sync + 'a;

/// Presses all ways of a person that may still begin; meshes each mesh once. `kept` is told of each way that is
/// done, not of those that did not begin.
///
/// # Errors
/// No such volunteer, no mesh, or what `kept` says; a way without equilibrium, or that did not begin, is `None`.
pub fn press_all(
    person: &Person,
    ways: &[Way],
    begins: &(dyn Fn() -> bool + Sync),
    kept: &Keep<'_>,
) -> Result<Vec<Option<Pressed>>, Failure> {
    let mut meshes: Vec<Meshed> = Vec::new();
    for way in ways {
        if !meshes.contains(&way.mesh) {
            meshes.push(way.mesh);
        }
    }
    let ready: Result<Vec<Ready>, Failure> = meshes.par_iter().map(|m| person.meshed(*m)).collect();
    let ready = ready?;
    let one = |way: &Way| {
        let Some(n) = meshes.iter().position(|m| *m == way.mesh) else { return Ok(None) };
        if !begins() {
            return Ok(None);
        }
        let pressed = match ready[n].press(&way.plan) {
            Ok(course) => Some(course),
            Err(Failure::Numerics(_) | Failure::BadInput(_)) => None,
            Err(other) => return Err(other),
        };
        kept(way, &pressed)?;
        Ok(pressed)
    };
    ways.par_iter().with_max_len(1).map(one).collect()
}

/// How a truth is measured.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Measuring {
    /// Times the errors of a force, an area, an extent, a tilt.
    pub noise: f64,
    /// Offset of the thickness (mm) beyond its error.
    pub offset_mm: f64,
    /// Factor of all forces beyond its error.
    pub gain: f64,
}

impl Measuring {
    /// Errors of the sizes of the budget.
    pub const USUAL: Self = Self { noise: 1.0, offset_mm: 0.0, gain: 1.0 };
}

/// How much stiffer a person's tissue is than her calibration says, drawn.
pub fn drawn_stiffness(error: &RecordError, seed: u64) -> f64 {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let normal: f64 = StandardNormal.sample(&mut random);
    (error.stiffness * normal).exp()
}

/// A record of a pressed truth at so many thicknesses down to one, with drawn errors, of tissue stiffer by a
/// factor; and the factor of all its forces, the drawn gain included.
pub fn measured(
    truth: &Pressed,
    (points, thickest_mm, thinnest_mm): (usize, f64, f64),
    error: &RecordError,
    how: Measuring,
    (stiffness, seed): (f64, u64),
) -> (Record, f64) {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut normal = || -> f64 { StandardNormal.sample(&mut random) };
    let offset = error.thickness_mm * normal() + how.offset_mm;
    let gain = (error.gain * normal()).exp() * how.gain;
    let mut readings = Vec::new();
    for n in 0..points {
        let part = n as f64 / (points - 1).max(1) as f64;
        let thickness_mm = thickest_mm + part * (thinnest_mm - thickest_mm);
        let last = n + 1 == points;
        for channel in Channel::ALL {
            // One picture, at the end.
            if matches!(channel, Channel::Area | Channel::Extent) && !last {
                continue;
            }
            let mut value = truth.at(channel, thickness_mm + offset);
            if channel == Channel::Force {
                value *= stiffness * gain;
            }
            value += how.noise * error.of(channel, value) * normal();
            readings.push(Reading { thickness_mm, channel, value });
        }
    }
    (Record::new(readings), stiffness * gain)
}
