//! Warnings about readings that did not become samples, and about doubtful values.

use messages::{SensorFlag, text_of};

use crate::Counts;

/// Returns one sentence about doubtful values on a channel of a sensor.
#[must_use]
pub fn flag_sentence(channel: &str, flag: &SensorFlag) -> String {
    let (quantity, unit, size) = (text_of(&flag.quantity), text_of(&flag.unit), flag.size);
    let quantity = if quantity.is_empty() { format!("value {}", flag.number) } else { quantity };
    let unit = if unit.is_empty() { unit } else { format!(" {unit}") };
    let what = match (flag.kind, flag.end_ns) {
        (SensorFlag::KIND_GAP, 0) => format!("silent for {size:.1} s"),
        (SensorFlag::KIND_GAP, _) => format!("speaks again after {size:.1} s"),
        (SensorFlag::KIND_FLAT, 0) => format!("the same value for {size:.0} s; look whether the sensor is stuck"),
        (SensorFlag::KIND_FLAT, _) => format!("changes again after {size:.0} s"),
        (SensorFlag::KIND_SPIKE, _) => format!("a spike of {size:.4}{unit}"),
        (_, 0) => format!("{size:.4}{unit} outside the range in the system file; not in the map"),
        (_, _) => format!("within its range again; it was up to {size:.4}{unit} outside"),
    };
    format!("{channel}: {quantity}: {what}")
}

/// Returns one sentence about readings since `before` that got no position or were malformed; `None` if all others were
/// only stale.
#[must_use]
pub fn unused_readings_sentence(name: &str, now: &Counts, before: &Counts) -> Option<String> {
    let counts = [
        (now.unplaced - before.unplaced, "without a newer estimate"),
        (now.old - before.old, "older than any estimate"),
        (now.gaps - before.gaps, "in gaps of the estimates"),
        (now.malformed - before.malformed, "not of the type of the channel"),
    ];
    let lost: u64 = counts.iter().map(|(count, _)| count).sum();
    let reasons = counts.iter().filter(|(count, _)| *count > 0).map(|(count, reason)| format!("{count} {reason}"));
    (lost > 0).then(|| {
        let all = now.readings - before.readings;
        format!(
            "sensor/{name}: {lost} of {all} readings did not become samples: {}",
            reasons.collect::<Vec<_>>().join(", ")
        )
    })
}
