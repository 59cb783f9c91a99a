//! What the planner accepts, the motors can do: the fastest accepted flight is flown at the lowest supply voltage
//! without a fault, and the rejected one faults. `nims plan`, `nims check` and a dry run give the planner's verdict.

use commissioning::{check, plan};
use config::{Point, SystemFile};
use messages::PlanStatus;
use motor_box::MotorBoxSection;
use nims_tests::lockstep::{Chain, Lockstep};
use nims_tests::scenarios::Case;
use planner::plan::{Plan, PlanError};
use planner::{Mission, PlannerConfig, dry_run};
use proptest::prelude::*;
use std::path::Path;
use std::sync::LazyLock;

const CASE: Case = Case { robot: "lab3", mission: "polyline", motor_s: [0.03, 0.04] };

/// The example robot with a speed limit that its winches cannot reach, and its system with this lowest supply voltage.
fn system(folder: &Path, supply_min_v: f64) -> SystemFile {
    let configs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../configs");
    let changed = |name: &str, changes: &[(&str, &str)]| {
        let text = std::fs::read_to_string(configs.join(name)).unwrap();
        changes.iter().fold(text, |text, (old, new)| {
            assert!(text.contains(old), "{name} has no {old}");
            text.replace(old, new)
        })
    };
    let robot = changed("robots/lab3.toml", &[("\nspeed_limit_m_s = 0.4", "\nspeed_limit_m_s = 1.0")]);
    let supply = format!("supply_min_v = {supply_min_v:?}");
    let system =
        changed("systems/demo3.toml", &[("supply_min_v = 20.0", &supply), ("../robots/lab3.toml", "robot.toml")]);
    std::fs::write(folder.join("robot.toml"), robot).unwrap();
    std::fs::write(folder.join("system.toml"), system).unwrap();
    SystemFile::load(&folder.join("system.toml")).unwrap()
}

fn mission(speed_m_s: f64) -> Mission {
    let points = "[[3.0, 1.8, 0.5], [6.6, 1.8, 1.4], [4.7, 5.0, 0.6], [4.8, 3.0, 0.4]]";
    Mission::parse(&format!(
        "name = \"fast\"\nspeed_m_s = {speed_m_s}\n[[leg]]\npolyline = {{ points_m = {points} }}\n"
    ))
    .unwrap()
}

/// Flies the mission with a supply whose voltage is just above 20 V under load. Returns the final state of the plan and
/// the faults.
fn fly(file: &SystemFile, mission: &Mission) -> (u8, u32) {
    let mut scenario = CASE.scenario(true).unwrap();
    scenario.plant.supply_v = 20.5;
    let mut lockstep = Lockstep::with(scenario, Chain::from_file(file).unwrap()).unwrap();
    lockstep.zero_and_arm().unwrap();
    lockstep.run(mission).unwrap();
    let mut faults = 0;
    for _ in 0..20_000 {
        let cycle = lockstep.cycle().unwrap();
        faults |= cycle.authority.faults;
        if matches!(cycle.plan.state, PlanStatus::STATE_DONE | PlanStatus::STATE_ABORTED) {
            return (cycle.plan.state, faults);
        }
    }
    panic!("the mission does not end; faults {faults:#x}");
}

#[test]
fn the_fastest_accepted_flight_is_flown_at_the_lowest_supply_and_a_rejected_one_is_not() {
    let folder = tempfile::tempdir().unwrap();
    let checked = system(folder.path(), 20.0);
    let robot_file = checked.robot_file().unwrap();
    let config = PlannerConfig::from_files(&checked, robot_file.robot().unwrap());
    let start = MotorBoxSection::from_file(&checked, &robot_file).unwrap().unwrap().start_m.position_m.into();
    let plan = |speed_m_s| Plan::new(&mission(speed_m_s), &config, start, 0.0, 1);
    // Each refusal states the speed of its segment; the slowest segment decides.
    let mut speed_m_s = 1.0;
    while let Err(error) = plan(speed_m_s) {
        let PlanError::Refused { feasible_m_s: Some(feasible_m_s), .. } = error else { panic!("{error}") };
        assert!(feasible_m_s < speed_m_s, "{error}");
        speed_m_s = feasible_m_s;
    }
    assert!((0.3..0.8).contains(&speed_m_s), "{speed_m_s}");
    let (state, faults) = fly(&checked, &mission(speed_m_s));
    assert_eq!((state, faults), (PlanStatus::STATE_DONE, 0), "at {speed_m_s} m/s");

    // Without a stated supply voltage the planner accepts what the motors cannot do.
    let folder = tempfile::tempdir().unwrap();
    let unchecked = system(folder.path(), 0.0);
    let (state, faults) = fly(&unchecked, &mission(1.0));
    assert!(state == PlanStatus::STATE_ABORTED && faults != 0, "{state} {faults:#x}");
}

/// The folder of the system with which the commands are compared.
static COMPARED: LazyLock<tempfile::TempDir> = LazyLock::new(|| {
    let folder = tempfile::tempdir().unwrap();
    system(folder.path(), 20.0);
    folder
});

fn place() -> impl Strategy<Value = [f64; 3]> {
    (2.0..8.0f64, 0.5..6.0f64, 0.2..2.4f64).prop_map(|(x, y, z)| [x, y, z])
}

proptest! {
    #[test]
    fn every_command_gives_the_planners_verdict(from in place(), to in place(), speed_m_s in 0.1..1.0f64) {
        let file = SystemFile::load(&COMPARED.path().join("system.toml")).unwrap();
        let robot = file.robot_file().unwrap().robot().unwrap();
        let config = PlannerConfig { check_step_m: 0.01, ..PlannerConfig::from_files(&file, robot) };
        let mission = |speed_m_s: f64| Mission::parse(&format!(
            "name = \"move\"\nspeed_m_s = {speed_m_s:?}\nacceleration_m_s2 = {:?}\n[[leg]]\nline = {{ to_m = {to:?} }}\n",
            robot.acceleration_limit_m_s2()
        )).unwrap();
        let planned = Plan::new(&mission(speed_m_s), &config, from.into(), 0.0, 1);

        let args = plan::Args {
            config: COMPARED.path().join("system.toml"), from: Point::from(from), to: Point::from(to), path: None, mu: None,
            time_weight: 0.0, method: None, speed: Some(speed_m_s), constant_speed: false,
        };
        let answer = plan::run(&args).unwrap().value;
        prop_assert_eq!(answer["feasible"].as_bool().unwrap(), planned.is_ok(), "{} {:?}", answer, planned.err());
        prop_assert_eq!(check::fly(&mission(speed_m_s), &file, &from).is_ok(), planned.is_ok());
        prop_assert_eq!(dry_run(&mission(speed_m_s), &config, from).is_ok(), planned.is_ok());
        if let Err(PlanError::Refused { feasible_m_s: Some(feasible_m_s), .. }) = planned {
            prop_assert!(feasible_m_s < speed_m_s);
            prop_assert!(Plan::new(&mission(feasible_m_s), &config, from.into(), 0.0, 1).is_ok());
        }
    }
}
