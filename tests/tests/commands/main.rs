//! The command line and its files, what other programs read of them, and how the tree is built.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod architecture;
mod command_line;
mod documents;
mod hostile_files;
mod install;
mod interoperability;
mod layouts;
mod setup;
mod solve;
