//! The suite of every drive family, run for this one.

use drive_conformance::{BOUND, Clockwork, Family, VirtualUnits, WATCHDOG_MS};
use drives::{AXES, Command};
use odrive::driver::UART_MARGIN_NS;
use odrive::unit::{Board, BoardOptions, Measured, Target};
use odrive::{Bus, BusConfig};
use serial::{Device, Pipe, WireQueue};

struct ODrive;

/// The board of one port, or none. A type of this test, because neither trait nor board are its own.
struct Boards(Option<Board>);

impl Device for Boards {
    fn receive(&mut self, now_ns: u64, byte: u8, reply: &mut WireQueue) {
        self.0.iter_mut().for_each(|board| board.receive(now_ns, byte, reply));
    }
    fn advance(&mut self, now_ns: u64) {
        self.0.iter_mut().for_each(|board| board.advance(now_ns));
    }
}

impl Boards {
    fn board(&mut self) -> &mut Board {
        self.0.as_mut().unwrap()
    }

    fn change(&mut self, change: impl FnOnce(&mut Measured)) {
        let mut measured = *self.board().measured();
        change(&mut measured);
        self.board().measure(&measured);
    }
}

impl VirtualUnits for Boards {
    fn measure(&mut self, _: usize, counts: [i64; AXES], currents_a: [f64; AXES]) {
        self.change(|measured| (measured.counts, measured.currents_a) = (counts, currents_a));
    }
    fn drive(&self, _: usize, motor: usize) -> Command {
        match self.0.as_ref().unwrap().target(motor) {
            Target::Velocity(counts_s) => Command::Velocity(counts_s),
            Target::Current(current_a) => Command::Torque(current_a),
            Target::Released => Command::Release,
        }
    }
    fn restart(&mut self, _: usize, down_ns: u64) {
        self.board().reboot(down_ns);
    }
    fn mute(&mut self, _: usize, muted: bool) {
        self.board().mute_until(if muted { u64::MAX } else { 0 });
    }
    fn press_stop(&mut self, _: usize, pressed: bool) {
        self.change(|measured| measured.stopped = pressed);
    }
    fn keep_watchdog(&mut self, _: usize, kept_ms: u32) {
        self.board().keep_watchdog(kept_ms);
    }
}

impl Family for ODrive {
    type Units = Boards;
    type Bus = Bus<Pipe<Clockwork<Boards>>>;
    const BAUD: u32 = 921_600;
    // The two axes of a board are read one after the other, so their samples are of different times; the tests of the
    // driver drive both.
    const MOTORS: usize = 1;
    const UNITS: usize = 1;
    // A batch has 200 bytes, and 250 where a velocity changes to a torque.
    const ANSWER_NS: u64 = UART_MARGIN_NS + 3_000_000;
    // An axis that was disarmed shows it, is cleared, and arms.
    const EXCHANGES: u32 = 4;
    const COUNTER_WRAPS: bool = false;

    fn units(count: usize) -> Boards {
        let options = BoardOptions { axes: 1, rounds_position: false, ..BoardOptions::new(0) };
        Boards((count > 0).then(|| Board::new(options)))
    }
    fn bus(pipe: Pipe<Clockwork<Boards>>, count: usize) -> Self::Bus {
        assert_eq!(count, 1);
        let config = BusConfig {
            baud: Self::BAUD,
            margin_ns: UART_MARGIN_NS,
            address: 0,
            axes: 1,
            watchdog_ms: WATCHDOG_MS as u16,
            bound: BOUND,
            torque_constant_n_m_a: 0.05,
            stop_pin: None,
        };
        Bus::new(pipe, &config).unwrap()
    }
    fn pipe(bus: &mut Self::Bus) -> &mut Pipe<Clockwork<Boards>> {
        bus.transport_mut()
    }
}

drive_conformance::conformance!(ODrive);
