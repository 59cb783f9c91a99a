//! Publishes the robot as messages that ROS 2 itself defines, so that tools can draw it in three dimensions.
//!
//! Foxglove, Lichtblick, RViz, rerun and other tools that read `tf2_msgs/TFMessage`, `geometry_msgs/PoseStamped`,
//! `nav_msgs/Path`, `visualization_msgs/MarkerArray`, `sensor_msgs/PointCloud2`, `nav_msgs/OccupancyGrid` and
//! `rcl_interfaces/Log` show the node, cables and anchors, the planned and the flown path, the sensors' measurements
//! and their maps, without a plug-in.
//!
//! Invariants:
//! * [`Visualization`] is pure: samples in as bytes, CDR bodies out; the same for live samples ([`process`]) and
//!   recorded runs.
//! * Every body of a type has the same length, so it fits a sample of fixed size ([`messages::ros`]).
//! * No other process depends on it: the robot flies without it.

#![forbid(unsafe_code)]

mod drawing;
mod grid;
pub mod process;

pub use drawing::{Drawing, Kind, Visualization};
