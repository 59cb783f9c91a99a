//! Random missions in drawn worlds. The planner knows the model only; what it accepts has to be flown in the world
//! without a fault and without a slack cable, and it has to accept most of what the world allows.
//!
//! A few of them are flown with every change, and by hand a thousand of each kind, with the seeds 1 to 1000:
//! `cargo test -p nims-tests --test lockstep missions::a_thousand -- --ignored --nocapture`. `NIMS_SEED` is another
//! first seed.

use crate::drawn::{Drawn, number};
use cable_robot::{CableVec, Obstacle, Vector3};
use config::{ObstacleSection, RobotFile};
use messages::{MotorAuthority as A, PlanStatus};
use nims_tests::lockstep::{Chain, Lockstep};
use nims_tests::walk::random::Random;
use planner::{Mission, Planner, PlannerConfig};
use std::io::{IsTerminal, Write};
use std::sync::atomic::{AtomicU64, Ordering};

pub const SYSTEMS: [&str; 4] = ["demo3", "field3", "river4", "forest4"];
/// Largest way of a leg along x and y, m, so that flights of long robots stay short.
const REACH_M: f64 = 8.0;
/// Length of cable at a pulley that its trunk may be close to, m.
const ROOT_M: f64 = 1.0;
/// Missions that are flown with every change.
const EVERYDAY: u64 = 24;
/// Duty of a drive that has no voltage left.
const ALL_DUTY: f64 = 0.999;

/// A flight to its end.
#[derive(Debug, Clone, Copy)]
struct Flown {
    /// Faults of motor-io.
    faults: u32,
    /// Least and largest true tension of a cable, N.
    tensions_n: [f64; 2],
    /// True and estimated tensions at the end, N.
    last_n: [CableVec; 2],
    /// Largest current that was measured, A.
    current_a: f64,
    /// Largest duty of a drive.
    duty: f64,
    /// Least true distance from the bodies, m.
    distance_m: f64,
    done: bool,
}

impl Flown {
    /// Whether the world allowed the flight, by the limits that the robot file states.
    fn is_feasible(&self, robot: &RobotFile) -> bool {
        let [low_n, high_n] = robot.robot.tension_limits_n;
        let [least_n, most_n] = self.tensions_n;
        let motors = self.current_a <= robot.motor.current_limit_a && self.duty < ALL_DUTY;
        self.done && self.faults == 0 && least_n >= low_n && most_n <= high_n && motors
    }

    /// Whether an accepted mission met a fault, ran out of voltage, or had a slack cable.
    fn has_failed(&self) -> bool {
        let faulted = self.faults & messages::faults::HARD != 0;
        !self.done || faulted || self.tensions_n[0] <= 0.0 || self.duty >= ALL_DUTY
    }
}

/// Bodies, and those that carry a pulley.
#[derive(Default)]
struct Bodies {
    free: Vec<Obstacle>,
    carriers: Vec<Obstacle>,
}

/// Points in the volume that the anchors span, some of which cannot be held.
pub fn mission(drawn: &Drawn, random: &mut Random) -> Mission {
    let anchors = &drawn.robot.robot.anchors_m;
    let around = |k: usize| {
        let (low, high) =
            anchors.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), a| (low.min(a[k]), high.max(a[k])));
        let middle = drawn.plant.start_m[k];
        ((low + 0.05 * (high - low)).max(middle - REACH_M), (high - 0.05 * (high - low)).min(middle + REACH_M))
    };
    let ((x0, x1), (y0, y1)) = (around(0), around(1));
    let ground_m = drawn.robot.robot.ground_m;
    let top_m = ground_m + 0.9 * (anchors[0][2] - ground_m);
    let points: Vec<[f64; 3]> = (0..1 + random.below(3))
        .map(|_| [random.between(x0, x1), random.between(y0, y1), random.between(ground_m + 0.1, top_m)])
        .collect();
    let speed_m_s = drawn.robot.robot.speed_limit_m_s * random.between(0.3, 1.0);
    let text =
        format!("name = \"drawn\"\nspeed_m_s = {speed_m_s:.3}\n[[leg]]\npolyline = {{ points_m = {points:?} }}\n");
    Mission::parse(&text).unwrap()
}

/// A planner that knows neither limits of tensions nor of motors, to see what the world allows.
fn unlimited(drawn: &Drawn) -> Planner {
    let mut robot = drawn.robot.clone();
    robot.robot.tension_limits_n = [1e-3, 1e4];
    robot.motor.current_limit_a = 500.0;
    robot.supply_min_v = None;
    Planner::new(PlannerConfig::from_files(&drawn.file, robot.robot().unwrap()))
}

/// Flies a mission; `None`: the planner rejects it.
fn fly(drawn: &Drawn, mut lockstep: Lockstep, mission: &Mission, bodies: &Bodies) -> Option<Flown> {
    lockstep.zero_and_arm().unwrap();
    lockstep.run(mission).ok()?;
    let mut flown = Flown {
        faults: 0,
        tensions_n: [f64::INFINITY, 0.0],
        last_n: [CableVec::zeros(0); 2],
        current_a: 0.0,
        duty: 0.0,
        distance_m: f64::INFINITY,
        done: false,
    };
    for number in 0..60_000_u32 {
        let cycle = lockstep.cycle().unwrap();
        for (i, tension_n) in cycle.truth_n.iter().enumerate() {
            let [least_n, most_n] = flown.tensions_n;
            flown.tensions_n = [least_n.min(*tension_n), most_n.max(*tension_n)];
            flown.current_a = flown.current_a.max(cycle.state.current_a[i].abs());
            flown.duty = flown.duty.max(cycle.state.duty[i].abs());
        }
        let estimated_n = CableVec::from_array8(&cycle.estimate.tension_n, cycle.truth_n.len());
        flown.last_n = [cycle.truth_n, estimated_n];
        flown.faults |= cycle.authority.faults;
        if number % 10 == 0 && !(bodies.free.is_empty() && bodies.carriers.is_empty()) {
            let free_m = drawn.least_distance_m(cycle.truth_m, &cycle.truth_n, &bodies.free, 0.0);
            let carried_m = drawn.least_distance_m(cycle.truth_m, &cycle.truth_n, &bodies.carriers, ROOT_M);
            flown.distance_m = flown.distance_m.min(free_m).min(carried_m);
        }
        match cycle.plan.state {
            PlanStatus::STATE_DONE => return Some(Flown { done: true, ..flown }),
            PlanStatus::STATE_ABORTED => return Some(flown),
            _ => {}
        }
    }
    panic!("the mission does not end");
}

#[derive(Debug, Default)]
struct Tally {
    accepted: u32,
    /// Accepted ones that met a fault, ran out of voltage, or had a slack cable.
    failed: u32,
    /// Accepted ones during which a limit of the robot file was exceeded by the truth.
    beyond: u32,
    /// By how much at most, N: below the least tension, and above the largest one.
    below_n: f64,
    above_n: f64,
    feasible: u32,
    feasible_accepted: u32,
    least_n: f64,
    duty: f64,
    distance_m: f64,
}

impl Tally {
    fn new() -> Self {
        Self { least_n: f64::INFINITY, distance_m: f64::INFINITY, ..Self::default() }
    }

    fn add(&mut self, outcome: &Outcome) {
        self.feasible += u32::from(outcome.feasible);
        let Some(flown) = &outcome.accepted else { return };
        self.accepted += 1;
        self.failed += u32::from(flown.has_failed());
        self.beyond += u32::from(!outcome.feasible);
        self.feasible_accepted += u32::from(outcome.feasible);
        self.below_n = self.below_n.max(outcome.limits_n[0] - flown.tensions_n[0]);
        self.above_n = self.above_n.max(flown.tensions_n[1] - outcome.limits_n[1]);
        self.least_n = self.least_n.min(flown.tensions_n[0]);
        self.duty = self.duty.max(flown.duty);
        self.distance_m = self.distance_m.min(flown.distance_m);
    }
}

/// What became of a mission.
struct Outcome {
    /// Number of the system.
    system: usize,
    /// The flight, if the planner accepts the mission.
    accepted: Option<Flown>,
    /// Whether the world allows it by the limits of the robot file, as far as that was tried.
    feasible: bool,
    /// Limits of the tensions in the robot file, N.
    limits_n: [f64; 2],
    /// The mission, with all that it takes to fly it again.
    words: String,
}

/// Flies the missions of some seeds over the cores, with the progress on a terminal.
fn outcomes(count: u64, each: fn(u64) -> Outcome) -> Vec<Outcome> {
    let first = number("NIMS_SEED", 1);
    let seeds: Vec<u64> = (first..first + count).collect();
    let (shows, done) = (std::io::stderr().is_terminal(), AtomicU64::new(0));
    command::parallel(&seeds, command::processors(), |&seed| {
        let outcome = each(seed);
        let done = done.fetch_add(1, Ordering::Relaxed) + 1;
        if shows {
            let _ = write!(std::io::stderr(), "\r{done} of {count} missions ");
        }
        outcome
    })
}

/// In how many accepted missions the truth was beyond a limit, and by how much.
fn beyond(tallies: &[(&str, Tally)]) -> String {
    let count: u32 = tallies.iter().map(|(_, tally)| tally.beyond).sum();
    let most_n = |of: fn(&Tally) -> f64| tallies.iter().map(|(_, tally)| of(tally)).fold(0.0, f64::max);
    let (below_n, above_n) = (most_n(|tally| tally.below_n), most_n(|tally| tally.above_n));
    format!(
        "{count} beyond a limit of the robot file, at most {below_n:.1} N below and {above_n:.1} N above a tension's"
    )
}

/// The results of each system, with the missions that failed printed.
fn tallied(outcomes: &[Outcome]) -> [(&'static str, Tally); 4] {
    let mut tallies = SYSTEMS.map(|name| (name, Tally::new()));
    for outcome in outcomes {
        tallies[outcome.system].1.add(outcome);
        if let Some(flown) = outcome.accepted.filter(|flown| flown.has_failed() || flown.distance_m <= 0.0) {
            println!("{}: {flown:?}", outcome.words);
        }
    }
    tallies
}

/// A mission in a drawn world. One that the planner rejects is flown with a planner without limits of tensions and
/// motors, to see whether the world allows it.
fn in_a_drawn_world(seed: u64) -> Outcome {
    let system = (seed % 4) as usize;
    let mut random = Random::new(seed);
    let drawn = Drawn::new(SYSTEMS[system], 100 + seed / 4);
    let mission = mission(&drawn, &mut random);
    let accepted = fly(&drawn, drawn.lockstep(), &mission, &Bodies::default());
    let tried = accepted.or_else(|| {
        let mut chain = Chain::from_files(&drawn.file, &drawn.robot).unwrap();
        chain.planner = unlimited(&drawn);
        fly(&drawn, drawn.lockstep_with(chain), &mission, &Bodies::default())
    });
    let feasible = tried.is_some_and(|flown| flown.is_feasible(&drawn.robot));
    let words = format!("NIMS_SEED={seed} {}, {mission:?}", SYSTEMS[system]);
    Outcome { system, accepted, feasible, limits_n: drawn.robot.robot.tension_limits_n, words }
}

fn judge_missions(count: u64) {
    let tallies = tallied(&outcomes(count, in_a_drawn_world));
    println!("{tallies:#?}");
    let sum = |of: fn(&Tally) -> u32| tallies.iter().map(|(_, tally)| of(tally)).sum::<u32>();
    let (flown, failed, beyond) = (sum(|t| t.accepted), sum(|t| t.failed), beyond(&tallies));
    let (accepted, feasible) = (sum(|t| t.feasible_accepted), sum(|t| t.feasible));
    println!(
        "of {count} missions {flown} accepted, {failed} of them failed, {beyond}; \
         {accepted} of {feasible} feasible ones accepted"
    );
    assert_eq!(failed, 0);
    assert!(accepted * 100 >= feasible * 80 && feasible > 0, "{accepted} of {feasible}");
}

#[test]
fn missions_that_the_planner_accepts_are_flown_in_drawn_worlds() {
    judge_missions(number("NIMS_MISSIONS", EVERYDAY));
}

#[test]
#[ignore = "takes minutes; docs/measured.md has the results"]
fn a_thousand_missions_that_the_planner_accepts_are_flown() {
    judge_missions(1000);
}

/// Trunks in the volume, and some that carry a pulley.
fn trunks(drawn: &mut Drawn, random: &mut Random) -> Bodies {
    let start = Vector3::from(drawn.plant.start_m);
    let anchors = drawn.robot.robot.anchors_m.to_vec();
    let mut bodies = Bodies::default();
    let mut sections = Vec::new();
    for anchor in &anchors {
        if random.once_in(3) {
            // The pulley is at its side that looks to the node.
            let out = (Vector3::from(*anchor) - start).xy().normalize();
            let radius_m = random.between(0.1, 0.3);
            let away_m = radius_m + random.between(0.02, 0.15);
            let section = ObstacleSection::cylinder(
                [anchor[0] + out.x * away_m, anchor[1] + out.y * away_m],
                radius_m,
                [-1.0, anchor[2] + 1.0],
            );
            bodies.carriers.push(section.obstacle().unwrap());
            sections.push(section);
        }
    }
    for _ in 0..1 + random.below(3) {
        let (radius_m, top_m) = (random.between(0.1, 0.4), random.between(0.3, 1.1) * anchors[0][2]);
        let center_m = [0, 1].map(|k| start[k] + random.between(-0.7, 0.7) * REACH_M.min(anchors[1][0]));
        let section = ObstacleSection::cylinder(center_m, radius_m, [-1.0, top_m]);
        let body = section.obstacle().unwrap();
        if anchors.iter().any(|anchor| body.is_near(&Vector3::from(*anchor), &start, 0.3)) {
            continue;
        }
        bodies.free.push(body);
        sections.push(section);
    }
    drawn.robot.obstacle = sections;
    bodies
}

/// A mission among trunks in a drawn world, by a robot that states how well its anchors were measured.
fn among_trunks(seed: u64) -> Outcome {
    let system = (seed % 4) as usize;
    let mut random = Random::new(1_000_000 + seed);
    let mut drawn = Drawn::new(SYSTEMS[system], 100 + seed / 4);
    drawn.state_anchors();
    let bodies = trunks(&mut drawn, &mut random);
    let mission = mission(&drawn, &mut random);
    let accepted = fly(&drawn, drawn.lockstep(), &mission, &bodies);
    let feasible = accepted.is_some_and(|flown| flown.is_feasible(&drawn.robot));
    let words = format!("NIMS_SEED={seed} {}, {mission:?} {:?}", SYSTEMS[system], drawn.robot.obstacle);
    Outcome { system, accepted, feasible, limits_n: drawn.robot.robot.tension_limits_n, words }
}

fn judge_trunks(count: u64) {
    let tallies = tallied(&outcomes(count, among_trunks));
    println!("{tallies:#?}");
    let flown: u32 = tallies.iter().map(|(_, tally)| tally.accepted).sum();
    let least_m = tallies.iter().map(|(_, tally)| tally.distance_m).fold(f64::INFINITY, f64::min);
    let beyond = beyond(&tallies);
    println!("of {count} missions among trunks {flown} accepted, at least {least_m:.3} m left, {beyond}");
    let rejected = count - u64::from(flown);
    assert!(u64::from(flown) * 8 >= count && rejected * 8 >= count, "{flown} flown, {rejected} rejected");
    for (name, tally) in &tallies {
        assert!(tally.distance_m > 0.0 && tally.failed == 0, "{name}: {tally:?}");
    }
}

#[test]
fn missions_among_trunks_in_drawn_worlds_touch_none() {
    judge_trunks(number("NIMS_TRUNKS", EVERYDAY));
}

/// The motor of a sound cable whose readings alternate between two low phases of its ripple, for a second.
#[test]
fn a_motor_that_is_read_at_two_low_phases_is_no_slack_cable() {
    let outcome = among_trunks(963);
    let flown = outcome.accepted.unwrap();
    assert!(!flown.has_failed(), "{}: {flown:?}", outcome.words);
}

#[test]
#[ignore = "takes minutes; docs/measured.md has the results"]
fn a_thousand_missions_among_trunks_touch_none() {
    judge_trunks(1000);
}

/// A fault that motor-io reports is one that the tally counts.
#[test]
fn a_flight_beyond_its_limits_counts_as_failed() {
    let drawn = Drawn::new("demo3", 1);
    let flown = Flown {
        faults: A::FAULT_OVER_CURRENT,
        tensions_n: [5.0, 20.0],
        last_n: [CableVec::zeros(0); 2],
        current_a: 1.0,
        duty: 0.5,
        distance_m: 1.0,
        done: true,
    };
    assert!(flown.has_failed() && !flown.is_feasible(&drawn.robot));
    let good = Flown { faults: 0, ..flown };
    assert!(!good.has_failed() && good.is_feasible(&drawn.robot));
    for worse in [Flown { tensions_n: [0.0, 20.0], ..good }, Flown { duty: 1.0, ..good }, Flown { done: false, ..good }]
    {
        assert!(worse.has_failed(), "{worse:?}");
    }
}
