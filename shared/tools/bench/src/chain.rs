//! `chain`: computing time of a cycle of motor-io, estimator and controller as a share of the period; and the time for
//! tensions, compared with a pseudo-inverse by singular value decomposition.

use super::figures::{Ratio, Spread, record};
use super::flight;
use super::settings::Settings;
use super::watch::Watch;
use bus::clock::now_ns;
use cable_robot::{Distribution, Robot, StructureMatrix, Vector3, tension};
use command::{Answer, Failure};
use controller::Inputs;
use lockstep::{Chain, Cycle, Scenario};
use nalgebra::Matrix3x4;
use runtime::Timing;
use serde::Serialize;
use std::hint::black_box;

/// Number of positions of a flight at which tensions are computed.
const POSES: usize = 64;
/// Number of passes over all positions per flight.
const PASSES: usize = 50;
/// Maximum difference between both methods, N.
const AGREE_N: f64 = 1e-6;
/// Singular values below this count as zero.
const RANK: f64 = 1e-12;

/// Result of `chain`.
#[derive(Debug, Clone, Serialize)]
pub struct ChainResult {
    /// Number of cables.
    pub cables: usize,
    /// Time of a cycle of the whole chain.
    pub ours: Spread,
    /// Median as a share of the period.
    pub median_share: f64,
    /// 99.9 % quantile as a share of the period.
    pub p999_share: f64,
    /// Time for the tensions of four cables.
    pub tensions: Tensions,
}

/// Time for the tensions at one position.
#[derive(Debug, Clone, Serialize)]
pub struct Tensions {
    /// By cable-robot, within the limits of each cable.
    pub ours: Spread,
    /// By pseudo-inverse, without limits.
    pub plain: Spread,
    /// Pseudo-inverse divided by cable-robot.
    pub ratio: Ratio,
}

/// Measures for this many seconds.
///
/// # Errors
/// The benchmark was stopped, or the law or method of the system file cannot be used.
pub fn measure(settings: &Settings, seconds: f64, watch: &mut Watch) -> Answer<ChainResult> {
    let scenario = flight::scenario(settings).map_err(Failure::bad)?;
    let cycles = flight::fly(&scenario).map_err(Failure::not_now)?;
    let poses = Poses::select(&scenario.robot, &cycles)?;
    let (mut ours, mut tensions) = (Timing::new(), [Timing::new(), Timing::new()]);
    let end_ns = now_ns() + (seconds * 1e9) as u64;
    loop {
        feed(&scenario, &cycles, &mut ours)?;
        for _ in 0..PASSES {
            poses.time(&mut tensions);
        }
        watch.update();
        watch.check_stop()?;
        if now_ns() >= end_ns {
            break;
        }
    }
    let ours = Spread::from_timing(&ours);
    let [limited, unlimited] = tensions.map(|timing| Spread::from_timing(&timing).divided(poses.at.len() as u64));
    Ok(ChainResult {
        cables: scenario.robot.cable_count(),
        ours,
        median_share: ours.median_s / scenario.period_s,
        p999_share: ours.p999_s / scenario.period_s,
        tensions: Tensions { ours: limited, plain: unlimited, ratio: Ratio::between(&unlimited, &limited) },
    })
}

/// Runs the whole flight through a new chain and times each cycle.
fn feed(scenario: &Scenario, cycles: &[Cycle], timing: &mut Timing) -> Answer {
    let mut chain = Chain::new(scenario).map_err(Failure::bad)?;
    for cycle in cycles {
        let begin_ns = now_ns();
        black_box(chain.core.decide(&cycle.input));
        black_box(chain.core.observe(&cycle.input));
        black_box(chain.estimator.step(&cycle.state, Some(&cycle.authority)));
        black_box(chain.controller.step(&Inputs {
            estimates: [Some(&cycle.estimate), None],
            motion: Some(&cycle.motion),
            authority: Some(&cycle.authority),
            state: Some(&cycle.state),
        }));
        record(timing, begin_ns, now_ns());
    }
    Ok(())
}

/// Positions at which tensions are computed, and their load.
struct Poses {
    robot: Robot,
    weight_n: Vector3<f64>,
    at: Vec<Vector3<f64>>,
}

impl Poses {
    /// Selects the positions of the flight at which no limit is active, so that both methods have the same solution.
    fn select(robot: &Robot, cycles: &[Cycle]) -> Answer<Self> {
        let weight_n = robot.wrench_n(&Vector3::zeros());
        let all = cycles.iter().step_by((cycles.len() / POSES).max(1)).map(|cycle| Vector3::from(cycle.truth_m));
        let mut poses = Self { robot: *robot, weight_n, at: all.collect() };
        let [low, high] = robot.tension_limits_n();
        let within = |at: &Vector3<f64>| {
            let found = poses.by_pseudo_inverse(at);
            found.is_some_and(|found| found.iter().all(|tension| (low..=high).contains(tension)))
        };
        let at: Vec<Vector3<f64>> = poses.at.iter().copied().filter(within).collect();
        poses.at = at;
        if poses.at.is_empty() || !poses.at.iter().all(|at| poses.difference_n(at) <= AGREE_N) {
            return Err(Failure::NotNow(format!(
                "the tensions at {} positions differ from those of a pseudo-inverse by more than {AGREE_N} N",
                poses.at.len()
            )));
        }
        Ok(poses)
    }

    fn within_limits(&self, at: &Vector3<f64>) -> Option<[f64; 4]> {
        let structure = StructureMatrix::at(self.robot.anchors(), at).ok()?;
        let limits_n = self.robot.tension_limits_n();
        let found = tension::distribute(&structure, &self.weight_n, limits_n, Distribution::LeastNorm).ok()?;
        found.tensions_n.get(..4)?.try_into().ok()
    }

    fn by_pseudo_inverse(&self, at: &Vector3<f64>) -> Option<[f64; 4]> {
        let anchors = self.robot.anchors();
        let pulls = [0, 1, 2, 3].map(|cable| (anchors[cable] - at).normalize());
        let inverse = Matrix3x4::from_columns(&pulls).pseudo_inverse(RANK).ok()?;
        Some((inverse * self.weight_n).into())
    }

    /// Returns the greatest difference between both methods, N.
    fn difference_n(&self, at: &Vector3<f64>) -> f64 {
        let (Some(ours), Some(plain)) = (self.within_limits(at), self.by_pseudo_inverse(at)) else { return f64::NAN };
        ours.iter().zip(plain).fold(0.0, |most: f64, (ours, plain)| most.max((ours - plain).abs()))
    }

    /// Times one pass over all positions with each method.
    fn time(&self, [ours, plain]: &mut [Timing; 2]) {
        let begin_ns = now_ns();
        for at in &self.at {
            black_box(self.within_limits(black_box(at)));
        }
        let between_ns = now_ns();
        for at in &self.at {
            black_box(self.by_pseudo_inverse(black_box(at)));
        }
        record(ours, begin_ns, between_ns);
        record(plain, between_ns, now_ns());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_methods_agree_along_most_of_the_flight() {
        let scenario = flight::scenario(&Settings::default()).unwrap();
        let cycles = flight::fly(&scenario).unwrap();
        let poses = Poses::select(&scenario.robot, &cycles).unwrap();
        assert!(poses.at.len() > POSES / 2, "{}", poses.at.len());
        assert!(poses.at.iter().all(|at| poses.difference_n(at) <= AGREE_N));
    }
}
