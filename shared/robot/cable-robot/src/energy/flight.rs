//! Best parabola and best lateral path of a robot with its limits, motors, ground and keep-out boxes. Positions in m,
//! speed in m/s, the weight of time in W; results in J, s and 1/m. A move that is not possible is an [`EnergyError`].
//!
//! ```
//! use cable_robot::{Distribution, Robot, RobotParts, Vector3, energy::flight::best_parabola};
//! let robot = Robot::new(RobotParts {
//!     anchors_m: vec![[0.0, 0.0, 3.05], [9.9, 0.1, 3.10], [9.8, 8.9, 2.98], [0.1, 9.0, 3.02]],
//!     node_mass_kg: 1.2,
//!     tension_limits_n: [2.0, 60.0],
//!     speed_limit_m_s: 0.4,
//!     acceleration_limit_m_s2: 0.5,
//!     ..RobotParts::default()
//! })?;
//! let (from, to) = (Vector3::new(3.0, 3.0, 2.0), Vector3::new(7.0, 3.0, 2.0));
//! let best = best_parabola(&robot, Distribution::LeastNorm, &from, &to, 0.2, 0.0)?;
//! assert!(best.mu_per_m > 0.0 && best.line.is_some_and(|line| best.cost.energy_j < line.energy_j));
//! // Where a second costs as much as ten joules, the straight line is best, or nearly so.
//! let hurried = best_parabola(&robot, Distribution::LeastNorm, &from, &to, 0.2, 10.0)?;
//! assert!(hurried.mu_per_m < best.mu_per_m);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

use nalgebra::Vector3;

use super::lateral::check_ground;
use super::optimum::{Precision, best};
use super::{Best, BestLateral, Bounds, Cost, EnergyError, WinchEnergy, lateral, parabola};
use crate::motion::{Cause, Refusal};
use crate::profile::ProfileLimits;
use crate::{Distribution, Path, Profile, Robot, Segment, path, swing};

/// Longest step of the check for obstacles, m: cables are kept away by the step in addition to the clearance.
const OBSTACLE_STEP_M: f64 = 0.05;

/// Simpson intervals for the result and for the scan: 32 have an error of 5e-5 with the default motor.
const INTERVALS: [usize; 2] = [32, 16];

/// Computes the parabola with the least motor loss at a constant speed, m/s, with a weight on time. It is fast enough
/// to be planned while the robot moves. Rejects ends inside a box or below the ground.
pub fn best_parabola(
    robot: &Robot,
    method: Distribution,
    from: &Vector3<f64>,
    to: &Vector3<f64>,
    speed_m_s: f64,
    time_weight_w: f64,
) -> Result<Best, EnergyError> {
    let winch_energy = winch_energy(robot, method);
    super::winch_energy::check_speed(speed_m_s)?;
    best(from, to, &bounds(robot, time_weight_w), |path, precision| {
        let intervals = INTERVALS[usize::from(precision == Precision::Coarse)];
        if precision == Precision::Fine {
            check_keep_out(robot, method, |u| parabola::at_fraction(path, u).position, intervals)?;
        }
        winch_energy.integrate(path, speed_m_s, intervals)
    })
}

/// Computes the path of three vertical and three sideways harmonics with the least motor loss, like [`best_parabola`].
/// It takes some hundred times as long as a parabola: only for a node at rest.
pub fn best_lateral(
    robot: &Robot,
    method: Distribution,
    from: &Vector3<f64>,
    to: &Vector3<f64>,
    speed_m_s: f64,
    time_weight_w: f64,
) -> Result<BestLateral, EnergyError> {
    let parabola = best_parabola(robot, method, from, to, speed_m_s, time_weight_w)?;
    if robot.is_planar() {
        return Ok(BestLateral::without_bow(parabola));
    }
    let (winch_energy, bounds) = (winch_energy(robot, method), bounds(robot, time_weight_w));
    Ok(lateral::best(from, to, &bounds, parabola, |bow, precision| {
        let intervals = INTERVALS[usize::from(precision == Precision::Coarse)];
        check_ground(bow, &bounds, intervals)?;
        check_keep_out(robot, method, |u| bow.at_fraction(u).position, intervals)?;
        winch_energy.integrate_bow(bow, speed_m_s, intervals)
    }))
}

/// Computes the parabola with the least motor loss from rest to rest with the accelerations of `limits`. Considers only
/// parabolas that pass the check of a whole segment, at points at most `check_step_m` apart: tensions under
/// acceleration, lengths, speeds, ground and boxes.
pub fn best_flown_parabola(
    robot: &Robot,
    method: Distribution,
    from: &Vector3<f64>,
    to: &Vector3<f64>,
    limits: &ProfileLimits,
    check_step_m: f64,
    time_weight_w: f64,
) -> Result<Best, EnergyError> {
    best(from, to, &bounds(robot, time_weight_w), |shape, precision| {
        parabola::check(shape)?;
        let (check_step_m, intervals) = match precision {
            Precision::Coarse => (None, INTERVALS[1]),
            Precision::Fine => (Some(check_step_m), INTERVALS[0]),
        };
        flown(robot, method, &parabola_or_line(shape), limits, check_step_m, intervals)
    })
}

/// Returns a parabola as a path: a line where the sag is 0 and for vertical moves.
pub fn parabola_or_line(shape: &path::Parabola) -> Path {
    let straight = shape.mu_per_m == 0.0 || parabola::is_vertical(shape);
    if straight { Path::line(shape.from, shape.to) } else { Path::Parabola(*shape) }
}

/// Checks a path with a speed profile within `limits`, at points at most `check_step_m` apart, and computes its cost
/// with about `intervals` Simpson intervals. Without a step, only the tensions at the points of these are checked.
pub fn flown(
    robot: &Robot,
    method: Distribution,
    path: &Path,
    limits: &ProfileLimits,
    check_step_m: Option<f64>,
    intervals: usize,
) -> Result<Cost, EnergyError> {
    let profile = Profile::plan(path, limits).map_err(|_| EnergyError::InvalidArgument {
        what: "the speed of the move",
        value: limits.cruise_m_s,
        accepted: "a speed that the length and the acceleration limit allow",
    })?;
    let profile = swing::shaped(robot, method, path, profile, limits.swing_limit_m);
    let segment = Segment { id: 0, path: *path, profile, start_s: 0.0 };
    if let Some(step_m) = check_step_m {
        segment.check(robot, method, step_m)?;
    }
    winch_energy(robot, method).along_profile(path, &profile, robot.node_mass_kg(), intervals)
}

/// Computes the cost of a path with a speed profile; for a dwell, the cost of holding. For estimates before a mission.
pub fn along(robot: &Robot, method: Distribution, path: &Path, profile: &Profile) -> Result<Cost, EnergyError> {
    winch_energy(robot, method).along_profile(path, profile, robot.node_mass_kg(), INTERVALS[1])
}

fn winch_energy(robot: &Robot, method: Distribution) -> WinchEnergy<'_> {
    WinchEnergy {
        anchors: robot.anchors(),
        wrench_n: robot.wrench_n(&Vector3::zeros()),
        drag_n_s2_m2: robot.drag_n_s2_m2(),
        cable_weight_n_m: robot.cable_weight_n_m(),
        limits_n: robot.tension_limits_n(),
        method,
        current: robot.current(),
    }
}

fn bounds(robot: &Robot, time_weight_w: f64) -> Bounds {
    Bounds { ground_m: Some(robot.ground_m()), time_weight_w }
}

/// Rejects a path through a box; the path is approximated by a polyline.
fn check_keep_out(
    robot: &Robot,
    method: Distribution,
    at: impl Fn(f64) -> Vector3<f64>,
    pieces: usize,
) -> Result<(), EnergyError> {
    let from = at(0.0);
    let mut before = from;
    for i in 1..=pieces {
        let position = at(i as f64 / pieces as f64);
        if let Some(b) = robot.keep_out().iter().position(|b| b.touches(&before, &position)) {
            let cause = Cause::KeepOut { number: b };
            return Err(Refusal { position, path_s_m: (position - from).norm(), cause }.into());
        }
        before = position;
    }
    check_obstacles(robot, method, at, pieces)
}

/// Rejects a path on which the node or a cable would touch an obstacle, in steps of at most [`OBSTACLE_STEP_M`].
fn check_obstacles(
    robot: &Robot,
    method: Distribution,
    at: impl Fn(f64) -> Vector3<f64>,
    pieces: usize,
) -> Result<(), EnergyError> {
    if robot.obstacles().next().is_none() {
        return Ok(());
    }
    let from = at(0.0);
    let mut before = from;
    for i in 0..pieces {
        let way_m = (at((i + 1) as f64 / pieces as f64) - before).norm();
        let steps = (way_m / OBSTACLE_STEP_M).ceil().max(1.0);
        for k in 1..=steps as usize {
            let position = at((i as f64 + k as f64 / steps) / pieces as f64);
            if let Some(contact) = robot.contact(&before, &position, method) {
                let cause = Cause::Obstacle { contact, clearance_m: robot.obstacle_margin_m(&position, method) };
                return Err(Refusal { position, path_s_m: (position - from).norm(), cause }.into());
            }
            before = position;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::RobotParts;

    fn robot(keep_out_m: Vec<[[f64; 3]; 2]>) -> Robot {
        Robot::new(RobotParts {
            anchors_m: vec![[0.0, 0.0, 3.05], [9.9, 0.1, 3.10], [9.8, 8.9, 2.98], [0.1, 9.0, 3.02]],
            node_mass_kg: 1.2,
            tension_limits_n: [2.0, 60.0],
            speed_limit_m_s: 0.4,
            acceleration_limit_m_s2: 0.5,
            ground_m: 0.1,
            keep_out_m,
            ..RobotParts::default()
        })
        .unwrap()
    }

    #[test]
    fn a_lateral_path_costs_less_and_keeps_to_ground_and_boxes() {
        let (from, to) = (Vector3::new(3.0, 3.0, 2.0), Vector3::new(7.0, 3.0, 2.0));
        let find = |robot: &Robot| best_lateral(robot, Distribution::LeastNorm, &from, &to, 0.2, 0.0).unwrap();
        let free = find(&robot(Vec::new()));
        let (bow, cost) = free.lateral.unwrap();
        assert!(cost.energy_j < 0.95 * free.parabola.cost.energy_j, "{free:?}");
        assert!((0..=1000).all(|i| bow.at_fraction(f64::from(i) / 1000.0).position.z >= 0.1));
        // A box on the side of the swing.
        let swing = bow.at_fraction(0.5).position.y;
        let (low, high) = if swing > 3.0 { (3.2, 6.0) } else { (0.0, 2.8) };
        let boxed = find(&robot(vec![[[4.0, low, 0.0], [6.0, high, 3.0]]]));
        if let Some((other, other_cost)) = boxed.lateral {
            assert!(other_cost.energy_j > cost.energy_j * 0.999, "{other:?}");
            let through = |u: f64| {
                let at = other.at_fraction(u).position;
                (4.02..5.98).contains(&at.x) && at.y > low + 0.02 && at.y < high - 0.02
            };
            assert!(!(0..=1000).any(|i| through(f64::from(i) / 1000.0)), "{other:?}");
        }
    }

    #[test]
    fn a_box_below_the_line_limits_the_sag() {
        let (from, to) = (Vector3::new(3.0, 3.0, 2.0), Vector3::new(7.0, 3.0, 2.0));
        let best = |robot: &Robot| best_parabola(robot, Distribution::LeastNorm, &from, &to, 0.2, 0.0).unwrap();
        let free = best(&robot(Vec::new()));
        let boxed = best(&robot(vec![[[4.5, 2.5, 0.0], [5.5, 3.5, 1.7]]]));
        assert!(free.mu_per_m > 0.1 && boxed.mu_per_m > 0.0, "{free:?}");
        let sag = 4.0 * boxed.mu_per_m;
        assert!(sag < 0.33, "{sag}");
        assert!(boxed.cost.energy_j > free.cost.energy_j && boxed.cost.energy_j < boxed.line.unwrap().energy_j);
        let error = best_parabola(
            &robot(vec![[[4.5, 2.5, 0.0], [5.5, 3.5, 3.0]]]),
            Distribution::LeastNorm,
            &from,
            &to,
            0.2,
            0.0,
        );
        assert_eq!(error.unwrap_err().kind(), "infeasible");
    }
}
