//! What the planner accepts, the motors can do: the fastest accepted flight is flown at the lowest supply voltage
//! without a fault, and the rejected one faults. `nims plan`, `nims check`, `nims workspace`, a dry run and the flown
//! mission give the same verdict.

use crate::drawn::number;
use cable_robot::Vector3;
use commissioning::{check, plan, workspace};
use config::{Point, SystemFile};
use messages::{PlanStatus, faults};
use motor_box::{BoxConfig, MotorBoxSection};
use nims_tests::lockstep::{Chain, Lockstep, Scenario};
use nims_tests::scenarios::Case;
use nims_tests::walk::random::Random;
use planner::plan::{Plan, PlanError};
use planner::{Mission, PlannerConfig, dry_run};
use std::path::{Path, PathBuf};

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

/// Systems whose moves are compared, and their robots, which may move faster than their winches can.
const COMPARED: [(&str, &str); 5] =
    [("demo3", "lab3"), ("demo4", "lab4"), ("field3", "field3"), ("river4", "river4"), ("forest4", "forest4")];

/// Moves of each system that are compared, and that are flown as well.
const MOVES: u64 = 24;
const FLOWN: u32 = 4;

/// Writes an example system whose robot may move at 1 m/s, in the world of its model, and returns its path.
fn fast_system(folder: &Path, (name, robot): (&str, &str)) -> PathBuf {
    let configs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../configs");
    let read = |file: String| std::fs::read_to_string(configs.join(file)).unwrap();
    let faster = |text_line: &str| {
        let limit = text_line.starts_with("speed_limit_m_s = ");
        format!("{}\n", if limit { "speed_limit_m_s = 1.0" } else { text_line })
    };
    let text: String = read(format!("robots/{robot}.toml")).lines().map(faster).collect();
    assert!(text.contains("\nspeed_limit_m_s = 1.0\n"), "{text}");
    std::fs::write(folder.join("robot.toml"), text).unwrap();
    let system = read(format!("systems/{name}.toml")).replace(&format!("../robots/{robot}.toml"), "robot.toml");
    let path = folder.join("system.toml");
    std::fs::write(&path, system.split("[motor_box.truth]").next().unwrap()).unwrap();
    path
}

/// Ends of a move in the box of the anchors, at most 8 m apart on each axis.
fn ends(anchors_m: &[[f64; 3]], ground_m: f64, random: &mut Random) -> [[f64; 3]; 2] {
    let range = |k: usize| {
        let values = || anchors_m.iter().map(|anchor| anchor[k]);
        (values().fold(f64::INFINITY, f64::min), values().fold(f64::NEG_INFINITY, f64::max))
    };
    let ranges = [range(0), range(1), (ground_m, range(2).1)];
    let from: [f64; 3] = ranges.map(|(low, high)| low + (high - low) * random.between(0.1, 0.85));
    let to = std::array::from_fn(|k| {
        let (low, high) = ranges[k];
        (low + (high - low) * random.between(0.1, 0.85)).clamp(from[k] - 8.0, from[k] + 8.0)
    });
    [from, to]
}

/// The verdicts of all commands on one move of a system.
struct Verdicts {
    planned: Result<Plan, PlanError>,
    dry_run: bool,
    check: bool,
    plan: bool,
    /// Whether `nims workspace` counts both ends.
    workspace: [bool; 2],
}

fn verdicts(path: &Path, file: &SystemFile, [from, to]: [[f64; 3]; 2], speed_m_s: f64) -> Verdicts {
    let robot = file.robot_file().unwrap().robot().unwrap();
    let config = PlannerConfig::from_files(file, robot);
    let mission = line(to, speed_m_s);
    let args = plan::Args {
        config: path.to_owned(),
        from: Point::from(from),
        to: Point::from(to),
        path: None,
        mu: None,
        time_weight: 0.0,
        method: None,
        speed: Some(speed_m_s),
        constant_speed: false,
    };
    let holds = |at: [f64; 3]| workspace::margin_n(&robot, config.distribution, &Vector3::from(at)).is_some();
    Verdicts {
        planned: Plan::new(&mission, &config, from.into(), 0.0, 1),
        dry_run: dry_run(&mission, &config, from).is_ok(),
        check: check::fly(&mission, file, &from).is_ok(),
        plan: plan::run(&args).unwrap().value["feasible"].as_bool().unwrap(),
        workspace: [from, to].map(holds),
    }
}

fn line(to: [f64; 3], speed_m_s: f64) -> Mission {
    let text = format!("name = \"move\"\nspeed_m_s = {speed_m_s:?}\n[[leg]]\nline = {{ to_m = {to:?} }}\n");
    Mission::parse(&text).unwrap()
}

/// The flown move: whether the planner accepts it in flight, and then its last state and all faults.
fn flown(file: &SystemFile, from: [f64; 3], mission: &Mission) -> Option<(u8, u32)> {
    let robot_file = file.robot_file().unwrap();
    let mut plant = BoxConfig::from_files(file, &robot_file, Path::new("/")).unwrap().plant;
    plant.start_m = from;
    let scenario = Scenario::from_files(file, robot_file.robot().unwrap(), plant, mission.clone()).unwrap();
    let mut lockstep = Lockstep::with(scenario, Chain::from_file(file).unwrap()).unwrap();
    lockstep.zero_and_arm().unwrap();
    lockstep.run(mission).ok()?;
    let mut faults = 0;
    for _ in 0..60_000 {
        let cycle = lockstep.cycle().unwrap();
        faults |= cycle.authority.faults;
        if matches!(cycle.plan.state, PlanStatus::STATE_DONE | PlanStatus::STATE_ABORTED) {
            return Some((cycle.plan.state, faults));
        }
    }
    panic!("the move does not end");
}

/// Random moves at random speeds: what one command accepts or refuses, the others do too, and so does the robot in
/// flight, which flies what it accepts without a fault. `NIMS_MOVES` sets another number of moves of each system.
#[test]
fn every_command_gives_the_planners_verdict() {
    let (mut accepted, mut held_back, mut all) = (0, 0, 0);
    for compared in COMPARED {
        let folder = tempfile::tempdir().unwrap();
        let path = fast_system(folder.path(), compared);
        let file = SystemFile::load(&path).unwrap();
        let robot_file = file.robot_file().unwrap();
        let anchors_m = robot_file.robot.anchors_m.to_vec();
        let [mut fly, mut refuse] = [FLOWN; 2];
        for seed in 0..number("NIMS_MOVES", MOVES) {
            let mut random = Random::new(0x5eed + seed);
            let [from, to] = ends(&anchors_m, robot_file.robot.ground_m, &mut random);
            let speed_m_s = random.between(0.1, 1.0);
            let found = verdicts(&path, &file, [from, to], speed_m_s);
            let what = || format!("{} from {from:?} to {to:?} at {speed_m_s} m/s: {:?}", compared.0, found.planned);
            let can = found.planned.is_ok();
            assert_eq!([found.dry_run, found.check, found.plan], [can; 3], "{}", what());
            assert!(!can || found.workspace == [true; 2], "{}", what());
            all += 1;
            accepted += u32::from(can);
            let mission = line(to, speed_m_s);
            match &found.planned {
                Ok(_) if fly > 0 => {
                    fly -= 1;
                    let end = flown(&file, from, &mission);
                    let (state, reported) = end.unwrap_or_else(|| panic!("refused in flight: {}", what()));
                    assert_eq!((state, reported & faults::HARD), (PlanStatus::STATE_DONE, 0), "{}", what());
                }
                Err(PlanError::Refused { refusal, feasible_m_s, .. }) => {
                    held_back += u32::from(refusal.cause.depends_on_speed());
                    // The ends can be held, and a slower move passes between them: the advice holds for all, too.
                    if let Some(slower_m_s) = feasible_m_s {
                        let found = verdicts(&path, &file, [from, to], *slower_m_s);
                        let all = [found.planned.is_ok(), found.dry_run, found.check, found.plan];
                        assert_eq!((all, found.workspace), ([true; 4], [true; 2]), "{} {slower_m_s}", what());
                    }
                    if refuse > 0 && found.workspace[0] {
                        refuse -= 1;
                        assert_eq!(flown(&file, from, &mission), None, "{}", what());
                    }
                }
                _ => {}
            }
        }
    }
    println!("{all} moves: {accepted} accepted, {held_back} too fast for the winches");
    assert!(accepted > all / 10 && held_back > all / 10, "{accepted} accepted, {held_back} held back of {all}");
}
