//! The phantom as a label volume, for other simulators.

use crate::{
    artifact::{bytes_artifact, bytes_of},
    phantom::CompressedPhantom,
};
use mammotwin_data::{
    Failure, Vec3,
    io::{
        metaimage::labels_mha,
        nifti::{Version, VoxelType, write},
    },
    progress::Progress,
    store::Stage,
    volume::{Grid, Volume},
};
use mammotwin_imaging::xray::{
    attenuation::Material,
    transport::{
        exam::{INCLUSIONS, MEDIA},
        scene::Body,
    },
};
use serde::Serialize;
use serde_json::json;
use std::path::Path;

bytes_artifact!("Labels of the phantom as NIfTI.", LabelsNifti, "nii.gz");
bytes_artifact!("Labels of the phantom as MetaImage.", LabelsMeta, "mha");
bytes_artifact!("What the labels are, and where the microcalcifications.", LabelsLegend, "json");

/// Labels of the phantom: 0 air, 1 skin, 2 breast tissue, from 3 on gland and masses. World coordinates are those of the
/// detector (mm): x to the person's right, y away from the chest wall, z up from the detector.
///
/// Microcalcifications are smaller than voxels; the legend has their centres and diameters.
#[derive(Debug, Clone, Serialize)]
pub struct PhantomNifti {
    /// Edge of a voxel (mm).
    pub voxel_mm: f64,
}

/// The same as MetaImage.
#[derive(Debug, Clone, Serialize)]
pub struct PhantomMeta {
    /// Edge of a voxel (mm).
    pub voxel_mm: f64,
}

/// What the labels are made of, and the microcalcifications.
#[derive(Debug, Clone, Serialize)]
pub struct PhantomLegend;

fn refuse(cause: &dyn std::fmt::Display) -> Failure {
    Failure::BadInput(format!("phantom as labels: {cause}"))
}

/// Labels by voxel centre, with a rim of air.
fn voxels(phantom: &CompressedPhantom, voxel_mm: f64) -> Result<Volume<u8>, Failure> {
    let (body, _) = phantom.body().map_err(|c| refuse(&c))?;
    let bounds = body.bounds();
    let count = |length: f64| (length / voxel_mm).ceil() as usize + 2;
    let shape = [0, 1, 2].map(|n| count(bounds.high[n] - bounds.low[n]));
    let origin = bounds.low - Vec3::repeat(0.5 * voxel_mm);
    let grid = Grid::aligned(shape, [voxel_mm; 3], origin);
    let label = |n: usize| {
        let point = grid.center(grid.voxel(n));
        // The body is known within its bounds only.
        if (0..3).any(|k| !(bounds.low[k]..=bounds.high[k]).contains(&point[k])) {
            return 0;
        }
        let medium = body.medium(&point);
        match MEDIA.iter().position(|&of| of == medium) {
            Some(label) => label as u8,
            None => (MEDIA.len() + medium - INCLUSIONS) as u8,
        }
    };
    let values = (0..grid.len()).map(label).collect();
    Ok(Volume { grid, values })
}

impl Stage for PhantomNifti {
    const NAME: &'static str = "phantom_nifti";
    const VERSION: u32 = 2;
    const METHODS: &'static str = "";
    type Input = CompressedPhantom;
    type Output = LabelsNifti;

    fn run(&self, phantom: &CompressedPhantom, _: &dyn Progress) -> Result<LabelsNifti, Failure> {
        let Volume { grid, values } = voxels(phantom, self.voxel_mm)?;
        let values = values.into_iter().map(f32::from).collect();
        let image = Volume { grid, values };
        let save = |path: &Path| {
            write(path, &image, VoxelType::U8, Version::One).map_err(|c| Failure::io(path, c))
        };
        bytes_of("phantom.nii.gz", save).map(LabelsNifti)
    }
}

impl Stage for PhantomMeta {
    const NAME: &'static str = "phantom_mha";
    const VERSION: u32 = 2;
    const METHODS: &'static str = "";
    type Input = CompressedPhantom;
    type Output = LabelsMeta;

    fn run(&self, phantom: &CompressedPhantom, _: &dyn Progress) -> Result<LabelsMeta, Failure> {
        let Volume { grid, values } = voxels(phantom, self.voxel_mm)?;
        labels_mha(&grid, &values).map(LabelsMeta).map_err(|c| refuse(&c))
    }
}

impl Stage for PhantomLegend {
    const NAME: &'static str = "phantom_legend";
    const VERSION: u32 = 2;
    const METHODS: &'static str = "";
    type Input = CompressedPhantom;
    type Output = LabelsLegend;

    fn run(&self, phantom: &CompressedPhantom, _: &dyn Progress) -> Result<LabelsLegend, Failure> {
        let named = |name: &str| Material::named(name).map_err(|c| refuse(&c));
        let skin = named("skin_hammerstein")?;
        let tissue = phantom.tissue().map_err(|c| refuse(&c))?;
        let (_, inclusions) = phantom.body().map_err(|c| refuse(&c))?;
        let calcium = Material::calcification().map_err(|c| refuse(&c))?;
        let of = |label: u8, material: &Material| {
            json!({
                "label": label,
                "material": material.name,
                "density_g_per_cm3": material.density_g_per_cm3,
                "mass_fractions": material.parts,
            })
        };
        let mut labels = vec![of(0, &named("air")?), of(1, &skin), of(2, &tissue)];
        labels.extend(inclusions.iter().zip(3..).map(|(material, label)| of(label, material)));
        let mut grains = Vec::new();
        for &diameter_mm in &phantom.plan.calcifications.diameter_mm {
            let one = phantom.with_diameter(diameter_mm).map_err(|c| refuse(&c))?;
            grains.extend(one.calcifications.iter().map(|c| {
                let center: &[f64] = c.site.center.as_slice();
                json!({ "diameter_mm": diameter_mm, "row": c.site.row, "column": c.site.column, "center_mm": center })
            }));
        }
        let legend = json!({
            "frame": "x to the person's right, y away from the chest wall, z up from the detector (mm)",
            "thickness_mm": phantom.thickness_mm,
            "labels": labels,
            "microcalcifications": { "in_labels": false, "material": calcium.name,
                "density_g_per_cm3": calcium.density_g_per_cm3, "sites": grains },
        });
        Ok(LabelsLegend(format!("{legend:#}\n").into_bytes()))
    }
}
