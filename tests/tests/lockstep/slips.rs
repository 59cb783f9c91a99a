//! Cables with two encoders in flights of drawn worlds: no false alarms, and how far a cable slips before it is found.
//!
//! The table is printed: `cargo test -p nims-tests --test lockstep slips -- --nocapture`; `NIMS_SLIPS=40` flies more
//! worlds, and `NIMS_SEED` is the first seed.

use crate::drawn::{Drawn, number};
use crate::missions::{SYSTEMS, mission};
use config::{DrumEncoder, DrumSection};
use messages::{MotorAuthority as A, MotorState, PlanStatus};
use motor_box::BoxConfig;
use nims_tests::lockstep::Lockstep;
use nims_tests::walk::random::Random;
use plant::Fault;
use std::path::Path;

/// Counts of the second encoders per metre.
const SECOND_PER_M: f64 = 26_500.0;
/// Drums of the worlds, m, by [`SYSTEMS`]; the true ones deviate by 1 % (standard deviation).
const DIAMETERS_M: [f64; 4] = [0.04, 0.04, 0.06, 0.08];
const CABLE_DIAMETER_M: f64 = 0.000_33;
const TURNS: f64 = 100.0;
/// Largest share by which what a robot file says of the layers is wrong.
const LAYERS_WRONG: f64 = 0.2;
/// Cycles between the instants of a flight at which each cable slips, one at a time.
const EVERY: u32 = 300;
/// Cycles after which a slip counts as not found.
const LONGEST: u32 = 600;
/// Speed of a cable above which its slip counts, m/s.
const MOVING_M_S: f64 = 0.02;
/// Least slip of a whole cable that is found, m: `slip_m`, the share of the motion, and a cycle at full speed.
const FOUND_M: f64 = 0.035;

/// A drawn world of which each cable has two encoders; the robot file does not have the true layers.
fn world(name: &str, seed: u64, encoder: DrumEncoder) -> Drawn {
    let mut drawn = Drawn::new(name, seed);
    let mut random = Random::new(seed ^ 0x5117);
    let cables = drawn.robot.robot.anchors_m.len();
    let drum = DrumSection {
        diameter_m: DIAMETERS_M[SYSTEMS.iter().position(|system| *system == name).unwrap()],
        cable_diameter_m: CABLE_DIAMETER_M,
        turns_per_layer: TURNS,
        cable_m: vec![drawn.robot.robot.length_limits_m[1].min(100.0) + 60.0; cables],
        encoder,
        idler_m: 0.0,
    };
    drawn.robot.drum = Some(drum.clone());
    if encoder == DrumEncoder::First {
        drawn.robot.lines.counts_stretched = config::CountsStretched::All(false);
    }
    drawn.file.motor_io.second_counts_per_m = vec![SECOND_PER_M; cables];
    drawn.plant = BoxConfig::from_files(&drawn.file, &drawn.robot, Path::new("/")).unwrap().plant;
    let mut wrong = |value: f64| value * random.between(1.0 - LAYERS_WRONG, 1.0 + LAYERS_WRONG);
    let (cable_diameter_m, turns_per_layer) = (wrong(CABLE_DIAMETER_M), wrong(TURNS));
    drawn.robot.drum = Some(DrumSection { cable_diameter_m, turns_per_layer, ..drum });
    drawn
}

/// What happens to one cable.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Way {
    Drum(f64),
    Idler(f64),
    Dead,
    Broken,
}

const WAYS: [Way; 6] = [Way::Drum(1.0), Way::Drum(0.5), Way::Drum(0.2), Way::Idler(1.0), Way::Dead, Way::Broken];

/// How one ended.
#[derive(Debug, Clone, Copy)]
struct Found {
    way: Way,
    /// Difference of the two encoders since, m, and faults, when the robot stopped; `None`: it did not.
    after: Option<(f64, u32, u8)>,
}

/// Slips a cable in a copy of a flight; `None` if the flight ends before that is found.
fn slip(mut flight: Lockstep, way: Way, cable: usize, encoder: DrumEncoder) -> Option<Found> {
    let before = flight.cycle().unwrap();
    if before.state.velocity_m_s[cable].abs() < MOVING_M_S {
        return None;
    }
    let fault = match way {
        Way::Drum(share) => Fault::DrumSlip { cable, share },
        Way::Idler(share) => Fault::IdlerSlip { cable, share },
        Way::Dead => Fault::EncoderDead { cable, on: true },
        Way::Broken => Fault::BrokenLine { cable, on: true },
    };
    flight.plant_mut().apply(fault).unwrap();
    // The first encoder's counts per metre are those of its world; all of them count nearly metres of cable.
    let first_per_m = flight.plant().config().idlers[cable].counts_per_m;
    for _ in 1..=LONGEST {
        let cycle = flight.cycle().unwrap();
        if cycle.authority.faults != 0 {
            let counted_m = |then: i64, now: i64, per_m: f64| (now - then) as f64 / per_m;
            let first_m = counted_m(before.input.counts[cable], cycle.input.counts[cable], first_per_m);
            let second_m = counted_m(before.input.second_counts[cable], cycle.input.second_counts[cable], SECOND_PER_M);
            let ratio = |on_drum: bool| if on_drum { 1.05 } else { 1.0 };
            let first_m = first_m * ratio(encoder == DrumEncoder::First);
            let second_m = second_m * ratio(encoder == DrumEncoder::Second);
            let after = Some(((second_m - first_m).abs(), cycle.authority.faults, cycle.state.position_known));
            return Some(Found { way, after });
        }
        if cycle.authority.mode != A::MODE_FOLLOWING || cycle.plan.state != PlanStatus::STATE_RUNNING {
            return None;
        }
    }
    Some(Found { way, after: None })
}

/// Flies a mission, which must not find a slip, and slips each cable of it again and again, in copies.
fn fly(name: &'static str, seed: u64, encoder: DrumEncoder, all: &mut Vec<Found>) -> (u64, f64) {
    let drawn = world(name, seed, encoder);
    let mut lockstep = drawn.lockstep();
    lockstep.zero_and_arm().unwrap();
    if lockstep.run(&mission(&drawn, &mut Random::new(seed))).is_err() {
        return (0, 0.0);
    }
    let (mut cycles, mut most_m) = (0, 0.0_f64);
    for number in 0.. {
        let cycle = lockstep.cycle().unwrap();
        cycles += 1;
        let apart_m = cycle.state.slip_m[..cycle.truth_n.len()].iter().fold(0.0, |most: f64, m| most.max(m.abs()));
        most_m = most_m.max(apart_m);
        assert_eq!(cycle.authority.faults & A::FAULT_SLIP, 0, "{name}, seed {seed}, {encoder:?}: {apart_m} m");
        if matches!(cycle.plan.state, PlanStatus::STATE_DONE | PlanStatus::STATE_ABORTED) {
            break;
        }
        if number % EVERY == EVERY / 2 && cycle.authority.mode == A::MODE_FOLLOWING {
            for cable in 0..cycle.truth_n.len() {
                for way in WAYS {
                    all.extend(slip(lockstep.fork().unwrap(), way, cable, encoder));
                }
            }
        }
    }
    (cycles, most_m)
}

/// Cables slip on drums and idlers, and encoders fail, in worlds whose drums are not those of the robot file: no false
/// alarm, and a slip of a whole cable is found within centimetres.
#[test]
fn slips_are_found_within_centimetres_and_only_slips() {
    let worlds = number("NIMS_SLIPS", 2);
    let first = number("NIMS_SEED", 1);
    for encoder in [DrumEncoder::Second, DrumEncoder::First] {
        let (mut all, mut flown, mut most_m) = (Vec::new(), 0, 0.0_f64);
        for seed in first..first + worlds {
            for name in SYSTEMS {
                let (cycles, apart_m) = fly(name, seed, encoder, &mut all);
                flown += cycles;
                most_m = most_m.max(apart_m);
            }
        }
        println!(
            "drum by the {encoder:?} encoder: {flown} cycles without a slip, at most {:.1} mm apart",
            1e3 * most_m
        );
        println!("| way | number | found | as a slip | encoders apart, cm: median / most |");
        for way in WAYS {
            let of: Vec<&Found> = all.iter().filter(|found| found.way == way).collect();
            let slipped = |found: &&&Found| found.after.is_some_and(|(_, faults, _)| faults & A::FAULT_SLIP != 0);
            let mut apart_m: Vec<f64> = of.iter().filter(slipped).filter_map(|found| Some(found.after?.0)).collect();
            apart_m.sort_by(f64::total_cmp);
            let found = of.iter().filter(|found| found.after.is_some()).count();
            let (median_m, most_m) =
                (apart_m.get(apart_m.len() / 2).copied().unwrap_or(0.0), apart_m.last().copied().unwrap_or(0.0));
            println!(
                "| {way:?} | {} | {found} | {} | {:.1} / {:.1} |",
                of.len(),
                apart_m.len(),
                1e2 * median_m,
                1e2 * most_m
            );
            let whole = matches!(way, Way::Drum(share) | Way::Idler(share) if share == 1.0);
            if whole {
                assert!(found == of.len(), "{way:?}: {} of {} found", found, of.len());
                assert!(most_m <= FOUND_M, "{way:?}: {most_m} m apart");
            }
            for found in of.iter().filter(slipped) {
                // A slip of a drum by an idler that turns as the cable: only that keeps the position.
                let known = found.after.map(|(_, _, known)| known) == Some(MotorState::POSITION_KNOWN);
                assert!(!known || encoder == DrumEncoder::Second, "{found:?} kept the position");
            }
        }
    }
}
