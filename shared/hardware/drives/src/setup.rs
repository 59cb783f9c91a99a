//! Bringing a unit into use: its steps, what interrupts them, and what a restart means.
//!
//! For families whose watchdog is a setting that a unit loses when it restarts, so that a missing watchdog shows a
//! restart.

use std::sync::Arc;

use crate::error::Error;
use crate::report::UnitReport;
use crate::silence::{ASK_SILENT_EVERY_NS, Noise, SILENT_AFTER};

/// Time in which a unit has to be without an answer to be silent, ns: an adapter may be slow for a while.
const SILENT_NS: u64 = 250_000_000;

/// Step of bringing a unit into use.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SetupStep {
    /// It is asked for its watchdog, which says whether it has restarted.
    Recognise,
    /// It is asked for its firmware. `same`: it has the watchdog already.
    Identify {
        /// See above.
        same: bool,
    },
    /// It is stopped, and its watchdog is set and read back.
    SetWatchdog,
    /// It is asked for what changes slowly.
    Readings,
}

/// What a unit was found to be.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Recognised {
    /// Its counts continue those before.
    Same,
    /// It has restarted: its counts are unrelated to those before.
    Restarted,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Phase {
    Step(SetupStep),
    /// In use.
    Ready,
    /// It does not keep its watchdog; tried again at `due_ns`.
    Unusable {
        got_ms: u32,
        due_ns: u64,
    },
}

/// Progress of bringing one unit into use, and since when it does not answer.
#[derive(Debug, Clone, Copy)]
pub struct Setup {
    phase: Phase,
    /// It was asked before whether it has the watchdog.
    recognised: bool,
    /// Since the unit's last restart its watchdog was read back.
    watchdog_set: bool,
    /// The restart that began the present setup was counted.
    restart_counted: bool,
    interlocked: bool,
    /// Questions without an answer since the last answer.
    failed: u32,
    /// Time of the first of them, ns.
    failing_from_ns: u64,
    quiet: bool,
    silent: bool,
    /// Time at which a silent unit is asked again, ns.
    due_ns: u64,
}

impl Default for Setup {
    fn default() -> Self {
        Self {
            phase: Phase::Step(SetupStep::Recognise),
            recognised: false,
            watchdog_set: false,
            restart_counted: false,
            interlocked: true,
            failed: 0,
            failing_from_ns: 0,
            quiet: false,
            silent: false,
            due_ns: 0,
        }
    }
}

impl Setup {
    /// True where the unit is in use.
    #[must_use]
    pub fn is_ready(&self) -> bool {
        self.phase == Phase::Ready
    }

    /// True where the unit does not move before it was commanded to stand still.
    #[must_use]
    pub fn is_interlocked(&self) -> bool {
        self.interlocked
    }

    /// Sets whether the unit does not move before it was commanded to stand still.
    pub fn set_interlocked(&mut self, interlocked: bool) {
        self.interlocked = interlocked;
    }

    /// True where the watchdog was read back since the unit's last restart.
    #[must_use]
    pub fn has_watchdog(&self) -> bool {
        self.watchdog_set
    }

    /// True where nothing at all answered the last question.
    #[must_use]
    pub fn is_quiet(&self) -> bool {
        self.quiet
    }

    /// False where a silent unit is left alone for a while.
    #[must_use]
    pub fn is_asked(&self, now_ns: u64) -> bool {
        now_ns >= self.due_ns
    }

    /// Sets whether nothing at all answered the last question.
    pub fn set_quiet(&mut self, quiet: bool) {
        self.quiet = quiet;
    }

    /// The step that is due, if any.
    pub fn due(&mut self, now_ns: u64) -> Option<SetupStep> {
        if let Phase::Unusable { due_ns, .. } = self.phase
            && now_ns >= due_ns
        {
            self.phase = Phase::Step(SetupStep::SetWatchdog);
        }
        match self.phase {
            Phase::Step(step) if self.is_asked(now_ns) => Some(step),
            _ => None,
        }
    }

    /// Uses the answer to [`SetupStep::Recognise`]; `same`: the unit has the configured watchdog.
    pub fn recognised(&mut self, same: bool, report: &mut UnitReport) -> Recognised {
        if report.setups == 0 {
            // Later it can be this driver that has set it.
            let first = !std::mem::replace(&mut self.recognised, true);
            report.was_alive = same && (first || report.was_alive);
        }
        // One that was in use and did not keep its watchdog may have restarted since, too.
        if !same && (self.watchdog_set || report.setups > 0) {
            self.restarted(report);
            return Recognised::Restarted;
        }
        let whole = report.setups == 0 || self.interlocked;
        self.watchdog_set |= same;
        self.phase = match same && !whole {
            true => Phase::Ready,
            false => Phase::Step(SetupStep::Identify { same }),
        };
        self.restart_counted &= self.phase != Phase::Ready;
        Recognised::Same
    }

    /// Uses the answer to [`SetupStep::Identify`].
    pub fn identified(&mut self, same: bool) {
        self.phase = Phase::Step(if same { SetupStep::Readings } else { SetupStep::SetWatchdog });
    }

    /// Uses the answer to [`SetupStep::SetWatchdog`]: whether the unit keeps the watchdog, otherwise the time it has.
    pub fn watchdog_read(&mut self, kept: bool, got_ms: u32, now_ns: u64) {
        self.watchdog_set = kept;
        self.phase = match kept {
            true => Phase::Step(SetupStep::Readings),
            false => Phase::Unusable { got_ms, due_ns: now_ns + ASK_SILENT_EVERY_NS },
        };
    }

    /// Uses the answer to [`SetupStep::Readings`]: the unit is in use.
    pub fn finished(&mut self, report: &mut UnitReport) {
        report.setups += 1;
        self.restart_counted = false;
        self.phase = Phase::Ready;
    }

    /// Records a restart of the unit. It may have executed a command before that showed, so it is stopped first.
    pub fn restarted(&mut self, report: &mut UnitReport) {
        self.set_up_again();
        report.was_alive &= report.setups > 0;
        (self.failed, self.due_ns, self.silent) = (0, 0, false);
        // Counted once, however many attempts the setup takes.
        let was_in_use = std::mem::take(&mut self.watchdog_set) || report.setups > 0;
        if was_in_use && !std::mem::replace(&mut self.restart_counted, true) {
            report.reboots += 1;
        }
    }

    /// The unit does not have its watchdog any more: it is stopped and gets it again.
    pub fn set_up_again(&mut self) {
        (self.phase, self.interlocked) = (Phase::Step(SetupStep::SetWatchdog), true);
    }

    /// It has to be asked again whether the unit has restarted.
    pub fn doubt(&mut self) {
        self.phase = Phase::Step(SetupStep::Recognise);
    }

    /// Records that the connection was lost, behind which the unit may have restarted.
    pub fn lost(&mut self) {
        self.doubt();
        self.interlocked = true;
        self.answered();
    }

    /// Records that the unit answered.
    pub fn answered(&mut self) {
        (self.failed, self.due_ns, self.quiet, self.silent) = (0, 0, false, false);
    }

    /// Records a question without a usable answer.
    pub fn unanswered(&mut self, error: &Error, now_ns: u64) {
        // Any other error is an answer.
        if !matches!(error, Error::NoAnswer { .. } | Error::Garbled { .. }) {
            return;
        }
        if self.failed == 0 {
            self.failing_from_ns = now_ns;
        }
        self.failed += 1;
        self.quiet = matches!(error, Error::NoAnswer { .. });
        if self.failed >= SILENT_AFTER && now_ns.saturating_sub(self.failing_from_ns) >= SILENT_NS {
            self.silent = true;
            self.interlocked = true;
            self.doubt();
            self.due_ns = now_ns + ASK_SILENT_EVERY_NS;
        }
    }

    /// Reason why the unit is not in use; `noise` is what arrived in place of its answer.
    #[must_use]
    pub fn not_ready(
        &self,
        port: &Arc<str>,
        unit: &Arc<str>,
        wanted_ms: u32,
        noise: &Noise,
        now_ns: u64,
    ) -> Option<Error> {
        let (port, unit) = (Arc::clone(port), Arc::clone(unit));
        match self.phase {
            _ if self.silent => Some(noise.error(port, unit, now_ns)),
            Phase::Ready => None,
            Phase::Unusable { got_ms, .. } => Some(Error::WatchdogRefused { port, unit, wanted_ms, got_ms }),
            Phase::Step(_) => Some(Error::Preparing { port, unit }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A unit that was set up as new.
    fn in_use() -> (Setup, UnitReport) {
        let (mut setup, mut report) = (Setup::default(), UnitReport::default());
        assert_eq!(setup.recognised(false, &mut report), Recognised::Same);
        setup.identified(false);
        setup.watchdog_read(true, 300, 0);
        setup.finished(&mut report);
        assert!(setup.is_ready());
        (setup, report)
    }

    #[test]
    fn a_new_unit_gets_its_watchdog_and_is_no_restart() {
        let (_, report) = in_use();
        assert_eq!((report.setups, report.reboots, report.was_alive), (1, 0, false));
    }

    #[test]
    fn a_restart_is_counted_also_after_a_refused_watchdog() {
        let (mut setup, mut report) = in_use();
        setup.set_up_again();
        setup.watchdog_read(false, 100, 0);
        assert_eq!((setup.is_ready(), setup.has_watchdog(), setup.due(1)), (false, false, None));
        setup.restarted(&mut report);
        assert_eq!(report.reboots, 1);
        // The same restart, seen again before the setup is complete.
        setup.restarted(&mut report);
        assert_eq!(report.reboots, 1);
        setup.watchdog_read(true, 300, 0);
        setup.finished(&mut report);
        setup.restarted(&mut report);
        assert_eq!(report.reboots, 2);
    }

    #[test]
    fn a_restart_behind_a_lost_port_is_counted_also_after_a_refused_watchdog() {
        let (mut setup, mut report) = in_use();
        setup.set_up_again();
        setup.watchdog_read(false, 100, 0);
        setup.lost();
        assert_eq!(setup.recognised(false, &mut report), Recognised::Restarted);
        assert_eq!(report.reboots, 1);
    }

    #[test]
    fn a_restart_before_the_first_setup_is_none() {
        let (mut setup, mut report) = (Setup::default(), UnitReport::default());
        setup.restarted(&mut report);
        assert_eq!(report.reboots, 0, "the unit was never in use");
    }

    /// Its watchdog is then one that this driver has set, though it did not hear so.
    #[test]
    fn a_new_unit_whose_answer_was_lost_has_not_been_running() {
        let (mut setup, mut report) = (Setup::default(), UnitReport::default());
        setup.recognised(false, &mut report);
        setup.identified(false);
        setup.doubt();
        assert_eq!(setup.recognised(true, &mut report), Recognised::Same);
        assert!(!report.was_alive);
        let (mut setup, mut report) = (Setup::default(), UnitReport::default());
        setup.recognised(true, &mut report);
        setup.doubt();
        setup.recognised(true, &mut report);
        assert!(report.was_alive, "asked twice");
        setup.doubt();
        setup.recognised(false, &mut report);
        assert!(!report.was_alive, "it has restarted since");
    }

    #[test]
    fn a_refused_watchdog_is_tried_again_later() {
        let mut setup = Setup::default();
        setup.watchdog_read(false, 100, 1_000);
        assert_eq!(setup.due(1_000 + ASK_SILENT_EVERY_NS - 1), None);
        assert_eq!(setup.due(1_000 + ASK_SILENT_EVERY_NS), Some(SetupStep::SetWatchdog));
    }

    #[test]
    fn a_lost_unit_is_recognised_by_its_watchdog_and_identified_again() {
        let (mut setup, mut report) = in_use();
        setup.set_interlocked(false);
        setup.lost();
        assert!(setup.is_interlocked());
        assert_eq!(setup.recognised(true, &mut report), Recognised::Same);
        assert_eq!(setup.due(0), Some(SetupStep::Identify { same: true }));
        // One that was only doubted continues at once.
        setup.identified(true);
        setup.finished(&mut report);
        setup.set_interlocked(false);
        setup.doubt();
        assert_eq!(setup.recognised(true, &mut report), Recognised::Same);
        assert!(setup.is_ready());
    }

    #[test]
    fn a_unit_is_silent_after_enough_questions_and_enough_time() {
        let (mut setup, _) = in_use();
        let (port, unit): (Arc<str>, Arc<str>) = ("port".into(), "unit".into());
        let asked = crate::CommandName { words: "read", code: None };
        let error = Error::NoAnswer { port: Arc::clone(&port), unit: Arc::clone(&unit), asked, waited_us: 1 };
        let state = |setup: &Setup| setup.not_ready(&port, &unit, 300, &Noise::default(), 0);
        for _ in 0..2 * SILENT_AFTER {
            setup.unanswered(&error, 5);
        }
        assert_eq!((state(&setup), setup.is_quiet()), (None, true), "within a moment");
        setup.unanswered(&error, 5 + SILENT_NS);
        assert!(matches!(state(&setup), Some(Error::Silent { .. })));
        assert!(setup.is_interlocked() && setup.due(5 + SILENT_NS).is_none());
        assert_eq!(setup.due(5 + SILENT_NS + ASK_SILENT_EVERY_NS), Some(SetupStep::Recognise));
    }
}
