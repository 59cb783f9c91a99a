//! What is said of readings that became no samples.

use crate::Counts;

/// One sentence about the readings of a sensor that got no place since `before`, or were none; nothing where all became samples or were
/// only stale.
#[must_use]
pub fn complaint(name: &str, now: &Counts, before: &Counts) -> Option<String> {
    let kinds = [
        (now.unplaced - before.unplaced, "without a newer estimate"),
        (now.old - before.old, "older than any estimate"),
        (now.gaps - before.gaps, "in gaps of the estimates"),
        (now.malformed - before.malformed, "not as the type of the channel says"),
    ];
    let lost: u64 = kinds.iter().map(|(count, _)| count).sum();
    let said = kinds.iter().filter(|(count, _)| *count > 0).map(|(count, kind)| format!("{count} {kind}"));
    (lost > 0).then(|| {
        let all = now.readings - before.readings;
        format!("sensor/{name}: {lost} of {all} readings became no samples: {}", said.collect::<Vec<_>>().join(", "))
    })
}
