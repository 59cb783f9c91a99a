//! The machine's monotonic clock.

use rustix::thread::{ClockId, clock_nanosleep_absolute};
use rustix::time::Timespec;

const NS_PER_S: u64 = 1_000_000_000;

/// Nanoseconds of the machine's monotonic clock (`CLOCK_MONOTONIC`), the same in every process.
#[must_use]
pub fn monotonic_ns() -> u64 {
    let now = rustix::time::clock_gettime(rustix::time::ClockId::Monotonic);
    // Both parts are non-negative by the clock's definition.
    now.tv_sec.unsigned_abs() * NS_PER_S + now.tv_nsec.unsigned_abs()
}

/// Sleeps until the monotonic clock shows `until_ns`; returns at once if that has passed.
pub fn sleep_until(until_ns: u64) {
    let until = Timespec { tv_sec: (until_ns / NS_PER_S) as i64, tv_nsec: (until_ns % NS_PER_S) as i64 };
    // Only a signal ends the sleep early; the time is absolute, so the sleep can be repeated.
    while let Err(rustix::io::Errno::INTR) = clock_nanosleep_absolute(ClockId::Monotonic, &until) {}
}
