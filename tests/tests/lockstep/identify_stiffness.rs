//! `nims identify` on the stiffness of the cables: flights in drawn worlds, whose truth it does not read.
//!
//! The table of docs/identification.md: `NIMS_WORLDS=12 cargo test -p nims-tests --test lockstep
//! identify_stiffness -- --nocapture`; `NIMS_SEED` is the first world.

use std::path::{Path, PathBuf};

use config::SystemFile;
use messages::{MotorAuthority, PlanStatus, Request};
use motor_box::BoxConfig;
use nims_sim::Tape;
use nims_tests::lockstep::{Chain, Lockstep, Scenario};
use planner::Mission;
use serde_json::Value;

use crate::drawn::{number, system};

/// First of the worlds: the model's own share was chosen in worlds 1 to 8.
const FIRST_WORLD: u64 = 301;
/// Stiffness about which the reels of the worlds are drawn, as factors of that of the robot file.
const REELS: [f64; 3] = [1.0, 0.75, 1.3];

/// A robot and what it flies.
struct Case {
    name: &'static str,
    system: &'static str,
    mission: &'static str,
    /// By how much each of these cables is reeled in before the mission is flown once more, m.
    jogs_m: &'static [(u8, f64)],
}

/// One cable is reeled in, and then paid out again beyond where it was.
const TIGHTER: [(u8, f64); 1] = [(1, -0.02)];
const BOTH: [(u8, f64); 2] = [(1, -0.02), (1, 0.04)];

const CASES: [Case; 7] = [
    Case { name: "3 cables, demo", system: "demo3", mission: "demo", jogs_m: &[] },
    Case { name: "3 cables, polyline", system: "demo3", mission: "polyline", jogs_m: &[] },
    Case { name: "4 cables, demo", system: "demo4", mission: "demo", jogs_m: &[] },
    Case { name: "4 cables, wide", system: "demo4", mission: "wide", jogs_m: &[] },
    Case { name: "4 cables, demo, tightened", system: "demo4", mission: "demo", jogs_m: &TIGHTER },
    Case { name: "4 cables, demo, tightened and loosened", system: "demo4", mission: "demo", jogs_m: &BOTH },
    Case { name: "4 cables, up and down, both", system: "demo4", mission: "motors", jogs_m: &BOTH },
];

/// A mission over most of the place, at two heights.
const WIDE: &str = "name = \"wide\"\nspeed_m_s = 0.3\n[[leg]]\npolyline = { points_m = [[2.5, 2.5, 0.8], \
                    [7.5, 2.5, 0.8], [7.5, 6.5, 0.8], [2.5, 6.5, 0.8], [2.5, 2.5, 1.6], [7.5, 6.5, 1.6], \
                    [4.8, 3.0, 0.3]] }\n";

fn mission(name: &str, file: &SystemFile) -> Mission {
    if name == "wide" {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("wide.toml");
        std::fs::write(&path, WIDE).unwrap();
        return Mission::read(&path).unwrap();
    }
    Mission::read(&file.planner.missions.join(name).with_extension("toml")).unwrap()
}

/// A flight that is recorded.
struct Recording {
    lockstep: Lockstep,
    tape: Tape,
}

impl Recording {
    fn cycles(&mut self, count: usize) {
        for _ in 0..count {
            let cycle = self.lockstep.cycle().unwrap();
            self.tape.cycle(&cycle, self.lockstep.slots()).unwrap();
        }
    }

    /// Flies the mission; false if it was not flown to its end.
    fn fly(&mut self, mission: &Mission) -> bool {
        if self.lockstep.run(mission).is_err() {
            return false;
        }
        for _ in 0..30_000 {
            let cycle = self.lockstep.cycle().unwrap();
            self.tape.cycle(&cycle, self.lockstep.slots()).unwrap();
            match cycle.plan.state {
                PlanStatus::STATE_DONE => return true,
                PlanStatus::STATE_ABORTED => return false,
                _ => {}
            }
        }
        false
    }

    /// Asks for something at rest and waits until the robot holds again.
    fn ask(&mut self, request: Request) {
        self.lockstep.request(request);
        self.cycles(1);
        let answer = self.lockstep.answers()[0];
        assert!(answer.is_accepted(), "{:?}", answer.reason);
        for _ in 0..1000 {
            let cycle = self.lockstep.cycle().unwrap();
            self.tape.cycle(&cycle, self.lockstep.slots()).unwrap();
            if [MotorAuthority::MODE_HOLDING, MotorAuthority::MODE_DISARMED].contains(&cycle.authority.mode) {
                break;
            }
        }
        self.cycles(150);
    }
}

/// Flies a case in a world, and returns the run and the true stiffness, N; `None` if the robot cannot fly it there.
fn flown(case: &Case, folder: &Path, seed: u64) -> Option<(PathBuf, f64)> {
    let path = folder.join("system.toml");
    let reel = REELS[seed as usize % REELS.len()];
    let text = std::fs::read_to_string(system(case.system)).unwrap();
    let configs = system(case.system).parent().unwrap().parent().unwrap().to_owned();
    let text = text.replace("\"../robots/", &format!("\"{}/robots/", configs.display()));
    let stated_n = SystemFile::load(&system(case.system)).unwrap().robot_file().unwrap().lines.stiffness_n.unwrap();
    let text = text.replace("[motor_box]", &format!("[motor_box]\nstiffness_n = {}", stated_n * reel));
    let model = folder.join("model.toml");
    std::fs::write(&model, text).unwrap();
    let args = nims_truth::Args { system: model, seed, spread: 1.0, warming: 0.0, wind: 0.0, out: Some(path.clone()) };
    nims_truth::run(&args).ok()?;
    let file = SystemFile::load(&path).unwrap();
    let robot = file.robot_file().unwrap();
    let plant = BoxConfig::from_files(&file, &robot, Path::new("/")).unwrap().plant;
    let cables = &plant.world.cables;
    let true_n =
        cables.iter().map(|cable| cable.line.unwrap_or(plant.line).stiffness_n).sum::<f64>() / cables.len() as f64;
    let mission = mission(case.mission, &SystemFile::load(&system(case.system)).unwrap());
    let scenario = Scenario::from_files(&file, robot.robot().unwrap(), plant, mission.clone()).unwrap();
    let lockstep = Lockstep::with(scenario, Chain::from_file(&file).unwrap()).unwrap();
    let run = folder.join("run.mcap");
    let mut recording = Recording { lockstep, tape: Tape::new(&run, &path).unwrap() };
    recording.cycles(20);
    let position_m = recording.lockstep.plant().position_m();
    recording.ask(Request::ZeroAt { position_m });
    recording.ask(Request::Arm);
    if !recording.fly(&mission) {
        return None;
    }
    for (cable, distance_m) in case.jogs_m {
        recording.cycles(150);
        recording.ask(Request::Jog { cable: *cable, distance_m: *distance_m });
        let position_m = recording.lockstep.plant().position_m();
        recording.ask(Request::ZeroAt { position_m });
        if !recording.fly(&mission) {
            return None;
        }
    }
    recording.cycles(50);
    recording.tape.finish().unwrap();
    Some((run, true_n))
}

/// What is said of a flight: the value and its deviation if it is given, what is left of the prior, the truth.
struct Said {
    given: Option<(f64, f64)>,
    left: f64,
    true_n: f64,
}

fn said(case: &Case, seed: u64) -> Option<Said> {
    let folder = tempfile::tempdir().unwrap();
    let Some((run, true_n)) = flown(case, folder.path(), seed) else {
        println!("{} in world {seed}: not flown to its end", case.name);
        return None;
    };
    let found = analysis::identify::run(&analysis::identify::Args { run, out: None }).unwrap().value;
    let found = &found["stiffness_n"];
    let number = |of: &Value| of.as_f64().unwrap();
    let given = found["undetermined"].is_null().then(|| (number(&found["value"]), number(&found["sigma"])));
    let sentence = found["undetermined"].as_str().map_or("", |why| why.split(';').next().unwrap_or_default());
    println!("{} in world {seed}: {given:?}, left {}, true {true_n:.0}: {sentence}", case.name, found["left"]);
    Some(Said { given, left: number(&found["left"]), true_n })
}

#[test]
fn three_cables_do_not_tell() {
    assert_eq!(judge(&CASES[..2]), 0);
}

#[test]
fn a_mission_alone_hardly_tells() {
    judge(&CASES[2..4]);
}

#[test]
fn pretensions_tell() {
    assert!(judge(&CASES[4..6]) > 0);
}

#[test]
fn pretensions_of_motions_up_and_down_tell() {
    assert!(judge(&CASES[6..]) > 0);
}

/// Flies cases in worlds, and returns how many values are given; they cover the truth.
fn judge(cases: &[Case]) -> usize {
    let first = number("NIMS_SEED", FIRST_WORLD);
    let (mut given, mut within) = (0, [0, 0]);
    for case in cases {
        let all: Vec<Said> = (first..first + number("NIMS_WORLDS", 2)).filter_map(|seed| said(case, seed)).collect();
        let count = all.len() as f64;
        let of_it: Vec<(f64, f64, f64)> =
            all.iter().filter_map(|one| one.given.map(|(value, sigma)| (value, sigma, one.true_n))).collect();
        let off = |(value, _, true_n): &(f64, f64, f64)| value / true_n - 1.0;
        let rms = (of_it.iter().map(|one| off(one).powi(2)).sum::<f64>() / of_it.len() as f64).sqrt();
        let covered = [1.0, 2.0].map(|sigmas| {
            of_it.iter().filter(|(value, sigma, true_n)| (value - true_n).abs() <= sigmas * sigma).count()
        });
        println!(
            "| {} | {} | {:.1} % | {} | {:.1} % | {:.1} % | {covered:?} |",
            case.name,
            all.len(),
            100.0 * all.iter().map(|one| one.left).sum::<f64>() / count,
            of_it.len(),
            100.0 * rms,
            100.0 * of_it.iter().map(|(value, sigma, _)| sigma / value).sum::<f64>() / of_it.len() as f64,
        );
        given += of_it.len();
        (0..2).for_each(|k| within[k] += covered[k]);
        let worst = of_it.iter().map(|one| off(one).abs()).fold(0.0, f64::max);
        assert!(worst < 0.25, "{}: {worst} off", case.name);
    }
    println!("given {given}, within one and two standard deviations {within:?}");
    assert!(within[1] as f64 >= 0.93 * given as f64, "{within:?} of {given}");
    given
}
