//! The second half of a cycle: what the drives replied, and what the cycle came to.

use super::{Core, Observation};
use crate::faults::Faults;
use crate::odometry::Reading;
use crate::safety::Mode;
use crate::watch::Situation;
use messages::{CABLES, Header, MotorAuthority, MotorInput, MotorState};

/// A tick that came more than this many periods after the last one leaves a gap in the motion worth looking at.
const GAP_PERIODS: f64 = 1.5;

impl Core {
    /// Second half of a cycle: the drives' replies.
    pub fn observe(&mut self, input: &MotorInput) -> Observation {
        let n = self.config.cable_count();
        self.end_ns = input.end_ns;
        let mut found = Faults::default();
        let back = self.watch.units(&self.config, input, &mut found);
        let ok: [bool; CABLES] =
            std::array::from_fn(|i| i < n && input.unit[self.config.unit_of_cable[i]] == MotorInput::UNIT_OK);
        self.unit_trouble = input.unit[..self.config.unit_count].iter().any(|unit| *unit != MotorInput::UNIT_OK);
        if self.unit_trouble && self.safety.energised() {
            self.skipped += 1;
        }
        let before: [f64; CABLES] = std::array::from_fn(|i| self.odometry.length_m(i));
        self.odometry.alive(std::array::from_fn(|i| input.unit_alive[self.config.unit_of_cable[i]] == 1));
        let mut fresh = [false; CABLES];
        for i in 0..n {
            let unit = self.config.unit_of_cable[i];
            let driven = self.safety.energised() && !self.sent.released[i];
            self.excuse.note(i, self.sent.speed_m_s[i], driven, ok[i]);
            if input.unit[unit] == MotorInput::UNIT_REBOOTED {
                self.odometry.rebase(i, input.counts[i], input.sampled_ns[i]);
            } else if ok[i] {
                let drift = self.excuse.drift_m_s(i);
                match self.odometry.read(i, input.counts[i], input.sampled_ns[i], back[unit], drift) {
                    Reading::Good => fresh[i] = true,
                    Reading::Doubtful => {}
                    Reading::Jumped => found.cable(MotorAuthority::FAULT_ENCODER_JUMP, i),
                    Reading::MovedWhileAway => fresh[i] = true,
                }
            }
        }
        let velocity: [f64; CABLES] = std::array::from_fn(|i| if i < n { self.odometry.velocity_m_s(i) } else { 0.0 });
        let situation = Situation {
            energised: self.safety.energised(),
            following: matches!(self.safety.mode(), Mode::Following | Mode::Stopping),
            sent_m_s: self.sent.speed_m_s,
            released: self.sent.released,
            excused_m_s: std::array::from_fn(|i| self.excuse.velocity_m_s(i)),
            estimator: self.chosen.map_or(self.arbiter.in_charge().1, |chosen| chosen.estimator),
        };
        self.watch.cables(&self.config, input, &situation, &velocity, &fresh, &mut found);
        if found.release.contains(&true) {
            // Nobody knows how far the line ran while its encoder said that it did not.
            self.odometry.doubt();
        }
        if self.safety.found(&found) {
            self.abandon();
        }
        self.catch_up(n, &before, &fresh);
        let state = self.state(input, &velocity, &fresh);
        let supply = self.watch.supply_v();
        let passed_s = self.gap_s.min(self.config.watchdog_s);
        let mut energy = self.energy.add(n, passed_s, self.config.robot.motor().resistance_ohm, |i| {
            (self.watch.current_a(i), self.watch.duty(i), supply[self.config.unit_of_cable[i]])
        });
        energy.header = state.header;
        let authority = self.authority(input, &state.header);
        Observation { state, slots: self.arbiter.slots(&authority), authority, energy }
    }

    /// If this machine stood still, the drives went on by the last command: the plan follows them as far as the encoders show, or
    /// else the controller would drive the node back.
    fn catch_up(&mut self, n: usize, before: &[f64; CABLES], fresh: &[bool; CABLES]) {
        let period_s = self.config.period_s;
        let gap = self.gap_s > GAP_PERIODS * period_s && self.gap_s <= self.config.watchdog_s;
        if !gap || self.safety.mode() != Mode::Following || !fresh[..n].iter().all(|fresh| *fresh) {
            return;
        }
        let (mut along, mut square) = (0.0, 0.0);
        for (i, (before, v)) in before.iter().zip(&self.sent_before).enumerate().take(n) {
            along += (self.odometry.length_m(i) - before) * v;
            square += v * v;
        }
        // Below 5 mm/s there is nothing to catch up with.
        if square > 2.5e-5 {
            self.clock.catch_up((along / square - period_s).clamp(0.0, self.gap_s - period_s));
        }
    }

    fn state(&self, input: &MotorInput, velocity: &[f64; CABLES], fresh: &[bool; CABLES]) -> MotorState {
        let (n, units) = (self.config.cable_count(), self.config.unit_count);
        let mut state = MotorState {
            velocity_m_s: *velocity,
            command_m_s: self.sent.speed_m_s,
            status: self.watch.status(),
            supply_v: self.watch.supply_v(),
            fresh: fresh.map(u8::from),
            cable_count: n as u8,
            unit_count: units as u8,
            position_known: self.odometry.position(),
            ..MotorState::default()
        };
        for i in 0..n {
            state.sampled_ns[i] = self.odometry.sampled_ns(i);
            state.counts[i] = self.odometry.counts(i);
            state.length_m[i] = self.odometry.length_m(i);
            state.current_a[i] = self.watch.current_a(i);
            state.duty[i] = self.watch.duty(i);
        }
        for i in 0..units {
            state.unit_ok[i] = u8::from(input.unit[i] == MotorInput::UNIT_OK);
        }
        let oldest = state.sampled_ns[..n].iter().copied().min().unwrap_or(0);
        let newest = state.sampled_ns[..n].iter().copied().max().unwrap_or(0);
        state.header = Header { cycle: input.header.cycle, seq: 0, stamp_ns: newest, oldest_input_ns: oldest };
        state
    }

    fn authority(&self, input: &MotorInput, header: &Header) -> MotorAuthority {
        let faults = self.safety.faults();
        let mut authority = MotorAuthority {
            header: Header { stamp_ns: input.end_ns, ..*header },
            plan_time_s: self.clock.time_s(),
            plan_rate: self.clock.rate(),
            plan_rate_target: self.clock.target(),
            period_s: self.config.period_s,
            scale: self.scale,
            missed: self.missed,
            late: self.late,
            skipped: self.skipped,
            bus_ns: input.end_ns.saturating_sub(input.begin_ns),
            wake_ns: input.begin_ns.saturating_sub(input.tick_ns),
            command_age_ns: self.command_age_ns,
            faults: faults.bits,
            epoch: self.safety.epoch(),
            segment: self.motion.segment(),
            motion: self.motion.id(),
            mode: self.safety.mode() as u8,
            position_known: self.odometry.position(),
            fault_cable: faults.cables.map(u8::from),
            fault_unit: faults.units.map(u8::from),
            cable_count: self.config.cable_count() as u8,
            ..MotorAuthority::default()
        };
        self.arbiter.describe(&mut authority);
        authority
    }
}
