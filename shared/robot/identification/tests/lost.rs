//! Lost answers of drives: the record of a cable stays usable, and says the same.

#![allow(clippy::unwrap_used)]

use identification::{Record, identify};

const PERIOD_S: f64 = 0.01;
const DELAY_S: f64 = 0.03;
const LAG_S: f64 = 0.04;
const CYCLES: usize = 6000;

/// A minute of starts and stops behind a delay and a lag, computed in steps of a tenth of a millisecond.
fn record() -> Record {
    let mut record = Record { period_s: PERIOD_S, ..Record::default() };
    let command = |time_s: f64| {
        let time_s = (time_s / PERIOD_S).floor() * PERIOD_S;
        0.2 * (0.9 * time_s).sin() + 0.1 * (2.3 * time_s).sin()
    };
    let (mut time_s, mut velocity_m_s, mut length_m) = (0.0, 0.0, 3.0);
    let step_s = 1e-4;
    for k in 0..CYCLES {
        let sent_s = k as f64 * PERIOD_S;
        let read_s = sent_s + 0.004;
        while time_s < read_s {
            let input = if time_s < DELAY_S { 0.0 } else { command(time_s - DELAY_S + 1e-9) };
            velocity_m_s += step_s / LAG_S * (input - velocity_m_s);
            length_m += step_s * velocity_m_s;
            time_s += step_s;
        }
        record.sent_s.push(sent_s);
        record.read_s.push(read_s);
        record.command_m_s.push(command(sent_s + 1e-9));
        // Steps of an encoder.
        record.length_m.push((length_m * 1e4).round() * 1e-4);
        record.is_flown.push(true);
    }
    for list in [&mut record.duty, &mut record.current_a, &mut record.supply_v, &mut record.tension_n] {
        list.resize(CYCLES, f64::NAN);
    }
    record
}

/// The record if the answers of these cycles are lost.
fn without(mut record: Record, lost: impl Iterator<Item = usize>) -> Record {
    for k in lost {
        record.read_s[k] = record.read_s[k - 1];
        record.length_m[k] = record.length_m[k - 1];
    }
    record
}

#[test]
fn lost_answers_do_not_change_what_is_identified() {
    let whole = record();
    let expected = identify(&whole).unwrap().drive;
    assert!((expected.total_s.value - DELAY_S - LAG_S).abs() < 0.001, "{expected:?}");
    // One in fifty and, every ten seconds, three in a row.
    let lost = (1..CYCLES).filter(|k| k % 50 == 17 || (k % 1000 > 500 && k % 1000 < 504));
    let mut record = without(whole.clone(), lost);
    assert!(identify(&record).is_err(), "a repeated reading is none");
    record.interpolate_lost();
    assert!(record.is_flown.iter().all(|flown| *flown));
    let found = identify(&record).unwrap().drive;
    assert!((found.total_s.value - expected.total_s.value).abs() < 0.0002, "{found:?}, {expected:?}");
    assert!((found.delay_s.value - expected.delay_s.value).abs() < 0.002, "{found:?}, {expected:?}");
    let mut again = whole.clone();
    again.interpolate_lost();
    let same = |of: fn(&Record) -> &[f64]| of(&again) == of(&whole);
    assert!(same(|record| &record.read_s) && same(|record| &record.length_m), "nothing was lost");
}

#[test]
fn a_long_loss_and_one_at_the_end_are_left_out() {
    let mut record = without(record(), (1000..1080).chain(CYCLES - 3..CYCLES));
    record.interpolate_lost();
    assert!(record.read_s.is_sorted_by(|before, after| before < after));
    for (k, flown) in record.is_flown.iter().enumerate() {
        assert_eq!(*flown, !(1000..1080).contains(&k) && k < CYCLES - 3, "cycle {k}");
    }
    let found = identify(&record).unwrap().drive;
    assert!((found.total_s.value - DELAY_S - LAG_S).abs() < 0.001, "{found:?}");
}
