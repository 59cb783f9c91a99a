//! One offset per run between the clock of the control cycle (CLOCK_MONOTONIC) and UNIX time.

use std::fs;

use rustix::time::{ClockId, clock_gettime};
use serde::{Deserialize, Serialize};

/// One instant on both clocks. Every stamp of a run is converted with it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct RunClock {
    /// UNIX time, ns.
    pub t0_unix_ns: u64,
    /// CLOCK_MONOTONIC of the same instant, ns.
    pub t0_mono_ns: u64,
}

/// A stamp older than this may come from another clock and is not used as the publication time, ns.
const OLD_NS: u64 = 60_000_000_000;

/// Publication time of a sample received at `now_ns`, CLOCK_MONOTONIC, ns.
///
/// A foreign sample carries only the time at which its content was valid. In the control loop that is at most a few
/// milliseconds before the publication. A stamp in the future (a prediction) or from another clock is replaced by
/// `now_ns`.
#[must_use]
pub fn published_ns(stamp_ns: u64, now_ns: u64) -> u64 {
    let plausible = stamp_ns > 0 && stamp_ns.saturating_add(OLD_NS) >= now_ns;
    if plausible { stamp_ns.min(now_ns) } else { now_ns }
}

/// Metadata key of the boot id: CLOCK_MONOTONIC restarts at every boot.
pub(crate) const BOOT_ID: &str = "boot_id";

pub(crate) fn boot_id() -> String {
    fs::read_to_string("/proc/sys/kernel/random/boot_id").unwrap_or_default().trim().to_owned()
}

impl RunClock {
    /// Reads both clocks.
    #[must_use]
    pub fn now() -> Self {
        // the second clock is read between two readings of the first; the pair with the shortest interval was disturbed
        // least
        (0..5)
            .map(|_| {
                let before = nanoseconds(ClockId::Monotonic);
                let unix = nanoseconds(ClockId::Realtime);
                let after = nanoseconds(ClockId::Monotonic);
                debug_assert!(after >= before, "CLOCK_MONOTONIC went back from {before} to {after}");
                (after - before, Self { t0_unix_ns: unix, t0_mono_ns: before + (after - before) / 2 })
            })
            .min_by_key(|(width, _)| *width)
            .map_or(Self { t0_unix_ns: 0, t0_mono_ns: 0 }, |(_, clock)| clock)
    }

    /// The clock stored in the metadata of a run file.
    pub(crate) fn from_about(about: &std::collections::BTreeMap<String, String>) -> Option<Self> {
        let number = |key: &str| about.get(key)?.parse().ok();
        Some(Self { t0_unix_ns: number("t0_unix_ns")?, t0_mono_ns: number("t0_mono_ns")? })
    }

    /// UNIX time of a CLOCK_MONOTONIC stamp, ns.
    #[must_use]
    pub fn unix_of(&self, mono_ns: u64) -> u64 {
        shift(mono_ns, self.t0_mono_ns, self.t0_unix_ns)
    }

    /// CLOCK_MONOTONIC stamp of a UNIX time, ns.
    #[must_use]
    pub fn mono_of(&self, unix_ns: u64) -> u64 {
        shift(unix_ns, self.t0_unix_ns, self.t0_mono_ns)
    }
}

fn shift(value: u64, from: u64, to: u64) -> u64 {
    let shifted = i128::from(value) - i128::from(from) + i128::from(to);
    u64::try_from(shifted.clamp(0, i128::from(u64::MAX))).unwrap_or(u64::MAX)
}

fn nanoseconds(clock: ClockId) -> u64 {
    let time = clock_gettime(clock);
    (time.tv_sec as u64).wrapping_mul(1_000_000_000).wrapping_add(time.tv_nsec as u64)
}

/// Formats a UNIX time in ns as `2026-03-01 14:05:09 UTC`.
#[must_use]
pub fn utc(unix_ns: u64) -> String {
    let seconds = unix_ns / 1_000_000_000;
    let (days, rest) = (seconds / 86_400, seconds % 86_400);
    // the calendar repeats every 400 years (146,097 days); years are counted from March, so the leap day is the last
    // day of a year
    let shifted = days + 719_468;
    let (era, day_of_era) = (shifted / 146_097, shifted % 146_097);
    let year_of_era = (day_of_era - day_of_era / 1_460 + day_of_era / 36_524 - day_of_era / 146_096) / 365;
    let day_of_year = day_of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let month_from_march = (5 * day_of_year + 2) / 153;
    let day = day_of_year - (153 * month_from_march + 2) / 5 + 1;
    let month = if month_from_march < 10 { month_from_march + 3 } else { month_from_march - 9 };
    let year = year_of_era + era * 400 + u64::from(month <= 2);
    format!("{year:04}-{month:02}-{day:02} {:02}:{:02}:{:02} UTC", rest / 3600, rest / 60 % 60, rest % 60)
}

/// Parses a UTC time such as `2026-03-01 14:05:09.25 UTC` to UNIX time, ns; `T` and `Z` of ISO 8601 are accepted too.
/// `None` for other texts and for times before 1970.
#[must_use]
pub fn unix_ns(utc: &str) -> Option<u64> {
    let text = utc.trim();
    let text = text.strip_suffix("UTC").or(text.strip_suffix('Z')).unwrap_or(text).trim();
    let (date, time) = text.split_once([' ', 'T'])?;
    let numbers = |text: &str, mark: char| text.split(mark).map(|part| part.parse().ok()).collect::<Option<Vec<u64>>>();
    let (time, fraction) = time.split_once('.').unwrap_or((time, "0"));
    let ([year, month, day], [hour, minute, second]) = (&numbers(date, '-')?[..], &numbers(time, ':')?[..]) else {
        return None;
    };
    let within = (1970..=2500).contains(year) && (1..=12).contains(month) && (1..=31).contains(day);
    if !within || *hour > 23 || *minute > 59 || *second > 59 || !fraction.bytes().all(|digit| digit.is_ascii_digit()) {
        return None;
    }
    // years are counted from March, as in `utc`
    let (year, month) = if *month > 2 { (*year, month - 3) } else { (year - 1, month + 9) };
    let day_of_year = (153 * month + 2) / 5 + day - 1;
    let day_of_era = (year % 400) * 365 + (year % 400) / 4 - (year % 400) / 100 + day_of_year;
    let days = (year / 400 * 146_097 + day_of_era).checked_sub(719_468)?;
    let nanoseconds: u64 = format!("{fraction:0<9}").get(..9)?.parse().ok()?;
    Some((days * 86_400 + hour * 3600 + minute * 60 + second) * 1_000_000_000 + nanoseconds)
}

/// Seconds from one UNIX time in ns to another; negative if it is earlier.
#[must_use]
pub fn seconds_since(unix_ns: u64, begin_ns: u64) -> f64 {
    // divided, not multiplied by 1e-9, so that whole milliseconds are the nearest floating-point numbers to their
    // decimals
    let span = |from: u64, to: u64| (to - from) as f64 / 1e9;
    if unix_ns >= begin_ns { span(begin_ns, unix_ns) } else { -span(unix_ns, begin_ns) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stamps_go_to_the_wall_clock_and_back() {
        let clock = RunClock { t0_unix_ns: 1_700_000_000_000_000_000, t0_mono_ns: 5_000_000_000 };
        assert_eq!(clock.unix_of(5_000_000_001), 1_700_000_000_000_000_001);
        assert_eq!(clock.unix_of(4_000_000_000), 1_699_999_999_000_000_000);
        assert_eq!(clock.mono_of(clock.unix_of(123)), 123);
        assert_eq!(clock.mono_of(0), 0, "a time before boot saturates at 0");
    }

    #[test]
    fn a_sample_was_published_when_it_was_true_if_that_can_be() {
        let now_ns = 100_000_000_000;
        assert_eq!(published_ns(now_ns - 5, now_ns), now_ns - 5);
        for stamp_ns in [0, 1, now_ns + 5, u64::MAX] {
            assert_eq!(published_ns(stamp_ns, now_ns), now_ns);
        }
    }

    #[test]
    fn the_calendar_agrees_with_known_dates() {
        assert_eq!(utc(0), "1970-01-01 00:00:00 UTC");
        assert_eq!(utc(951_782_400_000_000_000), "2000-02-29 00:00:00 UTC");
        assert_eq!(utc(1_700_000_000_123_456_789), "2023-11-14 22:13:20 UTC");
        assert_eq!(utc(4_107_542_399_000_000_000), "2100-02-28 23:59:59 UTC");
    }

    #[test]
    fn a_time_as_text_is_read_back() {
        for seconds in [0, 951_782_400, 1_700_000_000, 4_107_542_399, 1_772_373_909] {
            assert_eq!(unix_ns(&utc(seconds * 1_000_000_000)), Some(seconds * 1_000_000_000));
        }
        assert_eq!(unix_ns("2023-11-14T22:13:20.5Z"), Some(1_700_000_000_500_000_000));
        for wrong in ["", "12.5", "2023-11-14", "2023-13-14 22:13:20", "2023-11-14 25:13:20", "2023-11-14 22:13:x"] {
            assert_eq!(unix_ns(wrong), None, "{wrong}");
        }
    }

    #[test]
    fn both_clocks_are_read_at_one_instant() {
        let clock = RunClock::now();
        let later = RunClock::now();
        assert!(later.unix_of(later.t0_mono_ns).abs_diff(clock.unix_of(later.t0_mono_ns)) < 100_000_000);
    }
}
