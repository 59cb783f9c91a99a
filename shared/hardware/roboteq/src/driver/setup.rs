//! Bringing the controller into use.

use arrayvec::ArrayString;
use drives::{ASK_SILENT_EVERY_NS, CommandName, Error, PAUSE_NS, Recognised, SetupStep, reply_text};
use serial::Transport;

use super::Bus;
use super::parts::{Answers, Batch, Item, MARKS, mark};
use crate::codec::{AXES, COUNTS_PER_PULSE, FULL_SPEED, Line, Name, mode};

/// Variables, after the next one, that show whether a controller has the numbers.
const RECOGNISED_BY: [usize; 2] = [0, 5];
/// Answers that are neither those of a controller with the numbers nor of one without, after which it has none: a
/// script uses its variables.
const MOST_UNCLEAR: u32 = 20;
/// Numbers that a part of the setup writes.
const MARKS_AT_ONCE: usize = 2;
/// Parts in which the numbers are written, after the motors were stopped.
const MARK_STAGES: std::ops::RangeInclusive<usize> = 1..=MARKS / MARKS_AT_ONCE;
/// A part of the setup that was of no use: the next one is in a later call.
struct Again;

impl<T: Transport> Bus<T> {
    /// Connects and sets up the controller as far as `deadline_ns` allows; `Ok` once it is in use.
    pub(super) fn settle_controller(&mut self, deadline_ns: u64) -> Result<(), Error> {
        self.read_stop();
        self.connect()?;
        // One step is always begun: no call would otherwise be long enough at a low baud.
        if self.advance(u64::MAX) {
            self.bring_back(deadline_ns);
        }
        let verdict = self.not_ready().map_or(Ok(()), Err);
        if verdict.is_err() {
            let now_ns = self.transport.now_ns();
            self.transport.wait_until(deadline_ns.min(now_ns + PAUSE_NS).max(now_ns));
        }
        verdict
    }

    /// Advances a controller that is not in use, as far as the time allows.
    pub(super) fn bring_back(&mut self, deadline_ns: u64) {
        while self.advance(deadline_ns) {}
    }

    /// Takes one step, if one is due and fits; true where the next one may follow.
    fn advance(&mut self, deadline_ns: u64) -> bool {
        let now_ns = self.transport.now_ns();
        let Some(step) = self.setup.due(now_ns) else { return false };
        if self.unfit.is_some_and(|(_, again_ns)| now_ns < again_ns) {
            return false;
        }
        if self.stage.0 != Some(step) {
            self.stage = (Some(step), 0);
        }
        let hushes = !self.hushed;
        let batch = if hushes { hush() } else { self.next_stage(step) };
        if now_ns + self.likely_ns(&batch) > deadline_ns || self.discard().is_err() {
            return false;
        }
        // A silent controller is asked once, and not repeatedly.
        match self.transact(&batch, "set up", now_ns) {
            Ok(_) if hushes => self.hushed = true,
            Ok(answers) => {
                if self.use_stage(step, &answers).is_err() {
                    self.counters.garbled += 1;
                    return false;
                }
            }
            Err(error) => {
                self.unanswered(&error);
                return false;
            }
        }
        true
    }

    /// The questions about the counters.
    pub(super) fn ask_counters(&self) -> [Item; 2] {
        [Item::Ask(Name::Counts, (self.config.axes == 1).then_some(1)); 2]
    }

    /// The lines of the present part of a step.
    fn next_stage(&self, step: SetupStep) -> Batch {
        let mut batch = Batch { marked: self.marked, ..Batch::default() };
        let ask = |name| Item::Ask(name, None);
        let counters = self.ask_counters();
        match (step, self.stage.1) {
            (SetupStep::Recognise, _) => {
                batch.marked = false;
                let variables = RECOGNISED_BY.map(|further| Item::Ask(Name::Variable, Some(self.variable(further))));
                batch.items.extend(variables.into_iter().chain([ask(Name::Watchdog); 2]).chain(counters));
            }
            (SetupStep::Identify { .. }, 0) => batch.items.extend([Name::Firmware, Name::Model].map(ask)),
            (SetupStep::Identify { .. }, _) => {
                batch.items.extend([Name::MaxRpm, Name::Pulses, Name::MaxRpm, Name::Pulses].map(ask));
            }
            (SetupStep::SetWatchdog, 0) => {
                // After a watchdog any command would resume the speeds of before.
                batch.items.extend([Item::Order(Line::Motors([0; AXES])), ask(Name::Command)]);
            }
            (SetupStep::SetWatchdog, stage) if MARK_STAGES.contains(&stage) => {
                batch.marked = false;
                for variable in variables_of(stage) {
                    batch.items.push(Item::Order(Line::SetVariable(variable, mark(variable))));
                    batch.items.push(Item::Ask(Name::Variable, Some(variable)));
                }
            }
            (SetupStep::SetWatchdog, _) => {
                let time_ms = i32::from(self.config.watchdog_ms);
                batch.items.push(Item::Order(Line::Set(Name::Watchdog, None, time_ms)));
                batch.items.extend([ask(Name::Watchdog); 2].into_iter().chain(counters));
            }
            (SetupStep::Readings, _) => {
                let names = [Name::Faults, Name::MotorFaults, Name::Mode];
                batch.items.extend(names.into_iter().chain(names).map(ask));
            }
        }
        batch
    }

    /// Uses the answers to the present part of a step.
    fn use_stage(&mut self, step: SetupStep, answers: &Answers) -> Result<(), Again> {
        match (step, self.stage.1) {
            (SetupStep::Recognise, _) => return self.recognise(answers),
            (SetupStep::Identify { .. }, 0) => {
                let texts = [Name::Firmware, Name::Model].map(|name| answers.text(name).unwrap_or_default());
                let mut firmware = ArrayString::new();
                // As much as there is room for.
                for letter in texts[0].chars().chain(", ".chars()).chain(texts[1].chars()) {
                    let _ = firmware.try_push(letter);
                }
                self.firmware = Some(firmware);
            }
            (SetupStep::Identify { same }, _) => {
                let both = answers.twice(Name::MaxRpm).zip(answers.twice(Name::Pulses)).ok_or(Again)?;
                self.use_scales(both.0, both.1)?;
                self.setup.identified(same);
            }
            (SetupStep::SetWatchdog, 0) => {
                if answers.pair(Name::Command, 0) != Some([0; AXES]) {
                    return Err(Again);
                }
                self.sent = [0; AXES];
            }
            (SetupStep::SetWatchdog, stage) if MARK_STAGES.contains(&stage) => {
                let written = |(nth, variable)| answers.single(Name::Variable, nth) == Some(mark(variable));
                if !variables_of(stage).enumerate().all(written) {
                    return Err(Again);
                }
                self.marked = stage == *MARK_STAGES.end();
            }
            (SetupStep::SetWatchdog, _) => {
                let [one, two] = [0, 1].map(|nth| answers.single(Name::Watchdog, nth));
                let got_ms = one.filter(|_| one == two).ok_or(Again)?.unsigned_abs();
                let _ = self.use_counts(answers);
                let now_ns = self.transport.now_ns();
                self.setup.watchdog_read(got_ms == u32::from(self.config.watchdog_ms), got_ms, now_ns);
            }
            (SetupStep::Readings, _) => return self.use_readings(answers),
        }
        self.stage.1 += 1;
        Ok(())
    }

    fn recognise(&mut self, answers: &Answers) -> Result<(), Again> {
        // The batch has used one number.
        let wanted = RECOGNISED_BY.map(|further| mark(self.variable(further + MARKS - 1)));
        let got = [0, 1].map(|nth| answers.single(Name::Variable, nth));
        let [one, two] = [0, 1].map(|nth| answers.single(Name::Watchdog, nth));
        let wanted_ms = i32::from(self.config.watchdog_ms);
        // Only what is the same twice is sure enough for a restart.
        let time_ms = one.filter(|_| one == two).ok_or(Again)?;
        let sure = self.flags.time_is(time_ms);
        let numbered = got == wanted.map(Some);
        let empty = got[0] == got[1];
        let unclear = if numbered { time_ms != wanted_ms && !sure } else { !empty };
        self.unclear = if unclear { self.unclear + 1 } else { 0 };
        if (1..MOST_UNCLEAR).contains(&self.unclear) {
            return Err(Again);
        }
        self.marked = numbered;
        if self.report.setups == 0 {
            self.released = self.marked;
        }
        let watched = time_ms == wanted_ms;
        match self.setup.recognised(self.marked && watched, &mut self.report) {
            Recognised::Same => drop(self.use_counts(answers)),
            Recognised::Restarted => {
                self.counted.forget();
                (self.released, self.sent) = (false, [0; AXES]);
            }
        }
        self.stage = (None, 0);
        Ok(())
    }

    fn use_scales(&mut self, max_rpm: [i32; AXES], pulses: [i32; AXES]) -> Result<(), Again> {
        for axis in self.axes() {
            let (rpm, pulses) = (f64::from(max_rpm[axis]), f64::from(pulses[axis]).abs());
            self.scales_counts_s[axis] = rpm / 60.0 * pulses * COUNTS_PER_PULSE / f64::from(FULL_SPEED);
            if rpm <= 0.0 || pulses <= 0.0 {
                let now_ns = self.transport.now_ns();
                let said = reply_text(format_args!("MXRPM={rpm}, EPPR={pulses}"));
                self.unfit = Some((said, now_ns + ASK_SILENT_EVERY_NS));
                return Err(Again);
            }
        }
        self.unfit = None;
        Ok(())
    }

    fn use_readings(&mut self, answers: &Answers) -> Result<(), Again> {
        let faults = answers.single(Name::Faults, 0).filter(|first| answers.single(Name::Faults, 1) == Some(*first));
        let (faults, motors) = faults.zip(answers.twice(Name::MotorFaults)).ok_or(Again)?;
        self.use_flags(faults, motors, answers.at_ns);
        self.modes = answers.twice(Name::Mode).ok_or(Again)?;
        let fits = |mode| mode == mode::CLOSED_SPEED || mode == mode::OPEN_LOOP && self.released;
        if let Some(axis) = self.axes().find(|&axis| !fits(self.modes[axis])) {
            let now_ns = self.transport.now_ns();
            let said = reply_text(format_args!("{}; set 1, closed-loop speed", self.modes[axis]));
            self.unfit = Some((said, now_ns + ASK_SILENT_EVERY_NS));
            return Err(Again);
        }
        self.unfit = None;
        self.setup.finished(&mut self.report);
        Ok(())
    }

    /// Records a batch without an answer.
    pub(super) fn unanswered(&mut self, error: &Error) {
        let now_ns = self.transport.now_ns();
        self.setup.unanswered(error, now_ns);
    }

    /// Reason why the controller is not in use.
    pub(super) fn not_ready(&self) -> Option<Error> {
        let now_ns = self.transport.now_ns();
        let wanted_ms = u32::from(self.config.watchdog_ms);
        let error = self.setup.not_ready(self.transport.name(), &self.name, wanted_ms, &self.noise, now_ns)?;
        match (&error, self.unfit) {
            (Error::Preparing { .. }, Some((said, _))) => {
                let asked = CommandName { words: "read settings (~MMOD, ~MXRPM, ~EPPR)", code: None };
                Some(self.error(|port, unit| Error::Unexpected { port, unit, asked, said }))
            }
            _ => Some(error),
        }
    }
}

/// Ends what was sent before, the echo, and the repetition of questions.
fn hush() -> Batch {
    let mut batch = Batch { lenient: true, ..Batch::default() };
    batch.items.push(Item::End);
    batch.items.push(Item::Order(Line::Set(Name::EchoOff, None, 1)));
    batch.items.push(Item::Order(Line::ClearHistory));
    batch.items.push(Item::Ask(Name::Variable, Some(1)));
    batch
}

/// Variables whose numbers a part of the setup writes.
fn variables_of(stage: usize) -> impl Iterator<Item = u8> + Clone {
    let first = (stage - MARK_STAGES.start()) * MARKS_AT_ONCE + 1;
    (first..first + MARKS_AT_ONCE).map(|variable| variable as u8)
}
