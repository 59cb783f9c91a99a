//! Warnings about readings that did not become samples.

use crate::Counts;

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
