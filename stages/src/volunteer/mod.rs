//! The digital volunteer: a synthetic subject whose truth is known.
//!
//! The truth is a stress-free torso ([`torso`]) in the person's body frame, which is the common
//! frame and the frame of the supine image. Per pose it is deformed by gravity, then by what
//! people add ([`motion`]): a smooth change of the chest wall, arms, and a rigid motion of the
//! table. Each image is taken in the frame of its pose. The tilted image is turned with the body,
//! as a scanner with oblique slices would take it, so that gravity points to the side in it.

pub(crate) mod carry;
mod field;
mod gland;
mod landmarks;
pub mod mechanics;
pub mod motion;
mod posed;
pub mod preset;
mod study;
#[cfg(test)]
mod tests;
mod thorax;
pub mod torso;
pub mod truth;

pub use motion::{Motion, PoseName};
pub use posed::PosedBody;
pub use preset::Preset;
pub use study::model_plan;
pub use torso::Torso;
pub use truth::Truth;

use mammotwin_data::{
    Failure, Vec3,
    io::{
        hdf5,
        landmarks::write_csv,
        nifti::{self, Version, VoxelType},
    },
    landmarks::Landmarks,
    progress::{Part, Progress},
    study::Elements,
    volume::Grid,
};
use mammotwin_imaging::mri::synthesize as mri;
use mechanics::TruthBody;
use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};
use truth::PoseTruth;

/// Which volunteer to make, and how finely.
#[derive(Debug, Clone)]
pub struct Settings {
    /// Kind of volunteer: `small`, `large`.
    pub preset: String,
    /// Which person of that kind.
    pub seed: u64,
    /// Edge of the voxels (mm); the preset's full grid when absent.
    pub voxel_mm: Option<[f64; 3]>,
    /// Poses to scan; supine is always among them.
    pub poses: Vec<PoseName>,
    /// Effects of the truth that the study does not have: amplitude by name.
    pub hidden: BTreeMap<String, f64>,
    /// Whether chest wall and arms stay as they are between the poses, as no person's do.
    pub still: bool,
    /// Elements that the study asks for; the preset's when absent.
    pub elements: Option<Elements>,
    /// Edges of the elements of the truth (mm); the preset's when absent.
    pub truth_mm: Option<f64>,
    /// Folder to write to; made when missing.
    pub out_dir: PathBuf,
}

impl Settings {
    /// The volunteer of the demonstration: supine, prone and tilted; small on voxels of 1 mm, any
    /// other preset on its own.
    pub fn demo(preset: &str, out_dir: &Path) -> Self {
        Self {
            preset: preset.into(),
            seed: 7,
            voxel_mm: (preset == "small").then_some([1.0; 3]),
            poses: vec![PoseName::Supine, PoseName::Prone, PoseName::Tilted],
            hidden: BTreeMap::new(),
            still: false,
            elements: None,
            truth_mm: None,
            out_dir: out_dir.into(),
        }
    }
}

/// Where things were written.
#[derive(Debug, Clone, PartialEq)]
pub struct Written {
    /// The study, ready to run.
    pub study: PathBuf,
    /// Folder with the truth; no stage reads it.
    pub truth: PathBuf,
}

/// Standard deviation of a person's pointing at a landmark (mm), along each axis.
const POINTING_MM: f64 = 0.3;
/// Distance of lattice points on which deformations are kept (mm).
const LATTICE_MM: f64 = 2.5;
/// Air (mm) between a breast and the lateral borders of an image.
const SIDE_MM: f64 = 12.0;
/// Value that the images give to fat at full sensitivity.
const FAT: f64 = 800.0;
/// Signal to noise ratio of fat at full sensitivity.
const FAT_SNR: f64 = 55.0;

/// Makes a volunteer and writes `{pose}.nii.gz`, `{pose}_landmarks.csv`, `study.toml`, and
/// `truth/`: `truth.json` ([`Truth`]), `{pose}_labels.nii.gz`, and `bodies.h5` (the stress-free
/// mesh and its equilibrium in each pose, common frame; without what people add).
///
/// There is no mammography record yet: the truth is not compressed.
///
/// # Errors
/// [`Failure::Usage`] for an unknown preset, [`Failure::Numerics`] when a pose has no
/// equilibrium, [`Failure::Io`] when files cannot be written.
pub fn synthesize(settings: &Settings, progress: &dyn Progress) -> Result<Written, Failure> {
    let preset = Preset::named(&settings.preset)?;
    let mut person = preset.person(settings.seed);
    person.effects.clone_from(&settings.hidden);
    person.truth_mesh.size_mm = settings.truth_mm.unwrap_or(person.truth_mesh.size_mm);
    person.study_mesh.elements = settings.elements.unwrap_or(person.study_mesh.elements);
    let torso = Torso::new(person, settings.seed);
    let out = &settings.out_dir;
    let truth_dir = out.join("truth");
    std::fs::create_dir_all(&truth_dir).map_err(|error| Failure::io(&truth_dir, error))?;

    let mut poses: Vec<PoseName> = settings.poses.clone();
    poses.push(PoseName::Supine);
    poses.sort_unstable();
    poses.dedup();

    let marks = landmarks::stress_free(&torso);
    let meshing = torso.person.truth_mesh;
    let lying = Part { whole: progress, from: 0.0, to: 0.2 };
    let truth_body = TruthBody::new(&torso, meshing, &lying)?;
    let mut bodies = hdf5::Writer::create(truth_dir.join("bodies.h5"))?;
    bodies.put_mesh("stress_free", &truth_body.mesh)?;
    let mut truth = Truth::of(&torso, &settings.preset, settings.seed);
    for (done, &pose) in poses.iter().enumerate() {
        let part = |n: usize| 0.2 + 0.8 * n as f64 / poses.len() as f64;
        let progress = Part { whole: progress, from: part(done), to: part(done + 1) };
        let solving = Part { whole: &progress, from: 0.0, to: 0.5 };
        let scanning = Part { whole: &progress, from: 0.5, to: 1.0 };
        let deformed = truth_body.deform(pose, &solving)?;
        bodies.put_solution(pose.name(), &deformed)?;
        let shapes = truth_body.shapes(&deformed);
        let motion = Motion::drawn(&torso, pose, settings.seed);
        let motion = if settings.still { motion.still() } else { motion };
        let to_image = |x: &Vec3| motion.to_image(&torso, &shapes.forward(x));
        let exact: Landmarks =
            Landmarks(marks.0.iter().map(|(name, x)| (name.clone(), to_image(x))).collect());
        let skin: Vec<Vec3> = deformed.points.iter().map(|x| motion.to_image(&torso, x)).collect();
        let grid = field_of_view(&torso.person, settings.voxel_mm, &skin);
        let corners = [grid.center([0; 3]), grid.center(grid.shape.map(|n| n - 1))];
        let body = PosedBody::new(&torso, &motion, &shapes, corners, LATTICE_MM);
        let scan = protocol(&grid, pose, settings.seed);
        let picture = mri::scan(&grid, &scan, &|p: &Vec3| body.sample(p), &scanning);

        let file = |folder: &Path, ending: &str| folder.join(format!("{}{ending}", pose.name()));
        let path = file(out, ".nii.gz");
        nifti::write(&path, &picture.magnitude, VoxelType::I16, Version::One)?;
        let path = file(&truth_dir, "_labels.nii.gz");
        nifti::write_labels(&path, &picture.labels, Version::One)?;
        let pointed = landmarks::pointed_at(&exact, pose, settings.seed, POINTING_MM);
        write_csv(&file(out, "_landmarks.csv"), &pointed)?;
        truth.poses.insert(pose.name().into(), PoseTruth::of(pose, &motion, exact));
    }
    bodies.finish()?;
    truth.save(&truth_dir.join("truth.json"))?;
    let study = out.join("study.toml");
    let text = study::text(&torso, &truth, &poses, settings.seed);
    std::fs::write(&study, text).map_err(|error| Failure::io(&study, error))?;
    Ok(Written { study, truth: truth_dir })
}

/// The grid of an image that holds `body` (mm): as the preset has it, ended before the table and widened to the sides
/// as an operator does whose scout shows a breast that hangs out.
fn field_of_view(person: &Preset, voxel_mm: Option<[f64; 3]>, body: &[Vec3]) -> Grid {
    let image = &person.image;
    let voxel = voxel_mm.unwrap_or(image.voxel_mm);
    let least = body.iter().map(|p| p.x).fold(f64::MAX, f64::min);
    let most = body.iter().fold(Vec3::repeat(f64::MIN), |most, p| most.sup(p));
    let (mut low, mut high) = (image.low_mm, image.high_mm);
    low[0] = low[0].min(least - SIDE_MM);
    high[0] = high[0].max(most.x + SIDE_MM);
    high[1] = high[1].min(most.y + image.front_mm);
    let shape = [0, 1, 2].map(|axis| ((high[axis] - low[axis]) / voxel[axis]).ceil() as usize + 1);
    Grid::aligned(shape, voxel, low.into())
}

/// How a pose is scanned: a two-sided breast coil under the prone body, a flexible array on the
/// front otherwise. Noise grows with the inverse of the voxel's volume.
fn protocol(grid: &Grid, pose: PoseName, seed: u64) -> mri::Scan {
    let [_, nj, _] = grid.shape;
    let front = grid.center([0, nj - 1, 0]).y - 25.0;
    let centers = match pose {
        PoseName::Prone => vec![
            Vec3::new(78.0, front - 10.0, 8.0),
            Vec3::new(-82.0, front - 10.0, 0.0),
            Vec3::new(150.0, front - 60.0, 0.0),
            Vec3::new(-150.0, front - 60.0, 5.0),
        ],
        _ => vec![
            Vec3::new(60.0, front, 60.0),
            Vec3::new(-55.0, front, 60.0),
            Vec3::new(65.0, front, -65.0),
            Vec3::new(-60.0, front, -60.0),
            Vec3::new(0.0, -130.0, 0.0),
        ],
    };
    let coil = mri::Coil { centers, reach_mm: 75.0, floor: 0.1 };
    let noise = FAT / FAT_SNR;
    let noise_seed = mri::noise::mix(seed ^ (pose as u64 + 1) << 32);
    mri::Scan { coil, fat: FAT, noise, noise_seed, texture_seed: mri::noise::mix(seed) }
}
