//! One step per cycle: lengths read, lengths predicted, position, tensions.

use cable_robot::motor_model::PhiModel;
use cable_robot::{CableVec, MAX_CABLES, Robot, Vector3, elastic};
use messages::{Header, MotorAuthority, MotorState, NodeEstimate};
use service::config::EstimatorSection;

/// Cycles without a reading that the motor model may bridge. The same number of silent cycles makes a drive unit lost.
pub const BRIDGED_CYCLES: u64 = 3;

/// Share of a predicted displacement that counts as its standard deviation: the model (18) leaves 0.2 to 0.8 of the
/// error of not predicting at all, depending on the run.
const PREDICTION_SIGMA: f64 = 0.5;

/// What the estimator is told about the robot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EstimatorConfig {
    /// Geometry, node and lines.
    pub robot: Robot,
    /// Rows of the sliding window of (19).
    pub eta: usize,
    /// Pull towards `prior`, (m/s)².
    pub ridge: f64,
    /// `[φ1, φ2]` of a window that says nothing.
    pub prior: [f64; 2],
    /// Standard deviation of a measured length, m.
    pub sigma_length_m: f64,
    /// Non-zero number of this process's life.
    pub incarnation: u32,
}

impl EstimatorConfig {
    /// As a box file and its robot file say.
    pub fn of(section: &EstimatorSection, robot: Robot, incarnation: u32) -> Self {
        let robot = if section.stretch { robot } else { robot.with_rigid_lines() };
        let EstimatorSection { eta, ridge, prior, sigma_length_m, .. } = *section;
        Self { robot, eta, ridge, prior, sigma_length_m, incarnation }
    }
}

/// What is remembered of one cable.
#[derive(Debug, Clone, Copy)]
struct Cable {
    phi: PhiModel,
    /// Length at `sampled_ns`, m; `None` before the first reading.
    length_m: Option<f64>,
    sampled_ns: u64,
    /// Cycle of that reading.
    cycle: u64,
    /// Estimate v̂ of the cable's velocity during the present cycle, m/s.
    velocity_m_s: f64,
    /// Command sent in the last cycle, m/s.
    command_m_s: f64,
}

/// Motor state to node estimate: steps 1 and 2 of the paper's section VI.
#[derive(Debug, Clone)]
pub struct Estimator {
    robot: Robot,
    sigma_length_m: f64,
    incarnation: u32,
    cables: [Cable; MAX_CABLES],
    last_cycle: u64,
    last_stamp_ns: u64,
    last_instant_ns: u64,
    position: Option<Vector3<f64>>,
}

impl Estimator {
    /// An estimator that has not seen anything yet. Give it [`Robot::with_rigid_lines`] to leave stretch uncorrected.
    pub fn new(config: &EstimatorConfig) -> Self {
        let cable = Cable {
            phi: PhiModel::new(config.eta, config.ridge, config.prior),
            length_m: None,
            sampled_ns: 0,
            cycle: 0,
            velocity_m_s: 0.0,
            command_m_s: 0.0,
        };
        Self {
            robot: config.robot,
            sigma_length_m: config.sigma_length_m,
            incarnation: config.incarnation,
            cables: [cable; MAX_CABLES],
            last_cycle: 0,
            last_stamp_ns: 0,
            last_instant_ns: 0,
            position: None,
        }
    }

    /// The estimate for the cycle of one motor/state, true at the instant of its newest reading.
    ///
    /// The paper predicts lengths over a whole iteration, because its encoder counts arrive with the last command. Here
    /// they are read in the cycle itself, so the model bridges only the milliseconds between the reading of each cable
    /// and the common instant, and whole cycles when the bus lost a reading. Nothing is allocated.
    pub fn step(&mut self, state: &MotorState, authority: Option<&MotorAuthority>) -> NodeEstimate {
        let n = self.robot.cable_count();
        let instant_ns = self.instant_ns(state, authority);
        let mut estimate = NodeEstimate {
            header: Header {
                cycle: state.header.cycle,
                seq: 0,
                stamp_ns: instant_ns,
                oldest_input_ns: state.header.oldest_input_ns,
            },
            measured_m: state.length_m,
            epoch: authority.map_or(0, |authority| authority.epoch),
            incarnation: self.incarnation,
            cable_count: n as u8,
            ..NodeEstimate::default()
        };
        // A cycle that is not newer than the last is a second motor-io or a restarted one: what was learnt is void.
        if state.header.cycle <= self.last_cycle {
            self.forget();
        }
        (self.last_cycle, self.last_stamp_ns, self.last_instant_ns) =
            (state.header.cycle, state.header.stamp_ns, instant_ns);
        let mut known = usize::from(state.cable_count) == n && state.position_known != MotorState::POSITION_UNKNOWN;
        let mut sigma_m = CableVec::repeat(n, self.sigma_length_m);
        for i in 0..n {
            let cable = &mut self.cables[i];
            cable.read(state, i);
            let Some((predicted_m, moved_m)) = cable.predict(state.header.cycle, instant_ns) else {
                known = false;
                continue;
            };
            estimate.predicted_m[i] = predicted_m;
            estimate.cable_velocity_m_s[i] = cable.velocity_m_s;
            [estimate.phi1[i], estimate.phi2[i]] = cable.phi.phi();
            sigma_m[i] = self.sigma_length_m.hypot(PREDICTION_SIGMA * moved_m);
            estimate.header.oldest_input_ns = estimate.header.oldest_input_ns.min(cable.sampled_ns);
        }
        if known {
            let lengths = CableVec::from_array8(&estimate.predicted_m, n);
            // One encoder step in one cycle is a large velocity: for the node's own, motor-io's over 50 ms serves better
            // than the model's of this cycle.
            let measured_m_s = CableVec::from_array8(&state.velocity_m_s, n);
            self.solve(&lengths, &measured_m_s, &sigma_m, &mut estimate);
        }
        if estimate.valid == 0 {
            self.position = None;
        }
        estimate
    }

    /// When the estimate of this cycle is true: when the newest encoder was read. In a cycle without any reading the
    /// sample repeats the instant of the last one; then it is a period later, as if it had been read.
    fn instant_ns(&self, state: &MotorState, authority: Option<&MotorAuthority>) -> u64 {
        let cycles = state.header.cycle.saturating_sub(self.last_cycle);
        let repeated = state.header.stamp_ns == self.last_stamp_ns && (1..=BRIDGED_CYCLES).contains(&cycles);
        match authority {
            Some(authority) if repeated && (0.0..1.0).contains(&authority.period_s) => {
                self.last_instant_ns.saturating_add(cycles * (authority.period_s * 1e9) as u64)
            }
            _ => state.header.stamp_ns,
        }
    }

    fn forget(&mut self) {
        for cable in &mut self.cables {
            cable.length_m = None;
            cable.velocity_m_s = 0.0;
            cable.command_m_s = 0.0;
        }
        self.position = None;
    }

    fn solve(
        &mut self,
        lengths_m: &CableVec,
        measured_m_s: &CableVec,
        sigma_m: &CableVec,
        estimate: &mut NodeEstimate,
    ) {
        // The lines' statics at rest: 0.3 m/s² would move the node by less than a millimetre, and a motion that is not
        // flown as planned must not move the estimate.
        let rest = Vector3::zeros();
        let Ok(found) = elastic::equilibrium(&self.robot, lengths_m, &rest, self.position.as_ref()) else { return };
        let velocity = found.sensitivity.node_velocity(measured_m_s);
        let covariance = found.covariance(sigma_m);
        let finite = |v: &Vector3<f64>| v.iter().all(|x| x.is_finite());
        if !(finite(&found.position) && finite(&velocity) && covariance.iter().all(|x| x.is_finite())) {
            return;
        }
        self.position = Some(found.position);
        estimate.position_m = found.position.into();
        estimate.velocity_m_s = velocity.into();
        for row in 0..3 {
            for column in 0..3 {
                estimate.covariance_m2[3 * row + column] = covariance[(row, column)];
            }
        }
        estimate.tension_n = found.tensions_n.to_array8();
        estimate.residual_m = self.residual_m(&found, lengths_m);
        for (flag, slack) in estimate.slack.iter_mut().zip(found.slack) {
            *flag = u8::from(slack);
        }
        estimate.valid = 1;
    }

    /// How far the lengths are from fitting together, m: for rigid lines the RMS misfit; elastic lines always fit
    /// (tensions take it up), there it is what the solution is short of balance, as stretch.
    fn residual_m(&self, found: &elastic::Equilibrium, lengths_m: &CableVec) -> f64 {
        match self.robot.stiffness_n() {
            None => found.residual,
            Some(stiffness_n) => {
                let longest_m = lengths_m.iter().zip(self.robot.routed_length_m().iter()).map(|(l, r)| l + r);
                found.residual * longest_m.fold(0.0, f64::max) / stiffness_n
            }
        }
    }
}

impl Cable {
    /// Takes the reading of this cycle, if there is one, and teaches the motor model what the last command did.
    fn read(&mut self, state: &MotorState, i: usize) {
        let (length_m, sampled_ns) = (state.length_m[i], state.sampled_ns[i]);
        if state.fresh[i] != 0 && length_m.is_finite() {
            let elapsed_s = sampled_ns.saturating_sub(self.sampled_ns) as f64 * 1e-9;
            match self.length_m {
                Some(before_m) if self.cycle + 1 == state.header.cycle && elapsed_s > 0.0 => {
                    self.phi.update(self.command_m_s, (length_m - before_m) / elapsed_s);
                }
                _ => self.phi.forget_window(),
            }
            (self.length_m, self.sampled_ns, self.cycle) = (Some(length_m), sampled_ns, state.header.cycle);
        }
        self.command_m_s = if state.command_m_s[i].is_finite() { state.command_m_s[i] } else { 0.0 };
        self.velocity_m_s = self.phi.predict(self.command_m_s);
    }

    /// Length at the instant of the sample, and how much of it is prediction, m; `None` without a reading that is new
    /// enough.
    fn predict(&self, cycle: u64, instant_ns: u64) -> Option<(f64, f64)> {
        let length_m = self.length_m?;
        let silent = cycle.checked_sub(self.cycle)?;
        if silent > BRIDGED_CYCLES {
            return None;
        }
        // Signed: the instant of the cycle may lie before the reading.
        let ahead_s = if instant_ns >= self.sampled_ns {
            (instant_ns - self.sampled_ns) as f64 * 1e-9
        } else {
            -((self.sampled_ns - instant_ns) as f64 * 1e-9)
        };
        // A clock that jumped must not throw the node about: at 250 Hz to 10 Hz no cycle is longer than this.
        let moved_m = self.velocity_m_s * ahead_s.clamp(-0.1, 0.1 * (1 + silent) as f64);
        let predicted_m = length_m + moved_m;
        predicted_m.is_finite().then_some((predicted_m, moved_m))
    }
}
