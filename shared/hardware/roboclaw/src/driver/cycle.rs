//! One control cycle: command every unit, read its encoders, then read what the remaining time allows.

use std::sync::Arc;

use drives::{Error, Timed, UnitAnswer, UnitReport};
use serial::Transport;

use super::{Bus, Drive, Phase, step::Setup};
use crate::codec::{Motor, Read, Reply, Write};

/// Slow questions, one per cycle. The duty comes most often: a motor whose encoder has failed runs away at high duty,
/// which must be detected within a tenth of a second. Where cycles leave no time for them, it takes longer; see
/// [`Bus::read_overdue`]. The supply and the status with the stop button come twice in a
/// round.
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

/// Slow questions besides status and duties where no cycle leaves time for any; see [`Bus::read_overdue`].
const OTHERS: [Read; 4] = [Read::MainBattery, Read::Watchdog, Read::MainBattery, Read::Temperature];

/// A unit may read an encoder this much later than it was asked, ns, while the motor moves on.
const SAMPLE_JITTER_NS: u64 = 20_000_000;

impl<T: Transport> Bus<T> {
    /// Places for the answers of [`Bus::cycle`].
    pub fn blank_answers(&self) -> Vec<UnitAnswer> {
        let blank = |_| UnitAnswer {
            outcome: Err(Error::Resynchronising { port: self.port() }),
            report: UnitReport::default(),
        };
        self.units.iter().map(blank).collect()
    }

    /// Runs [`Bus::drive`], then [`Bus::spend`] for the remaining time.
    pub fn cycle(&mut self, drives: &[[Drive; 2]], deadline_ns: u64, answers: &mut [UnitAnswer]) {
        self.drive(drives, deadline_ns, answers);
        self.spend(deadline_ns);
        for (unit, answer) in self.units.iter().zip(answers) {
            answer.report = unit.report;
        }
    }

    /// Commands each unit and reads its encoders: the part of a control cycle that the caller waits for.
    ///
    /// `drives` and `answers` follow the order of the configuration; a unit without an entry is left idle. Nothing is
    /// sent after the deadline; a missing answer ends the call later than the deadline by at most the configured
    /// margin. While the bus is out of step, the call returns at once where the time does not suffice, and the next
    /// call continues.
    pub fn drive(&mut self, drives: &[[Drive; 2]], deadline_ns: u64, answers: &mut [UnitAnswer]) {
        (self.in_cycle, self.empty) = (true, false);
        self.begin_call(deadline_ns);
        self.learn_call(deadline_ns);
        let bus = if self.transport.now_ns() >= deadline_ns {
            Err(Error::TooLate { port: self.port() })
        } else {
            self.get_in_step(deadline_ns)
        };
        for (index, answer) in answers.iter_mut().enumerate().take(self.units.len()) {
            answer.outcome = match &bus {
                Err(error) => Err(error.clone()),
                Ok(()) => self.serve(index, drives.get(index).copied().unwrap_or_default(), deadline_ns),
            };
        }
        self.in_cycle = false;
        let left = |answer: &UnitAnswer| {
            matches!(answer.outcome, Err(Error::TooLate { .. } | Error::Busy { .. } | Error::Unanswered { .. }))
        };
        let late = self.transport.now_ns() > deadline_ns;
        self.overdue.judge(late || answers.iter().take(self.units.len()).any(left));
        for (unit, answer) in self.units.iter().zip(answers) {
            answer.report = unit.report;
        }
    }

    /// Uses the time until `deadline_ns`: reads the stop input, brings back units that are not in use, and when all
    /// are, reads currents and one slow value.
    ///
    /// Starts nothing that is unlikely to end by the deadline, except for one reading where the calls before had no
    /// time for any either ([`drives::Overdue::is_value_due`]). The results are in the next cycle's reports.
    pub fn spend(&mut self, deadline_ns: u64) {
        self.begin_call(deadline_ns);
        // Time passed since the last answer.
        self.empty = false;
        self.read_stop();
        if self.transport.now_ns() < deadline_ns
            && self.get_in_step(deadline_ns).is_ok()
            && self.set_up_units(deadline_ns).is_ok()
        {
            self.read_what_can_wait(deadline_ns);
        }
    }

    fn serve(&mut self, index: usize, drive: [Drive; 2], deadline_ns: u64) -> Result<(), Error> {
        // Another unit may have brought the bus out of step in this cycle, or used its time.
        self.get_in_step(deadline_ns)?;
        if self.transport.now_ns() >= deadline_ns {
            return Err(self.not_ready(index).unwrap_or_else(|| Error::TooLate { port: self.port() }));
        }
        let first = self.command_and_read(index, drive);
        // A second attempt is safe once the bus is in step, because commands are idempotent; but only if there is time
        // for it.
        match &first {
            Err(error) if error.is_on_the_wire() => {
                let again = self.get_in_step(deadline_ns).is_ok() && self.set_up_units(deadline_ns).is_ok();
                if !again || self.transport.now_ns() >= deadline_ns {
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
        // What is refused is motion. Its motors may still run where the connection was lost for less than the
        // watchdog's time, and the questions would feed that, so it is told to stand.
        self.command(index, if refused { drive.map(Drive::at_rest) } else { drive })?;
        if refused && let Some(unit) = self.units.get_mut(index) {
            unit.interlocked = true;
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
        let now_ns = self.transport.now_ns();
        match drive {
            [Drive::Idle, Drive::Idle] => return Ok(()),
            [Drive::Speed(one), Drive::Speed(two)] => self.write(index, Write::Speeds([one, two]))?,
            [Drive::Duty(one), Drive::Duty(two)] => self.write(index, Write::Duties([one, two]))?,
            mixed => {
                for (motor, drive) in [Motor::One, Motor::Two].into_iter().zip(mixed) {
                    match drive {
                        Drive::Idle => {}
                        Drive::Speed(speed) => self.write(index, Write::Speed(motor, speed))?,
                        Drive::Duty(duty) => self.write(index, Write::Duty(motor, duty))?,
                    }
                }
            }
        }
        if let Some(unit) = self.units.get_mut(index) {
            unit.commanded_ns = now_ns;
            unit.interlocked &= drive.iter().any(|drive| drive.moves());
        }
        Ok(())
    }

    pub(super) fn read_encoders(&mut self, index: usize) -> Result<(), Error> {
        let (Reply::Counts(raw), at_ns) = self.read(index, Read::Encoders)? else { return Ok(()) };
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
                // The counts of a unit that has restarted begin at zero, which looks just like this: its watchdog
                // tells.
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

    /// Reads the currents of every unit and one slow value, as far as time allows. A slow value that was left out comes
    /// before the currents in the next cycle: one of them is the status with the stop button.
    fn read_what_can_wait(&mut self, deadline_ns: u64) {
        let now_ns = self.transport.now_ns();
        if !self.has_time(6, deadline_ns) {
            self.counters.left_out += 1;
            if self.overdue.is_value_due(now_ns, self.units.len()) {
                self.read_overdue();
            }
            return;
        }
        self.overdue.is_due(true, now_ns);
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

    /// Reads one value however little time is left. Where the bus runs inline, its answer is left to the next call.
    ///
    /// Of three values one is a status, which has the stop button, and one are the duties, by which a motor is found
    /// whose encoder has failed; the third are currents, or one of [`OTHERS`]. While values are rare, those two of
    /// every unit come before the third. They are then up to 0.24 s old for one unit and 0.4 s for two at 100 Hz, and a
    /// quarter of a second for either at 200 Hz: to be in time, more of the cycles would have to be late.
    fn read_overdue(&mut self) {
        let (turn, units) = (self.overdue_turn, self.units.len());
        self.overdue_turn = turn.wrapping_add(1);
        let rare = self.overdue.is_rare();
        let first = if rare { 2 * units } else { 2 };
        let (place, round) = (turn % (first + 1), turn / (first + 1));
        let (index, pair) = (if rare { place / 2 } else { round % units }, round / 2);
        let _ = match place {
            _ if place < first && place % 2 == 0 => self.read_slow(index, Read::Status),
            _ if place < first => self.read_slow(index, Read::Pwms),
            _ if round % 2 == 0 => self.read_slow(pair % units, Read::Currents),
            _ => self.read_slow(pair % units, OTHERS[pair / units % OTHERS.len()]),
        };
    }

    /// False if the bus got out of step; the next cycle reports it.
    fn read_next_slow(&mut self, deadline_ns: u64) -> bool {
        if !self.has_time(6, deadline_ns) {
            self.counters.left_out += 1;
            return true;
        }
        self.slow_left_out = false;
        self.read_slow_in_turn().is_ok()
    }

    fn read_slow_in_turn(&mut self) -> Result<(), Error> {
        let units = self.units.len();
        let (index, read) = (self.slow_turn % units, SLOW[self.slow_turn / units % SLOW.len()]);
        self.slow_turn = (self.slow_turn + 1) % (units * SLOW.len());
        self.read_slow(index, read)
    }

    fn has_time(&self, answer_bytes: usize, deadline_ns: u64) -> bool {
        self.transport.now_ns() + self.likely_ns(2 + answer_bytes) <= deadline_ns
    }

    /// Reads a slow value into the report.
    pub(super) fn read_slow(&mut self, index: usize, read: Read) -> Result<(), Error> {
        let (reply, at_ns) = self.read(index, read)?;
        self.use_slow(index, reply, at_ns);
        Ok(())
    }

    /// Uses a slow value that was asked for at `at_ns`.
    pub(super) fn use_slow(&mut self, index: usize, reply: Reply, at_ns: u64) {
        let Some(unit) = self.units.get_mut(index) else { return };
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
                        unit.phase = Phase::Setup(Setup::Stop);
                    }
                }
            }
            _ => {}
        }
    }
}
