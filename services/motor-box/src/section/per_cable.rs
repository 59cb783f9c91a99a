//! A number for all cables, or one for each.

use serde::{Deserialize, Deserializer, Serialize, Serializer};
use toml::Value;

/// `5.0`: for all cables; `[5.0, 5.1, 4.9]`: one for each.
#[derive(Debug, Clone, PartialEq)]
pub enum PerCable {
    /// The same for all cables.
    All(f64),
    /// One number for each cable.
    Each(Vec<f64>),
}

impl PerCable {
    /// The number for a cable; a checked section has one for each.
    #[must_use]
    pub fn at(&self, cable: usize) -> f64 {
        match self {
            Self::All(value) => *value,
            Self::Each(values) => values.get(cable).copied().unwrap_or(f64::NAN),
        }
    }

    /// All numbers.
    #[must_use]
    pub fn values(&self) -> &[f64] {
        match self {
            Self::All(value) => std::slice::from_ref(value),
            Self::Each(values) => values,
        }
    }
}

impl<'de> Deserialize<'de> for PerCable {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let number = |value: &Value| value.as_float().or_else(|| value.as_integer().map(|integer| integer as f64));
        let value = Value::deserialize(deserializer)?;
        let read = match &value {
            Value::Array(values) => values.iter().map(number).collect::<Option<_>>().map(Self::Each),
            one => number(one).map(Self::All),
        };
        let sentence = || serde::de::Error::custom(format!("is {value}; accepted: a number, or one for each cable"));
        read.ok_or_else(sentence)
    }
}

impl Serialize for PerCable {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::All(value) => value.serialize(serializer),
            Self::Each(values) => values.serialize(serializer),
        }
    }
}
