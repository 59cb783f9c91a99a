//! tempfile.

fn main() {}
