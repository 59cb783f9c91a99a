//! The board's side of the protocol: a virtual ODrive with firmware 0.5 and without physics.
//!
//! The caller gives a [`Board`] what its sensors measure ([`Board::measure`]) and reads what its motors should do
//! ([`Board::target`]). Motors, supply and time are the caller's. A board can be the far end of a [`serial::Pipe`].
//!
//! Habits of the firmware that a driver meets: a line ends at line feed, carriage return or `!`, and an empty line is
//! answered; a wrong checksum is silence; commands are silent; a property has nine characters; questions do not feed
//! the watchdog, and after it the motor turns freely until the errors are cleared and the state is requested again.

mod properties;

use std::fmt::Write as _;

use serial::{Device, WireQueue};

use crate::codec::{AXES, COUNTS_PER_TURN, MAX_LINE, Text, control, error, number, seal, state, unseal};

/// Properties of a virtual board.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BoardOptions {
    /// Name for faults; the protocol has no address.
    pub address: u8,
    /// Axes with a motor.
    pub axes: usize,
    /// Firmware version.
    pub firmware: [u8; 3],
    /// Time from a line's last byte to the first of the answer, ns.
    pub turnaround_ns: u64,
    /// Positions are floats of 24 bits, as in the firmware; a test that reads time from them needs every bit.
    pub rounds_position: bool,
    /// Torque of an axis per ampere, N m/A.
    pub torque_constant_n_m_a: f64,
}

impl BoardOptions {
    /// A board with two axes.
    #[must_use]
    pub fn new(address: u8) -> BoardOptions {
        // The turnaround is assumed; it is not published.
        BoardOptions {
            address,
            axes: AXES,
            firmware: [0, 5, 6],
            turnaround_ns: 150_000,
            rounds_position: true,
            torque_constant_n_m_a: 0.05,
        }
    }
}

/// What a motor should do.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Target {
    /// Counts per second, for the board's loops.
    Velocity(f64),
    /// Current that makes torque, A.
    Current(f64),
    /// No drive output.
    Released,
}

/// Readings of the board's sensors.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Measured {
    /// Counts since the start of the simulation, 1/100 000 of a turn; the board derives its own position.
    pub counts: [i64; AXES],
    /// Speeds, counts per second.
    pub speeds_counts_s: [f64; AXES],
    /// Currents that make torque, A.
    pub currents_a: [f64; AXES],
    /// Supply, V.
    pub supply_v: f64,
    /// An emergency stop is requested (over CAN; the board has no pin for it).
    pub stopped: bool,
}

impl Default for Measured {
    /// At rest on 24 V.
    fn default() -> Measured {
        Measured {
            counts: [0; AXES],
            speeds_counts_s: [0.0; AXES],
            currents_a: [0.0; AXES],
            supply_v: 24.0,
            stopped: false,
        }
    }
}

#[derive(Debug, Clone, Copy)]
pub(crate) struct Axis {
    pub(crate) state: u32,
    pub(crate) error: u32,
    /// Turns per second.
    pub(crate) input_vel: f32,
    /// N m.
    pub(crate) input_torque: f32,
    pub(crate) control_mode: u32,
    pub(crate) watchdog_timeout_s: f32,
    pub(crate) watchdog_enabled: bool,
    fed_ns: u64,
    /// Count of the sensors at which the position is zero.
    zero: i64,
}

impl Axis {
    const NEW: Axis = Axis {
        state: state::IDLE,
        error: 0,
        input_vel: 0.0,
        input_torque: 0.0,
        control_mode: control::POSITION,
        watchdog_timeout_s: 0.0,
        watchdog_enabled: false,
        fed_ns: 0,
        zero: 0,
    };
}

/// A virtual ODrive.
#[derive(Debug, Clone)]
pub struct Board {
    options: BoardOptions,
    now_ns: u64,
    measured: Measured,
    axes: [Axis; AXES],
    line: Text,
    /// The present line is too long to be one.
    lost: bool,
    deaf_until_ns: u64,
    mute_until_ns: u64,
    kept_watchdog_s: Option<f32>,
    refused: u64,
    watchdog_trips: u64,
}

impl Board {
    /// A board that is switched on at time 0.
    #[must_use]
    pub fn new(options: BoardOptions) -> Board {
        Board {
            options,
            now_ns: 0,
            measured: Measured::default(),
            axes: [Axis::NEW; AXES],
            line: Text::new(),
            lost: false,
            deaf_until_ns: 0,
            mute_until_ns: 0,
            kept_watchdog_s: None,
            refused: 0,
            watchdog_trips: 0,
        }
    }

    /// Name for faults.
    #[must_use]
    pub fn address(&self) -> u8 {
        self.options.address
    }

    /// Sets the sensor readings.
    pub fn measure(&mut self, measured: &Measured) {
        self.measured = *measured;
        if measured.stopped {
            (0..self.options.axes).for_each(|axis| self.fail(axis, error::EMERGENCY_STOP));
        }
    }

    /// Last sensor readings.
    #[must_use]
    pub fn measured(&self) -> &Measured {
        &self.measured
    }

    /// What a motor should do at present.
    #[must_use]
    pub fn target(&self, motor: usize) -> Target {
        match self.axes.get(motor) {
            Some(axis) if axis.state != state::CLOSED_LOOP || self.has_no_supply() => Target::Released,
            Some(axis) if axis.control_mode == control::TORQUE => {
                Target::Current(f64::from(axis.input_torque) / self.options.torque_constant_n_m_a)
            }
            Some(axis) => Target::Velocity(f64::from(axis.input_vel) * COUNTS_PER_TURN),
            None => Target::Released,
        }
    }

    /// Torque that an axis adds to what its loops demand, N m: that of the last command with one.
    #[must_use]
    pub fn added_torque_n_m(&self, axis: usize) -> f64 {
        self.axes.get(axis).map_or(0.0, |axis| f64::from(axis.input_torque))
    }

    /// Number of lines that were not executed because of a wrong checksum.
    #[must_use]
    pub fn refused(&self) -> u64 {
        self.refused
    }

    /// Number of times that the watchdog released a motor.
    #[must_use]
    pub fn watchdog_trips(&self) -> u64 {
        self.watchdog_trips
    }

    /// Fault: an axis reports these bits and is disarmed, until its errors are cleared.
    pub fn fail(&mut self, axis: usize, bits: u32) {
        if let Some(axis) = self.axes.get_mut(axis) {
            (axis.error, axis.state) = (axis.error | bits, state::IDLE);
        }
    }

    /// Fault: the supply fails for `for_ns`. Then the board starts at zero, without the settings that were not saved.
    pub fn reboot(&mut self, for_ns: u64) {
        self.deaf_until_ns = self.now_ns + for_ns;
        for (axis, counts) in self.axes.iter_mut().zip(self.measured.counts) {
            *axis = Axis { zero: counts, fed_ns: self.deaf_until_ns, ..Axis::NEW };
        }
        self.line.clear();
    }

    /// Fault: no answer of the board reaches the wire until `until_ns`. It still executes commands.
    pub fn mute_until(&mut self, until_ns: u64) {
        self.mute_until_ns = until_ns;
    }

    /// Fault: accepts any watchdog time but keeps this one, ms.
    pub fn keep_watchdog(&mut self, kept_ms: u32) {
        self.kept_watchdog_s = Some(kept_ms as f32 * 1e-3);
    }

    /// True while the board has no supply.
    #[must_use]
    pub fn has_no_supply(&self) -> bool {
        self.now_ns < self.deaf_until_ns
    }

    /// Position, turns.
    fn turns(&self, axis: usize) -> f64 {
        let turns = (self.measured.counts[axis] - self.axes[axis].zero) as f64 / COUNTS_PER_TURN;
        if self.options.rounds_position { f64::from(turns as f32) } else { turns }
    }

    fn feed(&mut self, axis: usize) {
        let now_ns = self.now_ns;
        if let Some(axis) = self.axes.get_mut(axis) {
            axis.fed_ns = now_ns;
        }
    }

    /// Executes a line; returns the answer, if there is one.
    fn execute(&mut self, line: &str) -> Option<Text> {
        let mut answer = Text::new();
        let mut words = line.split(' ').filter(|word| !word.is_empty());
        let command = words.next().unwrap_or_default();
        let mut axis = || words.next().and_then(|word| word.parse::<usize>().ok()).unwrap_or(usize::MAX);
        let said = match command {
            "v" | "c" | "u" | "f" => {
                let index = axis();
                if index >= self.options.axes {
                    write!(answer, "invalid motor {index}")
                } else if command == "f" {
                    let velocity = self.measured.speeds_counts_s[index] / COUNTS_PER_TURN;
                    write!(answer, "{:.6} {velocity:.6}", self.turns(index))
                } else {
                    if command != "u" {
                        let value = words.next().and_then(number)? as f32;
                        let axis = &mut self.axes[index];
                        if command == "v" {
                            (axis.input_vel, axis.control_mode) = (value, control::VELOCITY);
                            // The third word, the feedforward, is only taken where it is there.
                            axis.input_torque =
                                words.next().and_then(number).map_or(axis.input_torque, |torque| torque as f32);
                        } else {
                            (axis.input_torque, axis.control_mode) = (value, control::TORQUE);
                        }
                    }
                    self.feed(index);
                    Ok(())
                }
            }
            "r" => match words.next().and_then(|property| self.read(property)) {
                Some(value) => answer.write_str(&value),
                None => answer.write_str("invalid property"),
            },
            "w" => match (words.next(), words.next().and_then(number)) {
                (Some(property), Some(value)) if self.write(property, value).is_some() => Ok(()),
                _ => answer.write_str("invalid property"),
            },
            "sc" => {
                self.axes.iter_mut().for_each(|axis| axis.error = 0);
                let measured = self.measured;
                self.measure(&measured);
                Ok(())
            }
            "sr" => {
                self.reboot(0);
                Ok(())
            }
            _ => answer.write_str("unknown command"),
        };
        (said.is_ok() && !answer.is_empty()).then_some(answer)
    }

    fn obey(&mut self, line: &[u8], reply: &mut WireQueue) {
        let Ok((body, sealed)) = unseal(line) else {
            self.refused += 1;
            return;
        };
        let Some(answer) = self.execute(body).filter(|_| self.now_ns >= self.mute_until_ns) else { return };
        let at_ns = self.now_ns + self.options.turnaround_ns;
        reply.push(at_ns, if sealed { seal(answer) } else { answer }.as_bytes());
        reply.push(at_ns, b"\r\n");
    }
}

impl Device for Board {
    /// Receives a byte; puts the answer onto the wire when a line is complete.
    fn receive(&mut self, now_ns: u64, byte: u8, reply: &mut WireQueue) {
        self.advance(now_ns);
        if self.has_no_supply() {
            return;
        }
        if !matches!(byte, b'\n' | b'\r' | b'!') {
            // Room for the checksum of a longest answer is not needed here.
            self.lost |= !byte.is_ascii() || self.line.len() >= MAX_LINE - 4;
            if !self.lost {
                self.line.push(char::from(byte));
            }
            return;
        }
        let line = std::mem::take(&mut self.line);
        if std::mem::take(&mut self.lost) {
            self.refused += 1;
        } else {
            self.obey(line.as_bytes(), reply);
        }
    }

    /// Advances the watchdogs to `now_ns`.
    fn advance(&mut self, now_ns: u64) {
        self.now_ns = self.now_ns.max(now_ns);
        for index in 0..self.options.axes {
            let axis = &self.axes[index];
            let passed_s = self.now_ns.saturating_sub(axis.fed_ns) as f64 * 1e-9;
            let expired = axis.watchdog_enabled && passed_s >= f64::from(axis.watchdog_timeout_s);
            if expired && axis.error & error::WATCHDOG == 0 {
                self.watchdog_trips += u64::from(axis.state == state::CLOSED_LOOP);
                self.fail(index, error::WATCHDOG);
            }
        }
    }
}
