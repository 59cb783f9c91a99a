//! Types of numbers in a definition, and numbers of these types.

use std::fmt;

/// Number type.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[allow(missing_docs)] // the names say it
pub enum Primitive {
    Bool,
    Int8,
    Uint8,
    Int16,
    Uint16,
    Int32,
    Uint32,
    Int64,
    Uint64,
    Float32,
    Float64,
}

impl Primitive {
    const ALL: [Self; 11] = [
        Self::Bool,
        Self::Int8,
        Self::Uint8,
        Self::Int16,
        Self::Uint16,
        Self::Int32,
        Self::Uint32,
        Self::Int64,
        Self::Uint64,
        Self::Float32,
        Self::Float64,
    ];

    /// Its name in a definition.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Bool => "bool",
            Self::Int8 => "int8",
            Self::Uint8 => "uint8",
            Self::Int16 => "int16",
            Self::Uint16 => "uint16",
            Self::Int32 => "int32",
            Self::Uint32 => "uint32",
            Self::Int64 => "int64",
            Self::Uint64 => "uint64",
            Self::Float32 => "float32",
            Self::Float64 => "float64",
        }
    }

    /// Size, bytes; also the alignment.
    #[must_use]
    pub const fn size(self) -> usize {
        match self {
            Self::Bool | Self::Int8 | Self::Uint8 => 1,
            Self::Int16 | Self::Uint16 => 2,
            Self::Int32 | Self::Uint32 | Self::Float32 => 4,
            Self::Int64 | Self::Uint64 | Self::Float64 => 8,
        }
    }

    pub(super) fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.name() == name)
    }

    /// Least and greatest value of an integer type.
    pub(super) const fn range(self) -> Option<(i128, i128)> {
        match self {
            Self::Int8 => Some((i8::MIN as i128, i8::MAX as i128)),
            Self::Uint8 => Some((0, u8::MAX as i128)),
            Self::Int16 => Some((i16::MIN as i128, i16::MAX as i128)),
            Self::Uint16 => Some((0, u16::MAX as i128)),
            Self::Int32 => Some((i32::MIN as i128, i32::MAX as i128)),
            Self::Uint32 => Some((0, u32::MAX as i128)),
            Self::Int64 => Some((i64::MIN as i128, i64::MAX as i128)),
            Self::Uint64 => Some((0, u64::MAX as i128)),
            Self::Bool | Self::Float32 | Self::Float64 => None,
        }
    }
}

/// A number of any kind, as wide as it needs to be.
#[derive(Debug, Clone, Copy, PartialEq)]
#[allow(missing_docs)] // the names say it
pub enum Number {
    Unsigned(u64),
    Signed(i64),
    Float32(f32),
    Float64(f64),
}

impl Number {
    /// Reads the number at the beginning of `bytes`, little endian.
    ///
    /// # Panics
    /// `bytes` is shorter than the number.
    #[must_use]
    pub fn read(primitive: Primitive, bytes: &[u8]) -> Self {
        let mut wide = [0_u8; 8];
        let size = primitive.size();
        wide[..size].copy_from_slice(&bytes[..size]);
        let raw = u64::from_le_bytes(wide);
        let sign_extended = ((raw << (64 - 8 * size)) as i64) >> (64 - 8 * size);
        match primitive {
            Primitive::Bool | Primitive::Uint8 | Primitive::Uint16 | Primitive::Uint32 | Primitive::Uint64 => {
                Self::Unsigned(raw)
            }
            Primitive::Int8 | Primitive::Int16 | Primitive::Int32 | Primitive::Int64 => Self::Signed(sign_extended),
            Primitive::Float32 => Self::Float32(f32::from_bits(raw as u32)),
            Primitive::Float64 => Self::Float64(f64::from_bits(raw)),
        }
    }

    /// The nearest `f64`; exact except for integers beyond 2^53.
    #[must_use]
    pub fn as_f64(self) -> f64 {
        match self {
            Self::Unsigned(value) => value as f64,
            Self::Signed(value) => value as f64,
            Self::Float32(value) => f64::from(value),
            Self::Float64(value) => value,
        }
    }
}

impl fmt::Display for Number {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unsigned(value) => value.fmt(f),
            Self::Signed(value) => value.fmt(f),
            Self::Float32(value) => value.fmt(f),
            Self::Float64(value) => value.fmt(f),
        }
    }
}
