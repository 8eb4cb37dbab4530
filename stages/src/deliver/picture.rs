//! Mammograms as files for picture programs.

use crate::{
    artifact::{bytes_artifact, bytes_of},
    mammogram::Mammograms,
};
use mammotwin_data::{
    Failure, io::picture, labels::Side, progress::Progress, radiograph::Radiograph, store::Stage,
};
use serde::Serialize;
use std::path::Path;

bytes_artifact!("A TIFF of counted quanta.", TiffFile, "tiff");
bytes_artifact!("An 8-bit PNG for the eye.", PngFile, "png");

/// Counted quanta, pixel by pixel, for measuring.
#[derive(Debug, Clone, Serialize)]
pub struct RawPicture {
    /// Which of the pictures.
    pub number: usize,
}

/// Counted quanta in 16 bits, times the power of two that its description names.
#[derive(Debug, Clone, Serialize)]
pub struct SixteenBits {
    /// Which of the pictures.
    pub number: usize,
}

/// A picture for the eye, hung as mammograms are.
#[derive(Debug, Clone, Serialize)]
pub struct ShownPicture {
    /// Which of the pictures.
    pub number: usize,
    /// Which breast.
    pub side: Side,
}

fn picture(mammograms: &Mammograms, number: usize) -> Result<&Radiograph, Failure> {
    mammograms.pictures.get(number).ok_or_else(|| {
        Failure::BadInput(format!(
            "picture {number}: only {} were taken",
            mammograms.pictures.len()
        ))
    })
}

impl Stage for RawPicture {
    const NAME: &'static str = "tiff";
    const VERSION: u32 = 1;
    const METHODS: &'static str = "";
    type Input = Mammograms;
    type Output = TiffFile;

    fn run(&self, mammograms: &Mammograms, _: &dyn Progress) -> Result<TiffFile, Failure> {
        let signal = picture(mammograms, self.number)?;
        let write = |path: &Path| {
            picture::write_float_tiff(path, signal).map_err(|cause| Failure::io(path, cause))
        };
        bytes_of("picture.tiff", write).map(TiffFile)
    }
}

impl Stage for SixteenBits {
    const NAME: &'static str = "tiff16";
    const VERSION: u32 = 1;
    const METHODS: &'static str = "";
    type Input = Mammograms;
    type Output = TiffFile;

    fn run(&self, mammograms: &Mammograms, _: &dyn Progress) -> Result<TiffFile, Failure> {
        let signal = picture(mammograms, self.number)?;
        let gain = picture::gain16(signal);
        let quantity = format!("{gain} x {}", signal.quantity);
        let named = Radiograph { quantity, ..signal.clone() };
        let write = |path: &Path| {
            picture::write_gray16(path, &named, gain).map_err(|cause| Failure::io(path, cause))
        };
        bytes_of("picture.tiff", write).map(TiffFile)
    }
}

impl Stage for ShownPicture {
    const NAME: &'static str = "png";
    const VERSION: u32 = 1;
    const METHODS: &'static str = "";
    type Input = Mammograms;
    type Output = PngFile;

    fn run(&self, mammograms: &Mammograms, _: &dyn Progress) -> Result<PngFile, Failure> {
        let signal = picture(mammograms, self.number)?;
        let shown = picture::Presentation::of(signal);
        let write = |path: &Path| {
            picture::write_presentation(path, signal, self.side, shown)
                .map_err(|cause| Failure::io(path, cause))
        };
        bytes_of("picture.png", write).map(PngFile)
    }
}
