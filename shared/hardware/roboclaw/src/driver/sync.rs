//! Synchronisation with the units: draining, fences, and the setup of a unit.

use std::sync::Arc;

use serial::Transport;

use super::step::{Setup, Step, Window};
use super::{Bus, Phase, watchdog_ms};
use drives::{ASK_SILENT_EVERY_NS, BABBLE_NS, Error, Instead, PAUSE_NS, SILENT_AFTER};

use crate::codec::{BYTE_GAP_NS, Command, Read, Reply, ReplyLength, Write};
use crate::packet::MAX_PACKET;

/// After this long without a byte the port is empty, and so are the units' parsers, ns.
const QUIET_NS: u64 = BYTE_GAP_NS + 2_000_000;

/// Every second missing answer doubles the time for the next, up to four times the margin: every second, because the
/// first may have been lost and not late; four times, because the other units and their watchdogs wait meanwhile.
const MOST_PATIENCE: u8 = 4;
/// Only one of this many attempts to reach a silent unit gets the longer time.
const PATIENT_EVERY: u32 = 4;

/// Step of a unit's watchdog time, ns.
const TENTH_NS: u64 = 100_000_000;

/// Bytes of one exchange of the setup. Only the version text is longer.
const LONGEST_STEP: usize = 20;

/// Questions that neither the cycle nor the setup asks. Consecutive fences differ, so that the late answer to one
/// cannot count as the answer to the next.
const FENCES: [Read; 4] = [Read::LogicBattery, Read::MaxCurrent1, Read::RawSpeed1, Read::VelocityPid1];

impl<T: Transport> Bus<T> {
    /// Connects, drains, fences and sets up units as far as `deadline_ns` allows; `Ok` once every unit is in use.
    ///
    /// A step that has begun may end later by the time of an answer. One step is always begun: where answers have
    /// lately been slow, no call would otherwise be long enough. Call it between cycles, or in a loop to connect.
    pub fn settle(&mut self, deadline_ns: u64) -> Result<(), Error> {
        self.empty = false;
        self.read_stop();
        // Time passes until the check of the deadline: without the pause the one step would always come slightly too
        // late.
        let deadline_ns = deadline_ns.max(self.transport.now_ns() + self.likely_ns(LONGEST_STEP) + PAUSE_NS);
        self.begin_call(deadline_ns);
        let result = self.get_in_step(deadline_ns).and_then(|()| self.set_up_units(deadline_ns));
        if result.is_err() {
            // A virtual clock moves only in waits, so this waits.
            let now_ns = self.transport.now_ns();
            self.transport.wait_until(deadline_ns.min(now_ns + PAUSE_NS).max(now_ns));
        }
        result
    }

    /// Connects if necessary, and completes draining and fencing.
    pub(super) fn get_in_step(&mut self, deadline_ns: u64) -> Result<(), Error> {
        match self.transport.connection() {
            Err(error) => return Err(self.port_failed(error)),
            Ok(connection) if connection != self.connection => {
                self.connection = connection;
                self.counters.connections += 1;
                self.lose_all();
                self.step = Step::Draining { quiet_from_ns: self.transport.now_ns() };
            }
            Ok(_) => {}
        }
        loop {
            match self.step {
                Step::Settled => return Ok(()),
                Step::Late(late) => self.await_late(late, deadline_ns)?,
                Step::Draining { quiet_from_ns } => self.drain(quiet_from_ns, deadline_ns)?,
                Step::Fencing { unit, read, until_ns, window } => {
                    self.fence(unit, read, until_ns, window, deadline_ns)?
                }
            }
        }
    }

    fn drain(&mut self, quiet_from_ns: u64, deadline_ns: u64) -> Result<(), Error> {
        let quiet_at_ns = quiet_from_ns + QUIET_NS;
        // If this call has no time for the whole silence, the next one waits for the rest: do not delay the caller.
        let until_ns = if quiet_at_ns <= deadline_ns { quiet_at_ns } else { 0 };
        let mut waste = [0; MAX_PACKET];
        let got = self.transport.read(&mut waste, until_ns).map_err(|error| self.port_failed(error))?;
        let now_ns = self.transport.now_ns();
        if got > 0 {
            self.counters.stray_bytes += got as u64;
            self.step = Step::Draining { quiet_from_ns: now_ns };
            self.noisy_from_ns.get_or_insert(now_ns);
            // Continuous noise must not block the caller.
            if now_ns < deadline_ns { Ok(()) } else { Err(self.resynchronising()) }
        } else if now_ns >= quiet_at_ns {
            self.step = Step::Settled;
            self.noisy_from_ns = None;
            Ok(())
        } else {
            Err(self.resynchronising())
        }
    }

    fn fence(
        &mut self,
        unit: usize,
        read: Read,
        until_ns: u64,
        mut window: Window,
        deadline_ns: u64,
    ) -> Result<(), Error> {
        let mut byte = [0];
        loop {
            // Byte by byte: a byte after the answer shows that the port is not empty.
            let got =
                self.transport.read(&mut byte, until_ns.min(deadline_ns)).map_err(|error| self.port_failed(error))?;
            let now_ns = self.transport.now_ns();
            if got == 0 && now_ns >= until_ns {
                self.fence_failed(unit, window.instead(&read.encode(self.address(unit))), now_ns);
                return Ok(());
            }
            if got == 0 {
                self.step = Step::Fencing { unit, read, until_ns, window };
                return Err(self.resynchronising());
            }
            window.push(byte[0]);
            let ReplyLength::Bytes(length) = read.reply_length() else { return Ok(()) };
            let Some(answer) = window.last(length + 2) else { continue };
            if read.decode(self.address(unit), answer).is_err() {
                continue;
            }
            if self.transport.pending().map_err(|error| self.port_failed(error))? > 0 {
                self.step = Step::Draining { quiet_from_ns: now_ns };
                return Ok(());
            }
            self.step = Step::Settled;
            if let Some(unit) = self.units.get_mut(unit) {
                unit.phase = Phase::Setup(Setup::Recognise { whole: unit.report.setups == 0 || unit.interlocked });
            }
            return Ok(());
        }
    }

    /// Time that a unit has to begin its answer while it is brought back into use, ns.
    pub(super) fn patience_ns(&self, unit: usize) -> u64 {
        self.units.get(unit).map_or(self.margin_ns, |unit| self.margin_ns << (unit.patience / 2))
    }

    pub(super) fn be_more_patient(&mut self, unit: usize) {
        if let Some(unit) = self.units.get_mut(unit) {
            unit.patience = (unit.patience + 1).min(MOST_PATIENCE);
        }
    }

    fn fence_failed(&mut self, unit: usize, instead: Instead, now_ns: u64) {
        self.counters.timeouts += 1;
        self.be_more_patient(unit);
        self.step = Step::Draining { quiet_from_ns: now_ns };
        self.stop_uncommanded(unit, now_ns);
        if let Some(unit) = self.units.get_mut(unit)
            && let Phase::Suspect { failed, .. } = unit.phase
        {
            unit.instead = instead;
            let failed = failed + 1;
            // It is lost.
            unit.interlocked |= failed >= SILENT_AFTER;
            let pause_ns = if failed < SILENT_AFTER { 0 } else { ASK_SILENT_EVERY_NS };
            unit.phase = Phase::Suspect { failed, due_ns: now_ns + pause_ns };
        }
    }

    /// Releases the motors of units out of use whose watchdog would expire before the next fence has ended, did the
    /// questions not feed it. A unit that hears and is not heard obeys. What it answers is drained before that fence.
    fn stop_uncommanded(&mut self, asked: usize, now_ns: u64) {
        // Before it, a command to another unit that is not heard either.
        let next_ns = now_ns + 2 * QUIET_NS + self.wire_ns(2 * LONGEST_STEP) + self.margin_ns + self.patience_ns(asked);
        for index in 0..self.units.len() {
            let Some(unit) = self.units.get_mut(index) else { return };
            let watchdog_ns = u64::from(unit.config.watchdog_tenths) * TENTH_NS;
            if unit.phase == Phase::Ready || next_ns < unit.commanded_ns + watchdog_ns {
                continue;
            }
            // The caller does not know that it has stopped, also where it is heard again before its watchdog's time.
            unit.interlocked = true;
            let packet = Write::Duties([0; 2]).encode(unit.config.address);
            self.counters.exchanges += 1;
            let until_ns = now_ns + self.wire_ns(packet.len()) + self.margin_ns;
            if let Err(error) = self.transport.write_all(&packet, until_ns) {
                self.port_failed(error);
                return;
            }
        }
    }

    /// Fences and sets up the units that need it, while the time lasts.
    pub(super) fn set_up_units(&mut self, deadline_ns: u64) -> Result<(), Error> {
        let mut index = 0;
        let mut verdict = Ok(());
        while index < self.units.len() {
            let now_ns = self.transport.now_ns();
            let Some(phase) = self.units.get(index).map(|unit| unit.phase) else { break };
            let due = match phase {
                Phase::Ready => false,
                Phase::Setup(_) => true,
                Phase::Suspect { due_ns, .. } | Phase::Unusable { due_ns, .. } => now_ns >= due_ns,
            };
            if !due {
                if verdict.is_ok()
                    && let Some(error) = self.not_ready(index)
                {
                    verdict = Err(error);
                }
                index += 1;
                continue;
            }
            if now_ns + self.likely_ns(LONGEST_STEP) > deadline_ns {
                return Err(self.not_ready(index).unwrap_or_else(|| self.resynchronising()));
            }
            match phase {
                Phase::Suspect { .. } => {
                    self.begin_fence(index)?;
                    self.get_in_step(deadline_ns)?;
                }
                Phase::Unusable { .. } => self.set_phase(index, Phase::Setup(Setup::SetWatchdog)),
                Phase::Setup(setup) => {
                    if self.set_up(index, setup).is_err() {
                        self.get_in_step(deadline_ns)?;
                    }
                }
                Phase::Ready => {}
            }
        }
        verdict
    }

    fn begin_fence(&mut self, unit: usize) -> Result<(), Error> {
        let read = FENCES[self.next_fence % FENCES.len()];
        self.next_fence = (self.next_fence + 1) % FENCES.len();
        let packet = read.encode(self.address(unit));
        let sent_ns = self.send(unit, &packet, Command::Read(read))?;
        let hopeless = matches!(self.units.get(unit).map(|unit| unit.phase),
            Some(Phase::Suspect { failed, .. }) if failed >= SILENT_AFTER && failed % PATIENT_EVERY != 0);
        let margin_ns = if hopeless { self.margin_ns } else { self.patience_ns(unit) };
        // The longest answer of a fence has 18 bytes.
        let until_ns = sent_ns + self.wire_ns(2 + 18) + margin_ns;
        self.step = Step::Fencing { unit, read, until_ns, window: Window::EMPTY };
        Ok(())
    }

    /// Asks the question of one setup step and selects the next step.
    fn set_up(&mut self, index: usize, setup: Setup) -> Result<(), Error> {
        let Some(wanted) = self.units.get(index).map(|unit| unit.config.watchdog_tenths) else { return Ok(()) };
        let next = match setup {
            Setup::Recognise { whole } => {
                let same = self.read(index, Read::Watchdog)?.0 == Reply::Watchdog(wanted);
                if let Some(unit) = self.units.get_mut(index).filter(|unit| unit.report.setups == 0) {
                    // Later it can be this driver that has set it.
                    let first = !std::mem::replace(&mut unit.recognised, true);
                    unit.report.was_alive = same && (first || unit.report.was_alive);
                }
                let was_used = self.units.get(index).is_some_and(|unit| unit.report.setups > 0);
                if !same {
                    self.has_restarted(index);
                }
                match (same, whole) {
                    (true, false) => Phase::Ready,
                    (false, _) if was_used => Phase::Setup(Setup::Stop),
                    _ => Phase::Setup(Setup::Version),
                }
            }
            Setup::Stop => {
                self.write(index, Write::Duties([0; 2]))?;
                Phase::Setup(Setup::Version)
            }
            Setup::Version => {
                if let Reply::Version(version) = self.read(index, Read::Version)?.0
                    && let Some(unit) = self.units.get_mut(index)
                {
                    unit.version = Some(version);
                    unit.width = None;
                }
                Phase::Setup(Setup::Status)
            }
            Setup::Status => {
                self.read_slow(index, Read::Status)?;
                Phase::Setup(Setup::SetWatchdog)
            }
            Setup::SetWatchdog => {
                self.write(index, Write::Watchdog(wanted))?;
                Phase::Setup(Setup::CheckWatchdog)
            }
            Setup::CheckWatchdog => match self.read(index, Read::Watchdog)?.0 {
                Reply::Watchdog(got) if got != wanted => {
                    let due_ns = self.transport.now_ns() + ASK_SILENT_EVERY_NS;
                    Phase::Unusable { wanted, got, due_ns }
                }
                _ => {
                    if let Some(unit) = self.units.get_mut(index) {
                        unit.watchdog_set = true;
                    }
                    Phase::Setup(Setup::Supply)
                }
            },
            Setup::Supply => {
                self.read_slow(index, Read::MainBattery)?;
                Phase::Setup(Setup::Encoders)
            }
            Setup::Encoders => {
                self.read_encoders(index)?;
                if let Some(unit) = self.units.get_mut(index) {
                    unit.report.setups += 1;
                    unit.doubtful = false;
                }
                Phase::Ready
            }
        };
        self.set_phase(index, next);
        Ok(())
    }

    fn set_phase(&mut self, index: usize, phase: Phase) {
        if let Some(unit) = self.units.get_mut(index) {
            unit.phase = phase;
        }
    }

    /// Records a restart of the unit: its encoders are at zero, its watchdog is off.
    pub(super) fn has_restarted(&mut self, index: usize) {
        if let Some(unit) = self.units.get_mut(index) {
            unit.interlocked = true;
            unit.doubtful = false;
            // Its counts are unrelated to those before the restart: the totals stay where they were.
            unit.last_raw = None;
            unit.held_back = false;
            // Counted once, however many attempts the setup takes.
            if std::mem::take(&mut unit.watchdog_set) {
                unit.report.reboots += 1;
            }
        }
    }

    /// Marks every unit as unknown, after the connection was lost.
    pub(super) fn lose_all(&mut self) {
        for unit in &mut self.units {
            unit.phase = Phase::Suspect { failed: 0, due_ns: 0 };
            unit.interlocked = true;
        }
    }

    /// Reason why a unit is not in use.
    pub(super) fn not_ready(&self, index: usize) -> Option<Error> {
        let unit = self.units.get(index)?;
        let (port, name) = (self.port(), Arc::clone(&unit.name));
        match unit.phase {
            Phase::Ready => None,
            Phase::Setup(_) => Some(Error::Preparing { port, unit: name }),
            Phase::Suspect { failed, .. } if failed < SILENT_AFTER => Some(Error::Resynchronising { port }),
            Phase::Suspect { .. } => Some(unit.instead.error(port, name, false)),
            Phase::Unusable { wanted, got, .. } => {
                let (wanted_ms, got_ms) = (watchdog_ms(wanted), watchdog_ms(got));
                Some(Error::WatchdogRefused { port, unit: name, wanted_ms, got_ms })
            }
        }
    }

    pub(super) fn resynchronising(&self) -> Error {
        let port = self.port();
        match self.noisy_from_ns {
            Some(from_ns) if self.transport.now_ns().saturating_sub(from_ns) > BABBLE_NS => Error::Babble { port },
            _ => Error::Resynchronising { port },
        }
    }
}
