//! What a digital volunteer is like before the seed varies her.

use mammotwin_data::{
    Failure,
    study::{InterfaceKind, MeshPlan},
};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// A kind of volunteer: `data/volunteers/*.toml`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Preset {
    /// Word on the command line.
    pub name: String,
    /// Largest relative change that a seed makes to a number.
    pub variation: f64,
    /// Chest wall and what lies on it.
    pub chest: Chest,
    /// Both breasts.
    pub breast: Breast,
    /// Young's moduli, to be found by a calibration.
    pub stiffness: Stiffness,
    /// Properties that are the same for every seed and known to the study.
    pub fixed: Fixed,
    /// Mesh of the truth.
    pub truth_mesh: MeshPlan,
    /// Mesh of the model under test, as the study states it.
    pub study_mesh: MeshPlan,
    /// Field of view.
    pub image: Frame,
    /// Mammography.
    pub compression: Compression,
    /// Effects of the truth, amplitude by name; the study does not have those that are hidden.
    #[serde(default)]
    pub effects: BTreeMap<String, f64>,
}

/// Chest wall: an elliptic cylinder along z, with muscle and fat over it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Chest {
    /// Half axis of the rib cage along x (mm).
    pub half_axis_x_mm: f64,
    /// Half axis of the rib cage along y (mm).
    pub half_axis_y_mm: f64,
    /// The body reaches this far along z (mm); images may end before.
    pub half_extent_z_mm: f64,
    /// Thickness of the muscle at the sternal and the midaxillary line (mm).
    pub muscle_thin_mm: f64,
    /// Thickness of the pectoral muscle at mid-height, where it is thickest (mm).
    pub muscle_thick_mm: f64,
    /// Fat and skin beside the breasts (mm).
    pub fat_mm: f64,
}

/// A half ellipsoid on the muscle.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Breast {
    /// Half axis of the base across the chest (mm).
    pub base_x_mm: f64,
    /// Half axis of the base along z (mm).
    pub base_z_mm: f64,
    /// Height over the muscle (mm).
    pub projection_mm: f64,
    /// From the sternal line to the centre, along the muscle (mm).
    pub from_sternal_line_mm: f64,
    /// Radius of the areola (mm).
    pub areola_radius_mm: f64,
    /// Fibroglandular part of the volume.
    pub gland_fraction: f64,
}

/// Young's moduli (kPa).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Stiffness {
    /// Right breast.
    pub breast_right_kpa: f64,
    /// Left breast.
    pub breast_left_kpa: f64,
    /// Skin.
    pub skin_kpa: f64,
    /// Deep fascia.
    pub fascia_kpa: f64,
}

/// Properties that no seed changes.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Fixed {
    /// Thickness of the skin membrane (mm). The picture shows a regional map instead.
    pub skin_mm: f64,
    /// Thickness of the fascia membrane (mm).
    pub fascia_mm: f64,
    /// Young's modulus of the suspensory ligaments (kPa).
    pub ligaments_kpa: f64,
    /// Young's modulus of the muscle (kPa); the muscle is rigid.
    pub muscle_kpa: f64,
    /// Poisson's ratio under gravity.
    pub poisson: f64,
    /// Density of all tissues (g/cm³).
    pub density_g_per_cm3: f64,
    /// What happens between breast and muscle.
    pub interface: InterfaceKind,
    /// Coulomb friction between breast and muscle.
    pub friction: f64,
}

/// Field of view and voxels.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Frame {
    /// Voxel of the full grid (mm).
    pub voxel_mm: [f64; 3],
    /// Air before the nipples (mm); the greatest y of an image follows from it.
    pub front_mm: f64,
    /// Least x, y, z of the image (mm).
    pub low_mm: [f64; 3],
    /// Greatest x and z of the image (mm); y is at most this.
    pub high_mm: [f64; 3],
}

/// What the last mammography was like.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Compression {
    /// Jₘ of the Gent law in compression.
    pub jm: f64,
    /// Compressed thickness of the right breast (mm).
    pub thickness_right_mm: f64,
    /// Compressed thickness of the left breast (mm).
    pub thickness_left_mm: f64,
    /// From the chest wall to the edge of the paddle (mm).
    pub chest_wall_distance_mm: f64,
}

const FILES: [(&str, &str); 3] = [
    ("small", include_str!("../../../data/volunteers/small.toml")),
    ("large", include_str!("../../../data/volunteers/large.toml")),
    ("tiny", include_str!("../../../data/volunteers/tiny.toml")),
];

const SLIDING: &str = "sliding";

impl Preset {
    /// The built-in preset of a name. `sliding` is `tiny` with breasts that slide on the muscle without
    /// friction.
    pub fn named(name: &str) -> Result<Self, Failure> {
        if name == SLIDING {
            let mut preset = Self::named("tiny")?;
            preset.name = name.into();
            preset.fixed.interface = InterfaceKind::NoSeparation;
            return Ok(preset);
        }
        let Some((_, text)) = FILES.iter().find(|(known, _)| *known == name) else {
            let known = FILES.map(|(known, _)| known).join(", ");
            return Err(Failure::Usage(format!(
                "no preset is called `{name}`; there are {known}, {SLIDING}"
            )));
        };
        toml::from_str(text).map_err(|error| Failure::BadInput(format!("preset {name}: {error}")))
    }

    /// The person of a seed: every number of chest, breast and stiffness changed by at most
    /// `variation`, independently.
    pub fn person(&self, seed: u64) -> Self {
        let mut random = stream(seed, Stream::Person);
        let mut vary = |value: &mut f64| {
            let change = self.variation * random.random_range(-1.0..1.0);
            *value = round_to_four_digits(*value * (1.0 + change));
        };
        let mut person = self.clone();
        let Self { chest, breast, stiffness, .. } = &mut person;
        for value in [
            &mut chest.half_axis_x_mm,
            &mut chest.half_axis_y_mm,
            &mut chest.muscle_thin_mm,
            &mut chest.muscle_thick_mm,
            &mut chest.fat_mm,
            &mut breast.base_x_mm,
            &mut breast.base_z_mm,
            &mut breast.projection_mm,
            &mut breast.from_sternal_line_mm,
            &mut breast.areola_radius_mm,
            &mut breast.gland_fraction,
            &mut stiffness.breast_right_kpa,
            &mut stiffness.breast_left_kpa,
            &mut stiffness.skin_kpa,
            &mut stiffness.fascia_kpa,
        ] {
            vary(value);
        }
        // The chest itself varies less than breasts do, or the image would cut it.
        for (value, nominal) in [
            (&mut chest.half_axis_x_mm, self.chest.half_axis_x_mm),
            (&mut chest.half_axis_y_mm, self.chest.half_axis_y_mm),
        ] {
            *value = round_to_four_digits(nominal + 0.3 * (*value - nominal));
        }
        person
    }
}

fn round_to_four_digits(value: f64) -> f64 {
    let digits = 3 - value.abs().log10().floor() as i32;
    let scale = 10f64.powi(digits);
    (value * scale).round() / scale
}

/// What random numbers are drawn for; each purpose has its own stream, so that a new one
/// changes no other.
#[derive(Debug, Clone, Copy)]
pub(super) enum Stream {
    /// The person's numbers.
    Person,
    /// Rigid motions of the table.
    Table,
    /// Change of the chest wall between poses.
    ChestWall,
    /// Errors of pointing at landmarks.
    Pointing,
}

/// The random numbers of a purpose.
pub(super) fn stream(seed: u64, purpose: Stream) -> ChaCha8Rng {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    random.set_stream(purpose as u64);
    random
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_seed_is_a_person_within_the_variation() {
        let preset = Preset::named("small").unwrap();
        assert_eq!(preset.person(7), preset.person(7));
        assert_ne!(preset.person(7), preset.person(8));
        for seed in 0..50 {
            let change = preset.person(seed).breast.projection_mm / preset.breast.projection_mm;
            assert!((change - 1.0).abs() <= preset.variation + 1e-3);
        }
    }

    #[test]
    fn an_unknown_preset_is_refused_with_the_known_names() {
        let text = Preset::named("medium").unwrap_err().to_string();
        assert!(text.contains("medium") && text.contains("small") && text.contains("large"));
    }
}
