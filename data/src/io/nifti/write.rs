//! Writes NIfTI files: the same image gives the same bytes.

use super::{
    NiftiError, Refusal, VoxelType,
    header::{SIZE_1, SIZE_2, Version},
};
use crate::{
    Mat3, Vec3,
    labels::{LabelMap, Tissue},
    volume::{Grid, Volume},
};
use flate2::{Compression, GzBuilder};
use std::{
    fs::File,
    io::{BufWriter, Write},
    path::Path,
};

/// Writes an image; gzip when the name ends in `.gz`. The file is closed with its errors checked.
///
/// Integer types hold whole values in their range as they are; other images are scaled to
/// their whole range by `scl_slope` and `scl_inter`. [`Version::One`] keeps the affine in single
/// precision, [`Version::Two`] exactly.
///
/// # Errors
/// When an axis is too long for the version, a value is not finite, the type is none of `U8`,
/// `I16`, `F32`, or the file system refuses.
pub fn write(
    path: &Path,
    image: &Volume<f32>,
    voxel: VoxelType,
    version: Version,
) -> Result<(), NiftiError> {
    if let Some(index) = image.values.iter().position(|v| !v.is_finite()) {
        let what = format!("hold {} at voxel {:?}", image.values[index], image.grid.voxel(index));
        return Err(Refusal::new("voxels", what, "replace values with no meaning").at(path));
    }
    let (slope, inter) = match voxel {
        VoxelType::F32 => (1.0, 0.0),
        VoxelType::I16 => scaling(&image.values, f64::from(i16::MIN), f64::from(i16::MAX)),
        VoxelType::U8 => scaling(&image.values, 0.0, f64::from(u8::MAX)),
        other => {
            let what = format!("{} is not written", other.name());
            return Err(Refusal::new("datatype", what, "choose uint8, int16 or float32").at(path));
        }
    };
    let header = header(&image.grid, voxel, version, [slope, inter]).map_err(|w| w.at(path))?;
    let stored = |v: f32| ((f64::from(v) - inter) / slope).round();
    save(path, &header, &image.values, |v: f32, bytes| match voxel {
        VoxelType::U8 => bytes.push(stored(v) as u8),
        VoxelType::I16 => bytes.extend((stored(v) as i16).to_le_bytes()),
        _ => bytes.extend(v.to_le_bytes()),
    })
}

/// Writes a label map as `uint8`, values as in [`Tissue::label`]; else as [`write()`].
///
/// # Errors
/// As [`write()`].
pub fn write_labels(path: &Path, labels: &LabelMap, version: Version) -> Result<(), NiftiError> {
    let header =
        header(&labels.grid, VoxelType::U8, version, [1.0, 0.0]).map_err(|w| w.at(path))?;
    save(path, &header, &labels.values, |tissue: Tissue, bytes| bytes.push(tissue.label()))
}

/// Writes numbers of labels as `uint16`; else as [`write()`].
///
/// # Errors
/// As [`write()`].
pub fn write_raw_labels(
    path: &Path,
    labels: &Volume<u16>,
    version: Version,
) -> Result<(), NiftiError> {
    let header =
        header(&labels.grid, VoxelType::U16, version, [1.0, 0.0]).map_err(|w| w.at(path))?;
    save(path, &header, &labels.values, |value: u16, bytes| bytes.extend(value.to_le_bytes()))
}

/// Slope and intercept that bring values into an integer range.
fn scaling(values: &[f32], low: f64, high: f64) -> (f64, f64) {
    let fits = |v: &f32| v.fract() == 0.0 && (low..=high).contains(&f64::from(*v));
    if values.iter().all(fits) {
        return (1.0, 0.0);
    }
    let (min, max) = values.iter().fold((f32::MAX, f32::MIN), |(a, b), &v| (a.min(v), b.max(v)));
    let (min, max) = (f64::from(min), f64::from(max));
    // As the header will hold them: in single precision, rounded so that the ends still fit.
    let slope = ((max - min) / (high - low)).max(f64::from(f32::MIN_POSITIVE)) * (1.0 + 1e-6);
    let slope = f64::from(slope as f32);
    (slope, f64::from((min - low * slope) as f32))
}

/// Streams header and voxels to a new file and closes it.
fn save<T: Copy>(
    path: &Path,
    header: &[u8],
    values: &[T],
    encode: impl Fn(T, &mut Vec<u8>),
) -> Result<(), NiftiError> {
    let io =
        |error: std::io::Error| NiftiError::Io { path: path.to_owned(), cause: error.to_string() };
    let fill = |out: &mut dyn Write| -> std::io::Result<()> {
        out.write_all(header)?;
        let mut bytes = Vec::new();
        for part in values.chunks(1 << 16) {
            bytes.clear();
            part.iter().for_each(|&value| encode(value, &mut bytes));
            out.write_all(&bytes)?;
        }
        Ok(())
    };
    let file = BufWriter::new(File::create(path).map_err(io)?);
    let file = if path.extension().is_some_and(|ending| ending == "gz") {
        // No name, no time, no operating system: the bytes depend on the image alone.
        let builder = GzBuilder::new().mtime(0).operating_system(255);
        let mut gzip = builder.write(file, Compression::new(4));
        fill(&mut gzip).map_err(io)?;
        gzip.finish().map_err(io)?
    } else {
        let mut file = file;
        fill(&mut file).map_err(io)?;
        file
    };
    let file = file.into_inner().map_err(|error| io(error.into_error()))?;
    file.sync_all().map_err(io)
}

/// Header and the four bytes that say "no extension".
fn header(
    grid: &Grid,
    voxel: VoxelType,
    version: Version,
    scaling: [f64; 2],
) -> Result<Vec<u8>, Refusal> {
    let most = if version == Version::One { i16::MAX as usize } else { usize::MAX >> 1 };
    if grid.is_empty() || grid.shape.iter().any(|&n| n > most) {
        let what = format!("would be {:?}", grid.shape);
        return Err(Refusal::new(
            "dim",
            what,
            "give an image of 1 to 32767 voxels along each axis",
        ));
    }
    let size = if version == Version::One { SIZE_1 } else { SIZE_2 };
    let mut fields = Fields { bytes: vec![0; size + 4], version };
    fields.fill(grid, voxel, scaling);
    Ok(fields.bytes)
}

/// Header bytes, little-endian.
struct Fields {
    bytes: Vec<u8>,
    version: Version,
}

impl Fields {
    fn fill(&mut self, grid: &Grid, voxel: VoxelType, [slope, inter]: [f64; 2]) {
        let one = self.version == Version::One;
        // Positions: field in NIfTI-1, in NIfTI-2.
        let at = |first: usize, second: usize| if one { first } else { second };
        let (real, size) = if one { (4, SIZE_1) } else { (8, SIZE_2) };
        self.put(0, &(size as i32).to_le_bytes());
        if one {
            self.put(344, b"n+1\0");
        } else {
            self.put(4, b"n+2\0\r\n\x1a\n");
        }
        let [ni, nj, nk] = grid.shape;
        for (n, count) in [3, ni, nj, nk, 1, 1, 1, 1].into_iter().enumerate() {
            match self.version {
                Version::One => self.put(40 + 2 * n, &(count as i16).to_le_bytes()),
                Version::Two => self.put(16 + 8 * n, &(count as i64).to_le_bytes()),
            }
        }
        self.put(at(70, 12), &voxel.code().to_le_bytes());
        self.put(at(72, 14), &(8 * voxel.bytes() as i16).to_le_bytes());
        let qform = Qform::of(&grid.axes);
        let spacing = grid.spacing_mm();
        let pixdim = [qform.as_ref().map_or(1.0, |q| q.handed), spacing[0], spacing[1], spacing[2]];
        for n in 0..8 {
            self.real(at(76, 104) + real * n, pixdim.get(n).copied().unwrap_or(1.0));
        }
        match self.version {
            Version::One => self.real(108, (SIZE_1 + 4) as f64),
            Version::Two => self.put(168, &(SIZE_2 as i64 + 4).to_le_bytes()),
        }
        self.real(at(112, 176), slope);
        self.real(at(116, 184), inter);
        self.put(at(123, 500), &[2]); // millimetres
        self.put(at(252, 344), &[u8::from(qform.is_some())]); // scanner coordinates
        self.put(at(254, 348), &[1]);
        if let Some(qform) = qform {
            for n in 0..3 {
                self.real(at(256, 352) + real * n, qform.quatern[n]);
                self.real(at(268, 376) + real * n, grid.origin[n]);
            }
        }
        for row in 0..3 {
            for column in 0..4 {
                let value = if column < 3 { grid.axes[(row, column)] } else { grid.origin[row] };
                self.real(at(280, 400) + real * (4 * row + column), value);
            }
        }
    }

    fn put(&mut self, at: usize, bytes: &[u8]) {
        self.bytes[at..at + bytes.len()].copy_from_slice(bytes);
    }

    /// A number of the header's precision.
    fn real(&mut self, at: usize, value: f64) {
        match self.version {
            Version::One => self.put(at, &(value as f32).to_le_bytes()),
            Version::Two => self.put(at, &value.to_le_bytes()),
        }
    }
}

/// Rotation part of an affine: quaternion (b, c, d) with a ≥ 0, and the sign of the third axis.
struct Qform {
    quatern: Vec3,
    handed: f64,
}

impl Qform {
    /// `None` when the axes are sheared: no qform can say that.
    fn of(axes: &Mat3) -> Option<Self> {
        let handed = axes.determinant().signum();
        let unit = |n: usize| axes.column(n).try_normalize(0.0);
        let turn = Mat3::from_columns(&[unit(0)?, unit(1)?, unit(2)? * handed]);
        if (turn.transpose() * turn - Mat3::identity()).norm() > 1e-4 {
            return None;
        }
        let turn = nalgebra::Rotation3::from_matrix(&turn);
        let q = nalgebra::UnitQuaternion::from_rotation_matrix(&turn);
        let sign = if q.w < 0.0 { -1.0 } else { 1.0 };
        Some(Self { quatern: sign * Vec3::new(q.i, q.j, q.k), handed })
    }
}
