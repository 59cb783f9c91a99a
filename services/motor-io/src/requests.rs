//! What the operator asks for, and what is answered in each mode.
#![allow(clippy::result_large_err)] // a sentence in place: in the loop nothing is allocated, so nothing is boxed

use crate::answer::{Answer, Sentence, sentence};
use crate::arbiter::role::Refusal;
use crate::core::Core;
use crate::mode::{Jog, Mode, Stop};
use crate::plan_clock::SLOWEST;
use crate::settings::{CoreConfig, JOG_LIMIT_M};
use cable_robot::{Vector3, elastic, kinematics, tension};
use messages::faults::{Faults, STOPS};
use messages::{CONTROLLERS, MotorAuthority, MotorInput, MotorState, OperatorRequest, ROLES, SLOT_NAMES, SLOTS};
use robot_state::sentences::{FaultList, ROLE_NAMES, WhyNot};

/// A number as it was given; huge ones in powers of ten, so that they leave room for the rest of the sentence.
struct Given(f64);

impl std::fmt::Display for Given {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        if self.0.abs() < 1e6 && (self.0 == 0.0 || self.0.abs() > 1e-6) {
            write!(f, "{}", self.0)
        } else {
            write!(f, "{:e}", self.0)
        }
    }
}

/// A request older than this was made in another situation, and whoever made it has been told that nobody answered, s.
const STALE_S: f64 = 5.0;
/// What is done however late it comes.
const ALWAYS_ACCEPTED: [u8; 5] = [
    OperatorRequest::VERB_ESTOP,
    OperatorRequest::VERB_STOP,
    OperatorRequest::VERB_HOLD,
    OperatorRequest::VERB_PAUSE,
    OperatorRequest::VERB_DISARM,
];

/// Refused: not now or as bad input, and why.
type Refused = (u8, Sentence);
/// Accepted or refused, with its sentence.
type Outcome = Result<Sentence, Refused>;

macro_rules! yes { ($($text:tt)*) => { Ok(sentence(format_args!($($text)*))) }; }
macro_rules! no { ($($text:tt)*) => { Err((OperatorRequest::REFUSED, sentence(format_args!($($text)*)))) }; }
macro_rules! bad { ($($text:tt)*) => { Err((OperatorRequest::BAD_INPUT, sentence(format_args!($($text)*)))) }; }

impl Core {
    /// Does what one request asks for, or says why not.
    /// `age_s`: how long ago it was made. What comes too late makes the robot rest, but never move.
    pub(crate) fn request(&mut self, input: &MotorInput, id: u64, verb: u8, args: &[f64; 8], age_s: f64) -> Answer {
        let outcome = match verb {
            _ if age_s > STALE_S && !ALWAYS_ACCEPTED.contains(&verb) => no!(
                "Not done: the request came {age_s:.0} s after it was made, and the robot may be elsewhere by now; ask again."
            ),
            OperatorRequest::VERB_ARM => self.arm(),
            OperatorRequest::VERB_DISARM => self.disarm(),
            OperatorRequest::VERB_HOLD | OperatorRequest::VERB_PAUSE => self.pause(input),
            OperatorRequest::VERB_STOP => self.stop_request(),
            OperatorRequest::VERB_ESTOP => self.emergency_stop(),
            OperatorRequest::VERB_RESET => self.reset(),
            OperatorRequest::VERB_ZERO_AT => self.zero_at(args),
            OperatorRequest::VERB_ZERO_LENGTHS => self.zero_lengths(args),
            OperatorRequest::VERB_CONFIRM_POSITION => self.confirm_position(),
            OperatorRequest::VERB_JOG => self.start_jog(args),
            OperatorRequest::VERB_RESUME => self.resume(input),
            OperatorRequest::VERB_SPEED => self.set_speed(args[0]),
            OperatorRequest::VERB_SWAP => self.swap(input, args),
            OperatorRequest::VERB_ADMIT => self.admit(args),
            OperatorRequest::VERB_GOTO | OperatorRequest::VERB_RUN => {
                bad!("Motions are planned by the planner; send this request to it.")
            }
            OperatorRequest::VERB_FAULT => bad!("Faults are made by the virtual motor box; send this request to it."),
            other => bad!(
                "There is no request number {other}; this program and the one that asked are of different versions."
            ),
        };
        let (accepted, sentence) = match outcome {
            Ok(sentence) => (OperatorRequest::ACCEPTED, sentence),
            Err(refused) => refused,
        };
        Answer { id, verb, accepted, sentence }
    }

    fn arm(&mut self) -> Outcome {
        match self.safety.mode() {
            Mode::Disarmed => {}
            Mode::Faulted | Mode::EmergencyStop => {
                return no!("Not armed: the robot is stopped by a fault; reset it first.");
            }
            _ => return yes!("Already armed."),
        }
        let lasting = self.safety.lasting();
        if lasting.bits != 0 {
            return no!("Not armed: {}.", FaultList(&lasting));
        }
        if !self.odometry.complete() {
            return no!("Not armed: not every encoder has been read yet; try again in a second.");
        }
        self.safety.arm();
        match self.odometry.position() {
            MotorState::POSITION_KNOWN => yes!("Armed: the drives hold the lines."),
            MotorState::POSITION_FROM_BEFORE_THE_CUT => {
                yes!(
                    "Armed: the drives hold the lines; the position is the one kept from before motor-io was started, so look where the node is and confirm it or zero before a motion."
                )
            }
            _ => yes!("Armed: the drives hold the lines; the position is unknown, so zero before a motion."),
        }
    }

    fn disarm(&mut self) -> Outcome {
        match *self.safety.mode() {
            Mode::Following(_) | Mode::Stopping(_) | Mode::Jogging(_) => {
                no!("Not disarmed: the robot moves; stop first.")
            }
            Mode::Disarmed => yes!("Already disarmed."),
            _ if self.limits.last_speed() != 0.0 => {
                no!("Not disarmed: the robot is still coming to rest; try again in a second.")
            }
            mode => {
                self.abandon();
                self.safety.disarm();
                match mode {
                    Mode::Holding => yes!("Disarmed: the drives have let go, and the node may sink."),
                    _ => yes!("The drives have let go, and the node may sink; the fault stays until it is reset."),
                }
            }
        }
    }

    fn pause(&mut self, input: &MotorInput) -> Outcome {
        match self.safety.mode_mut() {
            Mode::Following(following) => {
                following.pausing = true;
                yes!(
                    "Pausing: the robot comes to rest on its path and holds; resume goes on, stop gives the motion up."
                )
            }
            Mode::Jogging(jog) => {
                jog.cancelled = true;
                yes!("The cable comes to rest and holds.")
            }
            Mode::Holding => {
                // A motion that would begin in this very cycle begins paused.
                if self.motion.offered(input, self.safety.epoch(), self.clock.time_s(), self.config.period_s)
                    && self.begins_here(input)
                {
                    self.motion.begin(input);
                }
                yes!("Already holding.")
            }
            Mode::Stopping(_) => yes!("Already coming to rest."),
            Mode::Disarmed => no!("The drives are off, so nothing can be held; arm first."),
            Mode::Faulted | Mode::EmergencyStop => yes!("Already stopped by a fault; reset it to go on."),
        }
    }

    fn resume(&mut self, input: &MotorInput) -> Outcome {
        match self.safety.mode_mut() {
            Mode::Following(following) if following.pausing => {
                following.pausing = false;
                yes!("Going on.")
            }
            Mode::Following(_) => yes!("The motion is running."),
            Mode::Holding if self.motion.id() != 0 => {
                let lost = self.who_is_lost();
                if lost != 0 {
                    return no!("Not resumed: {}.", FaultList(&Faults { bits: lost, ..Faults::default() }));
                }
                if self.odometry.position() != MotorState::POSITION_KNOWN {
                    return no!(
                        "Not resumed: the position needs confirmation; confirm it or zero, then start a new motion."
                    );
                }
                if input.motion != self.motion.id() || input.motion_epoch != self.safety.epoch() {
                    return no!("Not resumed: the planner no longer has this motion; stop, then start a new one.");
                }
                let Some(chosen) = self.chosen_in_charge().filter(|chosen| self.motion.has(chosen.segment)) else {
                    return no!(
                        "Not resumed: no controller answers for this motion; look at nims status which process is missing."
                    );
                };
                if let Some(off_m) = self.setpoint_distance_m(input).filter(|off_m| *off_m > self.config.divergence_m) {
                    return no!(
                        "Not resumed: the node is {off_m:.2} m from where the motion was left (accepted: {} m); stop, then start a new motion.",
                        self.config.divergence_m
                    );
                }
                self.follow(&chosen);
                yes!("Going on where the motion was left.")
            }
            Mode::Holding => no!("There is no paused motion to go on with."),
            Mode::Stopping(_) => no!("The robot is coming to rest; resume when it holds."),
            Mode::Jogging(_) => no!("A cable is being jogged; there is no paused motion."),
            Mode::Disarmed => no!("The drives are off and no motion is kept; arm and start a new one."),
            Mode::Faulted | Mode::EmergencyStop => no!("A fault has ended the motion; reset it, then start a new one."),
        }
    }

    fn stop_request(&mut self) -> Outcome {
        match self.safety.mode_mut() {
            Mode::Following(following) => {
                let stop = Stop { dropped: true, ..Stop::on_path(following.steering) };
                self.begin_stop(stop, 0);
                yes!("Stopping on the path; the motion is given up.")
            }
            Mode::Stopping(stop) => {
                stop.dropped = true;
                yes!("Already coming to rest; the motion is given up.")
            }
            Mode::Jogging(jog) => {
                jog.cancelled = true;
                yes!("The cable comes to rest and holds.")
            }
            Mode::Holding => {
                let kept = self.motion.id() != 0;
                self.abandon();
                self.safety.clear_stops(STOPS);
                self.safety.bump();
                if kept { yes!("At rest; the paused motion is given up.") } else { yes!("Already at rest.") }
            }
            Mode::Disarmed => {
                self.safety.bump();
                yes!("Nothing moves: the drives are off.")
            }
            Mode::Faulted | Mode::EmergencyStop => yes!("Already stopped by a fault; reset it to go on."),
        }
    }

    fn emergency_stop(&mut self) -> Outcome {
        self.safety.enter(Mode::EmergencyStop);
        self.safety.bump();
        self.abandon();
        if self.safety.energised() {
            yes!("Emergency stop: every cable is held where it is; reset goes back to holding.")
        } else {
            yes!("Emergency stop: the drives are off and stay off until reset.")
        }
    }

    fn reset(&mut self) -> Outcome {
        match self.safety.mode() {
            Mode::Following(_) | Mode::Stopping(_) | Mode::Jogging(_) => {
                no!("Nothing is reset while the robot moves; stop first.")
            }
            Mode::Holding => {
                self.abandon();
                self.safety.clear_stops(STOPS);
                self.safety.bump();
                yes!("Reset: the robot holds.")
            }
            _ if self.limits.last_speed() != 0.0 => {
                no!("Not reset: the robot is still coming to rest; try again in a second.")
            }
            _ => {
                if !self.safety.reset() {
                    return no!("Not reset: {}.", FaultList(&self.safety.lasting()));
                }
                self.watch.forget();
                if !self.safety.energised() {
                    return yes!("Reset: the robot is disarmed.");
                }
                match self.odometry.position() {
                    MotorState::POSITION_KNOWN => yes!("Reset: the robot holds."),
                    _ => yes!(
                        "Reset: the robot holds; its position is not certain, so confirm it or zero before a motion."
                    ),
                }
            }
        }
    }

    /// Zeroing changes what every length means, so nothing may move by the old ones.
    fn may_zero(&self) -> Outcome {
        match self.safety.mode() {
            Mode::Following(_) | Mode::Stopping(_) | Mode::Jogging(_) => {
                no!("Not zeroed: the robot moves; stop first.")
            }
            Mode::Faulted | Mode::EmergencyStop => no!("Not zeroed: the robot is stopped by a fault; reset it first."),
            Mode::Holding | Mode::Disarmed if !self.odometry.complete() => {
                no!("Not zeroed: not every encoder has been read yet; try again in a second.")
            }
            Mode::Holding | Mode::Disarmed => yes!(""),
        }
    }

    fn zero(&mut self, lengths_m: &[f64]) {
        self.abandon();
        self.odometry.set(lengths_m);
        self.safety.bump();
    }

    fn zero_at(&mut self, args: &[f64; 8]) -> Outcome {
        self.may_zero()?;
        let at = Vector3::new(args[0], args[1], args[2]);
        if !at.iter().all(|v| v.is_finite() && v.abs() < 1e5) {
            let [x, y, z] = [Given(at.x), Given(at.y), Given(at.z)];
            return bad!("Not zeroed: [{x}, {y}, {z}] is no position; give x, y and z in metres.");
        }
        let robot = &self.config.robot;
        if robot.is_planar() && at.y != 0.0 {
            return bad!("Not zeroed: y is {}, and this robot moves in the plane y = 0; give x and z.", Given(at.y));
        }
        let held = match tension::at(robot, &at, &Vector3::zeros(), self.config.distribution) {
            Ok(held) => held,
            Err(error) => {
                return bad!("Not zeroed: the node cannot hang freely at [{}, {}, {}]: {error}.", at.x, at.y, at.z);
            }
        };
        let straight = kinematics::inverse_kinematics(robot.anchors(), &at);
        let lengths = elastic::unstretched(robot, &straight, &held.tensions_n);
        self.check_lengths(&lengths)?;
        self.zero(&lengths);
        yes!("The node is at [{}, {}, {}] now.", at.x, at.y, at.z)
    }

    fn zero_lengths(&mut self, args: &[f64; 8]) -> Outcome {
        self.may_zero()?;
        let n = self.config.cable_count();
        self.check_lengths(&args[..n])?;
        self.zero(&args[..n]);
        yes!("The lengths of the {n} cables are set.")
    }

    fn check_lengths(&self, lengths_m: &[f64]) -> Outcome {
        for (i, (length, [low, high])) in lengths_m.iter().zip(self.config.robot.length_limits_m()).enumerate() {
            if !(*low..=*high).contains(length) {
                return bad!(
                    "Not zeroed: cable {} would be {} m long; accepted: {low} to {high} m.",
                    i + 1,
                    Given(*length)
                );
            }
        }
        yes!("")
    }

    fn confirm_position(&mut self) -> Outcome {
        match (self.safety.mode(), self.odometry.position()) {
            (_, MotorState::POSITION_KNOWN) => yes!("The position is known; there is nothing to confirm."),
            (_, MotorState::POSITION_UNKNOWN) => no!("There is no position to confirm; zero the robot where it is."),
            (Mode::Following(_) | Mode::Stopping(_) | Mode::Jogging(_), _) => {
                no!("Not confirmed: the robot moves; stop first.")
            }
            _ => {
                self.abandon();
                self.odometry.confirm();
                self.safety.bump();
                yes!("The position from before is confirmed.")
            }
        }
    }

    fn start_jog(&mut self, args: &[f64; 8]) -> Outcome {
        let n = self.config.cable_count();
        let [number, metres] = [args[0], args[1]];
        if !(1..=n).any(|cable| cable as f64 == number) {
            return bad!("Not jogged: there is no cable {}; accepted: 1 to {n}.", Given(number));
        }
        if !metres.is_finite() || metres == 0.0 || metres.abs() > JOG_LIMIT_M {
            return bad!(
                "Not jogged: {} m is no distance for a jog; accepted: up to {JOG_LIMIT_M} m, positive pays line out, negative reels in.",
                Given(metres)
            );
        }
        match self.safety.mode() {
            Mode::Holding => {}
            Mode::Jogging(_) => return no!("Not jogged: a cable is being jogged; wait until it holds."),
            Mode::Following(_) | Mode::Stopping(_) => return no!("Not jogged: the robot moves; stop first."),
            Mode::Disarmed => return no!("Not jogged: the drives are off; arm first."),
            Mode::Faulted | Mode::EmergencyStop => {
                return no!("Not jogged: the robot is stopped by a fault; reset it first.");
            }
        }
        let lost = self.who_is_lost() & MotorAuthority::FAULT_SUPERVISOR_LOST;
        if lost != 0 {
            return no!("Not jogged: {}.", FaultList(&Faults { bits: lost, ..Faults::default() }));
        }
        if self.motion.id() != 0 {
            return no!("Not jogged: a motion is paused; stop to give it up first.");
        }
        let cable = number as usize - 1;
        if self.odometry.position() != MotorState::POSITION_UNKNOWN {
            let [low, high] = self.config.robot.length_limits_m()[cable];
            let (now, then) = (self.odometry.length_m(cable), self.odometry.length_m(cable) + metres);
            if (then > high && metres > 0.0) || (then < low && metres < 0.0) {
                return no!(
                    "Not jogged: cable {number} is {now:.3} m long and would be {then:.3} m; accepted: {low} to {high} m."
                );
            }
        }
        self.safety.enter(Mode::Jogging(Jog { cable, left_m: metres, cancelled: false }));
        yes!("Cable {number} {} {:.3} m.", if metres > 0.0 { "pays out" } else { "reels in" }, metres.abs())
    }

    fn set_speed(&mut self, fraction: f64) -> Outcome {
        if self.clock.set_speed(fraction) {
            yes!("Motions run at {:.0} % of their planned speed.", fraction * 100.0)
        } else {
            bad!("{} is no speed; accepted: a fraction from {SLOWEST} to 1.", Given(fraction))
        }
    }

    /// The role and the slot that a request means.
    fn seat(args: &[f64; 8]) -> Result<(usize, usize), Refused> {
        let index = |value: f64, end: usize| (0..end).find(|i| *i as f64 == value);
        match (index(args[0], ROLES), index(args[1], SLOTS)) {
            (Some(role), Some(slot)) => Ok((role, slot)),
            _ => bad!(
                "Not done: there is no slot {} of role {}; this program and the one that asked are of different versions.",
                Given(args[1]),
                Given(args[0])
            ),
        }
    }

    fn swap(&mut self, input: &MotorInput, args: &[f64; 8]) -> Outcome {
        let (role, slot) = Self::seat(args)?;
        let (who, name) = (ROLE_NAMES[role], SLOT_NAMES[slot]);
        if let Some((off_m, within_s)) = self.swap_moves_off(role, slot)
            && off_m > self.config.divergence_m
            && self.arbiter.slot(role, slot).phase().is_standby()
        {
            return no!(
                "Not swapped: the {who} in slot {name} would move the node {off_m:.2} m off its path within {within_s:.1} s (accepted: {} m); look at its configuration, or swap where the robot holds.",
                self.config.divergence_m
            );
        }
        match self.arbiter.announce(role, slot, input.header.cycle) {
            Ok(cycle) => yes!("The {who} in slot {name} takes over in cycle {cycle}."),
            Err(Refusal::InCharge) => yes!("The {who} in slot {name} is in charge already."),
            Err(Refusal::UnderWay) => no!("Not swapped: another swap is under way; ask again in a second."),
            Err(_) => no!("Not swapped: the {who} in slot {name} {}.", self.why_not(role, slot)),
        }
    }

    /// How far a controller would move the node off its path until the swap to it is over, m, and within which time, s: as it differs on
    /// average from the one in charge, half of that while the commands fade and all of it while the old one is in probation.
    fn swap_moves_off(&self, role: usize, slot: usize) -> Option<(f64, f64)> {
        if role != CONTROLLERS {
            return None;
        }
        let CoreConfig { fade_s, probation_s, .. } = self.config;
        let node_m_s = self.node.velocity_of(self.arbiter.bias_m_s(slot))?.norm();
        Some((node_m_s * (0.5 * fade_s + probation_s), fade_s + probation_s))
    }

    /// Why a slot is no standby, as the rest of a sentence, and what to do.
    fn why_not(&self, role: usize, slot: usize) -> WhyNot {
        let seat = self.arbiter.slot(role, slot);
        WhyNot {
            role,
            phase: seat.phase() as u8,
            cause: seat.cause(),
            verdict: self.arbiter.verdict()[slot],
            well_s: f64::from(seat.well()) * self.config.period_s,
            qualify_s: self.config.qualify_s,
            moves_off: self.swap_moves_off(role, slot),
        }
    }

    fn admit(&mut self, args: &[f64; 8]) -> Outcome {
        let (role, slot) = Self::seat(args)?;
        let (who, name) = (ROLE_NAMES[role], SLOT_NAMES[slot]);
        match self.arbiter.admit(role, slot) {
            Ok(()) => yes!("The {who} in slot {name} is admitted again; it qualifies from the beginning."),
            Err(Refusal::InCharge) => yes!("The {who} in slot {name} is in charge already."),
            Err(_) => yes!("The {who} in slot {name} was not set aside."),
        }
    }
}
