//! Soft mode in drawn worlds, whose mass, friction, pulleys and motor constants are not those of the files: hands off,
//! the node hardly sinks; a hand leads it, and afterwards the robot flies.
//!
//! The figures are printed: `cargo test -p nims-tests --test lockstep soft:: -- --nocapture`. `NIMS_WORLDS=40` draws
//! more worlds.

use crate::drawn::{Drawn, number};
use messages::{MotorAuthority as A, MotorState, PlanStatus, Request};
use nims_tests::lockstep::{Cycle, Lockstep};
use planner::Mission;
use plant::Fault;

/// Robots of three and four cables, and a planar one that floats.
const ROBOTS: [&str; 3] = ["demo3", "demo4", "aq4"];
/// Longest time after the robot holds until its speed loops are reset for the last time, and the node is at rest, s.
const AT_REST_S: f64 = 5.0;
/// Speed at which the node may sink, m/s.
const SINK_M_S: f64 = 0.05;

/// A winch that a hand can drive back, as a robot file states it, and the true inertia of rotor and gear at the cable.
#[derive(Debug, Clone, Copy)]
struct Winch {
    name: &'static str,
    force_constant_n_a: f64,
    gear_friction: f64,
    coulomb_n: f64,
    viscous_n_s_m: f64,
    inertia_kg: f64,
}

/// A brushless motor of 0.05 N m/A with a belt of 5 to 1 on a drum of 15 mm.
const BELT: Winch = Winch {
    name: "belt",
    force_constant_n_a: 17.0,
    gear_friction: 0.1,
    coulomb_n: 1.0,
    viscous_n_s_m: 5.0,
    inertia_kg: 4.0,
};

/// Nearly without friction: only what soft mode adds holds the node.
const SMOOTH: Winch = Winch { name: "smooth", gear_friction: 0.02, coulomb_n: 0.1, viscous_n_s_m: 0.5, ..BELT };

/// A drawn world with other winches, which deviate from the robot file by as much as those of before.
fn drawn(name: &str, seed: u64, winch: &Winch) -> Drawn {
    let mut drawn = Drawn::new(name, seed);
    let file = &mut drawn.robot.motor;
    let before = file.clone();
    file.force_constant_n_a = winch.force_constant_n_a;
    file.gear_friction = winch.gear_friction;
    file.coulomb_n = winch.coulomb_n;
    file.viscous_n_s_m = winch.viscous_n_s_m;
    file.current_limit_a = 10.0;
    let common = drawn.plant.motor;
    for cable in &mut drawn.plant.world.cables {
        let motor = cable.motor.get_or_insert(common);
        motor.force_constant_n_a *= winch.force_constant_n_a / before.force_constant_n_a;
        motor.gear_friction *= winch.gear_friction / before.gear_friction;
        motor.coulomb_n *= winch.coulomb_n / before.coulomb_n;
        motor.viscous_n_s_m *= winch.viscous_n_s_m / before.viscous_n_s_m;
        motor.inertia_kg = winch.inertia_kg;
    }
    // Drives that take torque.
    drawn.file.motor_io.ports.iter_mut().for_each(|port| port.torque_constant_n_m_a = Some(0.05));
    drawn
}

fn seconds(robot: &mut Lockstep, seconds: f64) -> Cycle {
    let mut last = robot.cycle().unwrap();
    for _ in 1..(seconds * 100.0) as u32 {
        last = robot.cycle().unwrap();
    }
    last
}

/// The robot, armed, at rest, and then soft.
fn soft(drawn: &Drawn) -> Lockstep {
    let mut robot = drawn.lockstep();
    robot.zero_and_arm().unwrap();
    seconds(&mut robot, AT_REST_S);
    robot.request(Request::Soft);
    let cycle = robot.cycle().unwrap();
    assert_eq!(cycle.authority.mode, A::MODE_SOFT, "{}", robot.answers()[0].reason);
    robot
}

fn distance_m(a: [f64; 3], b: [f64; 3]) -> f64 {
    (0..3).map(|i| (a[i] - b[i]).powi(2)).sum::<f64>().sqrt()
}

#[test]
fn hands_off_the_node_hardly_sinks() {
    println!(
        "| winch | robot | worlds | largest sinking speed, mm/s: median / max | moved in 20 s, mm: median / max |"
    );
    for winch in [BELT, SMOOTH] {
        for name in ROBOTS {
            let (mut sinks, mut ways) = (Vec::new(), Vec::new());
            for seed in 1..=number("NIMS_WORLDS", 3) {
                let mut robot = soft(&drawn(name, seed, &winch));
                let from_m = robot.plant().position_m();
                let (mut sink_m_s, mut moved_m) = (0.0_f64, 0.0_f64);
                for _ in 0..2000 {
                    let cycle = robot.cycle().unwrap();
                    assert_eq!(cycle.authority.mode, A::MODE_SOFT, "{winch:?} {name} {seed}: {:?}", cycle.authority);
                    sink_m_s = sink_m_s.max(-cycle.truth_m_s[2]);
                    moved_m = moved_m.max(distance_m(cycle.truth_m, from_m));
                }
                assert!(sink_m_s <= SINK_M_S, "{winch:?} {name} {seed}: sinks at {sink_m_s} m/s");
                assert!(moved_m < 0.05, "{winch:?} {name} {seed}: {moved_m} m");
                sinks.push(sink_m_s * 1e3);
                ways.push(moved_m * 1e3);
            }
            sinks.sort_by(f64::total_cmp);
            ways.sort_by(f64::total_cmp);
            let stated = |all: &[f64]| format!("{:.1} / {:.1}", all[all.len() / 2], all[all.len() - 1]);
            println!("| {} | {name} | {} | {} | {} |", winch.name, sinks.len(), stated(&sinks), stated(&ways));
        }
    }
}

/// A node that is heavier than the robot file says, by up to a fifth, beside all else that is drawn.
#[test]
fn a_heavier_node_hardly_sinks_either() {
    for name in ["demo3", "demo4"] {
        for heavier in [1.1, 1.2] {
            let mut drawn = drawn(name, 1, &BELT);
            drawn.plant.node.mass_kg = drawn.robot.robot.node_mass_kg * heavier;
            let mut robot = soft(&drawn);
            let mut sink_m_s = 0.0_f64;
            for _ in 0..2000 {
                let cycle = robot.cycle().unwrap();
                assert_eq!(cycle.authority.mode, A::MODE_SOFT);
                sink_m_s = sink_m_s.max(-cycle.truth_m_s[2]);
            }
            println!("{name}, {heavier} times as heavy: {:.1} mm/s", sink_m_s * 1e3);
            assert!(sink_m_s <= SINK_M_S, "{name} {heavier}: {sink_m_s} m/s");
        }
    }
}

/// The hand pulls harder until the node follows, up to so many newtons.
const HARDEST_N: f64 = 40.0;
/// Speed at which the hand leads the node, m/s.
const LED_M_S: f64 = 0.1;
/// Way along which the hand leads it, m.
const LED_M: f64 = 0.35;

#[test]
fn a_hand_leads_the_node_and_the_robot_flies_from_there() {
    println!("| robot | world | force of the hand, N: to begin / most | led, m | after letting go, mm |");
    for name in ROBOTS {
        for seed in 1..=number("NIMS_WORLDS", 2) {
            let drawn = drawn(name, seed, &BELT);
            let mut robot = soft(&drawn);
            seconds(&mut robot, 3.0);
            let from_m = robot.plant().position_m();
            let (mut force_n, mut begun_n, mut most_n) = (0.0_f64, None, 0.0_f64);
            while distance_m(robot.plant().position_m(), from_m) < LED_M {
                let cycle = robot.cycle().unwrap();
                assert_eq!(cycle.authority.mode, A::MODE_SOFT, "{name} {seed}: faults {:#x}", cycle.authority.faults);
                // A hand pulls harder as long as the node is slower than it.
                force_n = (force_n + 0.5 * (LED_M_S - cycle.truth_m_s[0])).clamp(0.0, HARDEST_N);
                robot.plant_mut().pull_node([force_n, 0.0, 0.0]);
                most_n = most_n.max(force_n);
                if distance_m(cycle.truth_m, from_m) > 0.05 {
                    begun_n.get_or_insert(most_n);
                }
                assert!(force_n < HARDEST_N, "{name} {seed}: the hand is not strong enough");
            }
            let led_m = distance_m(robot.plant().position_m(), from_m);
            let let_go_m = robot.plant().position_m();
            robot.plant_mut().pull_node([0.0; 3]);
            let cycle = seconds(&mut robot, 5.0);
            assert_eq!(cycle.authority.mode, A::MODE_SOFT, "{name} {seed}: faults {:#x}", cycle.authority.faults);
            let after_m = distance_m(cycle.truth_m, let_go_m);
            assert!(after_m < 0.05, "{name} {seed}: {after_m} m after the hand has let go");
            println!(
                "| {name} | {seed} | {:.1} / {most_n:.1} | {led_m:.2} | {:.0} |",
                begun_n.unwrap_or_default(),
                after_m * 1e3
            );
            robot.request(Request::Hold);
            let cycle = seconds(&mut robot, 1.0);
            assert_eq!((cycle.authority.mode, cycle.authority.faults), (A::MODE_HOLDING, 0));
            assert_eq!(cycle.state.position_known, MotorState::POSITION_KNOWN);
            flies_back(&mut robot, &drawn, from_m);
        }
    }
}

/// The robot flies to a place and arrives there, so it has known where it is.
fn flies_back(robot: &mut Lockstep, drawn: &Drawn, to_m: [f64; 3]) {
    let [x, y, z] = to_m;
    let planar = drawn.plant.planar;
    let to = if planar { format!("[{x:.4}, {z:.4}]") } else { format!("[{x:.4}, {y:.4}, {z:.4}]") };
    let text = format!("name = \"back\"\n[[leg]]\nline = {{ to_m = {to} }}\n");
    robot.run(&Mission::parse(&text).unwrap()).unwrap();
    for _ in 0..6000 {
        let cycle = robot.cycle().unwrap();
        if cycle.plan.state == PlanStatus::STATE_DONE {
            let off_m = distance_m(cycle.truth_m, to_m);
            assert!(off_m < 0.1, "{off_m} m off");
            return;
        }
    }
    panic!("the move back did not end");
}

#[test]
fn requests_and_borders_end_it_and_the_node_stands() {
    for (request, mode) in
        [(Request::Hold, A::MODE_HOLDING), (Request::Stop, A::MODE_HOLDING), (Request::Estop, A::MODE_EMERGENCY_STOP)]
    {
        let mut robot = soft(&drawn("demo4", 2, &BELT));
        robot.plant_mut().pull_node([8.0, 0.0, 0.0]);
        seconds(&mut robot, 3.0);
        robot.request(request);
        seconds(&mut robot, 1.0);
        let at_m = robot.plant().position_m();
        let cycle = seconds(&mut robot, 2.0);
        assert_eq!(cycle.authority.mode, mode);
        // The hand still pulls at it.
        assert!(distance_m(cycle.truth_m, at_m) < 0.01, "it moves on");
    }
    // The hand pulls the node down to the ground, and the drives hold it above.
    let drawn = drawn("demo3", 1, &BELT);
    let mut robot = soft(&drawn);
    robot.plant_mut().pull_node([0.0, 0.0, -12.0]);
    let mut lowest_m = f64::INFINITY;
    for _ in 0..1500 {
        let cycle = robot.cycle().unwrap();
        lowest_m = lowest_m.min(cycle.state.node_m[2]);
        // It brakes on the way down.
        if !matches!(cycle.authority.mode, A::MODE_SOFT | A::MODE_STOPPING) {
            break;
        }
    }
    let cycle = seconds(&mut robot, 2.0);
    assert_eq!((cycle.authority.mode, cycle.authority.faults), (A::MODE_HOLDING, A::FAULT_BORDER));
    assert!((0.0..0.1).contains(&lowest_m), "held {lowest_m} m above the ground");
}

#[test]
fn a_broken_cable_ends_it() {
    for cable in 0..4 {
        let mut robot = soft(&drawn("demo4", 3, &BELT));
        seconds(&mut robot, 3.0);
        robot.plant_mut().apply(Fault::BrokenLine { cable, on: true }).unwrap();
        let mut soft_cycles = 0;
        while robot.cycle().unwrap().authority.mode == A::MODE_SOFT {
            soft_cycles += 1;
            assert!(soft_cycles < 300, "cable {cable}: still soft three seconds after it broke");
        }
        let authority = robot.cycle().unwrap().authority;
        println!("cable {}: {soft_cycles} cycles, faults {:#x}", cable + 1, authority.faults);
        assert!(authority.faults & (A::FAULT_SOFT_SPEED | A::FAULT_BORDER) != 0, "{:#x}", authority.faults);
        let cycle = seconds(&mut robot, 5.0);
        assert!(cycle.state.velocity_m_s.iter().all(|v| v.abs() < 0.01), "{:?}", cycle.state.velocity_m_s);
    }
}
