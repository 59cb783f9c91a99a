//! The running robot: `nims up` on the virtual motor box, missions, and the death of each process.
//!
//! `NIMS_DRIFT_S=60` sets for how long the robot without a controller hangs, s.

use crate::robot::{FOUR_CABLES, GOAL, Robot, THREE_CABLES, program, steadily};
use bus::clock;
use cable_robot::CableVec;
use config::SystemFile;
use messages::{MotorAuthority, RecorderStatus, Request, TruthNode};
use nims_tests::drift::drift_m;
use rustix::process::Signal;
use serde_json::Value;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

/// The drives' watchdog in the system file, s, and the speed of the moves below, m/s.
const WATCHDOG_S: f64 = 0.3;
const SPEED_M_S: f64 = 0.2;
/// Ten steps of the encoder: less motion than that in 0.3 s is holding.
const STILL_M: f64 = 0.001;
/// Amplitude with which the node swings on its cables after a stop.
const SWING_M: f64 = 0.01;
/// Acceleration limit of the robot file, m/s², and the control period of the system file, s.
const ACCELERATION_M_S2: f64 = 0.5;
const PERIOD_S: f64 = 0.01;
/// A stop is commanded within so many cycles of the first one without a command.
const STOP_CYCLES: u64 = 3;
/// Additional cycles if the computer had no time for the robot in one of them.
const HICCUP_CYCLES: u64 = 8;

/// Started with that system file, armed, and in motion.
fn in_flight(file: &'static str, more: &str) -> Robot {
    let mut robot = Robot::up_with(file, more, |_| ());
    robot.arm();
    robot.fly_at(SPEED_M_S);
    robot
}

fn taut(robot: &Robot) -> bool {
    let cables = usize::from(robot.seen.cable_count);
    cables >= 3 && robot.seen.tension_n[..cables].iter().all(|tension| *tension > 1.0)
}

/// Waits until no drum turns. The node itself swings on the elastic cables by a millimetre or so for some seconds more.
fn until_still(robot: &mut Robot) {
    for _ in 0..40 {
        let before = robot.seen.length_m;
        std::thread::sleep(Duration::from_millis(300));
        robot.poll();
        if before.iter().zip(robot.seen.length_m).all(|(a, b)| (a - b).abs() < STILL_M) {
            return;
        }
    }
    panic!("the drums still turn\n{}", robot.printed());
}

/// Every run file is finished and sound.
fn files_are_closed(run: &Path) {
    let names: Vec<String> = std::fs::read_dir(run)
        .unwrap()
        .map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned())
        .collect();
    assert!(names.iter().any(|name| name == "run.mcap"), "{names:?}");
    assert!(!names.iter().any(|name| name.ends_with(".part")), "{names:?}");
    let report = runlog::info(run).unwrap();
    assert!(report.files.iter().all(|file| file.finished), "{report}");
    assert!(report.channels.iter().any(|channel| channel.name == "motor/state" && channel.messages > 100), "{report}");
}

/// Starts the same domain again; it ends by itself.
fn next_start_is_clean(robot: &Robot) {
    let again = robot.folder().join("again");
    let output = Command::new(program())
        .args(["up", "--domain", robot.domain.name(), "--for", "0.5", "--run"])
        .arg(&again)
        .arg(robot.system_file())
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    assert!(again.join("run.mcap").is_file());
}

/// Checks by the run file the time after the controller or the estimator was killed without a standby: a commanded stop
/// within so many cycles, no longer travel than that takes, no drift, taut cables.
fn stopped_in_time(run: &Path, body: &cable_robot::Robot, killed_ns: u64, drift_s: f64) {
    let after = |stamp_ns: u64| stamp_ns > killed_ns;
    let cycles: Vec<MotorAuthority> =
        runlog::read_channel(run, "motor/authority").unwrap().into_iter().map(|(_, sample)| sample).collect();
    let begin = cycles.iter().position(|cycle| after(cycle.header.stamp_ns)).unwrap();
    let (before, cycles) = (cycles[begin - 1], &cycles[begin..]);
    let first = cycles.iter().position(|cycle| cycle.unsteered() > before.unsteered()).unwrap();
    let stop = cycles.iter().position(|cycle| cycle.mode != MotorAuthority::MODE_FOLLOWING).unwrap();
    // The cycle that was under way, and the one whose command had already arrived.
    assert!(first <= 2, "{first} cycles until one is without an answer");
    // If the drives gave no readings in the cycle before, there was nothing to answer to.
    let until = |index: usize| if index == 0 { before.lost_on_ports() } else { cycles[index - 1].lost_on_ports() };
    let unread = until(stop) - until(first);
    let missing = cycles[stop].header.cycle - cycles[first].header.cycle + 1 - unread;
    // During a delay of the computer, which is then named, the robot waits briefly.
    let hiccup = cycles[..=stop].iter().any(|cycle| cycle.faults & MotorAuthority::FAULT_COMPUTER != 0);
    let allowed = if hiccup { STOP_CYCLES + HICCUP_CYCLES } else { STOP_CYCLES };
    assert!(missing <= allowed, "the stop is commanded in cycle {missing} without a command");

    let truth: Vec<TruthNode> =
        runlog::read_channel(run, "truth/node").unwrap().into_iter().map(|(_, sample)| sample).collect();
    let (earlier, later): (Vec<_>, Vec<_>) = truth.into_iter().partition(|sample| !after(sample.header.stamp_ns));
    let start = earlier.last().unwrap();
    let speed = start.velocity_m_s.iter().map(|v| v * v).sum::<f64>().sqrt();
    let still_ns = cycles[stop].header.stamp_ns + 1_500_000_000;
    // If motor-io itself stood still, the drives kept moving for that long.
    let frozen_s: f64 = cycles[..stop + 50]
        .windows(2)
        .map(|two| (two[1].header.stamp_ns - two[0].header.stamp_ns) as f64 * 1e-9 - 1.5 * PERIOD_S)
        .map(|late_s| late_s.max(0.0))
        .sum();
    let bound = speed * speed / (2.0 * ACCELERATION_M_S2) + (3.0 * PERIOD_S + frozen_s) * speed + 0.01;
    let far = |from: &[f64; 3], to: &[f64; 3]| from.iter().zip(to).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
    let travel = later
        .iter()
        .take_while(|sample| sample.header.stamp_ns < still_ns)
        .fold(0.0, |most: f64, sample| most.max(far(&start.position_m, &sample.position_m)));
    assert!(travel <= bound, "{travel} m, allowed {bound} m at {speed} m/s");

    let held = later.iter().filter(|sample| sample.header.stamp_ns > still_ns);
    let lengths: Vec<_> =
        held.map(|sample| CableVec::from_array8(&sample.length_m, usize::from(sample.cable_count))).collect();
    assert!(lengths.len() as f64 > 80.0 * drift_s, "{} samples of {drift_s} s", lengths.len());
    let drift = drift_m(body, &lengths).unwrap();
    assert!(drift <= 0.02 * drift_s / 60.0, "{drift} m of drift in {drift_s} s");
    let least = later
        .iter()
        .flat_map(|sample| &sample.tension_n[..usize::from(sample.cable_count)])
        .copied()
        .fold(f64::MAX, f64::min);
    assert!(least > 1.0, "a cable at {least} N");
    println!(
        "{speed:.3} m/s: the first one lost {first} cycles after the kill, the stop commanded in cycle {missing} without a command, {:.1} mm of \
         travel (allowed {:.1}), {:.2} mm of drift in {drift_s} s, least tension {least:.1} N",
        1e3 * travel,
        1e3 * bound,
        1e3 * drift
    );
}

#[test]
fn a_move_is_flown_and_ctrl_c_in_the_next_leaves_a_held_robot_and_a_closed_file() {
    steadily(|| {
        let mut robot = Robot::up("");
        let file = robot.system_file();
        let pid = robot.supervisor_pid().to_string();
        assert_eq!(robot.refused(&["up", file.to_str().unwrap()], &[&pid]), Some(2));
        // Nothing moves before it is armed, and the refusal gives the reason.
        assert_eq!(robot.refused(&["goto", "5.0,3.2,0.5"], &[]), Some(1));

        robot.arm();
        robot.fly_at(SPEED_M_S);
        // A position outside the workspace is bad input in any mode.
        assert_eq!(robot.refused(&["goto", "5.0,3.2,9.5"], &[]), Some(2));
        robot.arrive();
        robot.for_cycles(30);
        assert!(robot.distance_m(GOAL) < SWING_M, "{} m from the goal", robot.distance_m(GOAL));

        let listed: Value = serde_json::from_str(&robot.accepted(&["channel", "list", "--json"])).unwrap();
        let channels = listed["channels"].as_array().unwrap();
        assert!(channels.iter().any(|channel| channel["name"] == "motor/state"), "{listed}");
        let counted = robot.accepted(&["channel", "hz", "motor/state", "--for", "1", "--json"]);
        let counted: Value = serde_json::from_str(&counted).unwrap();
        let hz = counted["channels"][0]["hz"].as_f64().unwrap();
        assert!(hz > 50.0 && hz < 120.0, "{counted}");
        let echoed = robot.accepted(&["channel", "echo", "motor/authority", "-n", "2"]);
        let lines: Vec<Value> = echoed.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
        assert_eq!(lines.len(), 2);
        assert_eq!(lines[0]["mode"], "MODE_HOLDING", "{}", lines[0]);

        robot.fly_at(SPEED_M_S);
        assert_eq!(robot.down(Signal::INT), Some(0), "{}", robot.printed());
        let answer = robot.answer();
        assert_eq!(answer["mode"], "holding", "{answer}\n{}", robot.printed());
        files_are_closed(&robot.run());
        // The file ends with a robot that holds on taut cables.
        let truth = runlog::read_channel::<TruthNode>(&robot.run(), "truth/node").unwrap();
        let (earlier, last) = (truth[truth.len() - 10].1, truth.last().unwrap().1);
        let still = earlier.length_m.iter().zip(last.length_m).all(|(a, b)| (a - b).abs() < STILL_M);
        assert!(still, "{earlier:?} {last:?}");
        robot.seen = last;
        assert!(taut(&robot), "{last:?}");
        next_start_is_clean(&robot);
    });
}

#[test]
fn the_position_outlives_a_restart_but_has_to_be_confirmed() {
    steadily(|| {
        let mut robot = in_flight(THREE_CABLES, "");
        robot.arrive();
        robot.for_cycles(100);
        assert_eq!(robot.down(Signal::INT), Some(0), "{}", robot.printed());
        // The virtual motor box starts the node at the position in its file, so the file gets the last position.
        robot.change_system(|text| {
            assert!(text.contains("start_m = [4.8, 3.0, 0.3]"));
            text.replace("start_m = [4.8, 3.0, 0.3]", "start_m = [5.4, 3.6, 0.7]")
        });
        robot.up_again("");
        robot.ask("motor-io", Request::Arm);
        robot.poll();
        assert_eq!(robot.last.position_known, messages::MotorState::POSITION_RESTORED);
        assert_eq!(robot.refused(&["goto", "5.0,3.2,0.5"], &["confirm-position"]), Some(1));
        robot.accepted(&["confirm-position"]);
        let mut found = Vec::new();
        robot.until_reported("a position", |robot| robot.status()["position_m"].is_array());
        // A cycle without readings has no estimate.
        while found.is_empty() {
            let status = robot.status();
            found.extend(status["position_m"].as_array().into_iter().flatten().filter_map(Value::as_f64));
        }
        let off = found.iter().zip(GOAL).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
        assert!(off < 0.02, "{off} m from the last position");
        assert_eq!(robot.down(Signal::INT), Some(0), "{}", robot.printed());
    });
}

/// The active controller or estimator dies without a standby: stop on the path, hold.
fn stops_on_the_path(file: &'static str, name: &str, cause: u32) {
    let drift_s = std::env::var("NIMS_DRIFT_S").map_or(2.0, |seconds| seconds.parse().unwrap());
    steadily(|| {
        let mut robot = in_flight(file, "");
        robot.poll();
        let before = robot.named;
        let killed_ns = clock::now_ns();
        robot.signal(name, Signal::KILL);
        robot.until("the robot holds", |robot| {
            matches!(robot.last.mode, MotorAuthority::MODE_HOLDING | MotorAuthority::MODE_FAULTED)
        });
        assert_eq!(before, 0, "no fault before");
        assert_ne!(robot.named & cause, 0, "the cause is not named: faults {:#x}", robot.named);
        until_still(&mut robot);
        assert!(taut(&robot), "{:?}", robot.seen);
        assert!(robot.distance_m(GOAL) > 0.3, "the robot stopped on the path, not at its end");
        let place = robot.seen.position_m;
        std::thread::sleep(Duration::from_secs_f64(drift_s + 1.5));
        robot.poll();
        assert!(
            taut(&robot) && robot.distance_m(place) < SWING_M,
            "the node drifts: {place:?} {:?}",
            robot.seen.position_m
        );
        let reported = |line: &str| line.contains(name) && line.contains("signal 9");
        assert!(robot.printed().lines().any(reported), "{}", robot.printed());
        assert_eq!(robot.down(Signal::INT), Some(1), "nims up exits with success although {name} ended");
        files_are_closed(&robot.run());
        let body = SystemFile::load(&robot.system_file()).unwrap().robot_file().unwrap().robot().unwrap();
        stopped_in_time(&robot.run(), &body, killed_ns, drift_s);
        next_start_is_clean(&robot);
    });
}

#[test]
fn without_its_controller_the_robot_stops_on_the_path_and_holds() {
    stops_on_the_path(THREE_CABLES, "controller", MotorAuthority::FAULT_COMMAND_LOST);
}

#[test]
fn without_its_estimator_the_robot_stops_on_the_path_and_holds() {
    stops_on_the_path(THREE_CABLES, "estimator", MotorAuthority::FAULT_ESTIMATE_LOST);
}

#[test]
fn four_lines_stop_on_the_path_and_hold_without_their_controller() {
    stops_on_the_path(FOUR_CABLES, "controller", MotorAuthority::FAULT_COMMAND_LOST);
}

#[test]
fn a_controller_that_stands_still_is_as_good_as_dead_until_it_goes_on() {
    steadily(|| {
        let mut robot = in_flight(THREE_CABLES, "");
        robot.signal("controller", Signal::STOP);
        robot.until("the robot holds", |robot| robot.last.mode == MotorAuthority::MODE_HOLDING);
        assert_ne!(robot.named & MotorAuthority::FAULT_COMMAND_LOST, 0, "faults {:#x}", robot.named);
        until_still(&mut robot);
        assert!(taut(&robot) && robot.distance_m(GOAL) > 0.3, "{:?}", robot.seen);
        robot.until_reported("the missing heartbeat is reported", |robot| robot.state("controller") == "SILENT");
        robot.signal("controller", Signal::CONT);
        robot.until_reported("the return is reported", |robot| robot.state("controller") == "ready");
        assert_eq!(robot.down(Signal::INT), Some(0), "no process ended: {}", robot.printed());
        files_are_closed(&robot.run());
    });
}

#[test]
fn an_emergency_stop_waits_aloud_for_a_motor_io_that_stands_still() {
    steadily(|| {
        let mut robot = in_flight(THREE_CABLES, "");
        robot.signal("motor-io", Signal::STOP);
        let said = robot.folder().join("estop.stderr");
        let mut estop = Command::new(program())
            .args(["--domain", robot.domain.name(), "estop"])
            .stdout(Stdio::null())
            .stderr(std::fs::File::create(&said).unwrap())
            .spawn()
            .unwrap();
        robot.until_reported("the failed stop is reported", |_| {
            !std::fs::read_to_string(&said).unwrap_or_default().is_empty()
        });
        assert!(estop.try_wait().unwrap().is_none(), "the supervisor keeps trying");
        robot.signal("motor-io", Signal::CONT);
        robot.until("the emergency stop", |robot| robot.last.mode == MotorAuthority::MODE_EMERGENCY_STOP);
        assert!(estop.wait().unwrap().success(), "{}", std::fs::read_to_string(&said).unwrap());
        until_still(&mut robot);
        assert!(taut(&robot), "{:?}", robot.seen);
        robot.down(Signal::INT);
    });
}

#[test]
fn a_recorder_whose_file_cannot_grow_reports_it_and_starts_another_during_the_flight() {
    // A limit on the file size simulates a full disk; the shell ignores its signal for the recorder.
    let recorder = program().with_file_name("recorder");
    let more = format!(
        "\n[[process]]\nname = \"recorder\"\nrole = \"recorder\"\ncommand = ['/bin/sh', '-c', 'trap \"\" XFSZ; exec \"$0\" \"$@\"', '{}']\n",
        recorder.display()
    );
    steadily(|| {
        let mut robot = in_flight(THREE_CABLES, &more);
        let pid = robot.pid("recorder").unwrap().to_string();
        let limit = |bytes: &str| {
            let set = Command::new("prlimit").args(["--pid", &pid, &format!("--fsize={bytes}:")]).status();
            assert!(set.unwrap().success(), "prlimit of util-linux is needed");
        };
        limit("1000");
        for wanted in [RecorderStatus::STATE_FAILED, RecorderStatus::STATE_RECORDING] {
            robot.until_recorder(wanted);
            limit("unlimited");
        }
        robot.arrive();
        assert_eq!(robot.named & messages::faults::HARD, 0, "the robot has faults: {:#x}", robot.named);
        assert!(robot.distance_m(GOAL) < SWING_M, "{} m from the goal", robot.distance_m(GOAL));
        assert_eq!(robot.down(Signal::INT), Some(1), "a part of the run is lost: {}", robot.printed());
        assert_eq!(robot.answer()["unrecorded"].as_array().map(Vec::len), Some(1), "{}", robot.answer());
        assert!(robot.run().join("run-0002.mcap").is_file());
        files_are_closed(&robot.run());
    });
}

#[test]
fn without_its_planner_the_robot_finishes_the_segment_and_holds() {
    steadily(|| {
        let mut robot = in_flight(THREE_CABLES, "");
        robot.signal("planner", Signal::KILL);
        robot.arrive();
        until_still(&mut robot);
        let off = robot.distance_m(GOAL);
        assert!(off < SWING_M && taut(&robot), "{off} m from the end of the segment");
        robot.down(Signal::INT);
        files_are_closed(&robot.run());
        next_start_is_clean(&robot);
    });
}

#[test]
fn without_its_recorder_the_mission_goes_on_and_a_new_file_begins() {
    steadily(|| {
        let mut robot = in_flight(THREE_CABLES, "");
        robot.signal("recorder", Signal::KILL);
        robot.until_reported("it is restarted", |robot| {
            robot.row("recorder").is_some_and(|row| row["restarts"] == 1 && row["state"] == "ready")
        });
        robot.arrive();
        assert!(robot.distance_m(GOAL) < SWING_M, "{} m from the goal", robot.distance_m(GOAL));
        let second = robot.run().join("run-0002.mcap");
        robot.until_reported("it records again", |_| second.with_extension("mcap.part").exists());
        robot.down(Signal::INT);
        files_are_closed(&robot.run());
        assert!(second.is_file());
        next_start_is_clean(&robot);
    });
}

#[test]
fn without_motor_io_the_drives_stop_the_motors() {
    steadily(|| {
        let mut robot = in_flight(THREE_CABLES, "");
        robot.until("the node is fast", |robot| robot.speed_m_s() > 0.15);
        robot.signal("motor-io", Signal::KILL);
        robot.poll();
        let place = robot.seen.position_m;
        std::thread::sleep(Duration::from_secs_f64(WATCHDOG_S + 1.5));
        robot.poll();
        let travel = robot.distance_m(place);
        println!("travel after the kill: {:.1} mm", 1e3 * travel);
        // The gears of this robot hold an unpowered cable, so nothing sinks afterwards.
        assert!(travel < WATCHDOG_S * SPEED_M_S + 0.01, "{travel} m");
        until_still(&mut robot);
        assert!(taut(&robot), "{:?}", robot.seen);
        robot.until_reported("the loss is reported", |robot| robot.state("motor-io") == "DIED");
        // The text itself: the cure is the one while `nims up` runs, which rejects a second one; its log is no cause.
        let said = robot.printed();
        let loss = said.lines().find(|line| line.contains("`nims restart motor-io`"));
        assert!(loss.is_some_and(|line| !line.contains("(INFO")), "{said}");
        let status = robot.status();
        assert_ne!(status["mission"]["state"], "running", "{status}");
        assert_eq!(robot.down(Signal::INT), Some(1));
        files_are_closed(&robot.run());
        next_start_is_clean(&robot);
    });
}

#[test]
fn a_planar_robot_that_floats_flies() {
    steadily(|| {
        let mut robot = Robot::up_with("aq4", "", |_| ());
        robot.ask("motor-io", Request::Arm);
        robot.accepted(&["zero", "--at", "4.0,2.0"]);
        robot.until("holding", |robot| robot.last.mode == MotorAuthority::MODE_HOLDING);
        robot.until_reported("the move is accepted", |robot| robot.nims(&["goto", "4.8,2.4"]).status.success());
        robot.until("it moves", |robot| robot.last.mode == MotorAuthority::MODE_FOLLOWING);
        robot.arrive();
        assert!(robot.distance_m([4.8, 0.0, 2.4]) < SWING_M, "{:?}", robot.seen.position_m);
        assert!(robot.seen.tension_n[..4].iter().all(|tension| *tension > 1.0), "{:?}", robot.seen.tension_n);
    });
}

#[test]
fn without_motor_io_cables_run_out_at_the_speed_that_check_computes() {
    steadily(|| {
        let mut robot = Robot::up_with(THREE_CABLES, "", |configs| {
            let path = configs.join("robots/lab3.toml");
            let text = std::fs::read_to_string(&path).unwrap();
            std::fs::write(&path, text.replace("gear_friction = 0.85 ", "gear_friction = 0.0 ")).unwrap();
        });
        let said = robot.accepted(&["check", robot.system_file().to_str().unwrap()]);
        // The first speed that it states is that of an unwinding cable.
        let (before, _) = said.split_once(" mm/s").expect("nims check warns of unwinding");
        let announced_m_s = 1e-3 * before.rsplit(' ').next().unwrap().parse::<f64>().unwrap();
        robot.arm();
        robot.until("holding", |robot| robot.last.mode == MotorAuthority::MODE_HOLDING);
        robot.signal("motor-io", Signal::KILL);
        std::thread::sleep(Duration::from_secs_f64(WATCHDOG_S + 1.0));
        robot.poll();
        let before = robot.seen;
        std::thread::sleep(Duration::from_secs(2));
        robot.poll();
        let seconds = 1e-9 * (robot.seen.header.stamp_ns - before.header.stamp_ns) as f64;
        let run_out = |i: usize| (robot.seen.length_m[i] - before.length_m[i]) / seconds;
        let fastest_m_s = (0..3).map(run_out).fold(0.0, f64::max);
        println!("a cable unwinds at {:.1} mm/s; check computes {:.1}", 1e3 * fastest_m_s, 1e3 * announced_m_s);
        // `nims check` reports it for the middle of the volume, where the cables are steeper.
        assert!((0.5..1.5).contains(&(fastest_m_s / announced_m_s)), "{fastest_m_s} of {announced_m_s} m/s");
        assert!(taut(&robot), "{:?}", robot.seen);
    });
}

#[test]
fn processes_outside_the_control_cycle_die_without_effect_on_the_flight() {
    steadily(|| {
        let process = |name: &str| {
            format!("\n[[process]]\nname = \"{name}\"\ncommand = [\"{name}\", \"--system\", \"{{system}}\"]\n")
        };
        let mut robot = in_flight(THREE_CABLES, &["visualization", "sensor-logger"].map(process).concat());
        robot.accepted(&["plug", "soil", "--", "my-sensor"]);
        for name in ["visualization", "sensor-logger", "soil"] {
            robot.until_reported("it runs", |robot| robot.pid(name).is_some());
            robot.signal(name, Signal::KILL);
            let lost = |line: &str| line.contains(name) && line.contains("signal 9");
            robot.until_reported("the loss is reported", |robot| robot.printed().lines().any(lost));
            assert_eq!(robot.last.mode, MotorAuthority::MODE_FOLLOWING, "after the death of {name}");
        }
        let mut watcher = Command::new(program());
        watcher.args(["--domain", robot.domain.name(), "channel", "echo", "motor/state"]);
        let mut watcher = watcher.stdout(Stdio::null()).spawn().unwrap();
        let pid = watcher.id();
        robot.until_reported("it watches", |robot| robot.domain.alive().iter().any(|node| node.pid == pid));
        robot.for_cycles(20);
        watcher.kill().unwrap();
        watcher.wait().unwrap();
        robot.arrive();
        assert!(robot.distance_m(GOAL) < SWING_M, "{} m from the goal", robot.distance_m(GOAL));
        // No process joins meanwhile, and the supervisor has not started the observer.
        robot.until_reported("the supervisor removes it", |robot| robot.domain.dead() == 0);
    });
}

#[test]
fn without_its_supervisor_the_robot_stops_and_the_next_one_cleans_up() {
    steadily(|| {
        let mut robot = in_flight(THREE_CABLES, "");
        let children: Vec<u32> =
            ["motor-io", "controller", "recorder"].iter().filter_map(|name| robot.pid(name)).collect();
        assert_eq!(children.len(), 3);
        robot.down(Signal::KILL);
        robot.until("the robot holds", |robot| robot.last.mode != MotorAuthority::MODE_FOLLOWING);
        until_still(&mut robot);
        assert!(taut(&robot));
        next_start_is_clean(&robot);
        for pid in children {
            let state = std::fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
            assert!(state.is_empty() || state.contains(") Z"), "process {pid} is still there: {state}");
        }
        // The orphaned recorder received the request to end.
        files_are_closed(&robot.run());
    });
}
