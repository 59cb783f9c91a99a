//! Second half of a cycle: the drives' replies, and the samples to publish.

use super::{Core, Observation, account};
use crate::mode::Mode;
use crate::odometry::Reading;
use crate::slip::Compared;
use crate::watch::SafetySnapshot;
use messages::faults::Faults;
use messages::{CABLES, Header, MotorAuthority, MotorInput, MotorState, UNITS};

/// Periods between two begins beyond which the gap matters for the motion.
const GAP_PERIODS: f64 = 1.5;

impl Core {
    /// Processes the drives' replies: the second half of a cycle.
    pub fn observe(&mut self, input: &MotorInput) -> Observation {
        let at_begin = self.before();
        let n = self.config.cable_count();
        self.timing.end_ns = input.end_ns;
        let mut found = Faults::default();
        let back = self.watch.units(&self.config, input, self.starves(), &mut found);
        let ok: [bool; CABLES] =
            std::array::from_fn(|i| i < n && input.unit[self.config.unit_of_cable[i]] == MotorInput::UNIT_OK);
        self.unit_trouble = input.unit[..self.config.unit_count].iter().any(|unit| *unit != MotorInput::UNIT_OK);
        let before: [f64; CABLES] = std::array::from_fn(|i| self.odometry.length_m(i));
        self.odometry.alive(std::array::from_fn(|i| input.unit_alive[self.config.unit_of_cable[i]] == 1));
        let (fresh, restarted) = self.read_encoders(input, &ok, &back, &mut found);
        let velocity: [f64; CABLES] = std::array::from_fn(|i| if i < n { self.odometry.velocity_m_s(i) } else { 0.0 });
        let situation = SafetySnapshot {
            energised: self.safety.energised(),
            following: self.safety.mode().on_motion(),
            sent_m_s: self.sent.speed_m_s,
            released: self.sent.released,
            radius_ratio: std::array::from_fn(|i| self.config.robot.drum(i).radius_ratio(before[i])),
            excused_m_s: self.excused_m_s(),
            starved: self.chain_starves(),
            estimator: self.chosen.map_or(self.arbiter.in_charge().1, |chosen| chosen.estimator),
        };
        self.watch.cables(&self.config, input, &situation, &velocity, &fresh, &mut found);
        let counts = situation.energised && self.odometry.position() != MotorState::POSITION_UNKNOWN;
        let compared = Compared { input, fresh: &fresh, restarted: &restarted, length_m: &before, counts };
        if self.slips.observe(&compared, &mut found) || found.release.contains(&true) {
            // How far the cable ran while its encoder showed no motion is unknown.
            self.odometry.doubt();
        }
        self.name_the_computer(&mut found);
        if self.safety.found(&found) {
            self.abandon();
        }
        self.catch_up(n, &before, &fresh);
        let lengths = std::array::from_fn(|i| self.odometry.length_m(i));
        self.node.observe(&lengths, self.odometry.position());
        for (cable, strain) in self.node.counted_strains() {
            self.odometry.set_strain(cable, strain);
        }
        self.still.average(&self.config, &self.watch);
        self.close_period(input);
        let state = self.state(input, &velocity, &fresh);
        let supply = self.watch.supply_v();
        let passed_s = self.timing.gap_s.min(self.config.watchdog_s);
        let mut energy = self.energy.add(n, passed_s, self.config.robot.motor().resistance_ohm, |i| {
            (self.watch.current_a(i), self.watch.duty(i), supply[self.config.unit_of_cable[i]])
        });
        energy.header = state.header;
        let authority = self.authority(input, &state.header);
        self.check_state(&at_begin);
        Observation { state, slots: self.arbiter.slots(&authority), authority, energy }
    }

    /// Judges and uses the counts of this cycle. Returns which were used, and which are unrelated to those before.
    /// `ok`: the unit of the cable answered; `back`: the unit was lost until now.
    fn read_encoders(
        &mut self,
        input: &MotorInput,
        ok: &[bool; CABLES],
        back: &[bool; UNITS],
        found: &mut Faults,
    ) -> ([bool; CABLES], [bool; CABLES]) {
        let (mut fresh, mut restarted) = ([false; CABLES], [false; CABLES]);
        for i in 0..self.config.cable_count() {
            let unit = self.config.unit_of_cable[i];
            self.explain_velocity(i, ok[i]);
            if input.unit[unit] == MotorInput::UNIT_REBOOTED {
                self.odometry.rebase(i, input.counts[i], input.sampled_ns[i]);
                restarted[i] = true;
            } else if ok[i] {
                let drift = self.envelope.drift_m_s(i);
                match self.odometry.read(i, input.counts[i], input.sampled_ns[i], back[unit], drift) {
                    Reading::Good => fresh[i] = true,
                    Reading::Doubtful => {}
                    Reading::Jumped => {
                        found.cable(MotorAuthority::FAULT_ENCODER_JUMP, i);
                        restarted[i] = true;
                    }
                    Reading::MovedWhileAway => fresh[i] = true,
                }
            }
        }
        (fresh, restarted)
    }

    /// Records what a drive was commanded, for the velocities that commands explain. In soft mode a hand moves the
    /// cables, and what it moved may run on for a moment.
    fn explain_velocity(&mut self, cable: usize, replied: bool) {
        let (led, released) = (self.sent.current_a.is_some(), self.sent.released[cable]);
        let sent_m_s = if led { self.odometry.velocity_m_s(cable) } else { self.sent.speed_m_s[cable] };
        self.envelope.record(cable, sent_m_s, self.safety.energised() && !released && !led, replied);
    }

    /// Least and largest velocity of each cable that has no cause of its own, m/s.
    fn excused_m_s(&self) -> [[f64; 2]; CABLES] {
        match self.sent.current_a {
            Some(_) => [[f64::NEG_INFINITY, f64::INFINITY]; CABLES],
            None => std::array::from_fn(|i| self.envelope.velocity_m_s(i)),
        }
    }

    /// Classifies this period of wall-clock time.
    fn close_period(&mut self, input: &MotorInput) {
        let cycle = account::Cycle {
            under_way: self.decision.under_way,
            fresh: self.decision.fresh,
            at_rest: !matches!(self.safety.mode(), Mode::Following(_)),
            resting: self.clock.rate() == 0.0,
            faults: self.safety.faults().bits,
            evidence: self.evidence(),
            in_charge: self.arbiter.in_charge(),
            period_s: self.config.period_s,
        };
        self.account.close(input, &cycle);
    }

    /// Advances the plan clock by what the drives did during a gap, as far as the encoders show it. Otherwise the
    /// controller would drive the node back.
    fn catch_up(&mut self, n: usize, before: &[f64; CABLES], fresh: &[bool; CABLES]) {
        let period_s = self.config.period_s;
        let gap_s = self.timing.gap_s;
        let gap = gap_s > GAP_PERIODS * period_s && gap_s <= self.config.watchdog_s;
        if !gap || !matches!(self.safety.mode(), Mode::Following(_)) || !fresh[..n].iter().all(|fresh| *fresh) {
            return;
        }
        let (mut along, mut square) = (0.0, 0.0);
        for (i, (before, v)) in before.iter().zip(&self.decision.sent_before_m_s).enumerate().take(n) {
            along += (self.odometry.length_m(i) - before) * v;
            square += v * v;
        }
        // Below 5 mm/s the error is negligible.
        if square > 2.5e-5 {
            self.clock.catch_up((along / square - period_s).clamp(0.0, gap_s - period_s));
        }
    }

    fn state(&self, input: &MotorInput, velocity: &[f64; CABLES], fresh: &[bool; CABLES]) -> MotorState {
        let (n, units) = (self.config.cable_count(), self.config.unit_count);
        let mut state = MotorState {
            velocity_m_s: *velocity,
            zeroed_m: self.odometry.zeroed_m(),
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
            state.slip_m[i] = self.slips.apart_m(i);
        }
        for i in 0..units {
            state.unit_ok[i] = u8::from(input.unit[i] == MotorInput::UNIT_OK);
        }
        let unknown = [f64::NAN; 3];
        state.node_m = self.node.position_m().map_or(unknown, Into::into);
        state.node_command_m_s = self.node.velocity_of(&self.sent.speed_m_s).map_or(unknown, Into::into);
        state.node_bound_m_s = self.node.position_m().map_or(f64::INFINITY, |_| self.config.node_speed_m_s());
        state.setpoint_distance_m = self.setpoint_distance_m(input).unwrap_or(f64::NAN);
        // 0 marks an encoder that was never read. Before the first reading, the sample is as old as the cycle.
        let read = || state.sampled_ns[..n].iter().copied().filter(|sampled_ns| *sampled_ns != 0);
        let oldest = read().min().unwrap_or(input.end_ns);
        let newest = read().max().unwrap_or(input.end_ns);
        let (life, cycle) = (input.header.life, input.header.cycle);
        state.header = Header { life, cycle, stamp_ns: newest, oldest_input_ns: oldest, ..Header::default() };
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
            scale: self.decision.scale,
            bus_ns: input.end_ns.saturating_sub(input.begin_ns),
            wake_ns: input.begin_ns.saturating_sub(input.tick_ns),
            command_age_ns: self.decision.command_age_ns,
            faults: faults.bits,
            epoch: self.safety.epoch(),
            segment: self.motion.segment(),
            motion: self.motion.id(),
            mode: self.safety.mode().number(),
            position_known: self.odometry.position(),
            fault_cable: faults.cables.map(u8::from),
            fault_unit: faults.units.map(u8::from),
            cable_count: self.config.cable_count() as u8,
            mission: input.mission,
            ..MotorAuthority::default()
        };
        self.account.describe(&mut authority);
        self.arbiter.describe(&mut authority);
        authority
    }
}
