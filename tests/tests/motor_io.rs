//! The process motor-io against virtual drive units on a pseudo-terminal: properties that only the real process shows.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use bus::{Bus, Client, Domain, Subscriber, TestDomain};
use messages::{GotoPath, MotorAuthority, MotorState, Request, text_of};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

/// Longest wait for any event: the machine may stand still for a quarter of a second now and then.
const LONG: Duration = Duration::from_secs(20);

fn binary(name: &str) -> PathBuf {
    let mut path = std::env::current_exe().unwrap();
    path.pop();
    path.pop();
    path.join(name)
}

/// A system with one port and two units, its files, its domain.
struct Place {
    domain: TestDomain,
    folder: tempfile::TempDir,
}

impl Place {
    fn new() -> Self {
        let place = Self { domain: Domain::for_test(), folder: tempfile::tempdir().unwrap() };
        let configs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../configs/robots/lab3.toml");
        let text = format!(
            "name = \"test\"\nrobot = \"{}\"\nrate_hz = 50.0\n[motor_io]\ncounts_per_m = [10865.0, 10865.0, 10865.0]\n\
             [[motor_io.ports]]\npath = \"{{domain}}/drive0\"\nunits = [{{ address = 128, cables = [1, 2] }}, {{ address = 129, cables = [3] }}]\n\
             [motor_box]\n",
            configs.canonicalize().unwrap().display()
        );
        std::fs::write(place.system_file(), text).unwrap();
        place
    }

    fn system_file(&self) -> PathBuf {
        self.folder.path().join("system.toml")
    }

    fn command(&self, name: &str) -> Command {
        let mut command = Command::new(binary(name));
        command.arg("--system").arg(self.system_file()).arg("--domain").arg(self.domain.name());
        if name == "motor-io" {
            command.arg("--state").arg(self.folder.path().join("state"));
        }
        command
    }

    fn start(&self, name: &str) -> Running {
        Running(self.command(name).stdin(Stdio::null()).stderr(Stdio::null()).spawn().unwrap())
    }

    fn eyes(&self, name: &str) -> Eyes {
        let bus = Bus::join(&self.domain, name).unwrap();
        let (state, authority) =
            (bus.deep_subscriber("motor/state").unwrap(), bus.deep_subscriber("motor/authority").unwrap());
        Eyes { client: None, state, authority, bus, last: None }
    }
}

/// A child process that ends with its test.
struct Running(Child);

impl Running {
    fn kill(mut self) {
        self.0.kill().unwrap();
        self.0.wait().unwrap();
    }

    fn end(mut self) -> bool {
        assert!(Command::new("kill").args(["-TERM", &self.0.id().to_string()]).status().unwrap().success());
        self.0.wait().unwrap().success()
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

struct Eyes {
    client: Option<Client>,
    state: Subscriber<MotorState>,
    authority: Subscriber<MotorAuthority>,
    bus: Bus,
    last: Option<(MotorState, MotorAuthority)>,
}

impl Eyes {
    fn until(
        &mut self,
        what: &str,
        wanted: impl Fn(&MotorState, &MotorAuthority) -> bool,
    ) -> (MotorState, MotorAuthority) {
        let give_up = Instant::now() + LONG;
        while Instant::now() < give_up {
            if let (Some(state), Some(authority)) = (self.state.latest().unwrap(), self.authority.latest().unwrap()) {
                self.last = Some((state, authority));
                if wanted(&state, &authority) {
                    return (state, authority);
                }
            }
            std::thread::sleep(Duration::from_millis(5));
        }
        panic!("waited in vain for {what}; last seen {:?}", self.last.map(|(_, authority)| authority));
    }

    fn up(&mut self) {
        self.until("all units", |state, _| state.unit_ok[..2] == [1, 1]);
    }

    fn ask(&mut self, request: Request) -> (bool, String) {
        let client = self.client.get_or_insert_with(|| self.bus.client("motor-io").unwrap());
        let answer = client.ask(&request.encode().unwrap(), LONG).unwrap();
        (answer.accepted == 1, text_of(&answer.answer))
    }

    fn demand(&mut self, request: Request) {
        let (accepted, sentence) = self.ask(request);
        assert!(accepted, "{sentence}");
    }

    /// Injects a fault into the motor box, or ends it.
    fn fault(&mut self, text: &str) {
        let request = Request::Fault { text: text.to_owned() }.encode().unwrap();
        let answer = self.bus.client("motor-box").unwrap().ask(&request, LONG).unwrap();
        assert_eq!(answer.accepted, 1, "{}", text_of(&answer.answer));
    }

    /// Repeats a request to the planner until it is accepted.
    fn go(&mut self, to: [f64; 3]) {
        let request = Request::Goto { to_m: to, path: GotoPath::Line, speed_m_s: None }.encode().unwrap();
        let give_up = Instant::now() + LONG;
        loop {
            let answer = self.bus.client("planner").and_then(|mut client| client.ask(&request, LONG));
            match answer {
                Ok(answer) if answer.accepted == 1 => return,
                other => {
                    let said = other.map(|answer| text_of(&answer.answer));
                    assert!(Instant::now() < give_up, "the planner keeps rejecting the request: {said:?}");
                }
            }
            std::thread::sleep(Duration::from_millis(100));
        }
    }

    /// Resets as soon as the cause has ended.
    fn reset(&mut self) {
        let give_up = Instant::now() + LONG;
        loop {
            let (accepted, sentence) = self.ask(Request::Reset);
            if accepted {
                return;
            }
            assert!(Instant::now() < give_up, "the reset is still rejected: {sentence}");
            std::thread::sleep(Duration::from_millis(50));
        }
    }
}

fn one_sentence(output: &Output) -> String {
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(text.lines().count(), 1, "{text}");
    text
}

#[test]
fn a_cable_is_jogged_by_the_distance_over_the_real_protocol() {
    let place = Place::new();
    let _box = place.start("motor-box");
    let io = place.start("motor-io");
    let mut eyes = place.eyes("test");
    eyes.up();
    eyes.demand(Request::ZeroAt { position_m: [4.8, 3.0, 0.3] });
    eyes.demand(Request::Arm);
    let (before, _) = eyes.until("holding", |_, authority| authority.mode == MotorAuthority::MODE_HOLDING);
    assert_eq!(before.position_known, MotorState::POSITION_KNOWN);
    eyes.demand(Request::Jog { cable: 2, distance_m: -0.05 });
    eyes.until("jogging", |_, authority| authority.mode == MotorAuthority::MODE_JOGGING);
    let wanted = before.length_m[1] - 0.05;
    let (after, authority) = eyes.until("the end of the jog", |state, authority| {
        authority.mode == MotorAuthority::MODE_HOLDING && (state.length_m[1] - wanted).abs() < 0.002
    });
    assert_eq!(authority.faults, 0);
    assert!((after.length_m[0] - before.length_m[0]).abs() < 0.002);
    eyes.demand(Request::Disarm);
    assert!(io.end());
}

#[test]
fn after_sigkill_the_position_is_from_before_and_nothing_is_armed() {
    let place = Place::new();
    let _box = place.start("motor-box");
    let io = place.start("motor-io");
    let mut eyes = place.eyes("test");
    eyes.up();
    eyes.demand(Request::ZeroAt { position_m: [4.8, 3.0, 0.3] });
    eyes.demand(Request::Arm);
    eyes.demand(Request::Jog { cable: 1, distance_m: -0.04 });
    eyes.until("the jog", |_, authority| authority.mode == MotorAuthority::MODE_JOGGING);
    let (before, _) = eyes.until("the end of the jog", |_, authority| authority.mode == MotorAuthority::MODE_HOLDING);
    // Stored at most twice a second.
    std::thread::sleep(Duration::from_millis(700));
    io.kill();

    let _io = place.start("motor-io");
    eyes.up();
    let (state, authority) =
        eyes.until("the restored position", |state, _| state.position_known == MotorState::POSITION_RESTORED);
    assert_eq!((authority.mode, authority.faults), (MotorAuthority::MODE_DISARMED, 0));
    for cable in 0..3 {
        // The unit went on counting, and an unpowered cable may creep.
        assert!((state.length_m[cable] - before.length_m[cable]).abs() < 0.05, "{}", state.length_m[cable]);
    }
    eyes.demand(Request::ConfirmPosition);
    eyes.until("the confirmed position", |state, _| state.position_known == MotorState::POSITION_KNOWN);
}

#[test]
fn a_box_that_dies_is_a_fault_and_its_return_moves_nothing() {
    let place = Place::new();
    let box_process = place.start("motor-box");
    let _io = place.start("motor-io");
    let mut eyes = place.eyes("test");
    eyes.up();
    eyes.demand(Request::Arm);
    eyes.until("holding", |_, authority| authority.mode == MotorAuthority::MODE_HOLDING);
    box_process.kill();
    let (_, authority) = eyes.until("the fault", |_, authority| authority.mode == MotorAuthority::MODE_FAULTED);
    // A delay of this machine at that moment is named too.
    assert_eq!(authority.faults & messages::faults::HARD, MotorAuthority::FAULT_LOST_UNIT);
    // The refusal names the port, and the consequence.
    let (accepted, sentence) = eyes.ask(Request::Reset);
    assert!(!accepted && sentence.contains("/drive0: "), "{sentence}");
    let _box = place.start("motor-box");
    eyes.up();
    let (_, authority) = eyes.until("its return", |state, _| state.unit_ok[..2] == [1, 1]);
    assert_eq!(authority.mode, MotorAuthority::MODE_FAULTED);
    let give_up = Instant::now() + LONG;
    while !eyes.ask(Request::Reset).0 {
        assert!(Instant::now() < give_up, "the reset is still rejected");
        std::thread::sleep(Duration::from_millis(50));
    }
    eyes.until("holding again", |_, authority| authority.mode == MotorAuthority::MODE_HOLDING);
}

#[test]
fn a_plug_pulled_and_put_back_while_holding_costs_no_position() {
    let place = Place::new();
    let _box = place.start("motor-box");
    let _io = place.start("motor-io");
    let mut eyes = place.eyes("test");
    eyes.up();
    eyes.demand(Request::ZeroAt { position_m: [4.8, 3.0, 0.3] });
    eyes.demand(Request::Arm);
    let (before, _) = eyes.until("holding", |_, authority| authority.mode == MotorAuthority::MODE_HOLDING);
    eyes.fault("unplug 1");
    let (_, authority) = eyes.until("the fault", |_, authority| authority.mode == MotorAuthority::MODE_FAULTED);
    // A delay of a busy computer may coincide.
    assert_eq!(authority.faults & !MotorAuthority::FAULT_COMPUTER, MotorAuthority::FAULT_LOST_UNIT);
    eyes.fault("plug 1");
    eyes.up();
    eyes.reset();
    let (after, _) = eyes.until("holding again", |_, authority| authority.mode == MotorAuthority::MODE_HOLDING);
    assert_eq!(after.position_known, MotorState::POSITION_KNOWN);
    for cable in 0..3 {
        assert!((after.length_m[cable] - before.length_m[cable]).abs() < 0.005, "{after:?}");
    }
}

#[test]
fn a_unit_that_restarts_in_a_motion_stops_the_robot_and_asks_for_a_confirmation() {
    let place = Place::new();
    let _box = place.start("motor-box");
    let _io = place.start("motor-io");
    let _others = ["estimator", "controller", "planner"].map(|name| place.start(name));
    let mut eyes = place.eyes("test");
    eyes.up();
    eyes.demand(Request::ZeroAt { position_m: [4.8, 3.0, 0.3] });
    eyes.demand(Request::Arm);
    eyes.go([5.4, 3.6, 0.7]);
    eyes.until("the motion", |_, authority| {
        authority.mode == MotorAuthority::MODE_FOLLOWING && authority.plan_rate == 1.0
    });
    eyes.fault("reboot 1 128 for 0.3");
    let (_, authority) =
        eyes.until("the fault", |_, authority| authority.faults & MotorAuthority::FAULT_UNIT_REBOOT != 0);
    assert_eq!((authority.mode, authority.fault_unit[0]), (MotorAuthority::MODE_FAULTED, 1));
    eyes.reset();
    let (state, _) = eyes.until("holding", |_, authority| authority.mode == MotorAuthority::MODE_HOLDING);
    assert_eq!(state.position_known, MotorState::POSITION_RESTORED);
    eyes.demand(Request::ConfirmPosition);
    eyes.until("the confirmed position", |state, _| state.position_known == MotorState::POSITION_KNOWN);
    eyes.go([4.8, 3.0, 0.4]);
    eyes.until("a new motion", |_, authority| authority.mode == MotorAuthority::MODE_FOLLOWING);
}

#[test]
fn motor_io_names_a_missing_port_and_exits() {
    let place = Place::new();
    let output = place.command("motor-io").output().unwrap();
    assert_eq!(output.status.code(), Some(1), "{}", String::from_utf8_lossy(&output.stderr));
    assert!(one_sentence(&output).contains("drive0"));
}

#[test]
fn a_second_motor_io_is_rejected_with_one_sentence() {
    let place = Place::new();
    let _box = place.start("motor-box");
    let _io = place.start("motor-io");
    let mut eyes = place.eyes("test");
    eyes.up();
    let output = place.command("motor-io").output().unwrap();
    assert_eq!(output.status.code(), Some(2));
    assert!(one_sentence(&output).contains("motor-io"));
    eyes.demand(Request::Arm);
}

#[test]
fn an_invalid_configuration_is_rejected_before_any_motion() {
    let place = Place::new();
    let text = std::fs::read_to_string(place.system_file()).unwrap();
    let cases = [
        ("rate_hz = 50.0", "rate_hz = 5000.0"),
        ("10865.0, 10865.0]", "10865.0]"),
        ("10865.0, 10865.0]", "10865.0, nan]"),
        ("cables = [3]", "cables = [2]"),
        ("cables = [3]", "cables = [7]"),
        ("address = 129", "address = 5"),
        ("[motor_box]", "watchdog_s = 0.0\n[motor_box]"),
    ];
    for (from, to) in cases {
        assert!(text.contains(from));
        let spoiled = text.replace(from, to).replace("watchdog_s = 0.0\n[motor_box]", "[motor_box]");
        let spoiled = if to.starts_with("watchdog") {
            spoiled.replace("[motor_io]\n", "[motor_io]\nwatchdog_s = 0.0\n")
        } else {
            spoiled
        };
        std::fs::write(place.system_file(), spoiled).unwrap();
        let output = place.command("motor-io").output().unwrap();
        assert_eq!(output.status.code(), Some(2), "{to}: {}", String::from_utf8_lossy(&output.stderr));
        one_sentence(&output);
    }
}
