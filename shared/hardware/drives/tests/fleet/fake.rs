//! A drive family that exists only here, as different from the real one as the trait allows: text lines with a tag in
//! each question and answer, one motor per unit, positions in turns, torque besides velocity.
//!
//! A question is `@ADDRESS TAG VERB VALUE`, its answer `@ADDRESS TAG TURNS AMPERES STATUS WATCHDOG_MS`. The tag makes a
//! late answer harmless: it answers an old question and is skipped.

use std::fmt::Write as _;
use std::sync::Arc;

use arrayvec::ArrayString;
use drives::{
    Capabilities, Command, CommandName, Counters, DriveBus, DriveStatus, Error, InvalidConfig, StopInput, Timed,
    UnitAnswer, UnitCommand, UnitInfo, UnitReport, reply_text,
};
use serial::{Device, Transport, WireQueue};

pub const COUNTS_PER_TURN: f64 = 1000.0;
/// Time for one question and its answer, ns.
const ANSWER_NS: u64 = 2_000_000;
/// Questions without an answer after which a unit is silent.
const SILENT_AFTER: u32 = 3;

/// A unit at the far end of the wire.
#[derive(Debug, Clone, Default)]
pub struct FakeUnit {
    pub address: u8,
    pub turns: f64,
    pub turns_s: f64,
    pub amperes: f64,
    pub watchdog_ms: u32,
    /// Keeps this watchdog whatever it is told.
    pub stubborn_ms: Option<u32>,
    pub muted: bool,
    /// Delay of its answers, ns.
    pub late_ns: u64,
    pub expired: bool,
    heard_ns: u64,
}

impl FakeUnit {
    pub fn restart(&mut self) {
        *self = Self { address: self.address, ..Self::default() };
    }
}

/// All units of a wire.
#[derive(Debug, Clone, Default)]
pub struct FakeWire {
    pub units: Vec<FakeUnit>,
    text: String,
    now_ns: u64,
}

impl FakeWire {
    pub fn new(addresses: &[u8]) -> Self {
        let unit = |&address| FakeUnit { address, ..FakeUnit::default() };
        Self { units: addresses.iter().map(unit).collect(), ..Self::default() }
    }

    fn answer(&mut self, now_ns: u64, reply: &mut WireQueue) {
        let text = std::mem::take(&mut self.text);
        let words: Vec<&str> = text.trim_start_matches('@').split(' ').collect();
        let &[address, tag, verb, value] = words.as_slice() else { return };
        let (address, value): (u8, f64) = (address.parse().unwrap(), value.parse().unwrap());
        let Some(unit) = self.units.iter_mut().find(|unit| unit.address == address && !unit.muted) else { return };
        unit.heard_ns = now_ns;
        match verb {
            "V" => (unit.turns_s, unit.amperes, unit.expired) = (value, 0.0, false),
            "T" => (unit.turns_s, unit.amperes, unit.expired) = (0.0, value, false),
            "R" => (unit.turns_s, unit.amperes, unit.expired) = (0.0, 0.0, false),
            "W" => unit.watchdog_ms = unit.stubborn_ms.unwrap_or(value as u32),
            _ => {}
        }
        let status = u8::from(unit.expired);
        let said = format!("@{address} {tag} {} {} {status} {}\n", unit.turns, unit.amperes, unit.watchdog_ms);
        reply.push(now_ns + unit.late_ns, said.as_bytes());
    }
}

impl Device for FakeWire {
    fn receive(&mut self, now_ns: u64, byte: u8, reply: &mut WireQueue) {
        match byte {
            b'\n' => self.answer(now_ns, reply),
            byte => self.text.push(char::from(byte)),
        }
    }

    fn advance(&mut self, now_ns: u64) {
        let passed_s = (now_ns - std::mem::replace(&mut self.now_ns, now_ns)) as f64 * 1e-9;
        for unit in &mut self.units {
            unit.turns += unit.turns_s * passed_s;
            let silent_ms = (now_ns - unit.heard_ns.min(now_ns)) / 1_000_000;
            if unit.watchdog_ms > 0 && silent_ms >= u64::from(unit.watchdog_ms) && unit.turns_s != 0.0 {
                (unit.turns_s, unit.amperes, unit.expired) = (0.0, 0.0, true);
            }
        }
    }
}

#[derive(Debug)]
struct Unit {
    name: Arc<str>,
    address: u8,
    report: UnitReport,
    /// Counts at the unit's own zero.
    zero: i64,
    confirmed_ms: Option<u32>,
    refused_ms: Option<u32>,
    interlocked: bool,
    failed: u32,
}

/// The driver of the family.
#[derive(Debug)]
pub struct FakeBus<T> {
    pub wire: T,
    units: Vec<Unit>,
    watchdog_ms: u32,
    tag: u32,
    connection: u32,
    stop: StopInput,
    counters: Counters,
    pub offers: Capabilities,
}

/// What an answer holds.
struct Reading {
    turns: f64,
    amperes: f64,
    expired: bool,
    watchdog_ms: u32,
    at_ns: u64,
}

impl<T: Transport> FakeBus<T> {
    pub fn new(wire: T, addresses: &[u8], watchdog_ms: u32) -> Result<Self, Error> {
        if watchdog_ms == 0 {
            let what = InvalidConfig::Watchdog { given_ms: 0, accepted: "1 to 65000 ms" };
            return Err(Error::Configuration { port: Arc::clone(wire.name()), what });
        }
        let unit = |&address| Unit {
            name: format!("drive {address}").into(),
            address,
            report: UnitReport::default(),
            zero: 0,
            confirmed_ms: None,
            refused_ms: None,
            interlocked: true,
            failed: 0,
        };
        let offers =
            Capabilities { velocity: true, torque: true, watchdog: true, currents: true, ..Capabilities::NONE };
        Ok(Self {
            wire,
            units: addresses.iter().map(unit).collect(),
            watchdog_ms,
            tag: 0,
            connection: 0,
            stop: StopInput::Unknown,
            counters: Counters::default(),
            offers,
        })
    }

    fn error(&self, unit: usize, error: impl FnOnce(Arc<str>, Arc<str>) -> Error) -> Error {
        error(Arc::clone(self.wire.name()), Arc::clone(&self.units[unit].name))
    }

    /// Connects; a new connection means that every unit may have restarted.
    fn connect(&mut self) -> Result<(), Error> {
        let connection = self.wire.connection();
        if connection.as_ref().ok() != Some(&self.connection) {
            for unit in &mut self.units {
                (unit.confirmed_ms, unit.interlocked) = (None, true);
            }
        }
        self.connection = connection?;
        Ok(())
    }

    fn ask(&mut self, unit: usize, words: &'static str, verb: char, value: f64) -> Result<Reading, Error> {
        let asked = CommandName { words, code: None };
        self.tag += 1;
        self.counters.exchanges += 1;
        let at_ns = self.wire.now_ns();
        let until_ns = at_ns + ANSWER_NS;
        let mut question = ArrayString::<48>::new();
        let _ = writeln!(question, "@{} {} {verb} {value}", self.units[unit].address, self.tag);
        self.wire.write_all(question.as_bytes(), until_ns)?;
        loop {
            let mut line = ArrayString::<96>::new();
            while !line.ends_with('\n') {
                let mut byte = [0];
                if self.wire.read(&mut byte, until_ns)? == 0 {
                    self.counters.timeouts += 1;
                    self.units[unit].failed += 1;
                    let waited_us = (ANSWER_NS / 1000) as u32;
                    return Err(self.error(unit, |port, unit| Error::NoAnswer { port, unit, asked, waited_us }));
                }
                let _ = line.try_push(char::from(byte[0]));
            }
            let Some((tag, reading)) = parse(&line, at_ns) else {
                let said = reply_text(format_args!("{}", line.trim_end()));
                return Err(self.error(unit, |port, unit| Error::Unexpected { port, unit, asked, said }));
            };
            if tag == self.tag {
                self.units[unit].failed = 0;
                return Ok(reading);
            }
            // The answer to an older question.
            self.counters.stray_bytes += line.len() as u64;
        }
    }

    fn drive(&mut self, index: usize, command: Option<Command>, deadline_ns: u64) -> Result<(), Error> {
        if self.wire.now_ns() + ANSWER_NS > deadline_ns {
            return Err(Error::TooLate { port: Arc::clone(self.wire.name()) });
        }
        self.ready(index)?;
        let moves = command.is_some_and(Command::moves);
        let refused = self.units[index].interlocked && moves;
        let reading = match command {
            Some(Command::Velocity(counts_s)) if !refused => {
                self.ask(index, "set velocity", 'V', counts_s / COUNTS_PER_TURN)?
            }
            Some(Command::Torque(amperes)) if !refused => self.ask(index, "set torque", 'T', amperes)?,
            Some(Command::Release) => self.ask(index, "release", 'R', 0.0)?,
            _ => self.ask(index, "read", '?', 0.0)?,
        };
        self.take(index, &reading)?;
        if refused {
            return Err(self.error(index, |port, unit| Error::Interlocked { port, unit }));
        }
        self.units[index].interlocked &= command.is_none();
        Ok(())
    }

    /// Reason why a unit is not in use.
    fn ready(&self, index: usize) -> Result<(), Error> {
        let unit = &self.units[index];
        if unit.failed >= SILENT_AFTER {
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

    fn take(&mut self, index: usize, reading: &Reading) -> Result<(), Error> {
        let unit = &mut self.units[index];
        if reading.watchdog_ms != self.watchdog_ms {
            // It restarted: its turns began at zero, so the counts go on from where they were.
            unit.report.reboots += 1;
            unit.zero = unit.report.counts.value[0];
            (unit.confirmed_ms, unit.interlocked) = (None, true);
            return self.ready(index);
        }
        let counts = unit.zero + (reading.turns * COUNTS_PER_TURN).round() as i64;
        unit.report.counts = Timed { value: [counts, 0], at_ns: reading.at_ns };
        unit.report.currents_a = Timed { value: [reading.amperes, 0.0], at_ns: reading.at_ns };
        let status = if reading.expired { DriveStatus::WATCHDOG } else { 0 };
        unit.report.status = Timed { value: DriveStatus(status), at_ns: reading.at_ns };
        unit.report.native_status = u32::from(reading.expired);
        Ok(())
    }

    fn set_up(&mut self, index: usize) -> Result<(), Error> {
        let before = self.ask(index, "read", '?', 0.0)?;
        let wanted_ms = self.watchdog_ms;
        if self.units[index].report.setups == 0 {
            self.units[index].report.was_alive = before.watchdog_ms == wanted_ms;
        }
        // A unit that restarted may have executed a command before its answer showed that.
        self.ask(index, "release", 'R', 0.0)?;
        self.ask(index, "set watchdog", 'W', f64::from(wanted_ms))?;
        let after = self.ask(index, "read", '?', 0.0)?;
        let unit = &mut self.units[index];
        if after.watchdog_ms != wanted_ms {
            unit.refused_ms = Some(after.watchdog_ms);
            return self.ready(index);
        }
        (unit.confirmed_ms, unit.refused_ms) = (Some(wanted_ms), None);
        unit.report.setups += 1;
        self.take(index, &after)
    }
}

fn parse(line: &str, at_ns: u64) -> Option<(u32, Reading)> {
    let mut words = line.trim_end().strip_prefix('@')?.split(' ').skip(1);
    let tag = words.next()?.parse().ok()?;
    let (turns, amperes) = (words.next()?.parse().ok()?, words.next()?.parse().ok()?);
    let (expired, watchdog_ms) = (words.next()? == "1", words.next()?.parse().ok()?);
    Some((tag, Reading { turns, amperes, expired, watchdog_ms, at_ns }))
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
            let in_time = self.wire.now_ns() + 4 * ANSWER_NS <= deadline_ns;
            if self.units[index].failed >= SILENT_AFTER && in_time {
                // Once per call it is asked again; an answer clears its failures.
                let _ = self.ask(index, "read", '?', 0.0);
            }
            if self.units[index].confirmed_ms.is_none() && self.units[index].failed < SILENT_AFTER && in_time {
                let _ = self.set_up(index);
            }
            verdict = verdict.and(self.ready(index));
        }
        // A clock that moves only when it is waited for must move here.
        let until_ns = self.wire.now_ns() + 100_000;
        self.wire.wait_until(until_ns);
        verdict
    }
    fn is_settled(&self) -> bool {
        (0..self.units.len()).all(|unit| self.ready(unit).is_ok())
    }
    fn stop(&self) -> &StopInput {
        &self.stop
    }
    fn counters(&self) -> Counters {
        self.counters
    }
}
