//! Plots of what was identified: the values of each cable with their deviations, and the commands with the lengths that
//! follow.

use std::path::Path;

use calibration::Found;
use calibration::flight::WIDE;
use command::Answer;
use identification::{Identified, Value};
use plot::{Axis, Chart, Legend, Picture, Series, SeriesStyle};

use super::findings::Findings;
use super::rows::Recorded;

/// Most points of a line.
const POINTS: usize = 800;

/// Writes identify.svg and identify.png.
pub(super) fn save(out: &Path, recorded: &Recorded, found: &Findings) -> Answer {
    let mut charts = vec![
        values(
            found,
            "delay and lag of each cable",
            "time, ms",
            &[
                ("delay", &|one| Some((one.drive.delay_s, 1e3))),
                ("lag", &|one| Some((one.drive.lag_s, 1e3))),
                ("both", &|one| Some((one.drive.total_s, 1e3))),
            ],
        ),
        values(
            found,
            "load as a share of the model's",
            "share",
            &[("load", &|one| Some((one.motor?.load_share, 1.0)))],
        ),
    ];
    charts.extend(stiffness(recorded, found));
    charts.extend(recorded.cables.iter().enumerate().map(|(cable, record)| {
        let step = record.len().div_ceil(POINTS).max(1);
        let begin_s = record.sent_s.first().copied().unwrap_or_default();
        let commands = (0..record.len()).step_by(step).map(|k| [record.sent_s[k] - begin_s, record.command_m_s[k]]);
        let measured = (step..record.len()).step_by(step).map(|k| {
            let (from, to) = (k - step, k);
            let speed = (record.length_m[to] - record.length_m[from]) / (record.read_s[to] - record.read_s[from]);
            [0.5 * (record.read_s[to] + record.read_s[from]) - begin_s, speed]
        });
        Chart {
            caption: format!("cable {}", cable + 1),
            x: Axis::auto("time, s"),
            y: Axis::auto("velocity, m/s"),
            series: vec![
                Series::line("command", 0, commands.collect()),
                Series::line("measured", 1, measured.collect()),
            ],
            legend: Legend::UpperRight,
            ..Chart::default()
        }
    }));
    let rows = charts.len().div_ceil(2) as u32;
    let title = format!("identified from {:.0} s", found.used_s);
    plot::save(&out.join("identify"), &Picture { title, size: (1200, 380 * rows), columns: 2, charts })
}

/// The stiffness before the flight and after it, if the flight tells it.
fn stiffness(recorded: &Recorded, found: &Findings) -> Option<Chart> {
    let Found::Determined { value, std } = found.stiffness.stiffness_n else { return None };
    let stated_n = recorded.robot.as_ref()?.stiffness_n?;
    let both = [("robot file, as a kind of cable", stated_n, WIDE * stated_n), ("this run", value, std)];
    let mut series = Vec::new();
    for (number, (name, value_n, sigma_n)) in both.into_iter().enumerate() {
        let x = (number + 1) as f64;
        let bar = [-2.0, 2.0].map(|sigmas| [x, 1e-3 * (value_n + sigmas * sigma_n)]);
        series.push(Series::line("", number, bar.to_vec()));
        series.push(Series::line(name, number, vec![[x, 1e-3 * value_n]]).with_style(SeriesStyle::Discs(4)));
    }
    Some(Chart {
        caption: "stiffness EA of the cables, with two standard deviations".to_owned(),
        x: Axis::fixed("before the run, after it", 0.5, 2.8),
        y: Axis::auto("EA, kN"),
        series,
        legend: Legend::UpperRight,
        ..Chart::default()
    })
}

/// A named value of a cable and the scale in which it is drawn.
type Named<'a> = (&'a str, &'a dyn Fn(&Identified) -> Option<(Value, f64)>);

fn values(found: &Findings, caption: &str, label: &str, all: &[Named<'_>]) -> Chart {
    let mut series = Vec::new();
    for (colour, (name, of)) in all.iter().enumerate() {
        let mut points = Vec::new();
        for (index, one) in found.cables.iter().enumerate() {
            let Some((value, scale)) = one.as_ref().ok().and_then(of) else { continue };
            let x = (index + 1) as f64 + 0.1 * colour as f64;
            points.push([x, scale * value.value]);
            let bar = [-2.0, 2.0].map(|sigmas| [x, scale * (value.value + sigmas * value.sigma)]);
            series.push(Series::line("", colour, bar.to_vec()));
        }
        series.push(Series::line(name, colour, points).with_style(SeriesStyle::Discs(4)));
    }
    Chart {
        caption: format!("{caption}, with two standard deviations"),
        x: Axis::fixed("cable", 0.5, found.cables.len() as f64 + 0.8),
        y: Axis::auto(label),
        series,
        legend: Legend::UpperRight,
        ..Chart::default()
    }
}
