//! Bringing the board into use.

use std::fmt::Write as _;

use arrayvec::ArrayString;
use drives::{ASK_SILENT_EVERY_NS, BABBLE_NS, Error, PAUSE_NS, SILENT_AFTER, Timed};
use serial::Transport;

use super::ask::Ask;
use super::batch::{Answers, Batch};
use super::{Bus, Phase};
use crate::codec::{AXES, Line, state};
use crate::status::neutral;

/// Time in which a board has to be without an answer to be silent, ns: an adapter may be slow for a while.
const SILENT_NS: u64 = 250_000_000;
/// Difference of a watchdog time that is read back, s: it is a float in the board.
const TIME_STEP_S: f64 = 0.000_5;
/// Lines of the longest step.
const STEP_LINES: usize = 14;

impl<T: Transport> Bus<T> {
    /// Connects and sets up the board as far as `deadline_ns` allows; `Ok` once it is in use.
    pub(super) fn settle_board(&mut self, deadline_ns: u64) -> Result<(), Error> {
        self.read_stop();
        self.connect()?;
        let now_ns = self.transport.now_ns();
        // One step is always begun: no call would otherwise be long enough at a low baud.
        self.bring_back(deadline_ns.max(now_ns + self.likely_ns(STEP_LINES)));
        let verdict = self.not_ready().map_or(Ok(()), Err);
        if verdict.is_err() {
            let now_ns = self.transport.now_ns();
            self.transport.wait_until(deadline_ns.min(now_ns + PAUSE_NS).max(now_ns));
        }
        verdict
    }

    /// Advances a board that is not in use, as far as the time allows.
    pub(super) fn bring_back(&mut self, deadline_ns: u64) {
        loop {
            let now_ns = self.transport.now_ns();
            if let Phase::Unusable { due_ns, .. } = self.phase
                && now_ns >= due_ns
            {
                self.phase = Phase::SetWatchdog;
            }
            let idle = matches!(self.phase, Phase::Ready | Phase::Unusable { .. });
            if idle || now_ns < self.due_ns || now_ns + self.likely_ns(STEP_LINES) > deadline_ns {
                return;
            }
            if self.discard().is_err() {
                return;
            }
            let batch = self.next_step();
            // A silent board is asked once, and not repeatedly.
            match self.transact(&batch, "set up", now_ns) {
                Ok(answers) => self.step(&answers),
                Err(error) => return self.unanswered(&error),
            }
        }
    }

    pub(super) fn axes(&self) -> std::ops::Range<usize> {
        0..self.config.axes
    }

    fn next_step(&self) -> Batch {
        let mut batch = Batch::default();
        let watchdog_ms = u32::from(self.config.watchdog_ms);
        for axis in self.axes() {
            if self.phase == Phase::SetWatchdog {
                batch.orders.push(Line::Write(axis, "requested_state", state::IDLE));
                batch.orders.push(Line::WriteThousandths(axis, "config.watchdog_timeout", watchdog_ms));
                batch.orders.push(Line::Write(axis, "config.enable_watchdog", 1));
            }
            match self.phase {
                Phase::Identify { .. } => {}
                Phase::Readings => {
                    batch.asks.push(Ask::Error(axis));
                    batch.asks.push(Ask::Current(axis));
                }
                _ => {
                    batch.asks.push(Ask::WatchdogTime(axis));
                    batch.asks.push(Ask::WatchdogOn(axis));
                    batch.asks.push(Ask::State(axis));
                    batch.asks.push(Ask::Feedback(axis));
                }
            }
        }
        match self.phase {
            Phase::Identify { .. } => batch.asks.extend([0, 1, 2].map(Ask::Version)),
            Phase::Readings => batch.asks.push(Ask::Supply),
            _ => {}
        }
        batch
    }

    /// Uses the answers to a step of the setup.
    fn step(&mut self, answers: &Answers) {
        let whole = self.report.setups == 0 || self.interlocked;
        match self.phase {
            Phase::Recognise => {
                let same = self.has_watchdog(answers);
                if self.report.setups == 0 && !self.watchdog_set {
                    self.report.was_alive = same;
                }
                if !same && self.watchdog_set {
                    return self.has_restarted();
                }
                let _ = self.use_feedback(answers);
                self.watchdog_set |= same;
                self.phase = if same && !whole { Phase::Ready } else { Phase::Identify { same } };
            }
            Phase::Identify { same } => {
                let part = |part| answers.whole(Ask::Version(part)).unwrap_or(0);
                let mut text = ArrayString::new();
                // Three numbers fit.
                let _ = write!(text, "ODrive {}.{}.{}", part(0), part(1), part(2));
                self.firmware = Some(text);
                self.phase = if same { Phase::Readings } else { Phase::SetWatchdog };
            }
            Phase::SetWatchdog => {
                let _ = self.use_feedback(answers);
                self.watchdog_set = self.has_watchdog(answers);
                let due_ns = self.transport.now_ns() + ASK_SILENT_EVERY_NS;
                let on = answers.whole(Ask::WatchdogOn(0)) == Some(1);
                let got_ms = answers.value(Ask::WatchdogTime(0)).map_or(0, |[time_s, _]| (time_s * 1e3).round() as u32);
                self.phase = match self.watchdog_set {
                    true => Phase::Readings,
                    false => Phase::Unusable { got_ms: if on { got_ms } else { 0 }, due_ns },
                };
            }
            Phase::Readings => {
                self.use_slow(answers);
                self.report.setups += 1;
                self.phase = Phase::Ready;
            }
            Phase::Ready | Phase::Unusable { .. } => {}
        }
    }

    fn has_watchdog(&self, answers: &Answers) -> bool {
        let wanted_s = f64::from(self.config.watchdog_ms) * 1e-3;
        self.axes().all(|axis| {
            let time_s = answers.value(Ask::WatchdogTime(axis));
            answers.whole(Ask::WatchdogOn(axis)) == Some(1)
                && time_s.is_some_and(|[time_s, _]| (time_s - wanted_s).abs() < TIME_STEP_S)
        })
    }

    /// Uses readings that change slowly.
    pub(super) fn use_slow(&mut self, answers: &Answers) {
        let at_ns = answers.at_ns;
        let mut currents_a = [0.0; AXES];
        for axis in self.axes() {
            self.errors[axis] = answers.whole(Ask::Error(axis)).unwrap_or(0);
            currents_a[axis] = answers.value(Ask::Current(axis)).map_or(0.0, |[current_a, _]| current_a);
        }
        self.report.currents_a = Timed { value: currents_a, at_ns };
        if let Some([supply_v, _]) = answers.value(Ask::Supply) {
            self.report.supply_v = Timed { value: supply_v, at_ns };
        }
        self.report.status = Timed { value: neutral(self.errors), at_ns };
        self.report.native_status = self.errors[0] | self.errors[1] << 16;
    }

    /// Records a restart of the board: it is disarmed, its positions are other ones, its watchdogs are off.
    pub(super) fn has_restarted(&mut self) {
        (self.interlocked, self.held_back) = (true, false);
        // Its counts are unrelated to those before the restart: the totals stay where they were.
        self.last_raw = None;
        self.phase = Phase::SetWatchdog;
        // Counted once, however many attempts the setup takes.
        if std::mem::take(&mut self.watchdog_set) {
            self.report.reboots += 1;
        }
    }

    /// Records a batch without an answer.
    pub(super) fn unanswered(&mut self, error: &Error) {
        if !matches!(error, Error::NoAnswer { .. } | Error::Garbled { .. }) {
            return;
        }
        let now_ns = self.transport.now_ns();
        if self.failed == 0 {
            self.failing_from_ns = now_ns;
        }
        self.failed += 1;
        if self.failed >= SILENT_AFTER && now_ns.saturating_sub(self.failing_from_ns) >= SILENT_NS {
            self.silent = true;
            (self.phase, self.interlocked) = (Phase::Recognise, true);
            self.due_ns = now_ns + ASK_SILENT_EVERY_NS;
        }
    }

    /// Reason why the board is not in use.
    pub(super) fn not_ready(&self) -> Option<Error> {
        let now_ns = self.transport.now_ns();
        if self.silent {
            let noisy = self.noisy_from_ns.is_some_and(|from_ns| now_ns.saturating_sub(from_ns) > BABBLE_NS);
            return Some(self.error(|port, unit| self.instead.error(port, unit, noisy)));
        }
        let wanted_ms = u32::from(self.config.watchdog_ms);
        match self.phase {
            Phase::Ready => None,
            Phase::Unusable { got_ms, .. } => {
                Some(self.error(|port, unit| Error::WatchdogRefused { port, unit, wanted_ms, got_ms }))
            }
            _ => Some(self.error(|port, unit| Error::Preparing { port, unit })),
        }
    }
}
