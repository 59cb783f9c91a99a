//! Charts of the flights.

use std::path::Path;

use command::Answer;
use plot::{Axis, COLOURS, Chart, Legend, Picture, Series, SeriesStyle};

use crate::fly::{Ended, Flown};
use crate::variants::Variant;

/// Size of the picture, px.
const SIZE: (u32, u32) = (1200, 900);
/// Flights with a curve and a name of their own; of more, the colours would repeat.
const CURVES: usize = COLOURS.len();

/// Draws distances over time of the first flights, and the RMS of all, into `sim.svg` and `sim.png`.
///
/// # Errors
/// A file cannot be written.
pub(crate) fn write(folder: &Path, rows: &[(&Variant, &Flown)]) -> Answer {
    plot::save(&folder.join("sim"), &picture(rows))
}

fn picture(rows: &[(&Variant, &Flown)]) -> Picture {
    let curves = |caption: &str, which: usize| Chart {
        caption: caption.to_owned(),
        x: Axis::auto("time, s"),
        y: Axis::auto("mm"),
        series: rows.iter().take(CURVES).enumerate().map(|(index, row)| curve(index, row, which)).collect(),
        legend: Legend::UpperRight,
        ..Chart::default()
    };
    let rms = |name: &str, colour: usize, offset: f64, value: fn(&lockstep::Flight) -> f64| {
        let points = rows.iter().filter_map(|(variant, flown)| match &flown.ended {
            Ended::Done(flight) => Some([variant.number as f64 + offset, value(flight) * 1e3]),
            Ended::Failed(_) => None,
        });
        Series { name: name.to_owned(), colour, style: SeriesStyle::Bars(0.4), points: points.collect() }
    };
    let bars = Chart {
        caption: "RMS of each flight".to_owned(),
        x: Axis::fixed("flight", 0.0, rows.len() as f64 + 1.0),
        y: Axis::auto("mm"),
        series: vec![
            rms("estimate to setpoint", 0, -0.2, |flight| flight.estimate.rms_m),
            rms("truth to setpoint", 1, 0.2, |flight| flight.truth.rms_m),
        ],
        legend: Legend::UpperRight,
        ..Chart::default()
    };
    let charts = vec![curves("Estimate to setpoint", 1), curves("Truth to setpoint", 2), bars];
    Picture { title: "Flights side by side".to_owned(), size: SIZE, columns: 1, charts }
}

fn curve(index: usize, (variant, flown): &(&Variant, &Flown), which: usize) -> Series {
    let points = flown.distances.iter().map(|point| [point[0], point[which] * 1e3]).collect();
    Series::line(&format!("{} {}", variant.number, variant.name()), index, points).with_style(SeriesStyle::Line(1))
}
