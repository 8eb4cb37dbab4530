//! Label volumes as MetaImage (`.mha`), which ITK, GATE and many simulators read.

use crate::volume::Grid;
use flate2::{Compression, write::ZlibEncoder};
use std::io::Write;

/// A volume of bytes as a MetaImage file, compressed. World coordinates of the grid are taken as
/// right-anterior-superior; the file has ITK's left-posterior-superior.
///
/// # Errors
/// When the values are not as many as the voxels of the grid.
pub fn labels_mha(grid: &Grid, values: &[u8]) -> std::io::Result<Vec<u8>> {
    if values.len() != grid.len() {
        let text = format!("{} values for {} voxels", values.len(), grid.len());
        return Err(std::io::Error::new(std::io::ErrorKind::InvalidInput, text));
    }
    let mut zlib = ZlibEncoder::new(Vec::new(), Compression::new(4));
    zlib.write_all(values)?;
    let packed = zlib.finish()?;
    let spacing = grid.spacing_mm();
    let flip = [-1.0, -1.0, 1.0];
    let words = |numbers: &[f64]| {
        // No negative zero.
        numbers.iter().map(|n| (n + 0.0).to_string()).collect::<Vec<_>>().join(" ")
    };
    let directions: Vec<f64> =
        (0..9).map(|n| flip[n % 3] * grid.axes[(n % 3, n / 3)] / spacing[n / 3]).collect();
    let offset = [0, 1, 2].map(|n| flip[n] * grid.origin[n]);
    let [i, j, k] = grid.shape;
    let header = format!(
        "ObjectType = Image\nNDims = 3\nBinaryData = True\nBinaryDataByteOrderMSB = False\n\
         CompressedData = True\nCompressedDataSize = {}\nTransformMatrix = {}\nOffset = {}\n\
         CenterOfRotation = 0 0 0\nElementSpacing = {}\nDimSize = {i} {j} {k}\n\
         ElementType = MET_UCHAR\nElementDataFile = LOCAL\n",
        packed.len(),
        words(&directions),
        words(&offset),
        words(&spacing)
    );
    Ok([header.as_bytes(), &packed].concat())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Vec3;
    use std::io::Read;

    #[test]
    fn header_and_voxels_come_back() {
        let grid = Grid::aligned([3, 2, 1], [0.5, 1.0, 2.0], Vec3::new(-7.0, 3.0, 0.25));
        let bytes = labels_mha(&grid, &[0, 1, 2, 3, 2, 1]).unwrap();
        let start = bytes.windows(6).position(|w| w == b"LOCAL\n").unwrap() + 6;
        let header = std::str::from_utf8(&bytes[..start]).unwrap();
        for line in [
            "TransformMatrix = -1 0 0 0 -1 0 0 0 1",
            "Offset = 7 -3 0.25",
            "ElementSpacing = 0.5 1 2",
            "DimSize = 3 2 1",
        ] {
            assert!(header.lines().any(|l| l == line), "{line} in {header}");
        }
        let mut values = vec![];
        flate2::read::ZlibDecoder::new(&bytes[start..]).read_to_end(&mut values).unwrap();
        assert_eq!(values, [0, 1, 2, 3, 2, 1]);
        assert!(labels_mha(&grid, &[0]).is_err());
    }
}
