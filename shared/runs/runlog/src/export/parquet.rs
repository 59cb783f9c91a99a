//! Parquet: columns of plain values, one page per column and row group, compressed with zstd.
//!
//! Implements the part of the format (apache/parquet-format, `parquet.thrift` and `Encodings.md`) that a table of
//! numbers and texts without nulls needs: all columns are REQUIRED, so there are no definition and repetition levels;
//! the encoding is PLAIN. The metadata are Thrift structs in the compact protocol, with the field numbers next to their
//! names below.

use std::fs::File;
use std::io::{self, BufWriter, Write};

use messages::schema::{Number, Primitive};

use super::sink::Sink;
use super::table::{Column, ColumnKind, TIMES, Table, Times, text};
use crate::RecordedChannel;

const MAGIC: &[u8; 4] = b"PAR1";
/// Most rows of a row group: a reader loads one group at a time. The export ends a group earlier where the groups of
/// all its tables take much memory.
const GROUP_ROWS: usize = 1 << 16;
/// As in run files: faster and smaller than the default level on this kind of data.
const ZSTD_LEVEL: i32 = 1;

/// Values of the format's `Type`.
const INT32: i32 = 1;
const INT64: i32 = 2;
const FLOAT: i32 = 4;
const DOUBLE: i32 = 5;
const BYTE_ARRAY: i32 = 6;
/// Values of `CompressionCodec`, `Encoding`, `FieldRepetitionType`.
const ZSTD: i32 = 6;
const PLAIN: i32 = 0;
const RLE: i32 = 3;
const REQUIRED: i32 = 0;

struct Chunk {
    offset: i64,
    values: i64,
    plain_bytes: i64,
    bytes: i64,
}

pub(super) struct Parquet {
    out: BufWriter<File>,
    at: i64,
    columns: Vec<Column>,
    /// Plain values of the row group by column; the three times come first.
    values: Vec<Vec<u8>>,
    rows: usize,
    bytes: usize,
    groups: Vec<(i64, Vec<Chunk>)>,
    about: [(&'static str, String); 3],
    text: String,
}

impl Parquet {
    pub fn begin(file: File, table: Table, channel: &RecordedChannel) -> io::Result<Self> {
        let mut out = BufWriter::with_capacity(1 << 16, file);
        out.write_all(MAGIC)?;
        let values = vec![Vec::new(); table.columns.len() + TIMES.len()];
        let about = [
            ("channel", channel.name.clone()),
            ("type", channel.schema_name.clone()),
            ("definition", channel.schema.clone()),
        ];
        let (at, columns, text) = (MAGIC.len() as i64, table.columns, String::new());
        Ok(Self { out, at, columns, values, rows: 0, bytes: 0, groups: Vec::new(), about, text })
    }

    fn end_group(&mut self) -> io::Result<()> {
        if self.rows == 0 {
            return Ok(());
        }
        let mut chunks = Vec::with_capacity(self.values.len());
        for values in &mut self.values {
            let packed = zstd::bulk::compress(values, ZSTD_LEVEL)?;
            let page = page_header(values.len(), packed.len(), self.rows)?;
            let bytes = (page.len() + packed.len()) as i64;
            let (plain_bytes, offset) = ((page.len() + values.len()) as i64, self.at);
            chunks.push(Chunk { offset, values: self.rows as i64, plain_bytes, bytes });
            self.out.write_all(&page)?;
            self.out.write_all(&packed)?;
            self.at += bytes;
            // The next group is about as large; a vector that doubles takes up to twice the memory.
            *values = Vec::with_capacity(values.len());
        }
        self.groups.push((self.rows as i64, chunks));
        (self.rows, self.bytes) = (0, 0);
        Ok(())
    }

    /// Name, `Type` and `ConvertedType` of each column.
    fn kinds(&self) -> Vec<(&str, i32, Option<i32>)> {
        let times = [(TIMES[0], DOUBLE, None), (TIMES[1], INT64, None), (TIMES[2], INT64, None)];
        let own = self.columns.iter().map(|column| {
            let (kind, converted) = match column.kind {
                ColumnKind::Number(primitive) => kind_of(primitive),
                // UTF8
                ColumnKind::Text(_) => (BYTE_ARRAY, Some(0)),
            };
            (column.name.as_str(), kind, converted)
        });
        times.into_iter().chain(own).collect()
    }

    /// Serialises `FileMetaData`.
    fn footer(&self) -> Vec<u8> {
        let kinds = self.kinds();
        let rows: i64 = self.groups.iter().map(|(rows, _)| rows).sum();
        let mut thrift = Thrift::default();
        thrift.begin();
        thrift.i32(1, 2); // version
        thrift.list(2, STRUCT, kinds.len() + 1); // schema: SchemaElement
        thrift.begin();
        thrift.text(4, "schema"); // name
        thrift.i32(5, kinds.len() as i32); // num_children
        thrift.end();
        for (name, kind, converted) in &kinds {
            thrift.begin();
            thrift.i32(1, *kind); // type
            thrift.i32(3, REQUIRED); // repetition_type
            thrift.text(4, name);
            if let Some(converted) = converted {
                thrift.i32(6, *converted); // converted_type
            }
            thrift.end();
        }
        thrift.i64(3, rows); // num_rows
        thrift.list(4, STRUCT, self.groups.len()); // row_groups
        for (rows, chunks) in &self.groups {
            thrift.begin();
            thrift.list(1, STRUCT, chunks.len()); // columns: ColumnChunk
            for (chunk, (name, kind, _)) in chunks.iter().zip(&kinds) {
                thrift.begin();
                thrift.i64(2, chunk.offset); // file_offset
                thrift.inner(3); // meta_data: ColumnMetaData
                thrift.i32(1, *kind); // type
                thrift.list(2, I32, 1); // encodings
                thrift.element(PLAIN);
                thrift.list(3, BINARY, 1); // path_in_schema
                thrift.bytes(name.as_bytes());
                thrift.i32(4, ZSTD); // codec
                thrift.i64(5, chunk.values); // num_values
                thrift.i64(6, chunk.plain_bytes); // total_uncompressed_size
                thrift.i64(7, chunk.bytes); // total_compressed_size
                thrift.i64(9, chunk.offset); // data_page_offset
                thrift.end();
                thrift.end();
            }
            thrift.i64(2, chunks.iter().map(|chunk| chunk.plain_bytes).sum()); // total_byte_size
            thrift.i64(3, *rows); // num_rows
            thrift.end();
        }
        thrift.list(5, STRUCT, self.about.len()); // key_value_metadata
        for (key, value) in &self.about {
            thrift.begin();
            thrift.text(1, key);
            thrift.text(2, value);
            thrift.end();
        }
        thrift.text(6, concat!("nims version ", env!("CARGO_PKG_VERSION"))); // created_by
        thrift.end();
        thrift.out
    }
}

impl Sink for Parquet {
    fn row(&mut self, times: Times, sample: &[u8]) -> io::Result<()> {
        let [t_s, log_time, publish_time, values @ ..] = self.values.as_mut_slice() else { return Ok(()) };
        t_s.extend_from_slice(&times.t_s.to_le_bytes());
        log_time.extend_from_slice(&times.log_time_ns.to_le_bytes());
        publish_time.extend_from_slice(&times.publish_time_ns.to_le_bytes());
        self.bytes += 3 * size_of::<u64>();
        for (column, values) in self.columns.iter().zip(values) {
            let before = values.len();
            match column.kind {
                ColumnKind::Number(primitive) => {
                    let raw = sample.get(column.offset..column.offset + primitive.size()).unwrap_or(&[0; 8]);
                    match Number::read(primitive, raw) {
                        // integers below eight bytes are stored as four bytes
                        Number::Unsigned(value) if primitive.size() < 8 => {
                            values.extend_from_slice(&(value as u32).to_le_bytes());
                        }
                        Number::Signed(value) if primitive.size() < 8 => {
                            values.extend_from_slice(&(value as i32).to_le_bytes());
                        }
                        _ => values.extend_from_slice(raw),
                    }
                }
                ColumnKind::Text(count) => {
                    self.text.clear();
                    text(sample.get(column.offset..column.offset + count).unwrap_or_default(), &mut self.text);
                    values.extend_from_slice(&(self.text.len() as u32).to_le_bytes());
                    values.extend_from_slice(self.text.as_bytes());
                }
            }
            self.bytes += values.len() - before;
        }
        self.rows += 1;
        if self.rows == GROUP_ROWS { self.end_group() } else { Ok(()) }
    }

    fn waiting_bytes(&self) -> usize {
        self.bytes
    }

    fn write_waiting(&mut self) -> io::Result<()> {
        self.end_group()
    }

    fn finish(mut self: Box<Self>) -> io::Result<()> {
        self.end_group()?;
        let footer = self.footer();
        self.out.write_all(&footer)?;
        self.out.write_all(&(footer.len() as u32).to_le_bytes())?;
        self.out.write_all(MAGIC)?;
        self.out.flush()
    }
}

fn kind_of(primitive: Primitive) -> (i32, Option<i32>) {
    match primitive {
        Primitive::Bool | Primitive::Uint8 => (INT32, Some(11)),
        Primitive::Uint16 => (INT32, Some(12)),
        Primitive::Uint32 => (INT32, Some(13)),
        Primitive::Uint64 => (INT64, Some(14)),
        Primitive::Int8 => (INT32, Some(15)),
        Primitive::Int16 => (INT32, Some(16)),
        Primitive::Int32 => (INT32, None),
        Primitive::Int64 => (INT64, None),
        Primitive::Float32 => (FLOAT, None),
        Primitive::Float64 => (DOUBLE, None),
    }
}

/// `PageHeader` of a data page.
fn page_header(plain: usize, packed: usize, rows: usize) -> io::Result<Vec<u8>> {
    let number = |value: usize| i32::try_from(value).map_err(io::Error::other);
    let mut thrift = Thrift::default();
    thrift.begin();
    thrift.i32(1, 0); // type: DATA_PAGE
    thrift.i32(2, number(plain)?); // uncompressed_page_size
    thrift.i32(3, number(packed)?); // compressed_page_size
    thrift.inner(5); // data_page_header
    thrift.i32(1, number(rows)?); // num_values
    thrift.i32(2, PLAIN); // encoding
    thrift.i32(3, RLE); // definition_level_encoding
    thrift.i32(4, RLE); // repetition_level_encoding
    thrift.end();
    thrift.end();
    Ok(thrift.out)
}

/// Types of the compact protocol.
const I32: u8 = 5;
const I64: u8 = 6;
const BINARY: u8 = 8;
const LIST: u8 = 9;
const STRUCT: u8 = 12;

/// The part of Thrift's compact protocol that is needed here.
#[derive(Default)]
struct Thrift {
    out: Vec<u8>,
    /// Last field number of each open struct.
    open: Vec<i16>,
}

impl Thrift {
    fn begin(&mut self) {
        self.open.push(0);
    }

    fn end(&mut self) {
        self.open.pop();
        self.out.push(0);
    }

    fn field(&mut self, id: i16, kind: u8) {
        let Some(last) = self.open.last_mut() else { return };
        let step = id - std::mem::replace(last, id);
        // fields come in ascending order and never sixteen apart here
        self.out.push((step as u8) << 4 | kind);
    }

    fn inner(&mut self, id: i16) {
        self.field(id, STRUCT);
        self.begin();
    }

    fn varint(&mut self, mut value: u64) {
        while value >= 0x80 {
            self.out.push(value as u8 | 0x80);
            value >>= 7;
        }
        self.out.push(value as u8);
    }

    fn zigzag(&mut self, value: i64) {
        self.varint((value << 1 ^ value >> 63) as u64);
    }

    fn i32(&mut self, id: i16, value: i32) {
        self.field(id, I32);
        self.zigzag(i64::from(value));
    }

    fn i64(&mut self, id: i16, value: i64) {
        self.field(id, I64);
        self.zigzag(value);
    }

    fn element(&mut self, value: i32) {
        self.zigzag(i64::from(value));
    }

    fn bytes(&mut self, bytes: &[u8]) {
        self.varint(bytes.len() as u64);
        self.out.extend_from_slice(bytes);
    }

    fn text(&mut self, id: i16, text: &str) {
        self.field(id, BINARY);
        self.bytes(text.as_bytes());
    }

    fn list(&mut self, id: i16, kind: u8, length: usize) {
        self.field(id, LIST);
        if length < 15 {
            self.out.push((length as u8) << 4 | kind);
        } else {
            self.out.push(0xf0 | kind);
            self.varint(length as u64);
        }
    }
}
