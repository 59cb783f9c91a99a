//! Jogs towards obstacles and keep-out boxes in drawn worlds: the node comes to rest at their borders, and by the truth
//! neither node nor cables touch anything.
//!
//! `NIMS_JOGS=4000 cargo test -p nims-tests --test lockstep -- borders:: --nocapture` makes more jogs.

use crate::drawn::{Drawn, number};
use cable_robot::{KeepOut, Obstacle, Vector3};
use config::ObstacleSection;
use messages::{MotorAuthority as A, Request};
use nims_tests::lockstep::{Cycle, Lockstep};
use nims_tests::walk::random::Random;
use robot_state::Reason;

/// Jogs in one world.
const JOGS: u64 = 20;
/// Longest time of a jog, s.
const LONGEST_S: f64 = 60.0;

/// What happened to the jogs of a world.
#[derive(Debug, Default)]
struct Tally {
    jogs: u64,
    refused: u64,
    ended_at_border: u64,
    faulted: u64,
    on_the_ground: u64,
    least_m: f64,
    boxed_m: f64,
}

/// Puts trunks, a wall and a box around the node.
fn surround(drawn: &mut Drawn, dice: &mut Random) {
    let start = Vector3::from(drawn.plant.start_m);
    let anchors = drawn.plant.anchors_m.clone();
    let reach_m = anchors.iter().map(|a| (Vector3::from(*a) - start).xy().norm()).fold(0.0, f64::max);
    let far = |x: f64, y: f64, radius_m: f64| {
        anchors.iter().all(|a| f64::hypot(a[0] - x, a[1] - y) > radius_m + 0.6)
            && f64::hypot(start.x - x, start.y - y) > radius_m + 0.15
    };
    while drawn.robot.obstacle.len() < 4 {
        let (turn, away_m) = (dice.between(0.0, std::f64::consts::TAU), dice.between(0.3, 0.8 * reach_m));
        let (x, y) = (start.x + away_m * turn.cos(), start.y + away_m * turn.sin());
        let (radius_m, top_m) = (dice.between(0.05, 0.4), dice.between(0.3, 1.2 * anchors[0][2]));
        if !far(x, y, radius_m) {
            continue;
        }
        let heights_m = [-1.0, top_m];
        let section = if drawn.robot.obstacle.len() == 3 {
            let corners_m = vec![[x - 0.6 * radius_m, y - 0.02], [x + 0.6 * radius_m, y + 0.02]];
            ObstacleSection { center_m: None, radius_m: None, corners_m, height_m: heights_m }
        } else {
            ObstacleSection::cylinder([x, y], radius_m, heights_m)
        };
        drawn.robot.obstacle.push(section);
    }
}

/// A box beside the node, which only it may not enter.
fn keep_out(drawn: &Drawn, dice: &mut Random) -> KeepOut {
    let start = Vector3::from(drawn.plant.start_m);
    let min = start + Vector3::new(dice.between(0.15, 0.5), dice.between(-1.0, -0.2), -1.0);
    KeepOut { min, max: min + Vector3::new(dice.between(0.3, 1.5), dice.between(0.5, 1.5), 5.0) }
}

/// The world's bodies and what is least far from them.
struct Watch<'a> {
    drawn: &'a Drawn,
    bodies: Vec<Obstacle>,
    boxed: KeepOut,
    tally: &'a mut Tally,
    /// Whether the robot knows the bodies.
    sees: bool,
}

impl Watch<'_> {
    fn look(&mut self, cycle: &Cycle) {
        let distance_m = self.drawn.least_distance_m(cycle.truth_m, &cycle.truth_n, &self.bodies, 0.0);
        let boxed_m = self.boxed.distance_m(&Vector3::from(cycle.truth_m));
        let touched = self.tally.least_m <= 0.0 || self.tally.boxed_m <= 0.0;
        if self.sees && !touched && (distance_m <= 0.0 || boxed_m <= 0.0) {
            let (truth_m, node_m, truth_n) = (cycle.truth_m, cycle.state.node_m, cycle.truth_n);
            println!("contact: node by the truth at {truth_m:?} under {truth_n:?} N, by its lengths at {node_m:?}");
        }
        self.tally.least_m = self.tally.least_m.min(distance_m);
        self.tally.boxed_m = self.tally.boxed_m.min(boxed_m);
    }
}

/// Whether the node lies on the ground. Its cables are slack then, and their lengths no longer say where it is.
fn lies(drawn: &Drawn, cycle: &Cycle) -> bool {
    let ground_m = drawn.plant.node.ground_m.unwrap_or(f64::NEG_INFINITY);
    cycle.truth_m[2] < ground_m + 0.02
}

/// Jogs until the robot holds; returns whether the robot has a fault or lies on the ground.
fn jog(lockstep: &mut Lockstep, cable: u8, distance_m: f64, watch: &mut Watch<'_>) -> bool {
    lockstep.request(Request::Jog { cable, distance_m });
    let cycle = lockstep.cycle().unwrap();
    let answer = lockstep.answers()[0];
    watch.tally.jogs += 1;
    if !answer.is_accepted() {
        watch.tally.refused +=
            u64::from(matches!(answer.reason, Reason::NotJoggedBorder { .. } | Reason::NotJoggedBox { .. }));
        return cycle.authority.mode == A::MODE_FAULTED;
    }
    let period_s = watch.drawn.file.period_s();
    for k in 0..(LONGEST_S / period_s) as u32 {
        let cycle = lockstep.cycle().unwrap();
        if lies(watch.drawn, &cycle) {
            watch.tally.on_the_ground += 1;
            return true;
        }
        if k % 5 == 0 {
            watch.look(&cycle);
        }
        match cycle.authority.mode {
            A::MODE_JOGGING => {}
            A::MODE_HOLDING => {
                watch.tally.ended_at_border += u64::from(cycle.authority.faults & A::FAULT_BORDER != 0);
                // The drives lag, and the node swings.
                for k in 0..60 {
                    let cycle = lockstep.cycle().unwrap();
                    if k % 5 == 0 && !lies(watch.drawn, &cycle) {
                        watch.look(&cycle);
                    }
                }
                return false;
            }
            _ => {
                watch.tally.faulted += 1;
                return true;
            }
        }
    }
    panic!("a jog does not end");
}

/// Makes jogs in one world. A robot that cannot see obstacles is the control.
fn jogs(name: &str, seed: u64, sees: bool, tally: &mut Tally) {
    let mut dice = Random::new(seed);
    let mut drawn = Drawn::new(name, 1 + seed % 40);
    drawn.state_anchors();
    surround(&mut drawn, &mut dice);
    let boxed = keep_out(&drawn, &mut dice);
    let bodies = drawn.robot.obstacle.iter().map(|section| section.obstacle().unwrap()).collect();
    let drawn = &drawn;
    let mut robot = drawn.clone();
    if sees {
        let point = |at: Vector3<f64>| config::Point { position_m: at.into(), planar: false };
        robot.robot.robot.keep_out = vec![[point(boxed.min), point(boxed.max)]];
    } else {
        robot.robot.obstacle.clear();
    }
    robot.file.motor_io.jog_speed_m_s = if seed.is_multiple_of(2) { 0.05 } else { 0.2 };
    let mut lockstep = robot.lockstep();
    lockstep.zero_and_arm().unwrap();
    let mut watch = Watch { drawn, bodies, boxed, tally, sees };
    let mut last = lockstep.cycle().unwrap();
    // By the truth of the start, nothing is touched before the first jog.
    let start_m = drawn.least_distance_m(last.truth_m, &last.truth_n, &watch.bodies, 0.0);
    if start_m <= 0.11 {
        return;
    }
    let cables = drawn.plant.cable_count();
    for _ in 0..JOGS {
        let cable = dice.below(cables) as u8 + 1;
        // More cables than directions get slack or tight soon.
        let most_m = if cables == 3 { 1.0 } else { 0.08 };
        let low = last.truth_m[2] < 0.25 + drawn.robot.robot.ground_m;
        let out = if low { false } else { dice.below(2) == 0 };
        let distance_m = dice.between(0.02, most_m) * if out { 1.0 } else { -1.0 };
        if jog(&mut lockstep, cable, distance_m, &mut watch) {
            return;
        }
        last = lockstep.cycle().unwrap();
    }
}

#[test]
fn jogs_come_to_rest_at_the_borders_of_what_they_must_not_touch() {
    let jogs_wanted = number("NIMS_JOGS", 300);
    let new = || Tally { least_m: f64::INFINITY, boxed_m: f64::INFINITY, ..Tally::default() };
    let (mut seed, mut blind) = (number("NIMS_SEED", 1), new());
    let mut all = [("demo3", new()), ("field3", new()), ("river4", new()), ("forest4", new())];
    while all.iter().map(|(_, tally)| tally.jogs).sum::<u64>() < jogs_wanted {
        // Three of four jogs with robots whose cables can be jogged far.
        let which = [0, 1, 0, 1, 0, 1, 2, 3][(seed % 8) as usize];
        let (name, tally) = &mut all[which];
        let before_m = (tally.least_m, tally.boxed_m);
        jogs(name, seed, true, tally);
        if (tally.least_m <= 0.0 && before_m.0 > 0.0) || (tally.boxed_m <= 0.0 && before_m.1 > 0.0) {
            println!("{name}: contact in the world of NIMS_SEED={seed}: {tally:?}");
        }
        if seed.is_multiple_of(4) {
            jogs("demo3", seed, false, &mut blind);
        }
        seed += 1;
    }
    println!("{all:#?}\nwithout obstacles in the robot file: {blind:?}");
    for (name, tally) in &all {
        assert!(tally.least_m > 0.0 && tally.boxed_m > 0.0, "{name}: {tally:?}");
    }
    let ended: u64 = all.iter().map(|(_, tally)| tally.ended_at_border + tally.refused).sum();
    assert!(ended * 10 > jogs_wanted, "too few jogs reach a border: {ended}");
    assert!(blind.least_m <= 0.0 || blind.boxed_m <= 0.0, "no jog leads anywhere dangerous: {blind:?}");
}
