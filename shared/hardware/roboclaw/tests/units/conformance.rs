//! The suite of every drive family, run for this one.

use drive_conformance::{BOUND, Clockwork, Family, VirtualUnits, WATCHDOG_MS};
use drives::{AXES, Command};
use roboclaw::codec::Motor;
use roboclaw::driver::WIRE_MARGIN_NS;
use roboclaw::unit::{Measured, Target, Unit, UnitBus, UnitOptions};
use roboclaw::{Bus, BusConfig, Status, UnitConfig};
use serial::{Device, Pipe, WireQueue};

struct RoboClaw;

/// The units of one bus. A type of this test, because neither trait nor units are its own.
struct Units(UnitBus);

fn address(unit: usize) -> u8 {
    0x80 + unit as u8
}

impl Device for Units {
    fn receive(&mut self, now_ns: u64, byte: u8, reply: &mut WireQueue) {
        self.0.receive(now_ns, byte, reply);
    }
    fn advance(&mut self, now_ns: u64) {
        self.0.advance(now_ns);
    }
}

impl VirtualUnits for Units {
    fn measure(&mut self, unit: usize, counts: [i64; AXES], currents_a: [f64; AXES]) {
        let unit = &mut self.0.units_mut()[unit];
        let measured = Measured { counts, currents_a, ..*unit.measured() };
        unit.measure(&measured);
    }
    fn drive(&self, unit: usize, motor: usize) -> Command {
        match self.0.units()[unit].target([Motor::One, Motor::Two][motor]) {
            Target::Speed(counts_s) => Command::Velocity(counts_s),
            Target::Duty(0.0) => Command::Release,
            Target::Duty(duty) => panic!("unit {unit} drives motor {motor} without its loop, duty {duty}"),
        }
    }
    fn restart(&mut self, unit: usize, down_ns: u64) {
        self.0.units_mut()[unit].reboot(down_ns);
    }
    fn mute(&mut self, unit: usize, muted: bool) {
        self.0.units_mut()[unit].mute_until(if muted { u64::MAX } else { 0 });
    }
    fn press_stop(&mut self, unit: usize, pressed: bool) {
        let unit = &mut self.0.units_mut()[unit];
        let status = Status(if pressed { Status::EMERGENCY_STOP } else { 0 });
        let measured = Measured { status, ..*unit.measured() };
        unit.measure(&measured);
    }
    fn keep_watchdog(&mut self, unit: usize, kept_ms: u32) {
        self.0.units_mut()[unit].keep_watchdog((kept_ms / 100) as u8);
    }
}

impl Family for RoboClaw {
    type Units = Units;
    type Bus = Bus<Pipe<Clockwork<Units>>>;
    const BAUD: u32 = 230_400;
    const MOTORS: usize = 2;
    // The longest exchange, the version text of the setup, has 52 bytes: 2.3 ms.
    const ANSWER_NS: u64 = WIRE_MARGIN_NS + 2_500_000;
    const EXCHANGES: u32 = 2;

    fn units(count: usize) -> Units {
        Units(UnitBus::new((0..count).map(|unit| Unit::new(UnitOptions::new(address(unit)))).collect()))
    }
    fn bus(pipe: Pipe<Clockwork<Units>>, count: usize) -> Self::Bus {
        let watchdog_tenths = (WATCHDOG_MS / 100) as u8;
        let unit = |unit| UnitConfig { address: address(unit), watchdog_tenths, bound: BOUND };
        let units = (0..count).map(unit).collect();
        let config = BusConfig { baud: Self::BAUD, margin_ns: WIRE_MARGIN_NS, units, stop_pin: None };
        Bus::new(pipe, &config).unwrap()
    }
    fn pipe(bus: &mut Self::Bus) -> &mut Pipe<Clockwork<Units>> {
        bus.transport_mut()
    }
}

/// The same in a thread that has other work.
struct Inline;

impl Family for Inline {
    type Units = Units;
    type Bus = Bus<Pipe<Clockwork<Units>>>;
    const BAUD: u32 = RoboClaw::BAUD;
    const MOTORS: usize = RoboClaw::MOTORS;
    const ANSWER_NS: u64 = RoboClaw::ANSWER_NS;
    const EXCHANGES: u32 = RoboClaw::EXCHANGES;
    const INLINE: bool = true;

    fn units(count: usize) -> Units {
        RoboClaw::units(count)
    }
    fn bus(pipe: Pipe<Clockwork<Units>>, count: usize) -> Self::Bus {
        RoboClaw::bus(pipe, count)
    }
    fn pipe(bus: &mut Self::Bus) -> &mut Pipe<Clockwork<Units>> {
        RoboClaw::pipe(bus)
    }
}

drive_conformance::conformance!(RoboClaw);

mod inline {
    drive_conformance::conformance!(super::Inline);
}
