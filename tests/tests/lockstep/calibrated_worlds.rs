//! What a guided calibration is worth to the node: drawn worlds of each size, calibrated by a script with human errors,
//! then zeroed once in the middle. The node then hangs at places over the workspace, in the plant at rest, and the
//! robot computes from its counts where it is.
//!
//! The intervals are those of a robot that knows that nothing has warmed or crept since it was zeroed, as it is here,
//! and beside them those with the `expansion` of its file.
//!
//! Takes minutes, so it runs by hand:
//! `cargo test --workspace --test lockstep calibrated_worlds -- --ignored --nocapture`.

use crate::calibrations::{DrawnRobot, median};
use cable_robot::{Anchors, Distribution, Robot, Uncertainty, Vector3, elastic};
use calibration::{LengthCovariance, calibrate};
use commissioning::calibrate::{CalibrationResult, MeasurementsFile, judge};
use config::{CalibrationFile, PulleyKind, RobotFile, SystemFile};
use motor_box::BoxConfig;
use nims_truth::Args;
use plant::world::{Warming, Wind};
use plant::{Plant, PlantConfig};
use std::io::{IsTerminal, Write};
use std::path::Path;

/// First world of each robot, unless `NIMS_SEED` gives another one. No tolerance was chosen in these worlds.
const FIRST_SEED: u64 = 1001;

/// Number of worlds, unless `NIMS_WORLDS` gives another one.
const WORLDS: u64 = 100;

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
#[derive(Debug, Clone)]
struct NodeErrors {
    calm_m: f64,
    weather_m: f64,
    /// Of each coordinate at each place without weather.
    coordinates: Vec<NodeCoordinate>,
}

/// A coordinate of the node.
#[derive(Debug, Clone, Copy)]
struct NodeCoordinate {
    error_m: f64,
    /// What the robot states if it knows that nothing has warmed or crept since its lengths were set, m.
    at_once_half_m: f64,
    /// What it states as its file is, m.
    half_m: f64,
}

/// One 95 % half-width of a normal error, in standard deviations.
const HALF_WIDTH_95: f64 = 1.96;

/// Results in one world.
struct Outcome {
    /// None if the calibration was refused.
    known: Option<Known>,
    /// The point model: wheels taken for eyes, and no test of the result.
    points: Option<NodeErrors>,
}

struct Known {
    node: Option<NodeErrors>,
    /// Each free coordinate of the anchors.
    coordinates: Vec<Coordinate>,
}

/// A coordinate of an anchor: x or y (`level`), or a height.
#[derive(Debug, Clone, Copy)]
struct Coordinate {
    level: bool,
    error_m: f64,
    half_m: f64,
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
        // What the idlers of these worlds do, and a robot file has to say.
        file.lines.counts_stretched = config::CountsStretched::All(true);
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

    /// RMS of the node error over the workspace with this model, and error and stated half-width of each coordinate.
    fn node_error_m(&self, robot: &Robot, scale: f64, weather: bool) -> Option<(f64, Vec<NodeCoordinate>)> {
        let middle = self.middle();
        let zero_m = Vector3::new(middle.x, middle.y, ZERO_HEIGHT * middle.z);
        let (zero, at_zero) = (self.hang(zero_m, false)?, hold(robot, &zero_m)?);
        let errors_at_zero = robot.uncertainty().length_errors_at(robot, &zero_m, &at_zero.tensions_n);
        let (mut squares, mut count, mut coordinates) = (0.0, 0, Vec::new());
        for anchor in &self.drawn.anchors_m {
            for (share, height) in OUTWARD.iter().flat_map(|s| HEIGHTS.map(|h| (*s, h))) {
                let out = (anchor - middle) * share;
                let at_m = Vector3::new(middle.x + out.x, middle.y + out.y, height * middle.z);
                let (Some(there), Some(held)) = (self.hang(at_m, weather), hold(robot, &at_m)) else { continue };
                let unstretched_m: Vec<f64> = (0..self.drawn.anchors_m.len())
                    .map(|i| {
                        let mut paid_m = self.counted_m(&zero, &there, i, scale);
                        if let Some(ea) = robot.stiffness_n().filter(|_| robot.counts_stretched(i)) {
                            paid_m /= 1.0 + 0.5 * (at_zero.tensions_n[i] + held.tensions_n[i]) / ea;
                        }
                        at_zero.unstretched_m[i] + paid_m
                    })
                    .collect();
                let hung = elastic::equilibrium(robot, &unstretched_m, &Vector3::zeros(), Some(&at_m)).ok()?;
                squares += (hung.position - at_m).norm_squared();
                count += 1;
                let half_m = |uncertainty: &Uncertainty| {
                    let covariance_m2 = uncertainty.covariance_m2(robot, &hung, Some(&errors_at_zero));
                    [0, 1, 2].map(|k| HALF_WIDTH_95 * covariance_m2[(k, k)].sqrt())
                };
                let stated_m = half_m(robot.uncertainty());
                let at_once_m = half_m(&Uncertainty { expansion: 0.0, ..*robot.uncertainty() });
                coordinates.extend((0..3).map(|k| NodeCoordinate {
                    error_m: (hung.position - at_m)[k].abs(),
                    at_once_half_m: at_once_m[k],
                    half_m: stated_m[k],
                }));
            }
        }
        (count > 0).then(|| ((squares / f64::from(count)).sqrt(), coordinates))
    }

    fn node_errors(&self, robot: &Robot, scale: f64) -> Option<NodeErrors> {
        let (calm_m, coordinates) = self.node_error_m(robot, scale, false)?;
        Some(NodeErrors { calm_m, weather_m: self.node_error_m(robot, scale, true)?.0, coordinates })
    }

    /// The robot with these anchors and pulleys, and with a calibration if there is one.
    fn robot(&self, anchors_m: &[[f64; 3]], radii_m: &[f64], judged: Option<&CalibrationResult>) -> Option<Robot> {
        let mut file = self.file.clone();
        file.calibration = judged.map(|judged| CalibrationFile {
            method: String::new(),
            date: String::new(),
            verdict: String::new(),
            anchors_m: anchors_m.to_vec(),
            covariance_m2: judged.covariance.rows(),
            length_covariance: judged.lengths.as_ref().map_or_else(Vec::new, LengthCovariance::rows),
            scale: 1.0,
            scale_std: 0.0,
            counts_per_m: None,
            pulley: None,
            pulley_radius_m: radii_m.to_vec(),
            cable_scale: Vec::new(),
        });
        let robot = file.robot().ok()?.with_anchors(Anchors::new(anchors_m).ok()?).ok()?;
        if radii_m.is_empty() { Some(robot) } else { robot.with_pulleys(radii_m).ok() }
    }

    fn outcome(mut self, points: usize) -> Outcome {
        let plain = self.drawn.measure(points);
        let mut with = plain.clone();
        let ruler_m = (1e3 * self.drawn.radius_m(0)).round() / 1e3;
        self.drawn.state(&mut with, ruler_m, 0.001);
        // The lengths are the robot's own.
        with.counts_per_m = Some(self.drawn.believed_counts[..self.drawn.anchors_m.len()].to_vec());
        let known = judge(&with, with.usual_method()).ok().map(|judged| {
            let anchors_m: Vec<[f64; 3]> = serde_json::from_value(judged.value["anchors_m"].clone()).unwrap();
            let radii_m: Vec<f64> = serde_json::from_value(judged.value["pulley_radius_m"].clone()).unwrap();
            let stds = judged.covariance.std_m();
            let coordinates =
                anchors_m.iter().zip(&self.drawn.anchors_m).zip(&stds).flat_map(|((found, truth), std)| {
                    let of = |k: usize| Coordinate {
                        level: k < 2,
                        error_m: (found[k] - truth[k]).abs(),
                        half_m: HALF_WIDTH_95 * std[k],
                    };
                    (0..3).filter(|k| std[*k] > 0.0).map(of).collect::<Vec<_>>()
                });
            let coordinates = coordinates.collect();
            let scale = judged.value["scale"].as_f64().unwrap_or(1.0);
            let robot = self.robot(&anchors_m, &radii_m, Some(&judged));
            Known { node: robot.and_then(|robot| self.node_errors(&robot, scale)), coordinates }
        });
        let eyes = MeasurementsFile { pulley: Some(PulleyKind::Eye), ..plain };
        let measured = eyes.measurements(eyes.usual_method()).unwrap();
        let points = calibrate(&measured, eyes.usual_method()).ok();
        let points = points.and_then(|found| self.node_errors(&self.robot(&found.anchors_m, &[], None)?, found.scale));
        Outcome { known, points }
    }
}

/// How the robot would hold the node here, by its model.
fn hold(robot: &Robot, at_m: &Vector3<f64>) -> Option<elastic::Realisation> {
    elastic::realise(robot, at_m, &Vector3::zeros(), Distribution::LeastNorm).ok()
}

/// All worlds of a robot, over the cores, with the progress on a terminal.
fn outcomes(name: &str, cables: usize, points: usize) -> Vec<Outcome> {
    let shows = std::io::stderr().is_terminal();
    let number = |name: &str, usual: u64| std::env::var(name).map_or(usual, |text| text.parse().unwrap());
    let first = number("NIMS_SEED", FIRST_SEED);
    let seeds: Vec<u64> = (first..first + number("NIMS_WORLDS", WORLDS)).collect();
    command::parallel(&seeds, command::processors(), |&seed| {
        let outcome = World::new(name, cables, seed).outcome(points);
        if shows {
            let _ = write!(std::io::stderr(), "\r{name}, {cables} cables: world {seed} ");
        }
        outcome
    })
}

#[test]
#[ignore = "takes minutes; docs/measured.md has the results"]
fn calibrated_worlds_state_where_the_node_is() {
    println!(
        "| robot | cables | refused | node RMS, median mm | with weather | point model | with weather |\n  \
         | robot | cables | coordinates | in their 95 % interval | half-width, median mm | error, median mm | ratio | RMS of error / stated |"
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
        let node: Vec<&NodeErrors> = known.iter().filter_map(|k| k.node.as_ref()).collect();
        let point: Vec<&NodeErrors> = all.iter().filter_map(|o| o.points.as_ref()).collect();
        let rms = |of: &[&NodeErrors], error: fn(&NodeErrors) -> f64| {
            1e3 * median(&of.iter().map(|e| error(e)).collect::<Vec<f64>>())
        };
        println!(
            "| {size} | {cables} | {refused} % | {:.1} ({} worlds) | {:.1} | {:.1} | {:.1} |",
            rms(&node, |e| e.calm_m),
            node.len(),
            rms(&node, |e| e.weather_m),
            rms(&point, |e| e.calm_m),
            rms(&point, |e| e.weather_m),
        );
        let anchors = |level: bool| {
            let of = known.iter().flat_map(|k| &k.coordinates);
            of.filter(|c| c.level == level).map(|c| (c.error_m, c.half_m)).collect::<Vec<_>>()
        };
        let node = |level: bool, half_m: fn(&NodeCoordinate) -> f64| {
            let of = node.iter().flat_map(|n| n.coordinates.chunks(3));
            let of = of.flat_map(|at| if level { at[..2].to_vec() } else { at[2..].to_vec() });
            of.map(|c| (c.error_m, half_m(&c))).collect::<Vec<_>>()
        };
        interval_row(size, cables, "anchors, x and y", &anchors(true));
        interval_row(size, cables, "anchors, heights", &anchors(false));
        interval_row(size, cables, "node, x and y", &node(true, |c| c.at_once_half_m));
        interval_row(size, cables, "node, height", &node(false, |c| c.at_once_half_m));
        interval_row(size, cables, "node, x and y, with expansion", &node(true, |c| c.half_m));
        interval_row(size, cables, "node, height, with expansion", &node(false, |c| c.half_m));
    }
}

/// Prints how often 95 % intervals hold the truth, how wide they are beside the errors, and the RMS of the errors in
/// stated standard deviations, which is 1 if what is stated is right.
fn interval_row(size: &str, cables: usize, what: &str, all: &[(f64, f64)]) {
    let inside = all.iter().filter(|(error, half)| error <= half).count() as f64 / all.len() as f64;
    let squares = all.iter().map(|(error, half)| (error / half * HALF_WIDTH_95).powi(2)).sum::<f64>();
    let rms = (squares / all.len() as f64).sqrt();
    let error_mm = 1e3 * median(&all.iter().map(|c| c.0).collect::<Vec<f64>>());
    let half_mm = 1e3 * median(&all.iter().map(|c| c.1).collect::<Vec<f64>>());
    println!(
        "  | {size} | {cables} | {what} | {:.1} % | {half_mm:.1} | {error_mm:.1} | {:.1} | {rms:.2} |",
        100.0 * inside,
        half_mm / error_mm
    );
}
