//! Formats the figures as a table. Pure.

use super::figures::{Ratio, Spread};
use super::report::BenchReport;
use super::words::{digits, duration, percent};
use super::{chain, disk, round_trip, tick};
use commissioning::finding;

/// Width of the first column.
const LABEL: usize = 44;
/// Width of the other columns.
const CELL: usize = 13;

fn row(label: &str, cells: &[String]) -> String {
    let mut line = format!("{label:<LABEL$}");
    for cell in cells {
        line.push_str(&format!("{cell:>CELL$}"));
    }
    line.trim_end().to_owned()
}

fn heading(label: &str, cells: &[&str]) -> String {
    row(label, &cells.iter().map(|cell| (*cell).to_owned()).collect::<Vec<_>>())
}

const SPREAD: [&str; 3] = ["median", "99.9 %", "worst"];

fn spread_cells(spread: &Spread) -> Vec<String> {
    [spread.median_s, spread.p999_s, spread.worst_s].map(duration).to_vec()
}

fn ratio_cells(ratio: &Ratio) -> Vec<String> {
    [ratio.median, ratio.p999].map(|ratio| format!("{} : 1", digits(ratio))).to_vec()
}

/// Formats all measured parts, each with its verdict.
#[must_use]
pub fn report(report: &BenchReport) -> String {
    let mut lines = Vec::new();
    let (rate_hz, verdicts) = (report.rate_hz, report.verdicts());
    let mut part = |mut table: Vec<String>, name: &str| {
        let verdict = verdicts.iter().find(|(part, _)| part.name() == name);
        table.extend(verdict.map(|(_, finding)| finding::to_text(std::slice::from_ref(finding))));
        table.push(String::new());
        lines.extend(table);
    };
    if let Some(found) = &report.tick {
        part(tick_table(found, rate_hz), "tick");
    }
    if let Some(found) = &report.bus {
        let mut table = bus_table(found);
        // Omitted if it has already been printed for the wake-ups.
        if report.tick.is_none() {
            table.extend(found.scheduling.lines());
        }
        part(table, "bus");
    }
    if let Some(found) = &report.chain {
        part(chain_table(found, rate_hz), "chain");
    }
    if let Some(found) = &report.disk {
        part(disk_table(found, report), "disk");
    }
    if report.beside {
        lines.push("measured while a robot was running, so the figures include its load".to_owned());
    } else {
        lines.pop();
    }
    lines.join("\n")
}

fn tick_table(found: &tick::TickResult, rate_hz: f64) -> Vec<String> {
    let mut lines =
        vec![heading(&format!("delay of a wake-up at {rate_hz} Hz"), &[&SPREAD[..], &["late", "skipped"]].concat())];
    for (label, ticks) in [("  as motor-io waits", &found.ours), ("  ordinary sleeping thread", &found.plain)] {
        let counts = [format!("{}/{}", ticks.late, ticks.lateness.count), ticks.skipped.to_string()];
        lines.push(row(label, &[spread_cells(&ticks.lateness), counts.to_vec()].concat()));
    }
    lines.push(row("  ordinary to motor-io", &ratio_cells(&found.ratio)));
    lines.extend(found.scheduling.lines());
    lines
}

fn bus_table(found: &round_trip::BusResult) -> Vec<String> {
    vec![
        heading(&format!("round trip of {} bytes", found.sample_bytes), &[&SPREAD[..], &["times"]].concat()),
        row("  over the bus", &[spread_cells(&found.ours), vec![found.ours.count.to_string()]].concat()),
        row("  over datagram sockets", &[spread_cells(&found.plain), vec![found.plain.count.to_string()]].concat()),
        row("  sockets to bus", &ratio_cells(&found.ratio)),
    ]
}

fn chain_table(found: &chain::ChainResult, rate_hz: f64) -> Vec<String> {
    let tensions = &found.tensions;
    vec![
        heading(&format!("computing, {} cables", found.cables), &[&SPREAD[..], &["times"]].concat()),
        row(
            "  a cycle of the control chain",
            &[spread_cells(&found.ours), vec![found.ours.count.to_string()]].concat(),
        ),
        row(
            &format!("  as a share of the period at {rate_hz} Hz"),
            &[found.median_share, found.p999_share, found.ours.worst_s * rate_hz].map(percent),
        ),
        row("  tensions within limits", &spread_cells(&tensions.ours)),
        row("  by pseudo-inverse, without limits", &spread_cells(&tensions.plain)),
        row("  pseudo-inverse to within limits", &ratio_cells(&tensions.ratio)),
    ]
}

fn disk_table(found: &disk::DiskResult, report: &BenchReport) -> Vec<String> {
    let mut lines = vec![heading(
        &format!("half a second of data to {}", report.runs.display()),
        &["MB/s", "median", "99.9 %", "longest sync"],
    )];
    for (label, way) in [("  as a run file", &found.ours), ("  as a plain file", &found.plain)] {
        let [median, p999] = [way.batch.median_s, way.batch.p999_s].map(duration);
        lines.push(row(label, &[digits(way.mb_s), median, p999, duration(way.sync.worst_s)]));
    }
    let mut ratio = vec![String::new()];
    ratio.extend(ratio_cells(&found.ratio));
    lines.push(row("  plain file to run file", &ratio));
    lines.push(format!(
        "the control chain publishes {} MB/s, which the run file compresses to {}",
        digits(found.needed_mb_s),
        percent(found.compressed_to)
    ));
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn durations_have_three_digits_and_a_suitable_unit() {
        for (seconds, said) in [
            (1e-9, "1 ns"),
            (0.25e-6, "250 ns"),
            (0.999_9e-6, "1 µs"),
            (1.234e-6, "1.23 µs"),
            (12.34e-6, "12.3 µs"),
            (123.4e-6, "123 µs"),
            (0.999_6e-3, "1 ms"),
            (0.01, "10 ms"),
            (0.1234, "123 ms"),
            (0.9996, "1 s"),
            (12.0, "12 s"),
            (600.0, "600 s"),
        ] {
            assert_eq!(duration(seconds), said, "{seconds}");
        }
        assert_eq!(percent(0.001), "0.1 %");
        assert_eq!(percent(0.123_4), "12.3 %");
        assert_eq!(percent(1.0), "100 %");
    }
}
