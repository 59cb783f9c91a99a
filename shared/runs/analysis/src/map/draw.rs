//! Draws a map: filled cells, contour lines, the flown path, and a labelled colour bar.

use crate::map::contour::numbers as numbers_of;
use crate::map::{contours, levels};
use command::{Answer, Failure};
use plot::{Canvas, equalise, format_tick, scale_colour};
use plotters::coord::Shift;
use plotters::prelude::*;
use std::path::Path;

/// Approximate width of the map area, px.
const PLANE_PX: f64 = 760.0;
/// Least and greatest height of the map area, px.
const HEIGHTS_PX: [f64; 2] = [320.0, 900.0];
/// Margin for the labels of the axes, px.
const LABELS_PX: u32 = 56;
/// Width of the colour bar with its labels, px.
const BAR_PX: u32 = 150;
const MARGIN_PX: u32 = 12;
const TITLE_PX: u32 = 20;
const TEXT_PX: u32 = 16;
/// Number of distinct colours; adjacent cells of the same colour are merged into one rectangle.
const SHADES: f64 = 96.0;

const NOWHERE: RGBColor = RGBColor(244, 244, 244);
const FRAME: RGBColor = RGBColor(120, 120, 120);
const CONTOUR: RGBColor = RGBColor(20, 20, 25);
const PATH: RGBColor = RGBColor(255, 255, 255);

/// Data of a map plot.
pub(super) struct Plot<'a> {
    /// Title.
    pub title: String,
    /// Label of the colour bar: quantity and unit.
    pub label: String,
    /// Names of the axes.
    pub axes: [&'a str; 2],
    /// Low corner, m.
    pub origin_m: [f64; 2],
    /// Side of a cell, m.
    pub cell_m: f64,
    pub columns: usize,
    pub rows: usize,
    /// Values row by row, lowest row first.
    pub values: Vec<Option<f64>>,
    /// Flown path, m.
    pub path: Vec<[f64; 2]>,
    /// Whether the colour scale starts at zero.
    pub from_zero: bool,
}

impl Plot<'_> {
    fn value(&self, column: usize, row: usize) -> Option<f64> {
        *self.values.get(row * self.columns + column)?
    }

    /// Returns the lowest and highest value.
    fn range(&self) -> [f64; 2] {
        let known = || self.values.iter().flatten();
        let low = if self.from_zero { 0.0 } else { known().copied().fold(f64::INFINITY, f64::min) };
        let high = known().copied().fold(f64::NEG_INFINITY, f64::max);
        if low > high || !(high - low).is_finite() {
            return [0.0, 1.0];
        }
        // A constant field gets a single colour.
        let least = 1e-9 * high.abs().max(1e-9);
        if high - low < least { [low - least, high + least] } else { [low, high] }
    }

    fn size(&self) -> (u32, u32) {
        let height = PLANE_PX * self.rows as f64 / self.columns as f64;
        let height = height.clamp(HEIGHTS_PX[0], HEIGHTS_PX[1]) as u32;
        (PLANE_PX as u32 + LABELS_PX + BAR_PX + 2 * MARGIN_PX, height + LABELS_PX + 2 * TITLE_PX + 2 * MARGIN_PX)
    }

    /// Returns the shade of a value in this range, 0 to 1.
    fn shade([low, high]: [f64; 2], value: f64) -> f64 {
        ((value - low) / (high - low) * SHADES).round() / SHADES
    }
}

/// Writes `stem`.png and `stem`.svg.
pub(super) fn save(stem: &Path, plot: &Plot<'_>) -> Answer<[std::path::PathBuf; 2]> {
    let write_failure = |path: &Path, error: &dyn std::fmt::Display| {
        Failure::NotNow(format!("the plot {} cannot be written: {error}", path.display()))
    };
    let with = |ending: &str| {
        let mut name = stem.as_os_str().to_owned();
        name.push(ending);
        std::path::PathBuf::from(name)
    };
    let (png, svg) = (with(".png"), with(".svg"));
    let mut canvas = Canvas::new(plot.size());
    draw(&(&mut canvas).into_drawing_area(), plot).map_err(|error| write_failure(&png, &error))?;
    let bytes = canvas.png().map_err(|error| write_failure(&png, &error))?;
    std::fs::write(&png, bytes).map_err(|error| write_failure(&png, &error))?;
    let mut text = String::new();
    draw(&SVGBackend::with_string(&mut text, plot.size()).into_drawing_area(), plot)
        .map_err(|error| write_failure(&svg, &error))?;
    std::fs::write(&svg, text).map_err(|error| write_failure(&svg, &error))?;
    Ok([png, svg])
}

fn words(error: impl std::error::Error) -> String {
    error.to_string()
}

fn draw<B: DrawingBackend>(root: &DrawingArea<B, Shift>, plot: &Plot<'_>) -> Result<(), String> {
    root.fill(&WHITE).map_err(words)?;
    let body = root.titled(&plot.title, ("sans-serif", TITLE_PX)).map_err(words)?;
    let (width, _) = body.dim_in_pixel();
    let (left, right) = body.split_horizontally(width.saturating_sub(BAR_PX));
    plane(&left, plot)?;
    bar(&right, plot)?;
    root.present().map_err(words)
}

fn plane<B: DrawingBackend>(area: &DrawingArea<B, Shift>, plot: &Plot<'_>) -> Result<(), String> {
    let [x0, y0] = plot.origin_m;
    let end = |from: f64, count: usize| from + count as f64 * plot.cell_m;
    let (mut x, mut y) = ([x0, end(x0, plot.columns)], [y0, end(y0, plot.rows)]);
    let (width, height) = area.dim_in_pixel();
    let around = LABELS_PX + 2 * MARGIN_PX;
    equalise(&mut x, &mut y, (width.saturating_sub(around), height.saturating_sub(around)));
    let mut plane = ChartBuilder::on(area)
        .margin(MARGIN_PX)
        .x_label_area_size(LABELS_PX)
        .y_label_area_size(LABELS_PX)
        .build_cartesian_2d(x[0]..x[1], y[0]..y[1])
        .map_err(words)?;
    plane.plotting_area().fill(&NOWHERE).map_err(words)?;
    let range = plot.range();
    for row in 0..plot.rows {
        let (bottom, top) = (end(y0, row), end(y0, row + 1));
        let mut column = 0;
        while column < plot.columns {
            let Some(shade) = plot.value(column, row).map(|value| Plot::shade(range, value)) else {
                column += 1;
                continue;
            };
            let first = column;
            while column < plot.columns && plot.value(column, row).map(|value| Plot::shade(range, value)) == Some(shade)
            {
                column += 1;
            }
            let corners = [(end(x0, first), top), (end(x0, column), bottom)];
            plane.draw_series([Rectangle::new(corners, scale_colour(shade).filled())]).map_err(words)?;
        }
    }
    let at = |[column, row]: [f64; 2]| (x0 + (column + 0.5) * plot.cell_m, y0 + (row + 0.5) * plot.cell_m);
    for level in levels(range) {
        let lines = contours(&|column, row| plot.value(column, row), plot.columns, plot.rows, level);
        let lines = lines.into_iter().map(|[a, b]| PathElement::new([at(a), at(b)], CONTOUR.mix(0.75).stroke_width(1)));
        plane.draw_series(lines).map_err(words)?;
    }
    let path = plot.path.iter().map(|point| (point[0], point[1]));
    plane.draw_series(LineSeries::new(path, PATH.mix(0.45).stroke_width(1))).map_err(words)?;
    plane
        .configure_mesh()
        .disable_mesh()
        .axis_style(FRAME)
        .x_labels(9)
        .y_labels(8)
        .x_label_formatter(&|value| format_tick(*value))
        .y_label_formatter(&|value| format_tick(*value))
        .label_style(("sans-serif", TEXT_PX))
        .x_desc(format!("{}, m", plot.axes[0]))
        .y_desc(format!("{}, m", plot.axes[1]))
        .draw()
        .map_err(words)
}

fn bar<B: DrawingBackend>(area: &DrawingArea<B, Shift>, plot: &Plot<'_>) -> Result<(), String> {
    let range @ [low, high] = plot.range();
    let numbers = BAR_PX - 44 - MARGIN_PX;
    let mut bar = ChartBuilder::on(area)
        .margin(MARGIN_PX)
        .margin_bottom(MARGIN_PX + LABELS_PX)
        .right_y_label_area_size(numbers)
        .build_cartesian_2d(0.0..1.0, low..high)
        .map_err(words)?;
    let steps = SHADES as usize;
    let value = |step: usize| low + (high - low) * step as f64 / steps as f64;
    let steps_of_colour = (0..steps).map(|step| {
        let shade = Plot::shade(range, 0.5 * (value(step) + value(step + 1)));
        Rectangle::new([(0.0, value(step + 1)), (1.0, value(step))], scale_colour(shade).filled())
    });
    bar.draw_series(steps_of_colour).map_err(words)?;
    for level in levels(range) {
        let line = PathElement::new([(0.0, level), (1.0, level)], CONTOUR.mix(0.75).stroke_width(1));
        bar.draw_series([line]).map_err(words)?;
    }
    let style = ("sans-serif", TEXT_PX).into_text_style(area);
    let (_, height) = area.dim_in_pixel();
    let tall = f64::from(height.saturating_sub(2 * MARGIN_PX + LABELS_PX));
    let (left, middle) = ((BAR_PX - numbers) as i32, f64::from(MARGIN_PX));
    for level in numbers_of(range) {
        let y = middle + tall * (high - level) / (high - low);
        let text = Text::new(format_tick(level), (left, y as i32 - TEXT_PX as i32 / 2), style.clone());
        area.draw(&text).map_err(words)?;
    }
    let (wide, _) = area.estimate_text_size(&plot.label, &style).map_err(words)?;
    let place = ((BAR_PX as i32 - wide as i32 - 4).max(0), height as i32 - LABELS_PX as i32 + 4);
    area.draw(&Text::new(plot.label.as_str(), place, style)).map_err(words)
}
