//! Improvement: calibration points at the corners.

use super::super::calibration::{Encoders, SIGMA_RANGE_M, calibrate, errors, random_points, survey};
use super::super::random::Random;
use super::super::section::{Check, Effort, Section, Table, fixed, mean};
use super::super::stand_in;
use super::{format_ratio, ratio_range};
use anyhow::Result;
use calibration::placement::corners;
use plot::{Axis, Chart, Picture, Series, SeriesStyle};

/// Standard deviation of a length, m.
const SIGMA_LENGTH_M: f64 = 0.02;

/// Compares points at the corners with random points.
pub fn placement(effort: Effort) -> Result<Section> {
    let trials = effort.trials(3000);
    let counts = effort.select(&[3, 6, 9, 18, 20]);
    let mut table = Table::new("Mean error of the heights, mm", &["M", "random", "at the corners", "ratio"]);
    let mut curves = [Vec::new(), Vec::new()];
    let mut ratios = Vec::new();
    for count in &counts {
        let (count, seed) = (*count, 1000 + *count as u64);
        let spread = mean_height_error(seed, trials, &|random| random_points(random, count))?;
        let cornered =
            mean_height_error(seed + 100, trials, &|_| corners(&stand_in::three_cable_anchors_xy(), count, 0.9))?;
        curves[0].push([count as f64, 1e3 * spread]);
        curves[1].push([count as f64, 1e3 * cornered]);
        if count > 3 {
            ratios.push(spread / cornered);
        }
        table.row([
            count.to_string(),
            fixed(1e3 * spread, 1),
            fixed(1e3 * cornered, 1),
            format_ratio(spread / cornered),
        ]);
    }
    let (three_cornered, twenty_spread) = (curves[1][0][1], curves[0][curves[0].len() - 1][1]);
    let chart = Chart {
        caption: "mean error of the heights".into(),
        x: Axis::auto("number of points M"),
        y: Axis::fixed("mm", 0.0, 60.0),
        series: curves
            .into_iter()
            .zip(["random", "at the corners"])
            .enumerate()
            .map(|(k, (points, name))| Series::line(name, 1 - k, points).with_style(SeriesStyle::Marked))
            .collect(),
        ..Chart::default()
    };
    Ok(Section {
        key: "placement",
        title: "Improvement: calibration points at the corners",
        claim: "Any point of the floor is a valid calibration point, but points near the corners of the triangle of the anchors are \
                much more informative. They take no extra effort, because their positions need not be measured."
            .into(),
        stand_in: format!(
            "Simulated: {}; ranges and lengths with a standard deviation of 0.02 m; {trials} calibrations per value. Corners: at \
             0.9 of the way to each anchor in turn, later rounds a little nearer.",
            stand_in::THREE
        ),
        tables: vec![table],
        pictures: vec![Picture { title: String::new(), size: (760, 400), columns: 1, charts: vec![chart] }],
        checks: vec![
            Check::claim(
                ratios.iter().all(|ratio| *ratio > 1.5),
                format!("with six points or more the error is {} smaller (with three, the mean error of random points has a heavy tail)", ratio_range(&ratios)),
            ),
            Check::claim(
                three_cornered < 1.1 * twenty_spread,
                format!("three points at the corners ({three_cornered:.1} mm) are as good as {} random ones ({twenty_spread:.1} mm)", counts[counts.len() - 1]),
            ),
        ],
        ratio: Some(ratio_range(&ratios)),
        ..Section::default()
    })
}

/// Returns the mean error of the heights over many calibrations with points at these places, m.
fn mean_height_error(seed: u64, trials: usize, places: &dyn Fn(&mut Random) -> Vec<[f64; 2]>) -> Result<f64> {
    let mut random = Random::new(seed);
    let mut all = Vec::new();
    for _ in 0..trials {
        let anchors = survey(&mut random, SIGMA_RANGE_M)?;
        let points = places(&mut random);
        let lengths = Encoders::noisy(SIGMA_LENGTH_M).measure(&mut random, &points);
        all.push(errors(&calibrate(&anchors, &lengths)?.0)[0]);
    }
    Ok(mean(&all))
}
