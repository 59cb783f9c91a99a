//! `nims plan`: what a move costs, and the parabola that costs least, without a running robot.

use crate::cli::{Method, PathKind, Plan};
use crate::failure::{Answer, Failure};
use cable_robot::energy::optimum::{Precision, best};
use cable_robot::energy::{Best, Bounds, Cost, EnergyError, Hoist, parabola};
use cable_robot::path::Parabola;
use cable_robot::profile::{Profile, ProfileLimits};
use cable_robot::{Distribution, Path, Robot, Segment, Vector3};
use serde_json::{Value, json};
use service::config::RobotFile;

/// Simpson's intervals for the answer, and for the scan.
const INTERVALS: [usize; 2] = [64, 16];

/// Step of the check of the whole move, m, for the answer, and for the scan.
const CHECK_M: [f64; 2] = [0.01, 0.1];

/// How tensions are chosen, from what was asked for.
pub fn distribution(method: Option<Method>, robot: &Robot) -> Distribution {
    match method {
        None => Distribution::default_for(robot.cable_count()),
        Some(Method::Unique) => Distribution::Unique,
        Some(Method::LeastNorm) => Distribution::LeastNorm,
        Some(Method::MinSum) => Distribution::MinSum,
        Some(Method::Safest) => Distribution::Safest,
    }
}

/// Plans the move: the best parabola, the one asked for, or the line.
///
/// # Errors
/// A robot file or arguments that cannot be used. A move that cannot be flown is an answer.
pub fn plan(asked: &Plan) -> Answer<Value> {
    let robot = RobotFile::load(&asked.config).map_err(Failure::bad)?.robot().map_err(Failure::bad)?;
    let speed_m_s = asked.speed.unwrap_or(robot.speed_limit_m_s());
    if !(speed_m_s > 0.0 && speed_m_s <= robot.speed_limit_m_s()) {
        return Err(Failure::BadInput(format!(
            "--speed is {speed_m_s} m/s; accepted: above 0 and at most the robot's speed_limit_m_s of {} m/s",
            robot.speed_limit_m_s()
        )));
    }
    let reckoning = Reckoning {
        hoist: Hoist {
            anchors: robot.anchors(),
            planar: false,
            wrench_n: robot.wrench_n(&Vector3::zeros()),
            limits_n: robot.tension_limits_n(),
            method: distribution(asked.method, &robot),
            current: robot.motor(),
        },
        robot: &robot,
        speed_m_s,
        constant: asked.constant_speed,
    };
    match reckoning.best(asked) {
        Ok(best) => Ok(words(&best)),
        Err(error @ EnergyError::BelowGround { .. }) => Ok(impossible(&error)),
        Err(error) if error.is_of_the_path() => Ok(impossible(&error)),
        Err(error) => Err(Failure::bad(error)),
    }
}

fn impossible(why: &EnergyError) -> Value {
    json!({ "feasible": false, "why": why.to_string() })
}

fn words(best: &Best) -> Value {
    let Cost { energy_j, duration_s, length_m, peak_tension_n, peak_current_a, margin_n } = best.cost;
    json!({
        "feasible": true,
        "mu_per_m": best.mu_per_m,
        "length_m": length_m,
        "duration_s": duration_s,
        "energy_j": energy_j,
        "mean_power_w": best.cost.mean_power_w(),
        "peak_tension_n": peak_tension_n,
        "peak_current_a": peak_current_a,
        "margin_n": margin_n,
        "line_energy_j": best.line.map(|line| line.energy_j),
        "line_duration_s": best.line.map(|line| line.duration_s),
    })
}

/// How a move is reckoned.
struct Reckoning<'a> {
    hoist: Hoist<'a>,
    robot: &'a Robot,
    speed_m_s: f64,
    /// Quasi-static at constant speed, as the paper has it; otherwise from rest to rest with its accelerations.
    constant: bool,
}

impl Reckoning<'_> {
    fn best(&self, asked: &Plan) -> Result<Best, EnergyError> {
        let (from, to) = (Vector3::from(asked.from.0), Vector3::from(asked.to.0));
        let bounds = Bounds { ground_m: Some(self.robot.ground_m()), time_weight_w: asked.time_weight };
        let shape = |mu_per_m| Parabola { from, to, mu_per_m };
        match (asked.path, asked.mu) {
            (Some(PathKind::Parabola), None) => best(&from, &to, &bounds, |path, precision| self.cost(path, precision)),
            (_, mu) => {
                parabola::mu_limit(&from, &to, self.robot.ground_m())?;
                let mu_per_m = mu.unwrap_or(0.0);
                let line = self.cost(&shape(0.0), Precision::Fine);
                let cost = self.cost(&shape(mu_per_m), Precision::Fine)?;
                Ok(Best { mu_per_m, cost, line: line.ok() })
            }
        }
    }

    fn cost(&self, shape: &Parabola, precision: Precision) -> Result<Cost, EnergyError> {
        parabola::check(shape)?;
        let coarse = usize::from(precision == Precision::Coarse);
        let straight = parabola::is_vertical(shape) || shape.mu_per_m == 0.0;
        let path = if straight { Path::line(shape.from, shape.to) } else { Path::Parabola(*shape) };
        // A constant speed has no start and no end: it is checked as slowly as makes no accelerations.
        let limits = if self.constant {
            ProfileLimits::rest_to_rest(1e-3, 1e-3)
        } else {
            ProfileLimits::rest_to_rest(self.speed_m_s, self.robot.acceleration_limit_m_s2())
        };
        let profile = Profile::plan(&path, &limits).map_err(|_| EnergyError::InvalidArgument {
            what: "the speed of the move",
            value: self.speed_m_s,
            accepted: "a speed that the length and the acceleration limit allow",
        })?;
        let segment = Segment { id: 0, path, profile, start_s: 0.0 };
        segment.check(self.robot, self.hoist.method, CHECK_M[coarse])?;
        if self.constant {
            self.hoist.constant_speed(shape, self.speed_m_s, INTERVALS[coarse])
        } else {
            self.hoist.along_profile(&path, &profile, self.robot.node_mass_kg(), INTERVALS[coarse])
        }
    }
}
