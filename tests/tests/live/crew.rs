//! The processes of a running robot: started, ended, restarted, plugged in and unplugged by the operator, and their
//! states.

use crate::robot::{Robot, THREE_CABLES, steadily};
use messages::{MotorAuthority, SlotRole};
use robot_state::answers::{Reason, detail};
use rustix::process::Signal;

/// Its id in the process table; 0 if it has none.
fn pid(robot: &Robot, name: &str) -> u32 {
    robot.pid_in_table(name).unwrap_or(0)
}

/// Programs on the bus other than this test.
fn others(robot: &Robot) -> Vec<String> {
    robot.domain.alive().into_iter().map(|node| node.name).filter(|name| name != "observer").collect()
}

fn lives(pid: u32) -> bool {
    let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
    !stat.is_empty() && !stat.contains(") Z")
}

fn begin(more: &str) -> Robot {
    Robot::begin(THREE_CABLES, more, |_| ())
}

fn ready(more: &str) -> Robot {
    let mut robot = Robot::up(more);
    // The supervisor's own report, because a start prints it after everything else.
    robot.until_reported("it is ready", |robot| robot.printed().contains("Ctrl-C"));
    robot
}

#[test]
fn processes_come_and_go_while_the_robot_runs() {
    let mut up = ready("");
    // A run that is cut off still names its programs, because the manifest is written at the start.
    let manifest = std::fs::read_to_string(up.run().join("manifest.json")).unwrap();
    let manifest: serde_json::Value = serde_json::from_str(&manifest).unwrap();
    let processes = manifest["processes"].as_array().unwrap();
    assert!(processes.len() >= 6 && processes.iter().all(|process| process["version"].is_string()), "{manifest:#}");
    assert!(manifest["ended_utc"].is_null());
    // A second controller beside the first one, in the free slot.
    up.accepted(&["start", "controller"]);
    assert_eq!(up.state("controller-b"), "ready");
    assert_eq!(up.state("controller"), "ready");
    assert_eq!(up.rejected(&["start", "controller"]), Reason::SlotsTaken { role: SlotRole::Controller });
    let second = pid(&up, "controller-b");
    let runs = Reason::ProcessRunning { process: detail("controller-b"), pid: second };
    assert_eq!(up.rejected(&["start", "controller", "--slot", "b"]), runs);
    up.accepted(&["stop-process", "controller-b"]);
    assert_eq!(up.state("controller-b"), "stopped");
    assert!(!lives(second));
    let stopped = Reason::ProcessNotRunning { process: detail("controller-b") };
    assert_eq!(up.rejected(&["stop-process", "controller-b"]), stopped);

    // An ended one returns under the same name, with another id.
    let planner = pid(&up, "planner");
    up.accepted(&["restart", "planner"]);
    assert!(pid(&up, "planner") != planner && !lives(planner));
    assert_eq!(up.state("planner"), "ready");

    // Programs that are not in the system file.
    std::fs::write(up.folder().join("sensor.sh"), "echo $1 > plugged; exec sleep 1000\n").unwrap();
    up.accepted(&["plug", "wind", "--", "sh", "sensor.sh", "{name}/{domain}"]);
    assert_eq!(up.state("wind"), "running", "a process without heartbeats is not reported as ready");
    let plugged = std::fs::read_to_string(up.folder().join("plugged")).unwrap();
    assert_eq!(plugged.trim(), format!("wind/{}", up.domain.name()));
    let wind = pid(&up, "wind");
    let plug = |name: &str, program: &str| up.rejected(&["plug", name, "--", program, "1000"]);
    assert_eq!(plug("wind", "sleep"), Reason::NameRuns { process: detail("wind") });
    assert!(matches!(plug("planner", "sleep"), Reason::NameTaken { process } if process == detail("planner")));
    assert!(matches!(plug("Wind!", "sleep"), Reason::NameInvalid { .. }));
    for program in ["no-such-program", "./sensor"] {
        let reason = plug("rain", program);
        assert!(
            matches!(reason, Reason::NoProgram { program: named, .. } if named.ends_with(&program[1..])),
            "{reason}"
        );
    }
    assert!(matches!(up.rejected(&["unplug", "planner"]), Reason::NotPluggable { .. }));
    assert!(
        matches!(up.rejected(&["unplug", "rain"]), Reason::UnknownProcess { process, .. } if process == detail("rain"))
    );
    assert!(matches!(up.rejected(&["stop-process", "nosuch"]), Reason::UnknownProcess { .. }));
    up.accepted(&["unplug", "wind"]);
    assert_eq!(up.state("wind"), "no row");
    assert!(!lives(wind));
    assert_eq!(up.down(Signal::INT), Some(0), "no process has ended: {}", up.printed());
    // The run and its file name what was plugged in.
    let kept = up.run().join("processes/1-wind-sensor.sh");
    let original = std::fs::read(up.folder().join("sensor.sh")).unwrap();
    assert_eq!(std::fs::read(&kept).unwrap(), original);
    let attachments = runlog::info(&up.run()).unwrap().attachments;
    assert!(attachments.contains(&"processes/1-wind-sensor.sh".to_owned()), "{attachments:?}");
}

#[test]
fn a_plugged_program_that_ends_at_once_is_reported_with_its_cause() {
    let mut up = ready("");
    let failing = ["plug", "rain", "--", "sh", "-c", "echo the gauge is not there >&2; exit 3"];
    up.refused(&failing, &["rain", "3", "the gauge is not there"]);
    assert_eq!(up.state("rain"), "DIED");
    // The name is free again.
    up.accepted(&["plug", "rain", "--", "sleep", "1000"]);
    assert_eq!(up.down(Signal::INT), Some(1), "nims up exits with success although rain ended");
}

#[test]
fn processes_in_charge_are_not_ended_during_a_motion() {
    steadily(|| {
        let mut up = ready("");
        up.arm();
        up.fly();
        for name in ["controller", "estimator", "motor-io", "motor-box"] {
            for command in ["stop-process", "restart"] {
                let reason = up.rejected(&[command, name]);
                assert!(matches!(reason, Reason::ProcessNeeded { process, .. } if process == detail(name)), "{reason}");
            }
        }
        up.accepted(&["hold"]);
        up.until("it holds", |up| up.last.mode == MotorAuthority::MODE_HOLDING);
        up.accepted(&["restart", "controller"]);
        assert_eq!(up.state("controller"), "ready");
        assert_eq!(up.down(Signal::INT), Some(0), "{}", up.printed());
    });
}

#[test]
fn a_standby_is_kept_and_a_dead_one_is_started_again() {
    let more = "\n[[process]]\nname = \"second\"\nrole = \"controller\"\nstandby = true\nrestart_pause_s = 0.1\n\
                \n[[process]]\nname = \"spare\"\nrole = \"estimator\"\nstart = false\n\
                \n[[process]]\nname = \"flaky\"\ncommand = [\"sh\", \"-c\", \"sleep 0.05; exit 7\"]\nrestart = true\nrestart_pause_s = 0.1\nrestart_limit = 2\n";
    let mut up = ready(more);
    assert_eq!(up.state("controller-b"), "ready");
    assert_eq!(up.state("spare"), "stopped", "the process starts only on request");
    for name in ["controller", "controller-b"] {
        let before = pid(&up, name);
        up.signal(name, Signal::KILL);
        up.until_reported("the controller is restarted", |up| up.state(name) == "ready" && pid(up, name) != before);
    }
    // By its name in the system file too.
    up.accepted(&["restart", "second"]);
    up.accepted(&["start", "spare"]);
    assert_eq!(up.state("estimator-b"), "ready");
    assert_eq!(up.state("spare"), "no row", "the process has the name of its slot");
    // A process that keeps dying is not restarted.
    up.until_reported("flaky is no longer restarted", |up| up.state("flaky") == "DIED for good");
    assert_eq!(up.row("flaky").unwrap()["restarts"], 2, "{}", up.printed());
    assert_eq!(up.down(Signal::INT), Some(1));
}

#[test]
fn a_process_that_does_not_get_ready_is_named_and_nothing_is_left_behind() {
    let mut up =
        begin("\n[[process]]\nname = \"planner\"\nrole = \"planner\"\ncommand = [\"sh\", \"-c\", \"sleep 1000\"]\n");
    up.until_reported("the process is named", |up| up.printed().contains("planner"));
    assert_eq!(up.down(Signal::INT), Some(1));
    assert_eq!(others(&up), [""; 0]);

    drop(up);
    let mut up = begin(
        "\n[[process]]\nname = \"planner\"\nrole = \"planner\"\ncommand = [\"sh\", \"-c\", \"echo no maps >&2; exit 1\"]\n",
    );
    assert_eq!(up.ended(), Some(1), "{}", up.printed());
    // The cause is what the program itself printed.
    assert!(up.printed().lines().any(|line| line.contains("planner") && line.contains("no maps")), "{}", up.printed());
    assert_eq!(others(&up), [""; 0]);
}

#[test]
fn a_closed_terminal_is_an_orderly_end() {
    let mut up = ready("");
    assert_eq!(up.down(Signal::HUP), Some(0), "{}", up.printed());
    assert_eq!(others(&up), [""; 0]);
    assert!(up.run().join("run.mcap").is_file());
}
