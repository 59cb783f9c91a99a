//! One number per cable, without allocation.
//!
//! A [`CableVec`] has 0 to [`MAX_CABLES`] entries; the field or function that uses it defines their meaning and unit.
//! The only error is too many entries.

use std::ops::{Deref, DerefMut};

use thiserror::Error;

/// Largest number of cables of a robot. Messages carry arrays of this length.
pub const MAX_CABLES: usize = 8;

/// Error: more values than a robot can have cables.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[error("{given} values for cables were given, and a robot has at most {MAX_CABLES} cables")]
pub struct TooManyCables {
    /// Number of values given.
    pub given: usize,
}

/// One `f64` per cable (lengths, velocities, tensions): used as a slice, stored as an array.
///
/// ```
/// use cable_robot::CableVec;
/// let lengths = CableVec::from_slice(&[5.1, 4.9, 6.0])?;
/// assert_eq!(lengths.len(), 3);
/// assert_eq!(lengths.to_array8()[3], 0.0);
/// # Ok::<(), cable_robot::cables::TooManyCables>(())
/// ```
#[derive(Clone, Copy, PartialEq)]
pub struct CableVec {
    values: [f64; MAX_CABLES],
    len: usize,
}

impl CableVec {
    /// Returns `n` zeros; `n` above [`MAX_CABLES`] counts as [`MAX_CABLES`].
    #[inline]
    pub const fn zeros(n: usize) -> Self {
        let len = if n > MAX_CABLES { MAX_CABLES } else { n };
        Self { values: [0.0; MAX_CABLES], len }
    }

    /// Returns the same value for each of `n` cables; `n` above [`MAX_CABLES`] counts as [`MAX_CABLES`].
    #[inline]
    pub fn repeat(n: usize, value: f64) -> Self {
        Self::from_fn(n, |_| value)
    }

    /// Copies a slice of at most [`MAX_CABLES`] values.
    #[inline]
    pub fn from_slice(values: &[f64]) -> Result<Self, TooManyCables> {
        if values.len() > MAX_CABLES {
            return Err(TooManyCables { given: values.len() });
        }
        Ok(Self::from_fn(values.len(), |i| values[i]))
    }

    /// Copies the first `n` values of a message's array; `n` above [`MAX_CABLES`] counts as [`MAX_CABLES`].
    #[inline]
    pub fn from_array8(values: &[f64; MAX_CABLES], n: usize) -> Self {
        Self::from_fn(n, |i| values[i])
    }

    /// Copies an array of at most [`MAX_CABLES`] values; more do not compile.
    #[inline]
    pub(crate) fn from_array<const N: usize>(given: [f64; N]) -> Self {
        const { assert!(N <= MAX_CABLES) };
        let mut values = [0.0; MAX_CABLES];
        values[..N].copy_from_slice(&given);
        Self { values, len: N }
    }

    /// Computes the value of each of `n` cables from its index; `n` above [`MAX_CABLES`] counts as [`MAX_CABLES`].
    #[inline]
    pub fn from_fn(n: usize, mut value: impl FnMut(usize) -> f64) -> Self {
        let mut result = Self::zeros(n);
        for i in 0..result.len {
            result.values[i] = value(i);
        }
        result
    }

    /// Takes the values of `n` cables two by two; an odd last one is the first of a pair. `n` above [`MAX_CABLES`]
    /// counts as [`MAX_CABLES`].
    #[inline]
    pub(crate) fn from_pairs(n: usize, pairs: impl Iterator<Item = [f64; 2]>) -> Self {
        let mut result = Self::zeros(n);
        for (values, pair) in result.values.as_chunks_mut().0.iter_mut().zip(pairs) {
            *values = pair;
        }
        if let Some(unused) = result.values.get_mut(result.len) {
            *unused = 0.0;
        }
        result
    }

    /// Returns the values padded with zeros, as messages carry them.
    pub const fn to_array8(&self) -> [f64; MAX_CABLES] {
        self.values
    }

    /// Applies a function to every value.
    #[inline]
    pub fn map(&self, mut f: impl FnMut(f64) -> f64) -> Self {
        Self::from_fn(self.len, |i| f(self.values[i]))
    }

    /// Applies a function to every value and the value of the same cable in `other`; as long as the shorter of the two.
    #[inline]
    pub fn zip_map(&self, other: &[f64], mut f: impl FnMut(f64, f64) -> f64) -> Self {
        Self::from_fn(self.len.min(other.len()), |i| f(self.values[i], other[i]))
    }

    /// Sum of the values.
    #[inline]
    pub fn sum(&self) -> f64 {
        self.iter().sum()
    }

    /// Sum of the squares.
    #[inline]
    pub fn norm_squared(&self) -> f64 {
        self.iter().map(|v| v * v).sum()
    }

    /// Largest magnitude; NaN if any value is NaN.
    #[inline]
    pub fn max_abs(&self) -> f64 {
        self.iter().fold(0.0, |m: f64, v| if v.is_nan() || m.is_nan() { f64::NAN } else { m.max(v.abs()) })
    }

    /// True if every value is finite.
    #[inline]
    pub fn is_finite(&self) -> bool {
        self.iter().all(|v| v.is_finite())
    }
}

impl Deref for CableVec {
    type Target = [f64];
    #[inline]
    fn deref(&self) -> &[f64] {
        &self.values[..self.len]
    }
}

impl DerefMut for CableVec {
    #[inline]
    fn deref_mut(&mut self) -> &mut [f64] {
        &mut self.values[..self.len]
    }
}

impl std::fmt::Debug for CableVec {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_list().entries(self.iter()).finish()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nine_values_are_refused() {
        let error = CableVec::from_slice(&[0.0; 9]).unwrap_err();
        assert_eq!(error, TooManyCables { given: 9 });
        assert!(["9", "8"].iter().all(|number| error.to_string().contains(number)), "{error}");
    }

    #[test]
    fn unused_places_stay_zero() {
        let mut v = CableVec::repeat(3, 2.0);
        v[2] = 5.0;
        assert_eq!(v.to_array8(), [2.0, 2.0, 5.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
        assert_eq!(CableVec::zeros(99).len(), MAX_CABLES);
    }

    #[test]
    fn a_nan_is_not_hidden_by_the_largest_magnitude() {
        assert!(CableVec::from_slice(&[1.0, f64::NAN, 2.0]).unwrap().max_abs().is_nan());
    }
}
