//! `nims workspace`: where the lines can hold the node at rest, how much room that is, and how far it is from the limits. The
//! room of a planar robot is an area.

use cable_robot::kinematics::inverse_kinematics;
use cable_robot::tension;
use cable_robot::{Distribution, Robot, Vector3, elastic};
use command::values::finite;
use command::{Answer, Failure, Output, points};
use config::RobotFile;
use plot::{Axis, BLACK, Chart, Legend, Look, Picture, Series, save_png};
use serde_json::{Value, json};
use std::path::PathBuf;

/// `nims workspace`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Robot file.
    #[arg(long)]
    pub config: PathBuf,
    /// Picture of slices at several heights; of a planar robot, of its plane.
    #[arg(long, value_name = "FILE")]
    pub png: Option<PathBuf>,
    /// Size of a cell, m; default: a fortieth of the longest side.
    #[arg(long, value_name = "M", value_parser = finite, allow_negative_numbers = true)]
    pub step: Option<f64>,
}

/// Cells along the longest side, if no step is given.
const CELLS: f64 = 40.0;

/// Most cells: some seconds with four cables.
const MOST_CELLS: f64 = 2e6;

/// Heights that the picture shows.
const SLICES: usize = 6;

/// A horizontal layer of cells.
struct Layer {
    z_m: f64,
    /// Centre of each cell that can be held, and its margin.
    held: Vec<([f64; 2], f64)>,
}

/// The cells of a box around the anchors, from the ground to the highest of them; of a planar robot one layer of them, whose
/// cells have no size across it.
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
            let why = "the anchors enclose no room above ground_m; give anchors that are not in one vertical plane (or, for a planar robot, not above each other), above the ground";
            return Err(Failure::BadInput(why.to_owned()));
        }
        let wanted = step_m.unwrap_or(size.max() / CELLS);
        let counts = size.map(|side| (side / wanted).ceil().max(1.0));
        if !(wanted > 0.0 && counts.product() <= MOST_CELLS) {
            return Err(Failure::BadInput(format!(
                "--step is {wanted} m; accepted: above 0, and such that the room of {:.1} x {:.1} x {:.1} m has at most {MOST_CELLS:e} cells",
                size.x, size.y, size.z
            )));
        }
        let step = size.component_div(&counts);
        Ok(Self { planar, low, step, counts: [counts.x as usize, counts.y as usize, counts.z as usize] })
    }

    /// Room of a cell within its layer: m², or m in a plane.
    fn cell(&self) -> f64 {
        if self.planar { self.step.x } else { self.step.x * self.step.y }
    }

    fn centre(&self, i: usize, j: usize, k: usize) -> Vector3<f64> {
        self.low + self.step.component_mul(&Vector3::new(i as f64 + 0.5, j as f64 + 0.5, k as f64 + 0.5))
    }
}

/// The greatest margin to a tension limit that can be had at rest, N; none where the node cannot be.
fn margin_n(robot: &Robot, at: &Vector3<f64>) -> Option<f64> {
    if robot.keep_out().iter().any(|b| b.touches(at, at)) {
        return None;
    }
    let weight = robot.wrench_n(&Vector3::zeros());
    let limits = robot.tension_limits_n();
    let held = tension::hold(robot.anchors(), robot.is_planar(), at, &weight, limits, Distribution::Safest).ok()?;
    if tension::worst_violation(&held.tensions_n, limits).is_some() {
        return None;
    }
    let lengths = elastic::unstretched(robot, &inverse_kinematics(robot.anchors(), at), &held.tensions_n);
    let long_enough = lengths.iter().zip(robot.length_limits_m()).all(|(l, [min, max])| (*min..=*max).contains(l));
    long_enough.then_some(held.margin_n)
}

fn layers(robot: &Robot, grid: &Grid) -> Vec<Layer> {
    let [nx, ny, nz] = grid.counts;
    (0..nz)
        .map(|k| {
            let cells = (0..nx).flat_map(|i| (0..ny).map(move |j| (i, j)));
            let held = cells.filter_map(|(i, j)| {
                let at = grid.centre(i, j, k);
                margin_n(robot, &at).map(|margin| ([at.x, at.y], margin))
            });
            Layer { z_m: grid.centre(0, 0, k).z, held: held.collect() }
        })
        .collect()
}

/// Volume and margins, and the picture if one is wanted.
///
/// # Errors
/// A robot file or step that cannot be used, or a picture that cannot be written.
pub fn run(asked: &Args) -> Answer<Output> {
    measured(asked).map(Output::json)
}

fn measured(asked: &Args) -> Answer<Value> {
    let robot = RobotFile::load(&asked.config).map_err(Failure::bad)?.robot().map_err(Failure::bad)?;
    let grid = Grid::new(&robot, asked.step)?;
    let layers = layers(&robot, &grid);
    let cell = grid.cell();
    let mut margins: Vec<f64> = layers.iter().flat_map(|layer| layer.held.iter().map(|(_, m)| *m)).collect();
    margins.sort_by(f64::total_cmp);
    let best = layers
        .iter()
        .flat_map(|layer| layer.held.iter().map(move |([x, y], m)| (Vector3::new(*x, *y, layer.z_m), *m)))
        .max_by(|a, b| a.1.total_cmp(&b.1));
    if let Some(path) = &asked.png {
        save_png(path, &picture(&robot, &grid, &layers))?;
    }
    let size = grid.step.component_mul(&Vector3::from(grid.counts.map(|n| n as f64)));
    let levels: Vec<Value> = layers
        .iter()
        .map(|layer| {
            let best = layer.held.iter().map(|(_, m)| *m).fold(f64::NEG_INFINITY, f64::max);
            json!({
                "z_m": layer.z_m,
                (if grid.planar { "width_m" } else { "area_m2" }): layer.held.len() as f64 * cell,
                "best_margin_n": if layer.held.is_empty() { Value::Null } else { json!(best) },
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

/// Slices at a few heights, coloured by margin.
fn picture(robot: &Robot, grid: &Grid, layers: &[Layer]) -> Picture {
    let most = layers
        .iter()
        .flat_map(|l| l.held.iter().map(|(_, m)| *m))
        .fold(0.0f64, |a, m| if m.is_finite() { a.max(m) } else { a });
    if grid.planar {
        return picture_of_plane(robot, grid, layers, most);
    }
    let shown = SLICES.min(layers.len());
    let charts = (0..shown).map(|s| {
        let layer = &layers[(s * layers.len() + layers.len() / 2) / shown];
        let values = layer.held.iter().map(|(_, m)| share(*m, most)).collect();
        let points = layer.held.iter().map(|(at, _)| *at).collect();
        let anchors = robot.anchors().iter().map(|a| [a.x, a.y]).collect();
        let cells = Look::Cells([grid.step.x, grid.step.y], values);
        Chart {
            caption: format!("z = {:.2} m: {:.1} m2", layer.z_m, layer.held.len() as f64 * grid.step.x * grid.step.y),
            x: Axis::of("x, m"),
            y: Axis::of("y, m"),
            series: vec![
                Series::line("", 0, points).looking(cells),
                Series::line("", BLACK, anchors).looking(Look::Discs(4)),
            ],
            equal_scale: true,
            legend: Legend::UpperRight,
        }
    });
    Picture {
        title: format!("Where the lines can hold the node; colour: margin to a tension limit, 0 to {most:.1} N"),
        size: (1260, 860),
        columns: 3,
        charts: charts.collect(),
    }
}

/// A margin as a share of the best one.
fn share(margin_n: f64, most_n: f64) -> f64 {
    if most_n > 0.0 { (margin_n / most_n).clamp(0.0, 1.0) } else { 0.0 }
}

/// The plane of a planar robot, coloured by margin.
fn picture_of_plane(robot: &Robot, grid: &Grid, layers: &[Layer], most_n: f64) -> Picture {
    let held = || layers.iter().flat_map(|layer| layer.held.iter().map(|([x, _], m)| ([*x, layer.z_m], *m)));
    let values: Vec<f64> = held().map(|(_, margin)| share(margin, most_n)).collect();
    let area_m2 = values.len() as f64 * grid.step.x * grid.step.z;
    let cells = Look::Cells([grid.step.x, grid.step.z], values);
    let anchors = robot.anchors().iter().map(|a| [a.x, a.z]).collect();
    let chart = Chart {
        caption: format!("{area_m2:.1} m2"),
        x: Axis::of("x, m"),
        y: Axis::of("z, m"),
        series: vec![
            Series::line("", 0, held().map(|(at, _)| at).collect()).looking(cells),
            Series::line("", BLACK, anchors).looking(Look::Discs(4)),
        ],
        equal_scale: true,
        legend: Legend::UpperRight,
    };
    Picture {
        title: format!("Where the lines can hold the node; colour: margin to a tension limit, 0 to {most_n:.1} N"),
        size: (1000, 700),
        columns: 1,
        charts: vec![chart],
    }
}
