//! Errors of a plant's configuration or input.

use thiserror::Error;

/// Invalid configuration or input of the plant.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum PlantError {
    /// A number is outside its accepted range.
    #[error("{key} is {value}; accepted: {accepted}")]
    Value {
        /// Name of the field, with its unit as suffix.
        key: &'static str,
        /// Value given.
        value: f64,
        /// Accepted values.
        accepted: &'static str,
    },
    /// A list has the wrong length.
    #[error("{key} has {found} entries; accepted: {expected}, one per cable")]
    Count {
        /// Name of the field.
        key: &'static str,
        /// Number of entries given.
        found: usize,
        /// Number of entries needed.
        expected: usize,
    },
    /// Too few or too many anchors.
    #[error("anchors_m has {0} anchors; accepted: 1 to 8")]
    Anchors(usize),
    /// The node cannot hang at rest at the start position.
    #[error(
        "the node cannot hang at rest at ({:.3}, {:.3}, {:.3}) m with tensions of {} to {} N: start it inside the \
         volume below the anchors or widen the tension limits",
        position_m[0], position_m[1], position_m[2], limits_n[0], limits_n[1]
    )]
    NoEquilibrium {
        /// Start position of the configuration.
        position_m: [f64; 3],
        /// Tension limits of the configuration.
        limits_n: [f64; 2],
    },
    /// The given start tensions do not hold the node.
    #[error(
        "the given start tensions leave a force of {residual_n:.3} N on the node: leave them out to have them solved"
    )]
    Unbalanced {
        /// Remaining force, N.
        residual_n: f64,
    },
    /// A cable number after the last one.
    #[error("there is no cable {}; accepted: 1 to {count}", .cable.saturating_add(1))]
    NoSuchCable {
        /// Requested index, from 0.
        cable: usize,
        /// Number of cables.
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
