//! `mammotwin study projection`: path lengths against closed forms.

use super::write;
use crate::cli::ProjectionArguments;
use mammotwin_data::{
    Failure,
    io::{picture::write_float_tiff, stl},
    radiograph::Radiograph,
};
use mammotwin_imaging::xray::{
    geometry::Geometry,
    known::{Known, measure, shadow},
};
use std::{fmt::Write, fs, path::Path};

/// Writes a picture of each body and `projection.csv`, or `surface.tiff` of a given surface.
pub fn projection(arguments: &ProjectionArguments) -> Result<(), Failure> {
    if !(0.05..=10.0).contains(&arguments.pixel_mm) {
        return Err(Failure::Usage("--pixel-mm: give 0.05 to 10".into()));
    }
    let folder = &arguments.out;
    let geometry = Geometry::pristina(arguments.pixel_mm);
    if let Some(file) = &arguments.surface {
        let refused = |cause: String| Failure::BadInput(format!("{}: {cause}", file.display()));
        let surface = stl::read(file)?;
        let picture = shadow(&surface, &geometry).map_err(|cause| refused(cause.to_string()))?;
        if surface.volume_mm3() <= 0.0 {
            return Err(refused("the surface is inside out: turn its facets over".into()));
        }
        fs::create_dir_all(folder).map_err(|cause| Failure::io(folder, cause))?;
        return save(&folder.join("surface.tiff"), &picture);
    }
    fs::create_dir_all(folder).map_err(|cause| Failure::io(folder, cause))?;
    let mut table = String::from(
        "# Path lengths of surfaces less closed forms, over the root mean square path\n\
         body,relative_rms,relative_largest\n",
    );
    for body in Known::ALL {
        let (picture, [rms, largest]) = measure(body, &geometry)
            .map_err(|cause| Failure::BadInput(format!("{}: {cause}", body.name())))?;
        save(&folder.join(format!("{}.tiff", body.name())), &picture)?;
        // Writing to a string does not fail.
        let _ = writeln!(table, "{},{rms:.3e},{largest:.3e}", body.name());
    }
    print!("{table}");
    write(&folder.join("projection.csv"), table)
}

fn save(path: &Path, picture: &Radiograph) -> Result<(), Failure> {
    write_float_tiff(path, picture).map_err(|cause| Failure::io(path, cause))
}
