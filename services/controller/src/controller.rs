//! The controller: one step per cycle, with a row of velocities for every live estimate.

use cable_robot::elastic::Realisation;
use cable_robot::kinematics::inverse_kinematics;
use cable_robot::limits::scale_to_limits;
use cable_robot::{CableVec, Jacobian, NodeJacobian, Vector3};
use messages::{
    ControlStatus, ESTIMATORS, Freshness, Header, MotorAuthority, MotorCommand, MotorState, NodeEstimate, PlanMotion,
    SLOTS, freshness, same_life,
};

use std::fmt;

use crate::custom_law::{CableLaw, LawInput};
use crate::instant::Instant;
use crate::law::{self, Law};
use crate::preview::{Notice, Preview};
use crate::retune::Fade;
use crate::settings::ControllerConfig;
use crate::target::{CurrentMotion, Target, at_rate, realise};

/// Inputs of a step.
#[derive(Debug, Clone, Copy, Default)]
pub struct Inputs<'a> {
    /// Newest estimate of each slot; the controller itself ignores those that are too old.
    pub estimates: [Option<&'a NodeEstimate>; SLOTS],
    /// Newest plan/motion.
    pub motion: Option<&'a PlanMotion>,
    /// Newest motor/authority.
    pub authority: Option<&'a MotorAuthority>,
    /// Newest motor/state; only the preview law needs it.
    pub state: Option<&'a MotorState>,
}

/// Computes cable velocities from node estimates and the motion: steps 3 and 4 of the paper's section VI.
pub struct Controller {
    config: ControllerConfig,
    /// A law per cable: p-feedforward or a custom law.
    cable_law: Option<Box<dyn CableLaw>>,
    /// The decoded plan/motion.
    motion: Option<CurrentMotion>,
    /// The preview law, if configured.
    preview: Option<Preview>,
    /// Answers of the newest cycle: the estimates of a cycle arrive one after the other, and a law is called once for
    /// each.
    answered: [Option<AnsweredEstimate>; SLOTS],
    /// The life of motor-io to which this state belongs.
    life: u64,
    /// Fades from the commands with former parameters to those with the present ones.
    fades: [Fade; SLOTS],
}

/// The state between two steps, without the parameters and without that of a law by cable, which may be a custom one.
impl fmt::Debug for Controller {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Controller")
            .field("motion", &self.motion)
            .field("preview", &self.preview)
            .field("answered", &self.answered)
            .field("life", &self.life)
            .field("fades", &self.fades)
            .finish_non_exhaustive()
    }
}

impl Controller {
    /// Creates a controller without a motion.
    pub fn new(config: ControllerConfig) -> Self {
        let preview = match config.law {
            Law::Preview { preview, .. } => Some(Preview::new(preview, config.robot.cable_count())),
            Law::LqEndpoint { .. } | Law::PFeedforward(_) | Law::Custom => None,
        };
        let cable_law: Option<Box<dyn CableLaw>> = match config.law {
            Law::PFeedforward(law) => Some(Box::new(law)),
            Law::LqEndpoint { .. } | Law::Preview { .. } | Law::Custom => None,
        };
        Self {
            config,
            cable_law,
            motion: None,
            preview,
            answered: [None; SLOTS],
            life: 0,
            fades: [Fade::default(); SLOTS],
        }
    }

    /// Returns an independent copy; `None` with a custom law, whose state cannot be copied.
    pub fn fork(&self) -> Option<Self> {
        let Self { config, motion, preview, answered, life, fades, .. } = self;
        (config.law != Law::Custom).then(|| Self {
            motion: motion.clone(),
            preview: preview.clone(),
            answered: *answered,
            life: *life,
            fades: *fades,
            ..Self::new(*config)
        })
    }

    /// Creates a controller with a custom law instead of the configured one.
    pub fn with_law(config: ControllerConfig, law: Box<dyn CableLaw>) -> Self {
        Self { cable_law: Some(law), ..Self::new(ControllerConfig { law: Law::Custom, ..config }) }
    }

    /// Changes the parameters between two steps; the command fades from the old to the new parameters over `fade_s`.
    /// Robot, kind of law and incarnation do not change: another law needs another controller.
    pub fn configure(&mut self, config: ControllerConfig, fade_s: f64) {
        let ControllerConfig { robot, incarnation, thread, law: present, .. } = self.config;
        let law = if law::is_same_kind(&present, &config.law) { config.law } else { present };
        let config = ControllerConfig { robot, incarnation, thread, law, ..config };
        if config == self.config {
            return;
        }
        self.config = config;
        match law {
            Law::PFeedforward(law) => self.cable_law = Some(Box::new(law)),
            Law::Preview { preview: settings, .. } => {
                if let Some(preview) = &mut self.preview {
                    preview.configure(settings);
                }
            }
            Law::LqEndpoint { .. } | Law::Custom => {}
        }
        self.fades.iter_mut().for_each(|fade| fade.begin(fade_s));
    }

    /// Returns the parameters of a custom law, as TOML.
    pub fn own_parameters(&self) -> String {
        self.cable_law.as_ref().map(|law| law.parameters()).unwrap_or_default()
    }

    /// Returns the configuration.
    pub fn config(&self) -> &ControllerConfig {
        &self.config
    }

    /// Returns a notice for the operator about the last steps: an identified model or a fallback.
    pub fn notice(&mut self) -> Option<Notice> {
        self.preview.as_mut().and_then(Preview::notice)
    }

    /// Computes the answer to one cycle: one row per estimate of that cycle. Allocates nothing.
    ///
    /// The cycle is that of the estimate in charge. After it is answered, a newer estimate of the other slot is
    /// answered too, so that no cycle is lost if the estimator in charge dies. Samples of the slot that is not in
    /// charge do not change the answer to the one in charge.
    ///
    /// Without a motion the answer is valid and zero. A row without a position, a target or a finite result is not
    /// valid; motor-io then has no answer from this pair of controller and estimator.
    pub fn step(&mut self, inputs: &Inputs<'_>) -> (MotorCommand, ControlStatus) {
        self.begin_life(inputs.authority);
        let estimates = self.live(inputs);
        let lead = inputs.authority.map_or(0, |authority| usize::from(authority.in_charge[ESTIMATORS]).min(SLOTS - 1));
        let first = inputs.authority.and_then(|authority| self.to_answer(lead, &estimates, authority));
        let header = step_header(inputs, first);
        let (mut command, mut status) = self.blank(inputs, &estimates, header);
        let (Some(authority), Some(_)) = (inputs.authority, first) else { return (command, status) };
        let instant = Instant::from_sample(&header, authority);
        let target = instant.and_then(|instant| self.target(inputs.motion, authority, &instant));
        if let Some(instant) = instant {
            self.update_preview(inputs, &estimates, authority, &instant, &header, lead);
        }
        match &self.preview {
            Some(preview) if preview.weight() >= 0.5 => status.horizon = preview.horizon() as u32,
            Some(_) => status.law = ControlStatus::LAW_LQ_ENDPOINT,
            None => {}
        }
        if let Some(target) = &target {
            command.segment = target.now.segment_id as u32;
            target.describe(&mut status);
        }
        status.segment = command.segment;
        for (slot, estimate) in estimates.iter().enumerate() {
            let Some(estimate) = estimate.filter(|estimate| estimate.header.cycle == header.cycle) else { continue };
            let (epoch, segment) = (authority.epoch, command.segment);
            let answer = match &self.answered[slot] {
                Some(last) if last.estimate == *estimate && (last.epoch, last.segment) == (epoch, segment) => {
                    last.answer
                }
                _ if estimate.header.stamp_ns == header.stamp_ns => {
                    self.answer(slot, estimate, target.as_ref(), authority.period_s)
                }
                // The estimate is of another instant: use the setpoint of that instant.
                _ => {
                    let instant = Instant::from_sample(&estimate.header, authority);
                    let target = instant.and_then(|instant| self.target(inputs.motion, authority, &instant));
                    self.answer(slot, estimate, target.as_ref(), authority.period_s)
                }
            };
            keep(&mut self.answered[slot], estimate, epoch, segment, answer);
            let Some(answer) = answer else { continue };
            for (i, velocity) in answer.velocities_m_s.iter().enumerate() {
                command.velocity_m_s[8 * slot + i] = *velocity;
            }
            command.valid[slot] = 1;
            // The status is about the estimate that motor-io uses, or about the other one if that is the only one.
            if usize::from(authority.active_estimator) == slot || status.valid == 0 {
                status.error_m = answer.error_m.into();
                status.error_norm_m = answer.error_m.norm();
                status.saturation = answer.saturation;
                status.redundant_m = answer.redundant_m;
                status.valid = 1;
            }
        }
        (command, status)
    }

    /// Drops the state of another life of motor-io: cycles, motions and readings are comparable only within a life.
    fn begin_life(&mut self, authority: Option<&MotorAuthority>) {
        let life = authority.map_or(self.life, |authority| authority.header.life);
        if life != self.life {
            self.life = life;
            self.motion = None;
            self.answered = [None; SLOTS];
            self.fades.iter_mut().for_each(Fade::reset);
            if let Some(preview) = &mut self.preview {
                preview.begin_life();
            }
        }
    }

    /// Returns the estimates that are recent enough to be answered.
    fn live<'a>(&self, inputs: &Inputs<'a>) -> [Option<&'a NodeEstimate>; SLOTS] {
        let ttl_cycles = self.config.estimate_ttl_cycles;
        let live = |estimate: &&NodeEstimate, authority: &MotorAuthority| {
            freshness(&estimate.header, &authority.header, ttl_cycles) == Freshness::Live
        };
        inputs.estimates.map(|estimate| estimate.filter(|one| inputs.authority.is_some_and(|by| live(one, by))))
    }

    /// Returns whether the last answer to a slot was for this cycle.
    fn has_answered(&self, slot: usize, cycle: u64) -> bool {
        self.answered[slot].as_ref().is_some_and(|last| last.estimate.header.cycle == cycle)
    }

    /// Returns the estimate whose cycle is answered: the one in charge, or a newer one of the other slot if the one in
    /// charge is already answered or its cycle is over, so that an answer would be too late.
    fn to_answer<'a>(
        &self,
        lead: usize,
        estimates: &[Option<&'a NodeEstimate>; SLOTS],
        authority: &MotorAuthority,
    ) -> Option<&'a NodeEstimate> {
        let done = |estimate: &NodeEstimate| {
            let cycle = estimate.header.cycle;
            self.has_answered(lead, cycle) || cycle < authority.header.cycle
        };
        match (estimates[lead], estimates[1 - lead]) {
            (Some(first), Some(other)) if other.header.cycle > first.header.cycle && done(first) => Some(other),
            (first, other) => first.or(other),
        }
    }

    /// Returns a command without valid rows, and a status with the inputs that it is based on.
    fn blank(
        &self,
        inputs: &Inputs<'_>,
        estimates: &[Option<&NodeEstimate>; SLOTS],
        header: Header,
    ) -> (MotorCommand, ControlStatus) {
        let config = &self.config;
        let command = MotorCommand {
            header,
            based_on_cycle: header.cycle,
            epoch: inputs.authority.map_or(0, |authority| authority.epoch),
            incarnation: config.incarnation,
            ttl_cycles: config.ttl_cycles,
            thread: config.thread,
            ..MotorCommand::default()
        };
        let status = ControlStatus {
            header,
            based_on_estimate: estimates.map(|estimate| estimate.map_or(0, |estimate| estimate.header.cycle)),
            based_on_authority: inputs.authority.map_or(0, |authority| authority.header.cycle),
            based_on_state: inputs.state.map_or(0, |state| state.header.cycle),
            based_on_motion: inputs.motion.map_or(0, |motion| motion.beat),
            horizon: config.horizon,
            incarnation: config.incarnation,
            law: config.law.number(),
            chosen_law: config.law.number(),
            cable_count: config.robot.cable_count() as u8,
            ..ControlStatus::default()
        };
        (command, status)
    }

    /// Updates the preview law for the cycle of `header`, which is that of the slot in charge, `lead`, or of the other
    /// slot.
    fn update_preview(
        &mut self,
        inputs: &Inputs<'_>,
        estimates: &[Option<&NodeEstimate>; SLOTS],
        authority: &MotorAuthority,
        instant: &Instant,
        header: &Header,
        lead: usize,
    ) {
        let cycle = header.cycle;
        // Ignore a cycle without readings: a broken estimator may report one.
        let of_cycle = |state: &&MotorState| state.header.cycle == cycle && same_life(&state.header, &authority.header);
        let Some(state) = inputs.state.filter(of_cycle) else { return };
        // The estimate of the other slot may arrive between motor/state and motor/authority; the model must not depend
        // on that.
        let led = estimates[lead].is_some_and(|estimate| estimate.header.cycle == cycle);
        if !led && authority.header.cycle != cycle {
            return;
        }
        let answered = self.has_answered(lead, cycle);
        let Some(preview) = &mut self.preview else { return };
        preview.observe(state, authority, instant.began_ns);
        for (slot, estimate) in estimates.iter().enumerate() {
            let Some(estimate) = estimate.filter(|estimate| estimate.header.cycle == cycle) else { continue };
            let own_instant = Instant::from_sample(&estimate.header, authority);
            let since_s = own_instant.map_or(instant.since_s, |instant| instant.since_s);
            preview.correct(slot, estimate, since_s, &state.velocity_m_s);
        }
        let ahead = (led && !answered) || !preview.looked_ahead(cycle);
        if let Some(motion) = self.motion.as_ref().filter(|_| ahead).and_then(CurrentMotion::motion) {
            let robot = &self.config.robot;
            // Difference between straight and unstretched lengths; if no tensions are found, that of the point before.
            let mut stretch = CableVec::zeros(robot.cable_count());
            preview.look_ahead(authority, instant.lag, |time_s, rate| {
                let setpoint = at_rate(motion, time_s, rate);
                match realise(&self.config, &setpoint) {
                    Some(held) => {
                        stretch = held.lengths_m.zip_map(&held.unstretched_m, |straight, paid| straight - paid);
                        held.unstretched_m
                    }
                    None => inverse_kinematics(robot.anchors(), &setpoint.position).zip_map(&stretch, |l, s| l - s),
                }
            });
        }
    }

    /// Returns the target at the instant of the estimate; `None` without a motion of the present epoch.
    #[inline]
    fn target(
        &mut self,
        message: Option<&PlanMotion>,
        authority: &MotorAuthority,
        instant: &Instant,
    ) -> Option<Target> {
        let motion = CurrentMotion::update(&mut self.motion, message, authority)?;
        Some(Target::at(&self.config, motion, authority, instant))
    }

    fn answer(
        &mut self,
        slot: usize,
        estimate: &NodeEstimate,
        target: Option<&Target>,
        period_s: f64,
    ) -> Option<Answer> {
        let config = &self.config;
        let n = config.robot.cable_count();
        if estimate.valid == 0 || usize::from(estimate.cable_count) != n {
            return None;
        }
        let Some(target) = target else {
            let velocities_m_s = CableVec::zeros(n);
            self.fades[slot].reset();
            return Some(Answer { velocities_m_s, error_m: Vector3::zeros(), saturation: 0.0, redundant_m: 0.0 });
        };
        let position = Vector3::from(estimate.position_m);
        let error_m = target.now.position - position;
        if error_m.norm().is_nan() || error_m.norm() > config.error_limit_m {
            return None;
        }
        let (u, redundant_m) = match self.cable_law.take() {
            None => self.endpoint(slot, estimate, target, position, period_s)?,
            Some(mut law) => {
                let u = law.velocity(&LawInput {
                    slot,
                    robot: &config.robot,
                    period_s,
                    horizon_s: period_s * f64::from(config.horizon),
                    estimate,
                    now: &target.now,
                    ahead: &target.ahead,
                    now_held: target.now_held.as_ref(),
                    ahead_held: target.ahead_held.as_ref(),
                });
                self.cable_law = Some(law);
                (u.filter(|u| u.len() == n)?, 0.0)
            }
        };
        if !u.is_finite() {
            return None;
        }
        let limits = CableVec::repeat(n, config.cable_speed_limit_m_s);
        let fade = &mut self.fades[slot];
        let u = fade.step(estimate.header.cycle, period_s, &u);
        let scaled = scale_to_limits(&u, &limits);
        fade.record(estimate.header.cycle, &scaled.velocities_m_s);
        Some(Answer {
            velocities_m_s: scaled.velocities_m_s,
            error_m,
            saturation: u.max_abs() / config.cable_speed_limit_m_s,
            redundant_m,
        })
    }

    /// Computes the velocities of the paper's law, blended with the preview law by its weight, and the error of the
    /// redundant lengths, m.
    fn endpoint(
        &self,
        slot: usize,
        estimate: &NodeEstimate,
        target: &Target,
        position: Vector3<f64>,
        period_s: f64,
    ) -> Option<(CableVec, f64)> {
        let config = &self.config;
        let n = config.robot.cable_count();
        let jacobian = Jacobian::at(config.robot.anchors(), &position).ok()?;
        let node_jacobian = jacobian.node_jacobian()?;
        let mut u =
            config.law.velocity(&node_jacobian, &(target.ahead.position - position), period_s, config.horizon)?;
        let mut redundant_m = 0.0;
        if let (Some(now), Some(ahead)) = (&target.now_held, &target.ahead_held) {
            // The law assumes rigid cables and a constant Jacobian. The further change of the unstretched lengths over
            // the horizon is known in advance and added as feedforward.
            let horizon_s = period_s * f64::from(config.horizon);
            let straight = jacobian.cable_velocity(&(target.ahead.position - target.now.position));
            for i in 0..n {
                u[i] += (ahead.unstretched_m[i] - now.unstretched_m[i] - straight[i]) / horizon_s;
            }
            let mut behind = CableVec::zeros(n);
            if config.robot.redundancy() > 0 {
                behind = redundant_error(&jacobian, &node_jacobian, now, estimate);
                redundant_m = behind.norm_squared().sqrt();
                for i in 0..n {
                    u[i] += behind[i] / config.redundant_s;
                }
            }
            if let Some(preview) = &self.preview
                && let Some(wanted) = preview.velocity(slot, estimate.header.cycle, &behind, config.redundant_s)
            {
                for i in 0..n {
                    u[i] += preview.weight() * (wanted[i] - u[i]);
                }
            }
        }
        Some((u, redundant_m))
    }
}

/// Returns the header of a step: that of the answered estimate. Without one, the stamp is that of the newest state or
/// authority, because a run file orders samples by their stamps.
fn step_header(inputs: &Inputs<'_>, answered: Option<&NodeEstimate>) -> Header {
    if let Some(estimate) = answered {
        return Header { seq: 0, published_ns: 0, ..estimate.header };
    }
    let life = inputs.authority.map_or(0, |authority| authority.header.life);
    let state_ns = inputs.state.map_or(0, |state| state.header.stamp_ns);
    let now_ns =
        if state_ns == 0 { inputs.authority.map_or(0, |authority| authority.header.stamp_ns) } else { state_ns };
    Header { life, stamp_ns: now_ns, oldest_input_ns: now_ns, ..Header::default() }
}

/// Returns the length error in the directions that do not move the node: (I - J B)(l* - l), m. For four cables in space
/// this is one direction, the null vector of Jᵀ, along which the tensions can change too; in a plane there are two.
fn redundant_error(
    jacobian: &Jacobian,
    node_jacobian: &NodeJacobian,
    now: &Realisation,
    estimate: &NodeEstimate,
) -> CableVec {
    let missing = now.unstretched_m.zip_map(&estimate.predicted_m, |wanted, is| wanted - is);
    let moving = jacobian.cable_velocity(&node_jacobian.node_velocity(&missing));
    missing.zip_map(&moving, |all, part| all - part)
}

/// The inputs of a computed row, and its result.
#[derive(Debug, Clone, Copy)]
struct AnsweredEstimate {
    estimate: NodeEstimate,
    epoch: u32,
    segment: u32,
    answer: Option<Answer>,
}

/// Keeps an answer in the place of the last one: an estimate has half a kilobyte.
#[inline]
fn keep(
    place: &mut Option<AnsweredEstimate>,
    estimate: &NodeEstimate,
    epoch: u32,
    segment: u32,
    answer: Option<Answer>,
) {
    match place {
        Some(last) => {
            last.estimate = *estimate;
            (last.epoch, last.segment, last.answer) = (epoch, segment, answer);
        }
        None => *place = Some(AnsweredEstimate { estimate: *estimate, epoch, segment, answer }),
    }
}

#[derive(Debug, Clone, Copy)]
struct Answer {
    velocities_m_s: CableVec,
    error_m: Vector3<f64>,
    saturation: f64,
    redundant_m: f64,
}
