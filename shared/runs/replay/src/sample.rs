//! A sample of any type as JSON and as text lines, by its definition.

use messages::schema::{Number, Schema, Value as FieldValue};
use serde_json::{Map, Value, json};

/// Most bytes that are shown.
const MOST_BYTES: usize = 4096;

/// Returns a sample as JSON, by its schema; without a matching schema, the bytes in hexadecimal, or how many they are.
#[must_use]
pub fn sample_value(schema: Option<&Schema>, bytes: &[u8]) -> Value {
    let Some(schema) = schema else {
        // The beginning of a picture says nothing.
        let shown = if bytes.len() > MOST_BYTES { json!(bytes.len()) } else { json!(messages::hex(bytes)) };
        return json!({ "bytes": shown });
    };
    let mut fields = Map::new();
    for (field, value) in schema.decode(bytes) {
        // Skip padding fields.
        if field.path.rsplit('.').next().is_some_and(|last| last.starts_with("pad") && last[3..].parse::<u8>().is_ok())
        {
            continue;
        }
        let shown = match (value.number(), field.count) {
            (Some(number), None) => field.name_of(number).map_or_else(|| to_json(number), |name| json!(name)),
            _ => array(&value),
        };
        fields.insert(field.path.clone(), shown);
    }
    Value::Object(fields)
}

fn array(value: &FieldValue<'_>) -> Value {
    match value.text() {
        Some(text) => json!(text),
        None => Value::Array(value.numbers().map(to_json).collect()),
    }
}

/// Returns a number as JSON; NaN and infinities, which JSON lacks, become null.
fn to_json(number: Number) -> Value {
    match number {
        Number::Unsigned(value) => json!(value),
        Number::Signed(value) => json!(value),
        Number::Float32(value) => json!(value),
        Number::Float64(value) => json!(value),
    }
}
