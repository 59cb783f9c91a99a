//! Bringing the board into use.

use std::fmt::Write as _;

use arrayvec::ArrayString;
use drives::{Error, PAUSE_NS, Recognised, SetupStep, Timed};
use serial::Transport;

use super::Bus;
use super::ask::Ask;
use super::batch::{Answers, Batch};
use crate::codec::{AXES, Line, state};
use crate::status::neutral;

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
            let Some(step) = self.setup.due(now_ns) else { return };
            if now_ns + self.likely_ns(STEP_LINES) > deadline_ns || self.discard().is_err() {
                return;
            }
            let batch = self.next_step(step);
            // A silent board is asked once, and not repeatedly.
            match self.transact(&batch, "set up", now_ns) {
                Ok(answers) => self.step(step, &answers),
                Err(error) => return self.unanswered(&error),
            }
        }
    }

    pub(super) fn axes(&self) -> std::ops::Range<usize> {
        0..self.config.axes
    }

    fn next_step(&self, step: SetupStep) -> Batch {
        let mut batch = Batch::default();
        let watchdog_ms = u32::from(self.config.watchdog_ms);
        for axis in self.axes() {
            if step == SetupStep::SetWatchdog {
                batch.orders.push(Line::Write(axis, "requested_state", state::IDLE));
                batch.orders.push(Line::WriteThousandths(axis, "config.watchdog_timeout", watchdog_ms));
                batch.orders.push(Line::Write(axis, "config.enable_watchdog", 1));
            }
            match step {
                SetupStep::Identify { .. } => {}
                SetupStep::Readings => {
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
        match step {
            SetupStep::Identify { .. } => batch.asks.extend([0, 1, 2].map(Ask::Version)),
            SetupStep::Readings => batch.asks.push(Ask::Supply),
            _ => {}
        }
        batch
    }

    /// Uses the answers to a step of the setup.
    fn step(&mut self, step: SetupStep, answers: &Answers) {
        match step {
            SetupStep::Recognise => match self.setup.recognised(self.has_watchdog(answers), &mut self.report) {
                Recognised::Same => drop(self.use_feedback(answers)),
                // The positions of a board that has restarted continue no counts.
                Recognised::Restarted => {
                    (self.last_raw, self.held_back) = (None, false);
                    self.motion.forget();
                    self.controls = [None; AXES];
                }
            },
            SetupStep::Identify { same } => {
                let part = |part| answers.whole(Ask::Version(part)).unwrap_or(0);
                let mut text = ArrayString::new();
                // Three numbers fit.
                let _ = write!(text, "ODrive {}.{}.{}", part(0), part(1), part(2));
                self.firmware = Some(text);
                self.setup.identified(same);
            }
            SetupStep::SetWatchdog => {
                let _ = self.use_feedback(answers);
                let on = answers.whole(Ask::WatchdogOn(0)) == Some(1);
                let got_ms = answers.value(Ask::WatchdogTime(0)).map_or(0, |[time_s, _]| (time_s * 1e3).round() as u32);
                let now_ns = self.transport.now_ns();
                self.setup.watchdog_read(self.has_watchdog(answers), if on { got_ms } else { 0 }, now_ns);
            }
            SetupStep::Readings => {
                self.use_slow(answers);
                self.setup.finished(&mut self.report);
            }
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
            currents_a[axis] = answers.value(Ask::Current(axis)).map_or(0.0, |[current_a, _]| current_a);
        }
        self.report.currents_a = Timed { value: currents_a, at_ns };
        if let Some([supply_v, _]) = answers.value(Ask::Supply) {
            self.report.supply_v = Timed { value: supply_v, at_ns };
        }
        self.use_errors(answers);
    }

    /// Uses the error words of the axes.
    pub(super) fn use_errors(&mut self, answers: &Answers) {
        for axis in self.axes() {
            self.errors[axis] = answers.whole(Ask::Error(axis)).unwrap_or(0);
        }
        self.report.status = Timed { value: neutral(self.errors), at_ns: answers.at_ns };
        self.report.native_status = self.errors[0] | self.errors[1] << 16;
    }

    /// Records a batch without an answer.
    pub(super) fn unanswered(&mut self, error: &Error) {
        let now_ns = self.transport.now_ns();
        self.setup.unanswered(error, now_ns);
    }

    /// Reason why the board is not in use.
    pub(super) fn not_ready(&self) -> Option<Error> {
        let now_ns = self.transport.now_ns();
        let wanted_ms = u32::from(self.config.watchdog_ms);
        self.setup.not_ready(self.transport.name(), &self.name, wanted_ms, &self.noise, now_ns)
    }
}
