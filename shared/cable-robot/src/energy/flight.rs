//! The best parabola of a robot as it stands: its limits, its motors, its ground and the boxes it stays out of.

use nalgebra::Vector3;

use super::optimum::{Precision, best};
use super::{Best, Bounds, EnergyError, Hoist, parabola};
use crate::motion::{Cause, Refusal};
use crate::path::Parabola;
use crate::{Distribution, Robot};

/// Simpson's intervals for the answer, and for the scan: 32 leave an error of 5e-5 with the default motor.
const INTERVALS: [usize; 2] = [32, 16];

/// The parabola that loses least in the motors at a constant speed, m/s, with a price on time, W; fast enough to be planned
/// while the robot flies. Ends in a box or below the ground are refused.
pub fn best_parabola(
    robot: &Robot,
    method: Distribution,
    from: &Vector3<f64>,
    to: &Vector3<f64>,
    speed_m_s: f64,
    time_weight_w: f64,
) -> Result<Best, EnergyError> {
    let hoist = Hoist {
        anchors: robot.anchors(),
        planar: false,
        wrench_n: robot.wrench_n(&Vector3::zeros()),
        limits_n: robot.tension_limits_n(),
        method,
        current: robot.motor(),
    };
    super::hoist::check_speed(speed_m_s)?;
    let bounds = Bounds { ground_m: Some(robot.ground_m()), time_weight_w };
    best(from, to, &bounds, |path, precision| {
        let intervals = INTERVALS[usize::from(precision == Precision::Coarse)];
        stays_out(robot, path, intervals)?;
        hoist.integrate(path, speed_m_s, intervals)
    })
}

/// Refuses a path through a box, as a polyline.
fn stays_out(robot: &Robot, path: &Parabola, pieces: usize) -> Result<(), EnergyError> {
    let mut before = path.from;
    for i in 1..=pieces {
        let at = parabola::at_fraction(path, i as f64 / pieces as f64).position;
        if let Some(b) = robot.keep_out().iter().position(|b| b.touches(&before, &at)) {
            let cause = Cause::KeepOut { number: b };
            return Err(Refusal { position: at, path_s_m: (at - path.from).norm(), cause }.into());
        }
        before = at;
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
