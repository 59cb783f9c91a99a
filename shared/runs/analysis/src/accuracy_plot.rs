//! Plot of a run: the path from above and from the side, and the tracking error over time.

use crate::accuracy::{Analysis, TrackPoint};
use crate::colours;
use command::{Answer, Failure};
use plot::COLOURS;
use plotters::coord::Shift;
use plotters::coord::types::RangedCoordf64;
use plotters::prelude::*;
use std::error::Error;
use std::path::Path;

const SIZE: (u32, u32) = (1000, 700);
/// Maximum number of points; more points than pixels only enlarge the file.
const POINTS: usize = 800;
/// As on the report's page.
const PLANNED: RGBColor = COLOURS[colours::SETPOINT];
const ESTIMATE: RGBColor = COLOURS[colours::ESTIMATE];
const TRUTH: RGBColor = COLOURS[colours::TRUTH];

type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;
type Position = cable_robot::Vector3<f64>;
type DrawResult = Result<(), Box<dyn Error>>;

/// Draws the run to an SVG file.
///
/// # Errors
/// The file cannot be written.
pub fn draw(path: &Path, analysis: &Analysis, title: &str) -> Answer {
    let failed =
        |error: Box<dyn Error>| Failure::NotNow(format!("the plot {} cannot be drawn: {error}", path.display()));
    let step = analysis.track.len().div_ceil(POINTS).max(1);
    let track: Vec<TrackPoint> = analysis.track.iter().step_by(step).copied().collect();
    let root = SVGBackend::new(path, SIZE).into_drawing_area();
    draw_all(&root, &track, title).map_err(failed)
}

fn draw_all(root: &Area<'_>, track: &[TrackPoint], title: &str) -> DrawResult {
    root.fill(&WHITE)?;
    let root = root.titled(title, ("sans-serif", 20))?;
    let (upper, lower) = root.split_vertically(430);
    let (left, right) = upper.split_horizontally(500);
    view(&left, track, "from above", "x, m", "y, m", |p| (p.x, p.y))?;
    view(&right, track, "from the side", "x, m", "z, m", |p| (p.x, p.z))?;
    errors(&lower, track)?;
    root.present()?;
    Ok(())
}

fn view(
    area: &Area<'_>,
    track: &[TrackPoint],
    caption: &str,
    x: &str,
    y: &str,
    project: impl Fn(&Position) -> (f64, f64),
) -> DrawResult {
    let points = || track.iter().flat_map(|point| [point.setpoint, point.estimate].into_iter().chain(point.truth));
    let bound = |pick: fn((f64, f64)) -> f64, from: f64, take: fn(f64, f64) -> f64| {
        points().map(|p| pick(project(&p))).fold(from, take)
    };
    let (mut x0, mut x1) = (bound(|p| p.0, f64::INFINITY, f64::min), bound(|p| p.0, f64::NEG_INFINITY, f64::max));
    let (mut y0, mut y1) = (bound(|p| p.1, f64::INFINITY, f64::min), bound(|p| p.1, f64::NEG_INFINITY, f64::max));
    // The same scale on both axes keeps circles round.
    let half = 0.55 * (x1 - x0).max((y1 - y0) * 1.25).max(0.1);
    let (mid_x, mid_y) = ((x0 + x1) / 2.0, (y0 + y1) / 2.0);
    (x0, x1, y0, y1) = (mid_x - half, mid_x + half, mid_y - half / 1.25, mid_y + half / 1.25);
    let mut chart = ChartBuilder::on(area)
        .caption(caption, ("sans-serif", 15))
        .margin(10)
        .x_label_area_size(35)
        .y_label_area_size(45)
        .build_cartesian_2d(x0..x1, y0..y1)?;
    chart.configure_mesh().light_line_style(WHITE).x_desc(x).y_desc(y).draw()?;
    let curves = [
        ("setpoint", PLANNED, 5, track.iter().map(|p| project(&p.setpoint)).collect::<Vec<_>>()),
        ("truth", TRUTH, 2, track.iter().filter_map(|p| p.truth).map(|p| project(&p)).collect()),
        ("estimate", ESTIMATE, 1, track.iter().map(|p| project(&p.estimate)).collect()),
    ];
    for (name, colour, width, points) in curves.into_iter().filter(|(_, _, _, points)| !points.is_empty()) {
        let style = colour.stroke_width(width);
        chart
            .draw_series(LineSeries::new(points, style))?
            .label(name)
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 20, y)], style));
    }
    // Both views have the same curves, and one legend is enough.
    if y == "y, m" { legend(&mut chart, SeriesLabelPosition::UpperRight) } else { Ok(()) }
}

fn errors(area: &Area<'_>, track: &[TrackPoint]) -> DrawResult {
    let off = |a: &Position, b: &Position| 1000.0 * (a - b).norm();
    let estimate: Vec<(f64, f64)> = track.iter().map(|p| (p.time_s, off(&p.estimate, &p.setpoint))).collect();
    let truth: Vec<(f64, f64)> = track.iter().filter_map(|p| Some((p.time_s, 1000.0 * p.truth_off_m?))).collect();
    let top = estimate.iter().chain(&truth).map(|(_, error)| *error).fold(1.0, f64::max) * 1.4;
    let end = track.last().map_or(1.0, |p| p.time_s).max(0.1);
    let mut chart = ChartBuilder::on(area)
        .caption("distance from the setpoint while it moves", ("sans-serif", 15))
        .margin(10)
        .x_label_area_size(35)
        .y_label_area_size(45)
        .build_cartesian_2d(0.0..end, 0.0..top)?;
    chart.configure_mesh().light_line_style(WHITE).x_desc("time, s").y_desc("mm").draw()?;
    chart
        .draw_series(LineSeries::new(truth, &TRUTH))?
        .label("truth")
        .legend(|(x, y)| PathElement::new([(x, y), (x + 20, y)], TRUTH));
    chart
        .draw_series(LineSeries::new(estimate, &ESTIMATE))?
        .label("estimate")
        .legend(|(x, y)| PathElement::new([(x, y), (x + 20, y)], ESTIMATE));
    legend(&mut chart, SeriesLabelPosition::UpperMiddle)
}

fn legend<'a, 'b: 'a>(
    chart: &mut ChartContext<'a, SVGBackend<'b>, Cartesian2d<RangedCoordf64, RangedCoordf64>>,
    position: SeriesLabelPosition,
) -> DrawResult {
    chart.configure_series_labels().position(position).background_style(WHITE).border_style(PLANNED).draw()?;
    Ok(())
}
