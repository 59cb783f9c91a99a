//! A value and how well it is known.

/// A value with its standard deviation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Value {
    /// Value.
    pub value: f64,
    /// Standard deviation.
    pub sigma: f64,
}
