//! A custom law in Python, in a program of its own: first in the shadow, then in charge, at 50 Hz.

use crate::robot::{Robot, THREE_CABLES, root, samples_of, steadily};
use messages::{CONTROLLERS, MotorAuthority, MotorCommand, MotorSlots, SLOTS, SystemConfig, text_of};
use nims_tests::python;
use rustix::process::Signal;
use std::collections::HashMap;

/// Amplitude with which the node swings on its cables after a stop, m.
const SWING_M: f64 = 0.01;

/// The template in slot b, beside the standard controller.
fn beside() -> String {
    let (modules, law) = (root().join("scripts/python"), root().join("scripts/templates/law.py"));
    let command = format!("env PYTHONPATH={} {} -B {}", modules.display(), python().display(), law.display());
    format!(
        "\n[[process]]\nname = \"my-law\"\nrole = \"controller\"\nslot = \"b\"\ncommand = [\"controller\", \"--program\", {command:?}]\n"
    )
}

/// Puts the law in charge while the robot moves; a swap that the machine spoils is repeated.
fn swap(robot: &mut Robot) {
    for _ in 0..5 {
        robot.until("it qualifies in flight", |robot| {
            robot.slots.phase[SLOTS * CONTROLLERS + 1] == MotorSlots::PHASE_QUALIFIED
                && robot.last.mode == MotorAuthority::MODE_FOLLOWING
        });
        if robot.nims(&["swap", "controller"]).status.success() {
            return;
        }
    }
    panic!("five times no swap\n{}", robot.printed());
}

#[test]
fn a_law_in_python_is_in_charge_after_it_kept_its_deadline_in_the_shadow() {
    steadily(|| {
        let mut robot = Robot::up_with(THREE_CABLES, &beside(), |configs| {
            let path = configs.join("systems/demo3.toml");
            let text = std::fs::read_to_string(&path).unwrap();
            assert!(text.contains("rate_hz = 100.0"));
            std::fs::write(&path, text.replacen("rate_hz = 100.0", "rate_hz = 50.0", 1)).unwrap();
        });
        robot.until("the law", |robot| robot.slots.phase[SLOTS * CONTROLLERS + 1] != MotorSlots::PHASE_EMPTY);
        robot.arm();
        robot.fly_at(0.04);
        swap(&mut robot);
        robot.until("it is in charge", |robot| robot.slots.in_charge[CONTROLLERS] == 1);
        robot.for_cycles(200);
        assert_eq!(robot.slots.in_charge[CONTROLLERS], 1, "it has lost its place\n{}", robot.printed());
        robot.arrive();
        robot.for_cycles(25);
        let off_m = robot.distance_m(robot.goal);
        assert!(off_m < SWING_M, "{off_m} m from the goal");
        assert_eq!(robot.down(Signal::INT), Some(0), "{}", robot.printed());
        judge(&robot);
    });
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
