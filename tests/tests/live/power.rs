//! The power fails during a mission, and the disk fills: the loss is known and small, and the robot starts with a
//! correct state.

use crate::robot::{GOAL, Robot, START, goto, program, steadily};
use messages::{MotorAuthority, MotorState, RecorderStatus, Request};
use robot_state::answers::Reason;
use rustix::process::Signal;
use std::collections::BTreeSet;
use std::path::Path;
use std::process::Command;

/// A second of control cycles.
const SECOND: u64 = 100;
/// Tolerance for equal lengths, m: a multiple of an encoder's step of 0.1 mm.
const SAME_M: f64 = 0.002;

fn cycles_in(run: &Path) -> BTreeSet<u64> {
    let samples = runlog::read_channel::<MotorState>(run, "motor/state").unwrap();
    samples.iter().map(|(_, sample)| sample.header.cycle).collect()
}

/// Up to the last second, the run file has every cycle that was published on the bus.
fn is_whole(run: &Path, seen: &[MotorState]) {
    let recorded = cycles_in(run);
    let (first, last) = (seen[0].header.cycle, seen.last().unwrap().header.cycle);
    let kept = *recorded.last().unwrap();
    println!("{}: recorded to cycle {kept}, seen to {last}", run.display());
    assert!(kept + SECOND >= last, "more than a second is lost: {kept} of {last}");
    let missing: Vec<u64> = seen
        .iter()
        .map(|state| state.header.cycle)
        .filter(|cycle| *cycle <= kept && !recorded.contains(cycle))
        .collect();
    assert!(missing.is_empty(), "cycles {first} to {kept} are incomplete: {missing:?}");
    assert!(runlog::info(run).unwrap().files.iter().all(|file| file.finished));
}

#[test]
fn a_power_cut_in_flight_loses_less_than_a_second_and_never_the_position_silently() {
    steadily(|| {
        let mut robot = Robot::up("");
        let mut states = robot.bus.deep_subscriber::<MotorState>("motor/state").unwrap();
        robot.arm();
        robot.fly();
        // A random instant within a second and a half.
        let wait = u64::from(bus::clock::unix_ns() as u32) % (SECOND * 3 / 2);
        let until = robot.last.header.cycle + wait;
        robot.until("the instant", |robot| robot.last.header.cycle >= until);
        assert_eq!(robot.last.mode, MotorAuthority::MODE_FOLLOWING);
        robot.kill_all();
        let mut seen = Vec::new();
        while let Some(state) = states.receive().unwrap() {
            seen.push(state);
        }
        println!("cut after {wait} cycles; {} cycles seen", seen.len());

        // By hand, on a copy of the folder.
        let run = robot.run();
        let home = robot.folder().join("home");
        std::fs::create_dir(&home).unwrap();
        let part = home.join("run.mcap.part");
        std::fs::copy(run.join("run.mcap.part"), &part).unwrap();
        let recovered = Command::new(program()).arg("recover").arg(&part).output().unwrap();
        assert!(recovered.status.success(), "{}", String::from_utf8_lossy(&recovered.stderr));
        is_whole(&home, &seen);

        // A power cut erases shared memory, including the list of processes.
        robot.forget();
        // By the next start, which also reports where the robot is believed to be, and that this is unconfirmed.
        robot.up_again("");
        // The old ports ended with the old processes.
        let mut states = robot.bus.deep_subscriber::<MotorState>("motor/state").unwrap();
        let cycle = robot.last.header.cycle + 5;
        robot.until("some cycles more", |robot| robot.last.header.cycle > cycle);
        robot.until_reported("the earlier run is recovered", |_| {
            runlog::info(&run).is_ok_and(|report| report.files.iter().all(|file| file.finished))
        });
        is_whole(&run, &seen);
        assert_eq!(robot.last.mode, MotorAuthority::MODE_DISARMED, "the robot is disarmed after a restart");
        assert_eq!(robot.last.position_known, MotorState::POSITION_RESTORED);
        let mut now = None;
        while let Some(state) = states.receive().unwrap() {
            now = Some(state);
        }
        let now = now.expect("the new motor-io publishes on the same channel");
        let apart = |then: &MotorState| {
            then.length_m[..3].iter().zip(now.length_m).fold(0.0, |most: f64, (then, now)| most.max((then - now).abs()))
        };
        let nearest = seen.iter().map(apart).fold(f64::INFINITY, f64::min);
        assert!(nearest < SAME_M, "the lengths match no cycle before the power cut: {nearest} m");
        assert_eq!(robot.reason("motor-io", &Request::Arm), Some(Reason::ArmedRestored));
        let refused = robot.reason("planner", &goto([5.0, 3.2, 0.5], 0.1));
        assert_eq!(refused, Some(Reason::PositionRestored), "the robot moves with an unconfirmed position");
        robot.ask("motor-io", Request::ConfirmPosition);
        robot.until("a confirmed position", |robot| robot.last.position_known == MotorState::POSITION_KNOWN);
    });
}

#[test]
fn a_disk_that_fills_in_flight_ends_the_recording_aloud_and_not_the_mission() {
    steadily(|| {
        let place = tempfile::tempdir().unwrap();
        let free = runlog::free_bytes(place.path()).unwrap();
        // The disk is full after so many more bytes; other programs of the machine use less in these seconds.
        let room = (free / 4).min(200_000_000);
        let mut robot = Robot::up(&format!("\n[recorder]\nmin_free_bytes = {}\n", free - room));
        robot.arm();
        robot.fly();
        robot.until_recorder(RecorderStatus::STATE_RECORDING);
        let filler = place.path().join("filler");
        let filled = Command::new("fallocate").args(["--length", &(2 * room).to_string()]).arg(&filler).status();
        assert!(filled.unwrap().success(), "fallocate of util-linux is needed");
        robot.until_recorder(RecorderStatus::STATE_DISK_FULL);
        robot.arrive();
        assert_eq!(robot.last.faults, 0);
        std::fs::remove_file(&filler).unwrap();
        assert!(
            runlog::info(&robot.run()).unwrap().files.iter().all(|file| file.finished),
            "the file is closed in order"
        );
    });
}

#[test]
fn a_mission_continues_after_a_power_cut_without_repeating_finished_legs() {
    steadily(|| {
        let mut robot = Robot::up("");
        let mission =
            format!("name = \"over\"\nspeed_m_s = 0.15\n[[leg]]\npolyline = {{ points_m = [{GOAL:?}, {START:?}] }}\n");
        let file = robot.folder().join("configs/missions/over.toml");
        std::fs::write(&file, &mission).unwrap();
        robot.arm();
        robot.until_reported("the mission is accepted", |robot| robot.nims(&["run", "over"]).status.success());
        robot.until("more than half of the first line", |robot| robot.distance_m(START) > 0.5);
        robot.kill_all();
        robot.poll();
        let there = robot.seen.position_m;
        let before = robot.distance_m(START);
        // The virtual motor box starts the node at the position in its file: the last position.
        robot.change_system(|text| text.replace("start_m = [4.8, 3.0, 0.3]", &format!("start_m = {there:?}")));
        robot.up_again("");
        robot.ask("motor-io", Request::Arm);
        robot.ask("motor-io", Request::ZeroAt { position_m: there });
        robot.until_reported("the rest is accepted", |robot| {
            robot.nims(&["run", "over", "--continue"]).status.success()
        });
        robot.until("the first line's end", |robot| {
            assert!(robot.distance_m(START) > before - 0.1, "the robot flies a finished leg again");
            robot.distance_m(GOAL) < 0.02
        });
        robot.arrive();
        assert!(robot.distance_m(START) < 0.02, "{} m from the end", robot.distance_m(START));
        // Completed legs stay completed.
        robot.refused(&["run", "over", "--continue"], &[]);
        // The run has what was flown, even if the progress file is lost.
        std::fs::remove_file(&file).unwrap();
        assert_eq!(robot.down(Signal::INT), Some(0), "{}", robot.printed());
        assert_eq!(std::fs::read_to_string(robot.run().join("missions/1-over.toml")).unwrap(), mission);
        assert!(!robot.run().join("missions/2-over.toml").exists(), "what was refused was not flown");
        let kept = runlog::info(&robot.run()).unwrap().attachments;
        assert!(kept.contains(&"missions/1-over.toml".to_owned()), "{kept:?}");
    });
}
