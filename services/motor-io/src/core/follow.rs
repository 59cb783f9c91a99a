//! What each mode wants: to hold, to follow, to stop on the path.

use super::{Beat, Core, Stop};
use crate::arbiter::Chosen;
use crate::safety::Mode;
use messages::{CABLES, MotorAuthority, MotorInput, MotorState};

/// So long without answers for which this program was too late, and the robot stops on its path, s.
const LATE_S: f64 = 0.4;
/// A planner that does not publish the motion any more is gone after so many cycles; fewer, and it may just be about to.
const ORPHANED_CYCLES: u32 = 5;

impl Core {
    /// The velocities the mode asks for.
    pub(super) fn wanted(&mut self, input: &MotorInput) -> [f64; CABLES] {
        match self.safety.mode() {
            Mode::Holding => {
                self.start(input);
                [0.0; CABLES]
            }
            Mode::Jogging => self.jogging(),
            Mode::Following => self.following(input),
            Mode::Stopping => self.stopping(input),
            Mode::Disarmed | Mode::Faulted | Mode::EmergencyStop => [0.0; CABLES],
        }
    }

    /// Begins a motion that is offered, if a controller follows it already.
    fn start(&mut self, input: &MotorInput) {
        let follows = self.chosen_in_charge().is_some_and(|chosen| chosen.segment == input.motion_segment);
        self.safety.clear_stops(MotorAuthority::FAULT_OFF_START);
        if follows
            && self.who_is_lost() == 0
            && self.odometry.position() == MotorState::POSITION_KNOWN
            && !self.unit_trouble
            && self.motion.offered(input, self.safety.epoch(), self.clock.time_s(), self.config.period_s)
            && self.begins_here(input)
        {
            self.motion.begin(input);
            self.follow();
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

    /// From Holding to Following, for the first time or again.
    pub(crate) fn follow(&mut self) {
        self.safety.clear_stops(messages::faults::STOPS);
        self.motion.resume();
        self.pausing = false;
        self.missing = 0;
        self.diverging = 0;
        self.settled = 0;
        self.gap_wait = 0;
        self.stop = Stop::default();
        self.good = ([0.0; CABLES], 0.0);
        self.safety.enter(Mode::Following);
    }

    fn following(&mut self, input: &MotorInput) -> [f64; CABLES] {
        let lost = self.who_is_lost();
        if lost & MotorAuthority::FAULT_SUPERVISOR_LOST != 0 {
            self.begin_stop(false, MotorAuthority::FAULT_SUPERVISOR_LOST);
            return self.stopping(input);
        }
        if self.watch.late() > self.config.cycles(LATE_S) {
            // This program does not get to speak with the drives: it comes to rest while it still does now and then.
            self.begin_stop(false, MotorAuthority::FAULT_LONG_GAP);
            return self.stopping(input);
        }
        if lost != 0 || (self.motion.orphaned() > ORPHANED_CYCLES && !self.motion.ended(self.clock.time_s())) {
            // What is known of the motion is flown to its end; see `settle`.
            self.safety.note_stop(MotorAuthority::FAULT_PLANNER_LOST);
        }
        let ended = self.motion.ended(self.clock.time_s());
        self.settled = if ended { self.settled.saturating_add(1) } else { 0 };
        let run = !self.pausing && !ended && !self.unit_trouble && self.gap_wait == 0;
        self.clock.set_ease(self.watch.ease());
        let usable = self.chosen.filter(|chosen| self.motion.has(chosen.segment) || (ended && chosen.segment == 0));
        match usable {
            Some(chosen) => {
                self.use_command(input, &chosen);
                self.note_command();
                if self.gap_wait > 0 && !self.unit_trouble {
                    self.gap_wait -= 1;
                    if self.gap_wait == 0 {
                        self.safety.clear_stops(MotorAuthority::FAULT_LONG_GAP);
                    }
                }
                self.clock.advance(run, self.config.ramp_s);
                self.good = (chosen.velocity_m_s, self.clock.rate());
                chosen.velocity_m_s
            }
            None if self.unit_trouble => {
                // Without this cycle's readings no controller can answer. The drives go on, and so does the plan, slower.
                self.clock.advance(false, self.config.ramp_s);
                self.last_good()
            }
            None => {
                self.missing += 1;
                if self.missing < self.ttl_cycles {
                    self.clock.advance(run, self.config.ramp_s);
                    return self.last_good();
                }
                if self.waits_for_the_computer() {
                    // As far as the drives go on, so does the plan, until both stand.
                    self.clock.advance(false, self.config.stop_s);
                    return self.last_good();
                }
                let cause = self.why_missing(input);
                let cause = self.or_the_computer(cause);
                self.begin_stop(false, cause);
                self.stop.open = true;
                [0.0; CABLES]
            }
        }
    }

    fn stopping(&mut self, input: &MotorInput) -> [f64; CABLES] {
        if self.stop.open {
            return [0.0; CABLES];
        }
        let usable = self.chosen.filter(|chosen| self.motion.has(chosen.segment));
        self.clock.advance(false, self.config.stop_s);
        if let Some(chosen) = usable {
            self.use_command(input, &chosen);
            self.good = (chosen.velocity_m_s, self.clock.rate());
            return chosen.velocity_m_s;
        }
        self.missing += 1;
        if self.missing >= self.ttl_cycles && !self.unit_trouble {
            self.stop.open = true;
        }
        self.last_good()
    }

    fn use_command(&mut self, input: &MotorInput, chosen: &Chosen) {
        self.motion.follow(if chosen.segment == 0 { self.motion.segment() } else { chosen.segment });
        self.missing = 0;
        self.fresh = true;
        self.ttl_cycles = self.config.ttl_cycles.min(chosen.ttl_cycles);
        self.command_age_ns = input.begin_ns.saturating_sub(chosen.oldest_input_ns);
    }

    /// The last command that was used, slowed down as far as the plan clock has been since.
    fn last_good(&self) -> [f64; CABLES] {
        let (velocity, rate) = self.good;
        let factor = if rate > 0.0 { (self.clock.rate() / rate).min(1.0) } else { 0.0 };
        velocity.map(|v| v * factor)
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

    /// Comes to rest on the path. `cause` 0: it was asked for, or the motion is at its end.
    pub(crate) fn begin_stop(&mut self, dropped: bool, cause: u32) {
        if cause == 0 {
            // Whatever had slowed the robot down before is not why it rests now.
            self.safety.clear_stops(MotorAuthority::FAULT_LONG_GAP | MotorAuthority::FAULT_COMPUTER);
        }
        self.safety.note_stop(cause);
        self.stop = Stop { open: false, dropped, waited: 0 };
        self.safety.enter(Mode::Stopping);
    }

    /// A stop under way is to give up the motion after all.
    pub(crate) fn drop_motion_after_stop(&mut self) {
        self.stop.dropped = true;
    }

    /// Everything ends here: fault or emergency.
    pub(crate) fn abandon(&mut self) {
        self.motion.finish(self.clock.time_s());
        self.pausing = false;
        self.jog = None;
        self.gap_wait = 0;
        if self.safety.mode() == Mode::EmergencyStop {
            self.clock.stand();
        }
    }

    /// The cable comes to rest where it is.
    pub(crate) fn cancel_jog(&mut self) {
        if let Some(jog) = &mut self.jog {
            jog.cancelled = true;
        }
    }
}
