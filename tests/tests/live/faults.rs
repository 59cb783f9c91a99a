//! Injected faults: each is detected within the cycles, and followed by the mode, of the table in `docs/faults.md`.

use crate::robot::{Robot, program, root, steadily};
use messages::{MotorAuthority, OperatorRequest, Request, text_of};
use motor_box::{BoxFault, FaultRequest};
use nims::fault::{ROWS, Row, page};
use nims_tests::lockstep::Lockstep;
use nims_tests::scenarios::Case;
use robot_state::answers::Reason;
use rustix::process::Signal;
use std::process::Command;
use std::time::Duration;

const FOLLOWING: u8 = MotorAuthority::MODE_FOLLOWING;

#[test]
fn the_page_is_the_table() {
    let path = root().join("docs/faults.md");
    let is = std::fs::read_to_string(&path).unwrap_or_default();
    assert!(is == page(), "docs/faults.md differs from the code; write it again: nims fault list > docs/faults.md");
}

/// Faults of motors, cables, encoders and supply: in lockstep, on three and four cables, with exact counts.
#[test]
fn faults_of_the_plant_are_detected_within_the_cycles_of_the_table() {
    for robot in ["lab3", "lab4"] {
        for row in &ROWS {
            let Ok(FaultRequest { fault: BoxFault::Plant(fault), .. }) = row.example.parse() else { continue };
            let scenario = Case { robot, mission: "polyline", motor_s: [0.030, 0.040] }.scenario(true).unwrap();
            let mission = scenario.mission.clone();
            let limit_n = scenario.robot.tension_limits_n()[1];
            let mut lockstep = Lockstep::new(scenario).unwrap();
            lockstep.zero_and_arm().unwrap();
            lockstep.run(&mission).unwrap();
            let mut last = (0..800).map(|_| lockstep.cycle().unwrap()).last().unwrap();
            assert_eq!((last.authority.mode, last.authority.faults), (FOLLOWING, 0));
            lockstep.plant_mut().apply(fault).unwrap();
            let mut cycles = 0;
            while last.authority.faults & row.bits == 0 {
                cycles += 1;
                assert!(cycles <= row.cycles, "{robot}, {}: not found in {} cycles", row.example, row.cycles);
                last = lockstep.cycle().unwrap();
            }
            println!("{robot}, {}: found after {cycles} cycles, {:#x}", row.example, last.authority.faults);
            let at_once = last.authority;
            let mut peak: f64 = 0.0;
            for _ in 0..200 {
                last = lockstep.cycle().unwrap();
                let cable = last.truth_n.iter().fold(0.0, |most: f64, tension| most.max(*tension));
                peak = peak.max(cable);
            }
            assert_eq!((at_once.mode, last.authority.mode), (row.mode, row.mode), "{robot}, {}", row.example);
            assert!(peak < limit_n, "{robot}, {}: {peak} N", row.example);
            println!("    largest tension afterwards {peak:.1} N");
        }
    }
}

/// A broken cable: the node comes down, the other cables hang loose, and their encoders do not show the motion of
/// their drums. The drums stand still.
#[test]
fn no_drum_creeps_on_under_a_slack_line() {
    for cable in 0..3 {
        let scenario = Case { robot: "lab3", mission: "polyline", motor_s: [0.030, 0.040] }.scenario(true).unwrap();
        let mission = scenario.mission.clone();
        let mut lockstep = Lockstep::new(scenario).unwrap();
        lockstep.zero_and_arm().unwrap();
        lockstep.run(&mission).unwrap();
        (0..800).for_each(|_| _ = lockstep.cycle().unwrap());
        lockstep.plant_mut().apply(plant::Fault::BrokenLine { cable, on: true }).unwrap();
        (0..500).for_each(|_| _ = lockstep.cycle().unwrap());
        assert!(lockstep.plant_mut().slack()[cable]);
        let before_m = lockstep.plant_mut().lengths_m();
        (0..3000).for_each(|_| _ = lockstep.cycle().unwrap());
        for (before_m, after_m) in before_m.iter().zip(lockstep.plant_mut().lengths_m()) {
            assert!((after_m - before_m).abs() < 1e-3, "{before_m} m became {after_m} m in half a minute");
        }
    }
}

/// Breaks something in flight, and checks within how many cycles it is named; false if that took longer because the
/// robot waited for the computer and reported so.
fn found_after(robot: &mut Robot, row: &Row, breaks: impl FnOnce(&mut Robot)) -> bool {
    robot.poll();
    assert_eq!((robot.last.mode, robot.last.faults), (FOLLOWING, 0), "{}", row.example);
    breaks(robot);
    robot.poll();
    let cycle = robot.last.header.cycle;
    if robot.last.faults & row.bits == 0 {
        robot.until(row.example, |robot| robot.last.faults & row.bits != 0);
    }
    let cycles = robot.last.header.cycle - cycle;
    println!("{}: found after {cycles} cycles, {:#x}", row.example, robot.last.faults);
    let in_time = cycles <= u64::from(row.cycles);
    assert!(in_time || robot.named & MotorAuthority::FAULT_COMPUTER != 0, "{}: {cycles} cycles", row.example);
    robot.until("the mode of the table", |robot| robot.last.mode == row.mode);
    in_time
}

/// Alters what a process publishes, in flight, and restores it; false if the robot has stopped for another reason.
fn found_in(robot: &mut Robot, row: &Row, process: &str, kind: &str) -> bool {
    robot.poll();
    assert_eq!((robot.last.mode, robot.last.faults), (FOLLOWING, 0), "{}", row.example);
    robot.fault_of(process, &row.example.replace(&format!(" {process}"), ""));
    robot.poll();
    let cycle = robot.last.header.cycle;
    if robot.last.faults == 0 {
        robot.until(row.example, |robot| robot.last.faults != 0);
    }
    let (cycles, faults) = (robot.last.header.cycle - cycle, robot.last.faults);
    println!("{}: found after {cycles} cycles, {faults:#x}", row.example);
    assert!(cycles <= u64::from(row.cycles), "{}: {cycles} cycles", row.example);
    robot.until("the mode of the table", |robot| robot.last.mode == row.mode);
    robot.fault_of(process, &format!("{kind} off"));
    resume(robot);
    faults & row.bits != 0
}

/// Waits until the motion continues and no fault is named.
fn resume(robot: &mut Robot) {
    robot.ask("motor-io", Request::Resume);
    robot.until("it continues", |robot| robot.last.mode == FOLLOWING && robot.last.faults == 0);
}

/// Repeats an attempt at most so many times.
fn in_one_of(tries: usize, row: &Row, mut found: impl FnMut() -> bool) {
    assert!((0..tries).any(|_| found()), "{}: {tries} times another fault, or too late", row.example);
}

fn row(kind: &str, of: &str) -> &'static Row {
    ROWS.iter().find(|row| row.kind() == kind && row.example.contains(of)).unwrap()
}

/// Noise on the wire costs periods and nothing else.
fn noise(robot: &mut Robot) {
    robot.fly();
    let lost = robot.last.lost_on_ports();
    robot.fault(row("noise", "").example);
    let until = robot.last.header.cycle + 200;
    robot.until("a noisy flight", |robot| robot.last.header.cycle > until);
    println!(
        "noise: {} periods lost on the ports in two seconds, faults {:#x}",
        robot.last.lost_on_ports() - lost,
        robot.last.faults
    );
    assert_eq!(robot.last.faults & messages::faults::HARD, 0, "it continues");
    assert!(robot.last.lost_on_ports() > lost, "the noise causes no fault");
}

/// The button of a unit: an emergency stop that no reset ends while it is pressed. When it is released, nothing moves.
fn pressed_button(robot: &mut Robot) {
    let pressed = row("estop", "");
    robot.fly();
    assert!(found_after(robot, pressed, |robot| robot.fault(pressed.example)));
    let refused = robot.reason("motor-io", &Request::Reset);
    assert!(matches!(refused, Some(Reason::NotResetFaults { .. })), "{refused:?}");
    robot.fault("estop 1 128 off");
    let until = robot.last.header.cycle + 50;
    robot.until("it stays stopped", |robot| robot.last.header.cycle > until);
    assert_eq!(robot.last.mode, MotorAuthority::MODE_EMERGENCY_STOP, "releasing the button does not reset the robot");
    robot.reset();
}

/// Faults on the wire and of processes: one robot after the other fault, in real time.
#[test]
fn faults_of_ports_and_processes_are_detected_within_the_cycles_of_the_table() {
    steadily(|| {
        let mut robot = Robot::up("");
        robot.arm();
        noise(&mut robot);

        for (kind, repair) in
            [("silence", "silence 1 off"), ("late", "late 1 off"), ("mute", ""), ("unplug", "plug 1"), ("reboot", "")]
        {
            let row = row(kind, "");
            robot.fly();
            let in_time = found_after(&mut robot, row, |robot| robot.fault(row.example));
            assert!(
                in_time,
                "{}: detected late, although this does not depend on the load of the computer",
                row.example
            );
            if !repair.is_empty() {
                robot.fault(repair);
            }
            if kind == "reboot" {
                robot.until("its restart", |robot| robot.last.faults & MotorAuthority::FAULT_UNIT_REBOOT != 0);
            }
            robot.reset();
        }

        pressed_button(&mut robot);

        for process in ["controller", "estimator"] {
            let row = row("stop", process);
            in_one_of(10, row, || {
                robot.fly();
                let in_time = found_after(&mut robot, row, |robot| robot.signal(process, Signal::STOP));
                robot.signal(process, Signal::CONT);
                std::thread::sleep(Duration::from_millis(300));
                resume(&mut robot);
                in_time
            });
        }

        robot.fly();
        for process in ["controller", "estimator"] {
            for kind in ["slow", "nan", "frozen"] {
                let row = row(kind, process);
                // If the machine delays another process in that moment, the robot rightly stops for that one; then it
                // is repeated.
                in_one_of(10, row, || found_in(&mut robot, row, process, kind));
            }
        }

        for process in ["estimator", "controller"] {
            let row = row("kill", process);
            in_one_of(10, row, || {
                robot.fly();
                let in_time = found_after(&mut robot, row, |robot| robot.signal(process, Signal::KILL));
                robot.accepted(&["start", process]);
                robot.until_reported("it is back", |robot| robot.pid(process).is_some());
                std::thread::sleep(Duration::from_millis(300));
                resume(&mut robot);
                in_time
            });
        }
        robot.poll();
        assert!(robot.seen.tension_n[..3].iter().all(|tension| *tension > 1.0), "{:?}", robot.seen.tension_n);
    });
}

/// The command itself: refusals before any request, faults that end by themselves, and processes that stand still for a
/// while.
#[test]
fn the_command_breaks_things_and_puts_them_right_again() {
    let nims = |domain: &str, args: &[&str]| {
        let output = Command::new(program()).args(["--domain", domain, "fault"]).args(args).output().unwrap();
        (output.status.code(), String::from_utf8_lossy(&[output.stdout, output.stderr].concat()).into_owned())
    };
    for args in [
        &["explode", "1"][..],
        &["stall", "1", "--for", "-2"],
        &["jump", "1", "50", "--for", "1"],
        &["kill"],
        &["nan"],
        &["frozen", "recorder"],
    ] {
        let (code, said) = nims("nobody", args);
        assert_eq!((code, said.trim().lines().count()), (Some(2), 1), "{args:?}: {said}");
    }
    assert_eq!(nims("nobody", &["list"]), (Some(0), page()));
    let (code, said) = nims("nobody", &["stall", "1"]);
    // The command that helps.
    assert!(code == Some(1) && said.contains("nims up"), "{said}");

    let mut robot = Robot::up("");
    let domain = robot.domain.name().to_owned();
    robot.ask("motor-io", Request::Arm);
    let (code, said) = nims(&domain, &["unplug", "1", "--for", "0.7"]);
    assert_eq!(code, Some(0), "{said}");
    robot.until("the fault", |robot| robot.last.faults & MotorAuthority::FAULT_LOST_UNIT != 0);
    robot.reset();
    let (code, said) = nims(&domain, &["slow", "estimator", "5", "--for", "0.1"]);
    assert_eq!(code, Some(0), "{said}");
    let (code, said) = nims(&domain, &["slow", "controller", "many"]);
    assert!(code == Some(2) && said.trim().lines().count() == 1, "{said}");
    let (code, said) = nims(&domain, &["stall", "7"]);
    assert!(code == Some(2) && said.trim().lines().count() == 1, "{said}");
    let (code, said) = nims(&domain, &["stop", "nothing"]);
    assert!(code == Some(2) && said.contains("controller"), "{said}");
    let mut requests = robot.bus.subscriber::<OperatorRequest>("operator/request").unwrap();
    let (code, said) = nims(&domain, &["stop", "controller", "--for", "0.3"]);
    assert_eq!(code, Some(0), "{said}");
    // Signals reach a process without a request, and are on record all the same.
    let requests = std::iter::from_fn(|| requests.receive().unwrap()).filter(|request| request.answered == 1);
    let asked: Vec<String> = requests.map(|request| text_of(&request.text)).collect();
    assert!(asked.ends_with(&["stop controller", "continue controller"].map(str::to_owned)), "{asked:?}");
}
