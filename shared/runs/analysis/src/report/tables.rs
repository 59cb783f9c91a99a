//! The tables of sentences of the page: deviations with their causes, what was in charge, the drive units.

use super::explain::{Between, Explanation};
use super::gather::RunData;
use super::legs::LegReport;
use super::samples::Flag;
use plot::escape;
use plot::page::{Table, html_table};

pub(super) fn scroll(table: &str) -> String {
    format!("<div class=\"scroll\">{table}</div>\n")
}

/// Renders a table of sentences.
pub(super) fn words_table(table: &Table) -> String {
    scroll(&html_table(table).replacen("<table>", "<table class=\"words\">", 1))
}

/// Renders the largest deviations of the run and of each leg, with what the record shows while they rose.
pub fn deviations(run: &[Explanation], between: Option<&Between>, legs: &[LegReport]) -> String {
    if run.is_empty() {
        return String::new();
    }
    let mut table =
        Table::new("Largest deviations", &["s", "of", "mm", "rose for, s", "what the record shows in the rise"]);
    let legs = legs.iter().map(|leg| (format!("leg {} {}", leg.number, leg.kind), &leg.deviations[..]));
    let between = between.map(|between| (format!("{} to {} s", between.from_s, between.to_s), &between.deviations[..]));
    for (name, explanations) in std::iter::once(("the run".to_owned(), run)).chain(between).chain(legs) {
        for explanation in explanations {
            let causes: Vec<&str> = explanation.causes.iter().map(|cause| cause.text.as_str()).collect();
            table.row([
                format!("{:.2}", explanation.at_s),
                format!("{name}, {}", explanation.of),
                format!("{:.2}", 1e3 * explanation.max_m),
                format!("{:.2}", explanation.at_s - explanation.rises_from_s),
                if causes.is_empty() { "no recorded cause".to_owned() } else { causes.join("; ") },
            ]);
        }
    }
    words_table(&table)
}

/// Renders what happened at each fault.
pub fn incidents(run: &RunData) -> String {
    let (incidents, left_out) = run.incidents.all();
    if incidents.is_empty() {
        return String::new();
    }
    let mut table = Table::new("What happened at each fault", &["s", "UTC", "cycle", "what happened"]);
    for incident in incidents {
        let cycle = if incident.cycle == 0 { "-".to_owned() } else { incident.cycle.to_string() };
        let utc = run.utc(incident.time_s).unwrap_or_default();
        table.row([format!("{:.2}", incident.time_s), utc, cycle, incident.sentence]);
    }
    let more = match left_out {
        0 => String::new(),
        more => format!("<p class=\"soft\">{more} further faults are not listed.</p>\n"),
    };
    words_table(&table) + &more
}

/// Renders which controller and estimator were in charge, with their parameters.
pub fn in_charge(run: &RunData) -> String {
    let spans = run.in_charge.spans();
    if spans.is_empty() {
        return String::new();
    }
    let head = ["s", "to, s", "in charge", "law or method", "program", "parameters; later: those that changed"];
    let mut table = Table::new("Controllers and estimators in charge", &head);
    for span in spans {
        let or_unknown = |text: &Option<String>| text.clone().unwrap_or_else(|| "-".to_owned());
        let name = span.name.clone().unwrap_or_else(|| format!("{} in slot {}", span.role, span.slot));
        let program = match (&span.program, &span.version) {
            (Some(program), Some(version)) => format!("{program} ({version})"),
            (program, _) => or_unknown(program),
        };
        table.row([
            format!("{:.2}", span.from_s),
            format!("{:.2}", span.to_s),
            name,
            or_unknown(&span.law),
            program,
            span.parameters_text(),
        ]);
    }
    let more = match run.in_charge.left_out {
        0 => String::new(),
        more => format!("<p class=\"soft\">{more} further changes are not listed.</p>\n"),
    };
    words_table(&table) + &more
}

/// Renders when periods were not steered, and why.
pub fn losses(run: &RunData) -> String {
    if run.lost.stretches().is_empty() {
        return String::new();
    }
    let mut table = Table::new("Periods that were not steered", &["s", "to, s", "UTC", "periods", "cause", "cycles"]);
    for one in run.lost.stretches() {
        let [first, last] = one.cycles;
        table.row([
            format!("{:.2}", one.from_s),
            format!("{:.2}", one.to_s),
            run.utc(one.from_s).unwrap_or_default(),
            one.periods.to_string(),
            one.cause.to_owned(),
            if first == last { first.to_string() } else { format!("{first} to {last}") },
        ]);
    }
    let more = match run.lost.left_out {
        0 => String::new(),
        more => format!("<p class=\"soft\">{more} further stretches are not listed.</p>\n"),
    };
    words_table(&table) + &more
}

/// Renders the drive units as they answered at the start.
pub fn units(run: &RunData) -> String {
    if run.units.is_empty() {
        return String::new();
    }
    let mut table = Table::new("Drive units", &["port", "unit", "firmware", "watchdog, ms"]);
    for unit in &run.units {
        table.row([unit.port.clone(), unit.name.clone(), unit.firmware.clone(), unit.watchdog_ms.to_string()]);
    }
    words_table(&table)
}

/// Renders range and flags of each sensor value.
pub fn sensors(run: &RunData) -> String {
    let head = [
        "channel",
        "value",
        "least",
        "greatest",
        "gaps",
        "flat lines",
        "spikes",
        "outside its range",
        "marked by the device",
    ];
    let mut table = Table::new("Values of the sensors", &head);
    for (name, sensor) in run.sensors.channels() {
        for value in sensor.extremes() {
            let [low, high] =
                value.range.map_or(["-".to_owned(), "-".to_owned()], |range| range.map(|end| format!("{end:.4}")));
            let flag = |flag: Flag, unit: &str| match flag.first_s {
                Some(first_s) => format!("{}, from {first_s:.1} s on, at most {:.4}{unit}", flag.count, flag.largest),
                None => "none".to_owned(),
            };
            let flags = value.flags;
            table.row([
                name.clone(),
                value.name,
                low,
                high,
                flag(flags.gaps, " s"),
                flag(flags.flat_lines, " s"),
                flag(flags.spikes, ""),
                flag(flags.outside, ""),
                format!("{} of {} samples", sensor.doubtful, sensor.samples),
            ]);
        }
    }
    let channels = run.sensors.channels().iter();
    let more: String = channels
        .filter(|(_, sensor)| sensor.left_out() > 0)
        .map(|(name, sensor)| {
            let left_out = sensor.left_out();
            format!("<p class=\"soft\">{left_out} further values of {} are not shown.</p>\n", escape(name))
        })
        .collect();
    words_table(&table) + &more
}
