//! Physics of a cable-suspended robot: drives, motors, drums, idler encoders, elastic cables and the node.
//!
//! The plant replaces the hardware. Its inputs are the commands of a motor drive (speed or duty), its outputs the
//! measurements of a drive (encoder counts, current, supply), and the truth, which only a simulation has. Its code is
//! deliberately independent of the estimator: it models delays, encoder steps, friction, drag, stretch and motion lost
//! at a slack idler, so that the control software has realistic model errors.
//!
//! The modules, from the drive to the node:
//!
//! | module | what it models |
//! |---|---|
//! | [`drive`] | command delay and lag, speed loop at 300 Hz on encoder counts, saturation |
//! | [`motor`] | brushed motor and gear seen from the cable: quasi-static current, friction, inertia, self-locking |
//! | [`drum`] | radius that grows with every layer of cable |
//! | [`mod@line`] | elastic cable that cannot push; the idler and its encoder |
//! | [`node`] | point mass with weight or buoyancy, drag and soft ground; in space or in a plane |
//! | [`ground`] | input of sensors on the node: objects on the ground, quantities that vary with position |
//! | [`pulley`] | eyes and wheels from which the cables leave, with geometry of their own |
//! | [`world`] | what a model leaves out: play, friction of pulleys, weight, temperature, poles, wind, swing |
//! | [`statics`] | tensions that hold the node at rest at the start |
//!
//! # Invariants
//! * No clock, no input or output, no randomness except the configured seed: the same configuration and the same inputs
//!   give the same bits. Trigonometric and hyperbolic functions come from `libm`.
//! * Speeds and lengths are positive when cable is paid out; only [`motor`] uses the reel-in speed.
//! * [`Plant::step`] does not allocate.
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

mod cable;
pub mod config;
pub mod drive;
pub mod drum;
mod error;
pub mod ground;
pub mod line;
pub mod motor;
pub mod node;
mod plant;
pub mod pulley;
pub mod random;
pub mod statics;
mod swing;
mod weather;
pub mod world;

pub use config::PlantConfig;
pub use drive::{MotorInput, SpeedGains};
pub use error::PlantError;
pub use plant::{Fault, Plant};
pub use world::World;

/// Largest number of cables of a plant.
pub const MAX_CABLES: usize = 8;

/// Standard acceleration of gravity, m/s² (CGPM 1901).
pub const STANDARD_GRAVITY: f64 = 9.80665;
