//! `tick`: delay of a periodic wake-up, for a thread that waits like motor-io and for an ordinary thread, both at the
//! same time.

use super::figures::{Ratio, Spread, record};
use super::scheduling;
use super::settings::Settings;
use super::watch::Watch;
use bus::clock::{Pacer, Schedule, Tick, now_ns};
use command::{Answer, Failure};
use runtime::Timing;
use serde::Serialize;
use std::time::Duration;

/// Most classes of a delay: 1 µs to 10 s.
const CLASSES: u32 = 70;

/// Wake-ups of one thread.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Ticks {
    /// Delay.
    #[serde(flatten)]
    pub lateness: Spread,
    /// 99.99 % quantile of the delay, s.
    pub p9999_s: f64,
    /// Number of wake-ups by delay: upper end of a class, s, and number; ten classes per decade, without empty ones.
    pub classes: Vec<(f64, u64)>,
    /// Number of wake-ups more than half a period late; motor-io attributes a missing answer in such a period to the
    /// computer.
    pub late: u64,
    /// Number of periods skipped because the machine stalled.
    pub skipped: u64,
    /// Number of periods from the first to the last.
    pub periods: u64,
}

impl Ticks {
    /// Returns the share of the periods that were late or skipped.
    #[must_use]
    pub fn bad_share(&self) -> f64 {
        (self.late + self.skipped) as f64 / self.periods.max(1) as f64
    }
}

/// Result of `tick`.
#[derive(Debug, Clone, Serialize)]
pub struct TickResult {
    /// Thread that waits like motor-io.
    pub ours: Ticks,
    /// Ordinary thread that sleeps for the rest of the period.
    pub plain: Ticks,
    /// Ordinary divided by motor-io.
    pub ratio: Ratio,
    /// Scheduling of the first thread.
    pub scheduling: scheduling::AchievedScheduling,
}

/// Accumulates wake-ups.
struct WakeUpCounter {
    period_ns: u64,
    lateness: Timing,
    late: u64,
    skipped: u64,
    first_due_ns: Option<u64>,
    periods: u64,
}

impl WakeUpCounter {
    fn new(period_ns: u64) -> Self {
        Self { period_ns, lateness: Timing::new(), late: 0, skipped: 0, first_due_ns: None, periods: 0 }
    }

    fn add(&mut self, tick: &Tick) {
        record(&mut self.lateness, tick.scheduled_ns, tick.woke_ns);
        self.late += u64::from(2 * tick.lateness_ns() > self.period_ns);
        self.skipped += tick.skipped;
        let first = tick.scheduled_ns.saturating_sub((1 + tick.skipped) * self.period_ns);
        let before_first = *self.first_due_ns.get_or_insert(first);
        self.periods = tick.scheduled_ns.saturating_sub(before_first) / self.period_ns;
    }

    fn result(&self) -> Ticks {
        let lateness = Spread::from_timing(&self.lateness);
        let p9999_s = (self.lateness.quantile_ns(0.9999).max(1) as f64 * 1e-9).min(lateness.worst_s);
        let classes = classes(&self.lateness);
        Ticks { lateness, p9999_s, classes, late: self.late, skipped: self.skipped, periods: self.periods }
    }
}

/// Counts delays in ten classes per decade, from 1 µs to the longest delay; the first class also has all shorter ones.
fn classes(lateness: &Timing) -> Vec<(f64, u64)> {
    let end_ns = |class: u32| libm::pow(10.0, 3.0 + f64::from(class) / 10.0).round() as u64;
    let mut found = Vec::new();
    let mut counted = 0;
    for class in 1.. {
        let high_ns = end_ns(class);
        // Delays beyond the range of the histogram are in the last class.
        let is_last = high_ns >= lateness.max_ns() || class >= CLASSES;
        let up_to = if is_last { lateness.passes() } else { lateness.count_between_ns(0, high_ns) };
        if up_to > counted {
            found.push((high_ns as f64 * 1e-9, up_to - counted));
        }
        counted = up_to.max(counted);
        if is_last {
            break;
        }
    }
    found
}

/// Measures both threads for this many seconds, half a period apart.
///
/// # Errors
/// The benchmark was stopped, or a thread failed.
pub fn measure(settings: &Settings, seconds: f64, watch: &mut Watch) -> Answer<TickResult> {
    let period_ns = settings.period_ns();
    let wanted = ((seconds * settings.rate_hz).round() as u64).max(1);
    let stop = watch.stop();
    let stopped = || stop.load(std::sync::atomic::Ordering::Relaxed);
    let (ours, plain) = std::thread::scope(|scope| {
        let ours = scope.spawn(|| {
            let (reached, _awake) = scheduling::apply(&settings.realtime);
            let (mut count, mut pacer) = (WakeUpCounter::new(period_ns), Pacer::new(period_ns));
            while count.periods < wanted && !stopped() {
                count.add(&pacer.next());
            }
            (count.result(), reached)
        });
        let plain = scope.spawn(|| {
            let (mut count, mut schedule) =
                (WakeUpCounter::new(period_ns), Schedule::new(now_ns() + period_ns / 2, period_ns));
            while count.periods < wanted && !stopped() {
                let (scheduled_ns, skipped) = schedule.next(now_ns());
                std::thread::sleep(Duration::from_nanos(scheduled_ns.saturating_sub(now_ns())));
                let woke_ns = now_ns();
                schedule.record_start(scheduled_ns, woke_ns);
                count.add(&Tick { scheduled_ns, woke_ns, skipped });
            }
            count.result()
        });
        while !(ours.is_finished() && plain.is_finished()) {
            watch.update();
            std::thread::sleep(Watch::INTERVAL);
        }
        (ours.join(), plain.join())
    });
    watch.check_stop()?;
    let ended = || Failure::NotNow("a measuring thread ended early".to_owned());
    let (ours, scheduling) = ours.map_err(|_| ended())?;
    let plain = plain.map_err(|_| ended())?;
    let ratio = Ratio::between(&plain.lateness, &ours.lateness);
    Ok(TickResult { ours, plain, ratio, scheduling })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn count(period_ns: u64, ticks: &[(u64, u64, u64)]) -> Ticks {
        let mut count = WakeUpCounter::new(period_ns);
        for &(scheduled_ns, lateness_ns, skipped) in ticks {
            count.add(&Tick { scheduled_ns, woke_ns: scheduled_ns + lateness_ns, skipped });
        }
        count.result()
    }

    #[test]
    fn more_than_half_a_period_counts_as_late() {
        let found = count(1000, &[(6000, 499, 0), (7000, 500, 0), (8000, 501, 0), (9000, 999, 0)]);
        assert_eq!((found.late, found.skipped, found.periods, found.lateness.count), (2, 0, 4, 4));
        assert_eq!(found.bad_share(), 0.5);
    }

    #[test]
    fn every_wake_up_is_in_one_class() {
        let ticks: Vec<_> = [0, 1, 999, 1000, 1259, 5_000, 5_000_000, 20_000_000_000]
            .iter()
            .enumerate()
            .map(|(k, lateness_ns)| (1_000_000_000 * (k as u64 + 1), *lateness_ns, 0))
            .collect();
        let found = count(1_000_000_000, &ticks);
        assert_eq!(found.classes.iter().map(|(_, number)| number).sum::<u64>(), 8);
        assert_eq!(found.classes[0].1, 5, "up to 1.26 µs: {:?}", found.classes);
        assert_eq!(found.classes.last().unwrap().1, 1);
        assert!(found.classes.windows(2).all(|pair| pair[0].0 < pair[1].0));
        assert_eq!(count(10, &[]).classes.iter().map(|(_, number)| number).sum::<u64>(), 0);
    }

    #[test]
    fn every_period_is_a_tick_or_skipped() {
        // A stall after the second period, and the last but one skipped.
        let found = count(10, &[(50, 1, 0), (60, 1, 0), (100, 7, 3), (120, 0, 1)]);
        assert_eq!((found.skipped, found.periods, found.late), (4, 8, 1));
        assert_eq!(found.lateness.count + found.skipped, found.periods);
        // A stall before the first period.
        let found = count(10, &[(50, 1, 2)]);
        assert_eq!((found.skipped, found.periods), (2, 3));
        assert_eq!(count(10, &[]).bad_share(), 0.0);
    }
}
