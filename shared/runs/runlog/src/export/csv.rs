//! CSV: one row of column names, then one row per sample.

use std::fs::File;
use std::io::{self, BufWriter, Write};

use messages::schema::Number;

use super::sink::Sink;
use super::table::{ColumnKind, Table, Times, text};

pub(super) struct Csv {
    out: BufWriter<File>,
    table: Table,
    line: String,
    text: String,
}

impl Csv {
    pub fn begin(file: File, table: Table) -> io::Result<Self> {
        let mut out = BufWriter::with_capacity(1 << 16, file);
        writeln!(out, "{}", table.names().join(","))?;
        Ok(Self { out, table, line: String::new(), text: String::new() })
    }
}

impl Sink for Csv {
    fn row(&mut self, times: Times, sample: &[u8]) -> io::Result<()> {
        use std::fmt::Write as _;
        self.line.clear();
        let line = &mut self.line;
        let _ = write!(line, "{:.9},{},{}", times.t_s, times.log_time_ns, times.publish_time_ns);
        for column in &self.table.columns {
            line.push(',');
            match column.kind {
                ColumnKind::Number(primitive) => {
                    // the shortest digits that parse back to the same number
                    let bytes = sample.get(column.offset..column.offset + primitive.size()).unwrap_or(&[0; 8]);
                    let _ = write!(line, "{}", Number::read(primitive, bytes));
                }
                ColumnKind::Text(count) => {
                    self.text.clear();
                    text(sample.get(column.offset..column.offset + count).unwrap_or_default(), &mut self.text);
                    quoted(&self.text, line);
                }
            }
        }
        line.push('\n');
        self.out.write_all(line.as_bytes())
    }

    fn finish(mut self: Box<Self>) -> io::Result<()> {
        self.out.flush()
    }
}

fn quoted(text: &str, line: &mut String) {
    if text.contains([',', '"', '\n', '\r']) {
        line.push('"');
        line.push_str(&text.replace('"', "\"\""));
        line.push('"');
    } else {
        line.push_str(text);
    }
}
