//! Commands that a unit executes, and its answers.

use super::axis::{Goal, Move};
use super::settings::{FULL_DUTY, Registers};
use super::{Unit, register};
use crate::codec::{ACK, Fields, Motor, Read, Reply, SAVE_KEY, Write, with_reply_crc};
use crate::packet::Packet;

/// Resolution of a raw speed, counts per second: the speed loop of a unit counts over 1/300 s.
const RAW_SPEED_STEP: f64 = 300.0;

/// Bytes after a command's number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Form {
    /// Nothing: a question.
    Question,
    /// A payload of this length and a checksum.
    Order(usize),
}

/// Form of a command; `None` for an unknown one.
pub(super) fn form(code: u8) -> Option<Form> {
    Some(match code {
        0 | 1 | 4..=7 => Form::Order(1),
        14 => Form::Order(1),
        20 => Form::Order(0),
        22 | 23 | 35 | 36 | 80 | 94 => Form::Order(4),
        28 | 29 | 50 => Form::Order(16),
        32 | 33 => Form::Order(2),
        34 => Form::Order(4),
        37..=39 => Form::Order(8),
        40 => Form::Order(12),
        41 | 42 => Form::Order(9),
        43 => Form::Order(17),
        44 | 45 => Form::Order(13),
        46 => Form::Order(21),
        51 => Form::Order(25),
        52 | 53 => Form::Order(6),
        54 => Form::Order(12),
        65 | 66 => Form::Order(17),
        67 => Form::Order(33),
        119 | 120 => Form::Order(5),
        121 => Form::Order(9),
        122 | 123 => Form::Order(9),
        124 => Form::Order(17),
        125 | 126 => Form::Order(3),
        127 => Form::Order(5),
        133 | 134 => Form::Order(8),
        47 | 73 | 83 | 100 | 101 => Form::Question,
        code if Read::from_code(code).is_some() || Registers::answers(code) => Form::Question,
        code => Form::Order(Registers::payload_of(code)?),
    })
}

impl Unit {
    /// Executes a command and returns the answer; `None` for an invalid one.
    pub(super) fn answer(&mut self, code: u8, payload: &[u8]) -> Option<Packet> {
        let address = self.options.address;
        match form(code)? {
            Form::Question => {
                if let Some(read) = Read::from_code(code) {
                    return Some(self.reply(read).encode(address, code));
                }
                let mut packet = Packet::new();
                match code {
                    47 => packet.extend(&self.axes.each_ref().map(|axis| match axis.waiting() {
                        Some(waiting) => waiting as u8,
                        // No move is active.
                        None => 0x80,
                    })),
                    73 => self.reply_all_readings(&mut packet),
                    83 => packet.extend(&tenths(self.measured.temperature_c).to_be_bytes()),
                    100 => {
                        packet.extend(&tenths(self.measured.supply_v).to_be_bytes());
                        packet.extend(&tenths(self.measured.logic_v).to_be_bytes());
                    }
                    101 => {
                        for _ in 0..2 {
                            packet.extend(&tenths(self.measured.temperature_c).to_be_bytes());
                        }
                    }
                    _ => packet.extend(self.registers.read(code)?),
                }
                Some(with_reply_crc(packet, address, code))
            }
            Form::Order(_) => {
                let done = if let Some(write) = Write::decode(code, payload) {
                    self.execute(write);
                    true
                } else {
                    let done = self.registers.write(code, payload) || self.move_on(code, payload).is_some();
                    self.commands += u64::from(done);
                    done
                };
                done.then(|| {
                    let mut ack = Packet::new();
                    ack.extend(&[ACK]);
                    ack
                })
            }
        }
    }

    fn reply(&mut self, read: Read) -> Reply {
        let pid = |motor: usize| Reply::VelocityPid(self.settings.velocity_pids[motor]);
        let speed = |motor: usize| saturated(self.measured.speeds_counts_s[motor]);
        let raw =
            |motor: usize| saturated((self.measured.speeds_counts_s[motor] / RAW_SPEED_STEP).round() * RAW_SPEED_STEP);
        match read {
            Read::Watchdog => Reply::Watchdog(self.settings.watchdog_tenths),
            Read::Encoder1 => self.reply_count(0),
            Read::Encoder2 => self.reply_count(1),
            Read::Speed1 => Reply::Speed(speed(0)),
            Read::Speed2 => Reply::Speed(speed(1)),
            Read::RawSpeed1 => Reply::Speed(raw(0)),
            Read::RawSpeed2 => Reply::Speed(raw(1)),
            Read::RawSpeeds => Reply::Speeds([raw(0), raw(1)]),
            Read::Speeds => Reply::Speeds([speed(0), speed(1)]),
            Read::Version => Reply::Version(self.options.version),
            Read::MainBattery => Reply::Battery(tenths(self.measured.supply_v).unsigned_abs()),
            Read::LogicBattery => Reply::Battery(tenths(self.measured.logic_v).unsigned_abs()),
            Read::Pwms => Reply::Pwms(self.measured.duties.map(|duty| scaled(duty, FULL_DUTY))),
            Read::Currents => Reply::Currents(self.measured.currents_a.map(|current| scaled(current, 100.0))),
            Read::VelocityPid1 => pid(0),
            Read::VelocityPid2 => pid(1),
            Read::Encoders => Reply::Counts([0, 1].map(|motor| self.count(motor) as u32)),
            Read::Temperature => Reply::Temperature(tenths(self.measured.temperature_c)),
            Read::Status => Reply::Status(self.measured.status, self.options.width),
            Read::MaxCurrent1 => Reply::MaxCurrent(self.settings.max_centiamps[0]),
            Read::MaxCurrent2 => Reply::MaxCurrent(self.settings.max_centiamps[1]),
        }
    }

    fn reply_count(&mut self, motor: usize) -> Reply {
        let backward = u8::from(self.measured.speeds_counts_s[motor] < 0.0) << 1;
        Reply::Count(self.count(motor) as u32, std::mem::take(&mut self.wrapped[motor]) | backward)
    }

    /// Answer to 73: every reading at once.
    fn reply_all_readings(&self, packet: &mut Packet) {
        let measured = &self.measured;
        packet.extend(&((self.now_ns / 1_000_000) as u32).to_be_bytes());
        packet.extend(&measured.status.0.to_be_bytes());
        let words = [
            tenths(measured.temperature_c),
            tenths(measured.temperature_c),
            tenths(measured.supply_v),
            tenths(measured.logic_v),
            scaled(measured.duties[0], FULL_DUTY),
            scaled(measured.duties[1], FULL_DUTY),
            scaled(measured.currents_a[0], 100.0),
            scaled(measured.currents_a[1], 100.0),
        ];
        words.iter().for_each(|word| packet.extend(&word.to_be_bytes()));
        for motor in 0..2 {
            packet.extend(&(self.count(motor) as u32).to_be_bytes());
        }
        for axis in &self.axes {
            let set = match axis.target() {
                super::Target::Speed(speed) => saturated(speed),
                super::Target::Duty(_) => 0,
            };
            packet.extend(&set.to_be_bytes());
        }
        for speed in measured.speeds_counts_s {
            packet.extend(&saturated(speed).to_be_bytes());
        }
        packet.extend(&[0; 8]);
    }

    /// Executes commands that only the vendor's client sends: old-style duty, duty with a ramp, distances, positions.
    fn move_on(&mut self, code: u8, payload: &[u8]) -> Option<()> {
        use Motor::{One, Two};
        let mut fields = Fields(payload);
        match code {
            0 | 1 | 4 | 5 => {
                let duty = f64::from(fields.u8()?.min(127)) / 127.0;
                let motor = if code < 4 { One } else { Two };
                self.axes[motor.index()].set_duty(if code & 1 == 0 { duty } else { -duty }, 0.0);
            }
            6 | 7 => {
                let duty = (f64::from(fields.u8()?.min(127)) - 64.0) / 63.0;
                self.axes[usize::from(code - 6)].set_duty(duty, 0.0);
            }
            41 | 42 => self.add_distance(code - 41, false, &mut fields)?,
            44 | 45 => self.add_distance(code - 44, true, &mut fields)?,
            43 => {
                let moves = [distance(0.0, &mut fields)?, distance(0.0, &mut fields)?];
                self.add_both(moves, fields.u8()?)?;
            }
            46 => {
                let ramp = f64::from(fields.u32()?);
                let moves = [distance(ramp, &mut fields)?, distance(ramp, &mut fields)?];
                self.add_both(moves, fields.u8()?)?;
            }
            51 => {
                let mut one = || {
                    let ramp = f64::from(fields.u32()?);
                    distance(ramp, &mut fields)
                };
                let moves = [one()?, one()?];
                self.add_both(moves, fields.u8()?)?;
            }
            52 | 53 => {
                let (duty, ramp) = (duty(&mut fields)?, f64::from(fields.u32()?) / FULL_DUTY);
                self.axes[usize::from(code - 52)].set_duty(duty, ramp);
            }
            54 => {
                for axis in &mut self.axes {
                    let (duty, ramp) = (duty(&mut fields)?, f64::from(fields.u32()?) / FULL_DUTY);
                    axis.set_duty(duty, ramp);
                }
            }
            65 | 66 => {
                let made = position(&mut fields)?;
                self.add(usize::from(code - 65), made, fields.u8()?)?;
            }
            67 => {
                let moves = [position(&mut fields)?, position(&mut fields)?];
                self.add_both(moves, fields.u8()?)?;
            }
            119..=124 => self.go_to_counts(code, &mut fields)?,
            // Percent of a range that this unit does not have.
            125..=127 => {}
            80 => {
                if fields.u32()? != SAVE_KEY {
                    return None;
                }
                self.settings = super::Settings::new(self.options.watchdog_tenths);
                self.registers = Registers::new();
            }
            _ => return None,
        }
        Some(())
    }

    /// Executes the moves to absolute counts, with the default speed or with a given one.
    fn go_to_counts(&mut self, code: u8, fields: &mut Fields<'_>) -> Option<()> {
        match code {
            119 | 120 => {
                let made = self.go_to(usize::from(code - 119), None, fields.i32()?);
                self.add(usize::from(code - 119), made, fields.u8()?)?;
            }
            121 => {
                let moves = [self.go_to(0, None, fields.i32()?), self.go_to(1, None, fields.i32()?)];
                self.add_both(moves, fields.u8()?)?;
            }
            122 | 123 => {
                let motor = usize::from(code - 122);
                let (speed, count) = (fields.u32()?, fields.i32()?);
                let made = self.go_to(motor, Some(speed), count);
                self.add(motor, made, fields.u8()?)?;
            }
            124 => {
                let mut one = |motor| Some(self.go_to(motor, Some(fields.u32()?), fields.i32()?));
                let moves = [one(0)?, one(1)?];
                self.add_both(moves, fields.u8()?)?;
            }
            _ => return None,
        }
        Some(())
    }

    fn add_distance(&mut self, motor: u8, with_ramp: bool, fields: &mut Fields<'_>) -> Option<()> {
        let ramp = if with_ramp { f64::from(fields.u32()?) } else { 0.0 };
        let made = distance(ramp, fields)?;
        self.add(usize::from(motor), made, fields.u8()?)
    }

    fn add_both(&mut self, moves: [Move; 2], at_once: u8) -> Option<()> {
        for (motor, made) in moves.into_iter().enumerate() {
            self.add(motor, made, at_once)?;
        }
        Some(())
    }

    fn add(&mut self, motor: usize, made: Move, at_once: u8) -> Option<()> {
        let axis = self.axes.get_mut(motor)?;
        let taken = axis.add_move(made, at_once != 0);
        // The buffer's state is then right without time passing.
        axis.advance(0.0, register(self.measured.counts, self.zero, motor));
        taken.then_some(())
    }

    fn go_to(&self, motor: usize, speed: Option<u32>, count: i32) -> Move {
        let fastest = self.settings.velocity_pids[motor].counts_s_at_full_duty;
        let speed = f64::from(speed.unwrap_or(fastest));
        Move { ramp: 0.0, end_ramp: 0.0, speed, goal: Goal::Position(f64::from(count)) }
    }
}

fn duty(fields: &mut Fields<'_>) -> Option<f64> {
    Some(f64::from(fields.i16()?) / FULL_DUTY)
}

fn distance(ramp: f64, fields: &mut Fields<'_>) -> Option<Move> {
    let (speed, distance) = (f64::from(fields.i32()?), f64::from(fields.u32()?));
    Some(Move { ramp, end_ramp: ramp, speed, goal: Goal::Distance(distance) })
}

fn position(fields: &mut Fields<'_>) -> Option<Move> {
    let (ramp, speed, end_ramp) = (f64::from(fields.u32()?), f64::from(fields.u32()?), f64::from(fields.u32()?));
    Some(Move { ramp, end_ramp, speed, goal: Goal::Position(f64::from(fields.i32()?)) })
}

/// Tenths of a volt or degree on the wire.
fn tenths(value: f64) -> i16 {
    scaled(value, 10.0)
}

/// Scales and rounds; the conversion saturates, and a NaN becomes 0.
fn scaled(value: f64, scale: f64) -> i16 {
    (value * scale).round() as i16
}

fn saturated(value: f64) -> i32 {
    value.round() as i32
}
