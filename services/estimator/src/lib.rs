//! Motor state to node estimate.
