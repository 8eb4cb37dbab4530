//! A picture of the phantom, one for each diameter of microcalcification.

use crate::phantom::CompressedPhantom;
use mammotwin_data::{
    Failure,
    io::hdf5,
    progress::Progress,
    radiograph::Radiograph,
    store::{Artifact, Stage},
};
use mammotwin_imaging::xray::{
    calibration::{Anchor, Unit, calibrate},
    exposure::expose,
    project::{fits, project},
};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Projects the phantoms and takes their pictures, as the plan of the phantom says.
#[derive(Debug, Clone, Serialize)]
pub struct Mammogram {
    /// Seed of the quantum noise.
    pub seed: u64,
}

/// What one picture took.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Technique {
    /// Diameter of the microcalcifications (mm).
    pub diameter_mm: f64,
    /// Photons per mm² below the focal spot, without object.
    pub photons_per_mm2: f64,
    /// Incident air kerma (mGy) at the upper surface of the breast.
    pub kerma_mgy: f64,
    /// What automatic and fixed exposure would give (mGy); absent where automatic sees no breast.
    pub kerma_of_controls_mgy: [Option<f64>; 2],
}

/// The pictures.
#[derive(Debug, Clone)]
pub struct Mammograms {
    /// One for each diameter.
    pub techniques: Vec<Technique>,
    /// Counted quanta per pixel, with noise, one for each diameter.
    pub pictures: Vec<Radiograph>,
}

impl Artifact for Mammograms {
    const EXTENSION: &'static str = "h5";

    fn save(&self, path: &Path) -> Result<(), Failure> {
        let mut file = hdf5::Writer::create(path)?;
        file.put_json("techniques", &self.techniques, "exposure of each picture")?;
        for (n, picture) in self.pictures.iter().enumerate() {
            file.put_radiograph(&format!("picture_{n}"), picture)?;
        }
        Ok(file.finish()?)
    }

    fn load(path: &Path) -> Result<Self, Failure> {
        let file = hdf5::Reader::open(path)?;
        let techniques: Vec<Technique> = file.json("techniques")?;
        let mut pictures = Vec::new();
        for n in 0..techniques.len() {
            pictures.push(file.radiograph(&format!("picture_{n}"))?);
        }
        Ok(Self { techniques, pictures })
    }
}

impl Stage for Mammogram {
    const NAME: &'static str = "mammogram";
    const VERSION: u32 = 2;
    const METHODS: &'static str = "Primary photons were projected from a point source (or a focal spot) through the exact surfaces onto \
         the detector; light spread follows the published transfer function of a caesium iodide \
         detector, and quantum noise is Poisson. Scatter is not included.";
    type Input = CompressedPhantom;
    type Output = Mammograms;

    fn run(
        &self,
        phantom: &CompressedPhantom,
        progress: &dyn Progress,
    ) -> Result<Mammograms, Failure> {
        let refuse =
            |cause: &dyn std::fmt::Display| Failure::BadInput(format!("mammogram: {cause}"));
        let unit = Unit::of(&phantom.plan).map_err(|c| refuse(&c))?;
        fits(&phantom.surface, &unit.geometry).map_err(|c| refuse(&c))?;
        let calibration = calibrate(&Anchor::default(), &unit).map_err(|c| refuse(&c))?;
        let mut made = Mammograms { techniques: Vec::new(), pictures: Vec::new() };
        let diameters = &phantom.plan.calcifications.diameter_mm;
        for (n, &diameter_mm) in diameters.iter().enumerate() {
            progress.report(n as f64 / diameters.len() as f64, &format!("{diameter_mm} mm"));
            let one = phantom.with_diameter(diameter_mm).map_err(|c| refuse(&c))?;
            let projection = project(&one, &unit.geometry).map_err(|c| refuse(&c))?;
            let seed = self.seed.wrapping_add(n as u64);
            let control = phantom.plan.exposure;
            let mut taken = expose(&one, &projection, &unit, &calibration, control, seed)
                .map_err(|c| refuse(&c))?;
            if let Some(before) = made.pictures.last() {
                unit.detector.remember(&mut taken.noisy, before);
            }
            made.techniques.push(Technique {
                diameter_mm,
                photons_per_mm2: taken.photons_per_mm2,
                kerma_mgy: taken.kerma_mgy,
                kerma_of_controls_mgy: taken.kerma_of_controls_mgy,
            });
            made.pictures.push(taken.noisy);
        }
        Ok(made)
    }
}
