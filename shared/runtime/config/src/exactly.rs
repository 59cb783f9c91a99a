//! Lists with an exact length. serde reads the first entries into an array and leaves out the rest.

use serde::de::{Deserialize, Deserializer, Error};

/// Reads exactly `N` entries.
///
/// # Errors
/// Another count.
pub fn exactly<'de, D: Deserializer<'de>, T: Deserialize<'de>, const N: usize>(
    deserializer: D,
) -> Result<[T; N], D::Error> {
    array(Vec::deserialize(deserializer)?)
}

/// Reads exactly `N` entries for a key that may be missing.
///
/// # Errors
/// Another count.
pub fn exactly_if_given<'de, D: Deserializer<'de>, T: Deserialize<'de>, const N: usize>(
    deserializer: D,
) -> Result<Option<[T; N]>, D::Error> {
    Option::deserialize(deserializer)?.map(array).transpose()
}

/// Reads a list of lists of exactly `N` entries.
///
/// # Errors
/// A list with another count.
pub fn each_exactly<'de, D: Deserializer<'de>, T: Deserialize<'de>, const N: usize>(
    deserializer: D,
) -> Result<Vec<[T; N]>, D::Error> {
    Vec::deserialize(deserializer)?.into_iter().map(array).collect()
}

fn array<E: Error, T, const N: usize>(entries: Vec<T>) -> Result<[T; N], E> {
    let count = entries.len();
    entries.try_into().map_err(|_| E::custom(format!("has {count} entries; accepted: {N}")))
}
