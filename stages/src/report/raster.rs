//! Pictures in memory, and their PNG bytes.

use base64::Engine;
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
        png(&bytes, [self.width, self.height], color)
    }

    /// The picture as a `data:` address for HTML.
    pub fn data_uri(&self) -> String {
        address(&self.png())
    }
}

/// A picture that covers a part of its rectangle: what is behind it shows through the rest.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Cutout {
    /// The colours; any where nothing is covered.
    pub picture: Raster,
    /// How much of each pixel is covered: 0 nothing, 255 all.
    pub cover: Vec<u8>,
}

impl Cutout {
    /// A picture that covers nothing yet.
    pub fn empty(width: usize, height: usize) -> Self {
        Self { picture: Raster::filled(width, height, [0; 3]), cover: vec![0; width * height] }
    }

    /// Half the size, each pixel the mean of four: what was drawn twice too large gets smooth
    /// edges.
    pub fn halved(&self) -> Self {
        let wide = self.picture.width;
        let mut small = Self::empty(wide / 2, self.picture.height / 2);
        for n in 0..small.cover.len() {
            let at = 2 * (n / small.picture.width) * wide + 2 * (n % small.picture.width);
            let four = [at, at + 1, at + wide, at + wide + 1];
            let cover: u32 = four.iter().map(|&at| u32::from(self.cover[at])).sum();
            small.cover[n] = ((cover + 2) / 4) as u8;
            if cover > 0 {
                small.picture.pixels[n] = [0, 1, 2].map(|c| {
                    let part = |&at: &usize| {
                        u32::from(self.picture.pixels[at][c]) * u32::from(self.cover[at])
                    };
                    ((four.iter().map(part).sum::<u32>() + cover / 2) / cover) as u8
                });
            }
        }
        small
    }

    /// The picture on a ground of one colour.
    pub fn on(&self, ground: Rgb) -> Raster {
        let Raster { width, height, .. } = self.picture;
        let mix = |(pixel, cover): (&Rgb, &u8)| {
            let cover = u32::from(*cover);
            [0, 1, 2].map(|c| {
                let sum = u32::from(pixel[c]) * cover + u32::from(ground[c]) * (255 - cover);
                ((sum + 127) / 255) as u8
            })
        };
        let pixels = self.picture.pixels.iter().zip(&self.cover).map(mix).collect();
        Raster { width, height, pixels }
    }

    /// The picture as a `data:` address for HTML, its ground transparent.
    pub fn data_uri(&self) -> String {
        let Raster { width, height, pixels } = &self.picture;
        let four = |([r, g, b], cover): (&Rgb, &u8)| [*r, *g, *b, *cover];
        let bytes: Vec<u8> = pixels.iter().zip(&self.cover).flat_map(four).collect();
        address(&png(&bytes, [*width, *height], ExtendedColorType::Rgba8))
    }
}

fn png(bytes: &[u8], [width, height]: [usize; 2], color: ExtendedColorType) -> Vec<u8> {
    let mut file = Vec::new();
    let (compression, filter) = (png::CompressionType::Best, png::FilterType::Adaptive);
    png::PngEncoder::new_with_quality(&mut file, compression, filter)
        .write_image(bytes, width as u32, height as u32, color)
        .expect("a picture in memory has as many pixels as it says");
    file
}

fn address(png: &[u8]) -> String {
    let text = base64::engine::general_purpose::STANDARD.encode(png);
    format!("data:image/png;base64,{text}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_edge_has_its_own_colour_and_lets_the_ground_through() {
        let mut large = Cutout::empty(4, 2);
        for n in [0, 1, 4] {
            large.picture.pixels[n] = [200, 100, 0];
            large.cover[n] = 255;
        }
        let small = large.halved();
        // Three of four are covered on the left, none on the right.
        assert_eq!((small.picture.width, small.picture.height), (2, 1));
        assert_eq!(small.cover, [191, 0]);
        assert_eq!(small.picture.pixels[0], [200, 100, 0], "no mixture with the ground");
        assert_eq!(small.on([255; 3]).pixels, [[214, 139, 64], [255; 3]]);
        assert_eq!(small.on([0; 3]).pixels, [[150, 75, 0], [0; 3]]);
    }
}
