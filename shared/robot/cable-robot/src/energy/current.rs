//! Current of a winch motor: the interface of the friction model and of the measured tables.

use thiserror::Error;

use crate::drum::Drum;
use crate::motor::Motor;

/// Current of a winch motor at the cable of the bare drum: the friction model or a measured table.
pub trait Current {
    /// Armature current, A, for a tension, N, and a reel-in speed -dL/dt, m/s. Fails outside the measured range.
    fn current_a(&self, tension_n: f64, reel_in_m_s: f64) -> Result<f64, TableError>;

    /// The same for the motor of a cable, counted from 0, where motors differ.
    fn current_of_a(&self, _cable: usize, tension_n: f64, reel_in_m_s: f64) -> Result<f64, TableError> {
        self.current_a(tension_n, reel_in_m_s)
    }

    /// Drum of a cable, counted from 0: a fuller one pulls harder and turns slower than the bare one. Without layers
    /// unless stated.
    fn drum(&self, _cable: usize) -> Drum {
        Drum::default()
    }

    /// Armature resistance, Ω.
    fn resistance_ohm(&self) -> f64;
}

impl Current for Motor {
    fn current_a(&self, tension_n: f64, reel_in_m_s: f64) -> Result<f64, TableError> {
        Ok(Motor::current_a(self, tension_n, reel_in_m_s))
    }

    fn resistance_ohm(&self) -> f64 {
        self.resistance_ohm
    }
}

/// Error of a table that cannot be built or does not cover a point.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum TableError {
    /// The data do not form a table.
    #[error("{what}; give rising finite speeds and tensions, two or more of each, and a row of currents per speed")]
    Shape {
        /// Description of the problem.
        what: String,
    },
    /// Point outside the measured range; nothing is extrapolated.
    #[error(
        "the {what} of {value:.6} {unit} is outside the measured {low} to {high} {unit}; measure further or move within"
    )]
    OutOfRange {
        /// Quantity: speed or tension.
        what: &'static str,
        /// Requested value.
        value: f64,
        /// Unit of the value.
        unit: &'static str,
        /// Lowest measured value.
        low: f64,
        /// Highest measured value.
        high: f64,
    },
}

impl TableError {
    /// Error kind for programs: `invalid_argument` or `out_of_range`.
    pub fn kind(&self) -> &'static str {
        match self {
            Self::Shape { .. } => "invalid_argument",
            Self::OutOfRange { .. } => "out_of_range",
        }
    }
}
