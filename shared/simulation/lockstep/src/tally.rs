//! What a flight amounts to, added up over its cycles.

use anyhow::{Context, Result, ensure};
use cable_robot::Vector3;
use messages::{CABLES, MotorAuthority};
use segments::motion_of;

use crate::flight::{Cycle, Deviation, Flight};

/// Accumulates distances.
#[derive(Debug, Clone, Copy, Default)]
struct Sum {
    squares: f64,
    max: f64,
    count: u64,
}

impl Sum {
    fn add(&mut self, value: f64) {
        self.squares += value * value;
        self.max = self.max.max(value.abs());
        self.count += 1;
    }

    fn rms(&self) -> f64 {
        if self.count == 0 { 0.0 } else { (self.squares / self.count as f64).sqrt() }
    }

    fn deviation(&self) -> Deviation {
        Deviation { rms_m: self.rms(), max_m: self.max }
    }
}

/// Accumulates a flight.
#[derive(Debug, Default)]
pub(crate) struct Tally {
    estimate: Sum,
    truth: Sum,
    between: Sum,
    stated: Sum,
    velocity: Sum,
    tension: Sum,
    covered: u64,
    share: f64,
    range_n: Option<[f64; 2]>,
    slack: u64,
    saturation: f64,
    step_m_s: f64,
    sent_m_s: Option<[f64; CABLES]>,
    /// Energy of all motors at the first and at the last cycle, J.
    energy_j: Option<[f64; 2]>,
    last: Option<[[f64; 3]; 2]>,
}

impl Tally {
    /// Adds a cycle; only those in which the setpoint moves count for the deviations.
    pub fn add(&mut self, cycle: &Cycle) -> Result<()> {
        let authority = &cycle.authority;
        let energy_j: f64 = cycle.energy.energy_j.iter().sum();
        self.energy_j = Some([self.energy_j.map_or(energy_j, |[first, _]| first), energy_j]);
        if let Some(before) = self.sent_m_s.replace(cycle.sent_m_s) {
            let steps = cycle.sent_m_s.iter().zip(before).map(|(now, before)| (now - before).abs());
            self.step_m_s = steps.fold(self.step_m_s, f64::max);
        }
        // Evaluate the setpoint at the time at which the truth was sampled.
        let since_s = (cycle.state.header.stamp_ns - cycle.input.begin_ns) as f64 * 1e-9;
        let time_s = authority.plan_time_s + authority.plan_rate * since_s;
        let moving = motion_of(&cycle.motion).map(|motion| motion.setpoint(time_s));
        let Some(setpoint) = moving else { return Ok(()) };
        if authority.mode != MotorAuthority::MODE_FOLLOWING || setpoint.at_rest {
            return Ok(());
        }
        ensure!(cycle.estimate.valid == 1, "the estimate of cycle {} is not valid", authority.header.cycle);
        let (actual, estimated) = (Vector3::from(cycle.truth_m), Vector3::from(cycle.estimate.position_m));
        self.estimate.add((estimated - setpoint.position).norm());
        self.truth.add((actual - setpoint.position).norm());
        self.between.add((actual - estimated).norm());
        self.covered += u64::from(cycle.covers_truth());
        self.stated.add(cycle.stated_m());
        self.velocity.add((Vector3::from(cycle.truth_m_s) - Vector3::from(cycle.estimate.velocity_m_s)).norm());
        self.saturation = self.saturation.max(cycle.control.saturation);
        for (true_n, chosen) in cycle.truth_n.iter().zip(&cycle.control.tension_n) {
            let error = true_n - chosen;
            self.tension.add(error);
            self.share = self.share.max(error.abs() / (0.15 * chosen).max(2.0));
            let [low, high] = self.range_n.unwrap_or([f64::INFINITY, 0.0]);
            self.range_n = Some([low.min(*true_n), high.max(*true_n)]);
        }
        self.slack += u64::from(cycle.truth_n.iter().any(|t| *t <= 0.0));
        self.last = Some([cycle.truth_m, setpoint.position.into()]);
        Ok(())
    }

    /// Closes the flight after so many cycles, of which `cycle` is the last.
    pub fn finish(self, cycles: u64, cycle: &Cycle) -> Result<Flight> {
        let [first_j, last_j] = self.energy_j.unwrap_or_default();
        Ok(Flight {
            moving_cycles: self.estimate.count,
            cycles,
            estimate: self.estimate.deviation(),
            truth: self.truth.deviation(),
            between: self.between.deviation(),
            covered: self.covered as f64 / self.estimate.count as f64,
            stated: self.stated.deviation(),
            velocity_rms_m_s: self.velocity.rms(),
            tension_max_n: self.tension.max,
            tension_rms_n: self.tension.rms(),
            tension_share: self.share,
            tension_range_n: self.range_n.unwrap_or_default(),
            slack_cycles: self.slack,
            unsteered: cycle.authority.unsteered(),
            saturation: self.saturation,
            step_m_s: self.step_m_s,
            energy_j: last_j - first_j,
            end_m: self.last.context("nothing moved")?,
            state: cycle.plan.state,
        })
    }
}
