//! The page: one self-contained, printable HTML file without scripts or network access, with a light and a dark theme.

use super::charts::{self, Figure, cable_name};
use super::explain::{Between, Explanation};
use super::gather::RunData;
use super::legs::LegReport;
use super::tables::{self, scroll, words_table};
use super::verdict::{Grade, Verdict};
use messages::CABLES;
use plot::page::{Table, html_table};
use plot::{css_colour, escape};
use std::fmt::Write as _;

const STYLE: &str = "\
:root{color-scheme:light dark;--ink:#1d2733;--soft:#5d6b7a;--line:#dde3ea;--paper:#fff;--tint:#f5f7fa;--label:#46525f;--grid:#e9edf1;--frame:#b9c3cd;--black:#000}\
@media screen and (prefers-color-scheme:dark){:root{--ink:#e3e9ef;--soft:#9fadbb;--line:#33404d;--paper:#141a21;--tint:#1d252e;--label:#b4c0cc;--grid:#27313c;--frame:#46535f;--black:#f2f5f8}}\
*{box-sizing:border-box}body{font:15px/1.5 system-ui,'Segoe UI',Roboto,'Helvetica Neue',Arial,sans-serif;color:var(--ink);background:var(--paper);margin:0}\
main{max-width:1140px;margin:0 auto;padding:1.6rem 1.2rem 4rem}main.several{max-width:1900px}\
header{border-bottom:1px solid var(--line);padding-bottom:1.1rem;margin-bottom:1.4rem}\
h1{font-size:1.5rem;line-height:1.25;margin:0 0 .2rem}h2{font-size:1.12rem;margin:2.4rem 0 .7rem;padding-top:1rem;border-top:1px solid var(--line)}\
h3{font-size:1rem;margin:.2rem 0 .6rem;color:var(--soft)}p{margin:.4rem 0}.soft{color:var(--soft)}\
.verdict{border-left:5px solid;padding:.7rem 1rem;margin:.9rem 0 0;font-size:1.06rem;background:var(--tint)}\
.good{border-color:#2c8c3c}.remarks{border-color:#d08700}.bad{border-color:#c62f2f}\
.facts{display:grid;grid-template-columns:repeat(auto-fit,minmax(165px,1fr));gap:1px;background:var(--line);border:1px solid var(--line);margin:1.2rem 0}\
.facts div{background:var(--paper);padding:.55rem .8rem}.facts span{display:block;color:var(--soft);font-size:.8rem}.facts b{font-size:1.02rem;font-weight:600}\
.runs{display:grid;grid-template-columns:repeat(var(--runs),minmax(0,1fr));gap:1.6rem}.run{display:flex;flex-wrap:wrap;gap:.4rem 16px;align-content:flex-start}.run>*{width:100%}\
figure{margin:.3rem 0 .6rem;break-inside:avoid}figure.half{width:calc(50% - 8px)}\
figcaption{font-size:.9rem;margin-left:.2rem}figcaption b{font-weight:600;margin-right:.6rem}\
.key{white-space:nowrap;color:var(--soft);margin-right:.8rem;font-size:.84rem}.key i{color:var(--black);display:inline-block;width:.8em;height:.8em;border-radius:2px;margin-right:.35em;vertical-align:-.05em}\
svg{display:block;width:100%;height:auto;font:12px system-ui,'Segoe UI',Roboto,'Helvetica Neue',Arial,sans-serif;fill:var(--label);color:var(--black)}\
svg .grid{stroke:var(--grid);fill:none}svg .frame{fill:none;stroke:var(--frame)}\
.scroll{overflow:auto;max-height:60rem;margin:.3rem 0 .8rem}table{border-collapse:collapse;font-size:.86rem;font-variant-numeric:tabular-nums;min-width:50%}\
caption{text-align:left;font-weight:600;padding:.2rem 0}th,td{border-bottom:1px solid var(--line);padding:.28rem .6rem;text-align:right;vertical-align:top}\
th{color:var(--soft);font-weight:600;background:var(--tint);position:sticky;top:0}td:first-child,th:first-child{text-align:left}\
table.words td,table.words th{text-align:left}table.words td:first-child{text-align:right}\
footer{margin-top:3rem;color:var(--soft);font-size:.82rem;border-top:1px solid var(--line);padding-top:.8rem}\
@media(min-width:1200px){table:not(.words) td{white-space:nowrap}}\
@media(max-width:900px){th,td{padding:.28rem .22rem}td:first-child{position:sticky;left:0;background:var(--paper)}table.words td{overflow-wrap:anywhere}table{font-size:.8rem}}\
@media(max-width:760px){figure.half{width:100%}.runs{grid-template-columns:minmax(0,1fr)}table{font-size:.72rem}}\
@media print{main{max-width:none;padding:0}h2{break-after:avoid}.scroll{overflow:visible;max-height:none}body{font-size:12px}table{font-size:.75rem}}";

/// A run with its assessment.
pub struct RunAssessment {
    /// The collected data.
    pub run: RunData,
    /// The verdict.
    pub verdict: Verdict,
    /// The legs.
    pub legs: Vec<LegReport>,
    /// The largest deviations of the run.
    pub deviations: Vec<Explanation>,
    /// The deviations of an asked time.
    pub between: Option<Between>,
}

/// Content of one section for one run.
#[derive(Default)]
struct Part {
    before: String,
    figures: Vec<Figure>,
    after: String,
}

/// Renders the page of one run, or of several side by side.
pub fn page(runs: &[RunAssessment]) -> String {
    let names: Vec<&str> = runs.iter().map(|assessment| assessment.run.name.as_str()).collect();
    let title = names.join(" and ");
    let mut out = String::new();
    // Writing to a string cannot fail.
    let _ = write!(
        out,
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n<meta name=\"viewport\" content=\"width=device-width\">\n\
         <title>{}</title>\n<style>{STYLE}</style>\n</head>\n<body>\n<main class=\"{}\">\n",
        escape(&title),
        if runs.len() == 1 { "single" } else { "several" }
    );
    out.push_str(&header(&title, runs));
    out.push_str(&facts(runs));
    section(&mut out, runs, "Legs", |assessment| Part { before: leg_table(assessment), ..Part::default() });
    section(&mut out, runs, "Path", |assessment| {
        let mut figures = charts::path(&assessment.run);
        figures.extend(charts::site(&assessment.run));
        Part { figures, ..Part::default() }
    });
    section(&mut out, runs, "Tracking", |assessment| Part {
        figures: charts::tracking(&assessment.run),
        after: tables::deviations(&assessment.deviations, assessment.between.as_ref(), &assessment.legs),
        ..Part::default()
    });
    section(&mut out, runs, "Events", |assessment| Part {
        figures: charts::timeline(&assessment.run),
        before: tables::incidents(&assessment.run),
        after: tables::in_charge(&assessment.run) + &event_table(&assessment.run),
    });
    section(&mut out, runs, "Cables", |assessment| Part {
        before: cable_table(&assessment.run),
        figures: charts::cables(&assessment.run),
        ..Part::default()
    });
    section(&mut out, runs, "Energy", |assessment| Part {
        before: energy_table(assessment),
        figures: charts::power(&assessment.run),
        ..Part::default()
    });
    section(&mut out, runs, "Control cycle", |assessment| Part {
        before: timing_table(&assessment.run),
        figures: charts::timing(&assessment.run),
        after: tables::losses(&assessment.run) + &tables::units(&assessment.run) + &process_table(&assessment.run),
    });
    if runs.iter().any(|assessment| !assessment.run.sensors.channels().is_empty()) {
        section(&mut out, runs, "Sensors", |assessment| {
            let mut figures = super::map_charts::figures(&assessment.run);
            figures.extend(charts::sensors(&assessment.run));
            Part { before: tables::sensors(&assessment.run), figures, ..Part::default() }
        });
    }
    section(&mut out, runs, "Recording", |assessment| Part { before: recording(&assessment.run), ..Part::default() });
    let _ = writeln!(
        out,
        "<footer>Created by nims {} from the run {}. Bands show the least and the greatest value of each time interval, lines the mean.</footer>\n</main>\n</body>\n</html>",
        escape(runtime::build::description()),
        if runs.len() == 1 { "file alone" } else { "files alone" }
    );
    out
}

/// Returns the title with the verdict of each run.
fn header(title: &str, runs: &[RunAssessment]) -> String {
    let mut out = format!("<header><h1>{}</h1>\n", escape(title));
    for assessment in runs {
        let class = match assessment.verdict.grade {
            Grade::Good => "good",
            Grade::Remarks => "remarks",
            Grade::Bad => "bad",
        };
        let name = if runs.len() == 1 { String::new() } else { format!("<b>{}.</b> ", escape(&assessment.run.name)) };
        let _ = writeln!(out, "<p class=\"verdict {class}\">{name}{}</p>", escape(&assessment.verdict.sentence));
    }
    out.push_str("</header>\n");
    out
}

fn section(out: &mut String, runs: &[RunAssessment], title: &str, part: impl Fn(&RunAssessment) -> Part) {
    let mut parts: Vec<Part> = runs.iter().map(part).collect();
    // The same figure of all runs has the same axes.
    let captions: Vec<String> =
        parts.iter().flat_map(|part| part.figures.iter().map(|figure| figure.caption.clone())).collect();
    for (at, caption) in captions.iter().enumerate() {
        if !captions[..at].contains(caption) {
            let same =
                parts.iter_mut().flat_map(|part| part.figures.iter_mut()).filter(|figure| figure.caption == *caption);
            charts::share_axes(same);
        }
    }
    let _ = writeln!(out, "<section><h2>{}</h2>\n<div class=\"runs\" style=\"--runs:{}\">", escape(title), runs.len());
    for (part, assessment) in parts.iter().zip(runs) {
        out.push_str("<div class=\"run\">\n");
        if runs.len() > 1 {
            let _ = writeln!(out, "<h3>{}</h3>", escape(&assessment.run.name));
        }
        out.push_str(&part.before);
        for figure in part.figures.iter().filter(|figure| !figure.is_empty()) {
            draw(out, figure);
        }
        out.push_str(&part.after);
        if part.before.is_empty() && part.after.is_empty() && part.figures.iter().all(Figure::is_empty) {
            out.push_str("<p class=\"soft\">Nothing to show.</p>\n");
        }
        out.push_str("</div>\n");
    }
    out.push_str("</div></section>\n");
}

fn draw(out: &mut String, figure: &Figure) {
    let class = if figure.half { " class=\"half\"" } else { "" };
    let _ = write!(out, "<figure{class}><figcaption><b>{}</b>", escape(&figure.caption));
    let mut said: Vec<&(String, String)> = Vec::new();
    for key in figure.key.iter().filter(|(_, name)| !name.is_empty()) {
        if !said.contains(&key) {
            let _ = write!(out, "<span class=\"key\"><i style=\"background:{}\"></i>{}</span>", key.0, escape(&key.1));
            said.push(key);
        }
    }
    let _ = writeln!(out, "</figcaption>{}</figure>", figure.svg());
}

/// Returns the key figures of a run, the same list for every run.
fn facts_of(assessment: &RunAssessment) -> Vec<(&'static str, String)> {
    let run = &assessment.run;
    let none = || "-".to_owned();
    let mm = |error: Option<&crate::accuracy::Error>| {
        error.map_or_else(none, |error| format!("{:.2} RMS, {:.2} max", 1000.0 * error.rms_m, 1000.0 * error.max_m))
    };
    let analysis = run.analysis.as_ref();
    let cycles = run.authority.as_ref();
    let energy: f64 = run.cables.iter().map(|cable| cable.energy_j).sum();
    let loss: f64 = run.cables.iter().map(|cable| cable.loss_j).sum();
    let tensions = run.cables.iter().filter_map(|cable| cable.tension.extremes());
    let [low, high] =
        tensions.fold([f64::INFINITY, f64::NEG_INFINITY], |sum, one| [sum[0].min(one[0]), sum[1].max(one[1])]);
    let lost: u64 = run.recording.channels.iter().map(|channel| channel.lost).sum();
    vec![
        ("started", run.recording.started.clone().unwrap_or_else(none)),
        ("duration", seconds(run.recording.duration_s)),
        (
            "robot",
            format!(
                "{} cables at {}",
                run.cables.len(),
                cycles.map_or_else(none, |last| format!("{:.0} Hz", 1.0 / last.period_s))
            ),
        ),
        (
            "flown path",
            format!(
                "{}{:.2} m in {} legs",
                super::verdict::at_least(run),
                run.legs.flown_m(),
                assessment.legs.len() + run.legs.left_out
            ),
        ),
        ("tracking: estimate from setpoint, mm", mm(analysis.map(|analysis| &analysis.estimate))),
        ("model error: truth from estimate, mm", mm(analysis.and_then(|analysis| analysis.model.as_ref()))),
        ("model error as the estimate states it", analysis.map_or_else(none, |analysis| analysis.stated.to_string())),
        ("both: truth from setpoint, mm", mm(analysis.and_then(|analysis| analysis.truth.as_ref()))),
        ("world of the truth", run.world.clone().unwrap_or_else(none)),
        ("tensions", if low <= high { format!("{low:.1} to {high:.1} N") } else { none() }),
        ("electrical energy", format!("{energy:.1} J, {loss:.1} J of it lost")),
        ("steered", if run.periods.all() > 0 { run.periods.leading() } else { none() }),
        ("not steered, by cause", if run.periods.all() > 0 { run.periods.by_cause() } else { none() }),
        ("faults", run.events.faults.to_string()),
        ("recorded; lost", format!("{} samples; {lost} in {:.1} s", run.recording.messages, run.unrecorded_s())),
        (
            "size of the files",
            format!("{:.1} MB", run.recording.files.iter().map(|file| file.bytes as f64).sum::<f64>() * 1e-6),
        ),
    ]
}

fn facts(runs: &[RunAssessment]) -> String {
    let all: Vec<Vec<(&str, String)>> = runs.iter().map(facts_of).collect();
    let Some(first) = all.first() else { return String::new() };
    if runs.len() == 1 {
        let tiles: String = first
            .iter()
            .map(|(what, value)| format!("<div><span>{}</span><b>{}</b></div>", escape(what), escape(value)))
            .collect();
        return format!("<div class=\"facts\">{tiles}</div>\n");
    }
    let head: Vec<&str> =
        std::iter::once("").chain(runs.iter().map(|assessment| assessment.run.name.as_str())).collect();
    let mut table = Table::new("", &head);
    for (row, (what, _)) in first.iter().enumerate() {
        table.row(std::iter::once((*what).to_owned()).chain(all.iter().map(|facts| facts[row].1.clone())));
    }
    scroll(&html_table(&table))
}

fn seconds(seconds: f64) -> String {
    if seconds < 900.0 { format!("{seconds:.1} s") } else { format!("{:.1} min", seconds / 60.0) }
}

fn maybe(value: Option<f64>, digits: usize) -> String {
    value.filter(|value| value.is_finite()).map_or_else(|| "-".to_owned(), |value| format!("{value:.digits$}"))
}

fn point(p: &[f64; 3]) -> String {
    format!("{:.2}, {:.2}, {:.2}", p[0], p[1], p[2])
}

fn leg_table(assessment: &RunAssessment) -> String {
    if assessment.legs.is_empty() {
        return "<p class=\"soft\">No leg was flown.</p>\n".to_owned();
    }
    let head = [
        "leg",
        "start, s",
        "from, m",
        "to, m",
        "length, m",
        "flown, m",
        "planned, s",
        "flown, s",
        "cruise, m/s",
        "estimate RMS, mm",
        "max, mm",
        "truth RMS, mm",
        "max, mm",
        "peak tension, N",
    ];
    let mut table = Table::new("", &head);
    for (at, leg) in assessment.legs.iter().enumerate() {
        let mm = |value: Option<f64>| maybe(value.map(|metres| 1000.0 * metres), 2);
        let now = super::verdict::current_activity(&assessment.run).filter(|_| at + 1 == assessment.legs.len());
        let unfinished = leg.unfinished(now);
        table.row([
            format!("{} {}{unfinished}", leg.number, leg.kind),
            format!("{:.1}", leg.begin_s),
            point(&leg.from_m),
            point(&leg.to_m),
            format!("{:.2}", leg.length_m),
            format!("{:.2}", leg.flown_m),
            format!("{:.1}", leg.planned_s),
            format!("{:.1}", leg.duration_s),
            format!("{:.2}", leg.cruise_m_s),
            mm(leg.estimate.map(|error| error.rms_m)),
            mm(leg.estimate.map(|error| error.max_m)),
            mm(leg.truth.map(|error| error.rms_m)),
            mm(leg.truth.map(|error| error.max_m)),
            format!("{:.1}", leg.peak_tension_n),
        ]);
    }
    let more = match assessment.run.legs.left_out {
        0 => String::new(),
        more => format!(
            "<p class=\"soft\">{more} further legs are included in the figures above but not in the tables.</p>\n"
        ),
    };
    scroll(&html_table(&table)) + &more
}

fn energy_table(assessment: &RunAssessment) -> String {
    let moving: Vec<&LegReport> = assessment.legs.iter().filter(|leg| leg.energy_j.is_some()).collect();
    if moving.is_empty() {
        return String::new();
    }
    let head = [
        "leg",
        "electrical, J",
        "mean power, W",
        "lost in the motors, J",
        "mean loss, W",
        "model: loss, J",
        "model: straight line, J",
        "compared with the straight line",
    ];
    let mut table = Table::new("", &head);
    for leg in moving {
        let against = leg.reckoned_j.zip(leg.straight_j).map(|(own, straight)| 100.0 * (own / straight - 1.0));
        table.row([
            format!("{} {}", leg.number, leg.kind),
            maybe(leg.energy_j, 2),
            maybe(leg.energy_j.map(|energy| energy / leg.duration_s), 2),
            maybe(leg.loss_j, 2),
            maybe(leg.mean_loss_w, 2),
            maybe(leg.reckoned_j, 2),
            maybe(leg.straight_j, 2),
            against.map_or_else(
                || "-".to_owned(),
                |percent| if percent.abs() < 0.05 { "the same".to_owned() } else { format!("{percent:+.1} %") },
            ),
        ]);
    }
    scroll(&html_table(&table))
        + "<p class=\"soft\">Lost in the motors: current squared times armature resistance. Model: the same for the planned path and speeds, \
           and for a straight line between the same points with the same speed and acceleration.</p>\n"
}

fn cable_table(run: &RunData) -> String {
    if run.cables.is_empty() {
        return String::new();
    }
    let head = [
        "",
        "length, m",
        "speed, m/s",
        "tension, N",
        "true tension, N",
        "current, A",
        "electrical, J",
        "lost, J",
        "velocity error, RMS mm/s",
    ];
    let mut table = Table::new("", &head);
    let span = |extremes: Option<[f64; 2]>, digits: usize| {
        extremes.map_or_else(|| "-".to_owned(), |[low, high]| format!("{low:.digits$} to {high:.digits$}"))
    };
    for (i, cable) in run.cables.iter().enumerate().take(CABLES) {
        table.row([
            cable_name(i),
            span(cable.length.extremes(), 3),
            span(cable.velocity.extremes(), 3),
            span(cable.tension.extremes(), 1),
            span(cable.true_tension.extremes(), 1),
            span(cable.current.extremes(), 2),
            format!("{:.1}", cable.energy_j),
            format!("{:.1}", cable.loss_j),
            maybe(cable.lag.result().map(|error| 1000.0 * error.rms_m), 1),
        ]);
    }
    let mut html = html_table(&table);
    for i in 0..run.cables.len() {
        let name = cable_name(i);
        let chip = format!("<td><span class=\"key\"><i style=\"background:{}\"></i></span>{name}</td>", css_colour(i));
        html = html.replacen(&format!("<td>{name}</td>"), &chip, 1);
    }
    scroll(&html)
}

fn timing_table(run: &RunData) -> String {
    let Some(last) = &run.authority else { return String::new() };
    let head = ["", "median, ms", "99 %, ms", "99.9 %, ms", "longest, ms"];
    let mut table = Table::new("", &head);
    let steps = ["tick to wake-up", "bus exchange", "oldest reading to command", "publication of state to command"];
    for (name, times) in steps.into_iter().zip(&run.times) {
        let ms = |ns: u64| if times.all.is_empty() { "-".to_owned() } else { format!("{:.3}", ns as f64 * 1e-6) };
        let quantile = |share: f64| ms(times.all.value_at_quantile(share));
        table.row([name.to_owned(), quantile(0.5), quantile(0.99), quantile(0.999), ms(times.all.max())]);
    }
    let sentence = format!(
        "<p>A period takes {:.1} ms. <b>{}</b> during missions, without {} periods of operators' pauses: {}. Computer: a program did \
         not get the processor, according to the kernel. Drive: no answer in time. Resync: a port was being resynchronised. Answer: no valid \
         command, for any other reason.</p>\n",
        1000.0 * last.period_s,
        run.periods.leading(),
        run.periods.paused,
        run.periods.by_cause()
    );
    sentence + &scroll(&html_table(&table))
}

fn process_table(run: &RunData) -> String {
    if run.processes.is_empty() {
        return String::new();
    }
    let head = ["process", "passes", "median, ms", "99 %, ms", "longest, ms", "lost input samples"];
    let mut table = Table::new("Loops of the processes", &head);
    for (name, beat) in &run.processes {
        let ms = |ns: u64| format!("{:.3}", ns as f64 * 1e-6);
        table.row([
            name.clone(),
            beat.passes.to_string(),
            ms(beat.busy_p50_ns),
            ms(beat.busy_p99_ns),
            ms(beat.busy_max_ns),
            beat.lost.to_string(),
        ]);
    }
    scroll(&html_table(&table))
}

fn event_table(run: &RunData) -> String {
    if run.events.all().is_empty() {
        return String::new();
    }
    let mut table = Table::new("", &["s", "UTC", "about", "what"]);
    for event in run.events.all() {
        let again = if event.times > 1 { format!(" ({} times in ten seconds)", event.times) } else { String::new() };
        let utc = run.utc(event.time_s).unwrap_or_default();
        table.row([
            format!("{:.2}", event.time_s),
            utc,
            event.kind.name().to_owned(),
            format!("{}{again}", event.text),
        ]);
    }
    let more = match run.events.left_out {
        0 => String::new(),
        more => format!("<p class=\"soft\">{more} further events are not listed.</p>\n"),
    };
    words_table(&table) + &more
}

fn recording(run: &RunData) -> String {
    let recording = &run.recording;
    let mut out = String::new();
    for sentence in recording.verdict.iter().chain(&run.lacks) {
        let mut letters = sentence.chars();
        let first: String = letters.next().map(|letter| letter.to_uppercase().collect()).unwrap_or_default();
        let _ = writeln!(out, "<p>{}{}</p>", escape(&first), escape(letters.as_str()));
    }
    if let Some(free) = run.least_free_bytes {
        let lag = run.recorder.values().map(|status| status.worst_lag_ns).max().unwrap_or(0);
        let _ = writeln!(
            out,
            "<p>The disk always had at least {:.1} GB free. The recorder wrote each sample within {:.1} ms.</p>",
            free as f64 * 1e-9,
            lag as f64 * 1e-6
        );
    }
    if let Some(ended) = &recording.ended {
        let _ = writeln!(out, "<p>End of the recording: {}.</p>", escape(ended));
    }
    let mut files = Table::new("Files", &["file", "MB", "state", "damage"]);
    for file in &recording.files {
        let damage: Vec<String> = file
            .damage
            .iter()
            .map(|damage| format!("{} bytes at {}: {}", damage.bytes, damage.offset, damage.why))
            .collect();
        files.row([
            file.path.file_name().unwrap_or_default().to_string_lossy().into_owned(),
            format!("{:.2}", file.bytes as f64 * 1e-6),
            match (file.finished, file.recording, file.silent_s) {
                (true, ..) => "closed properly".to_owned(),
                (false, true, 0) => "being recorded".to_owned(),
                (false, true, silent_s) => format!("open, nothing written for {silent_s} s"),
                (false, false, _) => "not closed".to_owned(),
            },
            if damage.is_empty() { "none".to_owned() } else { damage.join("; ") },
        ]);
    }
    out.push_str(&scroll(&html_table(&files)));
    let mut channels =
        Table::new("Channels", &["channel", "samples", "rate, Hz", "longest silence, s", "lost", "gaps", "type"]);
    for channel in &recording.channels {
        channels.row([
            channel.name.clone(),
            channel.messages.to_string(),
            maybe(channel.rate_hz, 1),
            format!("{:.3}", channel.longest_silence_s),
            channel.lost.to_string(),
            channel.gaps.to_string(),
            channel.refused.as_ref().map_or_else(|| channel.schema.clone(), |why| format!("plain bytes: {why}")),
        ]);
    }
    out.push_str(&scroll(&html_table(&channels)));
    let mut about = Table::new("About", &["", ""]);
    for (key, value) in &recording.about {
        about.row([key.clone(), value.clone()]);
    }
    out.push_str(&words_table(&about).replacen("class=\"words\"", "", 1));
    out
}
