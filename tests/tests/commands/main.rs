//! The command line, its files, and other programs that read them.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod calculations;
mod command_line;
mod documents;
mod example_configurations;
mod hostile_files;
mod install;
mod interoperability;
mod layouts;
mod new_programs;
mod plugin_units;
mod sentences;
mod setup;
mod solve;
mod statics;
mod versions;
