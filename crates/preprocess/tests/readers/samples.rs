//! Small volumes, and the files that hold them.

use std::fs;
use std::io::Write;
use std::path::PathBuf;

use flate2::Compression;
use flate2::write::{GzEncoder, ZlibEncoder};
use tempfile::TempDir;
use voxrole_pack::scalar::LittleEndian;
use voxrole_pack::{ScalarType, Scalars, with_scalars};
use voxrole_preprocess::io::{ByteOrder, StoredType};

/// Dimensions of every sample.
pub const DIMS: [u32; 3] = [3, 4, 5];
const COUNT: usize = 60;

/// Sixty numbers of one type, its extremes among them.
pub fn numbers(scalar_type: ScalarType) -> Scalars {
    fn with_extremes<T>(first: [T; 4], other: impl Fn(u8) -> T) -> Vec<T> {
        first.into_iter().chain((4..COUNT as u8).map(other)).collect()
    }
    match scalar_type {
        ScalarType::U8 => Scalars::U8(with_extremes([0, 1, 254, 255], |n| n * 3)),
        ScalarType::I8 => Scalars::I8(with_extremes([-128, -1, 1, 127], |n| 30 - n as i8)),
        ScalarType::U16 => Scalars::U16(with_extremes([0, 1, 256, 65535], |n| u16::from(n) * 1000)),
        ScalarType::I16 => Scalars::I16(with_extremes([-32768, -1, 256, 32767], |n| 500 - i16::from(n) * 100)),
        ScalarType::U32 => Scalars::U32(with_extremes([0, 1, 0x0102_0304, u32::MAX], |n| u32::from(n) << 20)),
        ScalarType::I32 => {
            Scalars::I32(with_extremes([i32::MIN, -1, 0x0102_0304, i32::MAX], |n| -(i32::from(n) << 20)))
        }
        ScalarType::F32 => Scalars::F32(with_extremes([f32::MIN, 1e-40, -0.1, f32::INFINITY], |n| f32::from(n) / 7.0)),
        ScalarType::F64 => Scalars::F64(with_extremes([f64::MAX, 5e-324, -0.1, -1.0], |n| f64::from(n) / 7.0)),
    }
}

/// The numbers' bytes.
pub fn bytes(scalars: &Scalars, byte_order: ByteOrder) -> Vec<u8> {
    fn append<T: LittleEndian>(values: &[T], bytes: &mut Vec<u8>) {
        T::append_le(values, bytes);
    }
    let mut bytes = Vec::new();
    with_scalars!(scalars, values => append(values, &mut bytes));
    if byte_order == ByteOrder::Big {
        bytes.chunks_exact_mut(scalars.scalar_type().size_in_bytes()).for_each(<[u8]>::reverse);
    }
    bytes
}

/// Every type in both byte orders.
pub fn stored_types() -> impl Iterator<Item = StoredType> {
    let orders = [ByteOrder::Little, ByteOrder::Big];
    ScalarType::ALL
        .into_iter()
        .flat_map(move |scalar_type| orders.map(|byte_order| StoredType { scalar_type, byte_order }))
}

pub fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::default());
    encoder.write_all(bytes).expect("into memory");
    encoder.finish().expect("into memory")
}

pub fn zlib(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = ZlibEncoder::new(Vec::new(), Compression::default());
    encoder.write_all(bytes).expect("into memory");
    encoder.finish().expect("into memory")
}

/// Files in a folder of their own; the first is the one to open.
pub struct Files {
    folder: TempDir,
    first: &'static str,
}

impl Files {
    pub fn new<const N: usize>(files: [(&'static str, Vec<u8>); N]) -> Self {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let first = files[0].0;
        for (name, bytes) in files {
            fs::write(folder.path().join(name), bytes).expect("written");
        }
        Self { folder, first }
    }

    pub fn path(&self) -> PathBuf {
        self.folder.path().join(self.first)
    }
}

/// An NRRD header of a sample with further lines, up to and including the blank line.
pub fn nrrd_header(stored: StoredType, lines: &str) -> String {
    let name = match stored.scalar_type {
        ScalarType::U8 => "unsigned char",
        ScalarType::I8 => "int8",
        ScalarType::U16 => "ushort",
        ScalarType::I16 => "short",
        ScalarType::U32 => "uint32_t",
        ScalarType::I32 => "signed int",
        ScalarType::F32 => "float",
        ScalarType::F64 => "double",
    };
    let endian = if stored.byte_order == ByteOrder::Big { "big" } else { "little" };
    format!("NRRD0004\n# by hand\ntype: {name}\ndimension: 3\nsizes: 3 4 5\nendian: {endian}\nkey:=value\n{lines}\n\n")
}

/// A MetaImage header of a sample with further lines, up to but without `ElementDataFile`.
pub fn meta_header(stored: StoredType, lines: &str) -> String {
    let name = match stored.scalar_type {
        ScalarType::U8 => "MET_UCHAR",
        ScalarType::I8 => "MET_CHAR",
        ScalarType::U16 => "MET_USHORT",
        ScalarType::I16 => "MET_SHORT",
        ScalarType::U32 => "MET_UINT",
        ScalarType::I32 => "MET_INT",
        ScalarType::F32 => "MET_FLOAT",
        ScalarType::F64 => "MET_DOUBLE",
    };
    let msb = if stored.byte_order == ByteOrder::Big { "True" } else { "False" };
    format!(
        "ObjectType = Image\nNDims = 3\nDimSize = 3 4 5\nElementType = {name}\nBinaryDataByteOrderMSB = {msb}\n{lines}"
    )
}

/// The fields of a NIfTI-1 header that tests set.
#[derive(Clone)]
pub struct Nifti {
    pub stored: StoredType,
    pub sizeof_hdr: i32,
    pub dim: [i16; 8],
    pub datatype: Option<i16>,
    pub bitpix: Option<i16>,
    pub pixdim: [f32; 8],
    pub vox_offset: f32,
    pub scl: [f32; 2],
    pub xyzt_units: u8,
    pub codes: [i16; 2],
    pub quatern: [f32; 6],
    pub srow: [f32; 12],
    pub magic: [u8; 4],
}

impl Nifti {
    pub fn new(stored: StoredType) -> Self {
        Self {
            stored,
            sizeof_hdr: 348,
            dim: [3, 3, 4, 5, 1, 1, 1, 1],
            datatype: None,
            bitpix: None,
            pixdim: [1.0, 1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 0.0],
            vox_offset: 352.0,
            scl: [0.0; 2],
            xyzt_units: 2,
            codes: [0; 2],
            quatern: [0.0; 6],
            srow: [0.0; 12],
            magic: *b"n+1\0",
        }
    }

    /// The 348 bytes, and the four that say that no extension follows.
    pub fn header(&self) -> Vec<u8> {
        let mut header = vec![0; 352];
        let big = self.stored.byte_order == ByteOrder::Big;
        let mut put = |offset: usize, field: &[u8]| {
            let target = &mut header[offset..offset + field.len()];
            target.copy_from_slice(field);
            if big {
                target.reverse();
            }
        };
        let code = match self.stored.scalar_type {
            ScalarType::U8 => 2,
            ScalarType::I16 => 4,
            ScalarType::I32 => 8,
            ScalarType::F32 => 16,
            ScalarType::F64 => 64,
            ScalarType::I8 => 256,
            ScalarType::U16 => 512,
            ScalarType::U32 => 768,
        };
        let bits = 8 * self.stored.scalar_type.size_in_bytes() as i16;
        put(0, &self.sizeof_hdr.to_le_bytes());
        self.dim.iter().enumerate().for_each(|(index, dim)| put(40 + 2 * index, &dim.to_le_bytes()));
        put(70, &self.datatype.unwrap_or(code).to_le_bytes());
        put(72, &self.bitpix.unwrap_or(bits).to_le_bytes());
        self.pixdim.iter().enumerate().for_each(|(index, value)| put(76 + 4 * index, &value.to_le_bytes()));
        put(108, &self.vox_offset.to_le_bytes());
        self.scl.iter().enumerate().for_each(|(index, value)| put(112 + 4 * index, &value.to_le_bytes()));
        put(123, &[self.xyzt_units]);
        self.codes.iter().enumerate().for_each(|(index, code)| put(252 + 2 * index, &code.to_le_bytes()));
        self.quatern.iter().enumerate().for_each(|(index, value)| put(256 + 4 * index, &value.to_le_bytes()));
        self.srow.iter().enumerate().for_each(|(index, value)| put(280 + 4 * index, &value.to_le_bytes()));
        header[344..348].copy_from_slice(&self.magic);
        header
    }

    /// Header and numbers in one file.
    pub fn file(&self) -> Vec<u8> {
        [self.header(), bytes(&numbers(self.stored.scalar_type), self.stored.byte_order)].concat()
    }
}
