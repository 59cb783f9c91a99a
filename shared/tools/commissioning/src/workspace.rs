//! `nims workspace`: the region where the cables can hold the node at rest, its size, and its margins to the limits.
//! For a planar robot the region is an area.

use crate::config_kind::{self, Planned};
use crate::readable;
use cable_robot::tension;
use cable_robot::{Distribution, Path, Profile, Robot, Segment, Vector3};
use command::values::finite;
use command::{Answer, Failure, Output, points};
use plot::{Axis, BLACK, Chart, Legend, Picture, Series, SeriesStyle, save_png};
use serde_json::{Value, json};
use std::path::PathBuf;

/// `nims workspace`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Robot file, or system file, which also states the lowest voltage of the drives.
    #[arg(long, visible_aliases = ["robot", "system"])]
    pub config: PathBuf,
    /// Plot of slices at several heights; for a planar robot, of its plane.
    #[arg(long, value_name = "FILE")]
    pub png: Option<PathBuf>,
    /// Size of a cell, m; default: a fortieth of the longest side.
    #[arg(long, value_name = "M", value_parser = finite, allow_negative_numbers = true)]
    pub step: Option<f64>,
}

/// Cells along the longest side by default.
const CELLS: f64 = 40.0;

/// Maximum number of cells: some seconds with four cables.
const MOST_CELLS: f64 = 2e6;

/// Number of heights in the plot.
const SLICES: usize = 6;

/// A horizontal layer of cells.
struct Layer {
    z_m: f64,
    /// Centre of each feasible cell and its margin, N.
    feasible: Vec<([f64; 2], f64)>,
}

/// Grid of cells in the bounding box of the anchors, from the ground to the highest anchor. A planar robot has one
/// layer of cells without thickness.
struct Grid {
    planar: bool,
    low: Vector3<f64>,
    step: Vector3<f64>,
    counts: [usize; 3],
}

impl Grid {
    fn new(robot: &Robot, step_m: Option<f64>) -> Answer<Self> {
        let mut low = Vector3::repeat(f64::INFINITY);
        let mut high = Vector3::repeat(f64::NEG_INFINITY);
        for anchor in robot.anchors().iter() {
            (low, high) = (low.inf(anchor), high.sup(anchor));
        }
        low.z = robot.ground_m();
        let size = high - low;
        let planar = robot.is_planar();
        if !(size.x > 0.0 && size.z > 0.0 && (planar || size.y > 0.0)) {
            let why = "the anchors enclose no volume above ground_m; set anchors_m to points above the ground that are not in one vertical plane (for a planar robot: not on one vertical line)";
            return Err(Failure::BadInput(why.to_owned()));
        }
        let wanted = step_m.unwrap_or(size.max() / CELLS);
        let counts = size.map(|side| (side / wanted).ceil().max(1.0));
        if !(wanted > 0.0 && counts.product() <= MOST_CELLS) {
            return Err(Failure::BadInput(format!(
                "--step is {wanted} m; accepted: above 0, and large enough that the box of {:.1} x {:.1} x {:.1} m has at most {MOST_CELLS:e} cells",
                size.x, size.y, size.z
            )));
        }
        let step = size.component_div(&counts);
        Ok(Self { planar, low, step, counts: [counts.x as usize, counts.y as usize, counts.z as usize] })
    }

    /// Returns the size of a cell within its layer: m², or m for a planar robot.
    fn cell(&self) -> f64 {
        if self.planar { self.step.x } else { self.step.x * self.step.y }
    }

    fn centre(&self, i: usize, j: usize, k: usize) -> Vector3<f64> {
        self.low + self.step.component_mul(&Vector3::new(i as f64 + 0.5, j as f64 + 0.5, k as f64 + 0.5))
    }
}

/// Returns the greatest possible margin to a tension limit at rest, N; `None` where the planner refuses that the node
/// rests.
#[must_use]
pub fn margin_n(robot: &Robot, distribution: Distribution, at: &Vector3<f64>) -> Option<f64> {
    let rest = Segment { id: 1, path: Path::Dwell(*at), profile: Profile::dwell(1.0).ok()?, start_s: 0.0 };
    rest.check(robot, distribution, 1.0).ok()?;
    let weight_n = robot.with_cables_n(at, &robot.wrench_n(&Vector3::zeros()));
    let safest = tension::hold(robot.anchors(), at, &weight_n, robot.tension_limits_n(), Distribution::Safest);
    safest.ok().map(|held| held.margin_n)
}

fn layers(robot: &Robot, distribution: Distribution, grid: &Grid) -> Vec<Layer> {
    let [nx, ny, nz] = grid.counts;
    (0..nz)
        .map(|k| {
            let cells = (0..nx).flat_map(|i| (0..ny).map(move |j| (i, j)));
            let feasible = cells.filter_map(|(i, j)| {
                let at = grid.centre(i, j, k);
                margin_n(robot, distribution, &at).map(|margin| ([at.x, at.y], margin))
            });
            Layer { z_m: grid.centre(0, 0, k).z, feasible: feasible.collect() }
        })
        .collect()
}

/// Runs `nims workspace`: computes volume and margins, and draws the plot if requested.
///
/// # Errors
/// A robot file or step that cannot be used, or a plot that cannot be written.
pub fn run(args: &Args) -> Answer<Output> {
    let found = evaluate(args)?;
    let words = readable::workspace(&found);
    Ok(Output::new(found, words))
}

fn evaluate(args: &Args) -> Answer<Value> {
    let Planned { robot, distribution, .. } = config_kind::planned(&args.config)?;
    let grid = Grid::new(&robot, args.step)?;
    let layers = layers(&robot, distribution, &grid);
    let cell = grid.cell();
    let mut margins: Vec<f64> = layers.iter().flat_map(|layer| layer.feasible.iter().map(|(_, m)| *m)).collect();
    margins.sort_by(f64::total_cmp);
    let best = layers
        .iter()
        .flat_map(|layer| layer.feasible.iter().map(move |([x, y], m)| (Vector3::new(*x, *y, layer.z_m), *m)))
        .max_by(|a, b| a.1.total_cmp(&b.1));
    if let Some(path) = &args.png {
        save_png(path, &picture(&robot, &grid, &layers))?;
    }
    let size = grid.step.component_mul(&Vector3::from(grid.counts.map(|n| n as f64)));
    let levels: Vec<Value> = layers
        .iter()
        .map(|layer| {
            let best = layer.feasible.iter().map(|(_, m)| *m).fold(f64::NEG_INFINITY, f64::max);
            json!({
                "z_m": layer.z_m,
                (if grid.planar { "width_m" } else { "area_m2" }): layer.feasible.len() as f64 * cell,
                "best_margin_n": if layer.feasible.is_empty() { Value::Null } else { json!(best) },
            })
        })
        .collect();
    Ok(json!({
        (if grid.planar { "feasible_area_m2" } else { "feasible_volume_m3" }): margins.len() as f64 * cell * grid.step.z,
        "box_m": [points::written(&robot, &grid.low), points::written(&robot, &(grid.low + size))],
        "cell_m": points::written(&robot, &grid.step),
        "feasible_share": margins.len() as f64 / grid.counts.iter().product::<usize>() as f64,
        "median_margin_n": margins.get(margins.len() / 2),
        "best_margin_n": best.map(|(_, m)| m),
        "safest_position_m": best.map(|(at, _)| points::written(&robot, &at)),
        "levels": levels,
    }))
}

/// Draws slices at a few heights, coloured by margin.
fn picture(robot: &Robot, grid: &Grid, layers: &[Layer]) -> Picture {
    let most = layers
        .iter()
        .flat_map(|l| l.feasible.iter().map(|(_, m)| *m))
        .fold(0.0f64, |a, m| if m.is_finite() { a.max(m) } else { a });
    if grid.planar {
        return picture_of_plane(robot, grid, layers, most);
    }
    let shown = SLICES.min(layers.len());
    let charts = (0..shown).map(|s| {
        let layer = &layers[(s * layers.len() + layers.len() / 2) / shown];
        let values = layer.feasible.iter().map(|(_, m)| share(*m, most)).collect();
        let points = layer.feasible.iter().map(|(at, _)| *at).collect();
        let anchors = robot.anchors().iter().map(|a| [a.x, a.y]).collect();
        let cells = SeriesStyle::Cells([grid.step.x, grid.step.y], values);
        Chart {
            caption: format!(
                "z = {:.2} m: {:.1} m2",
                layer.z_m,
                layer.feasible.len() as f64 * grid.step.x * grid.step.y
            ),
            x: Axis::auto("x, m"),
            y: Axis::auto("y, m"),
            series: vec![
                Series::line("", 0, points).with_style(cells),
                Series::line("", BLACK, anchors).with_style(SeriesStyle::Discs(4)),
            ],
            equal_scale: true,
            legend: Legend::UpperRight,
        }
    });
    Picture {
        title: format!("Where the cables can hold the node; colour: margin to a tension limit, 0 to {most:.1} N"),
        size: (1260, 860),
        columns: 3,
        charts: charts.collect(),
    }
}

/// Returns a margin as a share of the best one.
fn share(margin_n: f64, most_n: f64) -> f64 {
    if most_n > 0.0 { (margin_n / most_n).clamp(0.0, 1.0) } else { 0.0 }
}

/// Draws the plane of a planar robot, coloured by margin.
fn picture_of_plane(robot: &Robot, grid: &Grid, layers: &[Layer], most_n: f64) -> Picture {
    let feasible = || layers.iter().flat_map(|layer| layer.feasible.iter().map(|([x, _], m)| ([*x, layer.z_m], *m)));
    let values: Vec<f64> = feasible().map(|(_, margin)| share(margin, most_n)).collect();
    let area_m2 = values.len() as f64 * grid.step.x * grid.step.z;
    let cells = SeriesStyle::Cells([grid.step.x, grid.step.z], values);
    let anchors = robot.anchors().iter().map(|a| [a.x, a.z]).collect();
    let chart = Chart {
        caption: format!("{area_m2:.1} m2"),
        x: Axis::auto("x, m"),
        y: Axis::auto("z, m"),
        series: vec![
            Series::line("", 0, feasible().map(|(at, _)| at).collect()).with_style(cells),
            Series::line("", BLACK, anchors).with_style(SeriesStyle::Discs(4)),
        ],
        equal_scale: true,
        legend: Legend::UpperRight,
    };
    Picture {
        title: format!("Where the cables can hold the node; colour: margin to a tension limit, 0 to {most_n:.1} N"),
        size: (1000, 700),
        columns: 1,
        charts: vec![chart],
    }
}
