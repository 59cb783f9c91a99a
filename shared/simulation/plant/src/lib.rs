//! Physics of a cable-suspended robot: drives, motors, drums, idler encoders, elastic lines and the node.
//!
//! The plant stands where the hardware stands. It takes what a motor drive is told (speed or duty) and gives what a
//! drive can measure (encoder counts, current, supply), plus the truth that only a simulation knows. It is written
//! apart from the estimator on purpose: delays, encoder steps, friction, drag, stretch and line lost on a slack
//! idler are here, so that the software above has something real to be wrong about.
//!
//! From the drive to the node, one room each:
//!
//! | module | what it models |
//! |---|---|
//! | [`drive`] | command delay and lag, speed loop at 300 Hz on encoder counts, saturation |
//! | [`motor`] | brushed motor and gear seen from the line: quasi-static current, friction, inertia, self-locking |
//! | [`drum`] | radius that grows with every layer of line |
//! | [`mod@line`] | elastic line that cannot push; the idler and its encoder |
//! | [`node`] | point mass with weight or buoyancy, drag and soft ground; in space or in a plane |
//! | [`ground`] | what a sensor on the node sees: things on the ground, quantities that differ from place to place |
//! | [`statics`] | the tensions that hold the node at rest at the start |
//!
//! # Invariants
//! * No clock, no input or output, no randomness but the configured seed: the same configuration and the same inputs
//!   give the same bits. Trigonometric and hyperbolic functions come from `libm`.
//! * Speeds and lengths are positive when line is paid out; only [`motor`] speaks of reel-in.
//! * [`Plant::step`] allocates nothing.
//!
//! # Example
//! ```
//! use plant::{MotorInput, Plant, PlantConfig};
//!
//! let anchors = vec![[0.0, 0.0, 3.05], [9.8, 0.0, 3.10], [4.7, 8.6, 2.98]];
//! let mut plant = Plant::new(PlantConfig::new(anchors, [4.8, 2.9, 1.0]))?;
//! let pay_out = plant.speed_input(0, 0.05);
//! for _ in 0..100 {
//!     plant.step(0.01, &[pay_out, pay_out, pay_out])?;
//! }
//! assert!(plant.position_m()[2] < 1.0);
//! assert!(plant.tensions_n().iter().all(|&t| t > 0.0));
//! # Ok::<(), plant::PlantError>(())
//! ```
#![forbid(unsafe_code)]

pub mod config;
pub mod drive;
pub mod drum;
mod error;
pub mod ground;
pub mod line;
pub mod motor;
pub mod node;
mod plant;
pub mod statics;

pub use config::PlantConfig;
pub use drive::{MotorInput, SpeedGains};
pub use error::PlantError;
pub use plant::{Fault, Plant};

/// Most cables a plant can have.
pub const MAX_CABLES: usize = 8;

/// Standard acceleration of gravity, m/s² (CGPM 1901).
pub const STANDARD_GRAVITY: f64 = 9.80665;
