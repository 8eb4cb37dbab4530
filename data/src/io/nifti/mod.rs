//! Images and label maps as NIfTI-1 and NIfTI-2: the only door for voxels.
//!
//! Read are `.nii` and `.hdr` with `.img`, plain or gzip, of either byte order and any real
//! voxel type. A header is checked as a whole before anything large is allocated, and a gzip
//! stream is read to its end so that its checksum counts. Behind this door all positions are
//! right-anterior-superior millimetres; oblique grids stay as they are.
//!
//! Format: Cox et al. (2004), "A (sort of) new image data format standard: NIfTI-1";
//! <https://nifti.nimh.nih.gov>.

mod header;
mod orientation;
mod source;
mod voxels;
mod write;

pub use header::Version;
pub use orientation::{axis_codes, obliquity};
pub use voxels::VoxelType;
pub use write::{write, write_labels, write_raw_labels};

use crate::{
    Failure,
    labels::{LabelMap, RawLabels, Scribbles, Tissue},
    volume::Volume,
};
use header::Packing;
use source::Source;
use std::path::{Path, PathBuf};

/// Why an image was not read or written, in one line.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum NiftiError {
    /// The file system refused.
    #[error("{}: {cause}", path.display())]
    Io {
        /// File that was touched.
        path: PathBuf,
        /// What the operating system said.
        cause: String,
    },
    /// The content cannot be meant.
    #[error("{}: {field} {what}; {remedy}", path.display())]
    Content {
        /// File that was read or should have been written.
        path: PathBuf,
        /// Header field, or part of the file, that is wrong.
        field: &'static str,
        /// What is wrong with it.
        what: String,
        /// How to mend it.
        remedy: &'static str,
    },
}

impl From<NiftiError> for Failure {
    fn from(error: NiftiError) -> Self {
        match error {
            NiftiError::Io { path, cause } => Self::Io { path, cause },
            content => Self::BadInput(content.to_string()),
        }
    }
}

/// A [`NiftiError::Content`] that does not know its file yet.
struct Refusal {
    field: &'static str,
    what: String,
    remedy: &'static str,
}

impl Refusal {
    fn new(field: &'static str, what: impl Into<String>, remedy: &'static str) -> Self {
        Self { field, what: what.into(), remedy }
    }

    fn at(self, path: &Path) -> NiftiError {
        let Self { field, what, remedy } = self;
        NiftiError::Content { path: path.to_owned(), field, what, remedy }
    }
}

/// An image with `scl_slope` and `scl_inter` applied.
///
/// # Errors
/// When the file is no sound image of one finite real number a voxel, or states no orientation.
pub fn read(path: &Path) -> Result<Volume<f32>, NiftiError> {
    let mut source = Source::open(path)?;
    let values = intensities(&mut source)?;
    Ok(Volume { grid: source.grid, values })
}

/// A label map; the values are those of [`Tissue`].
///
/// # Errors
/// As [`read`], and when a value is the label of no tissue.
pub fn read_labels(path: &Path) -> Result<LabelMap, NiftiError> {
    whole(path, |label| Tissue::from_label(u8::try_from(label).ok()?))
}

/// What a person marked; the values are those of [`Scribbles::from_label`].
///
/// # Errors
/// As [`read`], and when a value marks nothing known.
pub fn read_scribbles(path: &Path) -> Result<Scribbles, NiftiError> {
    whole(path, |label| Scribbles::from_label(u8::try_from(label).ok()?)).map(Scribbles)
}

/// Labels as another program numbers them.
///
/// # Errors
/// As [`read`], and when a value is no whole number from 0 to 65535.
pub fn read_raw_labels(path: &Path) -> Result<RawLabels, NiftiError> {
    whole(path, |label| u16::try_from(label).ok()).map(RawLabels)
}

/// An image of whole numbers.
fn whole<T>(path: &Path, convert: impl Fn(u32) -> Option<T>) -> Result<Volume<T>, NiftiError> {
    let mut source = Source::open(path)?;
    let (slope, inter) = (source.slope, source.inter);
    let values = source.voxels(|stored| {
        let value = slope * stored + inter;
        let whole = value.fract() == 0.0 && (0.0..f64::from(u32::MAX)).contains(&value);
        convert(whole.then_some(value as u32)?)
    })?;
    Ok(Volume { grid: source.grid, values })
}

fn intensities(source: &mut Source) -> Result<Vec<f32>, NiftiError> {
    let (slope, inter) = (source.slope, source.inter);
    source.voxels(|stored| {
        let value = (slope * stored + inter) as f32;
        value.is_finite().then_some(value)
    })
}

/// What a person wants to know about an image file before using it.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Summary {
    /// `nifti-1`, `nifti-2`; `pair` when header and voxels are two files.
    pub format: String,
    /// Number of voxels along i, j, k.
    pub dims: [usize; 3],
    /// Distance between voxels along i, j, k (mm).
    pub spacing_mm: [f64; 3],
    /// Voxel to RAS mm, by rows.
    pub affine: [[f64; 4]; 4],
    /// World directions of i, j, k: see [`axis_codes`].
    pub orientation: String,
    /// Largest angle between a voxel axis and its world axis (degrees).
    pub obliquity_deg: f64,
    /// Stored voxel type, as numpy names it.
    pub dtype: String,
    /// Least and greatest value, scaled.
    pub range: [f32; 2],
    /// What is unusual.
    pub warnings: Vec<String>,
}

/// Reads an image to its end and tells what it is.
///
/// # Errors
/// As [`read`].
pub fn inspect(path: &Path) -> Result<Summary, NiftiError> {
    let mut source = Source::open(path)?;
    let values = intensities(&mut source)?;
    let (low, high) = values.iter().fold((f32::MAX, f32::MIN), |(a, b), &v| (a.min(v), b.max(v)));
    if low == high {
        source.warnings.push(format!("every voxel is {low}"));
    }
    let (grid, header) = (&source.grid, &source.header);
    let version = if header.version == Version::One { "nifti-1" } else { "nifti-2" };
    let packing = if header.packing == Packing::Pair { " pair" } else { "" };
    let row = |n: usize| {
        let axes = grid.axes.row(n);
        [axes[0], axes[1], axes[2], grid.origin[n]]
    };
    Ok(Summary {
        format: format!("{version}{packing}"),
        dims: grid.shape,
        spacing_mm: grid.spacing_mm(),
        affine: [row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]],
        orientation: axis_codes(&grid.axes),
        obliquity_deg: obliquity(&grid.axes).to_degrees(),
        dtype: source.coding.voxel.name().into(),
        range: [low, high],
        warnings: source.warnings,
    })
}
