//! The unit's side of the protocol: a virtual RoboClaw without physics.
//!
//! The caller gives a [`Unit`] what its sensors measure ([`Unit::measure`]) and reads what its motors should do
//! ([`Unit::target`]). Motors, supply and time are the caller's, so that the same unit works in a process on a
//! pseudo-terminal and in a test with a virtual clock. A [`UnitBus`] puts several of them on one bus and can be the far
//! end of a [`serial::Pipe`].
//!
//! Where the manual leaves something open, the unit does what is harder for a driver: by default only a packet for the
//! unit itself feeds its watchdog.

mod answer;
mod axis;
mod bus;
mod settings;

pub use axis::Target;
pub use bus::UnitBus;

use crate::codec::{Motor, Pid, Version, Write};
use crate::packet::Packet;
use crate::status::{Status, StatusWidth};
use axis::Axis;
use settings::{Registers, Settings};

/// Packets that feed a unit's watchdog.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Feeds {
    /// Packets for this unit.
    #[default]
    OwnPackets,
    /// Any packet on the bus.
    AnyPacket,
}

/// Properties of a virtual unit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct UnitOptions {
    /// Address, 0x80 to 0x87.
    pub address: u8,
    /// Version text.
    pub version: Version,
    /// Width of the status in its firmware.
    pub width: StatusWidth,
    /// Time from a packet's last byte to the first of the answer, ns.
    pub turnaround_ns: u64,
    /// Packets that feed its watchdog.
    pub feeds: Feeds,
    /// Watchdog after power-on, tenths of a second.
    pub watchdog_tenths: u8,
}

impl UnitOptions {
    /// A unit with factory settings at this address.
    #[must_use]
    pub fn new(address: u8) -> UnitOptions {
        UnitOptions {
            address,
            version: Version::new("USB Roboclaw 2x15a v4.2.4"),
            width: StatusWidth::Wide,
            // Assumed for a native UART; not published.
            turnaround_ns: 150_000,
            feeds: Feeds::OwnPackets,
            watchdog_tenths: 0,
        }
    }
}

/// Readings of the unit's sensors.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Measured {
    /// Counts of both encoders since the start of the simulation; the unit derives its own register.
    pub counts: [i64; 2],
    /// Speeds, counts per second.
    pub speeds_counts_s: [f64; 2],
    /// Motor currents, A.
    pub currents_a: [f64; 2],
    /// Duty that the power stages give, -1 to 1.
    pub duties: [f64; 2],
    /// Main supply, V.
    pub supply_v: f64,
    /// Logic supply, V.
    pub logic_v: f64,
    /// Board temperature, degrees Celsius.
    pub temperature_c: f64,
    /// Conditions; an error stops both motors.
    pub status: Status,
}

impl Default for Measured {
    /// At rest on a full 12 V battery on a mild day.
    fn default() -> Measured {
        Measured {
            counts: [0; 2],
            speeds_counts_s: [0.0; 2],
            currents_a: [0.0; 2],
            duties: [0.0; 2],
            supply_v: 12.6,
            logic_v: 5.0,
            temperature_c: 25.0,
            status: Status(0),
        }
    }
}

/// A virtual RoboClaw.
#[derive(Debug, Clone)]
pub struct Unit {
    options: UnitOptions,
    now_ns: u64,
    measured: Measured,
    settings: Settings,
    /// Settings that a reboot restores.
    saved: Settings,
    registers: Registers,
    axes: [Axis; 2],
    /// Counts of the sensors at which the unit's register is zero.
    zero: [i64; 2],
    /// Wraps of the 32-bit registers since they were last read: 1 underflow, 4 overflow.
    wrapped: [u8; 2],
    heard_ns: u64,
    watchdog_trips: u64,
    deaf_until_ns: u64,
    mute_until_ns: u64,
    late: (u32, u64),
    kept_watchdog_tenths: Option<u8>,
    commands: u64,
}

impl Unit {
    /// A unit that is switched on at time 0.
    #[must_use]
    pub fn new(options: UnitOptions) -> Unit {
        let settings = Settings::new(options.watchdog_tenths);
        Unit {
            options,
            now_ns: 0,
            measured: Measured::default(),
            settings: settings.clone(),
            saved: settings,
            registers: Registers::new(),
            axes: [Axis::new(), Axis::new()],
            zero: [0; 2],
            wrapped: [0; 2],
            heard_ns: 0,
            watchdog_trips: 0,
            deaf_until_ns: 0,
            mute_until_ns: 0,
            late: (0, 0),
            kept_watchdog_tenths: None,
            commands: 0,
        }
    }

    /// Address.
    #[must_use]
    pub fn address(&self) -> u8 {
        self.options.address
    }

    /// Advances watchdog, ramps and moves over a distance to `now_ns`.
    pub fn advance(&mut self, now_ns: u64) {
        if now_ns <= self.now_ns {
            return;
        }
        let step_s = (now_ns - self.now_ns) as f64 * 1e-9;
        self.now_ns = now_ns;
        let watchdog_ns = u64::from(self.settings.watchdog_tenths) * 100_000_000;
        if watchdog_ns > 0
            && now_ns.saturating_sub(self.heard_ns) >= watchdog_ns
            && self.axes.iter().any(Axis::is_driven)
        {
            self.stop();
            self.watchdog_trips += 1;
        }
        for (motor, axis) in self.axes.iter_mut().enumerate() {
            axis.advance(step_s, register(self.measured.counts, self.zero, motor));
        }
    }

    /// Sets the sensor readings.
    pub fn measure(&mut self, measured: &Measured) {
        for motor in 0..2 {
            let lap = |counts| register(counts, self.zero, motor).div_euclid(1 << 32);
            let (before, after) = (lap(self.measured.counts), lap(measured.counts));
            self.wrapped[motor] |= if after < before { 1 } else { u8::from(after > before) << 2 };
        }
        self.measured = *measured;
    }

    /// Last sensor readings.
    #[must_use]
    pub fn measured(&self) -> &Measured {
        &self.measured
    }

    /// Present target of a motor.
    #[must_use]
    pub fn target(&self, motor: Motor) -> Target {
        if self.measured.status.is_error() || self.now_ns < self.deaf_until_ns {
            return Target::Duty(0.0);
        }
        self.axes[motor.index()].target()
    }

    /// Gains of a motor's velocity loop.
    #[must_use]
    pub fn velocity_pid(&self, motor: Motor) -> Pid {
        self.settings.velocity_pids[motor.index()]
    }

    /// Current limit of a motor, A.
    #[must_use]
    pub fn max_current_a(&self, motor: Motor) -> f64 {
        f64::from(self.settings.max_centiamps[motor.index()]) / 100.0
    }

    /// Number of times that the watchdog stopped the motors.
    #[must_use]
    pub fn watchdog_trips(&self) -> u64 {
        self.watchdog_trips
    }

    /// Number of accepted commands that change something.
    #[must_use]
    pub fn commands(&self) -> u64 {
        self.commands
    }

    /// Fault: the supply fails for `for_ns`. Then the unit restarts with its encoders at zero and its saved settings.
    pub fn reboot(&mut self, for_ns: u64) {
        self.settings = self.saved.clone();
        self.stop();
        self.zero = self.measured.counts;
        self.wrapped = [0; 2];
        self.late = (0, 0);
        self.deaf_until_ns = self.now_ns + for_ns;
        self.heard_ns = self.deaf_until_ns;
    }

    /// Fault: no answer of the unit reaches the bus until `until_ns`. It still executes commands.
    pub fn mute_until(&mut self, until_ns: u64) {
        self.mute_until_ns = until_ns;
    }

    /// Fault: the next `answers` answers begin `by_ns` late.
    pub fn answer_late(&mut self, answers: u32, by_ns: u64) {
        self.late = (answers, by_ns);
    }

    /// Fault: acknowledges a new watchdog time but keeps this one, tenths of a second.
    pub fn keep_watchdog(&mut self, tenths: u8) {
        self.settings.watchdog_tenths = tenths;
        self.kept_watchdog_tenths = Some(tenths);
    }

    /// True while the unit has no supply.
    #[must_use]
    pub fn has_no_supply(&self) -> bool {
        self.now_ns < self.deaf_until_ns
    }

    /// Executes a packet for this unit, its checksum already checked; returns the answer and its delay after the
    /// packet.
    fn handle(&mut self, code: u8, payload: &[u8]) -> Option<(Packet, u64)> {
        if self.has_no_supply() {
            return None;
        }
        self.heard_ns = self.now_ns;
        let answer = self.answer(code, payload)?;
        let late_ns = if self.late.0 > 0 {
            self.late.0 -= 1;
            self.late.1
        } else {
            0
        };
        (self.now_ns >= self.mute_until_ns).then_some((answer, self.options.turnaround_ns + late_ns))
    }

    /// Receives a packet for another unit.
    fn overhear(&mut self) {
        if self.options.feeds == Feeds::AnyPacket {
            self.heard_ns = self.now_ns;
        }
    }

    fn stop(&mut self) {
        for axis in &mut self.axes {
            axis.set_duty(0.0, 0.0);
        }
    }

    fn count(&self, motor: usize) -> i64 {
        register(self.measured.counts, self.zero, motor)
    }

    fn execute(&mut self, write: Write) {
        use Motor::{One, Two};
        self.commands += 1;
        match write {
            Write::Watchdog(tenths) => {
                self.settings.watchdog_tenths = self.kept_watchdog_tenths.unwrap_or(tenths);
            }
            Write::ResetEncoders => {
                self.zero = self.measured.counts;
                self.wrapped = [0; 2];
            }
            Write::SetEncoder(motor, count) => {
                self.zero[motor.index()] = self.measured.counts[motor.index()] - i64::from(count);
                self.wrapped[motor.index()] = 0;
            }
            Write::VelocityPid(motor, pid) => self.settings.velocity_pids[motor.index()] = pid,
            Write::Duty(motor, duty) => self.set_duty(motor, duty),
            Write::Duties([one, two]) => {
                self.set_duty(One, one);
                self.set_duty(Two, two);
            }
            Write::Speed(motor, speed) => self.set_speed(motor, 0, speed),
            Write::Speeds([one, two]) => {
                self.set_speed(One, 0, one);
                self.set_speed(Two, 0, two);
            }
            Write::SpeedRamp(motor, ramp, speed) => self.set_speed(motor, ramp, speed),
            Write::SpeedsRamp(ramp, [one, two]) => {
                self.set_speed(One, ramp, one);
                self.set_speed(Two, ramp, two);
            }
            Write::SpeedsRamps([(ramp_one, one), (ramp_two, two)]) => {
                self.set_speed(One, ramp_one, one);
                self.set_speed(Two, ramp_two, two);
            }
            Write::Save => self.saved = self.settings.clone(),
            Write::MaxCurrent(motor, centiamps) => self.settings.max_centiamps[motor.index()] = centiamps,
        }
    }

    fn set_duty(&mut self, motor: Motor, duty: i16) {
        self.axes[motor.index()].set_duty(f64::from(duty) / settings::FULL_DUTY, 0.0);
    }

    fn set_speed(&mut self, motor: Motor, ramp: u32, speed: i32) {
        self.axes[motor.index()].set_speed(
            f64::from(speed),
            f64::from(ramp),
            self.measured.speeds_counts_s[motor.index()],
        );
    }
}

/// Count of a unit before it is cut to 32 bits.
fn register(counts: [i64; 2], zero: [i64; 2], motor: usize) -> i64 {
    counts[motor] - zero[motor]
}
