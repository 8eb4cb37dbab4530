//! The bytes of an image file, plain or compressed, and where its voxels begin.

use super::{NiftiError, Refusal, header::*, orientation, voxels::*};
use crate::volume::Grid;
use flate2::bufread::MultiGzDecoder;
use std::{
    fs::File,
    io::{BufRead, BufReader, ErrorKind, Read},
    path::{Path, PathBuf},
};

/// More voxels are refused: 2 GiB of `f32`.
const MOST_VOXELS: u64 = 1 << 29;
/// Header extensions beyond this are refused (bytes).
const MOST_EXTENSION: f64 = (16 << 20) as f64;
/// DEFLATE cannot shrink further than this.
const MOST_DEFLATION: u64 = 1032;
/// Images beyond [`LARGE`] that shrank further than this hold nothing: a decompression bomb.
const BOMB_DEFLATION: u64 = 900;
/// Bytes from which on compression is looked at.
const LARGE: u64 = 64 << 20;
/// Bytes after the voxels that are taken for padding.
const PADDING: u64 = 4096;

/// A checked header, and a reader that stands at the first voxel.
pub(super) struct Source {
    pub path: PathBuf,
    pub header: Header,
    pub grid: Grid,
    pub coding: Coding,
    pub slope: f64,
    pub inter: f64,
    pub warnings: Vec<String>,
    bytes: Bytes,
}

/// A file, decompressed when its content (not its name) is gzip.
struct Bytes {
    reader: Box<dyn Read>,
    file_bytes: u64,
    gzip: bool,
}

impl Source {
    /// Opens a `.nii`, `.nii.gz` or either file of a `.hdr`, `.img` pair; nothing large is
    /// allocated before the header and the length of the file agree.
    pub fn open(path: &Path) -> Result<Self, NiftiError> {
        let (header_path, voxel_path) = pair(path);
        let mut bytes = Bytes::open(&header_path)?;
        let header = bytes.header().map_err(|why| why.at(&header_path))?;
        let mut warnings = Vec::new();
        let bad = |why: Refusal| why.at(path);
        let shape = shape(&header).map_err(bad)?;
        let voxel = VoxelType::of(header.datatype, header.bitpix).map_err(bad)?;
        let grid = orientation::grid(&header, shape, &mut warnings).map_err(bad)?;
        let (slope, inter) = scaling(&header, &mut warnings).map_err(bad)?;
        let (least, read) = match (header.packing, header.version) {
            (Packing::Single, Version::One) => (SIZE_1 + 4, SIZE_1),
            (Packing::Single, Version::Two) => (SIZE_2 + 4, SIZE_2),
            (Packing::Pair, _) => (0, 0),
        };
        let offset = vox_offset(&header, least).map_err(bad)?;
        if header.packing == Packing::Pair {
            let Some(voxel_path) = voxel_path else {
                return Err(bad(Refusal::new(
                    "magic",
                    "is that of a .hdr and .img pair",
                    "name the header .hdr and put the .img beside it",
                )));
            };
            bytes = Bytes::open(&voxel_path)?;
        }
        let coding = Coding { voxel, big_endian: header.big_endian, count: grid.len() };
        let data = (grid.len() * voxel.bytes()) as u64;
        bytes.fits(offset, data).map_err(bad)?;
        bytes.skip(offset - read as u64).map_err(bad)?;
        let path = path.to_owned();
        Ok(Self { path, header, grid, coding, slope, inter, warnings, bytes })
    }

    /// All voxels, then the end of the file with its checksum.
    pub fn voxels<T>(&mut self, convert: impl Fn(f64) -> Option<T>) -> Result<Vec<T>, NiftiError> {
        let values = decode(&mut self.bytes.reader, self.coding, convert).map_err(|stop| {
            match stop {
                Stop::Reading(error) => reading("the voxels", &error),
                Stop::Value(index, value) => {
                    let voxel = self.grid.voxel(index);
                    let what = format!("hold {value} at voxel {voxel:?}");
                    Refusal::new("voxels", what, "replace values that have no meaning")
                }
            }
            .at(&self.path)
        })?;
        let mut sink = std::io::sink();
        let after = std::io::copy(&mut (&mut self.bytes.reader).take(PADDING + 1), &mut sink)
            .map_err(|error| reading("the end of the file", &error).at(&self.path))?;
        if after > PADDING {
            let what = format!("states {:?} voxels, but the file goes on", self.grid.shape);
            let remedy = "the header is damaged: export the image again";
            return Err(Refusal::new("dim", what, remedy).at(&self.path));
        }
        if after > 0 {
            self.warnings.push(format!("{after} bytes after the voxels are ignored"));
        }
        Ok(values)
    }
}

impl Bytes {
    fn open(path: &Path) -> Result<Self, NiftiError> {
        let io = |error: std::io::Error| NiftiError::Io {
            path: path.to_owned(),
            cause: error.to_string(),
        };
        let about = std::fs::metadata(path).map_err(io)?;
        let empty = |what: &str| Refusal::new("file", what, "give a NIfTI image").at(path);
        if !about.is_file() {
            return Err(empty("is no regular file"));
        }
        if about.len() == 0 {
            return Err(empty("is empty"));
        }
        let mut plain = BufReader::with_capacity(1 << 16, File::open(path).map_err(io)?);
        let gzip = plain.fill_buf().map_err(io)?.starts_with(&[0x1f, 0x8b]);
        let reader: Box<dyn Read> =
            if gzip { Box::new(MultiGzDecoder::new(plain)) } else { Box::new(plain) };
        Ok(Self { reader, file_bytes: about.len(), gzip })
    }

    fn header(&mut self) -> Result<Header, Refusal> {
        let mut bytes = vec![0; SIZE_2];
        let short = |error: std::io::Error| reading("the header", &error);
        self.reader.read_exact(&mut bytes[..4]).map_err(short)?;
        let (version, big_endian) = Header::kind([bytes[0], bytes[1], bytes[2], bytes[3]])?;
        bytes.truncate(if version == Version::One { SIZE_1 } else { SIZE_2 });
        self.reader.read_exact(&mut bytes[4..]).map_err(short)?;
        Header::parse(&bytes, version, big_endian)
    }

    /// Whether a file of this length can hold so much data.
    fn fits(&self, offset: u64, data: u64) -> Result<(), Refusal> {
        let needed = offset + data;
        let most = if self.gzip { self.file_bytes * MOST_DEFLATION } else { self.file_bytes };
        if needed > most {
            return Err(Refusal::new(
                "dim",
                format!("asks for {needed} bytes, but the file can hold only {most}"),
                "the file is cut short or its header damaged: copy or export it again",
            ));
        }
        if self.gzip && needed > LARGE && needed > BOMB_DEFLATION * self.file_bytes {
            return Err(Refusal::new(
                "dim",
                format!("{} compressed bytes would become {needed}", self.file_bytes),
                "an image of one value is no image: give another",
            ));
        }
        Ok(())
    }

    fn skip(&mut self, count: u64) -> Result<(), Refusal> {
        let mut part = (&mut self.reader).take(count);
        let skipped = std::io::copy(&mut part, &mut std::io::sink())
            .map_err(|error| reading("the header extensions", &error))?;
        if skipped < count {
            return Err(reading("the header extensions", &ErrorKind::UnexpectedEof.into()));
        }
        Ok(())
    }
}

/// Header file and voxel file of a path; no voxel file when the name is that of neither.
fn pair(path: &Path) -> (PathBuf, Option<PathBuf>) {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let (stem, gz) = name.strip_suffix(".gz").map_or((&*name, ""), |stem| (stem, ".gz"));
    let beside = |stem: &str, ending: &str| {
        let same = path.with_file_name(format!("{stem}{ending}{gz}"));
        let other = if gz.is_empty() { ".gz" } else { "" };
        let other = path.with_file_name(format!("{stem}{ending}{other}"));
        if !same.exists() && other.exists() { other } else { same }
    };
    if let Some(stem) = stem.strip_suffix(".hdr") {
        (path.to_owned(), Some(beside(stem, ".img")))
    } else if let Some(stem) = stem.strip_suffix(".img") {
        (beside(stem, ".hdr"), Some(path.to_owned()))
    } else {
        (path.to_owned(), None)
    }
}

/// Voxels along i, j, k; further axes must have one entry.
fn shape(header: &Header) -> Result<[usize; 3], Refusal> {
    let dim = &header.dim;
    let refuse = |what: String, remedy: &'static str| Err(Refusal::new("dim", what, remedy));
    if !(1..=7).contains(&dim[0]) {
        return refuse(
            format!("[0] is {}, an image has 1 to 7 axes", dim[0]),
            "the header is damaged: export the image again",
        );
    }
    let mut shape = [1u64; 3];
    let mut total = 1u64;
    for axis in 1..=dim[0] as usize {
        let count = match u64::try_from(dim[axis]) {
            Ok(count) if count > 0 => count,
            _ => {
                return refuse(
                    format!("[{axis}] is {}, it must be positive", dim[axis]),
                    "the header is damaged: export the image again",
                );
            }
        };
        if axis > 3 && count > 1 {
            return refuse(
                format!("[{axis}] is {count}: this is a series of images"),
                "give one image: split the series",
            );
        }
        if axis <= 3 {
            shape[axis - 1] = count;
        }
        total = total.saturating_mul(count);
    }
    if total > MOST_VOXELS {
        return refuse(
            format!("asks for {total} voxels, at most {MOST_VOXELS} are read"),
            "crop the image, or average voxels",
        );
    }
    Ok(shape.map(|count| count as usize))
}

/// Slope and intercept of stored values. A slope of 0 or none means values as they are stored.
fn scaling(header: &Header, warnings: &mut Vec<String>) -> Result<(f64, f64), Refusal> {
    let (slope, inter) = (header.scl_slope, header.scl_inter);
    if !slope.is_finite() {
        warnings.push(format!("scl_slope is {slope}: stored values are taken as they are"));
    }
    if slope == 0.0 || !slope.is_finite() {
        return Ok((1.0, 0.0));
    }
    if !inter.is_finite() {
        return Err(Refusal::new(
            "scl_inter",
            format!("is {inter}"),
            "set it to 0, or to the intercept that is meant",
        ));
    }
    Ok((slope, inter))
}

fn vox_offset(header: &Header, least: usize) -> Result<u64, Refusal> {
    let offset = header.vox_offset;
    let sound = offset.fract() == 0.0 && (least as f64..=MOST_EXTENSION).contains(&offset);
    if !sound {
        return Err(Refusal::new(
            "vox_offset",
            format!("is {offset}, it must be a whole number from {least} to {MOST_EXTENSION}"),
            "the header is damaged: export the image again",
        ));
    }
    Ok(offset as u64)
}

/// What an error of reading says about the file.
fn reading(part: &str, error: &std::io::Error) -> Refusal {
    let what = match error.kind() {
        ErrorKind::UnexpectedEof => format!("is cut short in {part}"),
        ErrorKind::InvalidData | ErrorKind::InvalidInput => {
            format!("is damaged in {part}: gzip says {error}")
        }
        _ => format!("cannot be read in {part}: {error}"),
    };
    Refusal::new("file", what, "copy or export it again")
}
