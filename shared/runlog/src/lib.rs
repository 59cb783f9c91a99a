//! Run files: write, recover, read.
