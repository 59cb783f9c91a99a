//! Parser of ROS 2 definitions: finds the numbers in samples of types that this build does not contain.
//!
//! The parser is strict. It accepts only the subset that every reader of run files decodes alike. It rejects text that
//! would make a reader fail or silently read the wrong bytes:
//! * numbers (`bool`, `int8` ... `uint64`, `float32`, `float64`), fixed arrays of them, and nested types by their
//!   two-part name;
//! * integer constants, decimal, in upper case; they name the values of the next field if it has the same type;
//! * every number at a multiple of its own size, so that the struct in memory and its CDR body are the same bytes.
//!   Hidden padding cannot be seen in a text, but it makes the text's size differ from the sample's: compare
//!   [`Schema::size`] with the payload.
//!
//! ```
//! use messages::{Message, TruthNode};
//! let schema = messages::schema::Schema::parse(TruthNode::schema())?;
//! assert_eq!(schema.size(), size_of::<TruthNode>());
//! assert_eq!(schema.field("position_m").map(|field| field.offset), Some(48));
//! # Ok::<(), messages::schema::SchemaError>(())
//! ```

use std::collections::HashMap;
use std::fmt;

mod flaw;
mod limits;
mod number;

pub use flaw::{Flaw, SchemaError};
pub use number::{Number, Primitive};

use limits::{BYTES, DEPTH, FIELDS, SEPARATOR_LENGTH};

/// One number, or one array of numbers, of a sample.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SchemaField {
    /// e.g. `header.seq` or `command[1].epoch`.
    pub path: String,
    /// Kind of number.
    pub primitive: Primitive,
    /// Bytes from the beginning of the sample.
    pub offset: usize,
    /// Array length; `None` for a single number.
    pub count: Option<usize>,
    /// Names of values, in the order of the text.
    pub constants: Vec<(String, i128)>,
}

impl SchemaField {
    /// Size, bytes.
    #[must_use]
    pub fn size(&self) -> usize {
        self.primitive.size() * self.count.unwrap_or(1)
    }

    /// The name of a value, if the definition gives it one.
    #[must_use]
    pub fn name_of(&self, value: Number) -> Option<&str> {
        let value = match value {
            Number::Unsigned(value) => i128::from(value),
            Number::Signed(value) => i128::from(value),
            Number::Float32(_) | Number::Float64(_) => return None,
        };
        self.constants.iter().find(|(_, constant)| *constant == value).map(|(name, _)| name.as_str())
    }
}

/// A parsed definition: the fields in the order of their bytes.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Schema {
    fields: Vec<SchemaField>,
    size: usize,
}

impl Schema {
    /// Parses a complete definition, nested types included.
    ///
    /// # Errors
    /// The first line that is outside the subset, with the reason.
    pub fn parse(text: &str) -> Result<Self, SchemaError> {
        Self::parse_within(text, FIELDS)
    }

    /// As [`Schema::parse`], of a definition with at most so many fields after nested types are laid out.
    ///
    /// # Errors
    /// As [`Schema::parse`].
    pub fn parse_within(text: &str, most_fields: usize) -> Result<Self, SchemaError> {
        let definitions = definitions(text)?;
        let mut layout = Layout { definitions: &definitions, fields: Vec::new(), most_fields, offset: 0 };
        layout.place(0, "", 0)?;
        Ok(Self { size: layout.offset, fields: layout.fields })
    }

    /// Bytes of a sample.
    #[must_use]
    pub fn size(&self) -> usize {
        self.size
    }

    /// Every field.
    #[must_use]
    pub fn fields(&self) -> &[SchemaField] {
        &self.fields
    }

    /// The field of this path.
    #[must_use]
    pub fn field(&self, path: &str) -> Option<&SchemaField> {
        self.fields.iter().find(|field| field.path == path)
    }

    /// Whether a sample begins with [`crate::Header`], so that its number and its time can be read.
    #[must_use]
    pub fn has_header(&self) -> bool {
        const NAMES: [&str; 6] = ["life", "cycle", "seq", "stamp_ns", "published_ns", "oldest_input_ns"];
        NAMES.iter().enumerate().all(|(at, name)| {
            self.fields.get(at).is_some_and(|field| {
                field.path.strip_prefix("header.") == Some(name)
                    && field.primitive == Primitive::Uint64
                    && field.count.is_none()
            })
        })
    }

    /// Every field with its value, in the order of the bytes; bytes that are missing at the end leave their fields out.
    pub fn decode<'a>(&'a self, sample: &'a [u8]) -> impl Iterator<Item = (&'a SchemaField, Value<'a>)> {
        self.fields.iter().filter_map(|field| Some((field, Value::read(field, sample)?)))
    }
}

/// The value of one field: one number, or an array of them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Value<'a> {
    primitive: Primitive,
    array: bool,
    bytes: &'a [u8],
}

impl<'a> Value<'a> {
    /// The value of `field` in a sample; `None` if the sample ends before it.
    #[must_use]
    pub fn read(field: &SchemaField, sample: &'a [u8]) -> Option<Self> {
        let bytes = sample.get(field.offset..field.offset + field.size())?;
        Some(Self { primitive: field.primitive, array: field.count.is_some(), bytes })
    }

    /// Whether the field is an array.
    #[must_use]
    pub fn is_array(&self) -> bool {
        self.array
    }

    /// Its numbers: one, or those of the array.
    pub fn numbers(&self) -> impl Iterator<Item = Number> + use<'a> {
        let primitive = self.primitive;
        self.bytes.chunks_exact(primitive.size()).map(move |bytes| Number::read(primitive, bytes))
    }

    /// The first number, for fields that are not arrays.
    #[must_use]
    pub fn number(&self) -> Option<Number> {
        self.numbers().next()
    }

    /// The bytes of a `uint8` array as a text, if it is one: printable, filled up with zeros, at least one character.
    #[must_use]
    pub fn text(&self) -> Option<String> {
        if !self.array || self.primitive != Primitive::Uint8 {
            return None;
        }
        let end = self.bytes.iter().position(|byte| *byte == 0).unwrap_or(self.bytes.len());
        let (text, rest) = self.bytes.split_at(end);
        let text = std::str::from_utf8(text).ok()?;
        let printable = !text.is_empty() && text.chars().all(|c| !c.is_control() || c == '\n' || c == '\t');
        (printable && rest.iter().all(|byte| *byte == 0)).then(|| text.to_owned())
    }
}

impl fmt::Display for Value<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if !self.array {
            return self.number().map_or(Ok(()), |number| number.fmt(f));
        }
        f.write_str("[")?;
        for (at, number) in self.numbers().enumerate() {
            if at > 0 {
                f.write_str(", ")?;
            }
            number.fmt(f)?;
        }
        f.write_str("]")
    }
}

/// Splits a complete text into the names and lines of its definitions; the first has the name `""`.
///
/// It does not validate them. Use it to compare or rename nested types.
#[must_use]
pub fn split(text: &str) -> Vec<(&str, &str)> {
    let separator = "=".repeat(SEPARATOR_LENGTH);
    let mut parts = text.split(separator.as_str());
    let mut found = vec![("", parts.next().unwrap_or_default())];
    found.extend(parts.map(|part| {
        let part = part.strip_prefix('\n').unwrap_or(part);
        let (head, lines) = part.split_once('\n').unwrap_or((part, ""));
        (head.strip_prefix("MSG: ").unwrap_or(head).trim(), lines)
    }));
    found
}

/// Returns a definition without its comments: the text whose hash the type name ends in.
#[must_use]
pub fn without_comments(text: &str) -> String {
    let mut plain = String::with_capacity(text.len());
    for line in text.split_inclusive('\n') {
        match line.split_once('#') {
            None => plain.push_str(line),
            // A line of its own disappears, one behind a field ends there.
            Some((before, _)) if before.trim().is_empty() => {}
            Some((before, _)) => {
                plain.push_str(before.trim_end());
                plain.push('\n');
            }
        }
    }
    plain
}

/// Returns whether two definitions are the same but for their comments.
#[must_use]
pub fn is_same(one: &str, other: &str) -> bool {
    one == other || without_comments(one) == without_comments(other)
}

/// Whether `name` is a two-part type name that every reader accepts: `lower_snake/CamelCase`.
#[must_use]
pub fn is_type_name(name: &str) -> bool {
    let Some((package, kind)) = name.split_once('/') else { return false };
    is_snake(package)
        && kind.starts_with(|c: char| c.is_ascii_uppercase())
        && kind.chars().all(|c| c.is_ascii_alphanumeric())
}

fn is_snake(name: &str) -> bool {
    name.starts_with(|c: char| c.is_ascii_lowercase())
        && name.chars().all(|c| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_')
        && !name.contains("__")
        && !name.ends_with('_')
}

/// Rejected as field names, because some readers turn fields into Python attributes.
const PYTHON_KEYWORDS: [&str; 32] = [
    "and", "as", "assert", "async", "await", "break", "class", "continue", "def", "del", "elif", "else", "except",
    "finally", "for", "from", "global", "if", "import", "in", "is", "lambda", "nonlocal", "not", "or", "pass", "raise",
    "return", "try", "while", "with", "yield",
];

enum Kind<'a> {
    Number(Primitive),
    Nested(&'a str),
}

struct Member<'a> {
    line: usize,
    name: &'a str,
    kind: Kind<'a>,
    count: Option<usize>,
    constants: Vec<(String, i128)>,
}

struct Definition<'a> {
    line: usize,
    name: &'a str,
    members: Vec<Member<'a>>,
}

fn refuse<T>(line: usize, what: Flaw) -> Result<T, SchemaError> {
    Err(SchemaError { line, what })
}

fn definitions(text: &str) -> Result<Vec<Definition<'_>>, SchemaError> {
    let mut found = vec![Definition { line: 1, name: "", members: Vec::new() }];
    let mut names: HashMap<&str, usize> = HashMap::new();
    let mut constants: Vec<(Primitive, String, i128)> = Vec::new();
    let mut expect_name = false;
    for (at, raw) in text.split('\n').enumerate() {
        let number = at + 1;
        if raw.contains('\r') {
            return refuse(number, Flaw::CarriageReturn);
        }
        if expect_name {
            let name = raw.strip_prefix("MSG: ").map(str::trim_end).filter(|name| is_type_name(name));
            let Some(name) = name else {
                return refuse(number, Flaw::NoHead(raw.to_owned()));
            };
            if names.insert(name, found.len()).is_some() {
                return refuse(number, Flaw::TypeTwice(name.to_owned()));
            }
            found.push(Definition { line: number, name, members: Vec::new() });
            expect_name = false;
            continue;
        }
        let line = raw.split('#').next().unwrap_or_default().trim();
        if line.is_empty() {
            continue;
        }
        if line.starts_with("==") {
            if line.len() != SEPARATOR_LENGTH || line.bytes().any(|byte| byte != b'=') {
                return refuse(number, Flaw::Separator);
            }
            constants.clear();
            expect_name = true;
            continue;
        }
        let Some((kind, rest)) = line.split_once(char::is_whitespace) else {
            return refuse(number, Flaw::NotAMember(line.to_owned()));
        };
        if let Some((name, value)) = rest.split_once('=') {
            constants.push(constant(number, kind, name.trim(), value.trim())?);
            continue;
        }
        let Some(definition) = found.last_mut() else { continue };
        let member = member(number, kind, rest.trim(), &mut constants)?;
        if definition.members.iter().any(|other| other.name == member.name) {
            return refuse(number, Flaw::FieldTwice(member.name.to_owned()));
        }
        definition.members.push(member);
    }
    if expect_name {
        return refuse(text.lines().count(), Flaw::EndsBehindSeparator);
    }
    if let Some(empty) = found.iter().find(|definition| definition.members.is_empty()) {
        return refuse(empty.line, Flaw::Empty);
    }
    Ok(found)
}

fn constant(line: usize, kind: &str, name: &str, value: &str) -> Result<(Primitive, String, i128), SchemaError> {
    let Some((primitive, (least, greatest))) = Primitive::from_name(kind).and_then(|kind| Some((kind, kind.range()?)))
    else {
        return refuse(line, Flaw::ConstantType { name: name.to_owned(), kind: kind.to_owned() });
    };
    let upper = name.starts_with(|c: char| c.is_ascii_uppercase())
        && name.chars().all(|c| c.is_ascii_uppercase() || c.is_ascii_digit() || c == '_');
    if !upper {
        return refuse(line, Flaw::ConstantName(name.to_owned()));
    }
    let decimal = value.strip_prefix('-').unwrap_or(value);
    let parsed = value.parse::<i128>().ok().filter(|_| decimal.bytes().all(|byte| byte.is_ascii_digit()));
    match parsed.filter(|value| (least..=greatest).contains(value)) {
        Some(value) => Ok((primitive, name.to_owned(), value)),
        None => {
            let (value, kind, name) = (value.to_owned(), kind.to_owned(), name.to_owned());
            refuse(line, Flaw::ConstantValue { value, kind, name })
        }
    }
}

fn member<'a>(
    line: usize,
    kind: &'a str,
    name: &'a str,
    constants: &mut Vec<(Primitive, String, i128)>,
) -> Result<Member<'a>, SchemaError> {
    if !is_snake(name) || PYTHON_KEYWORDS.contains(&name) {
        return refuse(line, Flaw::FieldName(name.to_owned()));
    }
    let (base, count) = match kind.split_once('[') {
        None => (kind, None),
        Some((base, rest)) => {
            let length = rest.strip_suffix(']').filter(|digits| digits.bytes().all(|byte| byte.is_ascii_digit()));
            match length.and_then(|digits| digits.parse::<usize>().ok()).filter(|length| *length > 0) {
                Some(length) => (base, Some(length)),
                None => return refuse(line, Flaw::Array(kind.to_owned())),
            }
        }
    };
    let primitive = Primitive::from_name(base);
    let kind = match primitive {
        Some(primitive) => Kind::Number(primitive),
        None if is_type_name(base) => Kind::Nested(base),
        None => return refuse(line, Flaw::FieldType(base.to_owned())),
    };
    // constants belong to the field that follows them directly and has their type
    let named = constants.drain(..).filter(|(of, _, _)| Some(*of) == primitive).map(|(_, n, v)| (n, v)).collect();
    Ok(Member { line, name, kind, count, constants: named })
}

struct Layout<'a> {
    definitions: &'a [Definition<'a>],
    fields: Vec<SchemaField>,
    most_fields: usize,
    offset: usize,
}

impl Layout<'_> {
    fn place(&mut self, definition: usize, prefix: &str, depth: usize) -> Result<(), SchemaError> {
        let definitions = self.definitions;
        let definition = &definitions[definition];
        if depth > DEPTH {
            return refuse(definition.line, Flaw::TooDeep);
        }
        for member in &definition.members {
            let path = if prefix.is_empty() { member.name.to_owned() } else { format!("{prefix}.{}", member.name) };
            match member.kind {
                Kind::Number(primitive) => self.number(member, primitive, path)?,
                Kind::Nested(name) => {
                    let Some(nested) = definitions.iter().position(|other| other.name == name) else {
                        return refuse(member.line, Flaw::Undefined(name.to_owned()));
                    };
                    match member.count {
                        None => self.place(nested, &path, depth + 1)?,
                        Some(count) => {
                            for at in 0..count {
                                self.place(nested, &format!("{path}[{at}]"), depth + 1)?;
                            }
                        }
                    }
                }
            }
        }
        Ok(())
    }

    fn number(&mut self, member: &Member<'_>, primitive: Primitive, path: String) -> Result<(), SchemaError> {
        if !self.offset.is_multiple_of(primitive.size()) {
            return refuse(member.line, Flaw::Unaligned { path, offset: self.offset });
        }
        let end = member
            .count
            .unwrap_or(1)
            .checked_mul(primitive.size())
            .and_then(|size| size.checked_add(self.offset))
            .filter(|end| *end <= BYTES && self.fields.len() < self.most_fields);
        let Some(end) = end else {
            return refuse(member.line, Flaw::TooLarge { fields: self.most_fields });
        };
        let (count, constants) = (member.count, member.constants.clone());
        self.fields.push(SchemaField { path, primitive, offset: self.offset, count, constants });
        self.offset = end;
        Ok(())
    }
}
