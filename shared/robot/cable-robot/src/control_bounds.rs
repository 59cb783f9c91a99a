//! Bounds of control parameters. They stand below the laws, so that configuration files are checked without the laws.

/// Longest window η of the motor model, cycles.
pub const MAX_WINDOW: usize = 128;

/// Highest gain of proportional control on cable lengths, 1/s. Drives without any delay follow it at 10 Hz and more;
/// real ones allow less.
pub const MAX_LENGTH_GAIN: f64 = 50.0;

/// Longest preview, cycles.
pub const MAX_PREVIEW: usize = 200;
