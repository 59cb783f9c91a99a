//! A custom law and a custom estimator in Python, in programs of their own: first in the shadow, then in charge, at
//! 50 Hz.

use crate::robot::{Robot, THREE_CABLES, root, samples_of, steadily};
use messages::{
    CONTROLLERS, ESTIMATORS, MotorAuthority, MotorCommand, MotorSlots, NodeEstimate, SLOTS, SystemConfig, text_of,
};
use nims_tests::python;
use rustix::process::Signal;
use std::collections::HashMap;
use std::path::{Path, PathBuf};

/// Amplitude with which the node swings on its cables after a stop, m.
const SWING_M: f64 = 0.01;

/// A program of a role in slot b, beside the standard one.
fn beside(role: &str, program: &Path) -> String {
    let modules = root().join("scripts/python");
    let command = format!("env PYTHONPATH={} {} -B {}", modules.display(), python().display(), program.display());
    format!(
        "\n[[process]]\nname = \"mine\"\nrole = \"{role}\"\nslot = \"b\"\ncommand = [\"{role}\", \"--program\", {command:?}]\n"
    )
}

fn template(name: &str) -> PathBuf {
    root().join("scripts/templates").join(name)
}

/// A robot of three cables at 50 Hz.
fn slow(more: &str) -> Robot {
    Robot::up_with(THREE_CABLES, more, |configs| {
        let path = configs.join("systems/demo3.toml");
        let text = std::fs::read_to_string(&path).unwrap();
        assert!(text.contains("rate_hz = 100.0"));
        std::fs::write(&path, text.replacen("rate_hz = 100.0", "rate_hz = 50.0", 1)).unwrap();
    })
}

/// Puts what is in slot b in charge while the robot moves; a swap that the machine spoils is repeated.
fn swap(robot: &mut Robot, role: &str, kind: usize) {
    for _ in 0..5 {
        robot.until("it qualifies in flight", |robot| {
            robot.slots.phase[SLOTS * kind + 1] == MotorSlots::PHASE_QUALIFIED
                && robot.last.mode == MotorAuthority::MODE_FOLLOWING
        });
        if robot.nims(&["swap", role]).status.success() {
            return;
        }
    }
    panic!("five times no swap\n{}", robot.printed());
}

/// Flies with a program in slot b, which takes over on the way, and ends the robot.
fn fly(role: &str, kind: usize, program: &Path) -> Robot {
    let mut robot = slow(&beside(role, program));
    robot.until("the program", |robot| robot.slots.phase[SLOTS * kind + 1] != MotorSlots::PHASE_EMPTY);
    robot.arm();
    // Long enough to qualify and for 200 cycles in charge.
    robot.fly_at(0.07);
    swap(&mut robot, role, kind);
    robot.until("it is in charge", |robot| robot.slots.in_charge[kind] == 1);
    robot.for_cycles(200);
    assert_eq!(robot.slots.in_charge[kind], 1, "it has lost its place\n{}", robot.printed());
    robot.arrive();
    robot.for_cycles(25);
    let off_m = robot.distance_m(robot.goal);
    assert!(off_m < SWING_M, "{off_m} m from the goal");
    assert_eq!(robot.down(Signal::INT), Some(0), "{}", robot.printed());
    robot
}

#[test]
fn a_law_in_python_is_in_charge_after_it_kept_its_deadline_in_the_shadow() {
    steadily(|| judge(&fly("controller", CONTROLLERS, &template("law.py"))));
}

#[test]
fn an_estimator_in_python_is_in_charge_after_it_kept_its_deadline_in_the_shadow() {
    steadily(|| judge_estimator(&fly("estimator", ESTIMATORS, &template("estimator.py"))));
}

/// By the run file: no estimate of the program was valid before it was measured, and those in charge moved the robot.
fn judge_estimator(robot: &Robot) {
    let run = robot.run();
    let configs = samples_of::<SystemConfig>(&run, "system/config/estimator-b");
    let parameters = text_of(&configs.last().unwrap().parameters);
    assert!(parameters.contains("program = \"env ") && parameters.contains("alpha = 0.5"), "{parameters}");
    let estimates = samples_of::<NodeEstimate>(&run, "node/estimate/b");
    let unmeasured = estimates.iter().take_while(|estimate| estimate.valid == 0).count();
    assert!(
        unmeasured >= program_pipe::MEASURED_ANSWERS as usize,
        "{unmeasured} estimates before the first that counts"
    );
    let valid: HashMap<u64, u8> = estimates.iter().map(|estimate| (estimate.header.cycle, estimate.valid)).collect();
    let authorities = samples_of::<MotorAuthority>(&run, "motor/authority");
    let in_charge: Vec<&MotorAuthority> = authorities
        .iter()
        .filter(|sample| sample.mode == MotorAuthority::MODE_FOLLOWING && sample.active_estimator == 1)
        .collect();
    let answered = in_charge.iter().filter(|sample| valid.get(&(sample.header.cycle - 1)) == Some(&1)).count();
    let all = in_charge.len();
    println!("{answered} of {all} cycles in charge by an estimate of the program, {unmeasured} cycles measured before");
    assert!(all >= 200 && answered + 3 >= all, "{answered} of {all} cycles");
}

/// A program that no longer reads does not see that its pipe is closed.
#[test]
fn a_program_in_an_endless_loop_ends_with_the_controller_that_is_killed() {
    steadily(|| {
        let folder = tempfile::tempdir().unwrap();
        let program = folder.path().join("loop.py");
        let text =
            "import sys, time\nsys.stdin.readline()\nprint('{}', flush=True)\nwhile True:\n    time.sleep(0.01)\n";
        std::fs::write(&program, text).unwrap();
        let mut robot = slow(&beside("controller", &program));
        robot.until_reported("the controller", |robot| robot.pid("controller-b").is_some());
        let controller = robot.pid("controller-b").unwrap();
        // From here on the kernel ends it with its controller.
        let loops = |pid: &u32| {
            let command = std::fs::read_to_string(format!("/proc/{pid}/cmdline")).unwrap_or_default();
            command.split('\0').next().is_some_and(|program| program.ends_with("env") || program.contains("python"))
        };
        robot.until_reported("its program", |_| {
            let children = children(controller);
            !children.is_empty() && children.iter().all(loops)
        });
        let program = children(controller);
        robot.signal("controller-b", Signal::KILL);
        let is_gone = |pid: &u32| {
            let state = std::fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
            state.is_empty() || state.contains(") Z")
        };
        robot.until_reported("the program ends", |_| program.iter().all(is_gone));
    });
}

/// Processes that the threads of this one have started.
fn children(pid: u32) -> Vec<u32> {
    let threads = std::fs::read_dir(format!("/proc/{pid}/task")).into_iter().flatten().flatten();
    let lists = threads.filter_map(|thread| std::fs::read_to_string(thread.path().join("children")).ok());
    lists.flat_map(|list| list.split_whitespace().filter_map(|pid| pid.parse().ok()).collect::<Vec<u32>>()).collect()
}

/// By the run file: no answer of the program counted before it was measured, and those in charge moved the robot.
fn judge(robot: &Robot) {
    let run = robot.run();
    let configs = samples_of::<SystemConfig>(&run, "system/config/controller-b");
    let parameters = text_of(&configs.last().unwrap().parameters);
    assert!(parameters.contains("program = \"env ") && parameters.contains("gain_per_s = 1.5"));
    let commands = samples_of::<MotorCommand>(&run, "motor/command/b");
    // Without a segment the program is not asked.
    let asked: Vec<&MotorCommand> = commands.iter().filter(|command| command.segment != 0).collect();
    let unmeasured = asked.iter().take_while(|command| command.valid == [0; SLOTS]).count();
    assert!(unmeasured >= program_pipe::MEASURED_ANSWERS as usize, "{unmeasured} answers before the first that counts");
    let answered: HashMap<u64, [u8; SLOTS]> =
        asked.iter().map(|command| (command.based_on_cycle, command.valid)).collect();
    let authorities = samples_of::<MotorAuthority>(&run, "motor/authority");
    let in_charge: Vec<&MotorAuthority> = authorities
        .iter()
        .filter(|sample| sample.mode == MotorAuthority::MODE_FOLLOWING && sample.active_controller == 1)
        .collect();
    let moved =
        in_charge.iter().filter(|sample| answered.get(&(sample.header.cycle - 1)).is_some_and(|valid| valid[0] == 1));
    let (moved, all) = (moved.count(), in_charge.len());
    println!("{moved} of {all} cycles in charge by an answer of the program, {unmeasured} cycles measured before");
    assert!(all >= 200 && moved + 3 >= all, "{moved} of {all} cycles");
}
