//! What people add between poses: they breathe, lift an arm, and lie down elsewhere.

use super::{
    preset::{Stream, stream},
    torso::{Torso, smooth_step},
};
use mammotwin_data::{Mat3, Vec3, rigid::RigidTransform};
use nalgebra::{Matrix6, Rotation3, Vector6};
use rand::Rng;

/// How a body lies in the scanner.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, serde::Serialize, serde::Deserialize,
)]
#[serde(rename_all = "snake_case")]
pub enum PoseName {
    /// On the back; its image frame is the common frame.
    Supine,
    /// On the belly, the breasts hanging free.
    Prone,
    /// On the back, turned by 48 degrees to the left.
    Tilted,
    /// Standing.
    Upright,
}

impl PoseName {
    /// All poses.
    pub const ALL: [Self; 4] = [Self::Supine, Self::Prone, Self::Tilted, Self::Upright];

    /// Word in study files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Supine => "supine",
            Self::Prone => "prone",
            Self::Tilted => "tilted",
            Self::Upright => "upright",
        }
    }

    /// Direction of gravity in the common frame (unit). Supine, prone and tilted as measured by
    /// Mîra (2018, § 3.1.3); upright leans back a little.
    pub fn gravity(self) -> Vec3 {
        match self {
            Self::Supine => -Vec3::y(),
            Self::Prone => Vec3::new(0.037, 0.985, -0.165).normalize(),
            Self::Tilted => Vec3::new(-0.744, -0.667, 0.023).normalize(),
            Self::Upright => Vec3::new(0.02, 0.05, -0.998).normalize(),
        }
    }

    /// Direction of gravity in the image frame, where it follows from the posture; the tilted
    /// image is turned with the body, so that its gravity has to be stated.
    pub fn gravity_of_posture(self) -> Option<Vec3> {
        match self {
            Self::Supine => Some(-Vec3::y()),
            Self::Prone => Some(Vec3::y()),
            Self::Tilted => None,
            Self::Upright => Some(-Vec3::z()),
        }
    }
}

/// Everything that moves a person besides gravity, in one pose.
#[derive(Debug, Clone)]
pub struct Motion {
    /// From the image frame to the common frame.
    pub to_common: RigidTransform,
    /// Change of the chest wall.
    pub chest: ChestChange,
    /// Motion of the arms.
    pub arms: ArmMotion,
}

impl Motion {
    /// The motion of a pose; none in the supine pose, which is the reference.
    pub fn drawn(torso: &Torso, pose: PoseName, seed: u64) -> Self {
        Self {
            to_common: table_motion(pose, seed),
            chest: ChestChange::drawn(torso, pose, seed),
            arms: ArmMotion::drawn(torso, pose, seed),
        }
    }

    /// The same motion of the table, but chest wall and arms stay as they are.
    pub fn still(mut self) -> Self {
        (self.chest.scale, self.chest.rms_mm) = (0.0, 0.0);
        self.arms.pulls = [Vec3::zeros(); 2];
        self
    }

    /// Where soft tissue at a place of the common frame, under gravity, is in the image (mm).
    pub fn to_image(&self, torso: &Torso, p: &Vec3) -> Vec3 {
        let arms = self.arms.at(p, torso.chest_wall(p));
        self.to_common.inverse().point(&(p + self.chest.at(p) + arms))
    }
}

fn in_ball(random: &mut impl Rng, least: f64, greatest: f64) -> Vec3 {
    let direction = loop {
        let v = Vec3::from_fn(|_, _| random.random_range(-1.0..1.0));
        if v.norm() > 0.1 && v.norm() < 1.0 {
            break v.normalize();
        }
    };
    direction * random.random_range(least..greatest)
}

/// Rigid motion from a pose's image frame to the common frame: a shift of 5-15 mm, and a turn
/// that carries the direction of gravity exactly to [`PoseName::gravity`].
fn table_motion(pose: PoseName, seed: u64) -> RigidTransform {
    if pose == PoseName::Supine {
        return RigidTransform::identity();
    }
    let mut random = stream(seed ^ (pose as u64) << 32, Stream::Table);
    let shift = in_ball(&mut random, 5.0, 15.0);
    let rotation: Mat3 = match pose.gravity_of_posture() {
        None => *Rotation3::new(in_ball(&mut random, 0.03, 0.07)).matrix(),
        Some(down) => {
            let spin = Rotation3::new(down * random.random_range(-0.05..0.05));
            let lean = Rotation3::rotation_between(&down, &pose.gravity())
                .unwrap_or_else(Rotation3::identity);
            *(lean * spin).matrix()
        }
    };
    let center = Vec3::new(0.0, 40.0, 0.0);
    RigidTransform { rotation, translation: center - rotation * center + shift }
}

/// A smooth change of the chest wall whose rigid part is nothing.
#[derive(Debug, Clone)]
pub struct ChestChange {
    waves: Vec<Wave>,
    shift: Vec3,
    turn: Vec3,
    center: Vec3,
    scale: f64,
    /// Root mean square over the chest wall (mm).
    pub rms_mm: f64,
}

#[derive(Debug, Clone)]
struct Wave {
    amplitude: Vec3,
    vector: Vec3,
    phase: f64,
}

/// Places on the anterior chest wall, where changes are measured.
pub fn chest_wall_places(torso: &Torso) -> Vec<Vec3> {
    let limits = &torso.limits;
    let rows = 24;
    let arc = 1.3 * torso.person.chest.half_axis_x_mm;
    let mut places = Vec::new();
    for row in 0..=rows {
        let part = f64::from(row) / f64::from(rows);
        let z = limits.least_z_mm + part * (limits.greatest_z_mm - limits.least_z_mm);
        for column in -20..=20 {
            let at = super::torso::along_muscle(&torso.person, f64::from(column) / 20.0 * arc);
            if at.y > limits.least_y_mm {
                places.push(Vec3::new(at.x, at.y, z));
            }
        }
    }
    places
}

impl ChestChange {
    fn drawn(torso: &Torso, pose: PoseName, seed: u64) -> Self {
        let mut random = stream(seed ^ (pose as u64) << 32, Stream::ChestWall);
        let rms_mm = match pose {
            PoseName::Supine => 0.0,
            _ => random.random_range(1.2..2.4),
        };
        let waves = (0..10)
            .map(|_| Wave {
                amplitude: in_ball(&mut random, 0.5, 1.0),
                vector: in_ball(&mut random, 1.0, 1.0 + 1e-9)
                    * (std::f64::consts::TAU / random.random_range(160.0..320.0)),
                phase: random.random_range(0.0..std::f64::consts::TAU),
            })
            .collect();
        let places = chest_wall_places(torso);
        let center = places.iter().sum::<Vec3>() / places.len() as f64;
        let (shift, turn) = (Vec3::zeros(), Vec3::zeros());
        let mut change = Self { waves, shift, turn, center, scale: 1.0, rms_mm };
        let moved: Vec<Vec3> = places.iter().map(|p| change.at(p)).collect();
        (change.shift, change.turn) = rigid_part(&places, &moved, &center);
        let square: f64 = places.iter().map(|p| change.at(p).norm_squared()).sum();
        let rms = (square / places.len() as f64).sqrt();
        change.scale = if rms > 0.0 { rms_mm / rms } else { 0.0 };
        change
    }

    /// Displacement (mm) at a place of the common frame.
    pub fn at(&self, p: &Vec3) -> Vec3 {
        let mut sum = -self.shift - self.turn.cross(&(p - self.center));
        for wave in &self.waves {
            sum += wave.amplitude * (wave.vector.dot(p) + wave.phase).cos();
        }
        sum * self.scale
    }
}

/// Translation and small rotation vector about `center` that fit displacements best.
pub fn rigid_part(places: &[Vec3], moved: &[Vec3], center: &Vec3) -> (Vec3, Vec3) {
    let mut normal = Matrix6::zeros();
    let mut right = Vector6::zeros();
    for (place, moved) in places.iter().zip(moved) {
        let arm = place - center;
        for axis in 0..3 {
            let unit = Vec3::ith(axis, 1.0);
            // d/d(turn) of unit·(turn × arm) = arm × unit
            let lever = arm.cross(&unit);
            let row = Vector6::new(unit.x, unit.y, unit.z, lever.x, lever.y, lever.z);
            normal += row * row.transpose();
            right += row * moved[axis];
        }
    }
    let found = normal.cholesky().map_or(Vector6::zeros(), |factor| factor.solve(&right));
    (found.fixed_rows::<3>(0).into_owned(), found.fixed_rows::<3>(3).into_owned())
}

/// Lifted arms drag skin and fat near the armpits; the rib cage stays.
#[derive(Debug, Clone)]
pub struct ArmMotion {
    armpits: [Vec3; 2],
    pulls: [Vec3; 2],
}

/// Reach of an arm's motion (mm).
const ARM_REACH_MM: f64 = 42.0;

impl ArmMotion {
    fn drawn(torso: &Torso, pose: PoseName, seed: u64) -> Self {
        let mut random = stream(seed ^ (pose as u64 + 8) << 32, Stream::ChestWall);
        let chest = &torso.person.chest;
        let armpit = |sign: f64| {
            Vec3::new(sign * chest.half_axis_x_mm, 20.0, torso.limits.greatest_z_mm + 5.0)
        };
        let mut pull = |sign: f64| match pose {
            PoseName::Supine => Vec3::zeros(),
            _ => {
                let length = random.random_range(2.5..6.0);
                let out = random.random_range(0.1..0.4);
                Vec3::new(sign * out, random.random_range(-0.3..0.3), 1.0).normalize() * length
            }
        };
        Self { armpits: [armpit(1.0), armpit(-1.0)], pulls: [pull(1.0), pull(-1.0)] }
    }

    /// Displacement (mm) of soft tissue at a place of the common frame, `chest_wall` mm in front
    /// of the chest wall.
    pub fn at(&self, p: &Vec3, chest_wall: f64) -> Vec3 {
        let free = smooth_step(chest_wall / 8.0);
        let mut sum = Vec3::zeros();
        for (armpit, pull) in self.armpits.iter().zip(&self.pulls) {
            let near = (-(p - armpit).norm_squared() / (ARM_REACH_MM * ARM_REACH_MM)).exp();
            sum += pull * (near * free);
        }
        sum
    }
}
