//! proptest.

fn main() {}
