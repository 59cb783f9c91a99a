//! Cables that break in flights of drawn worlds, whose motors and tensions are not those of the robot file.
//!
//! `NIMS_BREAKS=60 cargo test --workspace --test lockstep -- broken:: --nocapture` flies more missions. `NIMS_SEED` is
//! the first seed.

use crate::drawn::{Drawn, number};
use crate::missions::{SYSTEMS, mission};
use messages::{MotorAuthority as A, PlanStatus};
use nims_tests::lockstep::Lockstep;
use nims_tests::walk::random::Random;

/// Cycles between the instants of a flight at which each cable is broken, one at a time.
const EVERY: u32 = 150;
/// Cycles after which a broken cable counts as not found.
const LONGEST: u32 = 400;
/// Cycles within which the table of faults states that it is found.
const STATED: u32 = 100;
/// Speed of a cable from which its motor shows whether it carries load, m/s.
const MOVING_M_S: f64 = 0.02;

/// How a cable moves when it breaks.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Way {
    In,
    Slowly,
    Out,
}

/// A broken cable, in a copy of a flight.
#[derive(Debug, Clone, Copy)]
struct Broken {
    name: &'static str,
    way: Way,
    /// Cycles until the robot stopped with a fault; `None`: not within [`LONGEST`].
    cycles: Option<u32>,
}

/// Breaks a cable; `None` if the flight ends before that is found.
fn broken(mut flight: Lockstep, name: &'static str, cable: usize) -> Option<Broken> {
    let reel_in_m_s = -flight.cycle().unwrap().state.velocity_m_s[cable];
    let way = match reel_in_m_s {
        v if v > MOVING_M_S => Way::In,
        v if v < -MOVING_M_S => Way::Out,
        _ => Way::Slowly,
    };
    flight.plant_mut().apply(plant::Fault::BrokenLine { cable, on: true }).unwrap();
    for cycles in 1..=LONGEST {
        let cycle = flight.cycle().unwrap();
        if cycle.authority.faults != 0 {
            return Some(Broken { name, way, cycles: Some(cycles) });
        }
        if cycle.authority.mode != A::MODE_FOLLOWING || cycle.plan.state != PlanStatus::STATE_RUNNING {
            return None;
        }
    }
    Some(Broken { name, way, cycles: None })
}

/// Breaks each cable of a flight again and again, in copies of it.
fn fly(name: &'static str, drawn: &Drawn, seed: u64) -> Vec<Broken> {
    let mut all = Vec::new();
    let mut lockstep = drawn.lockstep();
    lockstep.zero_and_arm().unwrap();
    if lockstep.run(&mission(drawn, &mut Random::new(seed))).is_err() {
        return all;
    }
    for number in 0.. {
        let cycle = lockstep.cycle().unwrap();
        if matches!(cycle.plan.state, PlanStatus::STATE_DONE | PlanStatus::STATE_ABORTED) {
            break;
        }
        if number % EVERY == EVERY / 2 && cycle.authority.mode == A::MODE_FOLLOWING {
            let cables = 0..cycle.truth_n.len();
            all.extend(cables.filter_map(|cable| broken(lockstep.fork().unwrap(), name, cable)));
        }
    }
    all
}

/// Of the cables that move, at least 99 of 100 are found in the time that the table of faults states.
#[test]
fn a_broken_cable_is_found_in_drawn_worlds() {
    let first = number("NIMS_SEED", 1);
    let all: Vec<Broken> = (first..first + number("NIMS_BREAKS", 8))
        .flat_map(|seed| {
            let name = SYSTEMS[(seed % 4) as usize];
            fly(name, &Drawn::new(name, 100 + seed / 4), seed)
        })
        .collect();
    for name in SYSTEMS {
        for way in [Way::In, Way::Slowly, Way::Out] {
            let of = |broken: &&Broken| broken.name == name && broken.way == way;
            let mut found: Vec<u32> = all.iter().filter(of).map(|broken| broken.cycles.unwrap_or(u32::MAX)).collect();
            found.sort_unstable();
            let late = found.iter().filter(|cycles| **cycles > STATED).count();
            if let (Some(median), Some(most)) = (found.get(found.len() / 2), found.get(found.len() * 9 / 10)) {
                println!(
                    "{name} {way:?}: {} broken, {late} later than {STATED}; median {median}, 90 % {most}",
                    found.len()
                );
            }
        }
    }
    let moving: Vec<&Broken> = all.iter().filter(|broken| broken.way != Way::Slowly).collect();
    let late = moving.iter().filter(|broken| broken.cycles.is_none_or(|cycles| cycles > STATED)).count();
    println!("{} broken while they moved, {late} later than {STATED} cycles", moving.len());
    assert!(moving.len() > 50 && late * 100 <= moving.len(), "{late} of {}", moving.len());
}
