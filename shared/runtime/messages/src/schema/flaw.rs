//! What a definition can break.

use super::limits::{BYTES, DEPTH, FIELDS, SEPARATOR_LENGTH};

/// What a definition breaks, and in which line.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("schema line {line}: {what}")]
pub struct SchemaError {
    /// From 1.
    pub line: usize,
    /// What is wrong there.
    pub what: Flaw,
}

/// What is wrong in one line of a definition.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum Flaw {
    /// A line ends in CR LF.
    #[error("the line ends in CR LF; end lines in LF alone")]
    CarriageReturn,
    /// Another line than `MSG: package/Type` behind the separator of definitions.
    #[error("`{0}` stands behind the separator; expected `MSG: package/Type`")]
    NoHead(String),
    /// Two definitions of one type.
    #[error("`{0}` is defined twice")]
    TypeTwice(String),
    /// A separator of definitions of another length, or with other characters.
    #[error("the separator of definitions is exactly {SEPARATOR_LENGTH} `=`")]
    Separator,
    /// A line that is neither a field nor a constant.
    #[error("`{0}` is not `type name` or `type NAME=value`")]
    NotAMember(String),
    /// Two fields of one name in one type.
    #[error("field `{0}` stands twice")]
    FieldTwice(String),
    /// Nothing behind the last separator.
    #[error("the text ends behind a separator")]
    EndsBehindSeparator,
    /// A type without a field.
    #[error("a type without a field has one byte in some readers and none in others")]
    Empty,
    /// A constant that is no integer.
    #[error("constant `{name}` has the type `{kind}`; only integers can be constants")]
    ConstantType {
        /// Of the constant.
        name: String,
        /// Its type.
        kind: String,
    },
    /// A constant whose name has other characters than those of constants.
    #[error("constant `{0}` is not in UPPER_CASE")]
    ConstantName(String),
    /// A constant's value that is not decimal, or outside its type.
    #[error("`{value}` is not a decimal {kind} for constant `{name}`")]
    ConstantValue {
        /// What stands there.
        value: String,
        /// The constant's type.
        kind: String,
        /// Its name.
        name: String,
    },
    /// A field's name that some reader cannot take.
    #[error("`{0}` is not a field name: lower case, digits and single `_`, no `_` at an end, no Python keyword")]
    FieldName(String),
    /// An array of more dimensions, of no fixed length, or of length 0.
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
    #[error("`{path}` would stand at byte {offset}: put explicit padding before it")]
    Unaligned {
        /// Of the field.
        path: String,
        /// Where it would stand.
        offset: usize,
    },
    /// A sample that is too large.
    #[error("more than {BYTES} bytes or {FIELDS} fields in one sample")]
    TooLarge,
}
