//! Habits of the virtual controller, as a client meets them on the wire, and the driver of one with two motors.

use drives::{Command, CountBound, DriveBus, DriveStatus, Error};
use proptest::prelude::*;
use roboteq::codec::{fault, mode, motor_fault};
use roboteq::unit::{Controller, ControllerOptions, Measured, Target};
use roboteq::{Bus, BusConfig};
use serial::{Device, Pipe, Transport, WireQueue};

const MS: u64 = 1_000_000;

struct Client {
    controller: Controller,
    now_ns: u64,
}

impl Client {
    /// A client of a controller whose echo is off.
    fn new() -> Client {
        let mut client = Client { controller: Controller::new(ControllerOptions::new(0)), now_ns: 0 };
        client.send("^ECHOF 1\r");
        client
    }

    /// Sends text and returns the bytes that come back.
    fn send(&mut self, text: &str) -> String {
        let mut wire = WireQueue::new(0);
        text.bytes().for_each(|byte| self.controller.receive(self.now_ns, byte, &mut wire));
        let said = std::iter::from_fn(|| wire.pop(u64::MAX).map(|(_, byte)| byte)).collect();
        String::from_utf8(said).unwrap()
    }

    fn wait(&mut self, ms: u64) {
        self.now_ns += ms * MS;
        self.controller.advance(self.now_ns);
    }
}

#[test]
fn lines_are_answered_as_the_manuals_say() {
    let mut client = Client::new();
    let measured = Measured {
        counts: [7, -8],
        speeds_counts_s: [100_000.0, -50_000.0],
        currents_a: [10.0, 20.0],
        supply_v: 24.6,
        ..Measured::default()
    };
    client.controller.measure(&measured);
    for (sent, answer) in [
        ("?A\r", "A=100:200\r"),
        ("?V\r", "V=135:246:4980\r"),
        ("?FF\r", "FF=0\r"),
        ("?FM 1\r", "FM=0\r"),
        ("?FM\r", "FM=0:0\r"),
        ("?FID\r", "FID=Roboteq v1.6 RCB500 05/01/2016\r"),
        ("?TRN\r", "TRN=RCB500:HDC2460\r"),
        ("!G 1 0\r", "+\r"),
        ("!S 1 300_!S 2 -1500_?C\r", "+\r+\rC=7:-8\r"),
        ("?CIS_?S_?M_", "CIS=100:-500\rS=3000:-1500\rM=100:-500\r"),
        ("?c 2\r\n", "C=-8\r"),
        ("!C 1 70_?C 1\r", "+\rC=70\r"),
        ("!M 1 1001\r", "-\r"),
        ("?XY\r", "-\r"),
        ("~RWD\r", "RWD=1000\r"),
        ("^RWD 70000\r", "-\r"),
        ("!VAR 3 123_?VAR 3\r", "+\rVAR=123\r"),
        ("!VAR 33 1\r", "-\r"),
        ("\r\n_", ""),
        ("\u{5}", "\u{6}"),
        ("# C\r", ""),
    ] {
        assert_eq!(client.send(sent), answer, "{sent:?}");
    }
}

#[test]
fn received_bytes_are_sent_back_until_that_is_switched_off() {
    let mut client = Client { controller: Controller::new(ControllerOptions::new(0)), now_ns: 0 };
    assert_eq!(client.send("?C\r"), "?C\rC=0:0\r");
    assert_eq!(client.send("^ECHOF 1\r"), "^ECHOF 1\r+\r");
    assert_eq!(client.send("?C\r"), "C=0:0\r");
    client.controller.reboot(0);
    assert_eq!(client.send("?C\r"), "?C\rC=0:0\r");
}

#[test]
fn after_the_watchdog_any_command_resumes_the_speeds_of_before() {
    let mut client = Client::new();
    client.send("^RWD 300_!M 100 0\r");
    assert_eq!(client.controller.target(0), Target::Velocity(10_000.0));
    client.wait(290);
    client.send("?C_?FF_^RWD 300\r");
    client.wait(11);
    assert_eq!((client.controller.target(0), client.controller.watchdog_trips()), (Target::Velocity(0.0), 1));
    client.send("?C_~RWD_^ECHOF 1\r");
    assert_eq!(client.controller.target(0), Target::Velocity(0.0), "questions and settings resume nothing");
    client.send("!VAR 1 5\r");
    assert_eq!(client.controller.target(0), Target::Velocity(10_000.0));
}

#[test]
fn a_history_is_repeated_until_it_is_cleared() {
    let mut client = Client::new();
    client.send("?C_?FF_# 10\r");
    client.wait(20);
    assert_eq!(client.send("?A\r"), "FF=0\rC=0:0\rA=0:0\r");
    client.send("# C\r");
    client.wait(50);
    assert_eq!(client.send("?A\r"), "A=0:0\r");
}

const CONFIG: BusConfig = BusConfig {
    baud: 115_200,
    margin_ns: roboteq::driver::UART_MARGIN_NS,
    address: 3,
    axes: 2,
    watchdog_ms: 300,
    bound: CountBound { counts_s: 20_000.0, margin: 100.0 },
    stop_pin: None,
};

fn bus(controller: Controller) -> Bus<Pipe<Controller>> {
    Bus::new(Pipe::new("port", CONFIG.baud, controller), &CONFIG).unwrap()
}

fn settle(bus: &mut Bus<Pipe<Controller>>) {
    while let Err(error) = bus.settle(bus.now_ns() + 5 * MS) {
        assert!(bus.now_ns() < 1000 * MS, "not set up: {error}");
    }
}

/// A driver in step with a controller of two motors, commanded to hold.
fn robot() -> Bus<Pipe<Controller>> {
    let mut bus = bus(Controller::new(ControllerOptions::new(3)));
    settle(&mut bus);
    cycle(&mut bus, [Command::HOLD; 2]).unwrap();
    bus
}

fn cycle(bus: &mut Bus<Pipe<Controller>>, commands: [Command; 2]) -> Result<(), Error> {
    let mut answers = bus.blank_answers();
    let start_ns = bus.now_ns().next_multiple_of(10 * MS);
    bus.transport_mut().wait_until(start_ns);
    bus.exchange(&[commands.map(Some)], start_ns + 9 * MS, &mut answers);
    bus.spend(start_ns + 9 * MS);
    answers.remove(0).outcome
}

fn status(bus: &mut Bus<Pipe<Controller>>) -> DriveStatus {
    let mut answers = bus.blank_answers();
    // Longer than a round of the slow questions, twice.
    for _ in 0..20 {
        let _ = cycle(bus, [Command::HOLD; 2]);
    }
    let deadline_ns = bus.now_ns() + 9 * MS;
    bus.exchange(&[[None; 2]], deadline_ns, &mut answers);
    answers[0].report.status.value
}

#[test]
fn both_motors_are_driven_and_read() {
    let mut bus = bus(Controller::new(ControllerOptions::new(3)));
    let measured = Measured { counts: [70, -80], currents_a: [1.5, -0.5], duties: [0.25, -1.0], ..Measured::default() };
    bus.transport_mut().device_mut().measure(&measured);
    settle(&mut bus);
    cycle(&mut bus, [Command::HOLD; 2]).unwrap();
    let firmware = bus.unit(0).unwrap().firmware.unwrap();
    assert!(firmware.starts_with("Roboteq v1.6 RCB500 05/01/2016, RCB500:HDC2460"), "{firmware}");
    for (commands, targets) in [
        ([Command::Velocity(1200.0), Command::Velocity(-99_960.0)], [Target::Velocity(1200.0), Target::Velocity(-1e5)]),
        ([Command::HOLD, Command::Release], [Target::Velocity(0.0), Target::Released]),
        ([Command::Velocity(-100.0), Command::Velocity(100.0)], [Target::Velocity(-100.0), Target::Velocity(100.0)]),
        ([Command::Release; 2], [Target::Released; 2]),
    ] {
        assert_eq!(cycle(&mut bus, commands), Ok(()), "{commands:?}");
        assert_eq!([0, 1].map(|motor| bus.transport().device().target(motor)), targets, "{commands:?}");
    }
    for _ in 0..40 {
        cycle(&mut bus, [Command::HOLD; 2]).unwrap();
    }
    let mut answers = bus.blank_answers();
    let deadline_ns = bus.now_ns() + 9 * MS;
    bus.exchange(&[[None; 2]], deadline_ns, &mut answers);
    let report = answers[0].report;
    assert_eq!((report.counts.value, report.currents_a.value), ([70, -80], [1.5, -0.5]));
    assert_eq!((report.duties.value, report.supply_v.value), ([0.25, -1.0], 24.0));
    assert_eq!((report.setups, report.reboots, report.jumps), (1, 0, 0));
}

#[test]
fn a_speed_that_the_controller_cannot_have_is_named_and_limited() {
    let mut bus = robot();
    let outcome = cycle(&mut bus, [Command::Velocity(200_000.0), Command::HOLD]);
    assert!(matches!(&outcome, Err(Error::Unsupported { what, .. }) if what.contains("MXRPM")), "{outcome:?}");
    assert_eq!(bus.transport().device().target(0), Target::Velocity(1e5));
}

#[test]
fn a_motor_that_is_not_in_speed_mode_is_refused_until_it_is() {
    let options = ControllerOptions { modes: [mode::CLOSED_SPEED, mode::OPEN_LOOP], ..ControllerOptions::new(3) };
    let mut bus = bus(Controller::new(options));
    for _ in 0..100 {
        assert!(cycle(&mut bus, [Command::HOLD; 2]).is_err());
    }
    let Err(Error::Unexpected { asked, said, .. }) = cycle(&mut bus, [Command::HOLD; 2]) else { panic!("not named") };
    assert!(asked.words.contains("MMOD") && said.starts_with("0;"), "{asked}: {said}");
    bus.transport_mut().device_mut().settings_mut().modes = [mode::CLOSED_SPEED; 2];
    settle(&mut bus);
    cycle(&mut bus, [Command::HOLD; 2]).unwrap();
    // One that this driver has released is its own, also for the next run of the program.
    cycle(&mut bus, [Command::Release; 2]).unwrap();
    let controller = bus.transport().device().clone();
    let mut next = Bus::new(Pipe::new("port", CONFIG.baud, controller), &CONFIG).unwrap();
    settle(&mut next);
    cycle(&mut next, [Command::HOLD; 2]).unwrap();
    assert_eq!(next.transport().device().target(1), Target::Velocity(0.0));
}

#[test]
fn a_new_driver_stops_the_motors_before_it_feeds_the_watchdog() {
    let mut controller = Controller::new(ControllerOptions::new(3));
    let mut wire = WireQueue::new(0);
    b"^RWD 100\r!M 500 500\r?C\r# 5\r".iter().for_each(|&byte| controller.receive(0, byte, &mut wire));
    controller.advance(200 * MS);
    assert_eq!(controller.watchdog_trips(), 1);
    let mut bus = bus(controller);
    bus.transport_mut().wait_until(200 * MS);
    while bus.settle(bus.now_ns() + MS).is_err() {
        let target = bus.transport().device().target(0);
        assert_eq!(target, Target::Velocity(0.0), "the speed of before was resumed");
        assert!(bus.now_ns() < 2000 * MS, "not set up");
    }
}

#[test]
fn conditions_have_neutral_bits() {
    let mut bus = robot();
    let device = |bus: &mut Bus<Pipe<Controller>>, bits, motor| {
        bus.transport_mut().device_mut().repair();
        bus.transport_mut().device_mut().fail(bits);
        bus.transport_mut().device_mut().fail_motor(1, motor);
        status(bus).0
    };
    for (bits, motor, neutral) in [
        (fault::OVERHEAT, 0, DriveStatus::OVERHEATED),
        (fault::OVER_VOLTAGE, 0, DriveStatus::SUPPLY_HIGH),
        (fault::UNDER_VOLTAGE, 0, DriveStatus::SUPPLY_LOW),
        (fault::SHORT | fault::MOSFET, 0, DriveStatus::STAGE_1 | DriveStatus::STAGE_2),
        (fault::SENSOR, 0, DriveStatus::OTHER_ERROR),
        (fault::DEFAULT_SETTINGS, 0, DriveStatus::OTHER_ERROR),
        (0, motor_fault::AMPS_LIMIT, DriveStatus::OVER_CURRENT_2_WARNING),
        (0, motor_fault::STALL, DriveStatus::SPEED_2),
        (0, motor_fault::AMPS_TRIGGER | motor_fault::FORWARD_LIMIT, {
            DriveStatus::CURRENT_2 | DriveStatus::POSITION_LIMIT_WARNING
        }),
        (0, 0, 0),
    ] {
        assert_eq!(device(&mut bus, bits, motor), neutral, "FF={bits}, FM={motor}");
    }
}

proptest! {
    #[test]
    fn no_bytes_move_a_motor_or_end_the_program(bytes in prop::collection::vec(any::<u8>(), 0..300)) {
        let mut client = Client::new();
        let mut wire = WireQueue::new(0);
        bytes.iter().for_each(|&byte| client.controller.receive(0, byte, &mut wire));
        prop_assert_eq!(client.controller.target(0), Target::Velocity(0.0));
    }

    /// Whatever changed digits make of the answers, the counts stay where a motor could be: in the time between two
    /// answers, or, where the same digit of both was changed, in an eighth of the time since the last sample.
    #[test]
    fn changed_digits_move_the_counts_no_further_than_a_motor(seed in any::<u64>()) {
        let mut bus = bus(Controller::new(ControllerOptions::new(3)));
        let counts = [1_234_567, -89];
        bus.transport_mut().device_mut().measure(&Measured { counts, ..Measured::default() });
        settle(&mut bus);
        for _ in 0..3 {
            cycle(&mut bus, [Command::HOLD; 2]).unwrap();
        }
        let faults = serial::Faults { corrupt: 0.01, ..serial::Faults::default() };
        bus.transport_mut().set_faults(faults, seed);
        let mut answers = bus.blank_answers();
        bus.exchange(&[[None; 2]], 0, &mut answers);
        let (mut last_ns, mut limit) = (answers[0].report.counts.at_ns, 0);
        for _ in 0..60 {
            let _ = cycle(&mut bus, [Command::HOLD; 2]);
            bus.exchange(&[[None; 2]], 0, &mut answers);
            let got = answers[0].report.counts;
            if got.at_ns != last_ns {
                // The bound is 20 counts in a millisecond, and the answers are 1.26 ms apart.
                limit = 27 + (20 * (got.at_ns - last_ns) / (8 * MS)).cast_signed();
                last_ns = got.at_ns;
            }
            let off = [0, 1].map(|motor| (got.value[motor] - counts[motor]).abs());
            prop_assert!(off.iter().all(|&off| off <= limit), "{:?}, limit {}", got, limit);
            prop_assert_eq!(answers[0].report.reboots, 0);
        }
    }
}
