//! Errors in the text of a definition.

use super::limits::{BYTES, DEPTH, SEPARATOR_LENGTH};

/// An error in a definition, and its line.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("schema line {line}: {what}")]
pub struct SchemaError {
    /// Line number, from 1.
    pub line: usize,
    /// The error.
    pub what: Flaw,
}

/// Error in one line of a definition.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum Flaw {
    /// A line ends in CR LF.
    #[error("the line ends in CR LF; end lines in LF alone")]
    CarriageReturn,
    /// The line after a separator of definitions is not `MSG: package/Type`.
    #[error("`{0}` follows the separator; expected `MSG: package/Type`")]
    NoHead(String),
    /// Two definitions of one type.
    #[error("`{0}` is defined twice")]
    TypeTwice(String),
    /// A separator of definitions with a wrong length or other characters.
    #[error("the separator of definitions is exactly {SEPARATOR_LENGTH} `=`")]
    Separator,
    /// A line that is neither a field nor a constant.
    #[error("`{0}` is not `type name` or `type NAME=value`")]
    NotAMember(String),
    /// Two fields of a type have the same name.
    #[error("field `{0}` is defined twice")]
    FieldTwice(String),
    /// No definition after the last separator.
    #[error("the text ends after a separator; add a definition or remove the separator")]
    EndsBehindSeparator,
    /// A type without a field.
    #[error("a type without a field has one byte in some readers and none in others")]
    Empty,
    /// A constant that is not an integer.
    #[error("constant `{name}` has the type `{kind}`; only integers can be constants")]
    ConstantType {
        /// Name of the constant.
        name: String,
        /// Its type.
        kind: String,
    },
    /// A constant whose name is not in upper case.
    #[error("constant `{0}` is not in UPPER_CASE")]
    ConstantName(String),
    /// The value of a constant is not decimal or does not fit its type.
    #[error("`{value}` is not a decimal {kind} for constant `{name}`")]
    ConstantValue {
        /// The text of the value.
        value: String,
        /// The constant's type.
        kind: String,
        /// Its name.
        name: String,
    },
    /// A field name that some reader rejects.
    #[error("`{0}` is not a field name: lower case, digits and single `_`, no `_` at an end, no Python keyword")]
    FieldName(String),
    /// An array with more than one dimension, without a fixed length, or of length 0.
    #[error("`{0}`: only arrays of one dimension and fixed length, e.g. [8]")]
    Array(String),
    /// A type outside the subset.
    #[error("`{0}` is neither a number type nor `package/Type`; strings, char and byte are not used")]
    FieldType(String),
    /// Types nested too deep.
    #[error("types are nested more than {DEPTH} deep, or in themselves")]
    TooDeep,
    /// A nested type that the text does not define.
    #[error("type `{0}` is not defined in this text")]
    Undefined(String),
    /// A number that is not at a multiple of its own size.
    #[error("`{path}` would start at byte {offset}: put explicit padding before it")]
    Unaligned {
        /// Path of the field.
        path: String,
        /// Its offset without padding, bytes.
        offset: usize,
    },
    /// A sample that is too large.
    #[error("more than {BYTES} bytes or {fields} fields in one sample")]
    TooLarge {
        /// Most fields.
        fields: usize,
    },
}
