//! Figures 12 and 13: paths of moves, and the current of a motor during one.

use super::comparison::{MoveComparison, three_words};
use crate::flight::Track;
use crate::section::{Check, Effort, Section, Table, fixed, mean, rms};
use crate::stand_in;
use anyhow::Result;
use cable_robot::Vector3;
use cable_robot::motor::Motor;
use plot::{Axis, BLACK, Chart, GREY, Legend, Picture, Series, SeriesStyle};

fn track_path(track: &Track, name: &str, colour: usize, onto: fn(&Vector3<f64>) -> [f64; 2]) -> Series {
    track.path(name, colour, |at| at.truth, onto)
}

/// Projects the flown paths onto a plane.
fn path_view(moves: &MoveComparison, caption: &str, y: &str, onto: fn(&Vector3<f64>) -> [f64; 2]) -> Chart {
    let anchors: Vec<[f64; 2]> = stand_in::three_cable_anchors().iter().map(|a| onto(&Vector3::from(*a))).collect();
    let mut outline = anchors.clone();
    outline.push(anchors[0]);
    // The legend is in the view that has space for it.
    let named = y == "z, m";
    let mut series = vec![
        Series::line(if named { "anchors" } else { "" }, BLACK, anchors).with_style(SeriesStyle::Discs(5)),
        Series::line("", GREY, outline).with_style(SeriesStyle::Dashed),
    ];
    for (k, tracks) in moves.flown.iter().enumerate() {
        let name = |text: &str| if k == 0 && named { text.to_owned() } else { String::new() };
        series.push(track_path(&tracks[1], &name("parabolas, flown"), 0, onto));
        series.push(track_path(&tracks[0], &name("straight lines, flown"), 1, onto));
    }
    Chart {
        caption: caption.into(),
        x: Axis::auto("x, m"),
        y: Axis::auto(y),
        series,
        equal_scale: true,
        legend: Legend::UpperLeft,
    }
}

/// Figure 12: paths.
pub fn fig12(effort: Effort) -> Result<Section> {
    let moves = MoveComparison::fly(effort)?;
    let view = |caption, y, onto| path_view(&moves, caption, y, onto);
    let charts = vec![view("from above", "y, m", |p| [p.x, p.y]), view("from the side", "z, m", |p| [p.x, p.z])];
    let distance =
        |k: usize| 1e3 * rms(&moves.flown.iter().flat_map(|tracks| tracks[k].errors_of_truth_m()).collect::<Vec<_>>());
    let deepest: Vec<f64> = moves
        .expected
        .iter()
        .zip(&moves.flown)
        .map(|((_, best), tracks)| {
            let ends = &tracks[1].instants;
            let (from, to) = (ends[0].setpoint, ends[ends.len() - 1].setpoint);
            let extent = (to - from).xy().norm();
            0.25 * best.mu_per_m * extent * extent
        })
        .collect();
    let mut table = Table::new("The moves", &["move", "optimal mu, 1/m", "sag below the middle, m"]);
    for (k, ((_, best), sag)) in moves.expected.iter().zip(&deepest).enumerate() {
        table.row([format!("{}", k + 1), fixed(best.mu_per_m, 3), fixed(*sag, 2)]);
    }
    Ok(Section {
        key: "fig12",
        title: "Figure 12: straight lines and optimised parabolas",
        claim: "Straight and optimised parabolic trajectories through the same points are executed.".into(),
        stand_in: three_words(),
        tables: vec![table],
        pictures: vec![Picture { title: String::new(), size: (1040, 480), columns: 2, charts }],
        checks: vec![
            Check::claim(
                moves.flown.iter().flatten().all(|track| track.done && track.unsteered == 0),
                format!("all {} moves are completed with every period steered", 2 * moves.flown.len()),
            ),
            Check::claim(
                distance(0) < 10.0 && distance(1) < 10.0,
                format!(
                    "the node stays within {:.1} mm RMS of the lines and {:.1} mm of the parabolas",
                    distance(0),
                    distance(1)
                ),
            ),
            Check::claim(
                deepest.iter().all(|sag| *sag > 0.1),
                "every optimal parabola sags clearly below its line".into(),
            ),
        ],
        ..Section::default()
    })
}

/// Returns the current of a motor over a flight according to statics and the friction model, A.
fn expected_current(track: &Track, motor: &Motor, cable: usize) -> Result<Vec<[f64; 2]>> {
    let anchors = stand_in::anchors(&stand_in::three_cable_anchors())?;
    track
        .instants
        .windows(3)
        .step_by(2)
        .map(|three| {
            let [before, at, after] = [three[0], three[1], three[2]];
            let structure = cable_robot::StructureMatrix::at(&anchors, &at.setpoint)?;
            let dt = after.time_s - before.time_s;
            let velocity = if dt > 0.0 { (after.setpoint - before.setpoint) / dt } else { Vector3::zeros() };
            let tension = cable_robot::tension::unique(&structure, &stand_in::weight())?;
            let line = anchors[cable] - at.setpoint;
            let reel_in = line.dot(&velocity) / line.norm();
            Ok([at.time_s, motor.current_a(tension[cable], reel_in)])
        })
        .collect()
}

/// Figure 13: current of motor 2 compared with the expected values.
pub fn fig13(effort: Effort) -> Result<Section> {
    let moves = MoveComparison::fly(effort)?;
    let motor = stand_in::geared();
    let cable = 1;
    let mut charts = Vec::new();
    let mut powers = Vec::new();
    let mut deviations = Vec::new();
    for (k, caption) in ["straight line", "optimised parabola"].into_iter().enumerate() {
        let track = &moves.flown[0][k];
        let expected = expected_current(track, &motor, cable)?;
        let measured: Vec<f64> = track.instants.windows(3).step_by(2).map(|three| three[1].current_a[cable]).collect();
        let moving: Vec<bool> = track.instants.windows(3).step_by(2).map(|three| three[1].moving).collect();
        let pick = |values: &mut dyn Iterator<Item = f64>| -> Vec<f64> {
            values.zip(&moving).filter(|(_, moving)| **moving).map(|(value, _)| value).collect()
        };
        let differences = pick(&mut expected.iter().zip(&measured).map(|(e, m)| m - e[1]));
        let sizes = pick(&mut expected.iter().map(|e| e[1]));
        deviations.push(rms(&differences) / rms(&sizes));
        powers.push(motor.resistance_ohm * mean(&pick(&mut measured.iter().map(|i| i * i))));
        charts.push(Chart {
            caption: caption.into(),
            x: Axis::auto("time, s"),
            y: Axis::auto("current of motor 2, A"),
            series: vec![
                track.over_time("measured by the drive", 0, |at| at.current_a[cable]).with_style(SeriesStyle::Line(1)),
                Series::line("expected", 1, expected),
            ],
            legend: Legend::LowerRight,
            ..Chart::default()
        });
    }
    // Both charts have the same scale.
    let top = charts.iter().flat_map(|chart| &chart.series).flat_map(|s| &s.points).fold(0.0, |m: f64, p| m.max(p[1]));
    let low = charts.iter().flat_map(|chart| &chart.series).flat_map(|s| &s.points).fold(0.0, |m: f64, p| m.min(p[1]));
    for chart in &mut charts {
        chart.y.range = Some([low * 1.1, top * 1.1]);
    }
    Ok(Section {
        key: "fig13",
        title: "Figure 13: current of motor 2 compared with the expected values",
        claim: "Measured currents are in fair agreement with the expected ones, and the mean power falls substantially with the \
                parabola."
            .into(),
        stand_in: format!("{} The first move; expected currents are quasi-static.", three_words()),
        pictures: vec![Picture { title: String::new(), size: (1040, 400), columns: 2, charts }],
        checks: vec![
            Check::claim(
                deviations.iter().all(|d| *d < 0.2),
                format!(
                    "the measured current deviates by {:.0} % (line) and {:.0} % (parabola) of the expected one, root mean square",
                    100.0 * deviations[0],
                    100.0 * deviations[1]
                ),
            ),
            Check::claim(
                powers[1] < 0.8 * powers[0],
                format!("the mean loss of motor 2 falls from {:.2} to {:.2} W", powers[0], powers[1]),
            ),
        ],
        ..Section::default()
    })
}
