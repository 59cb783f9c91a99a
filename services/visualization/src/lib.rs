//! The robot as tools draw it in three dimensions: messages that ROS 2 itself defines, made from the robot's own.
//!
//! Foxglove, Lichtblick, RViz, rerun and whoever else knows `tf2_msgs/TFMessage`, `geometry_msgs/PoseStamped`, `nav_msgs/Path`,
//! `visualization_msgs/MarkerArray`, `sensor_msgs/PointCloud2` and `rcl_interfaces/Log` shows where the node is, its lines and anchors, where
//! it is to go and has been, and what its sensors measured, without a plug-in.
//!
//! Invariants:
//! * [`Visualization`] is pure: it takes samples as bytes and gives CDR bodies; live ([`process`]) and from old runs alike.
//! * Every body of a type has the same length, so that it travels as a sample of fixed size ([`messages::ros`]).
//! * Nothing depends on it: the robot flies without it.

#![forbid(unsafe_code)]

mod cdr;
mod drawing;
pub mod process;

pub use drawing::{Drawing, Kind, Visualization};
