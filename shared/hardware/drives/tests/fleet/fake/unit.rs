//! The virtual units of the family: no physics, a caller gives them what their sensors measure.

use std::fmt::Write as _;

use arrayvec::ArrayVec;
use drive_conformance::VirtualUnits;
use drives::{AXES, Command};
use serial::{Device, WireQueue};

use super::{COUNTS_PER_TURN, EXPIRED, STOPPED, Text, seal, unseal};

/// A unit at the far end of the wire.
#[derive(Debug, Clone)]
struct FakeUnit {
    address: u8,
    counts: i64,
    /// Counts of the sensor at the unit's own zero.
    zero: i64,
    amperes: f64,
    drive: Command,
    watchdog_ms: u32,
    /// Keeps this watchdog whatever it receives.
    kept_ms: Option<u32>,
    muted: bool,
    stopped: bool,
    expired: bool,
    off_until_ns: u64,
    heard_ns: u64,
}

impl FakeUnit {
    fn new(address: u8) -> Self {
        Self {
            address,
            counts: 0,
            zero: 0,
            amperes: 0.0,
            drive: Command::Release,
            watchdog_ms: 0,
            kept_ms: None,
            muted: false,
            stopped: false,
            expired: false,
            off_until_ns: 0,
            heard_ns: 0,
        }
    }

    fn execute(&mut self, verb: &str, value: f64) {
        match verb {
            "V" => self.drive = Command::Velocity(value * COUNTS_PER_TURN),
            // What pulls waits for another command where the watchdog has released the motor.
            "T" if self.expired => return,
            "T" => self.drive = Command::Torque(value),
            "R" => self.drive = Command::Release,
            "W" => self.watchdog_ms = self.kept_ms.unwrap_or(value as u32),
            _ => return,
        }
        self.expired &= verb == "W";
    }

    fn status(&self) -> u32 {
        u32::from(self.expired) * EXPIRED + u32::from(self.stopped) * STOPPED
    }
}

/// All units of a wire.
#[derive(Debug, Clone)]
pub struct FakeWire {
    units: Vec<FakeUnit>,
    line: ArrayVec<u8, 96>,
    now_ns: u64,
}

impl FakeWire {
    pub fn new(addresses: &[u8]) -> Self {
        let units = addresses.iter().map(|&address| FakeUnit::new(address)).collect();
        Self { units, line: ArrayVec::new(), now_ns: 0 }
    }

    /// The answer to the received line, where it is a question to one of the units.
    fn answer(&mut self) -> Option<Text> {
        let mut words = unseal(&self.line)?.split(' ');
        let (address, tag): (u8, u32) = (words.next()?.parse().ok()?, words.next()?.parse().ok()?);
        let (verb, value): (&str, f64) = (words.next()?, words.next()?.parse().ok()?);
        let now_ns = self.now_ns;
        let unit = self.units.iter_mut().find(|unit| unit.address == address && now_ns >= unit.off_until_ns)?;
        unit.heard_ns = now_ns;
        unit.execute(verb, value);
        let turns = (unit.counts - unit.zero) as f64 / COUNTS_PER_TURN;
        let mut text = Text::new();
        let (amperes, status, watchdog_ms) = (unit.amperes, unit.status(), unit.watchdog_ms);
        let _ = write!(text, "@{address} {tag} {turns} {amperes} {status} {watchdog_ms}");
        (!unit.muted).then(|| seal(text))
    }
}

impl Device for FakeWire {
    fn receive(&mut self, now_ns: u64, byte: u8, reply: &mut WireQueue) {
        if byte == b'\n' {
            if let Some(answer) = self.answer() {
                reply.push(now_ns, answer.as_bytes());
            }
            self.line.clear();
        } else if self.line.try_push(byte).is_err() {
            // No line of the protocol is so long.
            self.line.clear();
        }
    }

    fn advance(&mut self, now_ns: u64) {
        self.now_ns = now_ns;
        for unit in &mut self.units {
            let quiet_ns = now_ns.saturating_sub(unit.heard_ns);
            let expires = unit.watchdog_ms > 0 && quiet_ns >= u64::from(unit.watchdog_ms) * 1_000_000;
            if expires && unit.drive != Command::Release {
                (unit.drive, unit.expired) = (Command::Release, true);
            }
        }
    }
}

impl VirtualUnits for FakeWire {
    fn measure(&mut self, unit: usize, counts: [i64; AXES], currents_a: [f64; AXES]) {
        let unit = &mut self.units[unit];
        (unit.counts, unit.amperes) = (counts[0], currents_a[0]);
    }

    fn drive(&self, unit: usize, _motor: usize) -> Command {
        let unit = &self.units[unit];
        if unit.stopped || self.now_ns < unit.off_until_ns { Command::Release } else { unit.drive }
    }

    fn restart(&mut self, unit: usize, down_ns: u64) {
        let unit = &mut self.units[unit];
        let off_until_ns = self.now_ns + down_ns;
        let FakeUnit { address, counts, kept_ms, .. } = *unit;
        *unit = FakeUnit { counts, zero: counts, kept_ms, off_until_ns, ..FakeUnit::new(address) };
    }

    fn mute(&mut self, unit: usize, muted: bool) {
        self.units[unit].muted = muted;
    }

    fn press_stop(&mut self, unit: usize, pressed: bool) {
        self.units[unit].stopped = pressed;
    }

    fn keep_watchdog(&mut self, unit: usize, kept_ms: u32) {
        let unit = &mut self.units[unit];
        (unit.kept_ms, unit.watchdog_ms) = (Some(kept_ms), kept_ms);
    }
}
