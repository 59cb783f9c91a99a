//! One step per cycle: an answer for every live estimate.

use cable_robot::elastic::{self, Realisation};
use cable_robot::kinematics::inverse_kinematics;
use cable_robot::limits::scale_to_limits;
use cable_robot::{CableVec, Distribution, Jacobian, Motion, NodeJacobian, Robot, Setpoint, Vector3};
use config::{RobotFile, SystemFile};
use messages::{
    AUTHORITY_LAG, ControlStatus, ESTIMATORS, Header, MotorAuthority, MotorCommand, MotorState, NodeEstimate,
    PlanMotion, SLOTS, Standing, same_life, standing,
};
use segments::motion_of;

use crate::custom_law::{CableLaw, LawInput};
use crate::law::{self, Law};
use crate::preview::{Notice, Preview};
use crate::retune::Fade;

/// What the controller is told.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ControllerConfig {
    /// The robot; [`Robot::with_rigid_lines`] leaves stretch uncorrected.
    pub robot: Robot,
    /// The law.
    pub law: Law,
    /// Δ, cycles, 1 to 200.
    pub horizon: u32,
    /// How the tensions of more cables than directions are chosen.
    pub distribution: Distribution,
    /// Time constant of the loop on the redundant lengths, s.
    pub redundant_s: f64,
    /// Largest velocity of a cable, m/s.
    pub cable_speed_limit_m_s: f64,
    /// Farther than this from the setpoint the controller gives no answer, m.
    pub error_limit_m: f64,
    /// Cycles for which a command may be used.
    pub ttl_cycles: u32,
    /// Cycles for which an estimate may be answered.
    pub estimate_ttl_cycles: u32,
    /// Kernel's number of the thread that answers; 0: unknown.
    pub thread: u32,
    /// Non-zero number of this process's life.
    pub incarnation: u32,
}

impl ControllerConfig {
    /// As a system file and its robot file say.
    ///
    /// # Errors
    /// A law or a weight that does not exist.
    pub fn of(file: &SystemFile, robot: &RobotFile, incarnation: u32) -> anyhow::Result<Self> {
        let section = &file.controller;
        let parts = robot.robot()?;
        Ok(Self {
            robot: if section.stretch { parts } else { parts.with_rigid_lines() },
            law: Law::of(section)?,
            horizon: u32::try_from(section.horizon_cycles)?,
            distribution: section.distribution_for(&parts),
            redundant_s: section.redundant_s,
            cable_speed_limit_m_s: robot.cable_speed_limit_m_s(),
            error_limit_m: section.error_limit_m,
            ttl_cycles: file.motor_io.ttl_cycles,
            estimate_ttl_cycles: file.estimator.ttl_cycles,
            thread: 0,
            incarnation,
        })
    }
}

/// What a step works on.
#[derive(Debug, Clone, Copy, Default)]
pub struct Inputs<'a> {
    /// Newest estimate of each slot, whatever it says: what may not be acted on is left out here.
    pub estimates: [Option<&'a NodeEstimate>; SLOTS],
    /// Newest plan/motion.
    pub motion: Option<&'a PlanMotion>,
    /// Newest motor/authority.
    pub authority: Option<&'a MotorAuthority>,
    /// Newest motor/state; only a law that looks at the drives needs it.
    pub state: Option<&'a MotorState>,
}

/// Node estimates and motion to cable velocities: steps 3 and 4 of the paper's section VI.
pub struct Controller {
    config: ControllerConfig,
    /// A law that works each line for itself, or one's own.
    own: Option<Box<dyn CableLaw>>,
    /// Decoded plan/motion and the beat it had.
    motion: Option<Kept>,
    /// The preview law, if it was chosen.
    preview: Option<Preview>,
    /// Rows of the newest cycle: estimates come one after the other, and a law is asked once for each.
    answered: [Option<Answered>; SLOTS],
    /// The life of motor-io that all of this belongs to.
    life: u64,
    /// From the answers by the parameters of before to those by the present ones.
    fades: [Fade; SLOTS],
}

/// When the estimate is true on the clock of the cycle.
#[derive(Debug, Clone, Copy)]
struct Instant {
    /// Cycles by which the authority is older than the estimate.
    lag: u64,
    /// When the commands of the estimate's cycle were sent, ns.
    began_ns: u64,
    /// From then to the estimate, s.
    since_s: f64,
}

impl Instant {
    /// `None` where the authority says nothing about this estimate.
    fn of(of: &Header, authority: &MotorAuthority) -> Option<Self> {
        let (period_s, rate) = (authority.period_s, authority.plan_rate);
        let lag = of.cycle.saturating_sub(authority.header.cycle);
        if !(period_s > 0.0 && period_s < 1.0 && (0.0..=1.0).contains(&rate) && lag <= AUTHORITY_LAG) {
            return None;
        }
        let began_ns = authority.header.stamp_ns.saturating_sub(authority.bus_ns);
        let since_s = of.stamp_ns.saturating_sub(began_ns) as f64 * 1e-9;
        let since_s = since_s.clamp(period_s * lag as f64, period_s * (lag + 1) as f64) - period_s * lag as f64;
        let began_ns = began_ns.saturating_add(lag * (period_s * 1e9) as u64);
        Some(Self { lag, began_ns, since_s })
    }
}

/// The motion that plan/motion last held.
#[derive(Debug, Clone, Copy)]
struct Kept {
    beat: u64,
    number: u32,
    epoch: u32,
    motion: Option<Motion>,
}

/// Where the node should be now and at the end of the horizon, and the lengths that put it there.
struct Target {
    now: Setpoint,
    ahead: Setpoint,
    now_held: Option<Realisation>,
    ahead_held: Option<Realisation>,
}

impl Controller {
    /// A controller that has not seen a motion.
    pub fn new(config: ControllerConfig) -> Self {
        let preview = match config.law {
            Law::Preview { preview, .. } => Some(Preview::new(preview, config.robot.cable_count())),
            Law::LqEndpoint { .. } | Law::PFeedforward(_) | Law::Custom => None,
        };
        let own: Option<Box<dyn CableLaw>> = match config.law {
            Law::PFeedforward(law) => Some(Box::new(law)),
            Law::LqEndpoint { .. } | Law::Preview { .. } | Law::Custom => None,
        };
        Self { config, own, motion: None, preview, answered: [None; SLOTS], life: 0, fades: [Fade::default(); SLOTS] }
    }

    /// A copy that goes its own way from here; `None` with a law of one's own, of which nobody knows what it remembers.
    pub fn fork(&self) -> Option<Self> {
        let Self { config, motion, preview, answered, life, fades, .. } = self;
        (config.law != Law::Custom).then(|| Self {
            motion: *motion,
            preview: preview.clone(),
            answered: *answered,
            life: *life,
            fades: *fades,
            ..Self::new(*config)
        })
    }

    /// A controller with a law of one's own in place of the configured one.
    pub fn with_law(config: ControllerConfig, law: Box<dyn CableLaw>) -> Self {
        Self { own: Some(law), ..Self::new(ControllerConfig { law: Law::Custom, ..config }) }
    }

    /// Goes on with other parameters, between two steps; the command fades from what it was to what it is now over `fade_s`. Robot, law and
    /// life stay what they are: another law is another controller.
    pub fn configure(&mut self, config: ControllerConfig, fade_s: f64) {
        let ControllerConfig { robot, incarnation, thread, law: present, .. } = self.config;
        let law = if law::is_same_kind(&present, &config.law) { config.law } else { present };
        let config = ControllerConfig { robot, incarnation, thread, law, ..config };
        if config == self.config {
            return;
        }
        self.config = config;
        match law {
            Law::PFeedforward(law) => self.own = Some(Box::new(law)),
            Law::Preview { preview: settings, .. } => {
                if let Some(preview) = &mut self.preview {
                    preview.configure(settings);
                }
            }
            Law::LqEndpoint { .. } | Law::Custom => {}
        }
        self.fades.iter_mut().for_each(|fade| fade.begin(fade_s));
    }

    /// Parameters of a law of one's own, as TOML.
    pub fn own_parameters(&self) -> String {
        self.own.as_ref().map(|own| own.parameters()).unwrap_or_default()
    }

    /// What it was told.
    pub fn config(&self) -> &ControllerConfig {
        &self.config
    }

    /// What an operator may want to know of the last steps: models identified, fallbacks.
    pub fn notice(&mut self) -> Option<Notice> {
        self.preview.as_mut().and_then(Preview::notice)
    }

    /// The answer to one cycle: one row per estimate of that cycle. Nothing is allocated.
    ///
    /// The cycle is that of the estimate in charge. Once that is answered, a newer estimate of the other slot gets an answer of its own, so
    /// that the death of an estimator costs no cycle. No sample of the slot that is not in charge changes what the one in charge is
    /// answered.
    ///
    /// Without a motion the answer is valid and zero: stand still. Without a position, a way to follow, or a finite
    /// result a row is not valid; motor-io then has no answer from this pair.
    pub fn step(&mut self, seen: &Inputs<'_>) -> (MotorCommand, ControlStatus) {
        self.begin_life(seen.authority);
        let estimates = self.live(seen);
        let lead = seen.authority.map_or(0, |authority| usize::from(authority.in_charge[ESTIMATORS]).min(SLOTS - 1));
        let first = seen.authority.and_then(|authority| self.to_answer(lead, &estimates, authority));
        let life = seen.authority.map_or(0, |authority| authority.header.life);
        // Without anything to answer to, it stands where the newest state does: a sample without a time has no place in a run file.
        let state_ns = seen.state.map_or(0, |state| state.header.stamp_ns);
        let now_ns =
            if state_ns == 0 { seen.authority.map_or(0, |authority| authority.header.stamp_ns) } else { state_ns };
        let mut header = Header { life, stamp_ns: now_ns, oldest_input_ns: now_ns, ..Header::default() };
        if let Some(first) = first {
            header = Header { seq: 0, published_ns: 0, ..first.header };
        }
        let (mut command, mut status) = self.blank(seen, &estimates, header);
        let (Some(authority), Some(_)) = (seen.authority, first) else { return (command, status) };
        let instant = Instant::of(&header, authority);
        let target = instant.and_then(|instant| self.target(seen.motion, authority, &instant));
        if let Some(instant) = instant {
            self.preview(seen, &estimates, authority, &instant, &header, lead);
        }
        match &self.preview {
            Some(preview) if preview.weight() >= 0.5 => status.horizon = preview.horizon() as u32,
            Some(_) => status.law = ControlStatus::LAW_LQ_ENDPOINT,
            None => {}
        }
        if let Some(target) = &target {
            command.segment = target.now.segment_id as u32;
            status.describe(target);
        }
        status.segment = command.segment;
        for (slot, estimate) in estimates.iter().enumerate() {
            let Some(estimate) = estimate.filter(|estimate| estimate.header.cycle == header.cycle) else { continue };
            let (epoch, segment) = (authority.epoch, command.segment);
            let answer = match &self.answered[slot] {
                Some(kept) if kept.estimate == *estimate && (kept.epoch, kept.segment) == (epoch, segment) => {
                    kept.answer
                }
                _ if estimate.header.stamp_ns == header.stamp_ns => {
                    self.answer(slot, estimate, target.as_ref(), authority.period_s)
                }
                // True at another instant: the set point of that instant.
                _ => {
                    let instant = Instant::of(&estimate.header, authority);
                    let target = instant.and_then(|instant| self.target(seen.motion, authority, &instant));
                    self.answer(slot, estimate, target.as_ref(), authority.period_s)
                }
            };
            self.answered[slot] = Some(Answered { estimate: *estimate, epoch, segment, answer });
            let Some(answer) = answer else { continue };
            for (i, velocity) in answer.velocities_m_s.iter().enumerate() {
                command.velocity_m_s[8 * slot + i] = *velocity;
            }
            command.valid[slot] = 1;
            // The status speaks of the estimate that motor-io uses; of the other one if that is all there is.
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

    /// Forgets what belongs to another life of motor-io: its cycles, motions and readings mean nothing in this one.
    fn begin_life(&mut self, authority: Option<&MotorAuthority>) {
        let life = authority.map_or(self.life, |authority| authority.header.life);
        if life != self.life {
            self.life = life;
            self.motion = None;
            self.answered = [None; SLOTS];
            self.fades.iter_mut().for_each(Fade::rest);
            if let Some(preview) = &mut self.preview {
                preview.begin_life();
            }
        }
    }

    /// The estimates that may be answered.
    fn live<'a>(&self, seen: &Inputs<'a>) -> [Option<&'a NodeEstimate>; SLOTS] {
        let ttl_cycles = self.config.estimate_ttl_cycles;
        let live = |estimate: &&NodeEstimate, authority: &MotorAuthority| {
            standing(&estimate.header, &authority.header, ttl_cycles) == Standing::Live
        };
        seen.estimates.map(|estimate| estimate.filter(|one| seen.authority.is_some_and(|by| live(one, by))))
    }

    /// The estimate whose cycle is answered: the one in charge, and a newer one of the other slot where that is answered already or its
    /// cycle is over, so that an answer would come too late.
    fn to_answer<'a>(
        &self,
        lead: usize,
        estimates: &[Option<&'a NodeEstimate>; SLOTS],
        authority: &MotorAuthority,
    ) -> Option<&'a NodeEstimate> {
        let done = |estimate: &NodeEstimate| {
            let cycle = estimate.header.cycle;
            let answered = self.answered[lead].is_some_and(|kept| kept.estimate.header.cycle == cycle);
            answered || cycle < authority.header.cycle
        };
        match (estimates[lead], estimates[1 - lead]) {
            (Some(first), Some(other)) if other.header.cycle > first.header.cycle && done(first) => Some(other),
            (first, other) => first.or(other),
        }
    }

    /// An answer without rows, and the account of what it rests on.
    fn blank(
        &self,
        seen: &Inputs<'_>,
        estimates: &[Option<&NodeEstimate>; SLOTS],
        header: Header,
    ) -> (MotorCommand, ControlStatus) {
        let config = &self.config;
        let command = MotorCommand {
            header,
            based_on_cycle: header.cycle,
            epoch: seen.authority.map_or(0, |authority| authority.epoch),
            incarnation: config.incarnation,
            ttl_cycles: config.ttl_cycles,
            thread: config.thread,
            ..MotorCommand::default()
        };
        let status = ControlStatus {
            header,
            based_on_estimate: estimates.map(|estimate| estimate.map_or(0, |estimate| estimate.header.cycle)),
            based_on_authority: seen.authority.map_or(0, |authority| authority.header.cycle),
            based_on_state: seen.state.map_or(0, |state| state.header.cycle),
            based_on_motion: seen.motion.map_or(0, |motion| motion.beat),
            horizon: config.horizon,
            incarnation: config.incarnation,
            law: config.law.number(),
            chosen_law: config.law.number(),
            cable_count: config.robot.cable_count() as u8,
            ..ControlStatus::default()
        };
        (command, status)
    }

    /// Tells the preview law about the cycle of `header`, which is that of the slot in charge, `lead`, or of the other one.
    fn preview(
        &mut self,
        seen: &Inputs<'_>,
        estimates: &[Option<&NodeEstimate>; SLOTS],
        authority: &MotorAuthority,
        instant: &Instant,
        header: &Header,
        lead: usize,
    ) {
        let cycle = header.cycle;
        // A cycle without readings has no say: what claims one may be a broken estimator.
        let of_cycle = |state: &&MotorState| state.header.cycle == cycle && same_life(&state.header, &authority.header);
        let Some(state) = seen.state.filter(of_cycle) else { return };
        // The other slot may speak between motor/state and motor/authority. What is learnt of a cycle does not depend on that.
        let led = estimates[lead].is_some_and(|estimate| estimate.header.cycle == cycle);
        if !led && authority.header.cycle != cycle {
            return;
        }
        let answered = self.answered[lead].is_some_and(|kept| kept.estimate.header.cycle == cycle);
        let Some(mut preview) = self.preview.take() else { return };
        preview.observe(state, authority, instant.began_ns);
        for (slot, estimate) in estimates.iter().enumerate() {
            let Some(estimate) = estimate.filter(|estimate| estimate.header.cycle == cycle) else { continue };
            let since_s = Instant::of(&estimate.header, authority).map_or(instant.since_s, |instant| instant.since_s);
            preview.correct(slot, estimate, since_s, &state.velocity_m_s);
        }
        let ahead = (led && !answered) || !preview.looked_ahead(cycle);
        if let Some(Kept { motion: Some(motion), .. }) = self.motion.as_ref().filter(|_| ahead) {
            let robot = &self.config.robot;
            // What stretch takes from the straight lengths; where no tensions are found, as much as just before.
            let mut stretch = CableVec::zeros(robot.cable_count());
            preview.look_ahead(authority, instant.lag, |time_s, rate| {
                let setpoint = at_rate(motion, time_s, rate);
                match self.held(&setpoint) {
                    Some(held) => {
                        stretch = held.lengths_m.zip_map(&held.unstretched_m, |straight, paid| straight - paid);
                        held.unstretched_m
                    }
                    None => inverse_kinematics(robot.anchors(), &setpoint.position).zip_map(&stretch, |l, s| l - s),
                }
            });
        }
        self.preview = Some(preview);
    }

    /// The target at the instant of the estimate; `None` without a motion of the present epoch.
    ///
    /// The motion that the robot is in the middle of outlives its planner: while the epoch holds, what is known of it is followed, whatever
    /// a planner that was started anew has to say.
    fn target(
        &mut self,
        message: Option<&PlanMotion>,
        authority: &MotorAuthority,
        instant: &Instant,
    ) -> Option<Target> {
        let message = message.filter(|message| {
            message.motion != 0 && message.epoch == authority.epoch && same_life(&message.header, &authority.header)
        });
        let orphaned = self.motion.is_some_and(|kept| {
            let under_way = authority.motion != 0 && (authority.motion, authority.epoch) == (kept.number, kept.epoch);
            under_way && message.is_none_or(|message| message.motion != kept.number || message.beat < kept.beat)
        });
        if !orphaned {
            let message = message?;
            if self.motion.is_none_or(|kept| (kept.beat, kept.number) != (message.beat, message.motion)) {
                let (beat, number, epoch) = (message.beat, message.motion, message.epoch);
                self.motion = Some(Kept { beat, number, epoch, motion: motion_of(message) });
            }
        }
        let motion = self.motion.and_then(|kept| kept.motion)?;
        let (period_s, rate) = (authority.period_s, authority.plan_rate);
        // The plan time is that of the beginning of the cycle; the estimate is true some milliseconds later, when the
        // encoders had been read.
        let now_s = authority.plan_time_s + rate * (instant.since_s + period_s * instant.lag as f64);
        let now = at_rate(&motion, now_s, rate);
        let ahead = at_rate(&motion, now_s + rate * period_s * f64::from(self.config.horizon), rate);
        Some(Target { now_held: self.held(&now), ahead_held: self.held(&ahead), now, ahead })
    }

    /// Lengths and tensions at a setpoint. At the very limit of what the lines can hold acceleration and drag are left
    /// out rather than giving up: the planner has checked the motion as planned.
    fn held(&self, setpoint: &Setpoint) -> Option<Realisation> {
        let ControllerConfig { robot, distribution, .. } = &self.config;
        let moving_n = robot.moving_wrench_n(&setpoint.velocity, &setpoint.acceleration);
        elastic::realise_under(robot, &setpoint.position, &moving_n, *distribution)
            .or_else(|_| elastic::realise(robot, &setpoint.position, &Vector3::zeros(), *distribution))
            .ok()
    }

    fn answer(
        &mut self,
        slot: usize,
        estimate: &NodeEstimate,
        target: Option<&Target>,
        period_s: f64,
    ) -> Option<Answer> {
        let config = self.config;
        let n = config.robot.cable_count();
        if estimate.valid == 0 || usize::from(estimate.cable_count) != n {
            return None;
        }
        let Some(target) = target else {
            let velocities_m_s = CableVec::zeros(n);
            self.fades[slot].rest();
            return Some(Answer { velocities_m_s, error_m: Vector3::zeros(), saturation: 0.0, redundant_m: 0.0 });
        };
        let position = Vector3::from(estimate.position_m);
        let error_m = target.now.position - position;
        if error_m.norm().is_nan() || error_m.norm() > config.error_limit_m {
            return None;
        }
        let (u, redundant_m) = match self.own.take() {
            None => self.endpoint(slot, estimate, target, position, period_s)?,
            Some(mut own) => {
                let u = own.velocity(&LawInput {
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
                self.own = Some(own);
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
        fade.sent(estimate.header.cycle, &scaled.velocities_m_s);
        Some(Answer {
            velocities_m_s: scaled.velocities_m_s,
            error_m,
            saturation: u.max_abs() / config.cable_speed_limit_m_s,
            redundant_m,
        })
    }

    /// The paper's law, or the preview law as far as it has a say; and what the redundant lengths lack, m.
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
            // The law moves the node as if lines were rigid and straight moves had constant Jacobians. What the
            // unstretched lengths do beyond that over the horizon is known in advance and goes along.
            let horizon_s = period_s * f64::from(config.horizon);
            let straight = jacobian.cable_velocity(&(target.ahead.position - target.now.position));
            for i in 0..n {
                u[i] += (ahead.unstretched_m[i] - now.unstretched_m[i] - straight[i]) / horizon_s;
            }
            let mut behind = CableVec::zeros(n);
            if config.robot.redundancy() > 0 {
                behind = redundant(&jacobian, &node_jacobian, now, estimate);
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

/// The setpoint on a plan clock that runs at `rate`: a slower motion along the same path.
fn at_rate(motion: &Motion, time_s: f64, rate: f64) -> Setpoint {
    let at = motion.setpoint(time_s);
    Setpoint { velocity: at.velocity * rate, acceleration: at.acceleration * (rate * rate), ..at }
}

/// What the lengths lack in the directions that do not move the node: (I - J B)(l* - l), m. For four cables in
/// space that is one direction, the null vector of Jᵀ, which is also the direction in which tensions trade places; in a
/// plane it is two.
fn redundant(
    jacobian: &Jacobian,
    node_jacobian: &NodeJacobian,
    now: &Realisation,
    estimate: &NodeEstimate,
) -> CableVec {
    let missing = now.unstretched_m.zip_map(&estimate.predicted_m, |wanted, is| wanted - is);
    let moving = jacobian.cable_velocity(&node_jacobian.node_velocity(&missing));
    missing.zip_map(&moving, |all, part| all - part)
}

/// What a row was computed for, and the result.
#[derive(Debug, Clone, Copy)]
struct Answered {
    estimate: NodeEstimate,
    epoch: u32,
    segment: u32,
    answer: Option<Answer>,
}

#[derive(Debug, Clone, Copy)]
struct Answer {
    velocities_m_s: CableVec,
    error_m: Vector3<f64>,
    saturation: f64,
    redundant_m: f64,
}

trait Describe {
    fn describe(&mut self, target: &Target);
}

impl Describe for ControlStatus {
    fn describe(&mut self, target: &Target) {
        self.setpoint_m = target.now.position.into();
        self.setpoint_velocity_m_s = target.now.velocity.into();
        if let Some(held) = &target.now_held {
            self.tension_n = held.tensions_n.to_array8();
        }
    }
}
