//! Figure 10: heights under the robot, mapped by a rangefinder that looks down, compared with the true ground.

mod scan;

use super::section::{Check, Effort, Section, Table, fixed};
use super::stand_in;
use anyhow::Result;
use plant::ground::Ground;
use plot::{Axis, BLACK, Chart, GREY, Legend, Picture, Series, SeriesStyle};
use scan::{Area, MapErrors, Scan};
use survey::grid::GridSpec;

/// Scanned part of the robot's span; some objects extend beyond it.
const AREA: Area = Area { low_m: [2.8, 0.8], high_m: [6.7, 4.4] };
/// A corner of the large prism, for quick runs.
const CORNER: Area = Area { low_m: [4.9, 3.4], high_m: [5.8, 4.3] };
/// Pitch of the uniform fine raster, m.
const FINE_M: f64 = 0.06;
/// Pitch over the patches of the adaptive scan, m.
const PATCH_M: f64 = 0.05;
/// Pitch of a uniform raster between coarse and fine, m.
const MIDDLE_M: f64 = 0.12;
/// Pitch of a uniform raster with a line over every row of cells, m.
const ROWS_M: f64 = scan::CELL_M;
/// Maximum share of the area covered by patches.
const SHARE: f64 = 0.4;
/// Greatest height of the colour scale, m.
const TOP_M: f64 = 0.3;
/// Greatest error of the colour scale, m.
const WORST_M: f64 = 0.05;

/// Figure 10: topography by coarse and fine scans.
pub fn fig10(effort: Effort) -> Result<Section> {
    let area = if effort == Effort::Full { AREA } else { CORNER };
    let ground = scan::ground()?;
    let band_m = scan::footprint_m() + scan::CELL_M;
    let coarse = scan::uniform(&area, &ground, scan::COARSE_M)?;
    let middle = scan::uniform(&area, &ground, MIDDLE_M)?;
    let fine = scan::uniform(&area, &ground, FINE_M)?;
    let rows = scan::uniform(&area, &ground, ROWS_M)?;
    let adaptive = scan::adaptive(&area, &ground, PATCH_M, SHARE)?;
    let flown = [
        ("uniform, coarse", scan::COARSE_M, &coarse),
        ("uniform, middle", MIDDLE_M, &middle),
        ("uniform, fine", FINE_M, &fine),
        ("uniform, one line per row of cells", ROWS_M, &rows),
        ("adaptive", PATCH_M, &adaptive),
    ];
    let errors = flown.map(|(_, _, scan)| MapErrors::compute(&scan.map, &ground, band_m));
    Ok(Section {
        key: "fig10",
        title: "Figure 10: multiscale topographical mapping",
        claim: "A rangefinder that looks down maps cylinders and rectangular prisms, one with a rectangular cavity at a corner, some of \
                them partly outside of the span; the plot resembles the idealised one."
            .into(),
        stand_in: stand_in_words(),
        tables: vec![error_table(&flown, &errors)],
        pictures: vec![maps(&area, &ground, &fine, &adaptive), rmse_by_length(&flown, &errors, &adaptive)],
        checks: checks(&fine, &rows, &adaptive, &errors, band_m),
        remarks: remarks(&fine, &adaptive),
        ..Section::default()
    })
}

fn stand_in_words() -> String {
    format!(
        "Closed-loop scans of the control chain against the plant: {}, a node of 2 kg at a height of {} m and {} m/s, drives with \
         30 ms delay and 40 ms lag, 50 cycles per second. The rangefinder has {} mm of noise, a beam of {} degrees, a reading every \
         {} ms that arrives {} ms later with a scatter of {} ms, and gets its position from the estimates around its own time. Cells of {} m. The ground is \
         configs/ground/fig10.toml.",
        stand_in::THREE,
        scan::HEIGHT_M,
        scan::SPEED_M_S,
        1e3 * scan::NOISE_M,
        scan::BEAM_DEG,
        1e3 * scan::READING_S,
        1e3 * scan::LATENCY_S[0],
        1e3 * scan::LATENCY_S[1],
        scan::CELL_M
    )
}

fn error_table(flown: &[(&str, f64, &Scan)], errors: &[MapErrors]) -> Table {
    let mut table = Table::new(
        "Error of the heights",
        &[
            "scan",
            "pitch, m",
            "path, m",
            "time, s",
            "RMSE of all cells, mm",
            "RMSE outside the band, mm",
            "unknown cells",
            "within 3 sigma, %",
        ],
    );
    for ((name, pitch_m, scan), error) in flown.iter().zip(errors) {
        table.row([
            (*name).to_owned(),
            fixed(*pitch_m, 2),
            fixed(scan.length_m, 1),
            fixed(scan.duration_s, 0),
            fixed(1e3 * error.all_m, 2),
            fixed(1e3 * error.away_m, 2),
            error.unknown.to_string(),
            fixed(100.0 * error.within, 1),
        ]);
    }
    table
}

/// Checks the claims; the errors are in the order of the flown scans.
fn checks(fine: &Scan, rows: &Scan, adaptive: &Scan, errors: &[MapErrors; 5], band_m: f64) -> Vec<Check> {
    let [_, _, by_fine, by_rows, by_adaptive] = errors;
    // The adaptive scan is as good as the uniform one from this point on.
    let reached =
        adaptive.rmse_by_length.iter().rposition(|[_, rmse_m]| *rmse_m > by_fine.all_m).map_or(0, |last| last + 1);
    let reached_m = adaptive.rmse_by_length.get(reached).map_or(f64::INFINITY, |[length_m, _]| *length_m);
    let share = reached_m / fine.length_m;
    vec![
        Check::claim(
            by_fine.away_m <= 0.010 && by_fine.near < 0.25,
            format!(
                "outside a band of {:.0} mm (the beam's footprint of {:.0} mm and one cell) at every edge, which excludes {:.1} % of \
                 the cells, the uniform fine raster has an RMSE of {:.2} mm; over all cells {:.2} mm",
                1e3 * band_m,
                1e3 * scan::footprint_m(),
                100.0 * by_fine.near,
                1e3 * by_fine.away_m,
                1e3 * by_fine.all_m
            ),
        ),
        Check::claim(
            by_adaptive.away_m <= 0.010,
            format!(
                "the same holds for the adaptive scan: {:.2} mm outside the band, {:.2} mm over all cells",
                1e3 * by_adaptive.away_m,
                1e3 * by_adaptive.all_m
            ),
        ),
        Check::claim(
            share <= 0.60,
            if share.is_finite() {
                format!(
                    "over all cells, including edges, the adaptive scan is as accurate as the uniform fine raster after a path of {reached_m:.1} m, \
                     {:.1} % of its {:.1} m",
                    100.0 * share,
                    fine.length_m
                )
            } else {
                format!(
                    "the adaptive scan, with a path of {:.1} m instead of {:.1} m, is less accurate over all cells than the uniform fine raster",
                    adaptive.length_m, fine.length_m
                )
            },
        ),
        Check::condition(
            by_adaptive.all_m <= by_rows.all_m,
            format!(
                "it is as accurate as a raster with one line per row of cells, with a path of {:.1} m: {:.2} mm compared with {:.2} mm",
                rows.length_m,
                1e3 * by_adaptive.all_m,
                1e3 * by_rows.all_m
            ),
        ),
    ]
}

fn remarks(fine: &Scan, adaptive: &Scan) -> Vec<String> {
    vec![
        format!(
            "The adaptive scan begins with the coarse raster and then flies {} rectangles in which the map changes between adjacent tracks, \
             with lines across the change. All scans are evaluated over all cells of the same area; an unknown cell \
             counts as ground. An object smaller than the pitch of the coarse raster may lie between its lines and is then \
             not detected, and the accuracy of a raster at edges depends on the positions of its lines.",
            adaptive.patches.len()
        ),
        format!(
            "The path is shorter, but the time is not: {:.0} s compared with {:.0} s, because the node rests at both ends of every line, and the lines \
             of the rectangles are short.",
            adaptive.duration_s, fine.duration_s
        ),
    ]
}

/// Creates a chart of cells coloured by values from 0 to 1.
fn cells(area: &Area, spec: &GridSpec, caption: String, value: impl Fn(usize, [f64; 2]) -> f64) -> Chart {
    let points: Vec<[f64; 2]> = (0..spec.cells()).map(|at| spec.centre(at % spec.columns, at / spec.columns)).collect();
    let values = points.iter().enumerate().map(|(at, place)| value(at, *place)).collect();
    let side = spec.cell_m * 1.02;
    Chart {
        caption,
        x: Axis::fixed("x, m", area.low_m[0], area.high_m[0]),
        y: Axis::fixed("y, m", area.low_m[1], area.high_m[1]),
        series: vec![Series {
            name: String::new(),
            colour: 0,
            style: SeriesStyle::Cells([side, side], values),
            points,
        }],
        equal_scale: true,
        ..Chart::default()
    }
}

/// Plots the true and measured heights, and the error.
fn maps(area: &Area, ground: &Ground, fine: &Scan, adaptive: &Scan) -> Picture {
    let spec = fine.map.spec();
    let height = |scan: &Scan, at: usize| scan.map.cells()[at].map_or(f64::NAN, |cell| cell.value);
    let span = format!("dark 0 m, bright {TOP_M} m");
    let charts = vec![
        cells(area, spec, format!("idealised heights, {span}"), |_, place| ground.height_m(place) / TOP_M),
        cells(area, spec, format!("uniform fine raster, path {:.0} m", fine.length_m), |at, _| {
            height(fine, at) / TOP_M
        }),
        cells(area, spec, format!("adaptive scan, path {:.0} m", adaptive.length_m), |at, _| {
            height(adaptive, at) / TOP_M
        }),
        cells(area, spec, format!("error of the adaptive scan, bright {:.0} mm", 1e3 * WORST_M), |at, place| {
            (height(adaptive, at) - ground.height_m(place)).abs() / WORST_M
        }),
    ];
    Picture { title: String::new(), size: (1040, 900), columns: 2, charts }
}

/// Plots the path of the adaptive scan, and the error over the path length.
fn rmse_by_length(flown: &[(&str, f64, &Scan)], errors: &[MapErrors], adaptive: &Scan) -> Picture {
    let (low, high) = (adaptive.map.spec().origin_m, adaptive.map.spec().end_m());
    let (coarse, patches) = adaptive.path.split_at(adaptive.second);
    let path = Chart {
        caption: "path of the adaptive scan".into(),
        x: Axis::fixed("x, m", low[0] - 0.1, high[0] + 0.1),
        // Space for the legend.
        y: Axis::fixed("y, m", low[1] - 0.1, high[1] + 1.0),
        series: vec![
            Series::line("coarse", GREY, coarse.to_vec()),
            Series::line("fine, where the map changes", 1, patches.to_vec()).with_style(SeriesStyle::Line(1)),
        ],
        equal_scale: true,
        legend: Legend::UpperLeft,
    };
    let uniform: Vec<[f64; 2]> = flown
        .iter()
        .zip(errors)
        .filter(|((name, ..), _)| name.starts_with("uniform"))
        .map(|((.., scan), error)| [scan.length_m, 1e3 * error.all_m])
        .collect();
    let level = uniform.get(2).map_or(f64::NAN, |[_, rmse_mm]| *rmse_mm);
    let longest = uniform.last().map_or(0.0, |[length_m, _]| *length_m);
    let rmse_by_length = adaptive.rmse_by_length.iter().map(|[length_m, rmse_m]| [*length_m, 1e3 * rmse_m]).collect();
    let error = Chart {
        caption: "RMSE of all cells over the path length".into(),
        x: Axis::auto("path, m"),
        y: Axis::auto("mm"),
        series: vec![
            Series::line("level of the fine raster", BLACK, vec![[0.0, level], [longest, level]])
                .with_style(SeriesStyle::Dashed),
            Series::line("uniform rasters", 0, uniform).with_style(SeriesStyle::Marked),
            Series::line("adaptive", 1, rmse_by_length),
        ],
        ..Chart::default()
    };
    Picture { title: String::new(), size: (1040, 460), columns: 2, charts: vec![path, error] }
}
