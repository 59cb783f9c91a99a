//! Renders a chart as an inline SVG element for a page: fine lines, fractional coordinates, and the font of the page.

use crate::colour::{css_colour, scale_colour};
use crate::picture::{Chart, Series, SeriesStyle};
use crate::scale::{axis_range, clip_line, equalise, format_tick};
use std::fmt::Write as _;

/// Left margin for the labels of the y axis, px.
const LEFT: f64 = 74.0;
/// Right margin, px.
const RIGHT: f64 = 14.0;
/// Top margin, px.
const TOP: f64 = 10.0;
/// Bottom margin for the labels of the x axis, px.
const BELOW: f64 = 44.0;
/// Minimum height of a visible band, px; its line covers a narrower one.
const BAND_PX: f64 = 1.2;
/// Minimum distance between drawn points, px.
const CLOSE_PX: f64 = 0.35;

/// Mapping from chart coordinates to pixels.
struct Plane {
    x: [f64; 2],
    y: [f64; 2],
    width: f64,
    height: f64,
}

impl Plane {
    fn x(&self, value: f64) -> f64 {
        LEFT + (value - self.x[0]) / (self.x[1] - self.x[0]) * self.width
    }

    fn y(&self, value: f64) -> f64 {
        TOP + (self.y[1] - value) / (self.y[1] - self.y[0]) * self.height
    }

    fn shows(&self, p: &[f64; 2]) -> bool {
        (self.x[0]..=self.x[1]).contains(&p[0]) && (self.y[0]..=self.y[1]).contains(&p[1])
    }
}

/// Returns the limits of both axes as drawn on an area of this size in px.
pub fn ranges(chart: &Chart, size: (u32, u32)) -> [[f64; 2]; 2] {
    let all = || chart.series.iter().flat_map(|series| series.points.iter());
    let high = || {
        chart.series.iter().flat_map(|series| match &series.style {
            SeriesStyle::Band(high) => high.as_slice(),
            _ => &[],
        })
    };
    let mut x = axis_range(&chart.x, all().map(|point| point[0]));
    let mut y = axis_range(&chart.y, all().map(|point| point[1]).chain(high().copied()));
    if chart.equal_scale {
        equalise(&mut x, &mut y, (size.0 - (LEFT + RIGHT) as u32, size.1 - (TOP + BELOW) as u32));
    }
    [x, y]
}

/// Renders the chart as an `<svg>` of this size in px, without its caption.
pub fn svg(chart: &Chart, size: (u32, u32)) -> String {
    let [x, y] = ranges(chart, size);
    let (width, height) = (f64::from(size.0), f64::from(size.1));
    let plane = Plane { x, y, width: width - LEFT - RIGHT, height: height - TOP - BELOW };
    let mut out = String::new();
    // Writing to a string cannot fail.
    let _ = write!(out, "<svg viewBox=\"0 0 {width} {height}\" role=\"img\">");
    grid(&mut out, &plane, chart);
    for series in &chart.series {
        draw(&mut out, &plane, series);
    }
    let _ = write!(
        out,
        "<rect class=\"frame\" x=\"{LEFT}\" y=\"{TOP}\" width=\"{:.1}\" height=\"{:.1}\"/></svg>",
        plane.width, plane.height
    );
    out
}

/// Returns round numbers within a range, about as many as requested.
pub fn ticks(range: [f64; 2], about: f64) -> Vec<f64> {
    let span = range[1] - range[0];
    if !(span.is_finite() && span > 0.0) {
        return Vec::new();
    }
    let rough = span / about;
    let power = libm::pow(10.0, libm::floor(libm::log10(rough)));
    let step = [1.0, 2.0, 5.0, 10.0].into_iter().map(|k| k * power).find(|step| *step >= rough).unwrap_or(rough);
    let first = (range[0] / step).ceil() as i64;
    (first..).map(|k| k as f64 * step).take_while(|value| *value <= range[1] + 1e-9 * span).take(50).collect()
}

/// The labels of an axis, each with its place.
fn labels(names: &[String], range: [f64; 2], about: f64) -> Vec<(f64, String)> {
    if names.is_empty() {
        return ticks(range, about).into_iter().map(|value| (value, format_tick(value))).collect();
    }
    let named = names.iter().enumerate().map(|(place, name)| (place as f64, name.clone()));
    named.filter(|(place, _)| (range[0]..=range[1]).contains(place)).collect()
}

fn grid(out: &mut String, plane: &Plane, chart: &Chart) {
    let (right, bottom) = (LEFT + plane.width, TOP + plane.height);
    for (value, text) in labels(&chart.x.names, plane.x, plane.width / 90.0) {
        let at = plane.x(value);
        let _ = write!(out, "<path class=\"grid\" d=\"M{at:.1} {TOP}V{bottom:.1}\"/>");
        let _ = write!(out, "<text x=\"{at:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{text}</text>", bottom + 16.0);
    }
    for (value, text) in labels(&chart.y.names, plane.y, plane.height / 36.0) {
        let at = plane.y(value);
        let _ = write!(out, "<path class=\"grid\" d=\"M{LEFT} {at:.1}H{right:.1}\"/>");
        let _ = write!(out, "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\">{text}</text>", LEFT - 6.0, at + 4.0);
    }
    let _ = write!(
        out,
        "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{}</text>",
        LEFT + 0.5 * plane.width,
        bottom + 36.0,
        super::escape(&chart.x.label)
    );
    let middle = TOP + 0.5 * plane.height;
    let _ = write!(
        out,
        "<text transform=\"translate(14 {middle:.1}) rotate(-90)\" text-anchor=\"middle\">{}</text>",
        super::escape(&chart.y.label)
    );
}

fn draw(out: &mut String, plane: &Plane, series: &Series) {
    let colour = css_colour(series.colour);
    let stroke = |width: f64, dash: &str| format!("fill=\"none\" stroke=\"{colour}\" stroke-width=\"{width}\"{dash}");
    match &series.style {
        // Background lines are wide and pale.
        SeriesStyle::Line(width @ 5..) => {
            lines(out, plane, series, &stroke(f64::from(*width), " stroke-opacity=\"0.35\""))
        }
        SeriesStyle::Line(width) => lines(out, plane, series, &stroke(0.75 * f64::from(*width), "")),
        SeriesStyle::Dashed => lines(out, plane, series, &stroke(1.2, " stroke-dasharray=\"5 4\"")),
        SeriesStyle::Marked => {
            lines(out, plane, series, &stroke(1.5, ""));
            discs(out, plane, series, 3, &colour);
        }
        SeriesStyle::Discs(radius) => discs(out, plane, series, *radius, &colour),
        SeriesStyle::Band(high) => band(out, plane, series, high, &colour),
        SeriesStyle::Bars(width) => {
            for p in series.points.iter().filter(|p| p[0].is_finite() && p[1].is_finite()) {
                rectangle(out, plane, [[p[0] - 0.5 * width, 0.0], [p[0] + 0.5 * width, p[1]]], &colour);
            }
        }
        SeriesStyle::Blocks => {
            series.points.chunks_exact(2).for_each(|pair| rectangle(out, plane, [pair[0], pair[1]], &colour))
        }
        SeriesStyle::Cells([width, height], values) => {
            // crispEdges avoids seams between adjacent cells.
            out.push_str("<g shape-rendering=\"crispEdges\">");
            for (p, value) in series.points.iter().zip(values) {
                let (w, h) = (0.5 * width, 0.5 * height);
                rectangle(out, plane, [[p[0] - w, p[1] - h], [p[0] + w, p[1] + h]], &hex(scale_colour(*value)));
            }
            out.push_str("</g>");
        }
        SeriesStyle::Scaled(radius, values) => {
            for (p, value) in series.points.iter().zip(values).filter(|(p, _)| plane.shows(p)) {
                let (x, y) = (plane.x(p[0]), plane.y(p[1]));
                let _ = write!(
                    out,
                    "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"{radius}\" fill=\"{}\"/>",
                    hex(scale_colour(*value))
                );
            }
        }
    }
}

fn hex(colour: plotters::style::RGBColor) -> String {
    format!("#{:02x}{:02x}{:02x}", colour.0, colour.1, colour.2)
}

fn lines(out: &mut String, plane: &Plane, series: &Series, style: &str) {
    let mut path = String::new();
    for piece in clip_line(&series.points, plane.x, plane.y) {
        let mut last = None;
        let end = piece.len() - 1;
        for (at, (x, y)) in piece.into_iter().map(|(x, y)| (plane.x(x), plane.y(y))).enumerate() {
            let close = last.is_some_and(|(lx, ly): (f64, f64)| (x - lx).abs().max((y - ly).abs()) < CLOSE_PX);
            if close && at != end {
                continue;
            }
            let _ = write!(path, "{}{x:.1} {y:.1}", if last.is_none() { "M" } else { "L" });
            last = Some((x, y));
        }
    }
    if !path.is_empty() {
        let _ = write!(out, "<path {style} stroke-linejoin=\"round\" d=\"{path}\"/>");
    }
}

/// Draws a filled band between each point and its other value, where it is high enough to be visible.
fn band(out: &mut String, plane: &Plane, series: &Series, high: &[f64], colour: &str) {
    let inside = |value: f64| plane.y(value).clamp(TOP, TOP + plane.height);
    let all: Vec<(f64, f64, f64)> =
        series.points.iter().zip(high).map(|(p, high)| (plane.x(p[0]), inside(p[1]), inside(*high))).collect();
    let mut path = String::new();
    let wide = |p: &(f64, f64, f64)| p.1 - p.2 > BAND_PX;
    for run in all.split(|p| !p.1.is_finite() || !p.2.is_finite()) {
        for part in run.chunk_by(|a, b| wide(a) == wide(b)).filter(|part| wide(&part[0])) {
            for (at, (x, low, _)) in part.iter().enumerate() {
                let _ = write!(path, "{}{x:.1} {low:.1}", if at == 0 { "M" } else { "L" });
            }
            if let [(x, low, high)] = part {
                // A single point becomes a band of one pixel.
                let _ = write!(path, "M{:.1} {low:.1}H{:.1}V{high:.1}H{:.1}Z", x - 0.5, x + 0.5, x - 0.5);
                continue;
            }
            for (x, _, high) in part.iter().rev() {
                let _ = write!(path, "L{x:.1} {high:.1}");
            }
            path.push('Z');
        }
    }
    if !path.is_empty() {
        let _ = write!(out, "<path fill=\"{colour}\" fill-opacity=\"0.25\" d=\"{path}\"/>");
    }
}

fn discs(out: &mut String, plane: &Plane, series: &Series, radius: u32, colour: &str) {
    for p in series.points.iter().filter(|p| plane.shows(p)) {
        let (x, y) = (plane.x(p[0]), plane.y(p[1]));
        let _ = write!(out, "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"{radius}\" fill=\"{colour}\"/>");
    }
}

/// Draws the visible part of the rectangle with these opposite corners.
fn rectangle(out: &mut String, plane: &Plane, [a, b]: [[f64; 2]; 2], colour: &str) {
    let clamp = |value: f64, range: [f64; 2]| value.clamp(range[0], range[1]);
    let (x0, x1) = (plane.x(clamp(a[0].min(b[0]), plane.x)), plane.x(clamp(a[0].max(b[0]), plane.x)));
    let (y0, y1) = (plane.y(clamp(a[1].max(b[1]), plane.y)), plane.y(clamp(a[1].min(b[1]), plane.y)));
    if x1 > x0 && y1 > y0 {
        // A rectangle narrower than a pixel stays visible.
        let width = (x1 - x0).max(0.8);
        let _ = write!(
            out,
            "<rect x=\"{x0:.1}\" y=\"{y0:.1}\" width=\"{width:.1}\" height=\"{:.1}\" fill=\"{colour}\"/>",
            y1 - y0
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Axis;

    #[test]
    fn ticks_are_round_and_within_the_range() {
        assert_eq!(ticks([0.0, 10.0], 5.0), [0.0, 2.0, 4.0, 6.0, 8.0, 10.0]);
        assert_eq!(ticks([-0.3, 0.3], 3.0), [-0.2, 0.0, 0.2]);
        assert!(ticks([1.0, 1.0], 5.0).is_empty() && ticks([f64::NAN, 1.0], 5.0).is_empty());
    }

    #[test]
    fn bands_lines_and_blocks_stay_on_the_plane() {
        let points: Vec<[f64; 2]> = (0..50).map(|i| [f64::from(i), f64::from(i % 7)]).collect();
        let high = points.iter().map(|p| p[1] + 3.0).collect();
        let chart = Chart {
            x: Axis::fixed("time, s", 5.0, 20.0),
            y: Axis::fixed("µ & σ", 1.0, 5.0),
            series: vec![
                Series::line("", 0, points.clone()).with_style(SeriesStyle::Band(high)),
                Series::line("", 1, points.clone()),
                Series::line("", 2, vec![[0.0, 0.0], [50.0, 2.0]]).with_style(SeriesStyle::Blocks),
                Series::line("", 3, points).with_style(SeriesStyle::Scaled(2, vec![0.5; 50])),
            ],
            ..Chart::default()
        };
        let text = svg(&chart, (400, 200));
        assert!(text.starts_with("<svg") && text.ends_with("</svg>") && text.contains("µ &amp; σ"));
        let mut seen = 0;
        for path in text.split(" d=\"").skip(1).map(|part| part.split('"').next().unwrap_or("")) {
            for pair in path.split(['M', 'L', 'Z']).filter(|pair| pair.contains(' ') && !pair.contains(['H', 'V'])) {
                let (x, y) = pair.split_once(' ').unwrap();
                let (x, y): (f64, f64) = (x.parse().unwrap(), y.parse().unwrap());
                assert!((TOP - 0.1..=200.0 - BELOW + 0.1).contains(&y), "{pair}");
                assert!(x >= LEFT - 300.0);
                seen += 1;
            }
        }
        assert!(seen > 40, "{seen}");
        assert!(!text.contains("NaN") && !text.contains("inf"));
    }
}
