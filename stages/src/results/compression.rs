//! `/compression` and `/radiographs`: the breast between the plates, and its pictures.

use crate::{
    compress::Compression,
    load_steps::{self, LoadStep},
    mammogram::Technique,
    quality::PictureRegions,
};
use mammotwin_data::{Failure, io::hdf5::Writer, radiograph::Radiograph};
use mammotwin_imaging::xray::quality::RoiQuality;

/// A picture, what it took, and what was measured on it.
#[derive(Debug, Clone)]
pub struct Picture<'a> {
    /// Name of the group.
    pub name: String,
    /// The picture.
    pub radiograph: &'a Radiograph,
    /// Its exposure.
    pub technique: &'a Technique,
    /// Its regions of interest.
    pub regions: Option<&'a PictureRegions>,
}

/// Writes the tetrahedra of a deformable muscle on the nodes of a mesh; nothing without one.
pub fn put_muscle(file: &mut Writer, name: &str, tets: &[[u32; 4]]) -> Result<(), Failure> {
    if tets.is_empty() {
        return Ok(());
    }
    Ok(file.put(name, tets, "1", "Node indices of the muscle's tetrahedra")?)
}

/// Writes `/compression`, in the frame of the reference pose.
pub fn put_compression(file: &mut Writer, found: &Compression) -> Result<(), Failure> {
    let at = |name: &str| format!("compression/{name}");
    let (rest, solution) = found.in_reference_pose();
    file.put_mesh(&at("rest"), &rest)?;
    put_muscle(file, &at("muscle/tets"), &found.muscle)?;
    file.put_state(&at("solution"), &solution)?;
    let pressure = &found.contact_pressure_kpa;
    let long_name = "Pressure of paddle and receptor on the skin, at the nodes";
    file.put(&at("contact_pressure_kpa"), pressure, "kPa", long_name)?;
    let long_name = "Area of the plates' faces that the skin around the node covers";
    file.put(&at("contact_area_mm2"), &found.face_areas_mm2(), "mm2", long_name)?;
    let back = found.to_detector.inverse();
    let steps: Vec<LoadStep> = found.steps.iter().map(|step| step.moved(&back)).collect();
    load_steps::put(file, &at("steps"), &steps)?;
    file.put_text(&at("side"), found.side.name(), "Which breast")?;
    file.put_scalar(&at("thickness_mm"), found.thickness_mm, "mm", "Distance of the plates")?;
    let long_name = "From the reference pose to the frame of the detector";
    file.put_motion(&at("to_detector"), &found.to_detector, long_name)?;
    file.put_scalar(&at("nipple_node"), found.nipple_node, "1", "Node that is the nipple")?;
    let nipple = found.nipple();
    file.put(&at("nipple_mm"), nipple.as_slice(), "mm", "Nipple in the frame of the detector")?;
    let met = found.met.as_deref().unwrap_or("");
    file.put_text(&at("ended_by"), met, "Key of compress.stop that ended it; empty for none")?;
    let nominal = found.nominal_thickness_mm;
    let long_name = "Mean of smallest and largest distance of the plates over the contact";
    file.put_scalar(&at("nominal_thickness_mm"), nominal, "mm", long_name)?;
    let why = found.stopped_early.as_deref().unwrap_or("");
    let long_name = "Why it ended before its stop rule; empty when the rule was met";
    file.put_text(&at("stopped_early"), why, long_name)?;
    file.attribute("compression", "long_name", "Compressed between paddle and receptor")?;
    Ok(())
}

/// Writes `/radiographs/NAME`.
pub fn put_picture(file: &mut Writer, picture: &Picture) -> Result<(), Failure> {
    let group = format!("radiographs/{}", picture.name);
    file.put_radiograph(&group, picture.radiograph)?;
    let Technique { diameter_mm, photons_per_mm2, kerma_mgy, .. } = *picture.technique;
    let at = |name: &str| format!("{group}/{name}");
    file.put_scalar(&at("diameter_mm"), diameter_mm, "mm", "Diameter of microcalcifications")?;
    let long_name = "Photons below the focal spot, without object";
    file.put_scalar(&at("photons_per_mm2"), photons_per_mm2, "1/mm2", long_name)?;
    let long_name = "Incident air kerma at the upper surface of the breast";
    file.put_scalar(&at("kerma_mgy"), kerma_mgy, "mGy", long_name)?;
    match picture.regions {
        Some(measured) => put_regions(file, &at("regions"), &measured.regions),
        None => Ok(()),
    }
}

fn put_regions(file: &mut Writer, group: &str, regions: &[RoiQuality]) -> Result<(), Failure> {
    let at = |name: &str| format!("{group}/{name}");
    let count = |of: fn(&RoiQuality) -> usize| regions.iter().map(|r| of(r) as u64).collect();
    let rows: Vec<u64> = count(|r| r.site.row);
    file.put(&at("row"), &rows, "1", "Row in the matrix, away from the chest wall")?;
    let columns: Vec<u64> = count(|r| r.site.column);
    file.put(&at("column"), &columns, "1", "Column in the matrix, along x")?;
    let sites: Vec<_> = regions.iter().map(|r| r.site.center).collect();
    let long_name = "Microcalcification in the frame of the detector";
    file.put(&at("site_mm"), &sites, "mm", long_name)?;
    let centers: Vec<[f64; 2]> = regions.iter().map(|r| r.center_mm).collect();
    file.put(&at("center_mm"), &centers, "mm", "Centre of its square of 10 mm on the detector")?;
    let pixels: Vec<u64> = count(|r| r.pixels);
    file.put(&at("pixels"), &pixels, "1", "Pixels of the microcalcification")?;
    let mut put = |name: &str, long_name: &str, of: fn(&RoiQuality) -> f64| {
        let values: Vec<f64> = regions.iter().map(of).collect();
        file.put(&at(name), &values, "1", long_name)
    };
    put("calcification", "Mean signal of the microcalcification", |r| r.calcification)?;
    put("background", "Mean signal around it", |r| r.background)?;
    put("sigma", "Standard deviation around it", |r| r.printed.sigma)?;
    put("snr", "Signal over noise, as printed", |r| r.printed.snr)?;
    put("sdnr", "Contrast over noise, as printed", |r| r.printed.sdnr)?;
    put("sigma_detrended", "Standard deviation, plane removed", |r| r.detrended.sigma)?;
    put("snr_detrended", "Signal over noise, plane removed", |r| r.detrended.snr)?;
    put("sdnr_detrended", "Contrast over noise, plane removed", |r| r.detrended.sdnr)?;
    Ok(())
}
