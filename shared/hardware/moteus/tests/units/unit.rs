//! Habits of the virtual unit, as a client meets them on the wire.

use moteus::codec::{Checksums, Frame, Line, Mode, Register, Resolution, Scale, Subframe, Value, frame_line, to_unit};
use moteus::unit::{Measured, Target, Unit, UnitBus, UnitOptions};
use proptest::prelude::*;
use serial::{Device, WireQueue};

const MS: u64 = 1_000_000;

struct Client {
    bus: UnitBus,
    now_ns: u64,
}

impl Client {
    fn new(checksums: Checksums) -> Client {
        let units = [1, 2].map(|address| Unit::new(UnitOptions::new(address)));
        Client { bus: UnitBus::new(units.to_vec(), checksums), now_ns: 0 }
    }

    /// Sends bytes and returns the lines that come back.
    fn send(&mut self, bytes: &[u8]) -> Vec<String> {
        let mut wire = WireQueue::new(0);
        for &byte in bytes {
            self.bus.receive(self.now_ns, byte, &mut wire);
        }
        let said: Vec<u8> = std::iter::from_fn(|| wire.pop(u64::MAX).map(|(_, byte)| byte)).collect();
        String::from_utf8(said).unwrap().lines().map(str::to_owned).collect()
    }

    fn ask(&mut self, frame: &Frame) -> Vec<Subframe> {
        let mut line = frame_line("can send", to_unit(1), frame, "BF", Checksums::Required);
        line.push(b'\n');
        let said = self.send(&line);
        assert_eq!(said[0], "OK *BD");
        match Line::parse(said[1].as_bytes(), Checksums::Required).unwrap() {
            Line::Received { identifier: 0x100, frame } => frame.subframes().map(Result::unwrap).collect(),
            other => panic!("{other:?}"),
        }
    }

    fn read(&mut self, register: u16, resolution: Resolution) -> Value {
        let mut frame = Frame::new();
        frame.read(register, resolution);
        match self.ask(&frame)[..] {
            [Subframe::Reply { register: answered, value }] if answered == register => value,
            ref other => panic!("{other:?}"),
        }
    }

    fn mode(&mut self) -> Mode {
        Mode(self.read(Register::MODE, Resolution::I8).integer().unwrap() as i8)
    }

    fn command(&mut self, mode: Mode, velocity: i32, timeout_ms: i16) -> Mode {
        let mut frame = Frame::new();
        frame.write(Register::MODE, Value::I8(mode.0));
        if mode == Mode::POSITION {
            frame.write(Register::COMMAND_POSITION, Value::I32(i32::MIN));
            frame.write(Register::COMMAND_VELOCITY, Value::I32(velocity));
        }
        frame.write(Register::COMMAND_TIMEOUT, Value::I16(timeout_ms));
        frame.read(Register::MODE, Resolution::I8);
        match self.ask(&frame)[..] {
            [Subframe::Reply { value, .. }] => Mode(value.integer().unwrap() as i8),
            ref other => panic!("{other:?}"),
        }
    }

    fn wait(&mut self, ms: u64) {
        self.now_ns += ms * MS;
        self.bus.advance(self.now_ns);
    }

    fn target(&self) -> Target {
        self.bus.units()[0].target()
    }
}

#[test]
fn a_timeout_brakes_and_only_a_stop_ends_it() {
    let mut client = Client::new(Checksums::Required);
    assert_eq!(client.command(Mode::POSITION, 125_000, 300), Mode::STOPPED, "the answer has the mode of before");
    assert_eq!((client.mode(), client.target()), (Mode::POSITION, Target::Velocity(125_000.0)));
    client.wait(299);
    // Questions do not feed the watchdog.
    assert_eq!(client.mode(), Mode::POSITION);
    client.wait(2);
    assert_eq!((client.mode(), client.target()), (Mode::TIMEOUT, Target::Velocity(0.0)));
    client.command(Mode::POSITION, 5000, 300);
    assert_eq!((client.mode(), client.target()), (Mode::TIMEOUT, Target::Velocity(0.0)));
    client.command(Mode::STOPPED, 0, 300);
    assert_eq!((client.mode(), client.target()), (Mode::STOPPED, Target::Released));
    client.wait(1000);
    assert_eq!(client.mode(), Mode::STOPPED, "a stopped unit has no watchdog");
    client.command(Mode::POSITION, 5000, 0);
    client.wait(101);
    assert_eq!(client.mode(), Mode::TIMEOUT, "0 is the default of 0.1 s");
    assert_eq!(client.bus.units()[0].watchdog_trips(), 2);
}

#[test]
fn writing_the_mode_resets_the_rest_of_the_command() {
    let mut client = Client::new(Checksums::Required);
    client.command(Mode::POSITION, 100_000, 300);
    assert_eq!(client.read(Register::COMMAND_TIMEOUT, Resolution::I16), Value::I16(300));
    let mut frame = Frame::new();
    frame.write(Register::MODE, Value::I8(Mode::POSITION.0));
    frame.read(Register::COMMAND_TIMEOUT, Resolution::I16);
    frame.read(Register::COMMAND_VELOCITY, Resolution::I32);
    let zero = |register, value| Subframe::Reply { register, value };
    assert_eq!(
        client.ask(&frame),
        [zero(Register::COMMAND_TIMEOUT, Value::I16(0)), zero(Register::COMMAND_VELOCITY, Value::I32(0))]
    );
}

#[test]
fn a_fault_is_latched_until_a_stop() {
    let mut client = Client::new(Checksums::Required);
    client.command(Mode::POSITION, 1000, 300);
    client.bus.units_mut()[0].fail(33);
    assert_eq!((client.mode(), client.target()), (Mode::FAULT, Target::Released));
    assert_eq!(client.read(Register::FAULT, Resolution::I8), Value::I8(33));
    client.command(Mode::POSITION, 1000, 300);
    assert_eq!(client.mode(), Mode::FAULT);
    client.command(Mode::STOPPED, 0, 300);
    client.command(Mode::POSITION, 1000, 300);
    assert_eq!((client.mode(), client.read(Register::FAULT, Resolution::I8)), (Mode::POSITION, Value::I8(0)));
    let low = Measured { supply_v: 5.0, ..Measured::default() };
    client.bus.measure(0, &low);
    assert_eq!((client.mode(), client.read(Register::FAULT, Resolution::I8)), (Mode::FAULT, Value::I8(40)));
}

#[test]
fn a_restart_begins_within_half_a_turn_with_a_new_clock() {
    let mut client = Client::new(Checksums::Required);
    client.wait(5000);
    client.bus.measure(0, &Measured { counts: 1_234_567, ..Measured::default() });
    assert_eq!(client.read(Register::MILLISECONDS, Resolution::I32), Value::I32(5000));
    assert_eq!(client.read(Register::MILLISECONDS, Resolution::I8), Value::I8(5000_i32 as i8), "the counter wraps");
    assert_eq!(client.read(Register::POSITION, Resolution::I32), Value::I32(1_234_567));
    client.bus.units_mut()[0].reboot(100 * MS);
    assert_eq!(client.send(b"can send 8001 1970 BF *AD\n"), ["OK *BD"], "without supply");
    client.wait(107);
    assert_eq!(client.read(Register::MILLISECONDS, Resolution::I32), Value::I32(7));
    assert_eq!(client.read(Register::POSITION, Resolution::I32), Value::I32(34_567));
    assert_eq!(client.read(Register::COMMAND_TIMEOUT, Resolution::I16), Value::I16(0));
}

#[test]
fn after_one_checksum_every_line_needs_one() {
    let mut client = Client::new(Checksums::Required);
    let said = client.send(b"can send 8001 1970 BF\n");
    assert!(said.len() == 2 && said[1].starts_with("rcv 0100 2970"), "{said:?}");
    assert_eq!(client.send(b"can send 8001 1970 BF *AD\n").len(), 2);
    for refused in [&b"can send 8001 1970 BF\n"[..], b"can send 8001 1970 BF *AE\n"] {
        let said = client.send(refused);
        assert!(said.len() == 1 && said[0].starts_with("ERR checksum"), "{said:?}");
    }
    assert_eq!(client.bus.refused(), 2);
    // Behind a USB adapter there are none.
    let mut client = Client::new(Checksums::Absent);
    let said = client.send(b"can send 8002 1970 BF\r\n\r\n");
    assert_eq!(said, ["OK", "rcv 0200 297000000000 E B F"], "lines may end twice, and nothing has to be filled up");
    assert_eq!(client.send(b"hello\n"), ["ERR unknown command"]);
    assert_eq!(client.send(b"can send 8003 1970 BF\n"), ["OK"], "no unit has this identifier");
    assert_eq!(client.send(b"can send 0001 01000A BF\n"), ["OK"], "no answer was asked for");
    assert_eq!(client.send(&[b'x'; 300]).len() + client.send(b"\n").len(), 1);
}

#[test]
fn unknown_registers_are_reported() {
    let mut client = Client::new(Checksums::Required);
    let mut frame = Frame::new();
    frame.write(Register::POSITION, Value::I8(3));
    frame.write(0x3FF, Value::I8(3));
    frame.read(0x3FF, Resolution::I8);
    frame.read(Register::FIRMWARE, Resolution::I32);
    let error = |register, code| Subframe::Error { register, code };
    let firmware = Subframe::Reply { register: Register::FIRMWARE, value: Value::I32(0x01_0C_00) };
    assert_eq!(client.ask(&frame), [error(Register::POSITION, 2), error(0x3FF, 1), error(0x3FF, 1), firmware]);
}

#[test]
fn a_position_ends_instead_of_wrapping() {
    let mut client = Client::new(Checksums::Required);
    for (counts, shown) in [(3_000_000_000, i32::MAX), (-3_000_000_000, -i32::MAX)] {
        client.bus.measure(0, &Measured { counts, ..Measured::default() });
        assert_eq!(client.read(Register::POSITION, Resolution::I32), Value::I32(shown));
    }
    // Far from zero the float of 24 bits has coarser steps.
    client.bus.measure(0, &Measured { counts: 123_456_789, ..Measured::default() });
    let shown = client.read(Register::POSITION, Resolution::I32).integer().unwrap();
    assert!((shown - 123_456_789).abs() <= 16 && Scale::POSITION.decode(Value::I32(shown)) > 1234.0, "{shown}");
}

proptest! {
    #[test]
    fn no_bytes_move_a_motor_or_end_the_program(bytes in prop::collection::vec(any::<u8>(), 0..400)) {
        let mut client = Client::new(Checksums::Required);
        let mut wire = WireQueue::new(0);
        bytes.iter().for_each(|&byte| client.bus.receive(0, byte, &mut wire));
        prop_assert_eq!(client.target(), Target::Released);
    }
}
