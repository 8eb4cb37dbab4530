//! Cuts through a pose for the report, so that no later stage needs the volume.

use crate::{
    register::Registered,
    report::{
        raster::Raster,
        slice::{OverlayPicture, Plane, SlicePicture, overlay, slice},
    },
};
use mammotwin_data::{
    Failure, Vec3,
    io::hdf5,
    labels::{LabelMap, Side},
    progress::Progress,
    store::{Artifact, Stage},
    volume::Volume,
};
use serde::Serialize;
use std::path::Path;

/// Draws the cuts of one pose.
#[derive(Debug, Clone, Serialize)]
pub struct Pictures {
    /// Pixel size of the cuts (mm).
    pub mm_per_pixel: f64,
}

/// The cuts of one pose.
#[derive(Debug, Clone)]
pub struct PosePictures {
    /// With outlines of the labels.
    pub outlines: Vec<SlicePicture>,
    /// Over the reference pose; empty for the reference pose itself.
    pub overlays: Vec<OverlayPicture>,
}

fn put_raster(file: &mut hdf5::Writer, name: &str, raster: &Raster) -> Result<(), Failure> {
    let shape = [raster.height, raster.width, 3];
    Ok(file.put_array(name, &shape, raster.pixels.as_flattened(), "1", "red, green, blue")?)
}

fn raster(file: &hdf5::Reader, name: &str) -> Result<Raster, Failure> {
    let (shape, values) = file.array::<u8>(name)?;
    let (pixels, rest) = values.as_chunks::<3>();
    let &[height, width, 3] = shape.as_slice() else {
        return Err(Failure::io(file.path(), format!("{name} is no picture")));
    };
    debug_assert!(rest.is_empty());
    Ok(Raster { width, height, pixels: pixels.to_vec() })
}

impl Artifact for PosePictures {
    const EXTENSION: &'static str = "h5";

    fn save(&self, path: &Path) -> Result<(), Failure> {
        let mut file = hdf5::Writer::create(path)?;
        let titles: Vec<String> = self.outlines.iter().map(|s| s.title.clone()).collect();
        file.put_texts("outlines/titles", &titles, "places of the cuts")?;
        for (n, cut) in self.outlines.iter().enumerate() {
            put_raster(&mut file, &format!("outlines/{n}"), &cut.picture)?;
        }
        let titles: Vec<String> = self.overlays.iter().map(|s| s.title.clone()).collect();
        file.put_texts("overlays/titles", &titles, "places of the cuts")?;
        for (n, cut) in self.overlays.iter().enumerate() {
            put_raster(&mut file, &format!("overlays/{n}/fixed"), &cut.fixed)?;
            put_raster(&mut file, &format!("overlays/{n}/moved"), &cut.moved)?;
            put_raster(&mut file, &format!("overlays/{n}/checkerboard"), &cut.checkerboard)?;
        }
        Ok(file.finish()?)
    }

    fn load(path: &Path) -> Result<Self, Failure> {
        let file = hdf5::Reader::open(path)?;
        let mut outlines = Vec::new();
        for (n, title) in file.texts("outlines/titles")?.into_iter().enumerate() {
            let picture = raster(&file, &format!("outlines/{n}"))?;
            outlines.push(SlicePicture { title, plane: Plane::ALL[n % 3], picture });
        }
        let mut overlays = Vec::new();
        for (n, title) in file.texts("overlays/titles")?.into_iter().enumerate() {
            overlays.push(OverlayPicture {
                title,
                plane: Plane::ALL[n % 3],
                fixed: raster(&file, &format!("overlays/{n}/fixed"))?,
                moved: raster(&file, &format!("overlays/{n}/moved"))?,
                checkerboard: raster(&file, &format!("overlays/{n}/checkerboard"))?,
            });
        }
        Ok(Self { outlines, overlays })
    }
}

/// Centre of the right breast (mm), where the cuts go through.
fn center(labels: &LabelMap) -> Vec3 {
    let (mut sum, mut count) = (Vec3::zeros(), 0.0);
    for (index, tissue) in labels.values.iter().enumerate() {
        if tissue.side() == Some(Side::Right) {
            sum += labels.grid.center(labels.grid.voxel(index));
            count += 1.0;
        }
    }
    if count > 0.0 { sum / count } else { labels.grid.center(labels.grid.shape.map(|n| n / 2)) }
}

impl Stage for Pictures {
    const NAME: &'static str = "pictures";
    const VERSION: u32 = 2;
    const METHODS: &'static str = "";
    /// The pose, and for a moving pose the reference image with the motion to it.
    type Input = (Volume<f32>, LabelMap, Option<Volume<f32>>, Option<Registered>);
    type Output = PosePictures;

    fn run(
        &self,
        (scan, labels, reference, registered): &Self::Input,
        progress: &dyn Progress,
    ) -> Result<PosePictures, Failure> {
        let point = center(labels);
        let cut = |plane: Plane| slice(scan, Some(labels), plane, &point, self.mm_per_pixel);
        let outlines = Plane::ALL.map(cut).to_vec();
        progress.report(0.5, "overlays");
        let overlays = match (reference, registered) {
            (Some(reference), Some(registered)) => {
                let there = registered.transform.inverse();
                let point = registered.transform.point(&point);
                let lay = |plane: Plane| {
                    let back = |p: &Vec3| there.point(p);
                    overlay(reference, scan, back, plane, &point, self.mm_per_pixel)
                };
                Plane::ALL.map(lay).to_vec()
            }
            _ => Vec::new(),
        };
        Ok(PosePictures { outlines, overlays })
    }
}
