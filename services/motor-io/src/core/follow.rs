//! Velocities that each mode asks for: holding, following, stopping on the path.

use super::{Beat, Core};
use crate::arbiter::ChosenCommand;
use crate::mode::{Braking, Following, Mode, Steering, Stop};
use messages::{CABLES, MotorAuthority, MotorInput, MotorState};

/// Time without answers because motor-io was late, after which the robot stops on its path, s.
pub(super) const LATE_S: f64 = 0.4;
/// Cycles after which a planner that no longer publishes the motion counts as gone. Within fewer, it may be about to;
/// at more than 250 Hz, within as long.
const ORPHANED_CYCLES: u32 = 5;

impl Core {
    /// Returns the velocities that the mode asks for.
    pub(super) fn wanted(&mut self, input: &MotorInput) -> [f64; CABLES] {
        match *self.safety.mode() {
            Mode::Holding => {
                self.start(input);
                [0.0; CABLES]
            }
            Mode::Jogging(jog) => self.jogging(jog),
            Mode::Soft(soft) => {
                self.yield_to_hand(soft);
                [0.0; CABLES]
            }
            Mode::Following(following) => self.following(following, input),
            Mode::Stopping(stop) => self.stopping(stop, input),
            Mode::Disarmed | Mode::Faulted | Mode::EmergencyStop => [0.0; CABLES],
        }
    }

    /// Begins the offered motion if a controller already follows it. It begins paused if the robot was told to hold
    /// after the motion was asked for: planning takes time, and the two arrive in any order.
    fn start(&mut self, input: &MotorInput) {
        let chosen = self.chosen_in_charge().filter(|chosen| chosen.segment == input.motion_segment);
        self.safety.clear_stops(MotorAuthority::FAULT_OFF_START);
        if !self.motion.is_offered(input, self.safety.epoch(), self.clock.time_s(), self.config.period_s) {
            return;
        }
        let asked_before = |request_ns: u64| input.motion_asked_ns != 0 && input.motion_asked_ns <= request_ns;
        if asked_before(self.ended_ns) {
            // The planner received its request after that other one, whose epoch it is planned for.
            self.safety.start_epoch();
        } else if asked_before(self.held_ns) {
            if self.begins_here(input) {
                self.motion.begin(input);
            }
        } else if let Some(chosen) = chosen
            && self.who_is_lost() == 0
            && self.odometry.position() == MotorState::POSITION_KNOWN
            && !self.unit_trouble
            && self.begins_here(input)
        {
            self.motion.begin(input);
            self.follow(&chosen);
        }
    }

    /// The chosen command if the pair in charge gave it. A motion does not begin with the command of a stand-in.
    pub(crate) fn chosen_in_charge(&self) -> Option<ChosenCommand> {
        self.chosen.filter(|chosen| (chosen.controller, chosen.estimator) == self.arbiter.in_charge())
    }

    /// Supervisor and planner, if they were running and no longer are; bits of `FAULT_*`.
    pub(crate) fn who_is_lost(&self) -> u32 {
        let cycles = self.config.cycles(self.config.beat_s);
        let bit = |beat: &Beat, bit: u32| if beat.lost(cycles) { bit } else { 0 };
        bit(&self.supervisor, MotorAuthority::FAULT_SUPERVISOR_LOST)
            | bit(&self.planner, MotorAuthority::FAULT_PLANNER_LOST)
    }

    /// Enters Following from Holding, at the start of a motion or on resume. `chosen` answers for the motion.
    pub(crate) fn follow(&mut self, chosen: &ChosenCommand) {
        debug_assert!(self.limits.last_speed() == 0.0, "a motion begins before the robot is at rest");
        self.safety.clear_stops(messages::faults::STOPS);
        self.safety.enter(Mode::Following(Following::from_rest(self.ttl_cycles(chosen))));
    }

    fn following(&mut self, mut state: Following, input: &MotorInput) -> [f64; CABLES] {
        let lost = self.who_is_lost();
        if lost & MotorAuthority::FAULT_SUPERVISOR_LOST != 0 {
            return self.stop_on_path(&state, MotorAuthority::FAULT_SUPERVISOR_LOST, input);
        }
        if self.watch.late() > self.config.cycles(LATE_S) {
            // motor-io is short of processor time: stop while some cycles still reach the drives.
            return self.stop_on_path(&state, MotorAuthority::FAULT_LONG_GAP, input);
        }
        let ended = self.motion.is_over(self.clock.time_s());
        if lost != 0 || (self.motion.cycles_without_plan() > self.config.lasting(ORPHANED_CYCLES) && !ended) {
            // The known part of the motion is flown to its end; see `settle`.
            self.safety.record_stop(MotorAuthority::FAULT_PLANNER_LOST);
        }
        state.settled = if ended { state.settled.saturating_add(1) } else { 0 };
        let run = !state.pausing && !ended && !self.unit_trouble && state.gap_wait == 0;
        self.clock.set_slowdown(self.watch.slowdown());
        let usable = self.chosen.filter(|chosen| self.motion.has(chosen.segment) || (ended && chosen.segment == 0));
        let wanted = if let Some(chosen) = usable {
            self.record_command();
            self.wait_after_gap(&mut state);
            self.clock.advance(run, self.config.ramp_s);
            self.use_command(&mut state.steering, input, &chosen)
        } else if self.unit_trouble {
            // Without this cycle's readings no controller can answer. Drives and plan continue, slower.
            self.clock.advance(false, self.config.ramp_s);
            state.steering.last_slowed_to(self.clock.rate())
        } else if !state.steering.record_missing() {
            self.clock.advance(run, self.config.ramp_s);
            state.steering.last_slowed_to(self.clock.rate())
        } else if self.waits_for_the_computer(state.steering.missing()) {
            // The drives continue and the plan with them, until both are at standstill.
            self.clock.advance(false, self.config.stop_s);
            state.steering.last_slowed_to(self.clock.rate())
        } else {
            let cause = self.why_missing(input);
            let cause = self.or_the_computer(cause);
            self.begin_stop(Stop::open(), cause);
            return [0.0; CABLES];
        };
        self.safety.enter(Mode::Following(state));
        wanted
    }

    /// Enters Stopping within this cycle.
    fn stop_on_path(&mut self, state: &Following, cause: u32, input: &MotorInput) -> [f64; CABLES] {
        let stop = Stop::on_path(state.steering);
        self.begin_stop(stop, cause);
        self.stopping(stop, input)
    }

    /// Counts down the cycles with a command after a gap.
    fn wait_after_gap(&mut self, state: &mut Following) {
        if state.gap_wait > 0 && !self.unit_trouble {
            state.gap_wait -= 1;
            if state.gap_wait == 0 {
                self.safety.clear_stops(MotorAuthority::FAULT_LONG_GAP);
            }
        }
    }

    fn stopping(&mut self, mut stop: Stop, input: &MotorInput) -> [f64; CABLES] {
        let Braking::OnPath { steering, .. } = &mut stop.braking else { return [0.0; CABLES] };
        let usable = self.chosen.filter(|chosen| self.motion.has(chosen.segment));
        self.clock.advance(false, self.config.stop_s);
        let wanted = if let Some(chosen) = usable {
            self.use_command(steering, input, &chosen)
        } else {
            let wanted = steering.last_slowed_to(self.clock.rate());
            if steering.record_missing() && !self.unit_trouble {
                stop.braking = Braking::Open;
            }
            wanted
        };
        self.safety.enter(Mode::Stopping(stop));
        wanted
    }

    /// Uses a command at the present rate of the plan clock, and returns its velocities.
    fn use_command(&mut self, steering: &mut Steering, input: &MotorInput, chosen: &ChosenCommand) -> [f64; CABLES] {
        self.motion.follow(if chosen.segment == 0 { self.motion.segment() } else { chosen.segment });
        steering.record(&chosen.velocity_m_s, self.clock.rate(), self.ttl_cycles(chosen));
        self.decision.fresh = true;
        self.decision.command_age_ns = input.begin_ns.saturating_sub(chosen.oldest_input_ns);
        chosen.velocity_m_s
    }

    /// Number of cycles for which a command remains in use when later ones are missing.
    fn ttl_cycles(&self, chosen: &ChosenCommand) -> u32 {
        self.config.ttl_cycles.min(chosen.ttl_cycles)
    }

    fn why_missing(&self, input: &MotorInput) -> u32 {
        let (controller, estimator) = self.arbiter.in_charge();
        if input.estimate_cycle[estimator].saturating_add(1) < input.header.cycle {
            // The controller has no estimate to answer to.
            return MotorAuthority::FAULT_ESTIMATE_LOST;
        }
        if self.motion.cycles_without_plan() > 0 {
            return MotorAuthority::FAULT_PLANNER_LOST;
        }
        match self.arbiter.verdict()[controller] {
            MotorAuthority::VERDICT_NO_ESTIMATE => MotorAuthority::FAULT_ESTIMATE_LOST,
            MotorAuthority::VERDICT_NOT_FINITE | MotorAuthority::VERDICT_OUT_OF_LIMITS => {
                MotorAuthority::FAULT_COMMAND_REFUSED
            }
            _ => MotorAuthority::FAULT_COMMAND_LOST,
        }
    }

    /// Enters Stopping. `cause` 0: on request, or at the end of the motion.
    pub(crate) fn begin_stop(&mut self, stop: Stop, cause: u32) {
        if cause == 0 {
            // An earlier reason for slowing down is not the reason for this stop.
            self.safety.clear_stops(MotorAuthority::FAULT_LONG_GAP | MotorAuthority::FAULT_COMPUTER);
        }
        debug_assert!(self.safety.mode().on_motion(), "a stop without a motion, in {:?}", self.safety.mode());
        self.safety.record_stop(cause);
        self.safety.enter(Mode::Stopping(stop));
    }

    /// Gives up the motion; in an emergency its clock stops at once.
    pub(crate) fn abandon(&mut self) {
        self.motion.finish(self.clock.time_s());
        if *self.safety.mode() == Mode::EmergencyStop {
            self.clock.stop_at_once();
        }
    }
}
