//! Energy loss of a move: section VIII of the paper.
//!
//! * [`table`]: the current of a winch, measured over speed and tension.
//! * [`parabola`]: the sagging path of (25)-(26) by its horizontal fraction, and the sag limit of the ground.
//! * [`WinchEnergy`]: the I²R loss of a move by Simpson's rule, at constant speed as in the paper or along a speed
//!   profile with its accelerations.
//! * [`lateral`]: paths that also swing sideways, which save more with self-locking gears.
//! * [`flight`]: the best parabola and the best lateral path of a configured robot.
//! * [`optimum`]: the sag with the lowest cost. With real motors the cost has several minima, and with least-sum
//!   tensions it jumps; therefore it is scanned before it is refined.
//!
//! # Example
//! ```
//! use cable_robot::{Anchors, Distribution, Vector3, energy::{Bounds, WinchEnergy}, motor::Motor, path::Parabola};
//! let anchors = Anchors::new(&[[0.0, 0.0, 6.0], [10.0, 0.0, 6.0], [10.0, 10.0, 6.0], [0.0, 10.0, 6.0]])?;
//! let motor = Motor::ideal(40.0, 1.2);
//! let winch_energy = WinchEnergy {
//!     anchors: &anchors,
//!     wrench_n: Vector3::new(0.0, 0.0, 19.62),
//!     drag_n_s2_m2: 0.0,
//!     cable_weight_n_m: 0.0,
//!     limits_n: [1.0, 150.0],
//!     method: Distribution::LeastNorm,
//!     current: &motor,
//! };
//! let (from, to) = (Vector3::new(2.5, 2.5, 4.0), Vector3::new(7.5, 2.5, 4.0));
//! let best = winch_energy.best_parabola(&from, &to, 0.2, 64, &Bounds { ground_m: Some(0.0), time_weight_w: 0.0 })?;
//! let line = best.line.expect("the straight line is possible here");
//! assert!(best.cost.energy_j < 0.7 * line.energy_j && best.cost.duration_s > line.duration_s);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod current;
mod error;
pub mod flight;
pub mod lateral;
pub mod optimum;
pub mod parabola;
pub mod table;
pub mod winch_energy;

pub use current::{Current, TableError};
pub use error::EnergyError;
pub use lateral::BestLateral;
pub use optimum::{Best, Bounds};
pub use table::{CurrentTable, MotorTable, Motors};
pub use winch_energy::{Cost, WinchEnergy};
