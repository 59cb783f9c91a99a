//! What a guided calibration is worth to the node: drawn worlds of each size, calibrated by a script with human errors,
//! then zeroed once in the middle. The node then hangs at places over the workspace, in the plant at rest, and the
//! robot computes from its counts where it is.
//!
//! Takes minutes, so it runs by hand:
//! `cargo test --workspace --test lockstep calibrated_worlds -- --ignored --nocapture`.

use crate::calibrations::{DrawnRobot, median};
use cable_robot::{Anchors, Distribution, Robot, Vector3, elastic};
use calibration::calibrate;
use commissioning::calibrate::{MeasurementsFile, judge};
use config::{PulleyKind, RobotFile, SystemFile};
use motor_box::BoxConfig;
use nims_truth::Args;
use plant::world::{Warming, Wind};
use plant::{Plant, PlantConfig};
use std::io::{IsTerminal, Write};
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};

/// Worlds of each robot. The tolerances of calibrations were chosen in the worlds 1 to 100.
const SEEDS: std::ops::Range<u64> = 1001..1101;

/// Weather after zeroing, in the second table.
const WARMING_K: f64 = 15.0;
const WIND_M_S: f64 = 8.0;

/// Shares of the way from the middle towards each anchor, and of the height of the anchors.
const OUTWARD: [f64; 2] = [0.25, 0.5];
const HEIGHTS: [f64; 3] = [0.15, 0.3, 0.5];
const ZERO_HEIGHT: f64 = 0.3;

/// The robot of a system file, perhaps with its first cables only, and its true world.
struct World {
    drawn: DrawnRobot,
    plant: PlantConfig,
    file: RobotFile,
}

/// Node errors of one model in one world, RMS over the places, m.
#[derive(Debug, Clone, Copy)]
struct NodeErrors {
    calm_m: f64,
    weather_m: f64,
}

/// Results in one world.
struct Outcome {
    /// None if the calibration was refused.
    known: Option<Known>,
    /// The point model: wheels taken for eyes, and no test of the result.
    points: Option<NodeErrors>,
}

struct Known {
    node: Option<NodeErrors>,
    /// Error and 95 % half-width of each free coordinate of the anchors, m.
    coordinates: Vec<(f64, f64)>,
}

impl World {
    fn new(name: &str, cables: usize, seed: u64) -> Self {
        let system = Path::new(env!("CARGO_MANIFEST_DIR")).join("../configs/systems").join(name).with_extension("toml");
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("system.toml");
        nims_truth::run(&Args { system, seed, spread: 1.0, warming: 0.0, wind: 0.0, out: Some(out.clone()) }).unwrap();
        let system = SystemFile::load(&out).unwrap();
        let mut file = system.robot_file().unwrap();
        let mut plant = BoxConfig::from_files(&system, &file, Path::new("/")).unwrap().plant;
        let drawn = DrawnRobot::new(name, cables, seed);
        plant.anchors_m = drawn.anchors_m.iter().map(|a| (*a).into()).collect();
        plant.idlers.truncate(cables);
        plant.routed_length_m.truncate(cables);
        plant.world.cables.truncate(cables);
        let mut anchors_m = file.robot.anchors_m.to_vec();
        anchors_m.truncate(cables);
        file.robot.anchors_m = anchors_m.into();
        file.lines.routed_length_m.truncate(cables);
        Self { drawn, plant, file }
    }

    fn middle(&self) -> Vector3<f64> {
        self.drawn.anchors_m.iter().sum::<Vector3<f64>>() / self.drawn.anchors_m.len() as f64
    }

    /// The plant at rest with the node here; None where it cannot hang.
    fn hang(&self, node: Vector3<f64>, weather: bool) -> Option<Plant> {
        let mut config = PlantConfig { start_m: node.into(), ..self.plant.clone() };
        if weather {
            config.world.warming = Warming { change_k: WARMING_K, over_s: 0.0 };
            config.world.wind = Wind { mean_m_s: [WIND_M_S, 0.0, 0.0], ..Wind::default() };
        }
        Plant::new(config).ok()
    }

    /// Cable counted from one state of rest to another, in the metres of the robot.
    fn counted_m(&self, from: &Plant, to: &Plant, cable: usize, scale: f64) -> f64 {
        let world = &self.plant.world.cables[cable];
        let mut counted_m = to.lengths_m()[cable] - from.lengths_m()[cable];
        if world.counts_stretched {
            let mean_n = 0.5 * (from.tensions_n()[cable] + to.tensions_n()[cable]);
            counted_m *= 1.0 + mean_n / world.line.unwrap_or(self.plant.line).stiffness_n;
        }
        counted_m * world.count_scale * (1.0 - self.plant.idlers[cable].slip) / scale
    }

    /// RMS of the node error over the workspace with this model.
    fn node_error_m(&self, anchors_m: &[[f64; 3]], radii_m: &[f64], scale: f64, weather: bool) -> Option<f64> {
        let mut robot = self.file.robot().unwrap().with_anchors(Anchors::new(anchors_m).ok()?).ok()?;
        if !radii_m.is_empty() {
            robot = robot.with_pulleys(radii_m).ok()?;
        }
        let middle = self.middle();
        let zero_m = Vector3::new(middle.x, middle.y, ZERO_HEIGHT * middle.z);
        let (zero, at_zero) = (self.hang(zero_m, false)?, hold(&robot, &zero_m)?);
        let (mut squares, mut count) = (0.0, 0);
        for anchor in &self.drawn.anchors_m {
            for (share, height) in OUTWARD.iter().flat_map(|s| HEIGHTS.map(|h| (*s, h))) {
                let out = (anchor - middle) * share;
                let at_m = Vector3::new(middle.x + out.x, middle.y + out.y, height * middle.z);
                let (Some(there), Some(held)) = (self.hang(at_m, weather), hold(&robot, &at_m)) else { continue };
                let unstretched_m: Vec<f64> = (0..self.drawn.anchors_m.len())
                    .map(|i| {
                        let mut paid_m = self.counted_m(&zero, &there, i, scale);
                        if let Some(ea) = robot.stiffness_n().filter(|_| robot.counts_stretched(i)) {
                            paid_m /= 1.0 + 0.5 * (at_zero.tensions_n[i] + held.tensions_n[i]) / ea;
                        }
                        at_zero.unstretched_m[i] + paid_m
                    })
                    .collect();
                let hung = elastic::equilibrium(&robot, &unstretched_m, &Vector3::zeros(), Some(&at_m)).ok()?;
                squares += (hung.position - at_m).norm_squared();
                count += 1;
            }
        }
        (count > 0).then(|| (squares / f64::from(count)).sqrt())
    }

    fn node_errors(&self, anchors_m: &[[f64; 3]], radii_m: &[f64], scale: f64) -> Option<NodeErrors> {
        let error = |weather| self.node_error_m(anchors_m, radii_m, scale, weather);
        Some(NodeErrors { calm_m: error(false)?, weather_m: error(true)? })
    }

    fn outcome(mut self, points: usize) -> Outcome {
        let plain = self.drawn.measure(points);
        let mut with = plain.clone();
        let ruler_m = (1e3 * self.drawn.radius_m(0)).round() / 1e3;
        self.drawn.state(&mut with, ruler_m, 0.001);
        let known = judge(&with, with.usual_method()).ok().map(|judged| {
            let anchors_m: Vec<[f64; 3]> = serde_json::from_value(judged.value["anchors_m"].clone()).unwrap();
            let radii_m: Vec<f64> = serde_json::from_value(judged.value["pulley_radius_m"].clone()).unwrap();
            let stds = judged.covariance.std_m();
            let coordinates =
                anchors_m.iter().zip(&self.drawn.anchors_m).zip(&stds).flat_map(|((found, truth), std)| {
                    let of = |k: usize| ((found[k] - truth[k]).abs(), 1.96 * std[k]);
                    (0..3).filter(|k| std[*k] > 0.0).map(of).collect::<Vec<_>>()
                });
            let coordinates = coordinates.collect();
            let scale = judged.value["scale"].as_f64().unwrap_or(1.0);
            Known { node: self.node_errors(&anchors_m, &radii_m, scale), coordinates }
        });
        let eyes = MeasurementsFile { pulley: Some(PulleyKind::Eye), ..plain };
        let measured = eyes.measurements(eyes.usual_method()).unwrap();
        let points = calibrate(&measured, eyes.usual_method()).ok();
        let points = points.and_then(|found| self.node_errors(&found.anchors_m, &[], found.scale));
        Outcome { known, points }
    }
}

/// How the robot would hold the node here, by its model.
fn hold(robot: &Robot, at_m: &Vector3<f64>) -> Option<elastic::Realisation> {
    elastic::realise(robot, at_m, &Vector3::zeros(), Distribution::LeastNorm).ok()
}

/// All worlds of a robot, over the cores, with the progress on a terminal.
fn outcomes(name: &str, cables: usize, points: usize) -> Vec<Outcome> {
    let (next, shows) = (AtomicU64::new(SEEDS.start), std::io::stderr().is_terminal());
    let work = || {
        let mut mine = Vec::new();
        loop {
            let seed = next.fetch_add(1, Ordering::Relaxed);
            if seed >= SEEDS.end {
                return mine;
            }
            mine.push(World::new(name, cables, seed).outcome(points));
            if shows {
                let _ = write!(std::io::stderr(), "\r{name}, {cables} cables: world {seed} ");
            }
        }
    };
    let cores = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
    std::thread::scope(|scope| {
        let workers: Vec<_> = (0..cores).map(|_| scope.spawn(work)).collect();
        workers.into_iter().flat_map(|worker| worker.join().unwrap()).collect()
    })
}

#[test]
#[ignore = "takes minutes; docs/measured.md has the results"]
fn calibrated_worlds_state_where_the_node_is() {
    println!(
        "| robot | cables | refused | node RMS, median mm | with weather | point model | with weather | coordinates in their 95 % \
         interval | half-width / error, medians mm | of the worst coordinate |"
    );
    for (name, size, cables, points) in [
        ("demo3", "10 m", 3, 9),
        ("demo4", "10 m", 4, 12),
        ("river4", "30 x 20 m", 3, 9),
        ("river4", "30 x 20 m", 4, 12),
        ("forest4", "80 x 20 m", 3, 9),
        ("forest4", "80 x 20 m", 4, 12),
    ] {
        let all = outcomes(name, cables, points);
        let known: Vec<&Known> = all.iter().filter_map(|o| o.known.as_ref()).collect();
        let refused = all.len() - known.len();
        let coordinates: Vec<(f64, f64)> = known.iter().flat_map(|k| k.coordinates.clone()).collect();
        let inside = coordinates.iter().filter(|(error, half)| error <= half).count() as f64;
        let coverage = inside / coordinates.len() as f64;
        let mm = |values: Vec<f64>| 1e3 * median(&values);
        let node: Vec<NodeErrors> = known.iter().filter_map(|k| k.node).collect();
        let point: Vec<NodeErrors> = all.iter().filter_map(|o| o.points).collect();
        let worst = |of: fn(&(f64, f64)) -> f64| {
            known.iter().map(|k| k.coordinates.iter().map(of).fold(0.0, f64::max)).collect()
        };
        let (worst_half_mm, worst_mm) = (mm(worst(|c| c.1)), mm(worst(|c| c.0)));
        let half_mm = mm(coordinates.iter().map(|c| c.1).collect());
        let error_mm = mm(coordinates.iter().map(|c| c.0).collect());
        let calm_mm = mm(node.iter().map(|e| e.calm_m).collect());
        println!(
            "| {size} | {cables} | {refused} % | {calm_mm:.1} ({} worlds) | {:.1} | {:.1} | {:.1} | {:.1} % | {half_mm:.1} / {error_mm:.1} | {worst_half_mm:.1} / {worst_mm:.1} |",
            node.len(),
            mm(node.iter().map(|e| e.weather_m).collect()),
            mm(point.iter().map(|e| e.calm_m).collect()),
            mm(point.iter().map(|e| e.weather_m).collect()),
            100.0 * coverage,
        );
    }
}
