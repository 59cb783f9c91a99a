//! Configuration of the core, and its checks.

use cable_robot::{Distribution, Robot, rate};
use config::ArbiterSection;
use messages::{CABLES, UNITS};
use thiserror::Error;

/// A key of the configuration that cannot be used.
#[derive(Debug, Clone, PartialEq, Error)]
#[error("[motor_io] {key} {problem}; accepted: {accepted}")]
pub struct ConfigError {
    /// Key as in the system file.
    pub key: &'static str,
    /// Given value.
    pub problem: String,
    /// Accepted values.
    pub accepted: &'static str,
}

fn refuse<T>(key: &'static str, problem: String, accepted: &'static str) -> Result<T, ConfigError> {
    Err(ConfigError { key, problem, accepted })
}

/// Configuration of the core; [`CoreConfig::check`] checks it.
///
/// [`CoreConfig::new`] fills in the defaults of the system file, so that a simulation gives only what differs.
#[derive(Debug, Clone)]
pub struct CoreConfig {
    /// The robot.
    pub robot: Robot,
    /// Control period, s.
    pub period_s: f64,
    /// Encoder counts per metre of cable, one per cable, on a drum those of the bare one; negative if the count falls
    /// as the cable pays out.
    pub counts_per_m: [f64; CABLES],
    /// Drive unit of each cable.
    pub unit_of_cable: [usize; CABLES],
    /// Number of drive units.
    pub unit_count: usize,
    /// Largest cable velocity, m/s.
    pub cable_speed_m_s: f64,
    /// Largest cable acceleration, m/s². Above the node's limit, because the controller's corrections need room beside
    /// the planned motion.
    pub cable_acceleration_m_s2: f64,
    /// Share by which the node may exceed the robot's speed limit.
    pub node_speed_margin: f64,
    /// Largest acceleration of the node, m/s².
    pub node_acceleration_m_s2: f64,
    /// Largest correction that a controller may add to the setpoint's velocity, m/s: brings the node back at
    /// half its speed limit.
    pub correction_limit_m_s: f64,
    /// Largest distance from the node at which a motion may begin, m. Uncorrected stretch is up to 35
    /// mm on the examples.
    pub start_bound_m: f64,
    /// Distance to the setpoint from which commands that lead away from it are a fault, m. Drives lag by up to 30 mm at
    /// full speed, and controllers do not answer from 250 mm on.
    pub divergence_m: f64,
    /// Time for which they may, s: a third of `divergence_m` at the speed limit.
    pub divergence_s: f64,
    /// Time in which pause, hold and resume ramp the plan clock between standstill and full rate, s.
    pub ramp_s: f64,
    /// Time of the ramp to standstill for stop, s.
    pub stop_s: f64,
    /// Rest after a motion's end before it counts as finished, s.
    pub settle_s: f64,
    /// Cycles in a row without a command after which the robot stops; until then it uses the last one.
    pub ttl_cycles: u32,
    /// Cable velocity of jogging, m/s.
    pub jog_speed_m_s: f64,
    /// Tension below which a cable is slack, N.
    pub slack_n: f64,
    /// Cycles before slack or over-tension is a fault; see [`CoreConfig::lasting`].
    pub slack_cycles: u32,
    /// Drive output above which a cable that hardly moves is stalled or slipping, 0 to 1.
    pub stall_duty: f64,
    /// Cycles before stall, runaway or over-current is a fault; see [`CoreConfig::lasting`].
    pub stall_cycles: u32,
    /// Lowest supply voltage, V.
    pub supply_min_v: f64,
    /// Largest continuous current of a motor, A.
    pub current_limit_a: f64,
    /// Time without a packet after which the drives stop their motors, s.
    pub watchdog_s: f64,
    /// Time without a beat after which the supervisor or the planner counts as lost, s.
    pub beat_s: f64,
    /// Time for which a second controller or estimator must answer well beside the one in charge to
    /// become its standby, s.
    pub qualify_s: f64,
    /// From the announcement of a swap to the cycle in which it takes effect, s.
    pub announce_s: f64,
    /// Time in which one command fades into another, s: longer than the lag of drives, too short to be noticed.
    pub fade_s: f64,
    /// Time after a swap in which a cycle missed by the new slot reinstates the old one, unless the
    /// computer was the cause, s.
    pub probation_s: f64,
    /// Time of good answers after which a standby's falls are forgiven, s.
    pub forgive_s: f64,
    /// Falls after which a standby is quarantined.
    pub quarantine_falls: u8,
    /// Largest deviation of a standby's command from the controller in charge, as a share of `cable_speed_m_s`. Laws
    /// differ most where the motion changes: by the acceleration times the difference of their look-ahead.
    pub command_bound: f64,
    /// Largest average deviation, as a share of the commanded speed, but at least `bias_bound_m_s`.
    pub bias_share: f64,
    /// Lower bound of the allowed average deviation, m/s: the difference of two good laws while the node accelerates.
    pub bias_bound_m_s: f64,
    /// Largest deviation of a standby's estimate from the one in charge, m.
    pub estimate_bound_m: f64,
    /// Second encoders, which are compared with the first ones; `None`: the cables have one each.
    pub second: Option<SecondEncoders>,
    /// Choice of tensions of more cables than dimensions where `zero --at` turns a position into lengths.
    pub distribution: Distribution,
    /// The first port, from 1, whose drives take no torque.
    pub port_without_torque: Option<usize>,
}

/// The second encoder of each cable: on the drum where the first one is on an idler, and the reverse.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SecondEncoders {
    /// Counts per metre of cable, on a drum those of the bare one; negative if the count falls as the cable pays out.
    pub counts_per_m: [f64; CABLES],
    /// Counts of a step: families read some encoders more coarsely than they count.
    pub step_counts: f64,
    /// Difference beyond what the model explains that is a fault, m.
    pub slip_m: f64,
    /// Share of the motion by which the two may differ.
    pub slip_share: f64,
    /// Cable between drum and idler, which stretches, m.
    pub idler_m: f64,
}

/// Longest distance of one jog, m; longer ones are motions of the planner.
pub const JOG_LIMIT_M: f64 = 2.0;

/// Drive unit of each of `n` cables; `units` lists the cables of each unit.
fn unit_of_cable(units: &[Vec<usize>], n: usize) -> Result<[usize; CABLES], ConfigError> {
    if units.is_empty() || units.len() > UNITS {
        return refuse("ports", format!("name {} drive units", units.len()), "1 to 8 units in all");
    }
    let mut unit_of_cable = [usize::MAX; CABLES];
    for (unit, cables) in units.iter().enumerate() {
        for &cable in cables {
            if cable >= n {
                let problem = format!("give cable {} to unit {}, and the robot has {n} cables", cable + 1, unit + 1);
                return refuse("ports", problem, "cables from 1 to the number of anchors");
            }
            if unit_of_cable[cable] != usize::MAX {
                let problem =
                    format!("give cable {} to units {} and {}", cable + 1, unit_of_cable[cable] + 1, unit + 1);
                return refuse("ports", problem, "every cable on exactly one motor");
            }
            unit_of_cable[cable] = unit;
        }
    }
    if let Some(cable) = unit_of_cable[..n].iter().position(|unit| *unit == usize::MAX) {
        let problem = format!("give cable {} to no unit", cable + 1);
        return refuse("ports", problem, "every cable on exactly one motor");
    }
    Ok(unit_of_cable.map(|unit| if unit == usize::MAX { 0 } else { unit }))
}

impl CoreConfig {
    /// Creates a configuration with the documented defaults. `counts_per_m` has one value per cable; `units` lists the
    /// cables (from 0) of each unit.
    ///
    /// # Errors
    /// Names the key that is missing or out of its range.
    pub fn new(robot: Robot, period_s: f64, counts_per_m: &[f64], units: &[Vec<usize>]) -> Result<Self, ConfigError> {
        let n = robot.cable_count();
        if counts_per_m.len() != n {
            let problem = format!("has {} values for a robot of {n} cables", counts_per_m.len());
            return refuse("counts_per_m", problem, "one value per cable");
        }
        let unit_of_cable = unit_of_cable(units, n)?;
        let mut counts = [1.0; CABLES];
        counts[..n].copy_from_slice(counts_per_m);
        let arbiter = ArbiterSection::default();
        let config = Self {
            period_s,
            counts_per_m: counts,
            unit_of_cable,
            unit_count: units.len(),
            cable_speed_m_s: robot.cable_speed_limit_m_s(),
            cable_acceleration_m_s2: 4.0 * robot.acceleration_limit_m_s2(),
            node_speed_margin: 0.1,
            node_acceleration_m_s2: 4.0 * robot.acceleration_limit_m_s2(),
            correction_limit_m_s: 0.5 * robot.speed_limit_m_s(),
            start_bound_m: 0.05,
            divergence_m: 0.1,
            divergence_s: 0.1,
            ramp_s: 0.5,
            stop_s: 0.25,
            settle_s: 0.5,
            ttl_cycles: 3,
            jog_speed_m_s: 0.05,
            slack_n: 0.5,
            slack_cycles: 30,
            stall_duty: 0.6,
            stall_cycles: 20,
            supply_min_v: 10.0,
            current_limit_a: 5.0,
            watchdog_s: 0.3,
            beat_s: 2.0,
            qualify_s: arbiter.qualify_s,
            announce_s: arbiter.announce_s,
            fade_s: arbiter.fade_s,
            probation_s: arbiter.probation_s,
            forgive_s: arbiter.forgive_s,
            quarantine_falls: arbiter.quarantine_falls,
            command_bound: arbiter.command_bound,
            bias_share: arbiter.bias_share,
            bias_bound_m_s: arbiter.bias_bound_m_s,
            estimate_bound_m: arbiter.estimate_bound_m,
            second: None,
            distribution: robot.default_distribution(),
            port_without_torque: None,
            robot,
        };
        config.check()?;
        Ok(config)
    }

    /// Bound on the node's speed, m/s.
    #[must_use]
    pub fn node_speed_m_s(&self) -> f64 {
        (1.0 + self.node_speed_margin) * self.robot.speed_limit_m_s()
    }

    /// Number of cables.
    #[must_use]
    pub fn cable_count(&self) -> usize {
        self.robot.cable_count()
    }

    /// Returns a time as a whole number of cycles, at least 1.
    #[must_use]
    pub fn cycles(&self, seconds: f64) -> u32 {
        rate::cycles(seconds, self.period_s)
    }

    /// Returns the number of cycles of a condition that has to last for `cycles`: so many at up to 250 Hz, and at
    /// higher rates those of the same time as at 250 Hz ([`rate::lasting`]).
    #[must_use]
    pub fn lasting(&self, cycles: u32) -> u32 {
        rate::lasting(cycles, self.period_s)
    }

    /// Checks every number.
    ///
    /// # Errors
    /// Names the first key out of its range.
    pub fn check(&self) -> Result<(), ConfigError> {
        let inside = |key, value: f64, low: f64, high: f64, accepted| {
            if value.is_finite() && (low..=high).contains(&value) {
                Ok(())
            } else {
                refuse(key, format!("is {value}"), accepted)
            }
        };
        inside("period", self.period_s, 0.002, 0.1, "10 to 500 cycles per second (rate_hz)")?;
        for (cable, counts) in self.counts_per_m[..self.cable_count()].iter().enumerate() {
            if !(counts.is_finite() && (100.0..=1e7).contains(&counts.abs())) {
                let problem = format!("is {counts} for cable {}", cable + 1);
                return refuse(
                    "counts_per_m",
                    problem,
                    "100 to 10000000 counts per metre, negative for a reversed encoder",
                );
            }
        }
        inside("cable_speed_limit_m_s", self.cable_speed_m_s, 1e-3, 10.0, "0.001 to 10 metres per second")?;
        inside("cable_acceleration_m_s2", self.cable_acceleration_m_s2, 1e-3, 100.0, "0.001 to 100 m/s²")?;
        inside("node_speed_margin", self.node_speed_margin, 0.0, 1.0, "0 to 1")?;
        inside(
            "node_acceleration_limit_m_s2",
            self.node_acceleration_m_s2,
            self.robot.acceleration_limit_m_s2(),
            100.0,
            "the robot's acceleration_limit_m_s2, by which motions are planned, to 100 m/s²",
        )?;
        inside("correction_limit_m_s", self.correction_limit_m_s, 1e-3, 10.0, "0.001 to 10 metres per second")?;
        inside("start_bound_m", self.start_bound_m, 1e-3, 10.0, "0.001 to 10 metres")?;
        inside("divergence_m", self.divergence_m, 1e-3, 10.0, "0.001 to 10 metres")?;
        inside("divergence_s", self.divergence_s, 0.01, 10.0, "0.01 to 10 seconds")?;
        inside("ramp_s", self.ramp_s, 0.05, 10.0, "0.05 to 10 seconds")?;
        inside("stop_s", self.stop_s, 0.05, 10.0, "0.05 to 10 seconds")?;
        inside("settle_s", self.settle_s, 0.0, 10.0, "0 to 10 seconds")?;
        inside("ttl_cycles", f64::from(self.ttl_cycles), 0.0, 50.0, "0 to 50 cycles")?;
        inside(
            "jog_speed_m_s",
            self.jog_speed_m_s,
            1e-3,
            self.cable_speed_m_s,
            "0.001 m/s up to the cable speed limit",
        )?;
        inside("slack_n", self.slack_n, 0.0, 1e4, "0 to 10000 newtons")?;
        inside("slack_cycles", f64::from(self.slack_cycles), 1.0, 1e4, "1 to 10000 cycles")?;
        inside("stall_duty", self.stall_duty, 0.05, 1.0, "0.05 to 1")?;
        inside("stall_cycles", f64::from(self.stall_cycles), 1.0, 1e4, "1 to 10000 cycles")?;
        inside("supply_min_v", self.supply_min_v, 0.0, 100.0, "0 to 100 volts")?;
        inside("current_limit_a", self.current_limit_a, 1e-3, 1e3, "0.001 to 1000 amperes")?;
        inside("watchdog_s", self.watchdog_s, 0.1, 2.0, "0.1 to 2 seconds in steps of 0.1")?;
        inside("beat_s", self.beat_s, 0.1, 60.0, "0.1 to 60 seconds")?;
        inside("qualify_s", self.qualify_s, 0.1, 60.0, "0.1 to 60 seconds")?;
        inside("announce_s", self.announce_s, 0.0, 10.0, "0 to 10 seconds")?;
        inside("fade_s", self.fade_s, 0.0, 10.0, "0 to 10 seconds")?;
        inside("probation_s", self.probation_s, 0.0, 60.0, "0 to 60 seconds")?;
        inside("forgive_s", self.forgive_s, 0.1, 3600.0, "0.1 to 3600 seconds")?;
        inside("quarantine_falls", self.quarantine_falls.into(), 1.0, 100.0, "1 to 100")?;
        inside("command_bound", self.command_bound, 1e-3, 1.0, "0.001 to 1")?;
        inside("bias_share", self.bias_share, 1e-3, 1.0, "0.001 to 1")?;
        inside("bias_bound_m_s", self.bias_bound_m_s, 1e-3, 10.0, "0.001 to 10 metres per second")?;
        inside("estimate_bound_m", self.estimate_bound_m, 1e-4, 1.0, "0.0001 to 1 metre")
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use cable_robot::RobotParts;

    /// A small robot of three cables on two units, for the tests of this crate.
    pub(crate) fn small_robot(rate_hz: f64) -> Result<CoreConfig, ConfigError> {
        let robot = Robot::new(RobotParts {
            anchors_m: vec![[0.0, 0.0, 3.05], [9.8, 0.0, 3.10], [4.7, 8.6, 2.98]],
            node_mass_kg: 1.2,
            tension_limits_n: [2.0, 60.0],
            speed_limit_m_s: 0.4,
            acceleration_limit_m_s2: 0.5,
            ..RobotParts::default()
        })
        .unwrap();
        CoreConfig::new(robot, 1.0 / rate_hz, &[10_000.0; 3], &[vec![0, 1], vec![2]])
    }

    #[test]
    fn a_condition_lasts_for_its_cycles_and_above_250_hz_for_their_time() {
        for rate_hz in [10.0, 100.0, 200.0, 250.0] {
            let config = small_robot(rate_hz).unwrap();
            assert_eq!([3, 5, 20, 30].map(|cycles| config.lasting(cycles)), [3, 5, 20, 30], "{rate_hz} Hz");
        }
        for (rate_hz, slack) in [(300.0, 36), (400.0, 48), (500.0, 60)] {
            let config = small_robot(rate_hz).unwrap();
            assert_eq!(config.lasting(config.slack_cycles), slack, "{rate_hz} Hz");
            assert!((f64::from(slack) * config.period_s - 0.120).abs() < config.period_s, "{rate_hz} Hz");
        }
        assert!(small_robot(501.0).is_err_and(|error| error.to_string().contains("500")));
    }
}
