//! One control cycle: command every unit, read its encoders, then what time is left for.

use std::sync::Arc;

use drives::{Error, Timed, UnitAnswer, UnitReport};
use serial::Transport;

use super::{Bus, Drive, Phase, step::Setup};
use crate::codec::{Motor, Read, Reply, Write};

/// One of these is asked per cycle. The duty most often: a motor that is driven hard and does not turn runs away when its encoder
/// has failed, and that has to be seen within a tenth of a second. The supply and the stop button come twice in a round.
const SLOW: [Read; 12] = [
    Read::Pwms,
    Read::Status,
    Read::Pwms,
    Read::MainBattery,
    Read::Pwms,
    Read::Watchdog,
    Read::Pwms,
    Read::Status,
    Read::Pwms,
    Read::MainBattery,
    Read::Pwms,
    Read::Temperature,
];

/// Duty of the whole supply.
const FULL_DUTY: f64 = 32_767.0;

/// An encoder may be read by the unit so much later than it was asked for, ns; a motor moves on meanwhile.
const SAMPLE_JITTER_NS: u64 = 20_000_000;

impl<T: Transport> Bus<T> {
    /// A place for the answers of [`Bus::cycle`].
    pub fn blank_answers(&self) -> Vec<UnitAnswer> {
        let blank = |_| UnitAnswer {
            outcome: Err(Error::Resynchronising { port: self.port() }),
            report: UnitReport::default(),
        };
        self.units.iter().map(blank).collect()
    }

    /// [`Bus::drive`], and then [`Bus::spend`] what is left of the time.
    pub fn cycle(&mut self, drives: &[[Drive; 2]], deadline_ns: u64, answers: &mut [UnitAnswer]) {
        self.drive(drives, deadline_ns, answers);
        self.spend(deadline_ns);
        for (unit, answer) in self.units.iter().zip(answers) {
            answer.report = unit.report;
        }
    }

    /// Give each unit its command and read its encoders: what a control cycle waits for.
    ///
    /// `drives` and `answers` have the units in the configuration's order; a unit without a drive is left idle. Nothing is sent once
    /// the deadline is over; an answer that does not come ends the call later than the deadline by at most the margin of the
    /// configuration. While the line is out of step the call returns at once where the time does not suffice, and the next goes on.
    pub fn drive(&mut self, drives: &[[Drive; 2]], deadline_ns: u64, answers: &mut [UnitAnswer]) {
        let whole_line = if self.transport.now_ns() >= deadline_ns {
            Err(Error::TooLate { port: self.port() })
        } else {
            self.get_in_step(deadline_ns)
        };
        for (index, answer) in answers.iter_mut().enumerate().take(self.units.len()) {
            answer.outcome = match &whole_line {
                Err(error) => Err(error.clone()),
                Ok(()) => self.serve(index, drives.get(index).copied().unwrap_or_default(), deadline_ns),
            };
        }
        for (unit, answer) in self.units.iter().zip(answers) {
            answer.report = unit.report;
        }
    }

    /// Use the time until `deadline_ns`: look at the stop input; bring back units that are not in use; when all are, read currents and one slow value.
    ///
    /// Nothing is begun that is unlikely to end by the deadline. What it finds out is in the next cycle's reports.
    pub fn spend(&mut self, deadline_ns: u64) {
        self.look_at_stop();
        if self.transport.now_ns() < deadline_ns
            && self.get_in_step(deadline_ns).is_ok()
            && self.set_up_units(deadline_ns).is_ok()
        {
            self.read_what_can_wait(deadline_ns);
        }
    }

    fn serve(&mut self, index: usize, drive: [Drive; 2], deadline_ns: u64) -> Result<(), Error> {
        // Another unit may have brought the line out of step in this cycle.
        self.get_in_step(deadline_ns)?;
        let first = self.command_and_read(index, drive);
        // Asking again is safe once the line is in step, because every drive can be given twice; but only if there is time for it.
        match &first {
            Err(error) if error.is_on_the_wire() => {
                if self.get_in_step(deadline_ns).is_err() || self.set_up_units(deadline_ns).is_err() {
                    return first;
                }
                self.command_and_read(index, drive)
            }
            _ => first,
        }
    }

    fn command_and_read(&mut self, index: usize, drive: [Drive; 2]) -> Result<(), Error> {
        if let Some(error) = self.not_ready(index) {
            return Err(error);
        }
        let Some(unit) = self.units.get(index) else { return Ok(()) };
        let (name, doubtful) = (Arc::clone(&unit.name), unit.doubtful);
        let refused = unit.interlocked && drive.iter().any(|drive| drive.moves());
        if !refused {
            self.command(index, drive)?;
        }
        if doubtful {
            self.read_slow(index, Read::Watchdog)?;
            if let Some(error) = self.not_ready(index) {
                return Err(error);
            }
        }
        self.read_encoders(index)?;
        if let Some(unit) = self.units.get_mut(index) {
            unit.patience = unit.patience.saturating_sub(1);
        }
        if refused { Err(Error::Interlocked { port: self.port(), unit: name }) } else { Ok(()) }
    }

    fn command(&mut self, index: usize, drive: [Drive; 2]) -> Result<(), Error> {
        match drive {
            [Drive::Idle, Drive::Idle] => return Ok(()),
            [Drive::Speed(one), Drive::Speed(two)] => self.tell(index, Write::Speeds([one, two]))?,
            [Drive::Duty(one), Drive::Duty(two)] => self.tell(index, Write::Duties([one, two]))?,
            mixed => {
                for (motor, drive) in [Motor::One, Motor::Two].into_iter().zip(mixed) {
                    match drive {
                        Drive::Idle => {}
                        Drive::Speed(speed) => self.tell(index, Write::Speed(motor, speed))?,
                        Drive::Duty(duty) => self.tell(index, Write::Duty(motor, duty))?,
                    }
                }
            }
        }
        if let Some(unit) = self.units.get_mut(index)
            && !drive.iter().any(|drive| drive.moves())
        {
            unit.interlocked = false;
        }
        Ok(())
    }

    pub(super) fn read_encoders(&mut self, index: usize) -> Result<(), Error> {
        let (Reply::Counts(raw), at_ns) = self.ask(index, Read::Encoders)? else { return Ok(()) };
        let port = self.port();
        let Some(unit) = self.units.get_mut(index) else { return Ok(()) };
        let Some(last) = unit.last_raw else {
            if unit.report.setups == 0 {
                unit.report.counts.value = raw.map(|count| i64::from(count.cast_signed()));
            }
            unit.report.counts.at_ns = at_ns;
            unit.last_raw = Some(raw);
            return Ok(());
        };
        let moved = [0, 1].map(|motor| raw[motor].wrapping_sub(last[motor]).cast_signed());
        let since_ns = at_ns.saturating_sub(unit.report.counts.at_ns) + SAMPLE_JITTER_NS;
        let beyond = moved.iter().position(|&counts| !unit.config.bound.explains(f64::from(counts), since_ns));
        if let Some(axis) = beyond {
            if !std::mem::replace(&mut unit.held_back, true) {
                // The counts of a unit that has restarted begin at zero, which looks just like this: its watchdog tells.
                unit.doubtful = true;
                let (unit, counts) = (Arc::clone(&unit.name), i64::from(moved[axis]));
                return Err(Error::EncoderJump { port, unit, axis, counts });
            }
            // It has not restarted; whether the count is credible is for the caller to judge.
            unit.report.jumps += 1;
        }
        for (total, moved) in unit.report.counts.value.iter_mut().zip(moved) {
            *total += i64::from(moved);
        }
        unit.report.counts.at_ns = at_ns;
        unit.last_raw = Some(raw);
        unit.held_back = false;
        Ok(())
    }

    /// Currents of every unit, and one of the slow reads, as far as there is time. A slow read that was left out comes before the currents
    /// in the next cycle: among them is the status, and with it the stop button.
    fn read_what_can_wait(&mut self, deadline_ns: u64) {
        let first = std::mem::replace(&mut self.slow_left_out, true);
        if first && !self.read_next_slow(deadline_ns) {
            return;
        }
        let units = self.units.len();
        for _ in 0..units {
            let index = self.current_turn % units;
            if !self.has_time(6, deadline_ns) {
                self.counters.left_out += 1;
                break;
            }
            self.current_turn = (self.current_turn + 1) % units;
            if self.read_slow(index, Read::Currents).is_err() {
                return;
            }
        }
        if !first {
            self.read_next_slow(deadline_ns);
        }
    }

    /// False if the line is out of step; the next cycle tells.
    fn read_next_slow(&mut self, deadline_ns: u64) -> bool {
        if !self.has_time(6, deadline_ns) {
            self.counters.left_out += 1;
            return true;
        }
        self.slow_left_out = false;
        let units = self.units.len();
        let (index, read) = (self.slow_turn % units, SLOW[self.slow_turn / units % SLOW.len()]);
        self.slow_turn = (self.slow_turn + 1) % (units * SLOW.len());
        self.read_slow(index, read).is_ok()
    }

    fn has_time(&self, answer_bytes: usize, deadline_ns: u64) -> bool {
        self.transport.now_ns() + self.likely_ns(2 + answer_bytes) <= deadline_ns
    }

    /// Ask for something that changes slowly, and keep the answer.
    pub(super) fn read_slow(&mut self, index: usize, read: Read) -> Result<(), Error> {
        let (reply, at_ns) = self.ask(index, read)?;
        let Some(unit) = self.units.get_mut(index) else { return Ok(()) };
        let report = &mut unit.report;
        match reply {
            Reply::Currents(centiamps) => {
                report.currents_a = Timed { value: centiamps.map(|current| f64::from(current) / 100.0), at_ns };
            }
            Reply::Pwms(duties) => {
                report.duties = Timed { value: duties.map(|duty| f64::from(duty) / FULL_DUTY), at_ns };
            }
            Reply::Battery(decivolts) => report.supply_v = Timed { value: f64::from(decivolts) / 10.0, at_ns },
            Reply::Temperature(tenths) => report.temperature_c = Timed { value: f64::from(tenths) / 10.0, at_ns },
            Reply::Status(status, width) => {
                report.status = Timed { value: status.neutral(), at_ns };
                report.native_status = status.0;
                unit.width = Some(width);
            }
            Reply::Watchdog(tenths) => {
                unit.doubtful = false;
                if tenths != unit.config.watchdog_tenths {
                    self.has_restarted(index);
                    if let Some(unit) = self.units.get_mut(index) {
                        unit.phase = Phase::Setup(Setup::Version);
                    }
                }
            }
            _ => {}
        }
        Ok(())
    }
}
