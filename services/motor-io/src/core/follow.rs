//! What each mode wants: to hold, to follow, to stop on the path.

use super::{Beat, Core};
use crate::arbiter::Chosen;
use crate::mode::{Braking, Following, Mode, Steering, Stop};
use messages::{CABLES, MotorAuthority, MotorInput, MotorState};

/// So long without answers for which this program was too late, and the robot stops on its path, s.
const LATE_S: f64 = 0.4;
/// A planner that does not publish the motion any more is gone after so many cycles; fewer, and it may just be about to.
const ORPHANED_CYCLES: u32 = 5;

impl Core {
    /// The velocities the mode asks for.
    pub(super) fn wanted(&mut self, input: &MotorInput) -> [f64; CABLES] {
        match *self.safety.mode() {
            Mode::Holding => {
                self.start(input);
                [0.0; CABLES]
            }
            Mode::Jogging(jog) => self.jogging(jog),
            Mode::Following(following) => self.following(following, input),
            Mode::Stopping(stop) => self.stopping(stop, input),
            Mode::Disarmed | Mode::Faulted | Mode::EmergencyStop => [0.0; CABLES],
        }
    }

    /// Begins a motion that is offered, if a controller follows it already.
    fn start(&mut self, input: &MotorInput) {
        let chosen = self.chosen_in_charge().filter(|chosen| chosen.segment == input.motion_segment);
        self.safety.clear_stops(MotorAuthority::FAULT_OFF_START);
        if let Some(chosen) = chosen
            && self.who_is_lost() == 0
            && self.odometry.position() == MotorState::POSITION_KNOWN
            && !self.unit_trouble
            && self.motion.offered(input, self.safety.epoch(), self.clock.time_s(), self.config.period_s)
            && self.begins_here(input)
        {
            self.motion.begin(input);
            self.follow(&chosen);
        }
    }

    /// The chosen command, if the pair in charge gave it: one that only stands in for a cycle is not followed from rest.
    pub(crate) fn chosen_in_charge(&self) -> Option<Chosen> {
        self.chosen.filter(|chosen| (chosen.controller, chosen.estimator) == self.arbiter.in_charge())
    }

    /// Supervisor and planner, where they were there and are not any more; bits of faults.
    pub(crate) fn who_is_lost(&self) -> u32 {
        let cycles = self.config.cycles(self.config.beat_s);
        let bit = |beat: &Beat, bit: u32| if beat.lost(cycles) { bit } else { 0 };
        bit(&self.supervisor, MotorAuthority::FAULT_SUPERVISOR_LOST)
            | bit(&self.planner, MotorAuthority::FAULT_PLANNER_LOST)
    }

    /// From Holding to Following, for the first time or again; `chosen` answers for the motion.
    pub(crate) fn follow(&mut self, chosen: &Chosen) {
        self.safety.clear_stops(messages::faults::STOPS);
        self.safety.enter(Mode::Following(Following::from_rest(self.ttl_cycles(chosen))));
    }

    fn following(&mut self, mut state: Following, input: &MotorInput) -> [f64; CABLES] {
        let lost = self.who_is_lost();
        if lost & MotorAuthority::FAULT_SUPERVISOR_LOST != 0 {
            return self.stop_on_path(&state, MotorAuthority::FAULT_SUPERVISOR_LOST, input);
        }
        if self.watch.late() > self.config.cycles(LATE_S) {
            // This program does not get to speak with the drives: it comes to rest while it still does now and then.
            return self.stop_on_path(&state, MotorAuthority::FAULT_LONG_GAP, input);
        }
        let ended = self.motion.ended(self.clock.time_s());
        if lost != 0 || (self.motion.orphaned() > ORPHANED_CYCLES && !ended) {
            // What is known of the motion is flown to its end; see `settle`.
            self.safety.note_stop(MotorAuthority::FAULT_PLANNER_LOST);
        }
        state.settled = if ended { state.settled.saturating_add(1) } else { 0 };
        let run = !state.pausing && !ended && !self.unit_trouble && state.gap_wait == 0;
        self.clock.set_ease(self.watch.ease());
        let usable = self.chosen.filter(|chosen| self.motion.has(chosen.segment) || (ended && chosen.segment == 0));
        let wanted = if let Some(chosen) = usable {
            self.note_command();
            self.wait_after_gap(&mut state);
            self.clock.advance(run, self.config.ramp_s);
            self.use_command(&mut state.steering, input, &chosen)
        } else if self.unit_trouble {
            // Without this cycle's readings no controller can answer. The drives go on, and so does the plan, slower.
            self.clock.advance(false, self.config.ramp_s);
            state.steering.last_slowed_to(self.clock.rate())
        } else if !state.steering.record_missing() {
            self.clock.advance(run, self.config.ramp_s);
            state.steering.last_slowed_to(self.clock.rate())
        } else if self.waits_for_the_computer(state.steering.missing()) {
            // As far as the drives go on, so does the plan, until both stand.
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

    /// From Following to Stopping, in this cycle.
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

    /// Uses a command at the present rate of the plan clock.
    fn use_command(&mut self, steering: &mut Steering, input: &MotorInput, chosen: &Chosen) -> [f64; CABLES] {
        self.motion.follow(if chosen.segment == 0 { self.motion.segment() } else { chosen.segment });
        steering.record(&chosen.velocity_m_s, self.clock.rate(), self.ttl_cycles(chosen));
        self.decision.fresh = true;
        self.decision.command_age_ns = input.begin_ns.saturating_sub(chosen.oldest_input_ns);
        chosen.velocity_m_s
    }

    /// How long a command stands in for the missing ones after it, cycles.
    fn ttl_cycles(&self, chosen: &Chosen) -> u32 {
        self.config.ttl_cycles.min(chosen.ttl_cycles)
    }

    fn why_missing(&self, input: &MotorInput) -> u32 {
        let (controller, estimator) = self.arbiter.in_charge();
        if input.estimate_cycle[estimator].saturating_add(1) < input.header.cycle {
            // The controller has nothing to answer to.
            return MotorAuthority::FAULT_ESTIMATE_LOST;
        }
        if self.motion.orphaned() > 0 {
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

    /// Comes to rest. `cause` 0: it was asked for, or the motion is at its end.
    pub(crate) fn begin_stop(&mut self, stop: Stop, cause: u32) {
        if cause == 0 {
            // Whatever had slowed the robot down before is not why it rests now.
            self.safety.clear_stops(MotorAuthority::FAULT_LONG_GAP | MotorAuthority::FAULT_COMPUTER);
        }
        self.safety.note_stop(cause);
        self.safety.enter(Mode::Stopping(stop));
    }

    /// The motion is given up; in an emergency its clock stands at once.
    pub(crate) fn abandon(&mut self) {
        self.motion.finish(self.clock.time_s());
        if *self.safety.mode() == Mode::EmergencyStop {
            self.clock.stand();
        }
    }
}
