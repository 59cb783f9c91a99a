//! The touch-down of the node on the floor, in drawn worlds: the lengths that a setup takes there.

use crate::drawn::{Drawn, number};
use cable_robot::{CableVec, Vector3};
use calibration::{Paying, TouchDown};
use messages::{MotorAuthority as A, PlanStatus, Request};
use nims_tests::lockstep::{Cycle, Lockstep};
use planner::mission::{Leg, Line, Mission, PathShape};

/// Depth of the goal below the floor, m: the floor is not where the robot expects it.
const BELOW_M: f64 = 0.25;
/// Height of the floor below the start of the robots, m.
const FLOOR_M: f64 = 0.15;
/// Places beside the start, m.
const PLACES: [[f64; 2]; 5] = [[0.0, 0.0], [0.8, 0.0], [-0.7, 0.5], [0.2, 0.9], [0.3, -0.8]];

#[derive(Debug)]
struct Touched {
    lengths_m: CableVec,
    /// True lengths from where the cables enter their wheels to the node, without stretch.
    true_m: CableVec,
    /// Largest tension as a share of that before, and height above the floor, at the detection.
    left: f64,
    height_m: f64,
}

fn paying(cycle: &Cycle) -> Paying {
    let (state, n) = (&cycle.state, cycle.truth_n.len());
    Paying {
        time_s: state.header.stamp_ns as f64 * 1e-9,
        command_m_s: CableVec::from_array8(&state.command_m_s, n),
        lengths_m: CableVec::from_array8(&state.length_m, n),
    }
}

fn line(to_m: Vector3<f64>, speed_m_s: f64) -> Leg {
    Leg::Line(Line { to_m: [to_m.x, to_m.y, to_m.z].into(), speed_m_s: Some(speed_m_s) })
}

fn mission(leg: Vec<Leg>) -> Mission {
    Mission {
        name: "down".to_owned(),
        speed_m_s: None,
        acceleration_m_s2: None,
        path: PathShape::Line,
        time_weight_w: 0.0,
        relative: false,
        leg,
    }
}

fn ended(cycle: &Cycle) -> bool {
    matches!(cycle.plan.state, PlanStatus::STATE_DONE | PlanStatus::STATE_ABORTED)
}

/// Flies to a place and lowers the node there; `None` if the motion ends before a touch-down.
fn lowered(drawn: &Drawn, flight: &mut Lockstep, place: [f64; 2], floor_m: f64, speed_m_s: f64) -> Option<Touched> {
    let start = Vector3::from(drawn.plant.start_m);
    let above = start + Vector3::new(place[0], place[1], 0.0);
    let down = Vector3::new(above.x, above.y, floor_m - BELOW_M);
    flight.run(&mission(vec![line(above, 0.2), line(down, speed_m_s)])).unwrap();
    let (mut detector, mut found, mut hanging_n) = (TouchDown::default(), None, CableVec::zeros(0));
    for _ in 0..20_000 {
        let cycle = flight.cycle().unwrap();
        if cycle.truth_m[2] > floor_m + 0.002 {
            hanging_n = cycle.truth_n;
        }
        if found.is_none()
            && let Some(lengths_m) = detector.step(&paying(&cycle))
        {
            let left = cycle.truth_n.zip_map(&hanging_n, |now, before| now / before).max_abs();
            let node = Vector3::from(cycle.truth_m);
            let true_m = CableVec::from_fn(cycle.truth_n.len(), |i| {
                let end = node + Vector3::from(drawn.plant.world.cables[i].attachment_m);
                drawn.true_anchors().pulley(i).length_m(&end)
            });
            flight.request(Request::Stop);
            found = Some(Touched { lengths_m, true_m, left, height_m: node.z - floor_m });
        }
        if cycle.authority.mode == A::MODE_FAULTED || ended(&cycle) {
            break;
        }
    }
    found
}

/// Recovers from the fault of the slack cables, and winds them up again; returns how many motions that took.
fn lifted(drawn: &Drawn, flight: &mut Lockstep, place: [f64; 2]) -> Option<usize> {
    let up = Vector3::from(drawn.plant.start_m) + Vector3::new(place[0], place[1], 0.0);
    for motions in 1..=20 {
        for request in [None, Some(Request::Reset), Some(Request::ConfirmPosition)] {
            request.into_iter().for_each(|request| flight.request(request));
            for _ in 0..200 {
                flight.cycle().unwrap();
            }
        }
        if flight.run(&mission(vec![line(up, 0.05)])).is_err() {
            continue;
        }
        loop {
            let cycle = flight.cycle().unwrap();
            if cycle.plan.state == PlanStatus::STATE_DONE {
                return Some(motions);
            }
            if cycle.plan.state == PlanStatus::STATE_ABORTED || cycle.authority.mode == A::MODE_FAULTED {
                break;
            }
        }
    }
    None
}

/// Worlds of the robots of 10 m. The lengths differ from the true ones by the zeros of the cables, the same
/// at every place; what is left is far below the 10 mm that a calibration assumes.
#[test]
fn the_lengths_of_a_touch_down_are_those_of_slack_cables_at_the_floor() {
    let (mut squares, mut count, mut most_m, mut motions) = (0.0, 0.0, 0.0f64, 0);
    for (name, seed) in
        ["demo3", "field3"].into_iter().flat_map(|name| (1..=number("NIMS_WORLDS", 3)).map(move |s| (name, s)))
    {
        let mut drawn = Drawn::new(name, seed);
        let floor_m = drawn.plant.start_m[2] - FLOOR_M;
        drawn.plant.node.ground_m = Some(floor_m);
        drawn.robot.robot.ground_m = floor_m - 2.0 * BELOW_M;
        let mut flight = drawn.lockstep();
        flight.zero_and_arm().unwrap();
        let mut off_m = Vec::new();
        for place in PLACES {
            let touched = lowered(&drawn, &mut flight, place, floor_m, 0.05).expect("a touch-down");
            // No cable carries load any more, and the node lies on the floor.
            assert!(touched.left < 0.05 && touched.height_m.abs() < 0.002, "{name} {seed}: {touched:?}");
            off_m.push(touched.lengths_m.zip_map(&touched.true_m, |read, is| read - is));
            motions += lifted(&drawn, &mut flight, place).expect("the node is lifted again");
        }
        for cable in 0..off_m[0].len() {
            let zero_m = off_m.iter().map(|off| off[cable]).sum::<f64>() / off_m.len() as f64;
            for rest_m in off_m.iter().map(|off| off[cable] - zero_m) {
                (squares, count, most_m) = (squares + rest_m * rest_m, count + 1.0, most_m.max(rest_m.abs()));
            }
        }
    }
    let rms_m = (squares / count).sqrt();
    println!(
        "{count} lengths: {:.2} mm RMS, {:.2} mm at most beside the zeros; {:.1} motions to lift the node again",
        1e3 * rms_m,
        1e3 * most_m,
        3.0 * motions as f64 / count
    );
    assert!(rms_m < 0.002 && most_m < 0.006, "{rms_m} {most_m}");
}

/// The heavy cables of a wide robot are never slack at once, so nothing is taken there, and nothing in flight.
#[test]
fn a_node_in_the_air_or_under_heavy_cables_does_not_touch_down() {
    let drawn = Drawn::new("river4", 1);
    let mut flight = drawn.lockstep();
    flight.zero_and_arm().unwrap();
    let floor_m = drawn.plant.start_m[2] - FLOOR_M - BELOW_M;
    assert!(lowered(&drawn, &mut flight, [0.8, 0.5], floor_m + BELOW_M, 0.1).is_none());
    let drawn = Drawn::new("demo3", 2);
    let mut flight = drawn.lockstep();
    flight.zero_and_arm().unwrap();
    assert!(lowered(&drawn, &mut flight, PLACES[2], 0.5, 0.1).is_none());
}
