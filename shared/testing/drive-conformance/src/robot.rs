//! A bus that is driven at the control rate.

use drives::{AXES, Command, DriveBus, Error, UnitAnswer, UnitCommand, UnitReport};
use serial::{Pipe, Transport};

use crate::clockwork::{Clockwork, second_of};
use crate::family::Family;
use crate::virtual_units::VirtualUnits;

/// One millisecond, ns.
pub const MS: u64 = 1_000_000;
/// Control period of the suite, ns.
pub const PERIOD_NS: u64 = 10 * MS;
/// Time from the beginning of a period to its deadline, ns.
pub const BUDGET_NS: u64 = 9 * MS;

/// Time in which a bus must find and set up its units, ns of the virtual clock.
const CONNECT_NS: u64 = 5_000 * MS;
/// Step between two cycles in which a fleet lets a bus settle, ns.
const STEP_NS: u64 = 5 * MS;

/// A bus of a family with virtual units, and the answers of its last cycle.
pub struct Robot<F: Family> {
    /// The driver under test.
    pub bus: F::Bus,
    /// Answers of the last cycle.
    pub answers: Vec<UnitAnswer>,
    /// Beginning of the next cycle, ns.
    pub tick_ns: u64,
    count: usize,
    inline: bool,
}

impl<F: Family> Robot<F> {
    /// A bus that has sent nothing yet, at the units as they are.
    pub fn at(clockwork: Clockwork<F::Units>, count: usize) -> Self {
        Self::on(Pipe::new("port", F::BAUD, clockwork), count)
    }

    fn on(pipe: Pipe<Clockwork<F::Units>>, count: usize) -> Self {
        let tick_ns = (pipe.now_ns() + 1).next_multiple_of(PERIOD_NS);
        let bus = F::bus(pipe, count);
        assert_eq!(bus.unit_count(), count);
        assert!(bus.can_run_inline() || !F::INLINE);
        let blank = UnitAnswer { outcome: Ok(()), report: UnitReport::default() };
        Self { bus, answers: vec![blank; count], tick_ns, count, inline: false }
    }

    /// So many units that were just switched on.
    pub fn fresh(count: usize) -> Self {
        Self::at(Clockwork::new(F::units(count), count), count)
    }

    /// The same, connected and commanded to hold once.
    pub fn connected(count: usize) -> Self {
        let mut robot = Self::fresh(count);
        robot.connect();
        robot.cycle(Command::HOLD);
        robot.assert_all_ok("after the connection");
        robot
    }

    /// Lets the bus find and set up its units, as a fleet does between cycles.
    pub fn connect(&mut self) {
        let until_ns = self.bus.now_ns() + CONNECT_NS;
        while self.bus.settle(self.bus.now_ns() + STEP_NS).is_err() {
            assert!(self.bus.now_ns() < until_ns, "not set up within 5 s: {:?}", self.bus.settle(until_ns));
        }
        assert!(self.bus.is_settled(), "settle returned Ok");
        self.tick_ns = (self.bus.now_ns() + 1).next_multiple_of(PERIOD_NS);
    }

    /// The units moved to a new driver, as when the program starts again while they run on.
    pub fn restarted_program(mut self) -> Self {
        let now_ns = self.bus.now_ns();
        let spare = Pipe::new("spare", F::BAUD, Clockwork::empty(F::units(0)));
        let mut pipe = std::mem::replace(F::pipe(&mut self.bus), spare);
        pipe.wait_until(now_ns);
        Self::on(pipe, self.count)
    }

    /// A command for every connected motor.
    pub fn all(&self, command: Option<Command>) -> Vec<UnitCommand> {
        let motor = |axis| if axis < F::MOTORS { command } else { None };
        vec![std::array::from_fn::<_, AXES, _>(motor); self.count]
    }

    /// Waits for the next period, and exchanges; leaves the time after it unused.
    pub fn exchange(&mut self, command: Option<Command>) -> u64 {
        let tick_ns = self.tick_ns;
        F::pipe(&mut self.bus).wait_until(tick_ns);
        let start_ns = self.bus.now_ns();
        let commands = self.all(command);
        self.lend();
        self.bus.exchange(&commands, start_ns + BUDGET_NS, &mut self.answers);
        let took_ns = self.bus.now_ns() - start_ns;
        let late_ns = if self.inline { 0 } else { u64::from(F::EXCHANGES) * F::ANSWER_NS };
        assert!(took_ns <= BUDGET_NS + late_ns, "an exchange took {took_ns} ns: {:?}", self.outcomes());
        start_ns
    }

    /// As a fleet does, lets a bus run inline while nothing is left to do between cycles.
    fn lend(&mut self) {
        self.inline = F::INLINE && self.bus.is_settled();
        self.bus.set_inline(self.inline);
    }

    /// Spends the rest of the period that `start_ns` began.
    pub fn spend(&mut self, start_ns: u64) {
        self.lend();
        let ends_ns = self.bus.now_ns().max(start_ns + BUDGET_NS);
        self.bus.spend(start_ns + BUDGET_NS);
        assert!(!self.inline || self.bus.now_ns() <= ends_ns, "the time was spent beyond its end");
        self.tick_ns = (self.bus.now_ns() + 1).next_multiple_of(PERIOD_NS);
    }

    /// Lets the period pass with a microsecond of time left, in which nothing fits.
    pub fn spend_a_microsecond(&mut self) {
        self.lend();
        let ends_ns = self.bus.now_ns() + MS / 1000;
        self.bus.spend(ends_ns);
        assert!(!self.inline || self.bus.now_ns() <= ends_ns, "the time was spent beyond its end");
        self.tick_ns = (self.bus.now_ns() + 1).next_multiple_of(PERIOD_NS);
    }

    /// One control cycle with this command for all motors.
    pub fn cycle(&mut self, command: Command) -> &[UnitAnswer] {
        let start_ns = self.exchange(Some(command));
        self.spend(start_ns);
        &self.answers
    }

    /// So many cycles with this command.
    pub fn cycles(&mut self, count: usize, command: Command) {
        for _ in 0..count {
            self.cycle(command);
        }
    }

    /// Cycles with [`Command::HOLD`] until every unit is in use; how many.
    pub fn recover(&mut self) -> usize {
        for cycles in 1..500 {
            if self.cycle(Command::HOLD).iter().all(|answer| answer.outcome.is_ok()) {
                return cycles;
            }
        }
        panic!("500 cycles did not bring the units back: {:?}", self.outcomes());
    }

    /// Outcomes of the last cycle.
    pub fn outcomes(&self) -> Vec<Result<(), Error>> {
        self.answers.iter().map(|answer| answer.outcome.clone()).collect()
    }

    /// The virtual units.
    pub fn units(&mut self) -> &mut F::Units {
        &mut self.clockwork().units
    }

    /// Asserts that a virtual motor does what was commanded, as exactly as the protocol can express it.
    pub(crate) fn assert_drive(&mut self, unit: usize, motor: usize, command: Command, case: &str) {
        let drive = self.units().drive(unit, motor);
        let same = match (drive, command) {
            (Command::Velocity(given), Command::Velocity(wanted)) => {
                (given - wanted).abs() < 0.6 * F::SPEED_STEP_COUNTS_S && (given == 0.0) == (wanted == 0.0)
            }
            // Torques go over the wire in their own unit.
            (Command::Torque(given), Command::Torque(wanted)) => (given - wanted).abs() < 0.001,
            _ => drive == command,
        };
        assert!(same, "{case}: unit {unit}, motor {motor}: {drive:?} instead of {command:?}");
    }

    pub(crate) fn clockwork(&mut self) -> &mut Clockwork<F::Units> {
        F::pipe(&mut self.bus).device_mut()
    }

    /// Time from the request of the last counts of a unit to the time that they show, ns; `offset` is what the counts
    /// have more than the clockwork.
    pub(crate) fn lag_ns(&self, unit: usize, offset: i64) -> i64 {
        let counts = self.answers[unit].report.counts;
        if F::MOTORS == AXES {
            assert_eq!(counts.value[0], -counts.value[1], "two motors of one sample disagree");
        }
        (counts.value[0] - offset) * 1000 - counts.at_ns.cast_signed()
    }

    /// Asserts that the second encoder's count is of the same time as the first one's, and continues that of before.
    pub(crate) fn assert_second(&self, unit: usize, before: UnitReport, case: &str) {
        let now = self.answers[unit].report;
        assert_eq!(now.second.counts.at_ns, now.counts.at_ns, "{case}: unit {unit}: read at another time");
        assert_eq!(now.second.breaks, before.second.breaks, "{case}: unit {unit}: its counts have a new origin");
        let moved = now.second.counts.value - before.second.counts.value;
        let expected = second_of(now.counts.value[0]) - second_of(before.counts.value[0]);
        // The clockwork shows whole microseconds.
        assert!(
            (moved - expected).abs() <= 2 * F::SECOND_STEP,
            "{case}: unit {unit} moved by {moved} instead of {expected}"
        );
    }

    /// Asserts that the last counts of a unit were taken after their request and before the wait for an answer ends.
    pub(crate) fn assert_fresh(&self, unit: usize, start_ns: u64, offset: i64, case: &str) {
        let at_ns = self.answers[unit].report.counts.at_ns;
        assert!(at_ns >= start_ns, "{case}: unit {unit} has a sample of an earlier cycle");
        let lag_ns = self.lag_ns(unit, offset);
        // The clockwork shows whole microseconds.
        let accepted = -1000..=F::ANSWER_NS.cast_signed();
        assert!(accepted.contains(&lag_ns), "{case}: the counts of unit {unit} are {lag_ns} ns from their time");
    }

    pub(crate) fn assert_all_ok(&self, when: &str) {
        assert!(self.answers.iter().all(|answer| answer.outcome.is_ok()), "{when}: {:?}", self.outcomes());
    }
}
