//! The search box: does every set of tissues that a calibration may meet end in equilibrium?
//!
//! Runs are drawn by a Latin hypercube (McKay, Beckman & Conover, *Technometrics* 21 (1979) 239,
//! <https://doi.org/10.1080/00401706.1979.10489755>) from the intervals of Mîra (2018), table 3.2,
//! and somewhat beyond: each number has every one of its strata once. Shapes, poses and chest walls
//! come in all combinations, equally often.

use crate::{
    model::{Body, Moduli, Muscle},
    volunteer::{PoseName, Preset, Torso, mechanics::TruthBody, model_plan},
};
use mammotwin_data::{
    Failure, Vec3,
    mesh::TetMesh,
    progress::Silent,
    solution::{Checks, Solution},
    study::{Elements, InterfaceKind, InterfacePlan, LawName, MeshPlan, ModelPlan},
    units::WEIGHT_OF_G_PER_CM3,
};
use mammotwin_solver::{
    Options, SolveError,
    materials::{InvariantEnergy, Law},
    mesh::quality::quality,
    solve::{follow, solve},
    terms::Load,
};
use rand::{Rng, SeedableRng, seq::SliceRandom};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

/// Volunteers whose shapes are used, and the seed that makes them.
pub const SHAPES: [&str; 2] = ["tiny", "large"];
const PERSON: u64 = 1;
/// Weight of the breast over its shear modulus, ρ g H / μ, beyond which it need not stand.
pub const STANDS_TO: f64 = 7.0;
/// What a solution has to keep.
pub const RESIDUAL: f64 = 1e-6;
/// Largest sum of all forces over the largest, and of moments over the most of a term.
pub const IMBALANCE: f64 = 1e-3;
/// Largest gap or penetration (mm).
pub const OPEN_MM: f64 = 0.05;
/// Largest difference of the volume (part of the whole) to that of the law under the same stress.
pub const VOLUME: f64 = 1e-3;
/// Largest difference of two ways to load, over the largest displacement.
pub const PATHS: f64 = 1e-3;
/// Beyond this skewness a deformed tetrahedron is said to be stretched beyond the mesh's quality.
pub const SKEWNESS: f64 = 0.95;
/// Below this part of 1 a Gent law has no limit.
const NO_LIMIT: f64 = 0.02;

/// What the breast does on the chest wall.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Wall {
    /// Glued to the muscle.
    Bonded,
    /// Slides without friction, never lifting off.
    Sliding,
    /// Slides against friction of 0.1, never lifting off.
    Rubbing,
    /// Glued to a muscle that gives way.
    OnMuscle,
    /// Slides without friction on a muscle that gives way, never lifting off.
    SlidingOnMuscle,
}

impl Wall {
    /// All of them.
    pub const ALL: [Self; 5] =
        [Self::Bonded, Self::Sliding, Self::Rubbing, Self::OnMuscle, Self::SlidingOnMuscle];

    /// Word in tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Bonded => "bonded",
            Self::Sliding => "sliding",
            Self::Rubbing => "friction 0.1",
            Self::OnMuscle => "bonded to soft muscle",
            Self::SlidingOnMuscle => "sliding on soft muscle",
        }
    }

    fn plan(self) -> InterfacePlan {
        match self {
            Self::Bonded | Self::OnMuscle => InterfacePlan::uniform(InterfaceKind::Bonded, None),
            Self::Sliding | Self::SlidingOnMuscle => {
                InterfacePlan::uniform(InterfaceKind::NoSeparation, Some(0.0))
            }
            Self::Rubbing => InterfacePlan::uniform(InterfaceKind::NoSeparation, Some(0.1)),
        }
    }

    fn gives_way(self) -> bool {
        matches!(self, Self::OnMuscle | Self::SlidingOnMuscle)
    }
}

/// One run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Case {
    /// Of [`SHAPES`].
    pub shape: usize,
    /// Of [`PoseName::ALL`].
    pub pose: usize,
    /// Chest wall.
    pub wall: Wall,
    /// Young's modulus of both breasts (kPa).
    pub breast_kpa: f64,
    /// Young's modulus of the skin (kPa).
    pub skin_kpa: f64,
    /// Young's modulus of the fascia (kPa).
    pub fascia_kpa: f64,
    /// Poisson's ratio of the breasts.
    pub poisson: f64,
    /// Jₘ of the breasts' Gent law; neo-Hookean without.
    pub jm: Option<f64>,
    /// Whether the load is also put on in three parts.
    pub stepped: bool,
}

impl Case {
    /// The pose.
    pub fn pose(&self) -> PoseName {
        PoseName::ALL[self.pose]
    }

    /// The law of the breasts.
    pub fn law(&self) -> LawName {
        if self.jm.is_some() { LawName::Gent } else { LawName::NeoHookean }
    }

    /// Weight of a column of this height (mm) over the shear modulus of the breast.
    fn weight(&self, height_mm: f64, density_g_per_cm3: f64) -> f64 {
        let shear_kpa = self.breast_kpa / (2.0 * (1.0 + self.poisson));
        density_g_per_cm3 * WEIGHT_OF_G_PER_CM3 * height_mm / shear_kpa
    }
}

/// The runs of a design; of so many of each combination, one is also loaded in parts (none for 0).
///
/// Moduli are even in their logarithms, Poisson's ratio in that of 1 - 2ν, Jₘ in 1/Jₘ.
pub fn design(runs: usize, stepped_every: usize, seed: u64) -> Vec<Case> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut stratum = || {
        let mut all: Vec<usize> = (0..runs).collect();
        all.shuffle(&mut random);
        all.into_iter()
            .map(|n| (n as f64 + random.random_range(0.0..1.0)) / runs as f64)
            .collect::<Vec<f64>>()
    };
    let [breast, skin, fascia, poisson, limit] = std::array::from_fn(|_| stratum());
    let between = |part: f64, [low, high]: [f64; 2]| low * (high / low).powf(part);
    // Short in tables, and the same in and out of them.
    let digits = |value: f64| (1e4 * value).round() / 1e4;
    let case = |n: usize| {
        let (shape, rest) = (n % SHAPES.len(), n / SHAPES.len());
        let (pose, rest) = (rest % PoseName::ALL.len(), rest / PoseName::ALL.len());
        let (wall, turn) = (rest % Wall::ALL.len(), rest / Wall::ALL.len());
        Case {
            shape,
            pose,
            wall: Wall::ALL[wall],
            breast_kpa: digits(between(breast[n], [0.2, 4.0])),
            skin_kpa: digits(between(skin[n], [2.0, 20.0])),
            fascia_kpa: digits(between(fascia[n], [50.0, 250.0])),
            poisson: digits(0.5 * (1.0 - between(poisson[n], [0.1, 0.002]))),
            jm: (limit[n] >= NO_LIMIT).then(|| digits(1.0 / limit[n])),
            stepped: stepped_every > 0 && turn % stepped_every == 0,
        }
    };
    (0..runs).map(case).collect()
}

/// A shape, meshed at rest, with its supports.
pub struct Shape {
    body: TruthBody,
    muscled: Muscled,
    plan: ModelPlan,
    /// How far (mm) the breasts stand out from the muscle.
    pub height_mm: f64,
}

impl Shape {
    /// One of [`SHAPES`], on a mesh of this size (mm).
    ///
    /// # Errors
    /// No mesh of this size.
    pub fn new(shape: usize, size_mm: f64) -> Result<Self, Failure> {
        let torso = Torso::new(Preset::named(SHAPES[shape])?, PERSON);
        let meshing = MeshPlan { size_mm, elements: Elements::Linear };
        let body = TruthBody::new(&torso, meshing, &Silent)?;
        let muscled = Muscled::new(&torso, &body);
        let (plan, height_mm) = (model_plan(&torso.person), torso.person.breast.projection_mm);
        Ok(Self { body, muscled, plan, height_mm })
    }

    /// Number of tetrahedra.
    pub fn tets(&self) -> usize {
        self.body.mesh.tets.len()
    }
}

/// The same breast before a muscle that gives way, which is without stress where the breast is.
struct Muscled {
    /// Stress-free.
    rest: Vec<Vec3>,
    /// In the pose to which supports are tied.
    reference: TetMesh,
    muscle: Muscle,
}

impl Muscled {
    fn new(torso: &Torso, body: &TruthBody) -> Self {
        let mut rest = body.mesh.clone();
        let plan = model_plan(&torso.person);
        let (wall, breasts) = (body.body(&plan).wall, body.mesh.points.len());
        let muscle = Muscle::behind(&mut rest, &*wall, |p| torso.rib_cage(p));
        let mut reference = body.body(&plan).mesh.clone();
        reference.points.extend_from_slice(&rest.points[breasts..]);
        Self { rest: rest.points, reference, muscle }
    }
}

/// What a run found.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Found {
    /// ρ g H / μ with the height H of the breasts.
    pub weight: f64,
    /// The state at the end, or why there is none.
    pub end: Result<State, Stop>,
}

/// No equilibrium.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Stop {
    /// What the solver said.
    pub why: String,
    /// Part of the load that was carried.
    pub carried: f64,
    /// Whether the solver met nothing that stops the body: [`SolveError::NoStableState`].
    pub unstable: bool,
}

impl Found {
    /// Whether there is no equilibrium and need be none: the solver found no stable state, and the
    /// weight is more than the tissue carries.
    pub fn has_no_stable_state(&self) -> bool {
        self.end.as_ref().is_err_and(|stop| stop.unstable) && self.weight > STANDS_TO
    }
}

/// An equilibrium.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct State {
    /// What the solver checked.
    pub checks: Checks,
    /// Largest displacement (mm).
    pub moved_mm: f64,
    /// Change of the volume (part of the rest volume).
    pub swollen: f64,
    /// The same as the law has it under the mean stress of each element.
    pub swollen_by_law: f64,
    /// Largest skewness at rest and deformed.
    pub skewness: [f64; 2],
    /// Largest distance of a node when the load comes in three parts, over the largest
    /// displacement; `None` where it was not tried or found no end.
    pub apart: Option<f64>,
    /// Why the load in three parts found no end.
    pub apart_failed: Option<String>,
}

impl Found {
    /// What is wrong with the run; nothing for a sound equilibrium, and for the lack of one where none
    /// need be.
    pub fn faults(&self) -> Vec<String> {
        let state = match &self.end {
            Ok(state) => state,
            Err(_) if self.has_no_stable_state() => return Vec::new(),
            Err(stop) => return vec![stop.why.clone()],
        };
        let checks = &state.checks;
        let mut faults = Vec::new();
        let mut most = |what: &str, value: f64, limit: f64| {
            // The negation also finds a NaN.
            if !(value <= limit) {
                faults.push(format!("{what} {value:.2e} over {limit:.0e}"));
            }
        };
        most("residual", checks.residual, RESIDUAL);
        most("sum of forces", checks.force_imbalance, IMBALANCE);
        most("sum of moments", checks.moment_imbalance, IMBALANCE);
        most("gap (mm)", checks.max_gap_mm.max(checks.max_penetration_mm), OPEN_MM);
        most("volume", (state.swollen - state.swollen_by_law).abs(), VOLUME);
        if let Some(apart) = state.apart.filter(|apart| !(*apart <= PATHS)) {
            let apart_mm = apart * state.moved_mm;
            faults.push(format!(
                "in three parts {apart:.2e} over {PATHS:.0e}: {apart_mm:.3} mm of {:.1} mm",
                state.moved_mm
            ));
        }
        faults.extend(state.apart_failed.iter().map(|why| format!("in three parts: {why}")));
        faults
    }

    /// Whether elements of the equilibrium are beyond the mesh's quality.
    pub fn is_stretched(&self) -> bool {
        self.end.as_ref().is_ok_and(|state| state.skewness[1] > SKEWNESS)
    }
}

impl Case {
    /// Loads the shape at rest with gravity.
    ///
    /// # Errors
    /// A model that cannot be made; the lack of an equilibrium is none.
    pub fn run(&self, shape: &Shape) -> Result<Found, Failure> {
        let mut plan = shape.plan.clone();
        plan.breast.poisson = self.poisson;
        (plan.breast.law, plan.breast.jm) = (self.law(), self.jm);
        (plan.skin.young_kpa, plan.fascia.young_kpa) = (self.skin_kpa, self.fascia_kpa);
        plan.interface = self.wall.plan();
        let moduli = Moduli::new(self.breast_kpa, self.breast_kpa);
        plan.muscle.rigid = !self.wall.gives_way();
        let (mut body, mut rest) = (shape.body.body(&plan), &shape.body.mesh.points);
        if self.wall.gives_way() {
            let Muscled { rest: with_muscle, reference, muscle } = &shape.muscled;
            body = Body { mesh: reference, muscle: Some(muscle), ..body };
            rest = with_muscle;
        }
        let model = body.model(rest, moduli, self.pose().gravity(), None)?;
        let options = Options::default();
        let weight = self.weight(shape.height_mm, plan.density_g_per_cm3);
        let found = match solve(&model, rest, &options, &Silent) {
            Ok(found) => found,
            Err(error) => return Ok(Found { weight, end: Err(Stop::of(error)) }),
        };
        let mut state = self.state(&shape.body.mesh, &found)?;
        if self.stepped {
            let path = [1.0, 2.0, 3.0].map(|n| Load { gravity: n / 3.0, ..Load::GRAVITY });
            match follow(&model, rest, &path, &options) {
                Ok(way) => {
                    let there = way.last().map_or(&found.points, |last| &last.points);
                    state.apart = Some(largest(&found.points, there) / state.moved_mm);
                }
                Err(error) => state.apart_failed = Some(error.to_string()),
            }
        }
        Ok(Found { weight, end: Ok(state) })
    }

    fn state(&self, mesh: &TetMesh, found: &Solution) -> Result<State, Failure> {
        let law = Law::new(self.law(), self.breast_kpa, self.poisson, self.jm)
            .map_err(|cause| Failure::BadInput(format!("search box: {cause}")))?;
        let (mut rest, mut now, mut lawful) = (0.0, 0.0, 0.0);
        for (n, tet) in mesh.tets.iter().enumerate() {
            let volume = TetMesh::tet_volume(&mesh.points, tet);
            rest += volume;
            now += TetMesh::tet_volume(&found.points, tet);
            lawful += volume * volume_under(&law, found.cauchy_kpa[n].trace() / 3.0);
        }
        let skewness = [&mesh.points, &found.points]
            .map(|points| quality(points, &mesh.tets).summary.max_skewness);
        Ok(State {
            checks: found.checks,
            moved_mm: largest(&mesh.points, &found.points),
            swollen: now / rest - 1.0,
            swollen_by_law: lawful / rest - 1.0,
            skewness,
            apart: None,
            apart_failed: None,
        })
    }
}

impl Stop {
    fn of(error: SolveError) -> Self {
        let unstable = matches!(error, SolveError::NoStableState { .. });
        Self { why: error.to_string(), carried: error.load_fraction(), unstable }
    }
}

/// Largest distance (mm) of two shapes of a body.
fn largest(a: &[Vec3], b: &[Vec3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max)
}

/// Volume over rest volume at which a law has this mean stress (kPa), K θ θ'.
fn volume_under(law: &Law, stress_kpa: f64) -> f64 {
    let mut j = 1.0;
    for _ in 0..NEWTON {
        let theta = law.dilatation(j);
        let bulk = law.volumetric_kpa();
        let off = bulk * theta.value * theta.d1 - stress_kpa;
        let slope = bulk * (theta.d1 * theta.d1 + theta.value * theta.d2);
        j = f64::max(j - off / slope, 0.5 * j);
    }
    j
}

/// Newton steps for a volume; it converges in five.
const NEWTON: usize = 12;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_stratum_and_combination_is_drawn_equally_often() {
        let cases = design(160, 4, 1);
        assert_eq!(cases, design(160, 4, 1));
        assert_ne!(cases, design(160, 4, 2));
        let mut breast: Vec<f64> =
            cases.iter().map(|c| 160.0 * (c.breast_kpa / 0.2).ln() / 20f64.ln()).collect();
        breast.sort_by(f64::total_cmp);
        // Moduli are written with four digits.
        assert!(breast.iter().enumerate().all(|(n, b)| (b - n as f64 - 0.5).abs() < 0.52));
        let alike = |case: &Case| {
            let same = |c: &&Case| (c.shape, c.pose, c.wall) == (case.shape, case.pose, case.wall);
            cases.iter().filter(same).count()
        };
        assert!(cases.iter().all(|case| alike(case) == 4));
        assert!(cases.iter().all(|c| (0.45..=0.499).contains(&c.poisson)));
        assert!(cases.iter().all(|c| c.jm.is_none_or(|jm| (1.0..=50.0).contains(&jm))));
        assert!(cases.iter().any(|c| c.stepped) && cases.iter().any(|c| !c.stepped));
    }

    #[test]
    fn the_volume_of_a_law_is_that_of_its_mean_stress() {
        for (name, jm) in [(LawName::NeoHookean, None), (LawName::Gent, Some(2.0))] {
            let law = Law::new(name, 0.5, 0.45, jm).unwrap();
            for j in [0.8, 1.0, 1.3] {
                let theta = law.dilatation(j);
                let stress = law.volumetric_kpa() * theta.value * theta.d1;
                assert!((volume_under(&law, stress) - j).abs() < 1e-10);
            }
        }
    }

    #[test]
    fn a_run_that_need_not_stand_is_no_fault() {
        let stop = Stop { why: "an element".into(), carried: 0.5, unstable: true };
        let heavy = Found { weight: 8.0, end: Err(stop.clone()) };
        assert!(heavy.faults().is_empty() && heavy.has_no_stable_state());
        assert_eq!(Found { weight: 6.0, end: Err(stop.clone()) }.faults(), ["an element"]);
        // A heavy breast that fails for another reason is a fault.
        let torn = Found { weight: 8.0, end: Err(Stop { unstable: false, ..stop }) };
        assert_eq!(torn.faults(), ["an element"]);
    }
}
