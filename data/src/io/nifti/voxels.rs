//! Voxel types, and the way from bytes to numbers.

use super::Refusal;
use std::io::Read;

/// Real number types of NIfTI voxels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum VoxelType {
    /// Unsigned 8 bit.
    U8,
    /// Signed 8 bit.
    I8,
    /// Unsigned 16 bit.
    U16,
    /// Signed 16 bit.
    I16,
    /// Unsigned 32 bit.
    U32,
    /// Signed 32 bit.
    I32,
    /// Unsigned 64 bit.
    U64,
    /// Signed 64 bit.
    I64,
    /// Single precision.
    F32,
    /// Double precision.
    F64,
}

impl VoxelType {
    const TABLE: [(Self, i16, usize, &'static str); 10] = [
        (Self::U8, 2, 1, "uint8"),
        (Self::I16, 4, 2, "int16"),
        (Self::I32, 8, 4, "int32"),
        (Self::F32, 16, 4, "float32"),
        (Self::F64, 64, 8, "float64"),
        (Self::I8, 256, 1, "int8"),
        (Self::U16, 512, 2, "uint16"),
        (Self::U32, 768, 4, "uint32"),
        (Self::I64, 1024, 8, "int64"),
        (Self::U64, 1280, 8, "uint64"),
    ];

    fn row(self) -> (i16, usize, &'static str) {
        let row = Self::TABLE.iter().find(|row| row.0 == self);
        let row = row.expect("the table names each type");
        (row.1, row.2, row.3)
    }

    /// Number in the header's `datatype`.
    pub(super) fn code(self) -> i16 {
        self.row().0
    }

    /// Bytes of a voxel.
    pub fn bytes(self) -> usize {
        self.row().1
    }

    /// Name as numpy has it.
    pub fn name(self) -> &'static str {
        self.row().2
    }

    /// Type of a header; colours and complex numbers are refused.
    pub(super) fn of(datatype: i16, bitpix: i16) -> Result<Self, Refusal> {
        let kind = match datatype {
            32 | 1792 | 2048 => "complex numbers",
            128 | 2304 => "colours",
            1536 => "quadruple precision",
            _ => "unknown",
        };
        let row = Self::TABLE.iter().find(|row| row.1 == datatype).ok_or_else(|| {
            Refusal::new(
                "datatype",
                format!("is {datatype} ({kind})"),
                "save one real number a voxel: int16 or float32, say",
            )
        })?;
        if usize::try_from(bitpix) != Ok(8 * row.2) {
            return Err(Refusal::new(
                "bitpix",
                format!("is {bitpix}, but {} has {} bits", row.3, 8 * row.2),
                "the header is damaged: export the image again",
            ));
        }
        Ok(row.0)
    }
}

/// How voxels lie in a file.
#[derive(Debug, Clone, Copy)]
pub(super) struct Coding {
    pub voxel: VoxelType,
    pub big_endian: bool,
    pub count: usize,
}

/// Bytes that are decoded at once: a multiple of every voxel size.
const CHUNK: usize = 1 << 20;
/// Voxels that are reserved before any of them was read (64 MB of them, as `f32`).
const FIRST: usize = 1 << 24;

/// Why decoding stopped.
pub(super) enum Stop {
    /// The bytes ended or could not be decompressed.
    Reading(std::io::Error),
    /// `convert` refused this value of the voxel with this position.
    Value(usize, f64),
}

/// Reads all voxels and converts each; `convert` gives `None` for a value that cannot be meant.
pub(super) fn decode<T>(
    reader: &mut dyn Read,
    coding: Coding,
    convert: impl Fn(f64) -> Option<T>,
) -> Result<Vec<T>, Stop> {
    let mut values = Vec::new();
    let mut chunk = vec![0; CHUNK.min(coding.count * coding.voxel.bytes())];
    while values.len() < coding.count {
        let left = coding.count - values.len();
        let bytes = chunk.len().min(left * coding.voxel.bytes());
        reader.read_exact(&mut chunk[..bytes]).map_err(Stop::Reading)?;
        if values.len() == values.capacity() {
            // A header may lie: the rest is reserved when the first voxels have been there.
            values.reserve_exact(if values.is_empty() { left.min(FIRST) } else { left });
        }
        append(&chunk[..bytes], coding, &convert, &mut values)?;
    }
    Ok(values)
}

fn append<T>(
    bytes: &[u8],
    coding: Coding,
    convert: &impl Fn(f64) -> Option<T>,
    values: &mut Vec<T>,
) -> Result<(), Stop> {
    macro_rules! each {
        ($kind:ty) => {
            for bytes in bytes.chunks_exact(size_of::<$kind>()) {
                let bytes = bytes.try_into().expect("the chunk has the size of the type");
                let number = if coding.big_endian {
                    <$kind>::from_be_bytes(bytes)
                } else {
                    <$kind>::from_le_bytes(bytes)
                } as f64;
                let value = convert(number).ok_or(Stop::Value(values.len(), number))?;
                values.push(value);
            }
        };
    }
    match coding.voxel {
        VoxelType::U8 => each!(u8),
        VoxelType::I8 => each!(i8),
        VoxelType::U16 => each!(u16),
        VoxelType::I16 => each!(i16),
        VoxelType::U32 => each!(u32),
        VoxelType::I32 => each!(i32),
        VoxelType::U64 => each!(u64),
        VoxelType::I64 => each!(i64),
        VoxelType::F32 => each!(f32),
        VoxelType::F64 => each!(f64),
    }
    Ok(())
}
