//! Habits of the virtual board, as a client meets them on the wire, and the driver of a board with two axes.

use drives::{Command, CountBound, DriveBus, DriveStatus};
use odrive::codec::error;
use odrive::unit::{Board, BoardOptions, Measured, Target};
use odrive::{Bus, BusConfig};
use proptest::prelude::*;
use serial::{Device, Pipe, Transport, WireQueue};

const MS: u64 = 1_000_000;

struct Client {
    board: Board,
    now_ns: u64,
}

impl Client {
    fn new() -> Client {
        Client { board: Board::new(BoardOptions::new(0)), now_ns: 0 }
    }

    /// Sends text and returns the lines that come back.
    fn send(&mut self, text: &str) -> Vec<String> {
        let mut wire = WireQueue::new(0);
        text.bytes().for_each(|byte| self.board.receive(self.now_ns, byte, &mut wire));
        let said: Vec<u8> = std::iter::from_fn(|| wire.pop(u64::MAX).map(|(_, byte)| byte)).collect();
        String::from_utf8(said).unwrap().lines().map(str::to_owned).collect()
    }

    fn wait(&mut self, ms: u64) {
        self.now_ns += ms * MS;
        self.board.advance(self.now_ns);
    }
}

#[test]
fn lines_are_answered_as_the_firmwares_source_says() {
    let mut client = Client::new();
    client.board.measure(&Measured { counts: [125_000, 0], speeds_counts_s: [50_000.0, 0.0], ..Measured::default() });
    for (sent, answer) in [
        ("f 0\n", &["1.250000 0.500000"][..]),
        ("f 0*118\n", &["1.250000 0.500000*35"]),
        ("f 9\n", &["invalid motor 9"]),
        ("r vbus_voltage\n", &["24.000000"]),
        ("r vbus_voltage *12\n", &[]),
        ("r blahblah\n", &["invalid property"]),
        ("v 0 1.5*108\n", &[]),
        ("v 0 1.5\n", &[]),
        ("w axis0.requested_state 8\n", &[]),
        ("u 0\nsc\n", &[]),
        ("\n", &["unknown command"]),
        ("f 0\r\n", &["1.250000 0.500000", "unknown command"]),
        ("f 0!", &["1.250000 0.500000"]),
        ("r axis0.requested_state\n", &["0"]),
        ("r axis0.current_state\n", &["8"]),
        ("r axis0.controller.input_vel\n", &["1.500000"]),
    ] {
        assert_eq!(client.send(sent), answer, "{sent:?}");
    }
    assert_eq!(client.board.refused(), 1);
}

#[test]
fn a_property_has_nine_characters() {
    let mut client = Client::new();
    client.board.measure(&Measured { counts: [-21_474_836_480, 0], ..Measured::default() });
    assert_eq!(client.send("r axis0.encoder.pos_estimate\n"), ["-214748.3"]);
    assert_eq!(client.send("f 0\n"), ["-214748.359375 0.000000"], "a float of 24 bits");
}

#[test]
fn the_watchdog_releases_and_questions_do_not_feed_it() {
    let mut client = Client::new();
    client.send("w axis0.config.watchdog_timeout 0.3\nw axis0.config.enable_watchdog 1\n");
    client.send("v 0 1.5\nw axis0.requested_state 8\n");
    assert_eq!(client.board.target(0), Target::Velocity(150_000.0));
    client.wait(290);
    client.send("f 0\nr axis0.error\nw axis0.config.enable_watchdog 1\nv 0 2\n");
    client.wait(290);
    assert_eq!(client.board.target(0), Target::Velocity(200_000.0), "a velocity feeds it");
    assert_eq!(client.send("f 0\n").len(), 1);
    client.wait(11);
    assert_eq!((client.board.target(0), client.board.watchdog_trips()), (Target::Released, 1));
    assert_eq!(client.send("r axis0.error\nv 0 1\nw axis0.requested_state 8\nr axis0.current_state\n"), ["2048", "1"]);
    assert_eq!(client.send("v 0 1\nsc\nw axis0.requested_state 8\nr axis0.current_state\n"), ["8"]);
    client.board.reboot(0);
    assert_eq!(client.send("r axis0.config.enable_watchdog\nr axis0.current_state\n"), ["0", "1"]);
}

const CONFIG: BusConfig = BusConfig {
    baud: 921_600,
    margin_ns: odrive::driver::UART_MARGIN_NS,
    address: 3,
    axes: 2,
    watchdog_ms: 300,
    bound: CountBound { counts_s: 3_000_000.0, margin: 0.0 },
    torque_constant_n_m_a: 0.05,
    stop_pin: None,
};

/// A driver in step with a board of two axes, commanded to hold.
fn robot() -> Bus<Pipe<Board>> {
    let pipe = Pipe::new("port", CONFIG.baud, Board::new(BoardOptions::new(3)));
    let mut bus = Bus::new(pipe, &CONFIG).unwrap();
    while bus.settle(bus.now_ns() + 5 * MS).is_err() {
        assert!(bus.now_ns() < 1000 * MS, "not set up");
    }
    cycle(&mut bus, [Command::HOLD; 2]).unwrap();
    bus
}

fn cycle(bus: &mut Bus<Pipe<Board>>, commands: [Command; 2]) -> Result<(), drives::Error> {
    let mut answers = bus.blank_answers();
    let start_ns = bus.now_ns().next_multiple_of(10 * MS);
    bus.transport_mut().wait_until(start_ns);
    bus.exchange(&[commands.map(Some)], start_ns + 9 * MS, &mut answers);
    bus.spend(start_ns + 9 * MS);
    answers.remove(0).outcome
}

#[test]
fn both_axes_are_driven_and_read() {
    let mut bus = robot();
    assert_eq!(bus.unit(0).unwrap().firmware.as_deref(), Some("ODrive 0.5.6"));
    for commands in [
        [Command::Velocity(1234.0), Command::Velocity(-98_765.0)],
        [Command::HOLD, Command::Release],
        [Command::Velocity(-1.0), Command::HOLD],
    ] {
        let measured = Measured { counts: [7, -8], currents_a: [1.5, -0.25], ..Measured::default() };
        bus.transport_mut().device_mut().measure(&measured);
        assert_eq!(cycle(&mut bus, commands), Ok(()), "{commands:?}");
        for (axis, command) in commands.into_iter().enumerate() {
            let target = match bus.transport().device().target(axis) {
                Target::Velocity(counts_s) => Command::Velocity((counts_s * 100.0).round() / 100.0),
                Target::Current(current_a) => Command::Torque(current_a),
                Target::Released => Command::Release,
            };
            assert_eq!(target, command, "axis {axis}");
        }
    }
    let mut answers = bus.blank_answers();
    let deadline_ns = bus.now_ns() + 9 * MS;
    bus.exchange(&[[None; 2]], deadline_ns, &mut answers);
    let report = answers[0].report;
    assert_eq!((report.counts.value, report.currents_a.value), ([7, -8], [1.5, -0.25]));
    assert_eq!((report.supply_v.value, report.setups, report.reboots), (24.0, 1, 0));
}

#[test]
fn no_torque_of_before_is_added_to_a_velocity() {
    let mut bus = robot();
    cycle(&mut bus, [Command::Torque(20.0), Command::Torque(-20.0)]).unwrap();
    let added = |bus: &Bus<Pipe<Board>>| [0, 1].map(|axis| bus.transport().device().added_torque_n_m(axis).round());
    assert_eq!(added(&bus), [1.0, -1.0]);
    cycle(&mut bus, [Command::HOLD, Command::Velocity(5000.0)]).unwrap();
    assert_eq!(added(&bus), [0.0, 0.0]);
}

#[test]
fn an_error_of_one_axis_stops_both_until_they_are_commanded_to_hold() {
    let mut bus = robot();
    cycle(&mut bus, [Command::Velocity(5000.0); 2]).unwrap();
    bus.transport_mut().device_mut().fail(1, error::ENCODER);
    for _ in 0..5 {
        assert!(cycle(&mut bus, [Command::Velocity(5000.0); 2]).is_err());
    }
    assert_eq!(bus.transport().device().target(0), Target::Velocity(0.0), "the other one does not turn on");
    let mut answers = bus.blank_answers();
    let deadline_ns = bus.now_ns() + 9 * MS;
    bus.exchange(&[[None; 2]], deadline_ns, &mut answers);
    assert!(answers[0].report.status.value.has(DriveStatus::ENCODER_2), "{}", answers[0].report.status.value);
    assert_eq!(answers[0].report.reboots, 0);
    assert!((0..10).any(|_| cycle(&mut bus, [Command::HOLD; 2]).is_ok()));
    cycle(&mut bus, [Command::Velocity(5000.0); 2]).unwrap();
    assert_eq!(bus.transport().device().target(1), Target::Velocity(f64::from(0.05_f32) * 1e5));
}

#[test]
fn why_an_axis_stopped_while_it_held_is_reported_before_it_is_armed_again() {
    for axis in 0..2 {
        let mut bus = robot();
        bus.transport_mut().device_mut().fail(axis, error::MOTOR);
        let mut answers = bus.blank_answers();
        let start_ns = bus.now_ns().next_multiple_of(10 * MS);
        bus.transport_mut().wait_until(start_ns);
        bus.exchange(&[[Some(Command::HOLD); 2]], start_ns + 9 * MS, &mut answers);
        let stage = [DriveStatus::STAGE_1, DriveStatus::STAGE_2][axis];
        let report = answers[0].report;
        assert!(report.status.value.has(stage) && report.native_status != 0, "{}", report.status.value);
        assert!((0..10).any(|_| cycle(&mut bus, [Command::HOLD; 2]).is_ok()));
        assert_eq!(bus.transport().device().target(axis), Target::Velocity(0.0), "armed again");
    }
}

#[test]
fn a_board_that_was_quiet_gets_no_command_after_the_deadline() {
    let mut bus = robot();
    bus.transport_mut().device_mut().mute_until(u64::MAX);
    assert!(cycle(&mut bus, [Command::HOLD; 2]).is_err());
    bus.transport_mut().device_mut().mute_until(0);
    let (asked, now_ns) = (bus.counters().exchanges, bus.now_ns());
    let mut answers = bus.blank_answers();
    // It is over before the mark is answered that shows whether the board is back.
    bus.exchange(&[[Some(Command::HOLD); 2]], now_ns + MS / 10, &mut answers);
    assert!(answers[0].outcome.is_err());
    assert_eq!(bus.counters().exchanges, asked + 1, "the mark alone");
    cycle(&mut bus, [Command::HOLD; 2]).unwrap();
}

proptest! {
    #[test]
    fn no_bytes_move_a_motor_or_end_the_program(bytes in prop::collection::vec(any::<u8>(), 0..300)) {
        let mut client = Client::new();
        let mut wire = WireQueue::new(0);
        bytes.iter().for_each(|&byte| client.board.receive(0, byte, &mut wire));
        prop_assert_eq!(client.board.target(0), Target::Released);
    }
}
