//! The controller's side of the protocol: a virtual Roboteq without physics.
//!
//! The caller gives a [`Controller`] what its sensors measure ([`Controller::measure`]) and reads what its motors
//! should do ([`Controller::target`]). Motors, supply and time are the caller's. A controller can be the far end of a
//! [`serial::Pipe`].
//!
//! Habits of the firmware that a driver meets: received bytes are sent back until `^ECHOF 1`; `_` ends a line as a
//! carriage return does, and other control characters are ignored; 0x05 is answered by 0x06; a question about no
//! channel is answered for all; only lines with `!` feed the watchdog, and after it the next of them resumes the speeds
//! of before; a history of questions can be repeated without being asked; settings are lost in a restart unless they
//! were saved.

mod answer;
mod settings;

use std::fmt::Write as _;

use serial::{Device, WireQueue};

use crate::codec::{AXES, Answer, COUNTS_PER_PULSE, FULL_SPEED, Line, Text, fault, mode};
pub use settings::{ControllerOptions, Settings};

/// User variables of a virtual controller.
pub const VARIABLES: usize = 32;

/// Questions that the history keeps.
const HISTORY: usize = 16;

const MS: u64 = 1_000_000;

/// What a motor should do.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Target {
    /// Counts per second, for the controller's loop.
    Velocity(f64),
    /// Drive output without a loop, as a share of the supply; not 0.
    Duty(f64),
    /// No loop and no drive output.
    Released,
}

/// Readings of the controller's sensors.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Measured {
    /// Counts since the start of the simulation; the controller derives its own counters.
    pub counts: [i64; AXES],
    /// Speeds, counts per second.
    pub speeds_counts_s: [f64; AXES],
    /// Motor currents, A.
    pub currents_a: [f64; AXES],
    /// Drive output as a share of the supply.
    pub duties: [f64; AXES],
    /// Supply, V.
    pub supply_v: f64,
    /// The emergency stop at the controller's input is pressed.
    pub stopped: bool,
}

impl Default for Measured {
    /// At rest on 24 V.
    fn default() -> Measured {
        Measured {
            counts: [0; AXES],
            speeds_counts_s: [0.0; AXES],
            currents_a: [0.0; AXES],
            duties: [0.0; AXES],
            supply_v: 24.0,
            stopped: false,
        }
    }
}

/// A virtual Roboteq with two motors.
#[derive(Debug, Clone)]
pub struct Controller {
    options: ControllerOptions,
    settings: Settings,
    now_ns: u64,
    measured: Measured,
    /// Commands as received, thousandths of full speed.
    commands: [i32; AXES],
    variables: [i32; VARIABLES],
    /// Counts of the sensors at which the counters are zero.
    zeros: [i64; AXES],
    faults: u32,
    motor_faults: [u32; AXES],
    fed_ns: u64,
    expired: bool,
    line: Text,
    /// The present line is too long to be one, or has bytes that are no letters.
    lost: bool,
    history: Vec<Line>,
    repeat_ms: u64,
    repeated_ns: u64,
    repeated: usize,
    deaf_until_ns: u64,
    mute_until_ns: u64,
    kept_watchdog_ms: Option<u32>,
    refused: u64,
    watchdog_trips: u64,
}

impl Controller {
    /// A controller that is switched on at time 0.
    #[must_use]
    pub fn new(options: ControllerOptions) -> Controller {
        Controller {
            settings: Settings::of(&options),
            options,
            now_ns: 0,
            measured: Measured::default(),
            commands: [0; AXES],
            variables: [0; VARIABLES],
            zeros: [0; AXES],
            faults: 0,
            motor_faults: [0; AXES],
            fed_ns: 0,
            expired: false,
            line: Text::new(),
            lost: false,
            history: Vec::with_capacity(HISTORY),
            repeat_ms: 0,
            repeated_ns: 0,
            repeated: 0,
            deaf_until_ns: 0,
            mute_until_ns: 0,
            kept_watchdog_ms: None,
            refused: 0,
            watchdog_trips: 0,
        }
    }

    /// Name for faults; the protocol has no address.
    #[must_use]
    pub fn address(&self) -> u8 {
        self.options.address
    }

    /// Sets the sensor readings.
    pub fn measure(&mut self, measured: &Measured) {
        self.measured = *measured;
        if measured.stopped {
            self.faults |= fault::EMERGENCY_STOP;
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
        let (Some(&command), Some(&mode)) = (self.commands.get(motor), self.settings.modes.get(motor)) else {
            return Target::Released;
        };
        let command = if self.expired { 0 } else { command };
        let share = f64::from(command) / f64::from(FULL_SPEED);
        match mode {
            _ if self.has_no_supply() || self.faults != 0 => Target::Released,
            mode::CLOSED_SPEED => Target::Velocity(share * self.full_speed_counts_s(motor)),
            _ if command == 0 => Target::Released,
            _ => Target::Duty(share),
        }
    }

    /// Speed of a command of 1000, counts per second.
    fn full_speed_counts_s(&self, motor: usize) -> f64 {
        f64::from(self.settings.max_rpm[motor]) / 60.0 * f64::from(self.settings.pulses[motor]) * COUNTS_PER_PULSE
    }

    /// Settings at present.
    #[must_use]
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// Changes the settings, as the maker's program does.
    pub fn settings_mut(&mut self) -> &mut Settings {
        &mut self.settings
    }

    /// Saves modes, speeds and encoders, as the maker's program does.
    pub fn save(&mut self) {
        let Settings { modes, max_rpm, pulses, .. } = self.settings;
        self.options = ControllerOptions { modes, max_rpm, pulses, ..self.options };
    }

    /// Number of lines that were answered by `-`.
    #[must_use]
    pub fn refused(&self) -> u64 {
        self.refused
    }

    /// Number of times that the watchdog stopped the motors.
    #[must_use]
    pub fn watchdog_trips(&self) -> u64 {
        self.watchdog_trips
    }

    /// Fault: the controller reports these bits of `?FF` and drives nothing, until they are cleared.
    pub fn fail(&mut self, bits: u32) {
        self.faults |= bits;
    }

    /// Fault: a motor reports these bits of `?FM`.
    pub fn fail_motor(&mut self, motor: usize, bits: u32) {
        if let Some(faults) = self.motor_faults.get_mut(motor) {
            *faults = bits;
        }
    }

    /// Ends the faults that the tests began.
    pub fn repair(&mut self) {
        (self.faults, self.motor_faults) = (self.faults & fault::EMERGENCY_STOP, [0; AXES]);
    }

    /// Fault: the supply fails for `for_ns`. Then the controller starts at zero, with the settings that were saved.
    pub fn reboot(&mut self, for_ns: u64) {
        self.deaf_until_ns = self.now_ns + for_ns;
        self.settings = Settings::of(&self.options);
        (self.commands, self.variables) = ([0; AXES], [0; VARIABLES]);
        (self.zeros, self.faults, self.motor_faults) = (self.measured.counts, 0, [0; AXES]);
        (self.fed_ns, self.expired) = (self.deaf_until_ns, false);
        self.history.clear();
        (self.repeat_ms, self.repeated, self.lost) = (0, 0, false);
        self.line.clear();
    }

    /// Fault: no answer of the controller reaches the wire until `until_ns`. It still executes commands.
    pub fn mute_until(&mut self, until_ns: u64) {
        self.mute_until_ns = until_ns;
    }

    /// Fault: accepts any watchdog time but keeps this one, ms.
    pub fn keep_watchdog(&mut self, kept_ms: u32) {
        self.kept_watchdog_ms = Some(kept_ms);
    }

    /// True while the controller has no supply.
    #[must_use]
    pub fn has_no_supply(&self) -> bool {
        self.now_ns < self.deaf_until_ns
    }

    /// Executes a line; returns the answer, if there is one.
    fn execute(&mut self, line: Line) -> Option<Answer<'static>> {
        if let Line::Motors(_) | Line::Go(..) | Line::Speed(..) | Line::SetVariable(..) | Line::Stop | Line::Resume =
            line
        {
            (self.fed_ns, self.expired) = (self.now_ns, false);
        }
        let done = match line {
            Line::Motors(values) => {
                values.iter().all(|value| value.abs() <= FULL_SPEED).then(|| self.commands = values)
            }
            Line::Go(channel, value) if value.abs() <= FULL_SPEED => self.command(channel, value),
            Line::Speed(channel, rpm) => {
                let full = self.settings.max_rpm.get(usize::from(channel).wrapping_sub(1)).copied().unwrap_or(1).max(1);
                let share = i64::from(rpm) * i64::from(FULL_SPEED) / i64::from(full);
                self.command(channel, share.clamp(-i64::from(FULL_SPEED), i64::from(FULL_SPEED)) as i32)
            }
            Line::Go(..) => None,
            Line::SetCounter(channel, value) => {
                let motor = usize::from(channel).wrapping_sub(1);
                let counts = self.measured.counts.get(motor).copied();
                counts.map(|counts| self.zeros[motor] = counts - i64::from(value))
            }
            Line::SetVariable(variable, value) => {
                let place = usize::from(variable).checked_sub(1).and_then(|index| self.variables.get_mut(index));
                place.map(|place| *place = value)
            }
            Line::Stop => {
                self.faults |= fault::EMERGENCY_STOP;
                Some(())
            }
            Line::Resume => {
                if !self.measured.stopped {
                    self.faults &= !fault::EMERGENCY_STOP;
                }
                Some(())
            }
            Line::Ask(name, channel) => {
                let answer = self.read(name, channel);
                if answer.is_some() && !name.is_setting() {
                    if self.history.len() == HISTORY {
                        self.history.remove(0);
                    }
                    self.history.push(line);
                }
                return Some(answer.unwrap_or(Answer::Refused));
            }
            Line::Set(name, channel, value) => self.settings.set(name, channel, value, self.kept_watchdog_ms),
            Line::ClearHistory => {
                self.history.clear();
                self.repeat_ms = 0;
                return None;
            }
            Line::Repeat(period_ms) => {
                (self.repeat_ms, self.repeated_ns) = (u64::from(period_ms), self.now_ns);
                return None;
            }
        };
        Some(if done.is_some() { Answer::Accepted } else { Answer::Refused })
    }

    fn command(&mut self, channel: u8, value: i32) -> Option<()> {
        let place = self.commands.get_mut(usize::from(channel).checked_sub(1)?)?;
        *place = value;
        Some(())
    }

    fn say(&self, answer: &Answer<'_>, reply: &mut WireQueue) {
        let mut text = Text::new();
        if self.now_ns >= self.mute_until_ns && write!(text, "{answer}").is_ok() {
            let at_ns = self.now_ns + self.options.turnaround_ns;
            reply.push(at_ns, text.as_bytes());
            reply.push(at_ns, b"\r");
        }
    }

    /// Answers what the history repeats. The wire takes it only together with a byte that arrives.
    fn repeat(&mut self, reply: &mut WireQueue) {
        let period_ns = self.repeat_ms * MS;
        while period_ns > 0 && !self.history.is_empty() && self.now_ns - self.repeated_ns >= period_ns {
            self.repeated_ns += period_ns;
            self.repeated = (self.repeated + 1) % self.history.len();
            if let Line::Ask(name, channel) = self.history[self.repeated]
                && let Some(answer) = self.read(name, channel)
            {
                self.say(&answer, reply);
            }
        }
    }
}

impl Device for Controller {
    /// Receives a byte; puts the answer onto the wire when a line is complete.
    fn receive(&mut self, now_ns: u64, byte: u8, reply: &mut WireQueue) {
        self.advance(now_ns);
        if self.has_no_supply() {
            return;
        }
        self.repeat(reply);
        if self.settings.echo && self.now_ns >= self.mute_until_ns {
            reply.push(self.now_ns, &[byte]);
        }
        match byte {
            0x05 => {
                if self.now_ns >= self.mute_until_ns {
                    reply.push(self.now_ns + self.options.turnaround_ns, &[0x06]);
                }
            }
            b'\r' | b'_' => {
                let line = std::mem::take(&mut self.line);
                let lost = std::mem::take(&mut self.lost);
                if line.trim_matches(' ').is_empty() && !lost {
                    return;
                }
                let line = Line::parse(&line).ok().filter(|_| !lost);
                let answer = line.map_or(Some(Answer::Refused), |line| self.execute(line));
                if let Some(answer) = answer {
                    self.refused += u64::from(answer == Answer::Refused);
                    self.say(&answer, reply);
                }
            }
            0..0x20 => {}
            _ => {
                self.lost |= !byte.is_ascii() || self.line.is_full();
                if !self.lost {
                    self.line.push(char::from(byte));
                }
            }
        }
    }

    /// Advances the watchdog to `now_ns`.
    fn advance(&mut self, now_ns: u64) {
        self.now_ns = self.now_ns.max(now_ns);
        let watchdog_ns = u64::from(self.settings.watchdog_ms) * MS;
        if watchdog_ns > 0 && !self.expired && self.now_ns.saturating_sub(self.fed_ns) >= watchdog_ns {
            self.expired = true;
            self.watchdog_trips += u64::from(self.commands != [0; AXES]);
        }
    }
}
