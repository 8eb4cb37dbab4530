//! Readers and writers of files.

pub mod dicom;
pub mod hdf5;
pub mod landmarks;
pub mod metaimage;
pub mod nifti;
pub mod picture;
pub mod ply;
pub mod stl;
pub mod torque;

use crate::Failure;
use std::{fs::File, path::Path};

/// Opens a file of at most so many bytes.
///
/// # Errors
/// [`Failure::Io`]; [`Failure::BadInput`] when it is larger: `mend` says what to do.
fn open_up_to(path: &Path, most_bytes: u64, mend: &str) -> Result<File, Failure> {
    let io = |error: std::io::Error| Failure::io(path, error);
    let file = File::open(path).map_err(io)?;
    if file.metadata().map_err(io)?.len() > most_bytes {
        let text = format!("{}: is larger than {most_bytes} bytes; {mend}", path.display());
        return Err(Failure::BadInput(text));
    }
    Ok(file)
}
