//! The clock of all processes, and a pacer for periodic work.

use rustix::thread::{ClockId, clock_nanosleep_absolute};
use rustix::time::{Timespec, clock_gettime};

/// Nanoseconds per second.
pub const SECOND_NS: u64 = 1_000_000_000;

/// Returns the time of CLOCK_MONOTONIC, ns: the clock of every stamp.
#[must_use]
pub fn now_ns() -> u64 {
    let now = clock_gettime(ClockId::Monotonic);
    now.tv_sec as u64 * SECOND_NS + now.tv_nsec as u64
}

/// Returns the wall clock, ns since 1970, for mapping stamps to calendar time; it may jump.
#[must_use]
pub fn unix_ns() -> u64 {
    let now = clock_gettime(ClockId::Realtime);
    now.tv_sec as u64 * SECOND_NS + now.tv_nsec as u64
}

/// One instant on both clocks. All conversions of a run's stamps to calendar time use the same instant, so that neither
/// a step of the wall clock nor the time between two readings of the clocks makes them inconsistent.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct WallClock {
    /// Wall clock, ns since 1970.
    pub unix_ns: u64,
    /// CLOCK_MONOTONIC, ns.
    pub mono_ns: u64,
}

impl WallClock {
    /// Reads both clocks.
    #[must_use]
    pub fn now() -> Self {
        Self { unix_ns: unix_ns(), mono_ns: now_ns() }
    }

    /// Returns the offset to add to a stamp for its UNIX time, ns.
    #[must_use]
    pub fn offset_ns(&self) -> i64 {
        self.unix_ns.cast_signed().wrapping_sub(self.mono_ns.cast_signed())
    }
}

/// Sleeps until CLOCK_MONOTONIC reaches `deadline_ns`; signals do not end the sleep.
pub fn sleep_until(deadline_ns: u64) {
    let at = Timespec { tv_sec: (deadline_ns / SECOND_NS) as i64, tv_nsec: (deadline_ns % SECOND_NS) as i64 };
    // A signal interrupts the sleep; the deadline is absolute, so repeat.
    while clock_nanosleep_absolute(ClockId::Monotonic, &at).is_err() {}
}

/// The start of a period.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Tick {
    /// Time when it was due, ns.
    pub scheduled_ns: u64,
    /// Time when the process woke up, ns.
    pub woke_ns: u64,
    /// Periods skipped since the last tick, because the machine stalled or the work took too long.
    pub skipped: u64,
}

impl Tick {
    /// Returns the lateness of the wake-up, ns.
    #[must_use]
    pub fn lateness_ns(&self) -> u64 {
        self.woke_ns.saturating_sub(self.scheduled_ns)
    }
}

/// The grid of due times; computes the next due time without reading a clock.
///
/// Two ticks start at least half a period apart, so a stall causes skipped periods and no burst.
#[derive(Debug, Clone)]
pub struct Schedule {
    period_ns: u64,
    last_ns: u64,
    last_woke_ns: u64,
}

impl Schedule {
    /// Creates a grid whose first due time is `start_ns` plus one period; a period of 0 becomes 1 ns.
    #[must_use]
    pub fn new(start_ns: u64, period_ns: u64) -> Self {
        Self { period_ns: period_ns.max(1), last_ns: start_ns, last_woke_ns: start_ns }
    }

    /// Returns the next due time and the number of periods skipped before it.
    ///
    /// A due time that has passed is late, not skipped, if it is the newest one and the last tick started at least half
    /// a period before it.
    #[must_use]
    pub fn next(&self, now_ns: u64) -> (u64, u64) {
        let newest_passed = now_ns.saturating_sub(self.last_ns) / self.period_ns;
        let mut steps = newest_passed.max(1);
        while self.last_ns + steps * self.period_ns < self.last_woke_ns + self.period_ns / 2 {
            steps += 1;
        }
        (self.last_ns + steps * self.period_ns, steps - 1)
    }

    /// Records the start of the tick that was due at `scheduled_ns`.
    pub fn record_start(&mut self, scheduled_ns: u64, woke_ns: u64) {
        (self.last_ns, self.last_woke_ns) = (scheduled_ns, woke_ns);
    }

    /// Returns the period, ns.
    #[must_use]
    pub fn period_ns(&self) -> u64 {
        self.period_ns
    }
}

/// A pacer for periodic work at absolute times: no drift and no bursts after a stall.
#[derive(Debug)]
pub struct Pacer {
    schedule: Schedule,
}

impl Pacer {
    /// Creates a pacer whose grid starts now.
    #[must_use]
    pub fn new(period_ns: u64) -> Self {
        Self { schedule: Schedule::new(now_ns(), period_ns) }
    }

    /// Sleeps until the next due time; returns at once if it has passed.
    #[allow(clippy::should_implement_trait)] // endless, and it sleeps
    pub fn next(&mut self) -> Tick {
        let (scheduled_ns, skipped) = self.schedule.next(now_ns());
        sleep_until(scheduled_ns);
        let woke_ns = now_ns();
        self.schedule.record_start(scheduled_ns, woke_ns);
        Tick { scheduled_ns, woke_ns, skipped }
    }

    /// Returns the time when the next tick is due, ns, for callers that wait for other events until then.
    #[must_use]
    pub fn due_ns(&self) -> u64 {
        self.schedule.next(now_ns()).0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn on_time_nothing_is_skipped() {
        let mut schedule = Schedule::new(1000, 10);
        for k in 1..50 {
            let (due, skipped) = schedule.next(1000 + 10 * (k - 1) + 3);
            assert_eq!((due, skipped), (1000 + 10 * k, 0));
            schedule.record_start(due, due + 1);
        }
    }

    #[test]
    fn periods_of_a_stall_are_skipped_and_the_grid_is_kept() {
        let mut schedule = Schedule::new(0, 10);
        schedule.record_start(10, 10);
        // At 137, the newest due time that has passed is 130; 20..=120 are skipped.
        let (due, skipped) = schedule.next(137);
        assert_eq!((due, skipped), (130, 11));
        schedule.record_start(due, 137);
        // 140 would be only 3 after the last start, so it is skipped too.
        assert_eq!(schedule.next(138), (150, 1));
    }

    #[test]
    fn ticks_are_at_least_half_a_period_apart() {
        let mut schedule = Schedule::new(0, 1000);
        let (mut now, mut last, mut random) = (0_u64, 0_u64, 12345_u64);
        for pass in 0..10_000 {
            random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            now += random >> 53; // work of 0 to 2047
            let (due, _) = schedule.next(now);
            now = now.max(due);
            assert!(due % 1000 == 0 && (pass == 0 || now >= last + 500), "{last} {now}");
            schedule.record_start(due, now);
            last = now;
        }
    }

    #[test]
    fn the_pacer_never_wakes_early() {
        let mut pacer = Pacer::new(1_000_000);
        for _ in 0..20 {
            let tick = pacer.next();
            assert!(tick.woke_ns >= tick.scheduled_ns);
        }
    }
}
