//! From the results of the stages to the files that people open: `results.h5` and `report.html`.

mod hdf5;
mod html;
mod picture;
mod scenes;
mod sections;

pub use hdf5::{Deliver, ResultsFile};
pub use html::{Report, ReportFile};
pub use picture::{PngFile, RawPicture, ShownPicture, TiffFile};
