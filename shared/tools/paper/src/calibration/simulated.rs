//! Figures 3 and 4: simulated errors of the heights.

use super::super::random::Random;
use super::super::section::{Check, Effort, Section, Table, fixed, mean, median};
use super::super::stand_in;
use super::{Encoders, SIGMA_RANGE_M, calibrate, errors, random_points, scaled, survey};
use anyhow::Result;
use calibration::gps_anchor;
use plot::{Axis, Chart, GREY, Picture, Series, SeriesStyle};

/// Statistics of many simulated calibrations.
#[derive(Debug, Clone, Copy)]
struct TrialStatistics {
    /// Mean error of heights, m.
    mean_z: f64,
    /// Median error of heights, m.
    median_z: f64,
    /// Mean position error of an anchor, m.
    mean_3d: f64,
    /// Share of trials with a negative squared height.
    unreal: f64,
}

fn simulate(seed: u64, trials: usize, points: usize, sigma_length: f64) -> Result<TrialStatistics> {
    let mut random = Random::new(seed);
    let (mut z, mut full, mut unreal) = (Vec::new(), Vec::new(), 0);
    for _ in 0..trials {
        let anchors = survey(&mut random, SIGMA_RANGE_M)?;
        let places = random_points(&mut random, points);
        let lengths = Encoders::noisy(sigma_length).measure(&mut random, &places);
        let (found, clamped) = calibrate(&anchors, &lengths)?;
        let [ez, e3] = errors(&found);
        z.push(ez);
        full.push(e3);
        unreal += usize::from(clamped);
    }
    Ok(TrialStatistics {
        mean_z: mean(&z),
        median_z: median(&z),
        mean_3d: mean(&full),
        unreal: unreal as f64 / trials as f64,
    })
}

const SIGMAS_M: [f64; 5] = [0.02, 0.05, 0.10, 0.15, 0.20];

fn stand_in_words() -> String {
    format!(
        "Simulated: {}; ranges with a standard deviation of 0.02 m as in the text, random points in the triangle of the \
         anchors shrunk to 0.9.",
        stand_in::THREE
    )
}

/// Figure 3: error over the number of points.
pub fn fig3(effort: Effort) -> Result<Section> {
    let counts = effort.select(&[3, 4, 5, 6, 8, 10, 15, 20]);
    let trials = effort.trials(4000);
    let mut table = Table::new("Mean error of the heights, m (median where the mean is heavy-tailed)", &["M"]);
    table.head.extend(SIGMAS_M.map(|sigma| format!("sigma_L = {sigma:.2} m")));
    let mut cells = Vec::new();
    for count in &counts {
        let row: Vec<TrialStatistics> = SIGMAS_M
            .iter()
            .enumerate()
            .map(|(k, sigma)| simulate(300 + 10 * *count as u64 + k as u64, trials, *count, *sigma))
            .collect::<Result<_>>()?;
        table.row(std::iter::once(count.to_string()).chain(row.iter().map(|cell| {
            let mean = fixed(cell.mean_z, 4);
            if *count < 5 { format!("{mean} ({})", fixed(cell.median_z, 4)) } else { mean }
        })));
        cells.push(row);
    }
    let series = SIGMAS_M.iter().enumerate().rev().map(|(k, sigma)| {
        let points = counts.iter().zip(&cells).map(|(count, row)| [*count as f64, row[k].mean_z]).collect();
        Series::line(&format!("σ_L = {sigma:.2} m"), k, points).with_style(SeriesStyle::Marked)
    });
    let chart = Chart {
        caption: "mean error of the heights".into(),
        x: Axis::auto("number of points M"),
        y: Axis::fixed("m", 0.0, 1.3),
        series: series.collect(),
        ..Chart::default()
    };
    // Medians, because a few trials dominate the means of three and four points.
    let falling =
        (0..SIGMAS_M.len()).all(|k| cells.windows(2).all(|pair| pair[1][k].median_z < pair[0][k].median_z * 1.02));
    let last = &cells[cells.len() - 1];
    let (low, high) = (&last[0], &last[SIGMAS_M.len() - 1]);
    let growth = high.mean_z / low.mean_z;
    let unreal = [cells[0][4].unreal, last[4].unreal];
    Ok(Section {
        key: "fig3",
        title: "Figure 3: error of the calibration over the number of points",
        claim: "The mean error falls with the number of points and grows with the noise of the lengths.".into(),
        stand_in: format!("{} {trials} calibrations per value.", stand_in_words()),
        tables: vec![table],
        pictures: vec![Picture { title: String::new(), size: (820, 480), columns: 1, charts: vec![chart] }],
        checks: vec![
            Check::claim(falling, "more points always give a smaller (median) error".into()),
            Check::claim(
                growth > 3.0,
                format!(
                    "with {} points ten times the noise gives {growth:.1} times the error, from {:.3} to {:.3} m; the rest \
                     comes from the ranges",
                    counts[counts.len() - 1],
                    low.mean_z,
                    high.mean_z
                ),
            ),
        ],
        remarks: vec![format!(
            "With the strongest noise {:.0} % of the calibrations from {} points have a negative squared height, which the \
             absolute value in (5) would hide; from {} points it is {:.1} %. The robot's calibration rejects such data.",
            100.0 * unreal[0],
            counts[0],
            counts[counts.len() - 1],
            100.0 * unreal[1]
        )],
        ..Section::default()
    })
}

/// Calibrates by the baseline, with three exactly known points on the floor; returns the mean error of heights and of
/// positions, m.
fn simulate_baseline(seed: u64, trials: usize, sigma_length: f64, share: f64) -> Result<[f64; 2]> {
    let mut random = Random::new(seed);
    let places = scaled(stand_in::three_cable_anchors_xy(), share);
    let points = places.map(|[x, y]| [x, y, 0.0]);
    let mut all = [Vec::new(), Vec::new()];
    for _ in 0..trials {
        let lengths = Encoders::noisy(sigma_length).measure(&mut random, &places);
        let mut found = [[0.0; 3]; 3];
        let mut met = true;
        for (i, anchor) in found.iter_mut().enumerate() {
            match gps_anchor(&points, &[0, 1, 2].map(|j| lengths[j][i])) {
                Ok(at) => *anchor = at,
                Err(_) => met = false,
            }
        }
        if met {
            for (all, error) in all.iter_mut().zip(errors(&found)) {
                all.push(error);
            }
        }
    }
    Ok(all.map(|values| mean(&values)))
}

/// Figure 4: comparison with the baseline.
pub fn fig4(effort: Effort) -> Result<Section> {
    let counts = effort.select(&[4, 5, 6, 7, 8, 9, 10, 12, 14, 20]);
    let trials = effort.trials(4000);
    let sigmas = [0.02, 0.05, 0.10, 0.20];
    let ours: Vec<Vec<TrialStatistics>> = counts
        .iter()
        .map(|count| {
            sigmas
                .iter()
                .enumerate()
                .map(|(k, sigma)| simulate(400 + 10 * *count as u64 + k as u64, trials, *count, *sigma))
                .collect::<Result<Vec<_>>>()
        })
        .collect::<Result<_>>()?;
    let baseline = |seed: u64, share: f64| -> Result<Vec<[f64; 2]>> {
        sigmas.iter().enumerate().map(|(k, sigma)| simulate_baseline(seed + k as u64, trials, *sigma, share)).collect()
    };
    let at_08 = baseline(480, 0.8)?;
    let at_05 = baseline(490, 0.5)?;
    let mut table = Table::new("Mean position error of an anchor, m", &["sigma_L, m", "known points"]);
    table.head.extend(counts.iter().map(|count| format!("M = {count}")));
    for (k, sigma) in sigmas.iter().enumerate() {
        let row = ours.iter().map(|row| fixed(row[k].mean_3d, 4));
        table.row([fixed(*sigma, 2), fixed(at_08[k][1], 4)].into_iter().chain(row));
    }
    let (crossover_table, crossovers) = crossovers(&counts, &sigmas, &ours, &at_08, &at_05);
    let within = crossovers.iter().all(|(main, _)| main.is_some_and(|count| (5..=10).contains(&count)));
    let by_height = crossovers.iter().all(|(_, heights)| heights.is_some_and(|count| (5..=10).contains(&count)));
    let chart = accuracy_chart(&effort.select(&[5, 6, 10, 20]), &counts, &sigmas, &ours, &at_08);
    let list: Vec<String> = crossovers.iter().map(|(main, _)| count_or_none(*main)).collect();
    Ok(Section {
        key: "fig4",
        title: "Figure 4: comparison with calibration by three known points",
        claim: "From somewhere between 5 and 10 points the method is more accurate than the baseline, even though the baseline's \
                three points are known exactly."
            .into(),
        stand_in: format!(
            "{} The baseline's points are the corners of the triangle of the anchors shrunk to 0.8, on the floor. {trials} \
             calibrations per value.",
            stand_in_words()
        ),
        tables: vec![table, crossover_table],
        pictures: vec![Picture { title: String::new(), size: (820, 480), columns: 1, charts: vec![chart] }],
        checks: vec![
            Check::claim(
                within,
                format!("by position the crossover is at M = {} for sigma_L = 0.02, 0.05, 0.10, 0.20 m", list.join(", ")),
            ),
            Check::condition(
                by_height,
                "the crossover is there too for heights only: x and y come from the laser, so the baseline is better at \
                 heights for longer"
                    .into(),
            ),
        ],
        remarks: vec!["The positions of the known points matter as much: the closer together they are, the worse is the baseline.".into()],
        ..Section::default()
    })
}

/// Plots the position errors of the method with some numbers of points, and of the baseline.
fn accuracy_chart(
    shown: &[usize],
    counts: &[usize],
    sigmas: &[f64],
    ours: &[Vec<TrialStatistics>],
    at_08: &[[f64; 2]],
) -> Chart {
    let mut series: Vec<Series> = shown
        .iter()
        .filter_map(|count| counts.iter().position(|c| c == count))
        .enumerate()
        .map(|(colour, i)| {
            let points = (0..sigmas.len()).map(|k| [sigmas[k], ours[i][k].mean_3d]).collect();
            Series::line(&format!("M = {}", counts[i]), colour, points).with_style(SeriesStyle::Marked)
        })
        .collect();
    let known = (0..sigmas.len()).map(|k| [sigmas[k], at_08[k][1]]).collect();
    series.push(Series::line("three known points", GREY, known).with_style(SeriesStyle::Dashed));
    Chart {
        caption: "mean error of anchor positions".into(),
        x: Axis::auto("σ_L, m"),
        y: Axis::auto("m"),
        series,
        legend: plot::Legend::UpperLeft,
        ..Chart::default()
    }
}

/// Returns the least number of points with which the method is better than the baseline.
fn crossover(counts: &[usize], ours: impl Fn(usize) -> f64, theirs: f64) -> Option<usize> {
    counts.iter().enumerate().find(|(i, _)| ours(*i) < theirs).map(|(_, count)| *count)
}

fn count_or_none(found: Option<usize>) -> String {
    found.map_or("none".to_owned(), |count| count.to_string())
}

/// Least numbers of points that are better than the baseline, by position and by height.
type Crossover = (Option<usize>, Option<usize>);

/// Returns the crossovers by noise as a table and as numbers; the baselines have mean errors of heights and positions.
fn crossovers(
    counts: &[usize],
    sigmas: &[f64],
    ours: &[Vec<TrialStatistics>],
    at_08: &[[f64; 2]],
    at_05: &[[f64; 2]],
) -> (Table, Vec<Crossover>) {
    let mut table = Table::new(
        "Least number of points that is better than the known points",
        &["sigma_L, m", "positions, known points at 0.8", "positions, known points at 0.5", "heights only, at 0.8"],
    );
    let mut found = Vec::new();
    for (k, sigma) in sigmas.iter().enumerate() {
        let main = crossover(counts, |i| ours[i][k].mean_3d, at_08[k][1]);
        let near = crossover(counts, |i| ours[i][k].mean_3d, at_05[k][1]);
        let heights = crossover(counts, |i| ours[i][k].mean_z, at_08[k][0]);
        table.row([fixed(*sigma, 2), count_or_none(main), count_or_none(near), count_or_none(heights)]);
        found.push((main, heights));
    }
    (table, found)
}
