//! Draws charts on any backend.

use plotters::coord::Shift;
use plotters::coord::types::RangedCoordf64;
use plotters::prelude::*;
use std::error::Error;

use crate::colour::{COLOURS, scale_colour};
use crate::picture::{Chart, Legend, Picture, Series, SeriesStyle};
use crate::scale::{axis_range, clip_line, equalise, format_tick};

const FRAME: RGBColor = RGBColor(200, 200, 200);
const CAPTION_PX: u32 = 16;
const TITLE_PX: u32 = 20;

/// `Err`: what the backend could not draw.
pub(crate) type DrawResult = Result<(), String>;

pub(crate) fn to_text(error: impl Error) -> String {
    error.to_string()
}

/// Draws a picture.
pub(crate) fn draw<B: DrawingBackend>(root: &DrawingArea<B, Shift>, picture: &Picture) -> DrawResult {
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
