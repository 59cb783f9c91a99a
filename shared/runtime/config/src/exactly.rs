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

/// Reads a list of lists of exactly `N` entries for a key that may be missing.
///
/// # Errors
/// A list with another count.
pub fn each_exactly_if_given<'de, D: Deserializer<'de>, T: Deserialize<'de>, const N: usize>(
    deserializer: D,
) -> Result<Option<Vec<[T; N]>>, D::Error> {
    let Some(lists) = Option::<Vec<Vec<T>>>::deserialize(deserializer)? else { return Ok(None) };
    lists.into_iter().map(array).collect::<Result<_, _>>().map(Some)
}

/// Reads exactly `M` lists of exactly `N` entries for a key that may be missing.
///
/// # Errors
/// Another count of lists, or a list with another count.
pub fn table_if_given<'de, D: Deserializer<'de>, T: Deserialize<'de>, const N: usize, const M: usize>(
    deserializer: D,
) -> Result<Option<[[T; N]; M]>, D::Error> {
    each_exactly_if_given(deserializer)?.map(array).transpose()
}

fn array<E: Error, T, const N: usize>(entries: Vec<T>) -> Result<[T; N], E> {
    let count = entries.len();
    entries.try_into().map_err(|_| E::custom(format!("has {count} entries; accepted: {N}")))
}

#[cfg(test)]
mod tests {
    use crate::SensorLoggerSection;

    #[test]
    fn the_corners_of_a_map_have_no_third_coordinate() {
        let read = |area: &str| toml::from_str::<SensorLoggerSection>(&format!("map_area_m = {area}"));
        assert_eq!(read("[[0, 1], [2, 3]]").unwrap().map_area_m, Some([[0.0, 1.0], [2.0, 3.0]]));
        assert_eq!(toml::from_str::<SensorLoggerSection>("").unwrap().map_area_m, None);
        for (area, count) in [("[[0, 1, 5], [2, 3]]", 3), ("[[0, 1], [2, 3], [4, 5]]", 3), ("[[0, 1]]", 1)] {
            let error = read(area).unwrap_err().to_string();
            // The number given, and the number accepted.
            let numbers: Vec<u32> = error.split([' ', '\n', ';']).filter_map(|word| word.parse().ok()).collect();
            assert!(numbers.ends_with(&[count, 2]), "{error}");
        }
    }
}
