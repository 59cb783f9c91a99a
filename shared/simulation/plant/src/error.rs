//! What can be wrong with a plant's configuration or input.

use thiserror::Error;

/// A configuration or an input that the plant cannot work with.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum PlantError {
    /// A number is outside what makes sense for it.
    #[error("{key} is {value}, but has to be {accepted}")]
    Value {
        /// Name of the field, with its unit as suffix.
        key: &'static str,
        /// What was given.
        value: f64,
        /// What would be accepted.
        accepted: &'static str,
    },
    /// A list has the wrong length.
    #[error("{key} has {found} entries, but {expected} are needed: one per cable")]
    Count {
        /// Name of the field.
        key: &'static str,
        /// Entries given.
        found: usize,
        /// Entries needed.
        expected: usize,
    },
    /// Too few or too many anchors.
    #[error("{0} anchors given, but a plant has 1 to 8")]
    Anchors(usize),
    /// The node cannot hang at rest where it was told to start.
    #[error(
        "the node cannot hang at rest at ({:.3}, {:.3}, {:.3}) m with tensions of {} to {} N: start it inside the \
         volume below the anchors or widen the tension limits",
        position_m[0], position_m[1], position_m[2], limits_n[0], limits_n[1]
    )]
    NoEquilibrium {
        /// The start position asked for.
        position_m: [f64; 3],
        /// Tension limits the solution was looked for in.
        limits_n: [f64; 2],
    },
    /// The given start tensions do not hold the node.
    #[error(
        "the given start tensions leave a force of {residual_n:.3} N on the node: leave them out to have them solved"
    )]
    Unbalanced {
        /// Force left over, N.
        residual_n: f64,
    },
    /// A cable number beyond the last one.
    #[error("there is no cable {}; accepted: 1 to {count}", .cable.saturating_add(1))]
    NoSuchCable {
        /// Index asked for, from 0.
        cable: usize,
        /// Cables there are.
        count: usize,
    },
}

/// Checks that `value` is finite and satisfies `accept`.
pub(crate) fn check(
    key: &'static str,
    value: f64,
    accepted: &'static str,
    accept: impl Fn(f64) -> bool,
) -> Result<(), PlantError> {
    if value.is_finite() && accept(value) { Ok(()) } else { Err(PlantError::Value { key, value, accepted }) }
}
