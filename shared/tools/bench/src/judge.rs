//! Evaluates the figures for a control rate: one finding with a remedy for each part. Pure.

use super::words::{duration, percent};
use super::{chain, disk, round_trip, tick};
use commissioning::finding::{Finding, error, note, warning};

/// Share of late or skipped periods beyond which the robot stops too often. A virtual machine with two shared cores,
/// which sometimes stalls as a whole, stays at a third of it and can fly.
const MAX_BAD_SHARE: f64 = 0.05;
/// Share of the period by which a wake-up may be late without any effect.
const HARMLESS_SHARE: f64 = 0.1;
/// motor-io waits half a period for the chain's answer, however late the cycle started; a longer tail means periods
/// without an answer.
const MOST_SHARE: f64 = 0.5;
/// A tenth of that leaves time for the drives and for other programs.
const GOOD_SHARE: f64 = 0.05;
/// The path from motor-io through estimator and controller back to motor-io has three hops, one and a half round trips.
const ROUND_TRIPS: f64 = 1.5;
/// Ratio of disk speed to data rate that leaves room for sensors, maps and pictures.
const GOOD_DISK: f64 = 10.0;
/// Ratio below which the disk falls behind as soon as another program writes.
const LEAST_DISK: f64 = 2.0;
/// Good time of a sync, s. A power cut loses the data since the last flush and the last sync.
const GOOD_SYNC_S: f64 = 1.0;
/// Maximum time of a sync, s: channels buffer samples for a recorder for 2.5 s.
const MOST_SYNC_S: f64 = 2.5;

enum Grade {
    Good,
    Fair,
    Bad,
}

/// Grades a value by two limits: up to the first it is good, up to the second fair.
fn grade(value: f64, good: f64, fair: f64) -> Grade {
    if value <= good {
        Grade::Good
    } else if value <= fair {
        Grade::Fair
    } else {
        Grade::Bad
    }
}

fn finding(part: &str, level: &Grade, rate_hz: f64, why: &str, cure: &str) -> Finding {
    match level {
        Grade::Good => note(format!("{part}: good for {rate_hz} Hz: {why}")),
        Grade::Fair => warning(format!("{part}: sufficient for {rate_hz} Hz with little margin: {why}"), cure),
        Grade::Bad => error(format!("{part}: insufficient for {rate_hz} Hz: {why}"), cure),
    }
}

/// Evaluates the wake-ups.
pub fn tick_finding(found: &tick::TickResult, rate_hz: f64) -> Finding {
    let ticks = &found.ours;
    let (worst_s, period_s) = (ticks.lateness.worst_s, 1.0 / rate_hz);
    let bad = ticks.late + ticks.skipped;
    let level = match (ticks.bad_share(), bad) {
        (share, _) if share > MAX_BAD_SHARE => Grade::Bad,
        (_, 0) if ticks.lateness.p999_s <= HARMLESS_SHARE * period_s => Grade::Good,
        _ => Grade::Fair,
    };
    let why = if bad == 0 {
        format!(
            "none of {} wake-ups was late by more than half a period; the worst was {} late in a period of {}",
            ticks.lateness.count,
            duration(worst_s),
            duration(period_s)
        )
    } else {
        format!(
            "of {} periods, {} began late by more than half a period and {} were skipped; the worst was {} late",
            ticks.periods,
            ticks.late,
            ticks.skipped,
            duration(worst_s)
        )
    };
    let cure = match (found.scheduling.fifo_priority, found.scheduling.refused.is_empty()) {
        (None, false) => "permit the settings listed above, so that the control chain has priority".to_owned(),
        (None, true) => "give the control chain priority: `priority = 50` in [realtime] of the system file".to_owned(),
        (Some(_), _) => format!(
            "end other programs, see `nims doctor` about power saving, or use a machine that is not shared{}",
            match sufficient_rate(worst_s).filter(|slower| f64::from(*slower) < rate_hz) {
                Some(slower) => format!(", or set the rate to {slower} Hz, at which nothing would have been late"),
                None => String::new(),
            }
        ),
    };
    finding("tick", &level, rate_hz, &why, &cure)
}

/// Returns the highest permitted rate in tens of hertz at which this delay would not have been late.
fn sufficient_rate(worst_s: f64) -> Option<u32> {
    let rate_hz = (0.5 / worst_s / 10.0).floor() * 10.0;
    (10.0..=500.0).contains(&rate_hz).then_some(rate_hz as u32)
}

/// Evaluates the round trips.
pub fn bus_finding(found: &round_trip::BusResult, rate_hz: f64) -> Finding {
    let share = ROUND_TRIPS * found.ours.p999_s * rate_hz;
    let level = grade(share, GOOD_SHARE, MOST_SHARE);
    let why = format!(
        "the three hops from motor-io through the control chain take {} of the period, {} in the worst thousandth",
        percent(ROUND_TRIPS * found.ours.median_s * rate_hz),
        percent(share)
    );
    let cure = match found.scheduling.refused.first() {
        Some(_) => "permit the scheduling settings listed above, or set a lower rate",
        None => "end other programs, see `nims doctor` about power saving, or set a lower rate",
    };
    finding("bus", &level, rate_hz, &why, cure)
}

/// Evaluates the computing time.
pub fn chain_finding(found: &chain::ChainResult, rate_hz: f64) -> Finding {
    let level = grade(found.p999_share, GOOD_SHARE, MOST_SHARE);
    let why = format!(
        "a cycle of the control chain takes {} of the period to compute, {} in the worst thousandth",
        percent(found.median_share),
        percent(found.p999_share)
    );
    finding("chain", &level, rate_hz, &why, "end other programs, use a faster machine, or set a lower rate")
}

/// Evaluates the disk.
pub fn disk_finding(found: &disk::DiskResult, rate_hz: f64) -> Finding {
    let (times, sync_s) = (found.ours.mb_s / found.needed_mb_s, found.ours.sync.worst_s.max(found.plain.sync.worst_s));
    let level = match (grade(-times, -GOOD_DISK, -LEAST_DISK), grade(sync_s, GOOD_SYNC_S, MOST_SYNC_S)) {
        (Grade::Bad, _) | (_, Grade::Bad) => Grade::Bad,
        (Grade::Good, Grade::Good) if !found.in_memory => Grade::Good,
        _ => Grade::Fair,
    };
    if found.in_memory {
        return finding(
            "disk",
            &level,
            rate_hz,
            "this folder is in memory, and a power cut erases it",
            "give a folder on a disk with --runs DIR",
        );
    }
    let why = format!(
        "it writes {times:.0} times the data rate of the control chain, and confirmed all writes within {}",
        duration(sync_s)
    );
    finding(
        "disk",
        &level,
        rate_hz,
        &why,
        "set `runs` in the system file to a faster disk to which no other program writes",
    )
}

#[cfg(test)]
mod tests {
    use super::super::figures::{Ratio, Spread};
    use super::super::scheduling::AchievedScheduling;
    use super::*;
    use commissioning::finding;

    fn spread(median_s: f64, p999_s: f64, worst_s: f64) -> Spread {
        Spread { count: 1000, median_s, p999_s, worst_s }
    }

    const RATIO: Ratio = Ratio { median: 2.0, p999: 3.0 };

    fn tick_result(p999_s: f64, late: u64, skipped: u64, scheduling: AchievedScheduling) -> tick::TickResult {
        let lateness = spread(1e-5, p999_s, 0.008);
        let ours = tick::Ticks { lateness, p9999_s: p999_s, classes: Vec::new(), late, skipped, periods: 1000 };
        tick::TickResult { plain: ours.clone(), ours, ratio: RATIO, scheduling }
    }

    fn fifo() -> AchievedScheduling {
        AchievedScheduling { fifo_priority: Some(50), ..AchievedScheduling::default() }
    }

    /// The findings of these tests, which one test compares with the file of sentences.
    #[derive(Default)]
    struct Findings(Vec<(String, String)>);

    impl Findings {
        fn assert_is(&mut self, found: &Finding, level: finding::Level, words: &[&str]) {
            self.0.push((format!("{level:?}"), format!("{} | {}", found.finding, found.cure)));
            assert_is(found, level, words);
        }
    }

    #[test]
    fn the_sentences_are_those_of_the_file() {
        let mut given = Findings::default();
        ticks_are_graded_by_share_and_tail(&mut given);
        bus_and_chain_leave_time_for_the_drives(&mut given);
        a_disk_is_graded_by_speed_and_longest_sync(&mut given);
        sentences::compare(env!("CARGO_MANIFEST_DIR"), given.0);
    }

    fn assert_is(found: &Finding, level: finding::Level, words: &[&str]) {
        assert_eq!(found.level, level, "{found:?}");
        assert_eq!(found.cure.is_empty(), level == finding::Level::Note, "{found:?}");
        for word in words {
            assert!(format!("{} {}", found.finding, found.cure).contains(word), "no {word:?} in {found:?}");
        }
    }

    fn ticks_are_graded_by_share_and_tail(given: &mut Findings) {
        use finding::Level::{Error, Note, Warning};
        // A tenth of a period of 10 ms.
        given.assert_is(&tick_finding(&tick_result(0.001, 0, 0, fifo()), 100.0), Note, &["100 Hz", "1000"]);
        given.assert_is(&tick_finding(&tick_result(0.001_01, 0, 0, fifo()), 100.0), Warning, &["100 Hz"]);
        given.assert_is(&tick_finding(&tick_result(0.000_1, 1, 0, fifo()), 100.0), Warning, &["1 ", "0 "]);
        given.assert_is(&tick_finding(&tick_result(0.000_1, 20, 30, fifo()), 100.0), Warning, &["20 ", "30 "]);
        given.assert_is(&tick_finding(&tick_result(0.000_1, 20, 31, fifo()), 100.0), Error, &["100 Hz", "60 Hz"]);
        // No remedy by a rate that is not lower.
        let cure = tick_finding(&tick_result(0.04, 0, 0, fifo()), 50.0).cure;
        assert!(!cure.contains(" Hz"), "{cure}");
    }

    #[test]
    fn the_remedy_for_late_ticks_is_the_next_untried_step() {
        let refused = AchievedScheduling { refused: vec!["no".to_owned()], ..AchievedScheduling::default() };
        let cure = |scheduling| tick_finding(&tick_result(0.1, 100, 0, scheduling), 100.0).cure;
        assert!(cure(refused).contains("permit"));
        assert!(cure(AchievedScheduling::default()).contains("[realtime]"));
        assert!(cure(fifo()).contains("nims doctor"));
    }

    #[test]
    fn a_sufficient_rate_is_a_permitted_one() {
        assert_eq!(sufficient_rate(0.002), Some(250));
        assert_eq!(sufficient_rate(0.001), Some(500));
        assert_eq!(sufficient_rate(0.0009), None);
        assert_eq!(sufficient_rate(0.0049), Some(100));
        assert_eq!(sufficient_rate(0.0051), Some(90));
        assert_eq!(sufficient_rate(0.05), Some(10));
        assert_eq!(sufficient_rate(0.051), None);
    }

    fn bus_and_chain_leave_time_for_the_drives(given: &mut Findings) {
        use finding::Level::{Error, Note, Warning};
        let bus = |p999_s| round_trip::BusResult {
            sample_bytes: 700,
            ours: spread(1e-5, p999_s, 0.5),
            plain: spread(1e-5, 1e-5, 1e-5),
            ratio: RATIO,
            scheduling: fifo(),
        };
        for (p999_s, level, words) in [(0.000_333, Note, "bus"), (0.000_334, Warning, "bus"), (0.003_34, Error, "bus")]
        {
            given.assert_is(&bus_finding(&bus(p999_s), 100.0), level, &[words, "100 Hz"]);
        }
        // The same times are worse at a higher rate.
        given.assert_is(&bus_finding(&bus(0.000_333), 200.0), Warning, &["200 Hz"]);
        let chain = |p999_share| chain::ChainResult {
            cables: 4,
            ours: spread(1e-5, p999_share / 100.0, 0.5),
            median_share: 0.001,
            p999_share,
            tensions: chain::Tensions { ours: spread(1.0, 1.0, 1.0), plain: spread(1.0, 1.0, 1.0), ratio: RATIO },
        };
        for (share, level) in [(0.05, Note), (0.0501, Warning), (0.5, Warning), (0.5001, Error)] {
            given.assert_is(&chain_finding(&chain(share), 100.0), level, &["chain", "0.1 %"]);
        }
    }

    fn a_disk_is_graded_by_speed_and_longest_sync(given: &mut Findings) {
        use finding::Level::{Error, Note, Warning};
        let disk = |mb_s, sync_s, in_memory| {
            let way = disk::WriteStats { mb_s, batch: spread(0.01, 0.1, 1.0), sync: spread(0.01, 0.1, sync_s) };
            disk::DiskResult {
                plain: way.clone(),
                ours: way,
                ratio: RATIO,
                needed_mb_s: 0.5,
                compressed_to: 0.4,
                in_memory,
            }
        };
        for (mb_s, sync_s, level) in [
            (5.0, 1.0, Note),
            (4.9, 1.0, Warning),
            (5.0, 1.01, Warning),
            (1.0, 2.5, Warning),
            (0.99, 0.1, Error),
            (50.0, 2.51, Error),
        ] {
            given.assert_is(&disk_finding(&disk(mb_s, sync_s, false), 100.0), level, &["disk"]);
        }
        given.assert_is(&disk_finding(&disk(500.0, 0.001, true), 100.0), Warning, &["disk", "--runs"]);
    }
}
