//! Reads the source tree for the tests of this crate: packages with their dependencies, and which file of a crate
//! imports which.
//!
//! Depends on no other crate of the project, so the rules are checked seconds after a change.
#![forbid(unsafe_code)]

pub mod modules;
pub mod packages;

pub use packages::{Package, packages, root, sources};
