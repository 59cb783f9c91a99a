//! Figure 10: the heights under the robot, mapped by a rangefinder that looks down, beside what really stands there.

mod scan;

use super::section::{Check, Effort, Section, Table, fixed};
use super::stand_in;
use anyhow::Result;
use plant::ground::Ground;
use plot::{Axis, BLACK, Chart, GREY, Legend, Picture, Series, SeriesStyle};
use scan::{Area, Errors, Scan};
use survey::grid::GridSpec;

/// Part of the robot's span; some of what stands there reaches out of it.
const AREA: Area = Area { low_m: [2.8, 0.8], high_m: [6.7, 4.4] };
/// A corner of the large prism.
const CORNER: Area = Area { low_m: [4.9, 3.4], high_m: [5.8, 4.3] };
/// Pitch of the uniform fine raster, m.
const FINE_M: f64 = 0.06;
/// Pitch over the patches of the adaptive scan, m.
const PATCH_M: f64 = 0.05;
/// And of a uniform raster between coarse and fine, m.
const MIDDLE_M: f64 = 0.12;
/// Of a uniform raster with a line over every row of cells, m.
const ROWS_M: f64 = scan::CELL_M;
/// Share of the area that the patches may cover.
const SHARE: f64 = 0.4;
/// Heights are drawn up to this, m.
const TOP_M: f64 = 0.3;
/// Errors are drawn up to this, m.
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
        ("uniform, a line for every row of cells", ROWS_M, &rows),
        ("adaptive", PATCH_M, &adaptive),
    ];
    let errors = flown.map(|(_, _, scan)| Errors::of(&scan.map, &ground, band_m));
    let [_, _, by_fine, by_rows, by_adaptive] = errors;
    let mut table = Table::new(
        "Error of the heights",
        &[
            "scan",
            "pitch, m",
            "path, m",
            "time, s",
            "RMSE everywhere, mm",
            "RMSE outside the band, mm",
            "unknown cells",
            "within 3 sigma, %",
        ],
    );
    for ((name, pitch_m, scan), error) in flown.iter().zip(&errors) {
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
    // from here on the adaptive scan stays as good as the uniform one
    let reached = adaptive.course.iter().rposition(|[_, rmse_m]| *rmse_m > by_fine.all_m).map_or(0, |last| last + 1);
    let reached_m = adaptive.course.get(reached).map_or(f64::INFINITY, |[length_m, _]| *length_m);
    let share = reached_m / fine.length_m;
    let checks = vec![
        Check::claim(
            by_fine.away_m <= 0.010 && by_fine.near < 0.25,
            format!(
                "outside a band of {:.0} mm (the beam's footprint of {:.0} mm and one cell) at every edge, which leaves out {:.1} % of \
                 the cells, the uniform fine raster has an RMSE of {:.2} mm; everywhere {:.2} mm",
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
                "so has the adaptive scan: {:.2} mm outside the band, {:.2} mm everywhere",
                1e3 * by_adaptive.away_m,
                1e3 * by_adaptive.all_m
            ),
        ),
        Check::claim(
            share <= 0.60,
            if share.is_finite() {
                format!(
                    "the adaptive scan is as good everywhere, edges included, as the uniform fine raster after {reached_m:.1} m of way, \
                     {:.1} % of its {:.1} m",
                    100.0 * share,
                    fine.length_m
                )
            } else {
                format!(
                    "the adaptive scan, {:.1} m of way against {:.1} m, is not as good everywhere as the uniform fine raster",
                    adaptive.length_m, fine.length_m
                )
            },
        ),
        Check::condition(
            by_adaptive.all_m <= by_rows.all_m,
            format!(
                "it is even as good as a raster with a line over the middle of every row of cells, {:.1} m of way: {:.2} mm against {:.2} mm",
                rows.length_m,
                1e3 * by_adaptive.all_m,
                1e3 * by_rows.all_m
            ),
        ),
    ];
    Ok(Section {
        key: "fig10",
        title: "Figure 10: multiscale topographical mapping",
        claim: "A rangefinder that looks down maps cylinders and rectangular prisms, one with a rectangular cavity at a corner, some of \
                them partly outside of the span; the plot resembles the idealised one."
            .into(),
        stand_in: format!(
            "Closed-loop scans of the control chain against the plant: {}, a node of 2 kg at a height of {} m and {} m/s, drives with \
             30 ms delay and 40 ms lag, 50 cycles a second. The rangefinder has {} mm of noise, a beam of {} degrees, a reading every \
             {} ms that is told {} ms later, give or take {} ms, and is placed by the estimates around its own time. Cells of {} m. The ground is \
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
        ),
        tables: vec![table],
        pictures: vec![maps(&area, &ground, &fine, &adaptive), course(&flown, &errors, &adaptive)],
        checks,
        remarks: vec![
            format!(
                "The adaptive scan begins with the coarse raster and then flies {} rectangles between whose neighbouring tracks the map \
                 changes, with lines across the change. All scans are judged over all cells of the same area; a cell of which nothing \
                 is known counts as ground. What is smaller than the pitch of the coarse raster may lie between its lines and is then \
                 never looked at, and how well a raster does at edges depends on where its lines happen to lie.",
                adaptive.patches.len()
            ),
            format!(
                "The way is shorter, the time is not: {:.0} s against {:.0} s, as the node rests at both ends of every line and the lines \
                 of the rectangles are short.",
                adaptive.duration_s, fine.duration_s
            ),
        ],
        ..Section::default()
    })
}

/// A chart of cells in colours for values from 0 to 1.
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

/// Idealised and measured heights, and what is between them.
fn maps(area: &Area, ground: &Ground, fine: &Scan, adaptive: &Scan) -> Picture {
    let spec = fine.map.spec();
    let height = |scan: &Scan, at: usize| scan.map.cells()[at].map_or(f64::NAN, |cell| cell.value);
    let span = format!("dark 0 m, bright {TOP_M} m");
    let charts = vec![
        cells(area, spec, format!("idealised heights, {span}"), |_, place| ground.height_m(place) / TOP_M),
        cells(area, spec, format!("uniform fine raster, {:.0} m of way", fine.length_m), |at, _| {
            height(fine, at) / TOP_M
        }),
        cells(area, spec, format!("adaptive scan, {:.0} m of way", adaptive.length_m), |at, _| {
            height(adaptive, at) / TOP_M
        }),
        cells(area, spec, format!("error of the adaptive scan, bright {:.0} mm", 1e3 * WORST_M), |at, place| {
            (height(adaptive, at) - ground.height_m(place)).abs() / WORST_M
        }),
    ];
    Picture { title: String::new(), size: (1040, 900), columns: 2, charts }
}

/// The way of the adaptive scan, and the error over the length of the way.
fn course(flown: &[(&str, f64, &Scan)], errors: &[Errors], adaptive: &Scan) -> Picture {
    let (low, high) = (adaptive.map.spec().origin_m, adaptive.map.spec().end_m());
    let (coarse, patches) = adaptive.way.split_at(adaptive.second);
    let way = Chart {
        caption: "the way of the adaptive scan".into(),
        x: Axis::fixed("x, m", low[0] - 0.1, high[0] + 0.1),
        // room for the legend
        y: Axis::fixed("y, m", low[1] - 0.1, high[1] + 1.0),
        series: vec![
            Series::line("coarse", GREY, coarse.to_vec()),
            Series::line("fine, where it changes", 1, patches.to_vec()).with_style(SeriesStyle::Line(1)),
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
    let course = adaptive.course.iter().map(|[length_m, rmse_m]| [*length_m, 1e3 * rmse_m]).collect();
    let error = Chart {
        caption: "RMSE everywhere over the length of the way".into(),
        x: Axis::auto("path, m"),
        y: Axis::auto("mm"),
        series: vec![
            Series::line("as good as the fine raster", BLACK, vec![[0.0, level], [longest, level]])
                .with_style(SeriesStyle::Dashed),
            Series::line("uniform rasters", 0, uniform).with_style(SeriesStyle::Marked),
            Series::line("adaptive", 1, course),
        ],
        ..Chart::default()
    };
    Picture { title: String::new(), size: (1040, 460), columns: 2, charts: vec![way, error] }
}
