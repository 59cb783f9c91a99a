//! What the flight says of the stiffness of the cables.

use cable_robot::{CableVec, RobotParts};
use calibration::flight::{Flight, FlightPart, FlightStiffness, WIDE, flight_stiffness};
use calibration::{FORCE_CONSTANT, Found};
use identification::{Identified, Record};

use super::rows::Recorded;

/// Duration of a part, s: short compared with a change of speed, long compared with the ripple of the currents.
const PART_S: f64 = 0.2;

/// Estimates the stiffness with the force constants that were identified.
pub(super) fn of(recorded: &Recorded, cables: &[Result<Identified, String>]) -> FlightStiffness {
    let unknown =
        |why: String| FlightStiffness { stiffness_n: Found::Undetermined(why), left: WIDE, estimate_n: f64::NAN };
    let Some(parts) = &recorded.robot else {
        return unknown("this run has no robot file that this version accepts, so it tells nothing".to_owned());
    };
    flight_stiffness(parts, &flight(parts, &recorded.cables, cables)).unwrap_or_else(|error| unknown(error.to_string()))
}

fn flight(parts: &RobotParts, records: &[Record], cables: &[Result<Identified, String>]) -> Flight {
    let constant = |found: &Result<Identified, String>| {
        let stated_n_a = parts.motor.force_constant_n_a;
        match found.as_ref().ok().and_then(|found| found.motor) {
            Some(motor) if motor.force_constant_n_a.value > 0.0 => {
                [motor.force_constant_n_a.value, motor.force_constant_n_a.sigma]
            }
            _ => [stated_n_a, FORCE_CONSTANT * stated_n_a],
        }
    };
    let period_s = records.first().map_or(PART_S, |record| record.period_s);
    let long = ((PART_S / period_s).round() as usize).max(2);
    Flight {
        parts: parts_of(records, long),
        part_s: long as f64 * period_s,
        force_constants_n_a: cables.iter().map(constant).collect(),
    }
}

/// Means over the parts that were flown whole.
fn parts_of(records: &[Record], long: usize) -> Vec<FlightPart> {
    let cycles = records.iter().map(Record::len).min().unwrap_or(0);
    let passed: Vec<Vec<f64>> = records.iter().map(passed_n_m).collect();
    let each = |of: &dyn Fn(usize, &Record) -> f64| CableVec::from_fn(records.len(), |i| of(i, &records[i]));
    let mut parts: Vec<FlightPart> = Vec::new();
    for begin in (0..cycles.saturating_sub(long)).step_by(long) {
        let all = begin..begin + long;
        let end = begin + long;
        if !records.iter().all(|record| record.is_flown[all.clone()].iter().all(|flown| *flown)) {
            continue;
        }
        let mean = |values: &[f64]| values[all.clone()].iter().sum::<f64>() / long as f64;
        parts.push(FlightPart {
            time_s: records.first().map_or(0.0, |record| mean(&record.read_s)),
            lengths_m: each(&|_, record| mean(&record.length_m)),
            passed_n_m: each(&|i, _| mean(&passed[i])),
            reel_in_m_s: each(&|_, record| {
                (record.length_m[begin] - record.length_m[end]) / (record.read_s[end] - record.read_s[begin])
            }),
            reel_in_m_s2: CableVec::zeros(records.len()),
            current_a: each(&|_, record| mean(&record.current_a)),
        });
    }
    let speeds: Vec<CableVec> = parts.iter().map(|part| part.reel_in_m_s).collect();
    let times_s: Vec<f64> = parts.iter().map(|part| part.time_s).collect();
    for k in 1..parts.len().saturating_sub(1) {
        let between_s = times_s[k + 1] - times_s[k - 1];
        parts[k].reel_in_m_s2 = speeds[k + 1].zip_map(&speeds[k - 1], |after, before| (after - before) / between_s);
    }
    parts
}

/// Integral of the modelled tension over the cable that was paid out, N m.
fn passed_n_m(record: &Record) -> Vec<f64> {
    let (mut sum_n_m, mut tension_n) = (0.0, 0.0);
    let mut out = Vec::with_capacity(record.len());
    for k in 0..record.len() {
        if record.tension_n[k].is_finite() {
            tension_n = record.tension_n[k];
        }
        if k > 0 {
            sum_n_m += tension_n * (record.length_m[k] - record.length_m[k - 1]);
        }
        out.push(sum_n_m);
    }
    out
}
