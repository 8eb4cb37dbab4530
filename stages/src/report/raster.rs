//! Pictures in memory, and their PNG bytes.

use image::{ExtendedColorType, ImageEncoder, codecs::png};

/// A colour: red, green, blue.
pub type Rgb = [u8; 3];

/// Pixels row by row from the top left.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Raster {
    /// Pixels in a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// The pixels.
    pub pixels: Vec<Rgb>,
}

impl Raster {
    /// A picture of one colour.
    pub fn filled(width: usize, height: usize, color: Rgb) -> Self {
        Self { width, height, pixels: vec![color; width * height] }
    }

    /// PNG file of the picture; in grey when no pixel has a colour.
    pub fn png(&self) -> Vec<u8> {
        let grey = self.pixels.iter().all(|[r, g, b]| r == g && g == b);
        let (bytes, color) = if grey {
            (self.pixels.iter().map(|pixel| pixel[0]).collect(), ExtendedColorType::L8)
        } else {
            (self.pixels.as_flattened().to_vec(), ExtendedColorType::Rgb8)
        };
        let mut file = Vec::new();
        let (compression, filter) = (png::CompressionType::Best, png::FilterType::Adaptive);
        png::PngEncoder::new_with_quality(&mut file, compression, filter)
            .write_image(&bytes, self.width as u32, self.height as u32, color)
            .expect("a picture in memory has as many pixels as it says");
        file
    }

    /// The picture as a `data:` address for HTML.
    pub fn data_uri(&self) -> String {
        use base64::Engine;
        let text = base64::engine::general_purpose::STANDARD.encode(self.png());
        format!("data:image/png;base64,{text}")
    }

    /// Half the size, each pixel the mean of four: what was drawn twice too large gets smooth
    /// edges.
    pub fn halved(&self) -> Self {
        let (width, height) = (self.width / 2, self.height / 2);
        let mean = |n: usize| {
            let at = 2 * (n / width) * self.width + 2 * (n % width);
            let four = [at, at + 1, at + self.width, at + self.width + 1];
            [0, 1, 2].map(|c| {
                let sum: u32 = four.iter().map(|&at| u32::from(self.pixels[at][c])).sum();
                ((sum + 2) / 4) as u8
            })
        };
        Self { width, height, pixels: (0..width * height).map(mean).collect() }
    }
}
