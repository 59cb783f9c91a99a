//! Charts described as data and drawn as SVG or PNG, with the same bytes on every machine.
//!
//! PNG needs no system font: its letters are pre-rasterised (Noto Sans Mono). A letter that this font lacks, such as a
//! Greek one, is spelt out.
#![forbid(unsafe_code)]

mod canvas;
pub mod page;
mod svg;

pub use canvas::Canvas;
pub use svg::{ranges, svg, ticks};

use command::{Answer, Failure};
use plotters::coord::Shift;
use plotters::coord::types::RangedCoordf64;
use plotters::prelude::*;
use std::error::Error;
use std::fmt::Write as _;
use std::path::Path;

/// Colours of series by number. They also differ in lightness, so that they stay distinct in a grey print.
pub const COLOURS: [RGBColor; 8] = [
    RGBColor(31, 119, 180),
    RGBColor(214, 39, 40),
    RGBColor(44, 140, 60),
    RGBColor(255, 127, 14),
    RGBColor(120, 80, 160),
    RGBColor(110, 110, 110),
    RGBColor(23, 170, 190),
    RGBColor(0, 0, 0),
];

/// Index of grey in [`COLOURS`].
pub const GREY: usize = 5;
/// Index of black in [`COLOURS`].
pub const BLACK: usize = 7;

const FRAME: RGBColor = RGBColor(200, 200, 200);
const CAPTION_PX: u32 = 16;
const TITLE_PX: u32 = 20;

/// A titled grid of charts.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Picture {
    /// Title above the grid.
    pub title: String,
    /// Width and height, px.
    pub size: (u32, u32),
    /// Number of charts per row.
    pub columns: usize,
    /// The charts, row by row.
    pub charts: Vec<Chart>,
}

/// One chart.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Chart {
    /// Caption above the chart.
    pub caption: String,
    /// Horizontal axis.
    pub x: Axis,
    /// Vertical axis.
    pub y: Axis,
    /// Series, drawn in this order.
    pub series: Vec<Series>,
    /// Whether both axes have the same scale.
    pub equal_scale: bool,
    /// Corner of the legend, which lists the named series.
    pub legend: Legend,
}

/// An axis.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Axis {
    /// Quantity and unit.
    pub label: String,
    /// Limits; `None` derives them from the data.
    pub range: Option<[f64; 2]>,
    /// Labels that replace the numbers 0, 1, 2 ..; only in HTML pages.
    pub names: Vec<String>,
}

impl Axis {
    /// Creates an axis with limits from the data.
    pub fn auto(label: &str) -> Self {
        Self { label: label.to_owned(), ..Self::default() }
    }

    /// Creates an axis with fixed limits.
    pub fn fixed(label: &str, from: f64, to: f64) -> Self {
        Self { label: label.to_owned(), range: Some([from, to]), names: Vec::new() }
    }
}

/// Corner of the legend.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Legend {
    /// Upper right.
    #[default]
    UpperRight,
    /// Upper left.
    UpperLeft,
    /// Lower right.
    LowerRight,
    /// Lower left.
    LowerLeft,
}

/// Points drawn in one style.
#[derive(Debug, Clone, PartialEq)]
pub struct Series {
    /// Name in the legend; empty for no entry.
    pub name: String,
    /// Index in [`COLOURS`].
    pub colour: usize,
    /// Drawing style.
    pub style: SeriesStyle,
    /// x and y. A value that is not finite interrupts a line.
    pub points: Vec<[f64; 2]>,
}

/// Drawing style of a series.
#[derive(Debug, Clone, PartialEq)]
pub enum SeriesStyle {
    /// A line of this width, px.
    Line(u32),
    /// A dashed line.
    Dashed,
    /// A line with a disc at each point.
    Marked,
    /// Discs of this radius, px.
    Discs(u32),
    /// Bars from y = 0 of this width in units of x.
    Bars(f64),
    /// Rectangles of this size centred at the points, each in the colour of its value from 0 to 1 on the colour scale.
    Cells([f64; 2], Vec<f64>),
    /// Discs of this radius in px, each in the colour of its value from 0 to 1 on the colour scale.
    Scaled(u32, Vec<f64>),
    /// Area between the points and these values of y.
    Band(Vec<f64>),
    /// Filled rectangles; two points each, opposite corners.
    Blocks,
}

impl Series {
    /// Creates a line series of 2 px.
    pub fn line(name: &str, colour: usize, points: Vec<[f64; 2]>) -> Self {
        Self { name: name.to_owned(), colour, style: SeriesStyle::Line(2), points }
    }

    /// Returns the series with another style.
    #[must_use]
    pub fn with_style(self, style: SeriesStyle) -> Self {
        Self { style, ..self }
    }
}

/// Writes `stem`.svg and `stem`.png.
///
/// # Errors
/// The files cannot be written.
pub fn save(stem: &Path, picture: &Picture) -> Answer {
    save_svg(&stem.with_extension("svg"), picture)?;
    save_png(&stem.with_extension("png"), picture)
}

/// Writes an SVG file.
///
/// # Errors
/// The file cannot be written.
pub fn save_svg(path: &Path, picture: &Picture) -> Answer {
    let mut text = String::new();
    {
        let root = SVGBackend::with_string(&mut text, picture.size).into_drawing_area();
        draw(&root, picture).map_err(|error| cannot(path, &error))?;
    }
    std::fs::write(path, text).map_err(|error| cannot(path, &error))
}

/// Writes a PNG file.
///
/// # Errors
/// The file cannot be written.
pub fn save_png(path: &Path, picture: &Picture) -> Answer {
    let mut canvas = Canvas::new(picture.size);
    {
        let root = (&mut canvas).into_drawing_area();
        draw(&root, picture).map_err(|error| cannot(path, &error))?;
    }
    std::fs::write(path, canvas.png().map_err(|error| cannot(path, &error))?).map_err(|error| cannot(path, &error))
}

fn cannot(path: &Path, error: &dyn std::fmt::Display) -> Failure {
    Failure::NotNow(format!("the plot {} cannot be written: {error}", path.display()))
}

type DrawResult = Result<(), String>;

fn to_text(error: impl Error) -> String {
    error.to_string()
}

fn draw<B: DrawingBackend>(root: &DrawingArea<B, Shift>, picture: &Picture) -> DrawResult {
    root.fill(&WHITE).map_err(to_text)?;
    let body = if picture.title.is_empty() {
        root.clone()
    } else {
        root.titled(&picture.title, ("sans-serif", TITLE_PX)).map_err(to_text)?
    };
    let columns = picture.columns.max(1);
    let rows = picture.charts.len().div_ceil(columns).max(1);
    for (area, chart) in body.split_evenly((rows, columns)).iter().zip(&picture.charts) {
        draw_chart(area, chart)?;
    }
    root.present().map_err(to_text)
}

/// Returns the limits of an axis: the given ones, or those of the data with a margin.
fn axis_range(axis: &Axis, values: impl Iterator<Item = f64>) -> [f64; 2] {
    if let Some(range) = axis.range {
        return range;
    }
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    for value in values.filter(|value| value.is_finite()) {
        (low, high) = (low.min(value), high.max(value));
    }
    if low > high {
        return [0.0, 1.0];
    }
    // Charts of quantities that start at zero show the zero.
    if low >= 0.0 && low < 0.4 * high {
        return [0.0, high * 1.06];
    }
    let air = 0.05 * (high - low).max(1e-9 * high.abs()).max(1e-12);
    [low - air, high + air]
}

/// Extends the narrower of two ranges until both have the same scale on an area of this size in px.
pub fn equalise(x: &mut [f64; 2], y: &mut [f64; 2], (width, height): (u32, u32)) {
    let per_pixel = |range: &[f64; 2], pixels: u32| (range[1] - range[0]) / f64::from(pixels.max(1));
    let scale = per_pixel(x, width).max(per_pixel(y, height));
    for (range, pixels) in [(x, width), (y, height)] {
        let (middle, half) = (0.5 * (range[0] + range[1]), 0.5 * scale * f64::from(pixels));
        *range = [middle - half, middle + half];
    }
}

/// Formats a tick value with the fewest digits that distinguish it from its neighbours.
pub fn format_tick(value: f64) -> String {
    let rounded = (value * 1e6).round() / 1e6;
    if rounded == 0.0 { "0".to_owned() } else { format!("{rounded}") }
}

/// Returns the parts of a line inside the ranges. A line that leaves the chart is cut at its edge, not at a false
/// value.
fn clip_line(points: &[[f64; 2]], x: [f64; 2], y: [f64; 2]) -> Vec<Vec<(f64, f64)>> {
    let mut pieces: Vec<Vec<(f64, f64)>> = Vec::new();
    let mut open = false;
    for pair in points.windows(2) {
        let [a, b] = [pair[0], pair[1]];
        // Clipping by Liang and Barsky: the share of the segment that is inside.
        let (mut enter, mut leave) = (0.0f64, 1.0f64);
        let mut inside = a.iter().chain(&b).all(|value| value.is_finite());
        for (k, range) in [x, y].iter().enumerate() {
            let d = b[k] - a[k];
            if d == 0.0 {
                inside &= (range[0]..=range[1]).contains(&a[k]);
            } else {
                let (s, t) = ((range[0] - a[k]) / d, (range[1] - a[k]) / d);
                enter = enter.max(s.min(t));
                leave = leave.min(s.max(t));
            }
        }
        if !inside || enter > leave {
            open = false;
            continue;
        }
        let at = |share: f64| (a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1]));
        match pieces.last_mut() {
            Some(piece) if open && enter == 0.0 => piece.push(at(leave)),
            _ => pieces.push(vec![at(enter), at(leave)]),
        }
        open = leave == 1.0;
    }
    pieces
}

fn draw_chart<B: DrawingBackend>(area: &DrawingArea<B, Shift>, chart: &Chart) -> DrawResult {
    const X_LABELS_PX: u32 = 42;
    const Y_LABELS_PX: u32 = 62;
    const MARGIN_PX: u32 = 10;
    let all = || chart.series.iter().flat_map(|series| series.points.iter());
    let mut x = axis_range(&chart.x, all().map(|point| point[0]));
    let mut y = axis_range(&chart.y, all().map(|point| point[1]));
    if chart.equal_scale {
        let (width, height) = area.dim_in_pixel();
        let caption = if chart.caption.is_empty() { 0 } else { 2 * CAPTION_PX };
        let plane = (
            width.saturating_sub(Y_LABELS_PX + 2 * MARGIN_PX),
            height.saturating_sub(X_LABELS_PX + 2 * MARGIN_PX + caption),
        );
        equalise(&mut x, &mut y, plane);
    }
    let mut builder = ChartBuilder::on(area);
    builder.margin(MARGIN_PX).x_label_area_size(X_LABELS_PX).y_label_area_size(Y_LABELS_PX);
    if !chart.caption.is_empty() {
        builder.caption(&chart.caption, ("sans-serif", CAPTION_PX));
    }
    let mut plane = builder.build_cartesian_2d(x[0]..x[1], y[0]..y[1]).map_err(to_text)?;
    plane
        .configure_mesh()
        .light_line_style(TRANSPARENT)
        .bold_line_style(RGBColor(232, 232, 232))
        .axis_style(FRAME)
        .x_labels(9)
        .y_labels(8)
        .x_label_formatter(&|value| format_tick(*value))
        .y_label_formatter(&|value| format_tick(*value))
        .label_style(("sans-serif", CAPTION_PX))
        .x_desc(&chart.x.label)
        .y_desc(&chart.y.label)
        .draw()
        .map_err(to_text)?;
    for series in &chart.series {
        draw_series(&mut plane, series, x, y)?;
    }
    name_series(&plane.plotting_area().strip_coord_spec(), chart)
}

/// Draws one series inside the ranges of the axes.
fn draw_series<B: DrawingBackend>(
    plane: &mut ChartContext<'_, B, Cartesian2d<RangedCoordf64, RangedCoordf64>>,
    series: &Series,
    x: [f64; 2],
    y: [f64; 2],
) -> DrawResult {
    let colour = COLOURS[series.colour % COLOURS.len()];
    let line = |width: u32| colour.stroke_width(width);
    let shown = |p: &&[f64; 2]| (x[0]..=x[1]).contains(&p[0]) && (y[0]..=y[1]).contains(&p[1]);
    let pieces = || clip_line(&series.points, x, y);
    let discs = |radius: u32| {
        series.points.iter().filter(shown).map(move |p| Circle::new((p[0], p[1]), radius, colour.filled()))
    };
    match &series.style {
        SeriesStyle::Line(_) | SeriesStyle::Marked => {
            let width = if let SeriesStyle::Line(width) = series.style { width } else { 2 };
            for piece in pieces() {
                plane.draw_series(LineSeries::new(piece, line(width))).map_err(to_text)?;
            }
            if series.style == SeriesStyle::Marked {
                plane.draw_series(discs(3)).map_err(to_text)?;
            }
        }
        SeriesStyle::Dashed => {
            for piece in pieces() {
                plane.draw_series(DashedLineSeries::new(piece, 6, 4, line(2))).map_err(to_text)?;
            }
        }
        SeriesStyle::Discs(radius) => drop(plane.draw_series(discs(*radius)).map_err(to_text)?),
        SeriesStyle::Bars(width) => {
            let bars = series
                .points
                .iter()
                .filter(shown)
                .map(|p| Rectangle::new([(p[0] - 0.5 * width, 0.0), (p[0] + 0.5 * width, p[1])], colour.filled()));
            plane.draw_series(bars).map_err(to_text)?;
        }
        SeriesStyle::Cells([width, height], values) => {
            let cells = series.points.iter().zip(values).filter(|(p, _)| shown(p)).map(|(p, value)| {
                let (w, h) = (0.5 * width, 0.5 * height);
                Rectangle::new([(p[0] - w, p[1] - h), (p[0] + w, p[1] + h)], scale_colour(*value).filled())
            });
            plane.draw_series(cells).map_err(to_text)?;
        }
        SeriesStyle::Scaled(radius, values) => {
            let discs = series.points.iter().zip(values).filter(|(p, _)| shown(p));
            let discs = discs.map(|(p, value)| Circle::new((p[0], p[1]), *radius, scale_colour(*value).filled()));
            plane.draw_series(discs).map_err(to_text)?;
        }
        SeriesStyle::Band(high) => {
            let inside = |value: f64| value.clamp(y[0], y[1]);
            let known = |(p, high): &(&[f64; 2], &f64)| p[1].is_finite() && high.is_finite();
            let low = series.points.iter().zip(high).filter(known).map(|(p, _)| (p[0], inside(p[1])));
            let back = series.points.iter().zip(high).filter(known).map(|(p, high)| (p[0], inside(*high)));
            let outline: Vec<(f64, f64)> = low.chain(back.rev()).collect();
            plane.draw_series([Polygon::new(outline, colour.mix(0.25).filled())]).map_err(to_text)?;
        }
        SeriesStyle::Blocks => {
            let inside = |p: [f64; 2]| (p[0].clamp(x[0], x[1]), p[1].clamp(y[0], y[1]));
            let pairs = series.points.chunks_exact(2);
            let blocks = pairs.map(|pair| Rectangle::new([inside(pair[0]), inside(pair[1])], colour.filled()));
            plane.draw_series(blocks).map_err(to_text)?;
        }
    }
    Ok(())
}

/// Draws the legend.
fn name_series<B: DrawingBackend>(plane: &DrawingArea<B, Shift>, chart: &Chart) -> DrawResult {
    const ROW_PX: i32 = 20;
    const SAMPLE_PX: i32 = 24;
    const GAP_PX: i32 = 8;
    let named: Vec<&Series> = chart.series.iter().filter(|series| !series.name.is_empty()).collect();
    if named.is_empty() {
        return Ok(());
    }
    let style = ("sans-serif", CAPTION_PX).into_text_style(plane);
    let mut widest = 0;
    for series in &named {
        let (width, _) = plane.estimate_text_size(&series.name, &style).map_err(to_text)?;
        widest = widest.max(width as i32);
    }
    let (width, height) = (widest + SAMPLE_PX + 3 * GAP_PX, ROW_PX * named.len() as i32 + GAP_PX);
    let (w, h) = plane.dim_in_pixel();
    let (right, lower) = (w as i32 - width - GAP_PX, h as i32 - height - GAP_PX);
    let (left, top) = match chart.legend {
        Legend::UpperRight => (right, GAP_PX),
        Legend::UpperLeft => (GAP_PX, GAP_PX),
        Legend::LowerRight => (right, lower),
        Legend::LowerLeft => (GAP_PX, lower),
    };
    let frame = [(left, top), (left + width, top + height)];
    plane.draw(&Rectangle::new(frame, WHITE.mix(0.85).filled())).map_err(to_text)?;
    plane.draw(&Rectangle::new(frame, FRAME)).map_err(to_text)?;
    for (row, series) in named.iter().enumerate() {
        let colour = COLOURS[series.colour % COLOURS.len()];
        let (x, y) = (left + GAP_PX, top + GAP_PX / 2 + ROW_PX * row as i32 + ROW_PX / 2);
        let line =
            |from: i32, to: i32, width: u32| PathElement::new([(x + from, y), (x + to, y)], colour.stroke_width(width));
        let disc = |radius: u32| Circle::new((x + SAMPLE_PX / 2, y), radius, colour.filled());
        match series.style {
            SeriesStyle::Line(width) => plane.draw(&line(0, SAMPLE_PX, width)),
            SeriesStyle::Dashed => plane.draw(&line(0, 9, 2)).and_then(|()| plane.draw(&line(14, SAMPLE_PX, 2))),
            SeriesStyle::Marked => plane.draw(&line(0, SAMPLE_PX, 2)).and_then(|()| plane.draw(&disc(3))),
            SeriesStyle::Discs(radius) => plane.draw(&disc(radius)),
            SeriesStyle::Bars(_)
            | SeriesStyle::Cells(..)
            | SeriesStyle::Scaled(..)
            | SeriesStyle::Band(_)
            | SeriesStyle::Blocks => {
                plane.draw(&Rectangle::new([(x + 6, y - 6), (x + SAMPLE_PX - 6, y + 6)], colour.filled()))
            }
        }
        .map_err(to_text)?;
        let text = Text::new(series.name.as_str(), (x + SAMPLE_PX + GAP_PX, y - ROW_PX / 2 + 2), style.clone());
        plane.draw(&text).map_err(to_text)?;
    }
    Ok(())
}

/// Returns a colour of the scale from dark blue through green to yellow; lightness increases with the value.
pub fn scale_colour(value: f64) -> RGBColor {
    const STOPS: [[f64; 3]; 5] =
        [[68.0, 20.0, 95.0], [59.0, 82.0, 139.0], [33.0, 145.0, 140.0], [94.0, 201.0, 98.0], [253.0, 231.0, 37.0]];
    let at = value.clamp(0.0, 1.0) * (STOPS.len() - 1) as f64;
    let below = (at as usize).min(STOPS.len() - 2);
    let share = at - below as f64;
    let channel = |k: usize| (STOPS[below][k] * (1.0 - share) + STOPS[below + 1][k] * share).round() as u8;
    RGBColor(channel(0), channel(1), channel(2))
}

/// Returns the CSS colour of a series. Black becomes `currentColor`, the text colour of the page, which stays visible
/// in dark mode.
pub fn css_colour(number: usize) -> String {
    if number == BLACK {
        return "currentColor".to_owned();
    }
    let RGBColor(r, g, b) = COLOURS[number % COLOURS.len()];
    format!("#{r:02x}{g:02x}{b:02x}")
}

/// Escapes text for HTML and SVG.
pub fn escape(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    for letter in text.chars() {
        match letter {
            '&' => escaped.push_str("&amp;"),
            '<' => escaped.push_str("&lt;"),
            '>' => escaped.push_str("&gt;"),
            '"' => escaped.push_str("&quot;"),
            _ => {
                let _ = escaped.write_char(letter);
            }
        }
    }
    escaped
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, clippy::expect_used)]
    use super::*;

    fn picture() -> Picture {
        let wave: Vec<[f64; 2]> = (0..60).map(|i| [f64::from(i), 3.0 + libm::sin(f64::from(i) * 0.2)]).collect();
        let looks = [
            SeriesStyle::Line(2),
            SeriesStyle::Dashed,
            SeriesStyle::Marked,
            SeriesStyle::Discs(3),
            SeriesStyle::Bars(0.5),
        ];
        let mut series: Vec<Series> = looks
            .into_iter()
            .enumerate()
            .map(|(k, look)| {
                let shifted = wave.iter().map(|p| [p[0], p[1] + k as f64]).collect();
                Series::line(&format!("σ = {k}"), k, shifted).with_style(look)
            })
            .collect();
        series[0].points[30][1] = f64::NAN;
        let chart =
            Chart { caption: "a".into(), x: Axis::auto("x, m"), y: Axis::auto("µ²"), series, ..Chart::default() };
        Picture {
            title: "title".into(),
            size: (640, 320),
            columns: 2,
            charts: vec![chart.clone(), Chart { equal_scale: true, ..chart }],
        }
    }

    #[test]
    fn the_same_picture_gives_the_same_bytes() {
        let folder = tempfile::tempdir().unwrap();
        let read = |name: &str| std::fs::read(folder.path().join(name)).unwrap();
        for name in ["one", "two"] {
            save(&folder.path().join(name), &picture()).unwrap();
        }
        assert_eq!(read("one.svg"), read("two.svg"));
        assert_eq!(read("one.png"), read("two.png"));
        assert!(read("one.png").starts_with(b"\x89PNG"));
        assert!(String::from_utf8(read("one.svg")).unwrap().contains("µ²"));
    }

    #[test]
    fn the_same_scale_on_both_axes_keeps_the_middle() {
        let (mut x, mut y) = ([0.0, 2.0], [0.0, 1.0]);
        equalise(&mut x, &mut y, (100, 100));
        assert_eq!((x, y), ([0.0, 2.0], [-0.5, 1.5]));
    }

    #[test]
    fn a_line_is_cut_where_it_leaves_the_chart() {
        let points = [[0.0, 4.0], [1.0, 0.0], [2.0, 1.0], [f64::NAN, 0.0], [3.0, 1.0], [4.0, -1.0]];
        let pieces = clip_line(&points, [0.0, 10.0], [0.0, 2.0]);
        assert_eq!(pieces, [vec![(0.5, 2.0), (1.0, 0.0), (2.0, 1.0)], vec![(3.0, 1.0), (3.5, 0.0)]]);
    }

    #[test]
    fn a_missing_folder_is_named() {
        let error = save(Path::new("/proc/nowhere/x"), &picture()).unwrap_err().to_string();
        assert!(error.contains("/proc/nowhere/x.svg"), "{error}");
    }
}
