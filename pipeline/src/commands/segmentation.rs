//! `mammotwin study segmentation`: found against true labels of digital volunteers.

use super::{synth::voxels, volunteer::made, write};
use crate::{
    cli::SegmentationArguments,
    display::Task,
    segmentation::{Measured, Scanned, markdown, measure, page, table},
};
use mammotwin_data::{
    Failure, Vec3,
    io::{landmarks, nifti},
    labels::LabelMap,
    progress::Progress,
    rigid::RigidTransform,
    volume::Volume,
};
use mammotwin_stages::{
    align::Start,
    report::{
        raster::Raster,
        slice::{Plane, slice},
    },
    volunteer::{PoseName, Settings, Truth},
};
use std::{collections::BTreeMap, fs, path::Path};

/// The poses that are taken.
const POSES: [PoseName; 3] = [PoseName::Supine, PoseName::Prone, PoseName::Tilted];

/// Makes the volunteers that are not there, segments every image and writes `segmentation.csv`,
/// `segmentation.md`, `index.html` and `PRESET_POSE.png` of the first volunteer of each kind.
pub fn segmentation(arguments: &SegmentationArguments) -> Result<(), Failure> {
    if arguments.seeds.is_empty() || arguments.presets.is_empty() {
        return Err(Failure::Usage("give at least one of --seeds and of --presets".into()));
    }
    let voxel_mm = voxels(&arguments.voxel_mm)?;
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
                poses: POSES.to_vec(),
                hidden: BTreeMap::new(),
                still: false,
                elements: None,
                truth_mm: None,
                out_dir: folder.clone(),
            })?;
            let truth = Truth::load(&folder.join("truth/truth.json"))?;
            for pose in POSES {
                let (image, known, found, measured) = one(&folder, &truth, pose)?;
                if seed == arguments.seeds[0] {
                    let name = format!("{preset}_{}.png", pose.name());
                    write(&out.join(&name), picture(&image, &found, &known).png())?;
                    let caption =
                        format!("{preset}, seed {seed}, {}: found above, true below", pose.name());
                    pictures.push((caption, name));
                }
                all.push(measured);
            }
            done += 1.0;
        }
    }
    write(&out.join("segmentation.csv"), table(&all))?;
    write(&out.join("segmentation.md"), markdown(&all))?;
    write(&out.join("index.html"), page(&all, &pictures))?;
    drop(task);
    tell!("{}", markdown(&all));
    tell!("{}: segmentation.csv, segmentation.md, index.html, pictures", out.display());
    Ok(())
}

/// Image, true and found labels of a pose, and how near they are.
fn one(
    folder: &Path,
    truth: &Truth,
    pose: PoseName,
) -> Result<(Volume<f32>, LabelMap, LabelMap, Measured), Failure> {
    let image = nifti::read(&folder.join(format!("{}.nii.gz", pose.name())))?;
    let known = nifti::read_labels(&folder.join(format!("truth/{}_labels.nii.gz", pose.name())))?;
    let marks = |pose: PoseName| {
        let path = folder.join(format!("{}_landmarks.csv", pose.name()));
        landmarks::read(&path).map_err(|cause| Failure::BadInput(cause.to_string()))
    };
    let reference = marks(PoseName::Supine)?;
    let start = Start::of_landmarks(&reference, &marks(pose)?)?
        .map_or_else(RigidTransform::identity, |start| start.transform);
    let name = pose.name();
    let scanned = Scanned { image: &image, start, labels: &known, truth, pose: name };
    let (measured, found) = measure(&scanned)?;
    Ok((image, known, found.labels, measured))
}

/// Cuts through the right breast with the outlines of the found labels, above the true ones.
fn picture(image: &Volume<f32>, found: &LabelMap, known: &LabelMap) -> Raster {
    const MM_PER_PIXEL: f64 = 1.0;
    const GAP: usize = 6;
    let (mut sum, mut count) = (Vec3::zeros(), 0.0);
    for (n, tissue) in known.values.iter().enumerate() {
        let p = known.grid.center(known.grid.voxel(n));
        if tissue.is_gland() && p.x > 0.0 {
            (sum, count) = (sum + p, count + 1.0);
        }
    }
    let middle = if count > 0.0 { sum / count } else { known.grid.center([0; 3]) };
    let row = |labels: &LabelMap| {
        Plane::ALL.map(|plane| slice(image, Some(labels), plane, &middle, MM_PER_PIXEL).picture)
    };
    let rows = [row(found), row(known)];
    let width = |row: &[Raster; 3]| row.iter().map(|cut| cut.width + GAP).sum::<usize>();
    let height = |row: &[Raster; 3]| row.iter().map(|cut| cut.height + GAP).max().unwrap_or(0);
    let (wide, high) =
        (rows.iter().map(width).max().unwrap_or(0), rows.iter().map(height).sum::<usize>());
    let mut all = Raster::filled(wide, high, [0; 3]);
    let mut top = 0;
    for row in &rows {
        let mut left = 0;
        for cut in row {
            for y in 0..cut.height {
                let at = (top + y) * wide + left;
                let from = &cut.pixels[y * cut.width..(y + 1) * cut.width];
                all.pixels[at..at + cut.width].copy_from_slice(from);
            }
            left += cut.width + GAP;
        }
        top += height(row);
    }
    all
}
