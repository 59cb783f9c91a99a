//! The unit's side of the protocol: a virtual moteus without physics.
//!
//! The caller gives a [`Unit`] what its sensors measure ([`Unit::measure`]) and reads what its motor should do
//! ([`Unit::target`]). Motors, supply and time are the caller's, so that the same unit works in a process on a
//! pseudo-terminal and in a test with a virtual clock. A [`UnitBus`] puts several of them on one bus and can be the far
//! end of a [`serial::Pipe`].
//!
//! Habits of the firmware that a driver meets: writing the mode resets every other setting of the command; the mode
//! that is read in the frame that writes it is that of before; values are floats of 24 bits that are cut off to whole
//! steps; a position ends instead of wrapping; after a timeout or a fault only a stop helps; a stopped unit has no
//! watchdog.

mod bus;
mod command;
mod registers;

pub use bus::UnitBus;

use crate::codec::{COUNTS_PER_TURN, Frame, Mode, REPLY_WANTED, Subframe};
use command::Command;

/// Time limit of a command that states none, s: the firmware's default.
const DEFAULT_TIMEOUT_S: f32 = 0.1;

/// Supply below which the firmware reports code 40, V.
const LOWEST_SUPPLY_V: f64 = 8.0;
const UNDERVOLTAGE: i8 = 40;

/// How fast a motor returns to a position that was commanded, per second.
const POSITION_GAIN_PER_S: f64 = 5.0;

/// Properties of a virtual unit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct UnitOptions {
    /// Identifier, 1 to 126.
    pub address: u8,
    /// Firmware version, byte by byte.
    pub firmware: i32,
    /// Time from a line's last byte to the first of the answer, ns.
    pub turnaround_ns: u64,
    /// Source of the second encoder; the other sources are the first one.
    pub second_source: u8,
    /// The position is a float of 24 bits, as in the firmware; a test that reads time from it needs every bit.
    pub rounds_position: bool,
    /// Torque that the unit states per ampere, N m/A.
    pub torque_constant_n_m_a: f64,
}

impl UnitOptions {
    /// A unit with factory settings and this identifier.
    #[must_use]
    pub fn new(address: u8) -> UnitOptions {
        // The turnaround is assumed; it is not published.
        UnitOptions {
            address,
            firmware: 0x01_0C_00,
            turnaround_ns: 150_000,
            second_source: 1,
            rounds_position: true,
            torque_constant_n_m_a: 0.05,
        }
    }
}

/// What the motor should do.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Target {
    /// Counts per second, for the unit's loops.
    Velocity(f64),
    /// Current that makes torque, A.
    Current(f64),
    /// No drive output.
    Released,
}

/// Readings of the unit's sensors.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Measured {
    /// Counts since the start of the simulation, 1/100 000 of a turn; the unit derives its own position.
    pub counts: i64,
    /// The same of the second encoder.
    pub second_counts: i64,
    /// The second encoder gives no position.
    pub second_fails: bool,
    /// Speed, counts per second.
    pub speed_counts_s: f64,
    /// Current that makes torque, A.
    pub current_a: f64,
    /// Share of the supply at the motor, -1 to 1.
    pub duty: f64,
    /// Supply, V.
    pub supply_v: f64,
    /// Board temperature, degrees Celsius.
    pub temperature_c: f64,
    /// Pins of the second auxiliary port.
    pub pins: i8,
}

impl Default for Measured {
    /// At rest on 24 V on a mild day.
    fn default() -> Measured {
        Measured {
            counts: 0,
            second_counts: 0,
            second_fails: false,
            speed_counts_s: 0.0,
            current_a: 0.0,
            duty: 0.0,
            supply_v: 24.0,
            temperature_c: 25.0,
            pins: 0,
        }
    }
}

/// A virtual moteus.
#[derive(Debug, Clone)]
pub struct Unit {
    options: UnitOptions,
    now_ns: u64,
    /// Time of power-on, ns.
    booted_ns: u64,
    measured: Measured,
    /// Count of the sensors at which the position is zero.
    zero: i64,
    mode: Mode,
    fault: i8,
    command: Command,
    /// Time of the last command, ns.
    commanded_ns: u64,
    deaf_until_ns: u64,
    mute_until_ns: u64,
    kept_timeout_s: Option<f32>,
    watchdog_trips: u64,
}

impl Unit {
    /// A unit that is switched on at time 0.
    #[must_use]
    pub fn new(options: UnitOptions) -> Unit {
        Unit {
            options,
            now_ns: 0,
            booted_ns: 0,
            measured: Measured::default(),
            zero: 0,
            mode: Mode::STOPPED,
            fault: 0,
            command: Command::NONE,
            commanded_ns: 0,
            deaf_until_ns: 0,
            mute_until_ns: 0,
            kept_timeout_s: None,
            watchdog_trips: 0,
        }
    }

    /// Identifier.
    #[must_use]
    pub fn address(&self) -> u8 {
        self.options.address
    }

    /// Advances the watchdog to `now_ns`.
    pub fn advance(&mut self, now_ns: u64) {
        self.now_ns = self.now_ns.max(now_ns);
        let timeout_s = if self.command.timeout_s == 0.0 { DEFAULT_TIMEOUT_S } else { self.command.timeout_s };
        let passed_s = now_ns.saturating_sub(self.commanded_ns) as f64 * 1e-9;
        if matches!(self.mode, Mode::POSITION | Mode::ZERO_VELOCITY) && passed_s >= f64::from(timeout_s) {
            self.mode = Mode::TIMEOUT;
            self.watchdog_trips += 1;
        }
    }

    /// Sets the sensor readings.
    pub fn measure(&mut self, measured: &Measured) {
        self.measured = *measured;
        if measured.supply_v < LOWEST_SUPPLY_V && self.target() != Target::Released {
            (self.mode, self.fault) = (Mode::FAULT, UNDERVOLTAGE);
        }
    }

    /// Last sensor readings.
    #[must_use]
    pub fn measured(&self) -> &Measured {
        &self.measured
    }

    /// What the motor should do at present.
    #[must_use]
    pub fn target(&self) -> Target {
        if self.has_no_supply() {
            return Target::Released;
        }
        match self.mode {
            Mode::POSITION if self.command.is_torque() => {
                Target::Current(f64::from(self.command.torque_n_m()) / self.options.torque_constant_n_m_a)
            }
            Mode::POSITION if self.command.position.is_finite() => {
                let away = f64::from(self.command.position) * COUNTS_PER_TURN - self.count() as f64;
                Target::Velocity(f64::from(self.command.velocity) * COUNTS_PER_TURN + POSITION_GAIN_PER_S * away)
            }
            Mode::POSITION => Target::Velocity(f64::from(self.command.velocity) * COUNTS_PER_TURN),
            // The firmware's default after a timeout: the motor is held without a position.
            Mode::TIMEOUT | Mode::ZERO_VELOCITY => Target::Velocity(0.0),
            _ => Target::Released,
        }
    }

    /// Number of times that the watchdog stopped the motor.
    #[must_use]
    pub fn watchdog_trips(&self) -> u64 {
        self.watchdog_trips
    }

    /// Fault: the supply fails for `for_ns`. Then the unit starts with a position within half a turn of zero.
    pub fn reboot(&mut self, for_ns: u64) {
        (self.mode, self.fault, self.command) = (Mode::STOPPED, 0, Command::NONE);
        self.deaf_until_ns = self.now_ns + for_ns;
        self.booted_ns = self.deaf_until_ns;
        self.zero = self.measured.counts - within_a_turn(self.measured.counts);
    }

    /// Fault: the motor's driver reports an error, as this code of the maker's reference; a stop clears it.
    pub fn fail(&mut self, code: i8) {
        (self.mode, self.fault) = (Mode::FAULT, code);
    }

    /// Fault: no answer of the unit reaches the bus until `until_ns`. It still executes commands.
    pub fn mute_until(&mut self, until_ns: u64) {
        self.mute_until_ns = until_ns;
    }

    /// Fault: accepts any time limit of a command but keeps this one, ms.
    pub fn keep_watchdog(&mut self, kept_ms: u32) {
        self.kept_timeout_s = Some(kept_ms as f32 * 1e-3);
    }

    /// True while the unit has no supply.
    #[must_use]
    pub fn has_no_supply(&self) -> bool {
        self.now_ns < self.deaf_until_ns
    }

    /// Executes a frame for this unit; returns the answer, if one was asked for and there is one.
    fn handle(&mut self, identifier: u16, frame: &Frame) -> Option<Frame> {
        if self.has_no_supply() {
            return None;
        }
        let mut answer = Frame::new();
        let mut commanded = None;
        for subframe in frame.subframes() {
            match subframe {
                Ok(Subframe::Write { register, value }) => match self.write(register, value) {
                    Ok(mode) => commanded = mode.or(commanded),
                    Err(code) => answer.write_error(register, code),
                },
                Ok(Subframe::Read { register, resolution }) => match self.read(register, resolution) {
                    Some(value) => answer.reply(register, value),
                    None => answer.read_error(register, 1),
                },
                // Nothing after a malformed subframe is executed.
                Ok(_) | Err(_) => break,
            }
        }
        // After the whole frame: its answer has the mode of before.
        if let Some(mode) = commanded {
            self.execute(mode);
        }
        let wanted = identifier & REPLY_WANTED != 0 && !answer.as_slice().is_empty();
        (wanted && self.now_ns >= self.mute_until_ns).then_some(answer)
    }

    fn execute(&mut self, mode: Mode) {
        self.commanded_ns = self.now_ns;
        self.mode = match mode {
            Mode::STOPPED => {
                self.fault = 0;
                Mode::STOPPED
            }
            _ if self.mode.is_latched() => self.mode,
            Mode::POSITION | Mode::ZERO_VELOCITY | Mode::BRAKE => mode,
            // Modes that a robot does not use drive nothing here.
            _ => Mode::STOPPED,
        };
    }

    fn count(&self) -> i64 {
        self.measured.counts - self.zero
    }
}

/// The count of the same angle between half a turn before zero and half a turn after.
fn within_a_turn(counts: i64) -> i64 {
    let turn = COUNTS_PER_TURN as i64;
    (counts + turn / 2).rem_euclid(turn) - turn / 2
}
