//! Requests of the operator: what each does in each mode, and its answer.
#![allow(clippy::result_large_err)] // a reason in place: the loop does not allocate, so nothing is boxed

use crate::answer::Answer;
use crate::arbiter::role::Refusal;
use crate::core::Core;
use crate::mode::{Jog, Mode, Stop};
use crate::plan_clock::SLOWEST;
use crate::settings::{CoreConfig, JOG_LIMIT_M};
use cable_robot::{Border, Contact, Vector3, elastic, kinematics, tension};
use messages::faults::{Faults, STOPS};
use messages::{CONTROLLERS, MotorAuthority, MotorInput, MotorState, Request, RequestBody, Slot, SlotRole};
use robot_state::Reason;
use robot_state::answers::detail;
use robot_state::sentences::StandbyRefusal;

/// Requests older than this are rejected, s: the situation has changed, and the requester has timed out.
const STALE_S: f64 = 5.0;

/// Whether a request can only bring the robot to rest: such a request is carried out at any age.
fn brings_to_rest(request: &Request) -> bool {
    request.is_stop() || *request == Request::Disarm
}

/// Whether a request moves the robot, or permits motion: such a request is refused if the robot was told to stop after
/// it was made, in whichever order the two arrive. `goto` and `run` are for the planner; their motion states when it
/// was asked for, see [`Core::record_order`].
fn may_move(request: &Request) -> bool {
    matches!(request, Request::Arm | Request::Reset | Request::Resume | Request::Jog { .. } | Request::Soft)
}

/// Why a request is refused, and otherwise why it is accepted.
type Outcome = Result<Reason, Reason>;

impl Core {
    /// Carries out one request that was made at `made_ns`; 0: now. A late request may bring the robot to rest and never
    /// moves it.
    pub(crate) fn request(&mut self, input: &MotorInput, id: u64, body: &RequestBody, made_ns: u64) -> Answer {
        let made_ns = if made_ns == 0 { input.begin_ns } else { made_ns };
        let age_s = input.begin_ns.saturating_sub(made_ns) as f64 * 1e-9;
        if body.is_stop() {
            // A stop of the future would forbid motion until then.
            self.stopped_ns = self.stopped_ns.max(made_ns.min(input.begin_ns));
        }
        let epoch = self.safety.epoch();
        let outcome = match Request::from_body(body) {
            Ok(request) if age_s > STALE_S && !brings_to_rest(&request) => Err(Reason::TooLate { age_s }),
            Ok(request) if made_ns < self.stopped_ns && may_move(&request) => Err(Reason::OvertakenByStop),
            Ok(request) => self.carry_out(input, &request),
            Err(error) => Err(Reason::Undecodable { why: detail(error) }),
        };
        self.record_order(body, &outcome, made_ns.min(input.begin_ns), epoch);
        let (Ok(reason) | Err(reason)) = outcome;
        Answer { id, verb: body.verb, reason }
    }

    /// Records a request after which no motion begins that was asked for before `made_ns`. `epoch`: that before it.
    fn record_order(&mut self, body: &RequestBody, outcome: &Outcome, made_ns: u64, epoch: u32) {
        let suspends = matches!(body.verb, RequestBody::VERB_HOLD | RequestBody::VERB_PAUSE);
        if self.safety.epoch() != epoch || (body.is_stop() && !suspends) {
            self.ended_ns = self.ended_ns.max(made_ns);
        } else if suspends && outcome.is_ok() {
            self.held_ns = self.held_ns.max(made_ns);
        } else if body.verb == RequestBody::VERB_RESUME && matches!(outcome, Ok(_) | Err(Reason::NothingPaused)) {
            // Also for a motion that is still to come, as after the map that a mission waits for.
            self.held_ns = 0;
        }
    }

    fn carry_out(&mut self, input: &MotorInput, request: &Request) -> Outcome {
        match request {
            Request::Arm => self.arm(),
            Request::Disarm => self.disarm(),
            Request::Hold | Request::Pause => self.pause(input),
            Request::Stop => self.stop_request(),
            Request::Estop => self.emergency_stop(),
            Request::Reset => self.reset(),
            Request::ZeroAt { position_m } => self.zero_at(Vector3::from(*position_m)),
            Request::ZeroLengths { lengths_m } => self.zero_lengths(lengths_m),
            Request::ConfirmPosition => self.confirm_position(),
            Request::Jog { cable, distance_m } => self.start_jog(usize::from(*cable), *distance_m),
            Request::Soft => self.start_soft(),
            Request::Resume => self.resume(input),
            Request::Speed { rate } => self.set_speed(*rate),
            Request::Swap { role, slot } => self.swap(input, *role, *slot),
            Request::Admit { role, slot } => self.admit(*role, *slot),
            Request::Goto { .. } | Request::Run { .. } => Err(Reason::ForPlanner),
            Request::Fault { .. } => Err(Reason::ForMotorBox),
            Request::StartProcess { .. }
            | Request::StopProcess { .. }
            | Request::RestartProcess { .. }
            | Request::Plug { .. }
            | Request::Unplug { .. }
            | Request::Mark { .. }
            | Request::Set { .. } => Err(Reason::ForSupervisor),
        }
    }

    fn arm(&mut self) -> Outcome {
        match self.safety.mode() {
            Mode::Disarmed => {}
            Mode::Faulted | Mode::EmergencyStop => {
                return Err(Reason::NotArmedStopped);
            }
            _ => return Ok(Reason::AlreadyArmed),
        }
        let faults = self.safety.persisting();
        if faults.bits != 0 {
            return Err(Reason::NotArmedFaults { faults });
        }
        if !self.odometry.complete() {
            return Err(Reason::NotArmedEncoders);
        }
        self.safety.arm();
        Ok(match self.odometry.position() {
            MotorState::POSITION_KNOWN => Reason::Armed,
            MotorState::POSITION_RESTORED => Reason::ArmedRestored,
            _ => Reason::ArmedUnknown,
        })
    }

    fn disarm(&mut self) -> Outcome {
        match *self.safety.mode() {
            Mode::Following(_) | Mode::Stopping(_) | Mode::Jogging(_) | Mode::Soft(_) => Err(Reason::NotDisarmedMoving),
            Mode::Disarmed => Ok(Reason::AlreadyDisarmed),
            _ if self.limits.last_speed() != 0.0 => Err(Reason::NotDisarmedYet),
            mode => {
                self.abandon();
                self.safety.disarm();
                Ok(if mode.is_latched() { Reason::DisarmedFaulted } else { Reason::Disarmed })
            }
        }
    }

    fn pause(&mut self, input: &MotorInput) -> Outcome {
        match self.safety.mode_mut() {
            Mode::Following(following) => {
                following.pausing = true;
                Ok(Reason::Pausing)
            }
            Mode::Jogging(jog) => {
                jog.cancelled = true;
                Ok(Reason::JogEnds)
            }
            Mode::Soft(_) => {
                self.end_soft(0);
                Ok(Reason::SoftEnds)
            }
            Mode::Holding => {
                // A motion that begins in this cycle begins paused.
                if self.motion.is_offered(input, self.safety.epoch(), self.clock.time_s(), self.config.period_s)
                    && self.begins_here(input)
                {
                    self.motion.begin(input);
                }
                Ok(Reason::AlreadyHolding)
            }
            Mode::Stopping(_) => Ok(Reason::AlreadyStopping),
            Mode::Disarmed => Err(Reason::NotHeld),
            Mode::Faulted | Mode::EmergencyStop => Ok(Reason::StoppedByFault),
        }
    }

    fn resume(&mut self, input: &MotorInput) -> Outcome {
        match self.safety.mode_mut() {
            Mode::Following(following) if following.pausing => {
                following.pausing = false;
                Ok(Reason::Resumed)
            }
            Mode::Following(_) => Ok(Reason::MotionRuns),
            Mode::Holding if self.motion.id() != 0 => {
                let lost = self.who_is_lost();
                if lost != 0 {
                    return Err(Reason::NotResumedFaults { faults: Faults { bits: lost, ..Faults::default() } });
                }
                if self.odometry.position() != MotorState::POSITION_KNOWN {
                    return Err(Reason::NotResumedPosition);
                }
                if input.motion != self.motion.id() || input.motion_epoch != self.safety.epoch() {
                    return Err(Reason::NotResumedMotion);
                }
                let Some(chosen) = self.chosen_in_charge().filter(|chosen| self.motion.has(chosen.segment)) else {
                    return Err(Reason::NotResumedController);
                };
                let most_m = self.config.divergence_m;
                if let Some(off_m) = self.setpoint_distance_m(input).filter(|off_m| *off_m > most_m) {
                    return Err(Reason::NotResumedAway { off_m, most_m });
                }
                self.follow(&chosen);
                Ok(Reason::ResumedMotion)
            }
            Mode::Holding | Mode::Soft(_) => Err(Reason::NothingPaused),
            Mode::Stopping(_) => Err(Reason::NotResumedStopping),
            Mode::Jogging(_) => Err(Reason::NotResumedJogging),
            Mode::Disarmed => Err(Reason::NotResumedDisarmed),
            Mode::Faulted | Mode::EmergencyStop => Err(Reason::NotResumedFault),
        }
    }

    fn stop_request(&mut self) -> Outcome {
        match self.safety.mode_mut() {
            Mode::Following(following) => {
                let stop = Stop { dropped: true, ..Stop::on_path(following.steering) };
                self.begin_stop(stop, 0);
                Ok(Reason::Stopping)
            }
            Mode::Stopping(stop) => {
                stop.dropped = true;
                Ok(Reason::StoppingDropped)
            }
            Mode::Jogging(jog) => {
                jog.cancelled = true;
                Ok(Reason::JogEnds)
            }
            Mode::Soft(_) => {
                self.end_soft(0);
                Ok(Reason::SoftEnds)
            }
            Mode::Holding => {
                let kept = self.motion.id() != 0;
                self.abandon();
                self.safety.clear_stops(STOPS);
                self.safety.start_epoch();
                Ok(if kept { Reason::RestDropped } else { Reason::AlreadyAtRest })
            }
            Mode::Disarmed => {
                self.safety.start_epoch();
                Ok(Reason::NothingMoves)
            }
            Mode::Faulted | Mode::EmergencyStop => Ok(Reason::StoppedByFault),
        }
    }

    fn emergency_stop(&mut self) -> Outcome {
        self.safety.enter(Mode::EmergencyStop);
        self.safety.start_epoch();
        self.abandon();
        Ok(if self.safety.energised() { Reason::EmergencyStop } else { Reason::EmergencyStopOff })
    }

    fn reset(&mut self) -> Outcome {
        match self.safety.mode() {
            Mode::Following(_) | Mode::Stopping(_) | Mode::Jogging(_) | Mode::Soft(_) => Err(Reason::NotResetMoving),
            Mode::Holding => {
                self.abandon();
                self.safety.clear_stops(STOPS);
                self.safety.start_epoch();
                Ok(Reason::Reset)
            }
            _ if self.limits.last_speed() != 0.0 => Err(Reason::NotResetYet),
            _ => {
                if !self.safety.reset() {
                    return Err(Reason::NotResetFaults { faults: self.safety.persisting() });
                }
                self.watch.clear();
                self.slips.clear();
                if !self.safety.energised() {
                    return Ok(Reason::ResetDisarmed);
                }
                let known = self.odometry.position() == MotorState::POSITION_KNOWN;
                Ok(if known { Reason::Reset } else { Reason::ResetUncertain })
            }
        }
    }

    /// Zeroing changes every length, so it is refused while the robot moves.
    fn may_zero(&self) -> Result<(), Reason> {
        match self.safety.mode() {
            Mode::Following(_) | Mode::Stopping(_) | Mode::Jogging(_) | Mode::Soft(_) => Err(Reason::NotZeroedMoving),
            Mode::Faulted | Mode::EmergencyStop => Err(Reason::NotZeroedFault),
            Mode::Holding | Mode::Disarmed if !self.odometry.complete() => Err(Reason::NotZeroedEncoders),
            Mode::Holding | Mode::Disarmed => Ok(()),
        }
    }

    /// Sets the lengths, with the node at that position, m; `None`: they fit no position.
    fn zero(&mut self, lengths_m: &[f64], at: Option<Vector3<f64>>) {
        self.abandon();
        // The margins of obstacles count the errors of the lengths from here.
        self.config.robot = self.config.robot.with_lengths_set_at(at.as_ref());
        self.odometry.set(lengths_m);
        self.safety.start_epoch();
    }

    fn zero_at(&mut self, at: Vector3<f64>) -> Outcome {
        self.may_zero()?;
        if !at.iter().all(|v| v.is_finite() && v.abs() < 1e5) {
            return Err(Reason::NotAPosition { position_m: at.into() });
        }
        let robot = &self.config.robot;
        if robot.is_planar() && at.y != 0.0 {
            return Err(Reason::OutOfPlane { y_m: at.y });
        }
        let held = match tension::at(robot, &at, &Vector3::zeros(), self.config.distribution) {
            Ok(held) => held,
            Err(error) => return Err(Reason::CannotHang { position_m: at.into(), why: detail(error) }),
        };
        let straight = kinematics::inverse_kinematics(robot.anchors(), &at);
        let lengths = elastic::unstretched(robot, &at, &straight, &held.tensions_n);
        self.check_lengths(&lengths)?;
        self.zero(&lengths, Some(at));
        Ok(Reason::ZeroedAt { position_m: at.into() })
    }

    fn zero_lengths(&mut self, lengths_m: &[f64]) -> Outcome {
        self.may_zero()?;
        let cables = self.config.cable_count();
        if lengths_m.len() != cables {
            return Err(Reason::LengthCount { given: lengths_m.len(), cables });
        }
        self.check_lengths(lengths_m)?;
        let at = elastic::equilibrium(&self.config.robot, lengths_m, &Vector3::zeros(), None).ok();
        self.zero(lengths_m, at.map(|at| at.position));
        Ok(Reason::ZeroedLengths { cables })
    }

    fn check_lengths(&self, lengths_m: &[f64]) -> Result<(), Reason> {
        let limits_m = self.config.robot.length_limits_m();
        for (i, (&length_m, &[low_m, high_m])) in lengths_m.iter().zip(limits_m).enumerate() {
            if !(low_m..=high_m).contains(&length_m) {
                return Err(Reason::LengthLimit { cable: i + 1, length_m, low_m, high_m });
            }
        }
        Ok(())
    }

    fn confirm_position(&mut self) -> Outcome {
        match (self.safety.mode(), self.odometry.position()) {
            (_, MotorState::POSITION_KNOWN) => Ok(Reason::PositionKnown),
            (_, MotorState::POSITION_UNKNOWN) => Err(Reason::NoPosition),
            (Mode::Following(_) | Mode::Stopping(_) | Mode::Jogging(_) | Mode::Soft(_), _) => {
                Err(Reason::NotConfirmedMoving)
            }
            _ => {
                self.abandon();
                self.odometry.confirm();
                self.safety.start_epoch();
                Ok(Reason::Confirmed)
            }
        }
    }

    /// `number`: from 1.
    fn start_jog(&mut self, number: usize, distance_m: f64) -> Outcome {
        let cables = self.config.cable_count();
        if !(1..=cables).contains(&number) {
            return Err(Reason::NoCable { cable: number, cables });
        }
        if !distance_m.is_finite() || distance_m == 0.0 || distance_m.abs() > JOG_LIMIT_M {
            return Err(Reason::NoDistance { distance_m, most_m: JOG_LIMIT_M });
        }
        match self.safety.mode() {
            Mode::Holding => {}
            Mode::Jogging(_) => return Err(Reason::AlreadyJogging),
            Mode::Following(_) | Mode::Stopping(_) | Mode::Soft(_) => return Err(Reason::NotJoggedMoving),
            Mode::Disarmed => return Err(Reason::NotJoggedDisarmed),
            Mode::Faulted | Mode::EmergencyStop => return Err(Reason::NotJoggedFault),
        }
        let lost = self.who_is_lost() & MotorAuthority::FAULT_SUPERVISOR_LOST;
        if lost != 0 {
            return Err(Reason::NotJoggedFaults { faults: Faults { bits: lost, ..Faults::default() } });
        }
        if self.motion.id() != 0 {
            return Err(Reason::NotJoggedPaused);
        }
        let cable = number - 1;
        if self.odometry.position() != MotorState::POSITION_UNKNOWN {
            let [low_m, high_m] = self.config.robot.length_limits_m()[cable];
            let (now_m, then_m) = (self.odometry.length_m(cable), self.odometry.length_m(cable) + distance_m);
            if (then_m > high_m && distance_m > 0.0) || (then_m < low_m && distance_m < 0.0) {
                return Err(Reason::NotJoggedLimit { cable: number, now_m, then_m, low_m, high_m });
            }
        }
        match self.border(cable, distance_m) {
            None => {}
            Some(Border::KeepOut(index)) => return Err(Reason::NotJoggedBox { cable: number, number: index + 1 }),
            Some(Border::Obstacle(Contact { obstacle, cable: near })) => {
                let part = near.map_or(0, |near| near + 1);
                return Err(Reason::NotJoggedBorder { cable: number, part, obstacle: obstacle + 1 });
            }
        }
        self.safety.clear_stops(MotorAuthority::FAULT_BORDER);
        self.safety.enter(Mode::Jogging(Jog { cable, left_m: distance_m, cancelled: false }));
        Ok(Reason::Jogging { cable: number, distance_m })
    }

    fn start_soft(&mut self) -> Outcome {
        match self.safety.mode() {
            Mode::Holding => {}
            Mode::Soft(_) => return Ok(Reason::AlreadySoft),
            Mode::Following(_) | Mode::Stopping(_) | Mode::Jogging(_) => return Err(Reason::NotSoftMoving),
            Mode::Disarmed => return Err(Reason::NotSoftDisarmed),
            Mode::Faulted | Mode::EmergencyStop => return Err(Reason::NotSoftFault),
        }
        if let Some(port) = self.config.port_without_torque {
            return Err(Reason::NotSoftDrives { port });
        }
        let lost = self.who_is_lost() & MotorAuthority::FAULT_SUPERVISOR_LOST;
        let faults = Faults { bits: self.safety.persisting().bits | lost, ..self.safety.persisting() };
        if faults.bits != 0 {
            return Err(Reason::NotSoftFaults { faults });
        }
        if self.motion.id() != 0 {
            return Err(Reason::NotSoftPaused);
        }
        let soft = self.soften()?;
        self.safety.clear_stops(STOPS);
        self.safety.start_epoch();
        self.safety.enter(Mode::Soft(soft));
        Ok(Reason::Soft)
    }

    fn set_speed(&mut self, rate: f64) -> Outcome {
        if self.clock.set_speed(rate) {
            Ok(Reason::SpeedSet { rate })
        } else {
            Err(Reason::NoSpeed { rate, slowest: SLOWEST })
        }
    }

    fn swap(&mut self, input: &MotorInput, role: SlotRole, slot: Slot) -> Outcome {
        let (of_role, at) = (role.index(), slot.index());
        let most_m = self.config.divergence_m;
        if let Some((off_m, within_s)) = self.swap_moves_off(of_role, at)
            && off_m > most_m
            && self.arbiter.slot(of_role, at).phase().is_standby()
        {
            return Err(Reason::SwapMovesOff { role, slot, off_m, within_s, most_m });
        }
        match self.arbiter.announce(of_role, at, input.header.cycle) {
            Ok(cycle) => Ok(Reason::Swapping { role, slot, cycle }),
            Err(Refusal::InCharge) => Ok(Reason::InCharge { role, slot }),
            Err(Refusal::UnderWay) => Err(Reason::SwapUnderWay),
            Err(_) => Err(Reason::NotSwapped { slot, why: self.why_not(of_role, at) }),
        }
    }

    /// How far a controller would move the node off its path until the swap to it is over, m, and within which time, s.
    /// It counts half of its mean difference from the controller in charge while the commands fade, and all of it
    /// during the probation.
    fn swap_moves_off(&self, role: usize, slot: usize) -> Option<(f64, f64)> {
        if role != CONTROLLERS {
            return None;
        }
        let CoreConfig { fade_s, probation_s, .. } = self.config;
        let node_m_s = self.node.velocity_of(self.arbiter.bias_m_s(slot))?.norm();
        Some((node_m_s * (0.5 * fade_s + probation_s), fade_s + probation_s))
    }

    /// Why a slot is not a standby.
    fn why_not(&self, role: usize, slot: usize) -> StandbyRefusal {
        let seat = self.arbiter.slot(role, slot);
        StandbyRefusal {
            role,
            phase: seat.phase() as u8,
            cause: seat.cause(),
            verdict: self.arbiter.verdict()[slot],
            well_s: f64::from(seat.good_answers()) * self.config.period_s,
            qualify_s: self.config.qualify_s,
            moves_off: self.swap_moves_off(role, slot),
        }
    }

    fn admit(&mut self, role: SlotRole, slot: Slot) -> Outcome {
        Ok(match self.arbiter.admit(role.index(), slot.index()) {
            Ok(()) => Reason::Admitted { role, slot },
            Err(Refusal::InCharge) => Reason::InCharge { role, slot },
            Err(_) => Reason::NotQuarantined { role, slot },
        })
    }
}
