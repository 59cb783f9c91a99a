//! `nims plan`: the cost of a move, and the parabola with the least cost, without a running robot.

use crate::config_kind::{self, Planned};
use crate::readable;
use cable_robot::energy::optimum::{Precision, best};
use cable_robot::energy::{Best, Bounds, Cost, EnergyError, WinchEnergy, flight, parabola};
use cable_robot::path::{Lateral, Parabola};
use cable_robot::profile::ProfileLimits;
use cable_robot::{Distribution, Path, Robot, Vector3};
use clap::ValueEnum;
use command::values::{finite, not_negative, point};
use command::{Answer, Failure, Output, points};
use config::Point;
use serde_json::{Value, json};
use std::path::PathBuf;

/// `nims plan`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Robot file, or system file, which also states the lowest voltage of the drives.
    #[arg(long, visible_aliases = ["robot", "system"])]
    pub config: PathBuf,
    /// Start of the move, m.
    #[arg(long, value_name = "X,Y,Z|X,Z", value_parser = point, allow_hyphen_values = true)]
    pub from: Point,
    /// End of the move, m.
    #[arg(long, value_name = "X,Y,Z|X,Z", value_parser = point, allow_hyphen_values = true)]
    pub to: Point,
    /// Shape of the path; default: a line, or with --mu a parabola. A parabola without --mu and a lateral path are
    /// those of least cost.
    #[arg(long, value_enum)]
    pub path: Option<PathKind>,
    /// Sag parameter of the parabola, 1/m.
    #[arg(long, value_name = "PER_M", value_parser = finite, allow_negative_numbers = true)]
    pub mu: Option<f64>,
    /// Cost of a second besides the losses in the motors, W.
    #[arg(long, value_name = "W", value_parser = not_negative, allow_negative_numbers = true, default_value = "0")]
    pub time_weight: f64,
    /// Tension distribution; default: unique for as many cables as degrees of freedom, least-norm for more.
    #[arg(long, value_enum)]
    pub method: Option<Method>,
    /// Cruise speed, m/s; default: the robot's limit.
    #[arg(long, value_name = "M_S", value_parser = finite, allow_negative_numbers = true)]
    pub speed: Option<f64>,
    /// Assume a constant speed without accelerations, as the paper does.
    #[arg(long)]
    pub constant_speed: bool,
}

/// Shape of a path.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum PathKind {
    /// A straight line.
    Line,
    /// A parabola in a vertical plane.
    Parabola,
    /// A curve that also deviates sideways, with the least losses in the motors.
    Lateral,
}

/// Choice among the feasible tensions.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Method {
    /// The only solution (as many cables as degrees of freedom).
    Unique,
    /// Least sum of squares.
    LeastNorm,
    /// Least sum.
    MinSum,
    /// Greatest distance from both limits.
    Safest,
}

/// Intervals of Simpson's rule: for the result, and for the scan.
const INTERVALS: [usize; 2] = [64, 16];

/// Returns the requested tension distribution, or the default of the robot.
pub fn distribution(method: Option<Method>, robot: &Robot) -> Distribution {
    match method {
        None => robot.default_distribution(),
        Some(Method::Unique) => Distribution::Unique,
        Some(Method::LeastNorm) => Distribution::LeastNorm,
        Some(Method::MinSum) => Distribution::MinSum,
        Some(Method::Safest) => Distribution::Safest,
    }
}

/// Runs `nims plan`: computes the cost of the best parabola, the requested path, or the line.
///
/// # Errors
/// A robot file or arguments that cannot be used. An infeasible move is a result, not an error.
pub fn run(args: &Args) -> Answer<Output> {
    let found = plan_move(args)?;
    let words = readable::plan(&found);
    Ok(Output::new(found, words))
}

fn plan_move(args: &Args) -> Answer<Value> {
    let Planned { robot, section, distribution } = config_kind::planned(&args.config)?;
    let speed_m_s = args.speed.unwrap_or(robot.speed_limit_m_s());
    if !(speed_m_s > 0.0 && speed_m_s <= robot.speed_limit_m_s()) {
        return Err(Failure::BadInput(format!(
            "--speed is {speed_m_s} m/s; accepted: above 0 and at most the robot's speed_limit_m_s of {} m/s",
            robot.speed_limit_m_s()
        )));
    }
    if args.path == Some(PathKind::Lateral) && args.mu.is_some() {
        return Err(Failure::BadInput("--mu applies to a parabola only; omit it, or use --path parabola".to_owned()));
    }
    let ends = [points::position(&robot, &args.from)?, points::position(&robot, &args.to)?].map(Vector3::from);
    // As if the lengths were set at the start.
    let robot = robot.with_lengths_set_at(Some(&ends[0]));
    let acceleration_m_s2 = section.acceleration_m_s2.min(robot.acceleration_limit_m_s2());
    let move_cost = MoveCost {
        winch_energy: WinchEnergy {
            anchors: robot.anchors(),
            wrench_n: robot.wrench_n(&Vector3::zeros()),
            drag_n_s2_m2: robot.drag_n_s2_m2(),
            cable_weight_n_m: robot.cable_weight_n_m(),
            limits_n: robot.tension_limits_n(),
            method: args.method.map_or(distribution, |method| self::distribution(Some(method), &robot)),
            current: robot.current(),
        },
        robot: &robot,
        limits: ProfileLimits {
            total_m_s2: robot.acceleration_limit_m_s2(),
            swing_limit_m: section.swing_limit_m,
            ..ProfileLimits::rest_to_rest(speed_m_s, acceleration_m_s2)
        },
        check_step_m: section.check_step_m,
        constant: args.constant_speed,
    };
    let found = match args.path {
        Some(PathKind::Lateral) => move_cost.best_lateral(args, ends),
        _ => move_cost.best(args, ends).map(|best| feasible_json(&best)),
    };
    match found {
        Ok(found) => Ok(found),
        Err(error @ EnergyError::BelowGround { .. }) => Ok(infeasible_json(&error)),
        Err(error) if error.is_of_the_path() => Ok(infeasible_json(&error)),
        Err(error) => Err(Failure::bad(error)),
    }
}

fn infeasible_json(why: &EnergyError) -> Value {
    json!({ "feasible": false, "why": why.to_string() })
}

fn feasible_json(best: &Best) -> Value {
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

/// Computes the cost of a move.
struct MoveCost<'a> {
    winch_energy: WinchEnergy<'a>,
    robot: &'a Robot,
    /// Those of the planner for a mission that states no acceleration.
    limits: ProfileLimits,
    check_step_m: f64,
    /// Quasi-static at constant speed, as in the paper; otherwise from rest to rest with accelerations.
    constant: bool,
}

impl MoveCost<'_> {
    fn best(&self, args: &Args, [from, to]: [Vector3<f64>; 2]) -> Result<Best, EnergyError> {
        let bounds = Bounds { ground_m: Some(self.robot.ground_m()), time_weight_w: args.time_weight };
        let shape = |mu_per_m| Parabola { from, to, mu_per_m };
        match (args.path, args.mu) {
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

    /// Finds the path that also deviates sideways, at constant speed as the planner does; returns the parabola where it
    /// costs less.
    fn best_lateral(&self, args: &Args, [from, to]: [Vector3<f64>; 2]) -> Result<Value, EnergyError> {
        let found = flight::best_lateral(
            self.robot,
            self.winch_energy.method,
            &from,
            &to,
            self.limits.cruise_m_s,
            args.time_weight,
        )?;
        let shape = |mu_per_m| Parabola { from, to, mu_per_m };
        let line = self.cost(&shape(0.0), Precision::Fine).ok();
        let Some((bow, _)) = found.lateral else {
            let mu_per_m = found.parabola.mu_per_m;
            return Ok(feasible_json(&Best { mu_per_m, cost: self.cost(&shape(mu_per_m), Precision::Fine)?, line }));
        };
        let constant = || self.winch_energy.bow_at_constant_speed(&bow, self.limits.cruise_m_s, INTERVALS[0]);
        let cost = self.along(&Path::Lateral(Lateral::new(bow)), Precision::Fine, constant)?;
        let mut value = feasible_json(&Best { mu_per_m: 0.0, cost, line });
        value["mu_per_m"] = Value::Null;
        value["down_m"] = json!(bow.down_m);
        value["side_m"] = json!(bow.side_m);
        Ok(value)
    }

    fn cost(&self, shape: &Parabola, precision: Precision) -> Result<Cost, EnergyError> {
        parabola::check(shape)?;
        let coarse = usize::from(precision == Precision::Coarse);
        self.along(&flight::parabola_or_line(shape), precision, || {
            self.winch_energy.constant_speed(shape, self.limits.cruise_m_s, INTERVALS[coarse])
        })
    }

    /// Checks a path and computes its cost: from rest to rest, or at `constant` speed.
    fn along(
        &self,
        path: &Path,
        precision: Precision,
        constant: impl Fn() -> Result<Cost, EnergyError>,
    ) -> Result<Cost, EnergyError> {
        let (check_step_m, intervals) = match precision {
            Precision::Coarse => (None, INTERVALS[1]),
            Precision::Fine => (Some(self.check_step_m), INTERVALS[0]),
        };
        let from_rest = |limits: &ProfileLimits| {
            flight::flown(self.robot, self.winch_energy.method, path, limits, check_step_m, intervals)
        };
        if self.constant {
            // The path has no start and end: check it at a speed so low that the accelerations vanish.
            let slow =
                ProfileLimits { swing_limit_m: self.limits.swing_limit_m, ..ProfileLimits::rest_to_rest(1e-3, 1e-3) };
            if precision == Precision::Fine {
                from_rest(&slow)?;
            }
            constant()
        } else {
            from_rest(&self.limits)
        }
    }
}
