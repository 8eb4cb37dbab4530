//! X-ray pictures as TIFF and PNG.

use crate::{labels::Side, radiograph::Radiograph};
use image::{
    ExtendedColorType, ImageEncoder,
    codecs::png::{CompressionType, FilterType, PngEncoder},
};
use std::{
    fs::File,
    io::{BufWriter, Seek, Write},
    path::{Path, PathBuf},
};
use tiff::{
    encoder::{
        Rational, TiffEncoder,
        colortype::{ColorType, Gray16, Gray32Float},
    },
    tags::{ResolutionUnit, Tag},
};

/// A picture that was not written.
#[derive(Debug, thiserror::Error)]
#[error("{}: {cause}", path.display())]
pub struct PictureError {
    /// The file.
    pub path: PathBuf,
    /// What is wrong with it.
    pub cause: String,
}

/// Writes the pixels as they are: 32-bit float TIFF, one line for each row, the row at the chest
/// wall first. The quantity is its description, the pixel pitch its resolution.
pub fn write_float_tiff(path: &Path, picture: &Radiograph) -> Result<(), PictureError> {
    save(path, |file| tiff_of::<Gray32Float>(file, picture, &picture.pixels))
}

/// Writes pixels times `counts_per_unit`, rounded and cut to 0..65535, as 16-bit `.png` or `.tif`.
pub fn write_gray16(
    path: &Path,
    picture: &Radiograph,
    counts_per_unit: f64,
) -> Result<(), PictureError> {
    let count = |&pixel: &f32| (f64::from(pixel) * counts_per_unit).round() as u16;
    let counts: Vec<u16> = picture.pixels.iter().map(count).collect();
    match path.extension().and_then(|e| e.to_str()) {
        Some("tif" | "tiff") => save(path, |file| tiff_of::<Gray16>(file, picture, &counts)),
        Some("png") => {
            let bytes: Vec<u8> = counts.iter().flat_map(|count| count.to_ne_bytes()).collect();
            let size = [picture.columns, picture.rows];
            save(path, |file| png(file, &bytes, size, ExtendedColorType::L16))
        }
        _ => {
            let cause = "16-bit pictures end in .png, .tif or .tiff".into();
            Err(PictureError { path: path.into(), cause })
        }
    }
}

/// The largest power of two, at most 1, with which a signal fits into 16 bits.
pub fn gain16(signal: &Radiograph) -> f64 {
    let brightest = signal.pixels.iter().fold(0f32, |most, &pixel| most.max(pixel));
    let mut gain = 1.0;
    while f64::from(brightest) * gain > f64::from(u16::MAX) && brightest.is_finite() {
        gain *= 0.5;
    }
    gain
}

/// Attenuations ln(brightest signal / signal) that are shown black and white.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Presentation {
    /// Shown black.
    pub black: f64,
    /// Shown white.
    pub white: f64,
}

impl Presentation {
    /// White a little above the densest permille of the picture, black at half of the densest.
    pub fn of(signal: &Radiograph) -> Self {
        let mut sorted = attenuation(signal);
        let last = sorted.len().saturating_sub(1);
        let rank = last - last / 1000;
        let densest = if sorted.is_empty() {
            1.0
        } else {
            *sorted.select_nth_unstable_by(rank, f64::total_cmp).1
        };
        Self { black: 0.5 * densest, white: 1.05 * densest }
    }
}

/// Writes a signal for the eye, as 8-bit `.png`: logarithmic, dense is bright, and turned as
/// mammograms are hung: chest wall at the right for the right breast and at the left for
/// the left one, the lateral side of a craniocaudal view on top.
pub fn write_presentation(
    path: &Path,
    signal: &Radiograph,
    side: Side,
    window: Presentation,
) -> Result<(), PictureError> {
    let scale = 255.0 / (window.white - window.black);
    let gray: Vec<u8> =
        attenuation(signal).iter().map(|a| ((a - window.black) * scale).round() as u8).collect();
    let hung = hang(&gray, signal, side);
    let (columns, rows) = (signal.columns, signal.rows);
    save(path, |file| png(file, &hung, [rows, columns], ExtendedColorType::L8))
}

/// Pixels turned as mammograms are hung: lines of `rows` pixels, `columns` of them.
pub(super) fn hang<T: Copy>(pixels: &[T], picture: &Radiograph, side: Side) -> Vec<T> {
    // Seen from above with x to the right and y up, the right breast is turned by +90 degrees
    // and the left one by -90: never mirrored.
    let (columns, rows) = (picture.columns, picture.rows);
    (0..columns * rows)
        .map(|n| {
            let (line, across) = (n / rows, n % rows);
            match side {
                Side::Right => pixels[(rows - 1 - across) * columns + (columns - 1 - line)],
                Side::Left => pixels[across * columns + line],
            }
        })
        .collect()
}

/// ln(brightest / pixel); pixels without signal are as dense as one quantum.
pub(super) fn attenuation(signal: &Radiograph) -> Vec<f64> {
    let brightest = signal.pixels.iter().fold(1f32, |most, &pixel| most.max(pixel));
    let of = |pixel: &f32| f64::from(brightest / pixel.max(1.0)).ln();
    signal.pixels.iter().map(of).collect()
}

/// Fills a new file and closes it with its errors checked.
pub(super) fn save(
    path: &Path,
    fill: impl FnOnce(&mut BufWriter<File>) -> Result<(), String>,
) -> Result<(), PictureError> {
    let failed = |cause: String| PictureError { path: path.into(), cause };
    let mut file = BufWriter::new(File::create(path).map_err(|e| failed(e.to_string()))?);
    fill(&mut file).map_err(failed)?;
    let file = file.into_inner().map_err(|e| failed(e.to_string()))?;
    file.sync_all().map_err(|e| failed(e.to_string()))
}

fn tiff_of<C: ColorType>(
    file: &mut (impl Write + Seek),
    picture: &Radiograph,
    pixels: &[C::Inner],
) -> Result<(), String>
where
    [C::Inner]: tiff::encoder::TiffValue,
{
    let write = || -> Result<(), tiff::TiffError> {
        let mut tiff = TiffEncoder::new(file)?;
        let mut image = tiff.new_image::<C>(picture.columns as u32, picture.rows as u32)?;
        image.encoder().write_tag(Tag::ImageDescription, picture.quantity.as_str())?;
        let per_cm = Rational { n: (10_000.0 / picture.pitch_mm).round() as u32, d: 1000 };
        image.resolution(ResolutionUnit::Centimeter, per_cm);
        image.write_data(pixels)
    };
    write().map_err(|e| e.to_string())
}

fn png(
    file: &mut impl Write,
    bytes: &[u8],
    [width, height]: [usize; 2],
    color: ExtendedColorType,
) -> Result<(), String> {
    PngEncoder::new_with_quality(file, CompressionType::Fast, FilterType::Adaptive)
        .write_image(bytes, width as u32, height as u32, color)
        .map_err(|e| e.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;
    use tiff::decoder::{Decoder, DecodingResult};

    /// 4 columns, 3 rows; pixel (row, column) holds e^-(10 row + column), times 1e9.
    fn picture() -> Radiograph {
        let value = |n: usize| 1e9 * (-((n / 4 * 10 + n % 4) as f32) / 10.0).exp();
        Radiograph {
            columns: 4,
            rows: 3,
            pitch_mm: 0.1,
            left_mm: -0.15,
            first_row_mm: 0.05,
            pixels: (0..12).map(value).collect(),
            quantity: "counted quanta per pixel".into(),
        }
    }

    #[test]
    fn a_float_tiff_gives_back_the_same_bits_and_says_what_they_are() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("signal.tif");
        write_float_tiff(&path, &picture()).unwrap();
        let mut tiff = Decoder::new(std::io::BufReader::new(File::open(&path).unwrap())).unwrap();
        assert_eq!(tiff.dimensions().unwrap(), (4, 3));
        assert_eq!(tiff.get_tag_ascii_string(Tag::ImageDescription).unwrap(), picture().quantity);
        let DecodingResult::F32(pixels) = tiff.read_image().unwrap() else { panic!("not float") };
        assert_eq!(pixels, picture().pixels);
        let first = std::fs::read(&path).unwrap();
        write_float_tiff(&path, &picture()).unwrap();
        assert_eq!(first, std::fs::read(&path).unwrap());
    }

    #[test]
    fn sixteen_bits_are_rounded_and_cut() {
        let folder = tempfile::tempdir().unwrap();
        let mut faint = picture();
        faint.pixels[..4].copy_from_slice(&[-3.0, 0.2, 20_000.4, 1e9]);
        for name in ["raw.png", "raw.tif"] {
            let path = folder.path().join(name);
            write_gray16(&path, &faint, 2.0).unwrap();
            let read = image::open(&path).unwrap().into_luma16();
            assert_eq!(read.dimensions(), (4, 3));
            assert_eq!(read.as_raw()[..4], [0, 0, 40_001, 65_535], "{name}");
        }
        let refused = write_gray16(&folder.path().join("raw.jpg"), &faint, 1.0).unwrap_err();
        assert!(refused.to_string().contains(".png, .tif"), "{refused}");
    }

    /// Row 0 is the chest wall, the last column the person's right.
    #[test]
    fn pictures_hang_as_mammograms_and_are_not_mirrored() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("shown.png");
        let window = Presentation { black: 0.0, white: 25.5 };
        let hang = |side| {
            write_presentation(&path, &picture(), side, window).unwrap();
            let read = image::open(&path).unwrap().into_luma8();
            assert_eq!(read.dimensions(), (3, 4));
            // Gray is 10 row + column.
            [(0, 0), (2, 0), (0, 3), (2, 3)].map(|(across, line)| read.get_pixel(across, line).0[0])
        };
        // Right breast: lateral (last column) on top, chest wall (row 0) at the right.
        assert_eq!(hang(Side::Right), [23, 3, 20, 0]);
        // Left breast: lateral (column 0) on top, chest wall at the left.
        assert_eq!(hang(Side::Left), [0, 20, 3, 23]);
    }

    #[test]
    fn a_file_that_cannot_be_written_is_named() {
        let nowhere = Path::new("/no/such/folder/signal.tif");
        let error = write_float_tiff(nowhere, &picture()).unwrap_err().to_string();
        assert!(error.starts_with("/no/such/folder/signal.tif: "), "{error}");
        if Path::new("/dev/full").exists() {
            let mut large = picture();
            (large.columns, large.rows, large.pixels) = (200, 200, vec![1.0; 40_000]);
            let full = Path::new("/dev/full");
            assert!(write_float_tiff(full, &large).is_err());
        }
    }
}
