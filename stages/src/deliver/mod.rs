//! From the results of the stages to the files that people open: `results.h5` and `report.html`.

mod clamping;
mod dicom;
mod fits;
mod hdf5;
mod html;
mod measured;
mod picture;
mod scenes;
mod sections;
mod voxels;

pub use dicom::{DicomFile, DicomPicture};
pub use hdf5::{Deliver, ResultsFile};
pub use html::{Report, ReportFile};
pub use picture::{PngFile, RawPicture, ShownPicture, SixteenBits, TiffFile};
pub use voxels::{LabelsLegend, LabelsMeta, LabelsNifti, PhantomLegend, PhantomMeta, PhantomNifti};
