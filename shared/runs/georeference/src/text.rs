//! Warnings about readings that did not become samples.

use crate::Counts;

/// Returns one sentence about readings since `before` that got no position or were malformed; `None` if all others were
/// only stale.
#[must_use]
pub fn complaint(name: &str, now: &Counts, before: &Counts) -> Option<String> {
    let kinds = [
        (now.unplaced - before.unplaced, "without a newer estimate"),
        (now.old - before.old, "older than any estimate"),
        (now.gaps - before.gaps, "in gaps of the estimates"),
        (now.malformed - before.malformed, "not of the type of the channel"),
    ];
    let lost: u64 = kinds.iter().map(|(count, _)| count).sum();
    let said = kinds.iter().filter(|(count, _)| *count > 0).map(|(count, kind)| format!("{count} {kind}"));
    (lost > 0).then(|| {
        let all = now.readings - before.readings;
        format!(
            "sensor/{name}: {lost} of {all} readings did not become samples: {}",
            said.collect::<Vec<_>>().join(", ")
        )
    })
}
