//! Lists of numbers with an exact length. serde reads the first numbers into an array and leaves out the rest.

use serde::de::{Deserialize, Deserializer, Error};

/// Reads exactly `N` numbers.
///
/// # Errors
/// Another count.
pub fn exactly<'de, D: Deserializer<'de>, const N: usize>(deserializer: D) -> Result<[f64; N], D::Error> {
    array(Vec::deserialize(deserializer)?)
}

/// Reads exactly `N` numbers for a key that may be missing.
///
/// # Errors
/// Another count.
pub fn exactly_if_given<'de, D: Deserializer<'de>, const N: usize>(
    deserializer: D,
) -> Result<Option<[f64; N]>, D::Error> {
    Option::deserialize(deserializer)?.map(array).transpose()
}

/// Reads a list of entries of exactly `N` numbers.
///
/// # Errors
/// An entry with another count.
pub fn each_exactly<'de, D: Deserializer<'de>, const N: usize>(deserializer: D) -> Result<Vec<[f64; N]>, D::Error> {
    Vec::deserialize(deserializer)?.into_iter().map(array).collect()
}

fn array<E: Error, const N: usize>(numbers: Vec<f64>) -> Result<[f64; N], E> {
    let count = numbers.len();
    numbers.try_into().map_err(|_| E::custom(format!("has {count} numbers; accepted: {N}")))
}
