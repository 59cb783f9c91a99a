//! The driver of the family.

use std::fmt::Write as _;
use std::sync::Arc;

use arrayvec::ArrayVec;
use drives::{
    Capabilities, Command, CommandName, CountBound, Counters, DriveBus, DriveStatus, Error, InvalidConfig, StopInput,
    Timed, UnitAnswer, UnitCommand, UnitInfo, UnitReport,
};
use serial::{PortClock, Transport};

use super::{COUNTS_PER_TURN, EXPIRED, STOPPED, Text, seal, unseal};

/// Time for one question and its answer, ns.
pub const ANSWER_NS: u64 = 2_000_000;
/// Questions without an answer after which a unit is silent: 0.25 s of cycles, so that a short stop of the computer is
/// no silence.
const SILENT_AFTER: u32 = 25;
/// Time between two questions to a silent unit, ns: each costs the others of the port the time of an answer.
const ASK_SILENT_EVERY_NS: u64 = 500_000_000;
/// A unit may read its encoder this much later than it was asked, ns, while the motor moves on.
const SAMPLE_JITTER_NS: u64 = 20_000_000;
/// Pause of a call that can do nothing, ns: a virtual clock moves only in waits.
const PAUSE_NS: u64 = 100_000;

#[derive(Debug)]
struct Unit {
    name: Arc<str>,
    address: u8,
    report: UnitReport,
    /// Count at the unit's own zero.
    origin: i64,
    /// The watchdog as it was read back; `None` while the unit is being set up.
    confirmed_ms: Option<u32>,
    refused_ms: Option<u32>,
    /// It has answered this driver before.
    known: bool,
    /// Since its last restart its watchdog was set and read back: another value means another restart.
    watchdog_set: bool,
    interlocked: bool,
    /// The last sample was beyond the bound and was held back.
    held_back: bool,
    /// Questions without an answer since the last answer.
    failed: u32,
    /// Time at which a silent unit is asked again, ns.
    due_ns: u64,
}

impl Unit {
    fn new(address: u8) -> Self {
        Self {
            name: format!("drive {address}").into(),
            address,
            report: UnitReport::default(),
            origin: 0,
            confirmed_ms: None,
            refused_ms: None,
            known: false,
            watchdog_set: false,
            interlocked: true,
            held_back: false,
            failed: 0,
            due_ns: 0,
        }
    }

    fn is_silent(&self) -> bool {
        self.failed >= SILENT_AFTER
    }

    /// The unit began at zero again, so its counts continue from where they were.
    fn restarted(&mut self) {
        self.report.reboots += 1;
        self.origin = self.report.counts.value[0];
        (self.confirmed_ms, self.watchdog_set, self.interlocked) = (None, false, true);
    }
}

/// The driver of the units on one port.
#[derive(Debug)]
pub struct FakeBus<T> {
    pub wire: T,
    units: Vec<Unit>,
    watchdog_ms: u32,
    bound: CountBound,
    tag: u32,
    connection: u32,
    counters: Counters,
    pub offers: Capabilities,
}

/// Content of an answer.
struct Reading {
    turns: f64,
    amperes: f64,
    status: u32,
    watchdog_ms: u32,
    /// Time of the question on the machine's clock, ns.
    at_ns: u64,
}

impl<T: Transport> FakeBus<T> {
    pub fn new(wire: T, addresses: &[u8], watchdog_ms: u32, bound: CountBound) -> Result<Self, Error> {
        if watchdog_ms == 0 {
            let what = InvalidConfig::Watchdog { given_ms: 0, accepted: "1 to 65000 ms" };
            return Err(Error::Configuration { port: Arc::clone(wire.name()), what });
        }
        let offers =
            Capabilities { velocity: true, torque: true, watchdog: true, currents: true, ..Capabilities::NONE };
        // Another first tag for each start: answers to the program's last run are old too.
        let tag = (wire.now_ns() / 1000) as u32;
        let units = addresses.iter().map(|&address| Unit::new(address)).collect();
        Ok(Self { wire, units, watchdog_ms, bound, tag, connection: 0, counters: Counters::default(), offers })
    }

    fn error(&self, unit: usize, error: impl FnOnce(Arc<str>, Arc<str>) -> Error) -> Error {
        error(Arc::clone(self.wire.name()), Arc::clone(&self.units[unit].name))
    }

    /// Connects; after a new connection every unit may have restarted.
    fn connect(&mut self) -> Result<(), Error> {
        let connection = self.wire.connection();
        if connection.as_ref().ok() != Some(&self.connection) {
            for unit in &mut self.units {
                (unit.confirmed_ms, unit.interlocked) = (None, true);
            }
        }
        let connection = connection?;
        if connection != self.connection {
            self.connection = connection;
            self.counters.connections += 1;
        }
        Ok(())
    }

    fn ask(&mut self, unit: usize, words: &'static str, verb: char, value: f64) -> Result<Reading, Error> {
        self.tag = self.tag.wrapping_add(1);
        self.counters.exchanges += 1;
        let at_ns = self.wire.stamp_ns();
        let until_ns = self.wire.now_ns() + ANSWER_NS;
        let mut question = Text::new();
        let _ = write!(question, "@{} {} {verb} {value}", self.units[unit].address, self.tag);
        self.wire.write_all(seal(question).as_bytes(), until_ns)?;
        let mut garbled = false;
        while let Some(line) = self.read_line(until_ns)? {
            match parse(&line, at_ns) {
                Some((address, tag, reading)) if (address, tag) == (self.units[unit].address, self.tag) => {
                    self.units[unit].failed = 0;
                    let noise = line.iter().rposition(|&byte| byte == b'@').unwrap_or(0);
                    self.counters.stray_bytes += noise as u64;
                    return Ok(reading);
                }
                // The answer to an older question.
                Some(_) => self.counters.stray_bytes += line.len() as u64 + 1,
                None => {
                    self.counters.garbled += 1;
                    self.counters.stray_bytes += line.len() as u64 + 1;
                    garbled = true;
                }
            }
        }
        self.counters.timeouts += 1;
        self.units[unit].failed += 1;
        self.units[unit].interlocked |= self.units[unit].is_silent();
        let asked = CommandName { words, code: None };
        let waited_us = (ANSWER_NS / 1000) as u32;
        Err(self.error(unit, |port, unit| match garbled {
            true => Error::Garbled { port, unit, asked },
            false => Error::NoAnswer { port, unit, asked, waited_us },
        }))
    }

    /// Bytes up to the next end of a line, or `None` after `until_ns`.
    fn read_line(&mut self, until_ns: u64) -> Result<Option<ArrayVec<u8, 96>>, Error> {
        let mut line = ArrayVec::new();
        loop {
            let mut byte = [0];
            // The second condition ends a stream of bytes without a pause.
            if self.wire.read(&mut byte, until_ns)? == 0 || self.wire.now_ns() > until_ns {
                self.counters.stray_bytes += line.len() as u64;
                return Ok(None);
            }
            match byte {
                [b'\n'] => return Ok(Some(line)),
                [byte] if line.is_full() => {
                    self.counters.stray_bytes += line.len() as u64;
                    line.clear();
                    line.push(byte);
                }
                [byte] => line.push(byte),
            }
        }
    }

    fn drive(&mut self, index: usize, command: Option<Command>, deadline_ns: u64) -> Result<(), Error> {
        if self.wire.now_ns() + ANSWER_NS > deadline_ns {
            return Err(Error::TooLate { port: Arc::clone(self.wire.name()) });
        }
        self.ready(index)?;
        let refused = self.units[index].interlocked && command.is_some_and(Command::moves);
        let reading = match command {
            Some(Command::Velocity(counts_s)) if !refused => {
                // A speed that is no number is a stop.
                let turns_s = if counts_s.is_nan() { 0.0 } else { counts_s.clamp(-1e9, 1e9) / COUNTS_PER_TURN };
                self.ask(index, "set velocity", 'V', turns_s)?
            }
            Some(Command::Torque(amperes)) if !refused => self.ask(index, "set torque", 'T', amperes)?,
            Some(Command::Release) => self.ask(index, "release", 'R', 0.0)?,
            _ => self.ask(index, "read", '?', 0.0)?,
        };
        self.store(index, &reading)?;
        let expired = matches!(command, Some(Command::Torque(_))) && reading.status & EXPIRED != 0;
        self.units[index].interlocked |= expired;
        if refused || expired {
            return Err(self.error(index, |port, unit| Error::Interlocked { port, unit }));
        }
        self.units[index].interlocked &= command.is_none();
        Ok(())
    }

    /// Reason why a unit is not in use.
    fn ready(&self, index: usize) -> Result<(), Error> {
        let unit = &self.units[index];
        if unit.is_silent() {
            return Err(self.error(index, |port, unit| Error::Silent { port, unit }));
        }
        match (unit.confirmed_ms, unit.refused_ms) {
            (Some(_), _) => Ok(()),
            (None, Some(got_ms)) => {
                let wanted_ms = self.watchdog_ms;
                Err(self.error(index, |port, unit| Error::WatchdogRefused { port, unit, wanted_ms, got_ms }))
            }
            (None, None) => Err(self.error(index, |port, unit| Error::Preparing { port, unit })),
        }
    }

    /// Takes a reading into the report.
    fn store(&mut self, index: usize, reading: &Reading) -> Result<(), Error> {
        let bound = self.bound;
        let unit = &mut self.units[index];
        if reading.watchdog_ms != self.watchdog_ms {
            unit.restarted();
            return self.ready(index);
        }
        let counts = unit.origin + (reading.turns * COUNTS_PER_TURN).round() as i64;
        let (last, at_ns) = (unit.report.counts, reading.at_ns);
        let moved = counts - last.value[0];
        let passed_ns = at_ns.saturating_sub(last.at_ns) + SAMPLE_JITTER_NS;
        if last.is_known() && !bound.explains(moved as f64, passed_ns) {
            if !std::mem::replace(&mut unit.held_back, true) {
                let axis = 0;
                return Err(self.error(index, |port, unit| Error::EncoderJump { port, unit, axis, counts: moved }));
            }
            // Whether the count is credible is for the caller to judge.
            unit.report.jumps += 1;
        }
        unit.held_back = false;
        unit.report.counts = Timed { value: [counts, 0], at_ns };
        unit.report.currents_a = Timed { value: [reading.amperes, 0.0], at_ns };
        let bit = |native, neutral| if reading.status & native != 0 { neutral } else { 0 };
        let status = bit(EXPIRED, DriveStatus::WATCHDOG) | bit(STOPPED, DriveStatus::EMERGENCY_STOP);
        unit.report.status = Timed { value: DriveStatus(status), at_ns };
        unit.report.native_status = reading.status;
        Ok(())
    }

    /// [`ask`](Self::ask) where the time suffices.
    fn ask_by(
        &mut self,
        deadline_ns: u64,
        unit: usize,
        words: &'static str,
        verb: char,
        value: f64,
    ) -> Result<Reading, Error> {
        if self.wire.now_ns() + ANSWER_NS > deadline_ns {
            return Err(Error::TooLate { port: Arc::clone(self.wire.name()) });
        }
        self.ask(unit, words, verb, value)
    }

    /// Sets the watchdog of a unit and reads it back. Where the time ends, the next call begins again, and finds the
    /// watchdog set.
    fn set_up(&mut self, index: usize, deadline_ns: u64) -> Result<(), Error> {
        let wanted_ms = self.watchdog_ms;
        let before = self.ask_by(deadline_ns, index, "read", '?', 0.0)?;
        let unit = &mut self.units[index];
        let same = before.watchdog_ms == wanted_ms;
        if !std::mem::replace(&mut unit.known, true) {
            unit.report.was_alive = same;
        }
        if !same {
            if unit.watchdog_set {
                // It restarted while its port was gone.
                unit.restarted();
            }
            // A unit that restarted may have executed a command before its answer showed that.
            self.ask_by(deadline_ns, index, "release", 'R', 0.0)?;
            self.ask_by(deadline_ns, index, "set watchdog", 'W', f64::from(wanted_ms))?;
        }
        let after = self.ask_by(deadline_ns, index, "read", '?', 0.0)?;
        let unit = &mut self.units[index];
        if after.watchdog_ms != wanted_ms {
            unit.refused_ms = Some(after.watchdog_ms);
            return self.ready(index);
        }
        (unit.confirmed_ms, unit.refused_ms, unit.watchdog_set) = (Some(wanted_ms), None, true);
        unit.report.setups += 1;
        self.store(index, &after)
    }

    /// Brings one unit back into use, as far as the time allows.
    fn bring_back(&mut self, index: usize, deadline_ns: u64) {
        if self.units[index].is_silent() {
            if self.wire.now_ns() < self.units[index].due_ns {
                return;
            }
            self.units[index].due_ns = self.wire.now_ns() + ASK_SILENT_EVERY_NS;
            // An answer clears its failures.
            let _ = self.ask_by(deadline_ns, index, "read", '?', 0.0);
        }
        if self.units[index].confirmed_ms.is_none() && !self.units[index].is_silent() {
            let _ = self.set_up(index, deadline_ns);
        }
    }
}

fn parse(line: &[u8], at_ns: u64) -> Option<(u8, u32, Reading)> {
    let mut words = unseal(line)?.split(' ');
    let (address, tag) = (words.next()?.parse().ok()?, words.next()?.parse().ok()?);
    let (turns, amperes) = (words.next()?.parse().ok()?, words.next()?.parse().ok()?);
    let (status, watchdog_ms) = (words.next()?.parse().ok()?, words.next()?.parse().ok()?);
    Some((address, tag, Reading { turns, amperes, status, watchdog_ms, at_ns }))
}

impl<T: Transport> DriveBus for FakeBus<T> {
    fn port(&self) -> &Arc<str> {
        self.wire.name()
    }
    fn unit_count(&self) -> usize {
        self.units.len()
    }
    fn capabilities(&self) -> Capabilities {
        self.offers
    }
    fn unit(&self, unit: usize) -> Option<UnitInfo> {
        let unit = self.units.get(unit)?;
        Some(UnitInfo { name: Arc::clone(&unit.name), firmware: None, watchdog_ms: unit.confirmed_ms })
    }
    fn now_ns(&self) -> u64 {
        self.wire.now_ns()
    }
    fn clock(&self) -> Option<Arc<PortClock>> {
        self.wire.clock()
    }
    fn exchange(&mut self, commands: &[UnitCommand], deadline_ns: u64, answers: &mut [UnitAnswer]) {
        let connected = self.connect();
        for (index, answer) in answers.iter_mut().enumerate().take(self.units.len()) {
            let [command, second] = commands.get(index).copied().unwrap_or_default();
            answer.outcome = match (&connected, second) {
                (Err(error), _) => Err(error.clone()),
                (Ok(()), Some(_)) => {
                    Err(self.error(index, |port, unit| Error::Unsupported { port, unit, what: "second motor" }))
                }
                (Ok(()), None) => self.drive(index, command, deadline_ns),
            };
            answer.report = self.units[index].report;
        }
    }
    fn spend(&mut self, deadline_ns: u64) {
        let _ = self.settle(deadline_ns);
    }
    fn settle(&mut self, deadline_ns: u64) -> Result<(), Error> {
        self.connect()?;
        let mut verdict = Ok(());
        for index in 0..self.units.len() {
            self.bring_back(index, deadline_ns);
            verdict = verdict.and(self.ready(index));
        }
        if verdict.is_err() {
            let until_ns = self.wire.now_ns() + PAUSE_NS;
            self.wire.wait_until(until_ns);
        }
        verdict
    }
    fn is_settled(&self) -> bool {
        (0..self.units.len()).all(|unit| self.ready(unit).is_ok())
    }
    fn stop(&self) -> &StopInput {
        // The ports of this family have no stop input.
        &StopInput::Unknown
    }
    fn counters(&self) -> Counters {
        self.counters
    }
}
