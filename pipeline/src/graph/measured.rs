//! What was measured of a person: images, and surfaces of scanners.

use super::{fiducials, gravity, labels};
use mammotwin_data::{
    Failure,
    labels::LabelMap,
    landmarks::Landmarks,
    store::{Run, Stored},
    study::{Scan, Study, Use},
    surface::TriMesh,
    volume::Volume,
};
use mammotwin_stages::{
    align::{Align, Start},
    measure::{Measure, PoseMeasures},
    pictures::{Pictures, PosePictures},
    register::{Register, Registered},
    scan::{PlaceScan, SkinScan},
    surface::{PoseSurfaces, Surface},
};
use std::collections::BTreeMap;

/// Pixel size (mm) of the cuts in the report.
const CUT_MM: f64 = 1.0;

/// Handles on what was made of one image.
#[derive(Debug, Clone)]
pub struct PoseOutcome {
    /// The image itself.
    pub scan: Stored<Volume<f32>>,
    /// Its labels.
    pub labels: Stored<LabelMap>,
    /// Its surfaces.
    pub surfaces: Stored<PoseSurfaces>,
    /// How it lies to the reference pose; `None` for the reference pose.
    pub registered: Option<Stored<Registered>>,
    /// Volumes, protrusion, nipples and skin of its breasts.
    pub measures: Stored<PoseMeasures>,
    /// Cuts for the report.
    pub pictures: Stored<PosePictures>,
}

/// Handles on what was made of a scan of the skin.
#[derive(Debug, Clone)]
pub struct ScanOutcome {
    /// How it lies to the reference pose.
    pub registered: Stored<Registered>,
    /// Its skin.
    pub surfaces: Stored<PoseSurfaces>,
}

/// Handles on what was made of all measurements, by pose name.
#[derive(Debug, Clone)]
pub struct Measured {
    /// Of images.
    pub images: BTreeMap<String, PoseOutcome>,
    /// Of scans of the skin.
    pub scans: BTreeMap<String, ScanOutcome>,
}

/// A pose that the model is compared with.
#[derive(Debug)]
pub struct Target<'a> {
    /// Its name.
    pub name: &'a String,
    /// Whether it calibrates or proves.
    pub usage: Use,
    /// How it lies to the reference pose.
    pub registered: &'a Stored<Registered>,
    /// Its surfaces.
    pub surfaces: &'a Stored<PoseSurfaces>,
}

impl Measured {
    /// All poses but the reference pose, images first.
    pub fn targets<'a>(&'a self, study: &'a Study) -> Vec<Target<'a>> {
        let imaged = self.images.iter().filter_map(|(name, pose)| {
            let usage = study.poses[name].usage;
            let registered = pose.registered.as_ref()?;
            Some(Target { name, usage, registered, surfaces: &pose.surfaces })
        });
        let scanned = self.scans.iter().map(|(name, scan)| Target {
            name,
            usage: study.scans[name].usage,
            registered: &scan.registered,
            surfaces: &scan.surfaces,
        });
        imaged.chain(scanned).collect()
    }
}

/// The poses that a fit reads, but the reference pose.
pub(crate) struct Fitted {
    pub names: Vec<String>,
    pub motions: Vec<Stored<Registered>>,
    pub surfaces: Vec<Stored<PoseSurfaces>>,
}

impl Fitted {
    /// Of some poses.
    pub fn of<'a>(targets: impl Iterator<Item = Target<'a>>) -> Self {
        let mut found = Self { names: Vec::new(), motions: Vec::new(), surfaces: Vec::new() };
        for Target { name, registered, surfaces, .. } in targets {
            found.names.push(name.clone());
            found.motions.push(registered.clone());
            found.surfaces.push(surfaces.clone());
        }
        found
    }
}

pub(crate) fn fitted(study: &Study, measured: &Measured) -> Fitted {
    let targets = measured.targets(study).into_iter();
    Fitted::of(targets.filter(|target| target.usage == Use::Fit))
}

/// Labels, surfaces and rigid motions of all images, skins and places of all scans.
pub(crate) fn measured(study: &Study, reference: &str, run: &Run<'_>) -> Result<Measured, Failure> {
    let images = images(study, reference, run)?;
    let landmarks = fiducials::landmarks(study, reference, run)?;
    let mut scans = BTreeMap::new();
    for (name, plan) in &study.scans {
        scans.insert(name.clone(), scan(name, plan, landmarks.as_ref(), run)?);
    }
    Ok(Measured { images, scans })
}

fn scan(
    name: &str,
    plan: &Scan,
    reference: Option<&Stored<Landmarks>>,
    run: &Run<'_>,
) -> Result<ScanOutcome, Failure> {
    let unit = plan.unit;
    let gravity_in_scan = plan
        .gravity()
        .ok_or_else(|| Failure::BadInput(format!("scans.{name}: no direction of gravity")))?;
    let surface: Stored<TriMesh> = run.external(&format!("scans.{name}.surface"), &plan.surface)?;
    let own: Stored<Landmarks> =
        run.external(&format!("scans.{name}.landmarks"), &plan.landmarks)?;
    let place = PlaceScan { pose: name.into(), gravity_in_scan };
    let registered = run.stage(name, &place, (reference, &own))?;
    let surfaces = run.stage(name, &SkinScan { unit }, (&surface, &registered))?;
    Ok(ScanOutcome { registered, surfaces })
}

fn images(
    study: &Study,
    reference: &str,
    run: &Run<'_>,
) -> Result<BTreeMap<String, PoseOutcome>, Failure> {
    let landmarks = |name: &str| fiducials::landmarks(study, name, run);
    let reference_landmarks = landmarks(reference)?;
    let mut scans = BTreeMap::new();
    for (name, pose) in &study.poses {
        let scan: Stored<Volume<f32>> =
            run.external(&format!("poses.{name}.image"), &pose.image)?;
        scans.insert(name.clone(), scan);
    }
    // The reference pose first: the others are registered to it.
    let mut order: Vec<&String> = study.poses.keys().collect();
    order.sort_by_key(|name| *name != reference);
    let mut poses: BTreeMap<String, PoseOutcome> = BTreeMap::new();
    for name in order {
        let (pose, scan) = (&study.poses[name], scans[name].clone());
        let gravity_in_image = gravity(name, pose)?;
        let own = if name == reference { reference_landmarks.clone() } else { landmarks(name)? };
        let start: Option<Stored<Start>> = match poses.get(reference) {
            None => None,
            Some(fixed) => {
                let images = (&fixed.scan, &fixed.labels, &scan);
                let marks = (reference_landmarks.as_ref(), own.as_ref());
                Some(run.stage(name, &Align, (marks.0, marks.1, images))?)
            }
        };
        let labels = labels::of_pose(name, pose, &scan, start.as_ref(), run)?;
        let surfaces = run.stage(name, &Surface::default(), &labels)?;
        let registered = match (&start, poses.get(reference)) {
            (Some(start), Some(fixed)) => {
                let register = Register { gravity_in_image };
                let both = (
                    (&fixed.scan, &fixed.labels, &fixed.surfaces),
                    (&scan, &labels, &surfaces),
                    start,
                );
                Some(run.stage(name, &register, both)?)
            }
            _ => None,
        };
        let inputs = (&scan, &labels, &surfaces, own.as_ref(), registered.as_ref());
        let measures = run.stage(name, &Measure, inputs)?;
        let pictures = Pictures { mm_per_pixel: CUT_MM };
        let fixed = registered.as_ref().and(poses.get(reference)).map(|fixed| &fixed.scan);
        let pictures = run.stage(name, &pictures, (&scan, &labels, fixed, registered.as_ref()))?;
        let pose = PoseOutcome { scan, labels, surfaces, registered, measures, pictures };
        poses.insert(name.clone(), pose);
    }
    Ok(poses)
}
