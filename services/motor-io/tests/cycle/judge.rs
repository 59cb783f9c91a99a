//! motor-io judges motions and commands by its own lengths, independent of estimator, controller and planner.

use crate::rig;

use cable_robot::{Jacobian, Vector3};
use messages::{CABLES, MotorAuthority as A, MotorSlots, Request, Slot, SlotRole};
use rig::{PERIOD_S, Rig};
use robot_state::Reason;

const HERE: [f64; 3] = [4.8, 3.0, 0.8];

/// Armed, the node at [`HERE`].
fn ready() -> Rig {
    let mut rig = Rig::default();
    rig.steps(3);
    rig.demand(Request::ZeroAt { position_m: HERE });
    rig.demand(Request::Arm);
    rig
}

/// The cable velocities that move the node like this where it is now.
fn cables(velocity: Vector3<f64>) -> [f64; CABLES] {
    let config = rig::config();
    let jacobian = Jacobian::at(config.robot.anchors(), &Vector3::from(HERE)).unwrap();
    jacobian.cable_velocity(&velocity).to_array8()
}

fn here() -> Vector3<f64> {
    Vector3::from(HERE)
}

/// Flies east at 0.2 m/s with perfect commands.
fn flying() -> Rig {
    let mut rig = ready();
    rig.offer_line(here(), here() + Vector3::new(2.0, 0.0, 0.0), 0.2);
    rig.until(5, |rig| rig.mode() == A::MODE_FOLLOWING);
    for _ in 0..100 {
        let planned = Vector3::from(rig.last.as_ref().unwrap().input.setpoint_velocity_m_s);
        rig.controller = Some(cables(planned));
        rig.step();
    }
    assert_eq!((rig.mode(), rig.faults()), (A::MODE_FOLLOWING, 0));
    assert!(rig.seen().state.setpoint_distance_m < 0.05, "{}", rig.seen().state.setpoint_distance_m);
    rig
}

#[test]
fn the_judge_computes_the_position_of_the_node() {
    let rig = ready();
    assert!((Vector3::from(rig.seen().state.node_m) - here()).norm() < 0.002, "{:?}", rig.seen().state.node_m);
    let blind = Rig::default();
    assert!({ blind }.step().seen.state.node_m[0].is_nan(), "nothing is known before a zero");
}

#[test]
fn a_motion_that_begins_elsewhere_is_not_started_and_one_that_begins_here_is() {
    let mut rig = ready();
    rig.offer_line(here() + Vector3::new(0.0, 0.0, 0.2), here() - Vector3::new(0.0, 0.0, 0.3), 0.2);
    rig.steps(20);
    assert_eq!((rig.mode(), rig.faults()), (A::MODE_HOLDING, A::FAULT_OFF_START));
    assert!(rig.last.as_ref().unwrap().sent.is_hold());
    rig.offer_line(here(), here() - Vector3::new(0.0, 0.0, 0.3), 0.2);
    rig.until(5, |rig| rig.mode() == A::MODE_FOLLOWING);
    assert_eq!(rig.faults(), 0);
}

#[test]
fn commands_that_lead_away_from_the_setpoint_are_a_fault_with_a_name() {
    let bound = rig::config();
    for answer in [Vector3::zeros(), Vector3::new(-0.3, 0.0, 0.0), Vector3::new(0.2, 0.0, 0.4)] {
        let mut rig = flying();
        rig.controller = Some(cables(answer));
        rig.until(200, |rig| rig.mode() == A::MODE_FAULTED);
        assert_eq!(rig.faults(), A::FAULT_DIVERGING);
        let off_m = rig.seen().state.setpoint_distance_m;
        let speed_m_s = bound.node_speed_m_s() + bound.robot.speed_limit_m_s();
        assert!(off_m < bound.divergence_m + speed_m_s * (bound.divergence_s + 5.0 * PERIOD_S), "{off_m}");
        rig.until(100, |rig| rig.last.as_ref().unwrap().sent.is_hold());
        // It stays a fault until it is reset, and then the robot holds.
        rig.demand(Request::Reset);
        assert_eq!((rig.mode(), rig.faults()), (A::MODE_HOLDING, 0));
    }
}

#[test]
fn neither_the_speed_of_the_node_nor_its_change_leaves_their_bounds() {
    let bound = rig::config();
    let mut rig = flying();
    let mut before = Vector3::from(rig.seen().state.node_command_m_s);
    for (cycle, answer) in
        [Vector3::new(2.0, 0.0, 0.0), Vector3::new(0.0, 0.5, 1.5)].iter().cycle().take(60).enumerate()
    {
        rig.controller = Some(cables(*answer));
        rig.step();
        let now = Vector3::from(rig.seen().state.node_command_m_s);
        assert!(now.norm() <= bound.node_speed_m_s() * (1.0 + 1e-3), "cycle {cycle}: {now:?}");
        // The position changes between two cycles, and with it what the same command does.
        let step = bound.node_acceleration_m_s2 * PERIOD_S;
        assert!((now - before).norm() <= 1.05 * step + 1e-6, "cycle {cycle}: {}", (now - before).norm());
        before = now;
    }
}

#[test]
fn a_controller_adds_no_more_to_the_setpoints_velocity_than_the_correction_limit() {
    let bound = rig::config();
    let mut rig = flying();
    rig.controller = Some(cables(Vector3::new(0.2, 0.0, 1.0)));
    for _ in 0..15 {
        rig.step();
        let last = rig.last.as_ref().unwrap();
        let planned = Vector3::from(last.input.setpoint_velocity_m_s) * last.seen.authority.plan_rate;
        let added = (Vector3::from(last.seen.state.node_command_m_s) - planned).norm();
        assert!(added <= bound.correction_limit_m_s * 1.05, "{added}");
    }
}

/// Flies three seconds with a second controller beside a good one. Returns the phase of slot b then, and the answer to
/// a swap to it.
fn beside(second: impl Fn(Vector3<f64>) -> [f64; CABLES]) -> (u8, Reason) {
    let mut rig = flying();
    for _ in 0..300 {
        let planned = Vector3::from(rig.last.as_ref().unwrap().input.setpoint_velocity_m_s);
        rig.controller = Some(cables(planned));
        rig.second = Some(second(planned));
        rig.step();
    }
    let phase = rig.seen().slots.phase[1];
    (phase, rig.reason(Request::Swap { role: SlotRole::Controller, slot: Slot::B }))
}

#[test]
fn a_new_process_that_answers_zeros_or_is_biased_does_not_take_over() {
    let (phase, reason) = beside(cables);
    assert!(phase == MotorSlots::PHASE_QUALIFIED && reason.accepted() == 1, "{reason}");
    let biased = |planned| {
        let mut all = cables(planned);
        all[1] += 0.1;
        all
    };
    let zeros = |_| [0.0; CABLES];
    for (phase, reason) in [beside(zeros), beside(biased)] {
        assert_eq!(phase, MotorSlots::PHASE_SHADOW, "{reason}");
        assert!(matches!(reason, Reason::NotSwapped { why, .. } if why.moves_off.is_some()), "{reason}");
    }
}
