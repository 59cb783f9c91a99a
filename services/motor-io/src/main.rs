//! motor-io.

fn main() {}
