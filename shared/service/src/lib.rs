//! The chassis of a process.
