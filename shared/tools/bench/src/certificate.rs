//! The certificate of a machine for a system: whether its wake-ups keep time under load, on one page. The verdict is
//! pure.

use super::load::Done;
use super::settings::CERTIFIED_WAKE_UPS;
use super::tick::{TickResult, Ticks};
use super::words::{digits, duration, percent};
use command::{Answer, Failure, Output};
use commissioning::doctor::kernel::{self, Kernel, Preemption};
use plot::page::{Table, html_table};
use plot::{Axis, Chart, Series, SeriesStyle, escape};
use serde_json::json;
use std::path::Path;

/// Largest share of a period for the delay of 99.99 % of the wake-ups.
const TAIL_SHARE: f64 = 0.1;
/// Largest share of periods whose wake-up may be later than that.
const TAIL: f64 = 1e-4;
/// Largest share of a period for the longest delay: motor-io waits half a period for an answer.
const WORST_SHARE: f64 = 0.5;
/// Names of the decades of the delay, from 1 µs on, and of the numbers of wake-ups.
const DELAYS: [&str; 8] = ["1 µs", "10 µs", "100 µs", "1 ms", "10 ms", "100 ms", "1 s", "10 s"];
const NUMBERS: [&str; 9] = ["0", "1", "10", "100", "1000", "10⁴", "10⁵", "10⁶", "10⁷"];

const STYLE: &str = "body{font:15px/1.45 sans-serif;max-width:800px;margin:1.5em auto;padding:0 1em;color:#222}\
table{border-collapse:collapse;margin:.8em 0}th,td{border:1px solid #ccc;padding:.15em .7em;text-align:left}\
th{background:#f4f4f4}svg{width:100%;height:auto;font-size:12px}svg text{fill:#444}.grid{stroke:#e8e8e8;fill:none}\
.frame{stroke:#888;fill:none}.verdict{padding:.5em .9em;color:#fff;font-weight:bold}\
.certified{background:#2c8c3c}.insufficient{background:#c03030}.not-certified{background:#777}";

/// Result of a certificate.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// Every condition holds.
    Certified,
    /// Measured as it must be, and too late.
    Insufficient,
    /// Not measured as it must be.
    NotCertified,
}

impl Verdict {
    fn words(self) -> &'static str {
        match self {
            Self::Certified => "certified",
            Self::Insufficient => "insufficient",
            Self::NotCertified => "not certified",
        }
    }
}

/// Judges the wake-ups, and gives a reason for everything but a certificate.
#[must_use]
pub fn judge(ticks: &Ticks, rate_hz: f64, load: &Done) -> (Verdict, Vec<String>) {
    let (period_s, mut late, mut missing) = (1.0 / rate_hz, Vec::new(), Vec::new());
    let count = ticks.lateness.count;
    if count < CERTIFIED_WAKE_UPS {
        missing.push(format!("{count} wake-ups were measured, and a certificate needs {CERTIFIED_WAKE_UPS}"));
    }
    if load.processors == 0 || load.copied_bytes == 0 || load.written_bytes == 0 {
        missing.push("they were measured without load".to_owned());
    }
    if ticks.p9999_s > TAIL_SHARE * period_s {
        late.push(format!(
            "one wake-up in ten thousand was late by {} or more, which is {} of the period; accepted: {}",
            duration(ticks.p9999_s),
            percent(ticks.p9999_s / period_s),
            percent(TAIL_SHARE)
        ));
    }
    // A period without a wake-up is later than any that had one.
    if ticks.skipped as f64 > TAIL * ticks.periods as f64 {
        late.push(format!("{} of {} periods had no wake-up at all", ticks.skipped, ticks.periods));
    }
    if ticks.lateness.worst_s > WORST_SHARE * period_s {
        late.push(format!(
            "the latest wake-up was {} late, which is {} of the period; accepted: {}",
            duration(ticks.lateness.worst_s),
            percent(ticks.lateness.worst_s / period_s),
            percent(WORST_SHARE)
        ));
    }
    let verdict = match (missing.is_empty(), late.is_empty()) {
        (false, _) => Verdict::NotCertified,
        (true, false) => Verdict::Insufficient,
        (true, true) => Verdict::Certified,
    };
    late.extend(missing);
    (verdict, late)
}

fn preemption(kernel: &Kernel) -> &'static str {
    match kernel.preemption {
        Preemption::RealTime => "PREEMPT_RT",
        Preemption::Full => "preemptible, not PREEMPT_RT",
        Preemption::Voluntary => "not preemptible",
        Preemption::Unknown => "not PREEMPT_RT",
    }
}

fn megabytes(bytes: u64) -> String {
    format!("{} MB", digits(bytes as f64 * 1e-6))
}

/// The load as a sentence.
fn load_words(load: &Done) -> String {
    if *load == Done::default() {
        return "none".to_owned();
    }
    format!(
        "{} threads that compute without a pause, one that copied {} in memory, one that wrote {} to the disk of the runs and waited for each megabyte, all at ordinary priority",
        load.processors,
        megabytes(load.copied_bytes),
        megabytes(load.written_bytes)
    )
}

/// Whether a word of the kernel's command line changes when threads wake up; others do not belong on a page that is
/// handed on.
fn is_about_time(word: &str) -> bool {
    const KEYS: [&str; 14] = [
        "clocksource",
        "cpufreq",
        "cpuidle",
        "idle",
        "intel_idle",
        "intel_pstate",
        "irqaffinity",
        "isolcpus",
        "mitigations",
        "nohz",
        "preempt",
        "processor",
        "rcu",
        "threadirqs",
    ];
    KEYS.iter().any(|key| word.starts_with(key))
}

/// What was measured on, and how.
fn conditions(kernel: &Kernel, system: &str, found: &TickResult, rate_hz: f64, load: &Done) -> Table {
    let mut table = Table::new("", &["condition", "here"]);
    let mut row = |name: &str, value: String| table.row([name.to_owned(), value]);
    let unknown = |text: &str| if text.is_empty() { "unknown".to_owned() } else { text.to_owned() };
    row("machine", format!("{}, {} processors", unknown(&kernel.model), kernel.online.len().max(1)));
    row("kernel", format!("{}, {}", unknown(&kernel.release), preemption(kernel)));
    let words = kernel.command_line.split_whitespace().filter(|word| is_about_time(word)).collect::<Vec<_>>();
    row(
        "command line of the kernel, about time",
        if words.is_empty() { "nothing".to_owned() } else { words.join(" ") },
    );
    let mut governors: Vec<&str> = kernel.governors.iter().map(|governor| &*governor.now).collect();
    governors.sort_unstable();
    governors.dedup();
    row("frequency of the processors", if governors.is_empty() { "fixed".to_owned() } else { governors.join(", ") });
    row("system file", system.to_owned());
    row("rate", format!("{rate_hz} Hz, a period of {}", duration(1.0 / rate_hz)));
    row("scheduling that it really gets", found.scheduling.lines().join("; "));
    row("load", load_words(load));
    row("version of nims", runtime::build::description().to_owned());
    row("date", runlog::utc(bus::clock::unix_ns()));
    table
}

fn figures(ticks: &Ticks, rate_hz: f64) -> Table {
    let mut table = Table::new("Delay of a wake-up", &["", "delay", "share of the period"]);
    for (name, value_s) in [
        ("median", ticks.lateness.median_s),
        ("99.9 %", ticks.lateness.p999_s),
        ("99.99 %", ticks.p9999_s),
        ("maximum", ticks.lateness.worst_s),
    ] {
        table.row([name.to_owned(), duration(value_s), percent(value_s * rate_hz)]);
    }
    let counts = format!("{} of {} periods", ticks.skipped, ticks.periods);
    table.row([
        "periods without a wake-up".to_owned(),
        counts,
        percent(ticks.skipped as f64 / ticks.periods.max(1) as f64),
    ]);
    table
}

fn histogram(ticks: &Ticks, rate_hz: f64) -> String {
    let decades = |delay_s: f64| libm::log10((delay_s * 1e6).max(1.0));
    // A class is a tenth of a decade wide, and one wake-up is one step high.
    let bars = ticks
        .classes
        .iter()
        .map(|(end_s, number)| [decades(*end_s) - 0.05, 1.0 + libm::log10(*number as f64)])
        .collect();
    let limit = |share: f64| {
        let at = decades(share / rate_hz);
        vec![[at, 0.0], [at, NUMBERS.len() as f64 - 1.0]]
    };
    let names = |list: &[&str]| list.iter().map(|name| (*name).to_owned()).collect();
    let chart = Chart {
        x: Axis { names: names(&DELAYS), ..Axis::fixed("delay of a wake-up", 0.0, DELAYS.len() as f64 - 1.0) },
        y: Axis { names: names(&NUMBERS), ..Axis::fixed("number of wake-ups", 0.0, NUMBERS.len() as f64 - 1.0) },
        series: vec![
            Series::line("", 0, bars).with_style(SeriesStyle::Bars(0.09)),
            Series::line("", 1, limit(TAIL_SHARE)),
            Series::line("", 1, limit(WORST_SHARE)).with_style(SeriesStyle::Dashed),
        ],
        ..Chart::default()
    };
    plot::svg(&chart, (760, 300))
}

fn page(verdict: Verdict, reasons: &[String], conditions: &Table, ticks: &Ticks, rate_hz: f64) -> String {
    let words = verdict.words();
    let title = format!("Wake-ups at {rate_hz} Hz: {words}");
    let list: String = reasons.iter().map(|reason| format!("<li>{}</li>\n", escape(reason))).collect();
    format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<meta charset=\"utf-8\">\n<meta name=\"viewport\" content=\"width=device-width\">\n\
         <title>{title}</title>\n<style>{STYLE}</style>\n<h1>{title}</h1>\n<p class=\"verdict {class}\">{words}</p>\n<ul>\n{list}</ul>\n\
         <p>A machine is certified if, under load, {wake_ups} wake-ups were measured, 99.99 % of them at most {tail} of the period late \
         (the line), and none more than {worst} (the dashed line).</p>\n{figures}{chart}\n{conditions}",
        class = words.replace(' ', "-"),
        wake_ups = CERTIFIED_WAKE_UPS,
        tail = percent(TAIL_SHARE),
        worst = percent(WORST_SHARE),
        figures = html_table(&figures(ticks, rate_hz)),
        chart = histogram(ticks, rate_hz),
        conditions = html_table(conditions),
    )
}

/// Judges, and writes the page.
///
/// # Errors
/// The page cannot be written; the machine is not certified.
pub fn issue(path: &Path, system: Option<&Path>, found: &TickResult, rate_hz: f64, load: Done) -> Answer<Output> {
    let (verdict, reasons) = judge(&found.ours, rate_hz, &load);
    let system = system.map(|path| path.display().to_string()).unwrap_or_default();
    let kernel = kernel::read(Path::new("/"));
    let conditions = conditions(&kernel, &system, found, rate_hz, &load);
    let text = page(verdict, &reasons, &conditions, &found.ours, rate_hz);
    std::fs::write(path, text)
        .map_err(|error| Failure::NotNow(format!("{} cannot be written: {error}", path.display())))?;
    let words = verdict.words();
    let value = json!({
        "verdict": words, "reasons": reasons, "page": path, "rate_hz": rate_hz, "tick": found,
        "load": load_words(&load),
    });
    let mut lines = vec![format!("{words} for {rate_hz} Hz: {}", path.display())];
    lines.extend(reasons.iter().map(|reason| format!("  {reason}")));
    let failure = (verdict != Verdict::Certified).then(|| Failure::NotNow(format!("this machine is {words}")));
    Ok(Output::new(value, lines.join("\n")).failing(failure))
}

#[cfg(test)]
mod tests {
    use super::super::figures::{Ratio, Spread};
    use super::super::scheduling::AchievedScheduling;
    use super::*;

    const LOAD: Done = Done { processors: 4, copied_bytes: 1 << 30, written_bytes: 1 << 20 };

    fn ticks(count: u64, p9999_s: f64, worst_s: f64, skipped: u64) -> Ticks {
        Ticks {
            lateness: Spread { count, median_s: 1e-5, p999_s: 5e-5, worst_s },
            p9999_s,
            classes: vec![(1.2e-5, count - 1), (worst_s, 1)],
            late: 0,
            skipped,
            periods: count + skipped,
        }
    }

    #[test]
    fn every_condition_decides() {
        let of = |count, p9999_s, worst_s, skipped, load: &Done| {
            let (verdict, reasons) = judge(&ticks(count, p9999_s, worst_s, skipped), 100.0, load);
            (verdict, reasons.len())
        };
        use Verdict::{Certified, Insufficient, NotCertified};
        assert_eq!(of(1_000_000, 1e-3, 5e-3, 100, &LOAD), (Certified, 0));
        assert_eq!(of(999_999, 1e-3, 5e-3, 0, &LOAD), (NotCertified, 1));
        assert_eq!(of(1_000_000, 1e-3, 5e-3, 0, &Done::default()), (NotCertified, 1));
        assert_eq!(of(1_000_000, 1e-3, 5e-3, 0, &Done { written_bytes: 0, ..LOAD }), (NotCertified, 1));
        assert_eq!(of(1_000_000, 1.01e-3, 5e-3, 0, &LOAD), (Insufficient, 1));
        assert_eq!(of(1_000_000, 1e-3, 5.1e-3, 0, &LOAD), (Insufficient, 1));
        assert_eq!(of(1_000_000, 1e-3, 5e-3, 101, &LOAD), (Insufficient, 1));
        // A short measurement proves nothing, and still names what was late.
        assert_eq!(of(1000, 2e-3, 6e-3, 1, &Done::default()), (NotCertified, 5));
        // The same delays are more of a shorter period.
        assert_eq!(judge(&ticks(1_000_000, 1e-3, 2e-3, 0), 250.0, &LOAD).0, Insufficient);
    }

    #[test]
    fn only_words_about_time_are_handed_on() {
        let line = "root=/dev/sda2 isolcpus=3 nohz_full=3 rcu_nocbs=3 processor.max_cstate=1 token=secret quiet";
        let words: Vec<&str> = line.split_whitespace().filter(|word| is_about_time(word)).collect();
        assert_eq!(words, ["isolcpus=3", "nohz_full=3", "rcu_nocbs=3", "processor.max_cstate=1"]);
    }

    #[test]
    fn the_page_states_verdict_machine_load_and_delays() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("page.html");
        let ours = ticks(1000, 2e-4, 3e-3, 0);
        let found = TickResult {
            plain: ours.clone(),
            ours,
            ratio: Ratio { median: 1.0, p999: 1.0 },
            scheduling: AchievedScheduling { fifo_priority: Some(50), ..AchievedScheduling::default() },
        };
        let output = issue(&path, Some(Path::new("lab.toml")), &found, 100.0, LOAD).unwrap();
        assert_eq!(output.value["verdict"], "not certified");
        assert!(output.failure.is_some());
        let page = std::fs::read_to_string(&path).unwrap();
        for words in ["<p class=\"verdict not-certified\">", "1000 wake-ups", "lab.toml"] {
            assert!(page.contains(words), "no {words:?} in {page}");
        }
        for words in [
            "SCHED_FIFO priority 50",
            "200 µs",
            "30 %",
            "4 threads",
            "<svg",
            "100 ms",
            &kernel::read(Path::new("/")).release,
        ] {
            assert!(page.contains(words), "no {words:?} in {page}");
        }
        // Two classes of delays, so two bars beside the frame.
        assert_eq!(page.matches("<rect").count(), 3);
        assert!(issue(&folder.path().join("no/page.html"), None, &found, 100.0, LOAD).is_err());
    }
}
