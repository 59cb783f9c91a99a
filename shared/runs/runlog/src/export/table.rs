//! Derives the columns of a table from the channel's definition.

use messages::schema::{Primitive, Schema, SchemaField};

/// A byte array of at least this length is a text column.
const TEXT_BYTES: usize = 16;

/// Times of a recorded sample.
#[derive(Debug, Clone, Copy)]
pub(super) struct Times {
    pub t_s: f64,
    pub log_time_ns: u64,
    pub publish_time_ns: u64,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum ColumnKind {
    Number(Primitive),
    Text(usize),
}

#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Column {
    pub name: String,
    pub kind: ColumnKind,
    /// Offset from the start of the sample, bytes.
    pub offset: usize,
}

#[derive(Debug)]
pub(super) struct Table {
    /// All columns except the three times.
    pub columns: Vec<Column>,
    /// Fields of the definition, padding included.
    pub fields: Vec<SchemaField>,
}

/// The columns in front of those of the definition.
pub(super) const TIMES: [&str; 3] = ["t_s", "log_time_ns", "publish_time_ns"];

impl Table {
    /// Columns of a definition; one column of plain bytes if there is none, or if it does not give the offset of each
    /// number.
    pub fn from_definition(definition: &str, size: usize) -> Result<Self, String> {
        let schema = Schema::parse(definition)
            .ok()
            .filter(|schema| schema.size() == size)
            .map_or_else(|| Schema::parse(&format!("uint8[{}] data\n", size.max(1))), Ok)
            .map_err(|error| error.to_string())?;
        if size == 0 {
            return Err("its samples are empty".to_owned());
        }
        let mut columns: Vec<Column> = Vec::new();
        let plain = schema.fields().len() == 1 && schema.fields()[0].path == "data";
        for field in schema.fields().iter().filter(|field| !is_padding(&field.path)) {
            let name = flat(&field.path);
            let mut add = |mut name: String, kind, offset| {
                while TIMES.contains(&name.as_str()) || columns.iter().any(|column| column.name == name) {
                    name.push('_');
                }
                columns.push(Column { name, kind, offset });
            };
            match field.count {
                Some(count) if field.primitive == Primitive::Uint8 && (count >= TEXT_BYTES || plain) => {
                    add(name, ColumnKind::Text(count), field.offset);
                }
                Some(count) => {
                    for at in 0..count {
                        let offset = field.offset + at * field.primitive.size();
                        add(format!("{name}_{}", at + 1), ColumnKind::Number(field.primitive), offset);
                    }
                }
                None => add(name, ColumnKind::Number(field.primitive), field.offset),
            }
        }
        Ok(Self { columns, fields: schema.fields().to_vec() })
    }

    pub fn names(&self) -> Vec<String> {
        let own = self.columns.iter().map(|column| column.name.clone());
        TIMES.iter().map(|name| (*name).to_owned()).chain(own).collect()
    }
}

/// Column name of a path: `command_2_epoch` for `command[1].epoch`. Fields of the sample's own header have their bare
/// names.
pub(super) fn flat(path: &str) -> String {
    let mut name = String::new();
    for part in path.strip_prefix("header.").unwrap_or(path).split('.') {
        if !name.is_empty() {
            name.push('_');
        }
        match part.strip_suffix(']').and_then(|part| part.split_once('[')) {
            Some((bare, index)) => {
                let number = index.parse::<usize>().map_or(0, |index| index + 1);
                name.push_str(&format!("{bare}_{number}"));
            }
            None => name.push_str(part),
        }
    }
    name
}

fn is_padding(path: &str) -> bool {
    let last = path.rsplit('.').next().unwrap_or(path);
    last.strip_prefix("pad")
        .is_some_and(|digits| !digits.is_empty() && digits.bytes().all(|byte| byte.is_ascii_digit()))
}

/// Appends the text before the first zero to `into`, or hexadecimal digits after `0x` if the bytes are not text.
pub(super) fn text(bytes: &[u8], into: &mut String) {
    let end = bytes.iter().position(|byte| *byte == 0).unwrap_or(bytes.len());
    let rest_is_zero = bytes[end..].iter().all(|byte| *byte == 0);
    match std::str::from_utf8(&bytes[..end]) {
        Ok(text) if rest_is_zero && text.chars().all(|c| !c.is_control() || c == '\n' || c == '\t') => {
            into.push_str(text)
        }
        _ => {
            into.push_str("0x");
            into.push_str(&messages::hex(bytes));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use messages::{Message, MotorInput, OperatorRequest};

    #[test]
    fn columns_have_the_names_that_analysts_expect() {
        let names = Table::from_definition(OperatorRequest::schema(), size_of::<OperatorRequest>()).unwrap().names();
        assert_eq!(names[..7], ["t_s", "log_time_ns", "publish_time_ns", "life", "cycle", "seq", "stamp_ns"]);
        for name in ["body_length_m_1", "body_verb", "hash", "text", "answer"] {
            assert!(names.iter().any(|found| found == name), "{name}");
        }
        assert!(!names.iter().any(|name| name.starts_with("pad") || name == "text_1"), "{names:?}");
        let names = Table::from_definition(MotorInput::schema(), size_of::<MotorInput>()).unwrap().names();
        assert!(names.iter().any(|name| name == "command_2_velocity_m_s_4"), "{names:?}");
        let mut sorted = names.clone();
        sorted.sort();
        sorted.dedup();
        assert_eq!(sorted.len(), names.len());
    }

    #[test]
    fn what_has_no_definition_is_bytes() {
        for definition in ["", "string name\n", "float64 x\n"] {
            let table = Table::from_definition(definition, 5).unwrap();
            assert_eq!(table.columns, [Column { name: "data".into(), kind: ColumnKind::Text(5), offset: 0 }]);
        }
        assert!(Table::from_definition("", 0).is_err());
        let mut said = String::new();
        text(b"ab\n\0\0", &mut said);
        text(&[1, 0xff], &mut said);
        text(b"a\0b", &mut said);
        assert_eq!(said, "ab\n0x01ff0x610062");
    }
}
