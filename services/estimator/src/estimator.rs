//! The estimator: one step per cycle, from measured lengths to predicted lengths, position and tensions.

use cable_robot::LengthErrors;
use cable_robot::modes::stiffness_at_n_m;
use cable_robot::rate::lasting;
use cable_robot::{CableVec, Robot, Vector3, elastic};
use config::EstimatorSection;
use messages::{CABLES, Header, MotorAuthority, MotorState, NodeEstimate, same_life};

use crate::cable_estimator::{BRIDGED_CYCLES, CableEstimator, Instant};
use crate::cables::Cables;
use crate::method::Method;
use crate::program::ProgramEstimator;
use crate::readings::{self, Readings};
use crate::swing::{Rest, SwingObserver};
use cable_control::length_filter::FilterError;
use std::fmt;

/// Configuration of an estimator.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EstimatorConfig {
    /// Geometry, node and cables.
    pub robot: Robot,
    /// Method that computes lengths and velocities from readings.
    pub method: Method,
    /// Standard deviation of a measured length, m.
    pub sigma_length_m: f64,
    /// Random number of this run of the process, never 0.
    pub incarnation: u32,
    /// Kernel's id of the thread that computes the estimates; 0: unknown.
    pub thread: u32,
}

impl EstimatorConfig {
    /// Returns the configuration in a section of a system file.
    ///
    /// # Errors
    /// A parameter is out of range.
    pub fn from_section(section: &EstimatorSection, robot: Robot, incarnation: u32) -> Result<Self, FilterError> {
        Ok(Self::with_method(Method::from_section(section)?, section, robot, incarnation))
    }

    /// As [`EstimatorConfig::from_section`] for a custom method; the `method` of the section is not used.
    #[must_use]
    pub fn for_custom_method(section: &EstimatorSection, robot: Robot, incarnation: u32) -> Self {
        Self::with_method(Method::custom(section), section, robot, incarnation)
    }

    fn with_method(method: Method, section: &EstimatorSection, robot: Robot, incarnation: u32) -> Self {
        let robot = if section.stretch { robot } else { robot.with_rigid_lines() };
        Self { robot, method, sigma_length_m: section.sigma_length_m, incarnation, thread: 0 }
    }
}

/// Computes node estimates from motor states: steps 1 and 2 of the paper's section VI.
#[derive(Clone)]
pub struct Estimator {
    config: EstimatorConfig,
    cables: Cables,
    readings: Readings,
    last_life: u64,
    last_cycle: u64,
    last_stamp_ns: u64,
    last_instant_ns: u64,
    last_epoch: u32,
    position: Option<Vector3<f64>>,
    /// Velocity of the last estimate, m/s; zero without one.
    velocity_m_s: Vector3<f64>,
    swing: SwingObserver,
    zero: Zero,
}

/// The state between two steps, without the parameters and without that of the method, which may be a custom one.
impl fmt::Debug for Estimator {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Estimator")
            .field("last_life", &self.last_life)
            .field("last_cycle", &self.last_cycle)
            .field("last_stamp_ns", &self.last_stamp_ns)
            .field("last_instant_ns", &self.last_instant_ns)
            .field("last_epoch", &self.last_epoch)
            .field("position", &self.position)
            .field("velocity_m_s", &self.velocity_m_s)
            .field("swing", &self.swing)
            .field("zero", &self.zero)
            .finish_non_exhaustive()
    }
}

/// The lengths as they were set, and the errors that they had then; `None` where that is unknown.
#[derive(Debug, Clone, Copy, Default)]
struct Zero {
    lengths_m: [f64; CABLES],
    errors: Option<LengthErrors>,
}

impl Estimator {
    /// Creates an estimator without readings. With [`Robot::with_rigid_lines`], stretch is not corrected. If the
    /// configured method is a custom one, no estimate is valid: use [`Estimator::with_method`].
    pub fn new(config: &EstimatorConfig) -> Self {
        Self::with_cables(config, Cables::each(config.method.cable(), config.robot.cable_count()))
    }

    /// Creates an estimator with a custom method instead of the configured one; each cable gets a copy of `cable`.
    pub fn with_method(config: &EstimatorConfig, mut cable: Box<dyn CableEstimator>) -> Self {
        cable.retune(config.method.parameters());
        let cables = Cables::each(Some(cable), config.robot.cable_count());
        Self::with_cables(&EstimatorConfig { method: config.method.to_custom(), ..*config }, cables)
    }

    /// Creates an estimator with the method of a program instead of the configured one. A copy asks the same program.
    pub fn with_program(config: &EstimatorConfig, program: ProgramEstimator) -> Self {
        let config = EstimatorConfig { method: config.method.to_custom(), ..*config };
        Self::with_cables(&config, Cables::Program(program))
    }

    fn with_cables(config: &EstimatorConfig, cables: Cables) -> Self {
        Self {
            config: *config,
            cables,
            readings: Readings::default(),
            last_life: 0,
            last_cycle: 0,
            last_stamp_ns: 0,
            last_instant_ns: 0,
            last_epoch: 0,
            position: None,
            velocity_m_s: Vector3::zeros(),
            swing: SwingObserver::default(),
            zero: Zero::default(),
        }
    }

    /// Returns the configuration.
    pub fn config(&self) -> &EstimatorConfig {
        &self.config
    }

    /// Returns the constants of a custom method, as TOML.
    pub fn constants(&self) -> String {
        self.cables.constants()
    }

    /// Changes the parameters between two steps. The state of the filters remains, so the estimate does not jump.
    /// Robot, kind of method and incarnation do not change: another method needs another estimator.
    pub fn configure(&mut self, config: &EstimatorConfig) {
        self.config.sigma_length_m = config.sigma_length_m;
        if config.method.number() == self.config.method.number() {
            self.config.method = config.method;
            self.cables.retune(config.method.parameters());
        }
    }

    /// Computes the estimate for the cycle of one motor/state, at the instant of its newest reading. Allocates nothing,
    /// unless it asks a program.
    ///
    /// The paper predicts lengths over a whole iteration, because its encoder counts arrive with the last command. Here
    /// the encoders are read in the cycle itself, so the model bridges only the milliseconds between the reading of
    /// each cable and the common instant, and whole cycles if the bus lost a reading.
    pub fn step(&mut self, state: &MotorState, authority: Option<&MotorAuthority>) -> NodeEstimate {
        let n = self.config.robot.cable_count();
        let authority = authority.filter(|authority| same_life(&authority.header, &state.header));
        // Reset for another life of motor-io, and for a cycle that is not newer than the last one.
        if state.header.life != self.last_life || state.header.cycle <= self.last_cycle {
            self.forget();
        }
        let instant_ns = self.instant_ns(state, authority);
        let mut estimate = NodeEstimate {
            header: Header { seq: 0, stamp_ns: instant_ns, published_ns: 0, ..state.header },
            measured_m: state.length_m,
            based_on_authority: authority.map_or(0, |authority| authority.header.cycle),
            epoch: authority.map_or(0, |authority| authority.epoch),
            incarnation: self.config.incarnation,
            thread: self.config.thread,
            cable_count: n as u8,
            method: self.config.method.number(),
            ..NodeEstimate::default()
        };
        // With a new epoch, the operator may have set the lengths.
        let epoch = authority.map_or(self.last_epoch, |authority| authority.epoch);
        if epoch != self.last_epoch {
            self.last_epoch = epoch;
            self.cables.expect_anything();
        }
        (self.last_life, self.last_cycle) = (state.header.life, state.header.cycle);
        (self.last_stamp_ns, self.last_instant_ns) = (state.header.stamp_ns, instant_ns);
        let mut known = usize::from(state.cable_count) == n
            && self.cables.are(n)
            && state.position_known != MotorState::POSITION_UNKNOWN;
        let sigma_length_m = self.config.sigma_length_m;
        let mut sigma_m = CableVec::repeat(n, sigma_length_m);
        let mut velocity_m_s = CableVec::zeros(n);
        let period_s = authority.map_or(0.0, |authority| authority.period_s);
        let instant = Instant { cycle: state.header.cycle, time_ns: instant_ns, period_s };
        let measured = self.cables.measure(&mut self.readings, &readings::samples(state, period_s)[..n], &instant);
        for (i, at) in measured.iter().enumerate().take(n) {
            let Some(at) = at else {
                known = false;
                continue;
            };
            estimate.predicted_m[i] = at.length_m;
            estimate.cable_velocity_m_s[i] = at.velocity_m_s;
            [estimate.phi1[i], estimate.phi2[i]] = at.phi;
            // Not `hypot`, whose result depends on the platform.
            sigma_m[i] = (sigma_length_m * sigma_length_m + at.sigma_m * at.sigma_m).sqrt();
            velocity_m_s[i] = at.steady_velocity_m_s.unwrap_or(state.velocity_m_s[i]);
            estimate.header.oldest_input_ns = estimate.header.oldest_input_ns.min(at.sampled_ns);
        }
        self.follow_zero(&state.zeroed_m);
        if known {
            let lengths = CableVec::from_array8(&estimate.predicted_m, n);
            self.solve(&lengths, &velocity_m_s, &sigma_m, &mut estimate);
        }
        if estimate.valid == 0 {
            self.position = None;
            self.velocity_m_s = Vector3::zeros();
            self.swing.forget();
        }
        estimate
    }

    /// Returns the instant of the estimate: the time of the newest encoder reading. A sample without any reading
    /// repeats the stamp of the last one; its instant is then extrapolated by the period.
    fn instant_ns(&self, state: &MotorState, authority: Option<&MotorAuthority>) -> u64 {
        let cycles = state.header.cycle.saturating_sub(self.last_cycle);
        let repeated = state.header.stamp_ns == self.last_stamp_ns && cycles > 0;
        let Some(MotorAuthority { period_s, .. }) = authority.filter(|_| repeated) else {
            return state.header.stamp_ns;
        };
        let bridged = u64::from(lasting(BRIDGED_CYCLES, *period_s));
        if cycles <= bridged && (0.0..1.0).contains(period_s) {
            self.last_instant_ns.saturating_add(cycles * (period_s * 1e9) as u64)
        } else {
            state.header.stamp_ns
        }
    }

    /// Computes the errors of the lengths where they were set, when they were set.
    fn follow_zero(&mut self, zeroed_m: &[f64; CABLES]) {
        if zeroed_m.iter().map(|m| m.to_bits()).eq(self.zero.lengths_m.iter().map(|m| m.to_bits())) {
            return;
        }
        // Set lengths move the position of rest, and not the node.
        self.swing.forget();
        let robot = &self.config.robot;
        let lengths_m = CableVec::from_array8(zeroed_m, robot.cable_count());
        let at = lengths_m.iter().all(|m| m.is_finite());
        let at = at.then(|| elastic::equilibrium(robot, &lengths_m, &Vector3::zeros(), None).ok());
        let errors = at.flatten().map(|at| robot.uncertainty().length_errors(robot, &at));
        self.zero = Zero { lengths_m: *zeroed_m, errors };
    }

    fn forget(&mut self) {
        (self.last_cycle, self.last_stamp_ns, self.last_instant_ns) = (0, 0, 0);
        self.readings.forget();
        self.cables.forget();
        self.position = None;
        self.velocity_m_s = Vector3::zeros();
        self.swing.forget();
    }

    fn solve(
        &mut self,
        lengths_m: &CableVec,
        velocity_m_s: &CableVec,
        sigma_m: &CableVec,
        estimate: &mut NodeEstimate,
    ) {
        // The equilibrium neglects acceleration: 0.3 m/s² would move the node by less than a millimetre, and an
        // acceleration that differs from the plan must not affect the estimate. It includes drag: in water, drag is
        // several times that force, lasts as long as the motion, and follows from the measured velocity; that of the
        // last cycle suffices.
        let wrench_n = self.config.robot.moving_wrench_n(&self.velocity_m_s, &Vector3::zeros());
        let found = elastic::equilibrium_under(&self.config.robot, lengths_m, &wrench_n, self.position.as_ref());
        let Ok(found) = &found else { return };
        let velocity = found.sensitivity.node_velocity(velocity_m_s);
        let swing = self.swing.step(
            &self.config.robot,
            &Rest {
                instant_ns: estimate.header.stamp_ns,
                position_m: found.position,
                velocity_m_s: velocity,
                stiffness_n_m: stiffness_at_n_m(&self.config.robot, found),
            },
        );
        let (robot, zero) = (&self.config.robot, self.zero.errors.as_ref());
        let covariance =
            found.covariance(sigma_m) + robot.uncertainty().covariance_m2(robot, found, zero) + swing.covariance_m2;
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
        estimate.residual_m = self.residual_m(found, lengths_m);
        estimate.swing_m = swing.amplitude_m;
        for (flag, slack) in estimate.slack.iter_mut().zip(found.slack) {
            *flag = u8::from(slack);
        }
        estimate.valid = 1;
    }

    /// Returns the residual of the lengths, m: for rigid cables the RMS misfit. Elastic cables always fit, because
    /// their tensions adapt; there it is the residual force of the equilibrium, converted to stretch.
    fn residual_m(&self, found: &elastic::Equilibrium, lengths_m: &CableVec) -> f64 {
        match self.config.robot.stiffness_n() {
            None => found.residual,
            Some(stiffness_n) => {
                let longest_m = lengths_m.iter().zip(self.config.robot.routed_length_m().iter()).map(|(l, r)| l + r);
                found.residual * longest_m.fold(0.0, f64::max) / stiffness_n
            }
        }
    }
}
