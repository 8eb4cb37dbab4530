//! Materials as photons meet them: coefficients and angles of scatter, tabulated finely.

use crate::xray::{
    attenuation::{AttenuationError, Material},
    transport::angles::Angles,
};

/// Lowest energy (keV): the first of the table of coefficients. What falls below it is absorbed
/// where it is.
pub const CUTOFF_KEV: f64 = 5.0;
/// Materials that a scene may have.
pub const MAX_MEDIA: usize = 8;
/// Highest energy (keV).
const TOP_KEV: f64 = 50.0;
/// Nodes per keV: linear between them is off by at most 5e-5 (at 5 keV; 1e-5 above 12 keV).
const PER_KEV: f64 = 20.0;

/// Materials of a scene; they are named by their index.
#[derive(Debug, Clone)]
pub struct Media {
    materials: Vec<Material>,
    angles: Vec<Angles>,
    /// By energy, then material.
    nodes: Vec<Node>,
}

/// Coefficients of one material at one energy.
#[derive(Debug, Clone, Copy, Default)]
struct Node {
    /// Attenuation (1/mm).
    total: f32,
    /// Share of photoelectric absorption in it.
    photo: f32,
    /// Share of photoelectric absorption and coherent scatter in it.
    photo_coherent: f32,
    /// Energy transfer (1/mm).
    transfer: f32,
    /// Share of an absorbed energy that gland gets.
    gland: f32,
}

/// Where an energy lies between the nodes.
#[derive(Debug, Clone, Copy)]
pub struct At {
    first: usize,
    part: f32,
}

/// What happens to a photon.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Event {
    /// Absorbed; fluorescence (calcium: 4 keV) stays where it is.
    Photoelectric,
    /// Turned without loss (Rayleigh).
    Coherent,
    /// Turned with loss (Compton).
    Incoherent,
}

impl Media {
    /// Tabulates materials. Of the energy that a mixture absorbs, gland gets the share
    /// w µ_tr(gland) / Σ w µ_tr (Boone 1999; Dance 1990); `glandular` says which materials count.
    pub fn new(materials: Vec<Material>) -> Result<Self, AttenuationError> {
        let angles = materials.iter().map(Angles::of).collect::<Result<Vec<_>, _>>()?;
        let last = ((TOP_KEV - CUTOFF_KEV) * PER_KEV).round() as usize;
        let mut nodes = Vec::with_capacity((last + 1) * materials.len());
        for n in 0..=last {
            let energy_kev = (CUTOFF_KEV + n as f64 / PER_KEV).min(TOP_KEV);
            for material in &materials {
                nodes.push(Node::of(material, energy_kev)?);
            }
        }
        Ok(Self { materials, angles, nodes })
    }

    /// The materials.
    pub fn materials(&self) -> &[Material] {
        &self.materials
    }

    /// Angles of scatter in a material.
    #[inline]
    pub fn angles(&self, medium: usize) -> &Angles {
        &self.angles[medium]
    }

    /// Whether photons of this energy can be followed.
    pub fn covers(energy_kev: f64) -> bool {
        (CUTOFF_KEV..=TOP_KEV).contains(&energy_kev)
    }

    /// Place of an energy (keV) that the table covers.
    #[inline]
    pub fn at(&self, energy_kev: f64) -> At {
        let place = (energy_kev - CUTOFF_KEV) * PER_KEV;
        let count = self.nodes.len() / self.materials.len();
        let first = (place as usize).min(count - 2);
        At { first: first * self.materials.len(), part: (place - first as f64) as f32 }
    }

    #[inline]
    fn mix(&self, at: At, medium: usize, of: impl Fn(&Node) -> f32) -> f64 {
        let low = of(&self.nodes[at.first + medium]);
        let high = of(&self.nodes[at.first + medium + self.materials.len()]);
        f64::from(low + at.part * (high - low))
    }

    /// Attenuation (1/mm).
    #[inline]
    pub fn total(&self, at: At, medium: usize) -> f64 {
        self.mix(at, medium, |n| n.total)
    }

    /// Energy transfer (1/mm).
    #[inline]
    pub fn transfer(&self, at: At, medium: usize) -> f64 {
        self.mix(at, medium, |n| n.transfer)
    }

    /// Share of an absorbed energy that gland gets.
    #[inline]
    pub fn gland(&self, at: At, medium: usize) -> f64 {
        self.mix(at, medium, |n| n.gland)
    }

    /// What a collision is, by a random number of 0..1.
    #[inline]
    pub fn event(&self, at: At, medium: usize, random: f64) -> Event {
        if random < self.mix(at, medium, |n| n.photo) {
            Event::Photoelectric
        } else if random < self.mix(at, medium, |n| n.photo_coherent) {
            Event::Coherent
        } else {
            Event::Incoherent
        }
    }
}

impl Node {
    fn of(material: &Material, energy_kev: f64) -> Result<Self, AttenuationError> {
        let [photo, coherent, incoherent] = material.processes_cm2_per_g(energy_kev)?;
        let sum = photo + coherent + incoherent;
        let per_mm = 0.1 * material.density_g_per_cm3;
        Ok(Self {
            total: material.attenuation_per_mm(energy_kev)? as f32,
            photo: (photo / sum) as f32,
            photo_coherent: ((photo + coherent) / sum) as f32,
            transfer: (per_mm * material.transfer_cm2_per_g(energy_kev)?) as f32,
            gland: material.gland_share(energy_kev)? as f32,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_fine_table_is_the_coarse_one() {
        let materials = ["skin_hammerstein", "air", "al"].map(|n| Material::named(n).unwrap());
        let media = Media::new(materials.to_vec()).unwrap();
        for energy in [5.0, 16.8, 17.263, 24.0, 37.77, 50.0] {
            let at = media.at(energy);
            for (n, material) in materials.iter().enumerate() {
                let exact = material.attenuation_per_mm(energy).unwrap();
                let error = media.total(at, n) / exact - 1.0;
                assert!(error.abs() < 1e-4, "{} {energy} keV: {error}", material.name);
                let exact =
                    0.1 * material.density_g_per_cm3 * material.transfer_cm2_per_g(energy).unwrap();
                assert!((media.transfer(at, n) / exact - 1.0).abs() < 1e-4);
            }
        }
        assert!(Media::covers(5.0) && Media::covers(50.0) && !Media::covers(50.01));
        assert!(!Media::covers(f64::NAN));
    }

    #[test]
    fn gland_gets_its_share() {
        let materials = [0.0, 0.2, 1.0].map(|g| Material::breast(g).unwrap());
        let media = Media::new(materials.to_vec()).unwrap();
        let at = media.at(20.0);
        let [gland, fat] = ["glandular_hammerstein", "adipose_hammerstein"]
            .map(|n| Material::named(n).unwrap().transfer_cm2_per_g(20.0).unwrap());
        let exact = 0.2 * gland / (0.2 * gland + 0.8 * fat);
        assert!((media.gland(at, 1) / exact - 1.0).abs() < 1e-5);
        assert_eq!([media.gland(at, 0), media.gland(at, 2)], [0.0, 1.0]);
        // Gland absorbs more than its share of the mass.
        assert!(exact > 0.27);
    }
}
