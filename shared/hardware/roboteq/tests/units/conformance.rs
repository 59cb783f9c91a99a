//! The suite of every drive family, run for this one.

use drive_conformance::{BOUND, Clockwork, Family, VirtualUnits, WATCHDOG_MS};
use drives::{AXES, Command};
use roboteq::driver::UART_MARGIN_NS;
use roboteq::unit::{Controller, ControllerOptions, Measured, Target};
use roboteq::{Bus, BusConfig};
use serial::{Device, Pipe, WireQueue};

struct Roboteq;

/// The controller of one port, or none. A type of this test, because neither trait nor controller are its own.
struct Controllers(Option<Controller>);

impl Device for Controllers {
    fn receive(&mut self, now_ns: u64, byte: u8, reply: &mut WireQueue) {
        self.0.iter_mut().for_each(|controller| controller.receive(now_ns, byte, reply));
    }
    fn advance(&mut self, now_ns: u64) {
        self.0.iter_mut().for_each(|controller| controller.advance(now_ns));
    }
}

impl Controllers {
    fn controller(&mut self) -> &mut Controller {
        self.0.as_mut().unwrap()
    }

    fn change(&mut self, change: impl FnOnce(&mut Measured)) {
        let mut measured = *self.controller().measured();
        change(&mut measured);
        self.controller().measure(&measured);
    }
}

impl VirtualUnits for Controllers {
    fn measure(&mut self, _: usize, counts: [i64; AXES], currents_a: [f64; AXES]) {
        // Motor 2 is not connected.
        let currents_a = [currents_a[0], 0.0];
        self.change(|measured| (measured.counts, measured.currents_a) = (counts, currents_a));
    }
    fn drive(&self, _: usize, motor: usize) -> Command {
        match self.0.as_ref().unwrap().target(motor) {
            Target::Velocity(counts_s) => Command::Velocity(counts_s),
            Target::Duty(share) => panic!("an output of {share} without a loop"),
            Target::Released => Command::Release,
        }
    }
    fn restart(&mut self, _: usize, down_ns: u64) {
        self.controller().reboot(down_ns);
    }
    fn mute(&mut self, _: usize, muted: bool) {
        self.controller().mute_until(if muted { u64::MAX } else { 0 });
    }
    fn press_stop(&mut self, _: usize, pressed: bool) {
        self.change(|measured| measured.stopped = pressed);
    }
    fn keep_watchdog(&mut self, _: usize, kept_ms: u32) {
        self.controller().keep_watchdog(kept_ms);
    }
}

impl Family for Roboteq {
    type Units = Controllers;
    type Bus = Bus<Pipe<Clockwork<Controllers>>>;
    // The highest rate of its serial port.
    const BAUD: u32 = 115_200;
    // The suite wants the two motors of a sample from one moment. Where a byte was changed, each motor has the middle
    // one of its own answers; the tests of the driver drive both.
    const MOTORS: usize = 1;
    const UNITS: usize = 1;
    // The longest batch takes 7.2 ms.
    const ANSWER_NS: u64 = UART_MARGIN_NS + 7_500_000;
    // A change of the operating mode is a batch of its own.
    const EXCHANGES: u32 = 2;
    /// 3000 turns per minute of an encoder with 20 pulses are 4000 counts per second, in 1000 steps.
    const SPEED_STEP_COUNTS_S: f64 = 4.0;
    const SPEED_STEPS: u32 = 1000;

    fn units(count: usize) -> Controllers {
        let options = ControllerOptions { pulses: [20; 2], ..ControllerOptions::new(0) };
        Controllers((count > 0).then(|| Controller::new(options)))
    }
    fn bus(pipe: Pipe<Clockwork<Controllers>>, count: usize) -> Self::Bus {
        assert_eq!(count, 1);
        let config = BusConfig {
            baud: Self::BAUD,
            margin_ns: UART_MARGIN_NS,
            address: 0,
            axes: 1,
            watchdog_ms: WATCHDOG_MS as u16,
            bound: BOUND,
            stop_pin: None,
        };
        Bus::new(pipe, &config).unwrap()
    }
    fn pipe(bus: &mut Self::Bus) -> &mut Pipe<Clockwork<Controllers>> {
        bus.transport_mut()
    }
}

drive_conformance::conformance!(Roboteq);
