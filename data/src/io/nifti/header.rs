//! The fields of a NIfTI header, as the file states them.

use super::Refusal;

/// Bytes of a NIfTI-1 header.
pub(super) const SIZE_1: usize = 348;
/// Bytes of a NIfTI-2 header.
pub(super) const SIZE_2: usize = 540;

/// Generation of the format.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Version {
    /// NIfTI-1: known to every program; affine in single precision.
    #[default]
    One,
    /// NIfTI-2: affine in double precision.
    Two,
}

/// Whether header and voxels share a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Packing {
    /// `.nii`.
    Single,
    /// `.hdr` and `.img`.
    Pair,
}

/// Header fields that this project reads. Free text is left unread: it may name the person.
#[derive(Debug, Clone)]
pub(super) struct Header {
    pub version: Version,
    pub big_endian: bool,
    pub packing: Packing,
    pub dim: [i64; 8],
    pub datatype: i16,
    pub bitpix: i16,
    pub pixdim: [f64; 8],
    pub vox_offset: f64,
    pub scl_slope: f64,
    pub scl_inter: f64,
    pub xyzt_units: i32,
    pub qform_code: i32,
    pub sform_code: i32,
    pub quatern: [f64; 3],
    pub qoffset: [f64; 3],
    pub srow: [[f64; 4]; 3],
}

impl Header {
    /// Size of the header and byte order, from its first four bytes.
    pub fn kind(first: [u8; 4]) -> Result<(Version, bool), Refusal> {
        let sizes = [(SIZE_1, Version::One), (SIZE_2, Version::Two)];
        for (size, version) in sizes {
            let size = size as u32;
            if first == size.to_le_bytes() {
                return Ok((version, false));
            }
            if first == size.to_be_bytes() {
                return Ok((version, true));
            }
        }
        let stated = i32::from_le_bytes(first);
        Err(Refusal::new(
            "sizeof_hdr",
            format!("is {stated}, a NIfTI file has 348 or 540"),
            "give a NIfTI-1 or NIfTI-2 image (.nii, .nii.gz, .hdr with .img)",
        ))
    }

    /// Fields of a whole header of [`SIZE_1`] or [`SIZE_2`] bytes.
    pub fn parse(bytes: &[u8], version: Version, big_endian: bool) -> Result<Self, Refusal> {
        let fields = Fields { bytes, big_endian };
        match version {
            Version::One => fields.version_1(),
            Version::Two => fields.version_2(),
        }
    }
}

/// Numbers at byte positions, in the byte order of the file.
struct Fields<'a> {
    bytes: &'a [u8],
    big_endian: bool,
}

impl Fields<'_> {
    fn version_1(&self) -> Result<Header, Refusal> {
        let packing = match &self.bytes[344..348] {
            b"n+1\0" => Packing::Single,
            b"ni1\0" => Packing::Pair,
            _ => return Err(wrong_magic()),
        };
        Ok(Header {
            version: Version::One,
            big_endian: self.big_endian,
            packing,
            dim: std::array::from_fn(|n| i64::from(self.i16(40 + 2 * n))),
            datatype: self.i16(70),
            bitpix: self.i16(72),
            pixdim: std::array::from_fn(|n| self.f32(76 + 4 * n)),
            vox_offset: self.f32(108),
            scl_slope: self.f32(112),
            scl_inter: self.f32(116),
            xyzt_units: i32::from(self.bytes[123]),
            qform_code: i32::from(self.i16(252)),
            sform_code: i32::from(self.i16(254)),
            quatern: std::array::from_fn(|n| self.f32(256 + 4 * n)),
            qoffset: std::array::from_fn(|n| self.f32(268 + 4 * n)),
            srow: std::array::from_fn(|row| {
                std::array::from_fn(|column| self.f32(280 + 16 * row + 4 * column))
            }),
        })
    }

    fn version_2(&self) -> Result<Header, Refusal> {
        let packing = match &self.bytes[4..12] {
            b"n+2\0\r\n\x1a\n" => Packing::Single,
            b"ni2\0\r\n\x1a\n" => Packing::Pair,
            _ => return Err(wrong_magic()),
        };
        Ok(Header {
            version: Version::Two,
            big_endian: self.big_endian,
            packing,
            dim: std::array::from_fn(|n| self.i64(16 + 8 * n)),
            datatype: self.i16(12),
            bitpix: self.i16(14),
            pixdim: std::array::from_fn(|n| self.f64(104 + 8 * n)),
            vox_offset: self.i64(168) as f64,
            scl_slope: self.f64(176),
            scl_inter: self.f64(184),
            xyzt_units: self.i32(500),
            qform_code: self.i32(344),
            sform_code: self.i32(348),
            quatern: std::array::from_fn(|n| self.f64(352 + 8 * n)),
            qoffset: std::array::from_fn(|n| self.f64(376 + 8 * n)),
            srow: std::array::from_fn(|row| {
                std::array::from_fn(|column| self.f64(400 + 32 * row + 8 * column))
            }),
        })
    }

    /// Little-endian bytes of the number at a position.
    fn little<const N: usize>(&self, at: usize) -> [u8; N] {
        let bytes = &self.bytes[at..at + N];
        std::array::from_fn(|n| if self.big_endian { bytes[N - 1 - n] } else { bytes[n] })
    }

    fn i16(&self, at: usize) -> i16 {
        i16::from_le_bytes(self.little(at))
    }

    fn i32(&self, at: usize) -> i32 {
        i32::from_le_bytes(self.little(at))
    }

    fn i64(&self, at: usize) -> i64 {
        i64::from_le_bytes(self.little(at))
    }

    fn f32(&self, at: usize) -> f64 {
        f64::from(f32::from_le_bytes(self.little(at)))
    }

    fn f64(&self, at: usize) -> f64 {
        f64::from_le_bytes(self.little(at))
    }
}

fn wrong_magic() -> Refusal {
    Refusal::new(
        "magic",
        "is not that of NIfTI (an ANALYZE file?)",
        "convert the image to NIfTI, with its orientation",
    )
}
