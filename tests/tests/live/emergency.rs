//! An emergency stop works when every slot and every byte of shared memory and of the disk is taken.

use crate::robot::{GOAL, Robot, START, goto};
use bus::{Bus, Client, Participant, Subscriber, Tap, Waiter};
use messages::{MotorAuthority, MotorInput, MotorState, RecorderStatus, Request};
use rustix::fs::{FallocateFlags, fallocate, fstatvfs};
use std::cell::RefCell;
use std::fs::File;
use std::process::Command;

/// Set in a process with a separate /dev/shm and disk.
const OWN: &str = "NIMS_TEST_OWN_SHARED_MEMORY";
const TEST: &str = "emergency::an_emergency_stop_gets_through_where_nothing_else_does";
/// Number of stops; this variable sets a larger one.
const ROUNDS: &str = "NIMS_TEST_ROUNDS";
/// Cycles from the arrival of the stop to the first in which nothing moves any more.
const CYCLES: u64 = 5;
/// Space for a second or two of the robot's run, which the recorder uses to the last megabyte.
const DISK: &str = "64m";
const RECORDER: &str = "[recorder]\nmin_free_bytes = 1000000\n";
const CROWDED: [&str; 9] = [
    "motor/state",
    "motor/authority",
    "motor/slots",
    "motor/input",
    "node/estimate/a",
    "control/status/a",
    "plan/status",
    "system/process",
    "operator/request",
];

/// Takes every free slot, as processes of the robot could.
struct Crowd {
    _taps: Vec<Tap>,
    _clients: Vec<Client>,
    _waiters: Vec<Waiter>,
    _members: Vec<Bus>,
}

impl Crowd {
    fn gather(robot: &Robot) -> Self {
        let join = || Bus::join_as(&robot.domain, "crowd", Participant::Member);
        let members: Vec<Bus> = (0..8).map(|_| join().unwrap()).collect();
        let (mut taps, mut clients, mut waiters) = (Vec::new(), Vec::new(), Vec::new());
        let mut next = members.iter().cycle();
        let mut any = || next.next().unwrap();
        // each until no slot is free
        for name in CROWDED {
            taps.extend(std::iter::from_fn(|| any().tap(name).ok()));
        }
        for name in ["motor-io", "planner", "nims"] {
            clients.extend(std::iter::from_fn(|| any().client(name).ok()));
        }
        for name in ["motor/state", "system/channels"] {
            waiters.extend(std::iter::from_fn(|| any().waiter(&[name]).ok()));
        }
        eprintln!("{} subscribers, {} clients, {} waiting", taps.len(), clients.len(), waiters.len());
        let late = &members[0];
        assert!(CROWDED.iter().all(|name| late.tap(name).is_err()), "every channel is full");
        assert!(late.client("motor-io").is_err() && late.waiter(&["system/channels"]).is_err());
        Self { _taps: taps, _clients: clients, _waiters: waiters, _members: members }
    }
}

#[test]
fn an_emergency_stop_gets_through_where_nothing_else_does() {
    if std::env::var_os(OWN).is_some() {
        return stop_in_a_crowd();
    }
    let disk = tempfile::tempdir().unwrap();
    let mount = format!("mount -t tmpfs -o size=96m tmpfs /dev/shm && mount -t tmpfs -o size={DISK} tmpfs \"$1\"");
    let program = std::env::current_exe().unwrap();
    let unshare = |command: &str| {
        let mut unshare = Command::new("unshare");
        unshare.args(["--mount", "--map-root-user", "sh", "-c", command]).arg(&program).arg(disk.path());
        unshare
    };
    if !unshare(&mount).output().is_ok_and(|tried| tried.status.success()) {
        let reason = "this user cannot mount a /dev/shm (unshare --mount --map-root-user)";
        return notes::left_out("an emergency stop with full shared memory and a full disk", reason);
    }
    let again = format!("{mount} && TMPDIR=\"$1\" exec \"$0\" --exact --nocapture {TEST}");
    assert!(unshare(&again).env(OWN, "1").status().unwrap().success());
}

fn stop_in_a_crowd() {
    let rounds = std::env::var(ROUNDS).ok().and_then(|rounds| rounds.parse().ok()).unwrap_or(5);
    let mut robot = Robot::up(RECORDER);
    let recorder = RefCell::new(robot.bus.subscriber::<RecorderStatus>("recorder/status").unwrap());
    let mut inputs = robot.bus.deep_subscriber::<MotorInput>("motor/input").unwrap();
    let mut states = robot.bus.deep_subscriber::<MotorState>("motor/state").unwrap();
    robot.arm();
    // The test opens what it needs before all slots are taken.
    robot.request("planner", &Request::Arm);
    let crowd = Crowd::gather(&robot);
    let fillers = ["/dev/shm".as_ref(), robot.folder()].map(|place| File::create(place.join("filler")).unwrap());
    fillers.iter().for_each(fill);
    let before = robot.nims(&["status"]);
    assert!(!before.status.success(), "it is full");
    robot.until("the disk is full", |_| {
        // The recorder needs no disk space to report it.
        recorder.borrow_mut().latest().unwrap().is_some_and(|status| status.state == RecorderStatus::STATE_DISK_FULL)
    });
    let mut slowest = 0;
    for round in 0..rounds {
        // To the farther of two places, wherever the last stop left the node.
        let to_m = farther(&robot);
        robot.ask("planner", goto(to_m, 0.12));
        robot.until("the motion", |robot| robot.last.mode == MotorAuthority::MODE_FOLLOWING);
        robot.for_cycles(20);
        fillers.iter().for_each(fill);
        let cycles = stop_once(&robot, &mut inputs, &mut states);
        assert!(cycles <= CYCLES, "round {round}: {cycles} cycles");
        slowest = slowest.max(cycles);
        robot.until("the stop", |robot| robot.last.mode == MotorAuthority::MODE_EMERGENCY_STOP);
        robot.reset();
    }
    eprintln!("{rounds} of {rounds} emergency stops, at zero after {slowest} cycles at most");
    drop(crowd);
}

fn farther(robot: &Robot) -> [f64; 3] {
    let away = |to: &[f64; 3]| robot.seen.position_m.iter().zip(to).map(|(a, b)| (a - b).abs()).sum::<f64>();
    if away(&GOAL) > away(&START) { GOAL } else { START }
}

/// Runs `nims estop`; returns the cycles from its arrival to the first zero command that stays.
fn stop_once(robot: &Robot, inputs: &mut Subscriber<MotorInput>, states: &mut Subscriber<MotorState>) -> u64 {
    while inputs.receive().unwrap().is_some() {}
    while states.receive().unwrap().is_some() {}
    let said = robot.nims(&["estop"]);
    assert!(said.status.success(), "{}", String::from_utf8_lossy(&said.stderr));
    // The answer was published after the cycle; the samples of the next ones follow.
    std::thread::sleep(std::time::Duration::from_millis(200));
    let arrived = std::iter::from_fn(|| inputs.receive().unwrap()).find(|input| input.estops > 0);
    let arrived = arrived.expect("motor/input contains it").header.cycle;
    let moving = |state: &MotorState| state.command_m_s.iter().any(|speed| *speed != 0.0);
    let seen: Vec<MotorState> = std::iter::from_fn(|| states.receive().unwrap()).collect();
    assert!(seen.iter().any(|state| state.header.cycle > arrived), "the estimates continue");
    let last =
        seen.iter().filter(|state| state.header.cycle >= arrived && moving(state)).map(|state| state.header.cycle);
    last.max().map_or(0, |cycle| cycle + 1 - arrived)
}

/// Fills the file system of this file.
fn fill(file: &File) {
    // The kernel allocates all or nothing, and another process may take a part of the room meanwhile.
    for _ in 0..100 {
        let room = fstatvfs(file).unwrap();
        let bytes = room.f_bavail * room.f_frsize;
        if bytes == 0 || fallocate(file, FallocateFlags::empty(), file.metadata().unwrap().len(), bytes).is_ok() {
            return;
        }
    }
}
