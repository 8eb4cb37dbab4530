//! From the results of the stages to the files that people open: `results.h5` and `report.html`.

mod html;
mod hdf5;
mod sections;

pub use hdf5::{Deliver, ResultsFile};
pub use html::{Report, ReportFile};
