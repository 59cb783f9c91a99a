//! The mathematics of a cable-suspended robot: a node that hangs from three to eight cables, which run through eyes or
//! over swivelling pulleys (the *anchors*, see [`pulley`]) to winches. A planar robot moves in the x-z plane (y = 0) on
//! two to eight cables; everything that takes [`Anchors`] or a [`Robot`] counts directions accordingly.
//!
//! Kinematics, tension distribution, elastic statics, energy, paths, speed profiles and the check of a whole motion
//! before it starts. Equation numbers in parentheses, like (14), refer to Borgstrom et al., "Design and Implementation
//! of NIMS3D, a 3-D Cabled Robot for Actuated Sensing Applications", IEEE Transactions on Robotics 25 (2), 2009.
//!
//! # Invariants
//! * No input or output, no clock, no messages, no threads. No allocation, except when a [`Robot`] is built from its
//!   parts and when an error is formatted.
//! * SI units, z up. Cable velocity is dL/dt: positive pays out cable. Only [`motor`] uses the reel-in speed.
//! * Trigonometric and hyperbolic functions come from `libm`, and matrices have fixed sizes, so that the same input
//!   gives the same bits on every processor.
//! * Every iteration is bounded.
//!
//! # Example
//! ```
//! use cable_robot::{Distribution, Robot, RobotParts, Vector3, kinematics, tension};
//!
//! let robot = Robot::new(RobotParts {
//!     anchors_m: vec![[0.0, 0.0, 3.05], [9.8, 0.0, 3.10], [4.7, 8.6, 2.98]],
//!     node_mass_kg: 1.2,
//!     tension_limits_n: [2.0, 60.0],
//!     speed_limit_m_s: 0.4,
//!     acceleration_limit_m_s2: 0.5,
//!     ..RobotParts::default()
//! })?;
//! let position = Vector3::new(4.8, 3.0, 1.2);
//! let lengths = kinematics::inverse_kinematics(robot.anchors(), &position);
//! let back = kinematics::forward_kinematics(robot.anchors(), &lengths, None)?;
//! assert!((back.position - position).norm() < 1e-9);
//!
//! let tensions = tension::at(&robot, &position, &Vector3::zeros(), Distribution::Unique)?;
//! assert!(tensions.margin_n > 0.0);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
#![forbid(unsafe_code)]
#![allow(clippy::neg_cmp_op_on_partial_ord, reason = "`!(a <= b)` also rejects NaN, which `a > b` would accept")]
#![allow(clippy::needless_range_loop, reason = "matrix kernels read like their formulas, with indices")]

pub mod anchors;
pub mod cables;
mod calibrated;
pub mod catenary;
mod clearance;
pub mod control_bounds;
pub mod drum;
pub mod elastic;
pub mod energy;
mod keep_out;
pub mod kinematics;
pub mod limits;
pub mod linalg;
pub mod model_error;
pub mod modes;
pub mod motion;
pub mod motor;
pub mod obstacle;
pub mod path;
pub mod planar;
pub mod profile;
pub mod pulley;
pub mod rate;
pub mod robot;
mod robot_error;
mod robot_parts;
pub mod sag;
pub mod swing;
pub mod tension;
pub mod uncertainty;

pub use anchors::Anchors;
pub use cables::{CableVec, MAX_CABLES};
pub use clearance::{Border, Held};
pub use drum::{Drum, DrumParts};
pub use keep_out::KeepOut;
pub use kinematics::{Jacobian, KinematicsError, NodeJacobian, StructureMatrix};
pub use modes::{Mode, Modes};
pub use motion::{Motion, Segment, Setpoint};
pub use nalgebra::{Matrix3, Vector3};
pub use obstacle::{Contact, Obstacle};
pub use path::Path;
pub use profile::Profile;
pub use robot::Robot;
pub use robot_error::RobotError;
pub use robot_parts::{DEFAULT_LENGTH_LIMITS_M, PulleyKind, RobotParts};
pub use tension::Distribution;
pub use uncertainty::{LengthErrors, Uncertainty};

/// Standard acceleration of gravity, m/s² (CODATA, exact by convention).
pub const STANDARD_GRAVITY: f64 = 9.80665;
