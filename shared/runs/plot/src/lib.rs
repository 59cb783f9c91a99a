//! Charts described as data and drawn as SVG or PNG, with the same bytes on every machine.
//!
//! PNG needs no system font: its letters are pre-rasterised (Noto Sans Mono). A letter that this font lacks, such as a
//! Greek one, is spelt out.
#![forbid(unsafe_code)]

mod canvas;
mod colour;
mod draw;
pub mod page;
mod picture;
mod scale;
mod svg;

pub use canvas::Canvas;
pub use colour::{BLACK, COLOURS, GREY, css_colour, scale_colour};
pub use picture::{Axis, Chart, Legend, Picture, Series, SeriesStyle};
pub use scale::{equalise, format_tick};
pub use svg::{ranges, svg, ticks};

use command::{Answer, Failure};
use plotters::prelude::*;
use std::fmt::Write as _;
use std::path::Path;

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
        draw::draw(&root, picture).map_err(|error| cannot(path, &error))?;
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
        draw::draw(&root, picture).map_err(|error| cannot(path, &error))?;
    }
    std::fs::write(path, canvas.png().map_err(|error| cannot(path, &error))?).map_err(|error| cannot(path, &error))
}

fn cannot(path: &Path, error: &dyn std::fmt::Display) -> Failure {
    Failure::NotNow(format!("the plot {} cannot be written: {error}", path.display()))
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
    fn a_missing_folder_is_named() {
        let error = save(Path::new("/proc/nowhere/x"), &picture()).unwrap_err().to_string();
        assert!(error.contains("/proc/nowhere/x.svg"), "{error}");
    }
}
