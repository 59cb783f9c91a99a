//! The suite of every drive family, run for this one.

use std::marker::PhantomData;

use drive_conformance::{BOUND, Clockwork, Family, VirtualUnits, WATCHDOG_MS};
use drives::{AXES, Command};
use moteus::codec::Checksums;
use moteus::driver::{UART_MARGIN_NS, USB_MARGIN_NS};
use moteus::unit::{Measured, Target, Unit, UnitBus, UnitOptions};
use moteus::{Bus, BusConfig, SecondInput, UnitConfig};
use serial::{Device, Pipe, WireQueue};

/// The units of one bus. A type of this test, because neither trait nor units are its own.
struct Units(UnitBus);

fn address(unit: usize) -> u8 {
    1 + unit as u8
}

impl Device for Units {
    fn receive(&mut self, now_ns: u64, byte: u8, reply: &mut WireQueue) {
        self.0.receive(now_ns, byte, reply);
    }
    fn advance(&mut self, now_ns: u64) {
        self.0.advance(now_ns);
    }
}

impl Units {
    fn change(&mut self, unit: usize, change: impl FnOnce(&mut Measured)) {
        let unit = &mut self.0.units_mut()[unit];
        let mut measured = *unit.measured();
        change(&mut measured);
        unit.measure(&measured);
    }
}

impl VirtualUnits for Units {
    fn measure(&mut self, unit: usize, counts: [i64; AXES], currents_a: [f64; AXES]) {
        self.change(unit, |measured| (measured.counts, measured.current_a) = (counts[0], currents_a[0]));
    }
    fn measure_second(&mut self, unit: usize, counts: i64) {
        self.change(unit, |measured| measured.second_counts = counts);
    }
    fn drive(&self, unit: usize, _: usize) -> Command {
        match self.0.units()[unit].target() {
            Target::Velocity(counts_s) => Command::Velocity(counts_s),
            Target::Current(current_a) => Command::Torque(current_a),
            Target::Released => Command::Release,
        }
    }
    fn restart(&mut self, unit: usize, down_ns: u64) {
        self.0.units_mut()[unit].reboot(down_ns);
    }
    fn mute(&mut self, unit: usize, muted: bool) {
        self.0.units_mut()[unit].mute_until(if muted { u64::MAX } else { 0 });
    }
    fn press_stop(&mut self, unit: usize, pressed: bool) {
        self.change(unit, |measured| measured.pins = i8::from(pressed));
    }
    fn keep_watchdog(&mut self, unit: usize, kept_ms: u32) {
        self.0.units_mut()[unit].keep_watchdog(kept_ms);
    }
}

/// Wires of the family.
trait Wire {
    const BAUD: u32;
    const MARGIN_NS: u64;
    const CHECKSUMS: Checksums;
    /// The units have a second encoder.
    const SECOND: bool = true;
}

/// Two units on one UART exist only here: the suite has two, and only a UART's lines have checksums.
struct Uart;

/// The same, with second encoders.
struct UartOfTwo;

/// A USB adapter, whose packets have checksums of their own, and its lines none.
struct Adapter;

impl Wire for Uart {
    const BAUD: u32 = 921_600;
    const MARGIN_NS: u64 = UART_MARGIN_NS;
    const CHECKSUMS: Checksums = Checksums::Required;
    const SECOND: bool = false;
}

impl Wire for UartOfTwo {
    const BAUD: u32 = Uart::BAUD;
    const MARGIN_NS: u64 = UART_MARGIN_NS;
    const CHECKSUMS: Checksums = Checksums::Required;
}

impl Wire for Adapter {
    const BAUD: u32 = 0;
    const MARGIN_NS: u64 = USB_MARGIN_NS;
    const CHECKSUMS: Checksums = Checksums::Absent;
}

struct Moteus<W>(PhantomData<W>);

impl<W: Wire> Family for Moteus<W> {
    type Units = Units;
    type Bus = Bus<Pipe<Clockwork<Units>>>;
    const BAUD: u32 = W::BAUD;
    const MOTORS: usize = 1;
    // Frames and answers of two units have 340 bytes.
    const ANSWER_NS: u64 = W::MARGIN_NS + 4_000_000;
    // A unit in fault is commanded, stopped and commanded again.
    const EXCHANGES: u32 = 3;
    const COUNTER_WRAPS: bool = false;
    const SECOND: bool = W::SECOND;
    const SECOND_STEP: i64 = 10;

    fn units(count: usize) -> Units {
        let options = |unit| UnitOptions { rounds_position: false, ..UnitOptions::new(address(unit)) };
        let units = (0..count).map(|unit| Unit::new(options(unit))).collect();
        Units(UnitBus::new(units, W::CHECKSUMS))
    }
    fn bus(pipe: Pipe<Clockwork<Units>>, count: usize) -> Self::Bus {
        let unit = |unit| UnitConfig {
            address: address(unit),
            watchdog_ms: WATCHDOG_MS as u16,
            bound: BOUND,
            torque_constant_n_m_a: 0.05,
            second: W::SECOND.then_some(SecondInput { source: 1, bound: BOUND }),
        };
        let config = BusConfig {
            baud: W::BAUD,
            margin_ns: W::MARGIN_NS,
            checksums: W::CHECKSUMS,
            units: (0..count).map(unit).collect(),
            stop_pin: None,
        };
        Bus::new(pipe, &config).unwrap()
    }
    fn pipe(bus: &mut Self::Bus) -> &mut Pipe<Clockwork<Units>> {
        bus.transport_mut()
    }
}

mod uart {
    drive_conformance::conformance!(super::Moteus<super::Uart>);
}

mod uart_of_two {
    drive_conformance::conformance!(super::Moteus<super::UartOfTwo>);
}

mod adapter {
    drive_conformance::conformance!(super::Moteus<super::Adapter>, in packets);
}
