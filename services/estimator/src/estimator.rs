//! One step per cycle: lengths read, lengths predicted, position, tensions.

use cable_robot::{CableVec, Matrix3, Robot, Vector3, elastic};
use config::EstimatorSection;
use messages::{Header, MotorAuthority, MotorState, NodeEstimate, same_life};

use crate::method::{Line, Method, MethodError};

/// Cycles without a reading that the motor model may bridge. The same number of silent cycles makes a drive unit lost.
pub const BRIDGED_CYCLES: u64 = 3;

/// What the estimator is told about the robot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EstimatorConfig {
    /// Geometry, node and lines.
    pub robot: Robot,
    /// How readings become lengths and velocities.
    pub method: Method,
    /// Standard deviation of a measured length, m.
    pub sigma_length_m: f64,
    /// Non-zero number of this process's life.
    pub incarnation: u32,
    /// Kernel's number of the thread that answers; 0: unknown.
    pub thread: u32,
}

impl EstimatorConfig {
    /// As a box file and its robot file say.
    ///
    /// # Errors
    /// A method or a parameter that does not exist.
    pub fn of(section: &EstimatorSection, robot: Robot, incarnation: u32) -> Result<Self, MethodError> {
        let robot = if section.stretch { robot } else { robot.with_rigid_lines() };
        Ok(Self { robot, method: Method::of(section)?, sigma_length_m: section.sigma_length_m, incarnation, thread: 0 })
    }
}

/// Motor state to node estimate: steps 1 and 2 of the paper's section VI.
#[derive(Debug, Clone)]
pub struct Estimator {
    robot: Robot,
    sigma_length_m: f64,
    incarnation: u32,
    method: u8,
    lines: Vec<Line>,
    thread: u32,
    last_life: u64,
    last_cycle: u64,
    last_stamp_ns: u64,
    last_instant_ns: u64,
    last_epoch: u32,
    position: Option<Vector3<f64>>,
    /// Velocity of the last estimate, m/s; zero without one.
    velocity_m_s: Vector3<f64>,
}

impl Estimator {
    /// An estimator that has not seen anything yet. Give it [`Robot::with_rigid_lines`] to leave stretch uncorrected.
    pub fn new(config: &EstimatorConfig) -> Self {
        Self {
            robot: config.robot,
            sigma_length_m: config.sigma_length_m,
            incarnation: config.incarnation,
            method: config.method.number(),
            lines: vec![config.method.line(); config.robot.cable_count()],
            thread: config.thread,
            last_life: 0,
            last_cycle: 0,
            last_stamp_ns: 0,
            last_instant_ns: 0,
            last_epoch: 0,
            position: None,
            velocity_m_s: Vector3::zeros(),
        }
    }

    /// Goes on with other parameters, between two steps: what was learnt and filtered stays, so that the estimate does not jump. Robot,
    /// method and life stay what they are; another method is another estimator.
    pub fn configure(&mut self, config: &EstimatorConfig) {
        self.sigma_length_m = config.sigma_length_m;
        self.lines.iter_mut().for_each(|line| line.retune(&config.method));
    }

    /// The estimate for the cycle of one motor/state, true at the instant of its newest reading.
    ///
    /// The paper predicts lengths over a whole iteration, because its encoder counts arrive with the last command. Here
    /// they are read in the cycle itself, so the model bridges only the milliseconds between the reading of each cable
    /// and the common instant, and whole cycles when the bus lost a reading. Nothing is allocated.
    pub fn step(&mut self, state: &MotorState, authority: Option<&MotorAuthority>) -> NodeEstimate {
        let n = self.robot.cable_count();
        let authority = authority.filter(|authority| same_life(&authority.header, &state.header));
        // Another life of motor-io, or a cycle that is not newer than the last: what was learnt is void.
        if state.header.life != self.last_life || state.header.cycle <= self.last_cycle {
            self.forget();
        }
        let instant_ns = self.instant_ns(state, authority);
        let mut estimate = NodeEstimate {
            header: Header { seq: 0, stamp_ns: instant_ns, published_ns: 0, ..state.header },
            measured_m: state.length_m,
            seen_authority: authority.map_or(0, |authority| authority.header.cycle),
            epoch: authority.map_or(0, |authority| authority.epoch),
            incarnation: self.incarnation,
            thread: self.thread,
            cable_count: n as u8,
            method: self.method,
            ..NodeEstimate::default()
        };
        // Lengths may have been given anew.
        let epoch = authority.map_or(self.last_epoch, |authority| authority.epoch);
        if epoch != self.last_epoch {
            self.last_epoch = epoch;
            self.lines.iter_mut().for_each(Line::expect_anything);
        }
        (self.last_life, self.last_cycle) = (state.header.life, state.header.cycle);
        (self.last_stamp_ns, self.last_instant_ns) = (state.header.stamp_ns, instant_ns);
        let mut known = usize::from(state.cable_count) == n && state.position_known != MotorState::POSITION_UNKNOWN;
        let mut sigma_m = CableVec::repeat(n, self.sigma_length_m);
        let mut velocity_m_s = CableVec::zeros(n);
        for (i, line) in self.lines.iter_mut().enumerate() {
            line.read(state, i);
            let Some(found) = line.at(state.header.cycle, instant_ns) else {
                known = false;
                continue;
            };
            estimate.predicted_m[i] = found.length_m;
            estimate.cable_velocity_m_s[i] = found.velocity_m_s;
            [estimate.phi1[i], estimate.phi2[i]] = found.phi;
            // Not `hypot`, which is the system's own and not the same everywhere.
            sigma_m[i] = (self.sigma_length_m * self.sigma_length_m + found.sigma_m * found.sigma_m).sqrt();
            velocity_m_s[i] = found.steady_m_s.unwrap_or(state.velocity_m_s[i]);
            estimate.header.oldest_input_ns = estimate.header.oldest_input_ns.min(found.sampled_ns);
        }
        if known {
            let lengths = CableVec::from_array8(&estimate.predicted_m, n);
            self.solve(&lengths, &velocity_m_s, &sigma_m, &mut estimate);
        }
        if estimate.valid == 0 {
            self.position = None;
            self.velocity_m_s = Vector3::zeros();
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
        (self.last_cycle, self.last_stamp_ns, self.last_instant_ns) = (0, 0, 0);
        self.lines.iter_mut().for_each(Line::forget);
        self.position = None;
        self.velocity_m_s = Vector3::zeros();
    }

    fn solve(
        &mut self,
        lengths_m: &CableVec,
        velocity_m_s: &CableVec,
        sigma_m: &CableVec,
        estimate: &mut NodeEstimate,
    ) {
        // The lines' statics at rest: 0.3 m/s² would move the node by less than a millimetre, and a motion that is not
        // flown as planned must not move the estimate. Drag is different: in water it is several times that force, lasts as
        // long as the motion and follows from a velocity that is measured; that of the last cycle is near enough.
        let wrench_n = self.robot.moving_wrench_n(&self.velocity_m_s, &Vector3::zeros());
        let found = elastic::equilibrium_under(&self.robot, lengths_m, &wrench_n, self.position.as_ref());
        let Ok(found) = found else { return };
        let velocity = found.sensitivity.node_velocity(velocity_m_s);
        let covariance =
            found.covariance(sigma_m) + found.covariance_by_anchors(&self.robot).unwrap_or_else(Matrix3::zeros);
        let finite = |v: &Vector3<f64>| v.iter().all(|x| x.is_finite());
        if !(finite(&found.position) && finite(&velocity) && covariance.iter().all(|x| x.is_finite())) {
            return;
        }
        (self.position, self.velocity_m_s) = (Some(found.position), velocity);
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
