//! `mammotwin study segmentation`: found against true labels of digital volunteers.

use super::{
    synth::{named_poses, voxels},
    volunteer::made,
    write,
};
use crate::{
    cli::SegmentationArguments,
    display::Task,
    segmentation::{
        Scanned, Seen, markdown, measure,
        overlay::{behind_tip, overlay},
        page, table,
    },
};
use mammotwin_data::{
    Failure, Vec3,
    io::{landmarks, nifti},
    labels::{LabelMap, Side},
    progress::{Progress, Silent},
    rigid::RigidTransform,
    volume::Volume,
};
use mammotwin_stages::{
    align::Start,
    volunteer::{PoseName, Settings, Truth},
};
use std::{collections::BTreeMap, fs, path::Path};

/// Makes the volunteers that are not there, segments every image and writes `segmentation.csv` (after
/// each person), `segmentation.md`, `index.html` and `PRESET_POSE.png` of the first of each kind.
pub fn segmentation(arguments: &SegmentationArguments) -> Result<(), Failure> {
    if arguments.seeds.is_empty() || arguments.presets.is_empty() {
        return Err(Failure::Usage("give at least one of --seeds and of --presets".into()));
    }
    let voxel_mm = voxels(&arguments.voxel_mm)?;
    let poses = named_poses(&arguments.poses)?;
    let marked = !arguments.without_landmarks;
    if !marked && poses.first() != Some(&PoseName::Supine) {
        let why =
            "--without-landmarks compares the images with the supine one; name it first in --poses";
        return Err(Failure::Usage(why.into()));
    }
    let out = &arguments.out;
    fs::create_dir_all(out).map_err(|cause| Failure::io(out, cause))?;
    let task = Task::new("segmentation");
    let (mut all, mut pictures) = (Vec::new(), Vec::new());
    let mut done = 0.0;
    let total = (arguments.seeds.len() * arguments.presets.len()) as f64;
    for preset in &arguments.presets {
        for &seed in &arguments.seeds {
            task.report(done / total, &format!("{preset} {seed}"));
            let folder = out.join(format!("{preset}-{seed}"));
            made(&Settings {
                preset: preset.clone(),
                seed,
                voxel_mm,
                poses: poses.clone(),
                hidden: BTreeMap::new(),
                still: false,
                elements: None,
                truth_mm: None,
                out_dir: folder.clone(),
            })?;
            let truth = Truth::load(&folder.join("truth/truth.json"))?;
            let mut supine = None;
            for &pose in &poses {
                let scan = Scan::read(&folder, pose)?;
                let start = match (&supine, marked) {
                    (Some((image, labels)), false) => {
                        Start::of_images((image, labels), &scan.image, &Silent)?.transform
                    }
                    (None, false) => RigidTransform::identity(),
                    (_, true) => marked_start(&folder, pose)?,
                };
                let Seen { measured, labels: found } = scan.measured(start, &truth, pose)?;
                if seed == arguments.seeds[0] {
                    let name = format!("{preset}_{}.png", pose.name());
                    let cut = behind_tip(&scan.labels, Side::Right).unwrap_or_else(Vec3::zeros);
                    let rows = [(&found, cut), (&scan.labels, cut)];
                    write(&out.join(&name), overlay(&scan.image, &rows).png())?;
                    let caption =
                        format!("{preset}, seed {seed}, {}: found above, true below", pose.name());
                    pictures.push((caption, name));
                }
                all.push(measured);
                if pose == PoseName::Supine {
                    supine = Some((scan.image, found));
                }
            }
            write(&out.join("segmentation.csv"), table(&all))?;
            done += 1.0;
        }
    }
    write(&out.join("segmentation.md"), markdown(&all))?;
    write(&out.join("index.html"), page(&all, &pictures))?;
    drop(task);
    tell!("{}", markdown(&all));
    tell!("{}: segmentation.csv, segmentation.md, index.html, pictures", out.display());
    Ok(())
}

/// Image of a pose and its true labels.
struct Scan {
    image: Volume<f32>,
    labels: LabelMap,
}

impl Scan {
    fn read(folder: &Path, pose: PoseName) -> Result<Self, Failure> {
        let name = pose.name();
        let image = nifti::read(&folder.join(format!("{name}.nii.gz")))?;
        let labels = nifti::read_labels(&folder.join(format!("truth/{name}_labels.nii.gz")))?;
        Ok(Self { image, labels })
    }

    /// What is found in it, and how near that is.
    fn measured(
        &self,
        start: RigidTransform,
        truth: &Truth,
        pose: PoseName,
    ) -> Result<Seen, Failure> {
        let pose = pose.name();
        measure(&Scanned { image: &self.image, start, labels: &self.labels, truth, pose })
    }
}

/// Motion of a pose to the supine one by the landmarks of both.
fn marked_start(folder: &Path, pose: PoseName) -> Result<RigidTransform, Failure> {
    let marks = |pose: PoseName| {
        let path = folder.join(format!("{}_landmarks.csv", pose.name()));
        landmarks::read(&path).map_err(|cause| Failure::BadInput(cause.to_string()))
    };
    let start = Start::of_landmarks(&marks(PoseName::Supine)?, &marks(pose)?)?;
    Ok(start.map_or_else(RigidTransform::identity, |start| start.transform))
}
