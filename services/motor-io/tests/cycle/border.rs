//! Jogs near obstacles and keep-out boxes.

use crate::counting::allocations;
use crate::rig;

use cable_robot::{Obstacle, Robot, RobotParts, Vector3, elastic, sag};
use messages::{MotorAuthority as A, MotorState, Request};
use motor_io::CoreConfig;
use proptest::prelude::*;
use rig::Rig;
use robot_state::Reason;

const CLEARANCE_M: f64 = 0.1;

/// The rig's robot with these bodies; the other configuration is that of the rig.
fn rig_with(change: impl FnOnce(&mut RobotParts)) -> (Rig, Robot) {
    let mut parts = RobotParts { clearance_m: CLEARANCE_M, ..rig::parts() };
    change(&mut parts);
    let robot = Robot::new(parts).unwrap();
    let config = CoreConfig { robot, jog_speed_m_s: 0.2, ..rig::config() };
    (Rig::new(config), robot)
}

/// Armed at these lengths, which the rig has too.
fn held(mut rig: Rig, lengths_m: [f64; 3]) -> Rig {
    rig.length_m[..3].copy_from_slice(&lengths_m);
    rig.steps(3);
    rig.demand(rig::lengths(lengths_m));
    rig.demand(Request::Arm);
    rig
}

fn position(robot: &Robot, lengths_m: &[f64]) -> Vector3<f64> {
    elastic::equilibrium(robot, lengths_m, &Vector3::zeros(), None).unwrap().position
}

/// Point of a cable with the node at rest, dry, at a share of its chord.
fn point(robot: &Robot, lengths_m: &[f64], cable: usize, share: f64) -> Vector3<f64> {
    let held = elastic::equilibrium(robot, lengths_m, &Vector3::zeros(), None).unwrap();
    let anchor = robot.anchors()[cable];
    let chord = held.position - anchor;
    let sag_m = sag::sag_m(robot.cable_weight_n_m(), chord.norm(), held.tensions_n[cable]);
    anchor + chord * share - Vector3::new(0.0, 0.0, 4.0 * sag_m * share * (1.0 - share))
}

/// Least distance of the dry cable from a body, by its points.
fn cable_m(robot: &Robot, lengths_m: &[f64], cable: usize, body: &Obstacle) -> f64 {
    let points = (20..=100).map(|k| point(robot, lengths_m, cable, f64::from(k) / 100.0));
    points.map(|point| body.distance_m(&point)).fold(f64::INFINITY, f64::min)
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    /// Whatever is jogged in whatever order, the node keeps its distance from a trunk beside it.
    #[test]
    fn no_jog_brings_the_node_closer_than_the_clearance(
        turn in 0.0..std::f64::consts::TAU,
        away_m in 0.35..1.2f64,
        jogs in prop::collection::vec((1..=3u8, -1.0..1.0f64), 1..8),
        lag_s in 0.02..0.1f64,
        delay_cycles in 0..6usize,
    ) {
        let lengths_m = [5.9, 5.8, 6.0];
        let at = position(&rig_with(|_| ()).1, &lengths_m);
        let (x, y) = (at.x + away_m * turn.cos(), at.y + away_m * turn.sin());
        let trunk = Obstacle::cylinder([x, y], 0.15, [-10.0, 1.6]).unwrap();
        let (mut rig, robot) = rig_with(|parts| parts.obstacles = vec![trunk]);
        (rig.lag_s, rig.delay_cycles) = (lag_s, delay_cycles);
        let mut rig = held(rig, lengths_m);
        for (cable, distance_m) in jogs {
            if !rig.ask(Request::Jog { cable, distance_m }).0 {
                continue;
            }
            let mut cycles = 0;
            while rig.mode() == A::MODE_JOGGING && cycles < 3000 {
                rig.step();
                cycles += 1;
            }
            rig.steps(50);
            prop_assert_eq!(rig.mode(), A::MODE_HOLDING, "{:#x}", rig.faults());
            let node = position(&robot, &rig.length_m[..3]);
            prop_assert!(trunk.distance_m(&node) > CLEARANCE_M - 1e-3, "{node:?}");
        }
    }

    /// A jog that loosens a heavy cable lowers the cable more than the node: below the sag under the least tension
    /// with which the planner flies, too.
    #[test]
    fn no_jog_lets_a_cable_sag_closer_than_the_clearance(
        number in 1..=3u8,
        at in 0.3..0.6f64,
        gap_m in 0.01..0.3f64,
        distance_m in 0.1..2.0f64,
        lengths_m in [5.7..6.3f64, 5.7..6.3f64, 5.7..6.3f64],
    ) {
        let heavy = |parts: &mut RobotParts| {
            (parts.node_mass_kg, parts.cable_mass_kg_m, parts.tension_limits_n) = (0.3, 0.08, [30.0, 60.0]);
            parts.length_limits_m = Some(vec![[0.3, 14.0]; 3]);
        };
        let cable = usize::from(number) - 1;
        let bare = rig_with(heavy).1;
        let low = point(&bare, &lengths_m, cable, at);
        let body = Obstacle::cylinder([low.x, low.y], 0.05, [-10.0, low.z - CLEARANCE_M - gap_m]).unwrap();
        prop_assume!(cable_m(&bare, &lengths_m, cable, &body) > CLEARANCE_M + 0.01);
        let (rig, robot) = rig_with(|parts| {
            heavy(parts);
            parts.obstacles = vec![body];
        });
        let mut rig = held(rig, lengths_m);
        if rig.ask(Request::Jog { cable: number, distance_m }).0 {
            rig.until(4000, |rig| rig.mode() != A::MODE_JOGGING);
            rig.steps(50);
        }
        let least_m = cable_m(&robot, &rig.length_m[..3], cable, &body);
        prop_assert!(least_m > CLEARANCE_M - 1e-3, "{least_m} m left, {:?}", rig.length_m);
    }
}

#[test]
fn a_jog_ends_at_a_box_and_leads_away_from_it_again() {
    let lengths_m = [5.9, 5.8, 6.0];
    let at = position(&rig_with(|_| ()).1, &lengths_m);
    // Reeling in the first cable leads towards its anchor.
    let boxed = [[-1.0, -1.0, -5.0], [at.x - 0.3, 9.0, 9.0]];
    let (rig, robot) = rig_with(|parts| parts.keep_out_m = vec![boxed]);
    let mut rig = held(rig, lengths_m);
    rig.demand(Request::Jog { cable: 1, distance_m: -1.0 });
    rig.until(2000, |rig| rig.mode() == A::MODE_HOLDING);
    assert_eq!(rig.faults(), A::FAULT_BORDER);
    let node = position(&robot, &rig.length_m[..3]);
    let left_m = node.x - boxed[1][0];
    assert!(left_m > CLEARANCE_M && left_m < CLEARANCE_M + 0.1, "{left_m} m before the box");
    // A slow start is still allowed, until no way is left to stop.
    let refused = (0..300).map(|_| {
        let again = rig.reason(Request::Jog { cable: 1, distance_m: -0.5 });
        rig.until(2000, |rig| rig.mode() == A::MODE_HOLDING);
        again
    });
    let refused = refused.filter(|again| matches!(again, Reason::NotJoggedBox { cable: 1, number: 1 })).count();
    assert!((1..300).contains(&refused), "{refused}");
    let node = position(&robot, &rig.length_m[..3]);
    assert!(node.x > boxed[1][0] + CLEARANCE_M);
    rig.demand(Request::Jog { cable: 1, distance_m: 0.2 });
    assert_eq!(rig.faults(), 0, "the reason of the end before is over");
    rig.until(2000, |rig| rig.mode() == A::MODE_HOLDING);
    assert!(position(&robot, &rig.length_m[..3]).x > node.x + 0.05);
}

#[test]
fn without_any_position_a_jog_is_not_checked() {
    let lengths_m = [5.9, 5.8, 6.0];
    let at = position(&rig_with(|_| ()).1, &lengths_m);
    let (mut rig, _) = rig_with(|parts| parts.keep_out_m = vec![[[-1.0, -1.0, -5.0], [at.x - 0.1, 9.0, 9.0]]]);
    rig.steps(3);
    rig.demand(Request::Arm);
    rig.demand(Request::Jog { cable: 1, distance_m: -0.5 });
    rig.until(2000, |rig| rig.mode() == A::MODE_HOLDING);
    assert_eq!(rig.faults(), 0);
    assert!((rig.length_m[0] - 4.5).abs() < 0.01);
}

/// After each restart the position is one from before, which a flight needs confirmed.
#[test]
fn a_jog_with_a_restored_position_ends_at_a_box() {
    let lengths_m = [5.9, 5.8, 6.0];
    let at = position(&rig_with(|_| ()).1, &lengths_m);
    let boxed = [[-1.0, -1.0, -5.0], [at.x - 0.3, 9.0, 9.0]];
    let (mut rig, robot) = rig_with(|parts| parts.keep_out_m = vec![boxed]);
    rig.length_m[..3].copy_from_slice(&lengths_m);
    let restored = [5.9, 5.8, 6.0, 0.0, 0.0, 0.0, 0.0, 0.0];
    rig.inbox.first(99, Some(rig::stored(restored, [0; 8])));
    rig.steps(3);
    assert_eq!(rig.seen().state.position_known, MotorState::POSITION_RESTORED);
    // What needs a known position is as before.
    assert!(rig.seen().state.node_m[0].is_nan());
    rig.demand(Request::Arm);
    rig.demand(Request::Jog { cable: 1, distance_m: -1.0 });
    rig.until(2000, |rig| rig.mode() == A::MODE_HOLDING);
    assert_eq!(rig.faults(), A::FAULT_BORDER);
    let left_m = position(&robot, &rig.length_m[..3]).x - boxed[1][0];
    assert!(left_m > CLEARANCE_M && left_m < CLEARANCE_M + 0.1, "{left_m} m before the box");
    rig.demand(Request::Jog { cable: 1, distance_m: 0.2 });
}

#[test]
fn the_check_of_a_jog_allocates_nothing() {
    let lengths_m = [5.9, 5.8, 6.0];
    let trunk = Obstacle::cylinder([4.0, 2.0], 0.1, [-10.0, 5.0]).unwrap();
    let (rig, _) = rig_with(|parts| (parts.obstacles, parts.cable_mass_kg_m) = (vec![trunk; 16], 0.001));
    let mut rig = held(rig, lengths_m);
    rig.demand(Request::Jog { cable: 1, distance_m: -0.5 });
    let mut inputs = Vec::new();
    for _ in 0..100 {
        inputs.push(rig.step().input);
    }
    let mut core = rig.core.clone();
    let count = allocations(|| {
        for input in &inputs {
            std::hint::black_box((core.decide(input), core.observe(input)));
        }
    });
    assert_eq!(count, 0);
}
