//! What each role and each token may do, and that commands are the same through the gateway.

use crate::rig::{Gateway, OWNER, me, nims, told};
use crate::robot::{Robot, START, program, steadily};
use gateway_protocol::{Accepted, Call, Reply};
use messages::{GotoPath, MotorAuthority, OperatorRequest, Request, Slot, SlotRole, text_of};
use rustix::process::geteuid;
use std::path::Path;
use std::process::{Command, Output};

/// Actions, and the lowest role that may do each. What is allowed may fail for another reason.
fn actions() -> Vec<(&'static str, &'static str, Call, Vec<u8>)> {
    let nothing = || "nothing".to_owned();
    let mission = b"not a mission";
    let hash = config::mission_hash("not a mission");
    let run = Request::Run { mission: nothing(), hash, continues: false };
    let plug = Request::Plug { name: "BAD NAME".to_owned(), folder: "/".to_owned(), command: vec![], replace: false };
    let lengths_m = [1.0; 3].into_iter().collect();
    let requests = vec![
        ("stop", "hold", Request::Hold),
        ("stop", "pause", Request::Pause),
        ("stop", "stop", Request::Stop),
        ("stop", "estop", Request::Estop),
        ("fly", "reset", Request::Reset),
        ("fly", "arm", Request::Arm),
        ("fly", "zero at", Request::ZeroAt { position_m: START }),
        ("fly", "zero lengths", Request::ZeroLengths { lengths_m }),
        ("fly", "confirm", Request::ConfirmPosition),
        ("fly", "jog", Request::Jog { cable: 9, distance_m: 0.1 }),
        ("fly", "soft", Request::Soft),
        ("fly", "resume", Request::Resume),
        ("fly", "speed", Request::Speed { rate: 0.5 }),
        ("fly", "swap", Request::Swap { role: SlotRole::Controller, slot: Slot::B }),
        ("fly", "admit", Request::Admit { role: SlotRole::Controller, slot: Slot::B }),
        ("fly", "goto", Request::Goto { to_m: [99.0; 3], path: GotoPath::Line, speed_m_s: None }),
        ("fly", "run", run),
        ("fly", "fault", Request::Fault { text: "no such fault".to_owned() }),
        ("fly", "start", Request::StartProcess { name: nothing(), slot: None, law: None }),
        ("fly", "stop-process", Request::StopProcess { name: nothing() }),
        ("fly", "restart", Request::RestartProcess { name: nothing() }),
        ("owner", "plug", plug),
        ("fly", "unplug", Request::Unplug { name: nothing() }),
        ("stop", "mark", Request::Mark { text: "a leaf moved".to_owned() }),
        ("fly", "set", Request::Set { key: nothing(), value: "1".to_owned() }),
        ("fly", "disarm", Request::Disarm),
    ];
    let mut actions: Vec<_> = requests
        .into_iter()
        .map(|(role, name, request)| {
            let body = if name == "run" { mission.to_vec() } else { Vec::new() };
            (role, name, Call::Ask { id: 1, request, process: None, held: false, at_ns: None, pressed_ns: None }, body)
        })
        .collect();
    let plain = [
        ("look", "robot", Call::Robot { id: 1 }),
        ("look", "configuration", Call::Configuration { id: 1 }),
        ("look", "channels", Call::Channels { id: 1 }),
        ("look", "subscribe", Call::Subscribe { id: 1, channel: "motor/state".to_owned(), rate_hz: Some(1.0) }),
        ("look", "runs", Call::Runs { id: 1 }),
        ("fly", "doctor", Call::Doctor { id: 1 }),
        ("owner", "tokens", Call::TokenList { id: 1 }),
        ("owner", "code", Call::CodeAdd { id: 1, name: nothing(), role: "look".to_owned() }),
    ];
    actions.extend(plain.map(|(role, name, call)| (role, name, call, Vec::new())));
    actions
}

#[test]
fn every_action_passes_or_not_by_the_role() {
    let robot = Robot::up("");
    let order = ["look", "stop", "fly", "owner"];
    assert_eq!(actions().len(), 34);
    for role in order {
        let gateway = Gateway::joined(&robot, &if role == "owner" { OWNER.to_owned() } else { me(role) });
        let mut requests = robot.bus.subscriber::<OperatorRequest>("operator/request").unwrap();
        let rank = |role: &str| order.iter().position(|one| *one == role).unwrap();
        let (mut client, mut passed) = (gateway.client(), 0);
        for (needs, name, call, body) in actions() {
            let reply = client.call_with(&call, &body);
            let refused = matches!(reply, Reply::Answer { reason: 450 | 451, accepted: Accepted::Refused, .. });
            assert_eq!(!refused, rank(role) >= rank(needs), "{role}: {name}: {reply:?}");
            passed += usize::from(!refused);
            if refused {
                continue;
            }
            // It came from the process itself, not from the gateway.
            if let Reply::Answer { reason, sentence, .. } = &reply {
                assert!(!(450..500).contains(reason), "{role}: {name}: {sentence}");
            }
        }
        let expected = match role {
            "look" => 5,
            "stop" => 10,
            "fly" => 31,
            _ => 34,
        };
        assert_eq!(passed, expected, "{role}");
        // The run names the user, not the gateway.
        let own = (geteuid().as_raw(), std::process::id(), OperatorRequest::ORIGIN_PYTHON);
        let mut recorded = 0;
        while let Some(request) = requests.receive().unwrap() {
            if request.origin == OperatorRequest::ORIGIN_PYTHON {
                assert_eq!((request.uid, request.pid, request.origin), own, "{}", text_of(&request.requester));
                recorded += 1;
            }
        }
        assert!(recorded > 0 || role == "look");
    }
}

/// A mission of a home that only its user may enter, by content; the robot flies it to its end. A controller is swapped
/// in flight.
fn flies_its_own_mission(robot: &mut Robot, gateway: &Gateway, home: &Path) {
    let mission = "name = \"own\"\n[[leg]]\nline = { to_m = [4.9, 3.1, 0.4] }\n";
    std::fs::write(home.join("own.toml"), mission).unwrap();
    let flown = told(gateway, home, &["run", "own.toml", "--wait", "--json"]);
    assert!(flown.contains("\"done\":true"), "{flown}");
    robot.poll();
    assert!(robot.distance_m([4.9, 3.1, 0.4]) < 0.05, "{:?}", robot.seen.position_m);
    told(gateway, home, &["goto", "5.2,3.4,0.6", "--speed", "0.1"]);
    let swapped = told(gateway, home, &["swap", "controller", "default"]);
    assert!(swapped.contains("controller-b is in charge"), "{swapped}");
}

/// Most questions until both answers are of one state of the robot.
const ATTEMPTS: usize = 10;

/// Commands with the same answer and exit code with and without the gateway.
const SAME: &[&[&str]] = &[
    &["arm"],
    &["zero", "--at", "4.8,3.0,0.3"],
    &["jog", "9", "0.1"],
    &["jog", "4", "0.1"],
    &["goto", "99,99,99"],
    &["goto", "4.8,3.0,0.5", "--speed", "9"],
    &["run", "no-such-mission"],
    &["speed", "50"],
    &["speed", "400"],
    &["resume"],
    &["restart", "nothing"],
    &["set", "controller.horizon_cycles"],
    &["set", "nothing", "1"],
    &["swap", "controller", "--slot", "b"],
    &["channel", "echo", "no/such"],
    &["fault", "nothing"],
    &["fault", "slack", "9"],
    &["confirm-position"],
    &["speed", "100"],
];

/// Asserts that both answers to a question are equal. They are of different instants, and what the robot has to say may
/// change between them, such as whether it has an estimate: then it is asked again.
fn agree<T: PartialEq + std::fmt::Debug>(ask: impl Fn() -> [T; 2]) {
    let [mut direct, mut through] = ask();
    for _ in 1..ATTEMPTS {
        if direct == through {
            return;
        }
        [direct, through] = ask();
    }
    assert_eq!(direct, through, "in {ATTEMPTS} attempts");
}

/// The names of all facts in an answer, and whether there are any of each.
fn facts(output: &Output) -> Vec<(String, bool)> {
    let value: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let whole = value.as_object().unwrap().iter().flat_map(|(key, value)| {
        let inner = value.as_object().into_iter().flatten();
        let inner = inner.map(move |(name, value)| (format!("{key}.{name}"), value.is_null()));
        std::iter::once((key.clone(), value.is_null())).chain(inner)
    });
    whole.collect()
}

#[test]
fn a_command_is_the_same_through_the_gateway() {
    steadily(|| {
        let mut robot = Robot::up("");
        let gateway = Gateway::joined(&robot, &me("fly"));
        let home = tempfile::tempdir().unwrap();
        let same = |args: &[&str]| {
            let (mut direct, through) = (robot.nims(args), nims(&gateway, home.path(), args));
            // The domain of a test has a name of its own.
            let said = String::from_utf8_lossy(&direct.stderr).replace(robot.domain.name(), crate::robot::THREE_CABLES);
            direct.stderr = said.into_bytes();
            assert_eq!(
                (
                    direct.status.code(),
                    String::from_utf8_lossy(&direct.stdout),
                    String::from_utf8_lossy(&direct.stderr)
                ),
                (
                    through.status.code(),
                    String::from_utf8_lossy(&through.stdout),
                    String::from_utf8_lossy(&through.stderr)
                ),
                "{args:?}"
            );
        };
        told(&gateway, home.path(), &["arm"]);
        told(&gateway, home.path(), &["zero", "--at", "4.8,3.0,0.3"]);
        for args in SAME {
            same(args);
        }
        // The status has the same facts, and the list the same channels.
        let both = |args: &[&str]| [robot.nims(args), nims(&gateway, home.path(), args)];
        agree(|| both(&["status", "--json"]).map(|output| facts(&output)));
        agree(|| both(&["channel", "list"]).map(|output| String::from_utf8_lossy(&output.stdout).lines().count()));
        let hz = told(&gateway, home.path(), &["channel", "hz", "motor/state", "--for", "1", "--json"]);
        let hz: serde_json::Value = serde_json::from_str(&hz).unwrap();
        assert!(hz["channels"][0]["received"].as_u64().unwrap() > 10, "{hz}");
        flies_its_own_mission(&mut robot, &gateway, home.path());
        told(&gateway, home.path(), &["stop"]);
        told(&gateway, home.path(), &["estop"]);
        robot.until("emergency stop", |robot| robot.last.mode == MotorAuthority::MODE_EMERGENCY_STOP);
    });
}

#[test]
fn a_token_acts_with_its_own_role() {
    let mut robot = Robot::up("");
    robot.arm();
    let gateway = Gateway::joined(&robot, OWNER);
    let home = tempfile::tempdir().unwrap();
    let secret = told(&gateway, home.path(), &["token", "add", "tablet", "stop"]);
    assert!(told(&gateway, home.path(), &["token", "list"]).contains("tablet"));
    let with_token = |args: &[&str]| {
        let mut command = Command::new(program());
        command.arg("--gateway").arg(&gateway.socket).args(args).env("NIMS_TOKEN", secret.trim());
        command.current_dir(home.path()).output().unwrap()
    };
    assert!(with_token(&["stop"]).status.success());
    let refused = with_token(&["arm"]);
    let sentence = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert!(refused.status.code() == Some(1) && sentence.contains("tablet") && sentence.contains("arm"), "{sentence}");
    told(&gateway, home.path(), &["token", "revoke", "tablet"]);
    assert_eq!(with_token(&["stop"]).status.code(), Some(1));
}
