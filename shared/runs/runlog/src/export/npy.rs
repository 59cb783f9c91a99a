//! NumPy: one structured array of the samples as they are in memory, preceded by their times.

use std::fs::File;
use std::io::{self, BufWriter, Seek, SeekFrom, Write};

use messages::schema::Primitive;

use super::sink::Sink;
use super::table::{Table, Times, flat};

/// Digits reserved for the sample count, which is known only at the end.
const COUNT_DIGITS: usize = 20;

pub(super) struct Npy {
    out: BufWriter<File>,
    header: String,
    samples: u64,
}

/// Field names: the times, then those of the definition including padding, so that each sample is copied unchanged.
pub(super) fn names(table: &Table) -> Vec<String> {
    let mut names = vec!["log_time_ns".to_owned(), "publish_time_ns".to_owned()];
    for field in &table.fields {
        let mut name = flat(&field.path);
        while names.contains(&name) {
            name.push('_');
        }
        names.push(name);
    }
    names
}

impl Npy {
    pub fn begin(file: File, table: &Table) -> io::Result<Self> {
        let mut types = vec!["'<u8'".to_owned(), "'<u8'".to_owned()];
        types.extend(table.fields.iter().map(|field| {
            let code = code(field.primitive);
            field.count.map_or_else(|| format!("'{code}'"), |count| format!("'{code}', ({count},)"))
        }));
        let fields: Vec<String> =
            names(table).iter().zip(&types).map(|(name, kind)| format!("('{name}', {kind})")).collect();
        let header = format!("{{'descr': [{}], 'fortran_order': False, 'shape': (", fields.join(", "));
        let mut npy = Self { out: BufWriter::with_capacity(1 << 16, file), header, samples: 0 };
        npy.head()?;
        Ok(npy)
    }

    /// Magic, version 2 (which allows long headers), header length and header text, padded so that the data begin at a
    /// multiple of 64.
    fn head(&mut self) -> io::Result<()> {
        let mut text = format!("{}{:>COUNT_DIGITS$},), }}", self.header, self.samples);
        let before = 6 + 2 + 4;
        let whole = (before + text.len() + 1).next_multiple_of(64);
        text.extend(std::iter::repeat_n(' ', whole - before - text.len() - 1));
        text.push('\n');
        let length = u32::try_from(text.len()).map_err(io::Error::other)?;
        self.out.write_all(b"\x93NUMPY\x02\x00")?;
        self.out.write_all(&length.to_le_bytes())?;
        self.out.write_all(text.as_bytes())
    }
}

impl Sink for Npy {
    fn row(&mut self, times: Times, sample: &[u8]) -> io::Result<()> {
        self.samples += 1;
        self.out.write_all(&times.log_time_ns.to_le_bytes())?;
        self.out.write_all(&times.publish_time_ns.to_le_bytes())?;
        self.out.write_all(sample)
    }

    fn finish(mut self: Box<Self>) -> io::Result<()> {
        self.out.seek(SeekFrom::Start(0))?;
        self.head()?;
        self.out.flush()
    }
}

fn code(primitive: Primitive) -> &'static str {
    match primitive {
        Primitive::Bool | Primitive::Uint8 => "|u1",
        Primitive::Int8 => "|i1",
        Primitive::Int16 => "<i2",
        Primitive::Uint16 => "<u2",
        Primitive::Int32 => "<i4",
        Primitive::Uint32 => "<u4",
        Primitive::Int64 => "<i8",
        Primitive::Uint64 => "<u8",
        Primitive::Float32 => "<f4",
        Primitive::Float64 => "<f8",
    }
}
