//! The controller with known positions and motions.

use cable_control::law::PFeedforward;
use cable_robot::profile::ProfileLimits;
use cable_robot::{CableVec, Jacobian, NodeJacobian, Path, Profile, Robot, RobotParts, Segment, Vector3, elastic};
use config::{ControlLaw, ControllerSection};
use controller::{CableLaw, Controller, ControllerConfig, Inputs, Law, LawError, LawInput, Notice};
use messages::{ControlStatus, Header, MotorAuthority, MotorCommand, MotorState, NodeEstimate, PlanMotion};
use proptest::prelude::*;
use segments::segment_message;

const PERIOD_S: f64 = 0.01;
const HORIZON: u32 = 20;
const LIMIT_M_S: f64 = 0.8;
const REDUNDANT_S: f64 = 0.3;

fn robot(cables: usize) -> Robot {
    let anchors = [[0.0, 0.0, 3.05], [9.9, 0.1, 3.10], [9.8, 8.9, 2.98], [0.1, 9.0, 3.02]];
    Robot::new(RobotParts {
        anchors_m: anchors[..cables].to_vec(),
        node_mass_kg: 1.2,
        tension_limits_n: [1.0, 60.0],
        speed_limit_m_s: 0.4,
        acceleration_limit_m_s2: 0.5,
        stiffness_n: Some(6000.0),
        routed_length_m: Some(vec![6.0; cables]),
        ..RobotParts::default()
    })
    .unwrap()
}

/// A planar robot whose node floats in water, held only by the preload of the cables.
fn floating() -> Robot {
    Robot::new(RobotParts {
        anchors_m: vec![[0.0, 0.0, 4.2], [8.0, 0.0, 4.0], [8.2, 0.0, 0.3], [0.0, 0.0, 0.2]],
        planar: true,
        node_mass_kg: 6.0,
        net_weight_n: Some(0.0),
        drag_n_s2_m2: 25.0,
        tension_limits_n: [10.0, 80.0],
        speed_limit_m_s: 0.3,
        acceleration_limit_m_s2: 0.3,
        stiffness_n: Some(12_000.0),
        routed_length_m: Some(vec![4.0; 4]),
        ..RobotParts::default()
    })
    .unwrap()
}

/// A motion in the plane of that robot.
fn level_motion() -> PlanMotion {
    let path = Path::line(Vector3::new(2.5, 0.0, 2.0), Vector3::new(5.5, 0.0, 2.4));
    let profile = Profile::plan(&path, &ProfileLimits::rest_to_rest(0.2, 0.2)).unwrap();
    let segment = Segment { id: 5, path, profile, start_s: 1.0 };
    PlanMotion { current: segment_message(&segment), end_s: segment.end_s(), ..motion() }
}

fn controller(robot: Robot) -> Controller {
    Controller::new(config(robot, Law::lq_endpoint(0.0, 1.0).unwrap()))
}

fn authority(cycle: u64, plan_time_s: f64) -> MotorAuthority {
    MotorAuthority {
        header: Header { cycle, seq: cycle, ..Header::at(cycle * 10_000_000) },
        plan_time_s,
        plan_rate: 1.0,
        period_s: PERIOD_S,
        epoch: 4,
        mode: MotorAuthority::MODE_FOLLOWING,
        ..MotorAuthority::default()
    }
}

fn estimate(robot: &Robot, cycle: u64, position: Vector3<f64>) -> NodeEstimate {
    let choice = robot.default_distribution();
    let held = elastic::realise(robot, &position, &Vector3::zeros(), choice).unwrap();
    NodeEstimate {
        header: Header { cycle, seq: cycle, ..Header::at(cycle * 10_000_000) },
        position_m: position.into(),
        predicted_m: held.unstretched_m.to_array8(),
        valid: 1,
        cable_count: robot.cable_count() as u8,
        ..NodeEstimate::default()
    }
}

fn from() -> Vector3<f64> {
    Vector3::new(4.8, 3.0, 0.6)
}

fn motion() -> PlanMotion {
    let path = Path::line(from(), Vector3::new(5.8, 3.6, 1.0));
    let profile = Profile::plan(&path, &ProfileLimits::rest_to_rest(0.2, 0.3)).unwrap();
    let segment = Segment { id: 5, path, profile, start_s: 1.0 };
    PlanMotion {
        current: segment_message(&segment),
        end_s: segment.end_s(),
        motion: 1,
        epoch: 4,
        beat: 1,
        ..PlanMotion::default()
    }
}

fn step(
    controller: &mut Controller,
    estimate: &NodeEstimate,
    motion: Option<&PlanMotion>,
    authority: &MotorAuthority,
) -> MotorCommand {
    controller.step(&Inputs { estimates: [Some(estimate), None], motion, authority: Some(authority), state: None }).0
}

#[test]
fn without_a_motion_the_answer_is_valid_and_zero() {
    for cables in [3, 4] {
        let robot = robot(cables);
        let other = PlanMotion { epoch: 3, ..motion() };
        let none = PlanMotion { motion: 0, ..motion() };
        for motion in [None, Some(&other), Some(&none)] {
            let command = step(&mut controller(robot), &estimate(&robot, 8, from()), motion, &authority(8, 0.0));
            assert_eq!((command.valid, command.segment, command.velocity_m_s), ([1, 0], 0, [0.0; 16]));
            assert_eq!((command.based_on_cycle, command.epoch, command.incarnation), (8, 4, 9));
            assert_eq!(command.ttl_cycles, 3);
        }
    }
}

/// A run file orders samples by their stamps: one without a stamp would come first and cause apparent losses.
#[test]
fn an_answer_without_an_estimate_has_a_stamp() {
    let mut authority = authority(8, 0.0);
    authority.header.stamp_ns = 80;
    let mut state = messages::MotorState::default();
    state.header.stamp_ns = 70;
    for (state, wanted_ns) in [(Some(&state), 70), (None, 80)] {
        let seen = Inputs { estimates: [None, None], motion: None, authority: Some(&authority), state };
        let (command, status) = controller(robot(3)).step(&seen);
        assert_eq!((command.valid, command.header.stamp_ns, status.header.stamp_ns), ([0, 0], wanted_ns, wanted_ns));
    }
}

/// A restarted planner has no motion, while the robot is still in one.
#[test]
fn a_motion_continues_without_its_planner_while_the_epoch_is_valid() {
    let robot = robot(3);
    let motion = motion();
    let now = segments::segment_of(&motion.current).unwrap().setpoint(3.0);
    let is = estimate(&robot, 8, now.position);
    let mut controller = controller(robot);
    let under_way = MotorAuthority { motion: 1, ..authority(8, 3.0) };
    let before = step(&mut controller, &is, Some(&motion), &under_way);
    assert_eq!(before.segment, 5);
    let none = PlanMotion::default();
    let other = PlanMotion { motion: 7, beat: 0, ..motion };
    let another_first = PlanMotion { beat: 0, end_s: 2.0, ..motion };
    for planner in [None, Some(&none), Some(&other), Some(&another_first)] {
        assert_eq!(step(&mut controller, &is, planner, &under_way), before);
    }
    let stopped = MotorAuthority { epoch: 5, ..under_way };
    assert_eq!(step(&mut controller, &is, Some(&none), &stopped).segment, 0);
    let at_rest = MotorAuthority { motion: 0, ..under_way };
    assert_eq!(step(&mut controller, &is, Some(&none), &at_rest).segment, 0);
}

/// A restarted planner counts beats and motions from the beginning, and may offer another motion with the same numbers.
#[test]
fn the_motion_of_another_epoch_is_not_followed_for_its_numbers() {
    let robot = robot(3);
    let (motion, mut controller) = (motion(), controller(robot));
    let is = estimate(&robot, 8, from());
    assert_eq!(step(&mut controller, &is, Some(&motion), &authority(8, 1.5)).segment, 5);
    let mut another = PlanMotion { epoch: 5, ..motion };
    another.current.id = 6;
    let later = MotorAuthority { epoch: 5, ..authority(8, 1.5) };
    assert_eq!(step(&mut controller, &is, Some(&another), &later).segment, 6);
}

#[test]
fn before_its_start_a_segment_is_named_and_the_velocities_are_zero() {
    let robot = robot(4);
    let command = step(&mut controller(robot), &estimate(&robot, 8, from()), Some(&motion()), &authority(8, 0.0));
    assert_eq!((command.valid, command.segment), ([1, 0], 5));
    assert!(command.velocity_m_s.iter().all(|v| v.abs() < 1e-9), "{:?}", command.velocity_m_s);
}

#[test]
fn on_the_path_the_command_is_the_velocity_of_the_lengths() {
    for cables in [3, 4] {
        let robot = robot(cables);
        let motion = motion();
        let segment = segments::segment_of(&motion.current).unwrap();
        let now = segment.setpoint(3.0);
        assert!((now.velocity.norm() - 0.2).abs() < 1e-12);
        let is = estimate(&robot, 8, now.position);
        let command = step(&mut controller(robot), &is, Some(&motion), &authority(8, 3.0));
        // Mean velocity of the unstretched lengths over the horizon.
        let choice = robot.default_distribution();
        let hold = |t| {
            let at = segment.setpoint(t);
            elastic::realise(&robot, &at.position, &at.acceleration, choice).unwrap().unstretched_m
        };
        let horizon_s = PERIOD_S * f64::from(HORIZON);
        let expected = hold(3.0 + horizon_s).zip_map(&hold(3.0), |b, a| (b - a) / horizon_s);
        for i in 0..cables {
            assert!((command.velocity_m_s[i] - expected[i]).abs() < 1e-6, "{:?} {expected:?}", command.velocity_m_s);
        }
    }
}

#[test]
fn an_error_is_reduced_to_zero_within_the_horizon() {
    let robot = robot(3);
    let off = Vector3::new(0.01, -0.02, 0.005);
    let is = estimate(&robot, 8, from() + off);
    let command = step(&mut controller(robot), &is, Some(&motion()), &authority(8, 0.0));
    let jacobian = Jacobian::at(robot.anchors(), &(from() + off)).unwrap();
    let expected = jacobian.cable_velocity(&(-off / (PERIOD_S * f64::from(HORIZON))));
    for i in 0..3 {
        assert!((command.velocity_m_s[i] - expected[i]).abs() < 1e-12);
    }
}

/// Errors of the redundant lengths are corrected without moving the node: one direction for four cables in space, two
/// in a plane.
#[test]
fn the_redundant_lengths_are_corrected_without_moving_the_node() {
    let cases = [(robot(4), motion(), from(), 1), (floating(), level_motion(), Vector3::new(2.5, 0.0, 2.0), 2)];
    for (robot, motion, at, modes) in cases {
        let jacobian = Jacobian::at(robot.anchors(), &at).unwrap();
        let node: NodeJacobian = jacobian.node_jacobian().unwrap();
        let mut ways: Vec<CableVec> = Vec::new();
        for cable in 0..4 {
            // A vector minus the part that moves the node is a direction in which the lengths only change the tensions.
            let any = CableVec::from_fn(4, |i| f64::from(u8::from(i == cable)));
            let moving = jacobian.cable_velocity(&node.node_velocity(&any));
            let redundant = any.zip_map(&moving, |a, m| a - m);
            let mut is = estimate(&robot, 8, at);
            for i in 0..4 {
                is.predicted_m[i] += 0.004 * redundant[i];
            }
            let command = step(&mut controller(robot), &is, Some(&motion), &authority(8, 0.0));
            for i in 0..4 {
                let expected = -0.004 * redundant[i] / REDUNDANT_S;
                assert!((command.velocity_m_s[i] - expected).abs() < 1e-9, "{:?}", command.velocity_m_s);
            }
            assert!(node.node_velocity(&command.velocity_m_s[..4]).norm() < 1e-9);
            // The part that is orthogonal to the directions found so far.
            let rest = ways.iter().fold(redundant, |rest, way| {
                let along: f64 = rest.iter().zip(way.iter()).map(|(r, w)| r * w).sum();
                rest.zip_map(way, |r, w| r - along * w)
            });
            let size = rest.norm_squared().sqrt();
            if size > 1e-6 {
                ways.push(rest.map(|r| r / size));
            }
        }
        assert_eq!(ways.len(), modes);
    }
}

/// The tensions of the target balance the drag of the moving node.
#[test]
fn the_tensions_of_the_target_include_the_drag() {
    let (robot, motion) = (floating(), level_motion());
    let segment = segments::segment_of(&motion.current).unwrap();
    let now = segment.setpoint(8.0);
    assert!((now.velocity.norm() - 0.2).abs() < 1e-12 && now.acceleration.norm() < 1e-12);
    let is = estimate(&robot, 8, now.position);
    let (authority, mut controller) = (authority(8, 8.0), controller(robot));
    let inputs =
        Inputs { estimates: [Some(&is), None], motion: Some(&motion), authority: Some(&authority), state: None };
    let (_, status) = controller.step(&inputs);
    let jacobian = Jacobian::at(robot.anchors(), &now.position).unwrap();
    let force = jacobian.structure_matrix().force(&status.tension_n[..4]);
    assert!((force - now.velocity * (25.0 * 0.2)).norm() < 1e-9, "{force:?}");
}

#[test]
fn both_live_estimates_are_answered_and_an_old_one_is_not() {
    let robot = robot(3);
    let (a, b) = (estimate(&robot, 8, from()), estimate(&robot, 8, from() + Vector3::new(0.01, 0.0, 0.0)));
    let old = estimate(&robot, 7, from());
    let (motion, authority) = (motion(), authority(8, 0.0));
    let seen = |estimates| Inputs { estimates, motion: Some(&motion), authority: Some(&authority), state: None };
    let (both, status) = controller(robot).step(&seen([Some(&a), Some(&b)]));
    assert_eq!(both.valid, [1, 1]);
    assert_eq!(&both.velocity_m_s[..8], &step(&mut controller(robot), &a, Some(&motion), &authority).velocity_m_s[..8]);
    assert_ne!(&both.velocity_m_s[..3], &both.velocity_m_s[8..11]);
    assert!(status.error_norm_m < 1e-12, "the status is about the active estimate");
    let (second, status) = controller(robot).step(&seen([Some(&old), Some(&b)]));
    assert_eq!((second.valid, second.based_on_cycle), ([0, 1], 8));
    assert!((status.error_norm_m - 0.01).abs() < 1e-9);
    assert_eq!(controller(robot).step(&seen([None, None])).0.valid, [0, 0]);
}

#[test]
fn an_authority_that_is_one_cycle_old_is_extrapolated() {
    let robot = robot(3);
    let motion = motion();
    let segment = segments::segment_of(&motion.current).unwrap();
    let is = estimate(&robot, 8, segment.setpoint(3.0).position);
    let current = step(&mut controller(robot), &is, Some(&motion), &authority(8, 3.0));
    let behind = step(&mut controller(robot), &is, Some(&motion), &authority(7, 3.0 - PERIOD_S));
    for i in 0..3 {
        assert!((current.velocity_m_s[i] - behind.velocity_m_s[i]).abs() < 1e-9);
    }
    let lost = step(&mut controller(robot), &is, Some(&motion), &authority(1, 2.9));
    assert_eq!(lost.segment, 0, "an old authority does not determine the plan clock");
}

#[test]
fn far_from_the_setpoint_there_is_no_answer() {
    let robot = robot(3);
    let is = estimate(&robot, 8, from() + Vector3::new(0.3, 0.0, 0.0));
    let command = step(&mut controller(robot), &is, Some(&motion()), &authority(8, 0.0));
    assert_eq!((command.valid, command.velocity_m_s), ([0, 0], [0.0; 16]));
}

#[test]
fn each_law_has_a_number_and_errors_name_the_key() {
    for law in ControlLaw::ALL {
        let section = ControllerSection { law: *law, ..ControllerSection::default() };
        assert_eq!(Law::numbered(Law::from_section(&section).unwrap().number()), Some(*law));
    }
    let key = |law: Result<Law, LawError>| {
        let LawError::Parameter { key, .. } = law.unwrap_err();
        key
    };
    assert_eq!(key(Law::lq_endpoint(-1.0, 1.0)), "state_weight");
    assert_eq!(key(Law::lq_endpoint(0.0, f64::NAN)), "input_weight");
    let gain = |length_gain_per_s| {
        Law::from_section(&ControllerSection {
            law: ControlLaw::PFeedforward,
            length_gain_per_s,
            ..ControllerSection::default()
        })
    };
    assert_eq!(gain(2.0).unwrap().number(), ControlStatus::LAW_P_FEEDFORWARD);
    assert_eq!(key(gain(0.0)), "length_gain_per_s");
}

fn config(robot: Robot, law: Law) -> ControllerConfig {
    ControllerConfig {
        robot,
        law,
        horizon: HORIZON,
        distribution: robot.default_distribution(),
        redundant_s: REDUNDANT_S,
        cable_speed_limit_m_s: LIMIT_M_S,
        error_limit_m: 0.25,
        ttl_cycles: 3,
        estimate_ttl_cycles: 3,
        thread: 0,
        incarnation: 9,
    }
}

/// On the path, p-feedforward commands the velocities of the lengths (by finite differences); with a length error, its
/// gain times the error is added, per cable.
#[test]
fn p_feedforward_adds_the_desired_velocity_and_the_length_error() {
    for cables in [3, 4] {
        let robot = robot(cables);
        let motion = motion();
        let segment = segments::segment_of(&motion.current).unwrap();
        let at = |time_s: f64| estimate(&robot, 8, segment.setpoint(time_s).position);
        let law = Law::PFeedforward(PFeedforward::new(2.5).unwrap());
        let mut controller = Controller::new(config(robot, law));
        let (command, status) = controller.step(&Inputs {
            estimates: [Some(&at(3.0)), None],
            motion: Some(&motion),
            authority: Some(&authority(8, 3.0)),
            state: None,
        });
        assert_eq!((command.valid, status.law), ([1, 0], ControlStatus::LAW_P_FEEDFORWARD));
        let (before, after) = (at(2.99).predicted_m, at(3.01).predicted_m);
        for i in 0..cables {
            let expected = (after[i] - before[i]) / 0.02;
            assert!((command.velocity_m_s[i] - expected).abs() < 2e-4, "{} {expected}", command.velocity_m_s[i]);
        }
        let mut behind = at(3.0);
        behind.predicted_m[1] -= 0.004;
        let pulled = step(&mut controller, &behind, Some(&motion), &authority(8, 3.0));
        for i in 0..cables {
            let more = if i == 1 { 0.01 } else { 0.0 };
            assert!((pulled.velocity_m_s[i] - command.velocity_m_s[i] - more).abs() < 1e-12);
        }
    }
}

/// The command of the controller is finite and within the limits for any output of a custom law.
#[test]
fn the_output_of_a_custom_law_is_limited() {
    struct Recorded(Vec<Option<CableVec>>);
    impl CableLaw for Recorded {
        fn velocity(&mut self, input: &LawInput<'_>) -> Option<CableVec> {
            assert_eq!((input.slot, input.period_s), (0, PERIOD_S));
            self.0.pop()?
        }
    }
    let robot = robot(3);
    let vec = |values: &[f64]| Some(CableVec::from_slice(values).unwrap());
    let outputs = [vec(&[0.1, -0.2, 0.0]), vec(&[8.0, -4.0, 0.8]), vec(&[f64::NAN, 0.0, 0.0]), vec(&[0.1, 0.1]), None];
    let expected = [Some([0.1, -0.2, 0.0]), Some([LIMIT_M_S, -0.5 * LIMIT_M_S, 0.1 * LIMIT_M_S]), None, None, None];
    let recorded = Recorded(outputs.into_iter().rev().collect());
    let law = Law::lq_endpoint(0.0, 1.0).unwrap();
    let mut controller = Controller::with_law(config(robot, law), Box::new(recorded));
    for (cycle, expected) in (8..).zip(expected) {
        let is = estimate(&robot, cycle, from());
        let command = step(&mut controller, &is, Some(&motion()), &authority(cycle, 0.0));
        // A second step in the same cycle returns the same command without calling the law.
        assert_eq!(step(&mut controller, &is, Some(&motion()), &authority(cycle, 0.0)), command);
        assert_eq!(command.valid, [u8::from(expected.is_some()), 0]);
        for (is, wanted) in command.velocity_m_s.iter().zip(expected.unwrap_or_default()) {
            assert!((is - wanted).abs() < 1e-12);
        }
    }
}

fn any_number() -> impl Strategy<Value = f64> {
    prop_oneof![-10.0..10.0f64, 0.0..5.0f64, Just(f64::NAN), Just(f64::NEG_INFINITY), Just(1e300), any::<f64>()]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(128))]

    /// Anywhere in the volume, at any time and rate, the command is finite and within the limits.
    #[test]
    fn a_valid_answer_is_finite_and_within_the_limits(
        x in 2.0..8.0f64, y in 2.0..7.0f64, z in 0.1..2.5f64,
        plan_time_s in 0.0..10.0f64, rate in 0.0..=1.0f64, cables in 3usize..=4, shift in -0.3..0.3f64,
    ) {
        let robot = robot(cables);
        let mut authority = authority(8, plan_time_s);
        authority.plan_rate = rate;
        let mut is = estimate(&robot, 8, from());
        is.position_m = [x, y, z];
        is.predicted_m[0] += shift;
        let near = [4.8 + 0.1 * (x - 5.0), 3.0 + 0.1 * (y - 4.0), 0.6 + 0.1 * (z - 1.0)];
        for position_m in [[x, y, z], near] {
            is.position_m = position_m;
            let command = step(&mut controller(robot), &is, Some(&motion()), &authority);
            prop_assert!(command.velocity_m_s.iter().all(|v| v.is_finite() && v.abs() <= LIMIT_M_S));
        }
    }

    /// With any content of the inputs there is no panic, and the velocities are finite and within the limits.
    #[test]
    fn arbitrary_inputs_give_limited_velocities(
        numbers in proptest::collection::vec(any_number(), 24), flags in any::<[u8; 4]>(), period in any_number(),
        stamp in any::<u64>(), kind in 0u8..6, knots in 0u32..40,
    ) {
        let robot = robot(4);
        let mut authority = authority(8, numbers[0]);
        (authority.plan_rate, authority.period_s, authority.bus_ns) = (numbers[1], period, stamp);
        authority.active_estimator = flags[0];
        let mut is = estimate(&robot, 8, from());
        is.header.stamp_ns = stamp;
        is.position_m = [numbers[2], numbers[3], numbers[4]];
        is.predicted_m = std::array::from_fn(|i| numbers[5 + i]);
        (is.valid, is.cable_count) = (flags[1] % 3, flags[2] % 9);
        let mut plan = motion();
        (plan.current.kind, plan.current.knot_count, plan.current.start_s) = (kind, knots, numbers[13]);
        plan.current.shape = std::array::from_fn(|i| numbers[14 + i]);
        plan.next = plan.current;
        let mut controller = controller(robot);
        for _ in 0..2 {
            let command = step(&mut controller, &is, Some(&plan), &authority);
            prop_assert!(command.velocity_m_s.iter().all(|v| v.is_finite() && v.abs() <= LIMIT_M_S));
            plan.beat += 1;
        }
    }
}

/// Returns whether the preview law notices that the drives do not follow their model, in ten seconds. `at` returns
/// command, m/s, and length, m, of all cables at a time; `set`, the lengths as they were set, m, and the epoch.
fn misfits(period_s: f64, mut at: impl FnMut(f64) -> (f64, f64), set: impl Fn(f64) -> (f64, u32)) -> bool {
    let section = ControllerSection {
        law: ControlLaw::Preview,
        drive_lag_s: Some([0.05, 0.05]),
        identify: false,
        ..ControllerSection::default()
    };
    let robot = robot(3);
    let mut controller = Controller::new(config(robot, Law::from_section(&section).unwrap()));
    let mut found = false;
    for cycle in 1..(10.0 / period_s) as u64 {
        let now_s = cycle as f64 * period_s;
        let header = Header { cycle, seq: cycle, ..Header::at((now_s * 1e9).round() as u64) };
        let ((command_m_s, length_m), (zeroed_m, epoch)) = (at(now_s), set(now_s));
        let state = MotorState {
            header,
            length_m: [length_m; 8],
            zeroed_m: [zeroed_m; 8],
            command_m_s: [command_m_s; 8],
            sampled_ns: [header.stamp_ns; 8],
            fresh: [1; 8],
            cable_count: 3,
            ..MotorState::default()
        };
        let authority = MotorAuthority { header, period_s, epoch, ..authority(cycle, 0.0) };
        let estimate = NodeEstimate { header, ..estimate(&robot, cycle, from()) };
        let (authority, state) = (Some(&authority), Some(&state));
        controller.step(&Inputs { estimates: [Some(&estimate), None], motion: None, authority, state });
        found |= matches!(controller.notice(), Some(Notice::Misfit { .. }));
    }
    found
}

/// Cables faster than 1 m/s move by more than 10 cm in a cycle of 10 Hz: their model must be compared too.
#[test]
fn a_wrong_model_of_fast_cables_is_found_at_every_rate() {
    for period_s in [0.01, 0.1] {
        let mut length_m = 5.0;
        // The drives follow 0.4 s late.
        let command_m_s = |time_s: f64| if time_s.rem_euclid(2.0) < 1.0 { 1.2 } else { -1.6 };
        let late = |now_s: f64| {
            length_m += command_m_s(now_s - 0.4) * period_s;
            (command_m_s(now_s), length_m)
        };
        assert!(misfits(period_s, late, |_| (5.0, 4)), "{period_s} s");
    }
}

/// Lengths that are set while the drives stand are no motion of theirs, at 10 Hz up to 1 m either.
#[test]
fn set_lengths_are_no_misfit() {
    let later = |now_s: f64| now_s > 5.0;
    let jumps = |now_s: f64| (0.0, if later(now_s) { 5.9 } else { 5.0 });
    assert!(misfits(0.1, jumps, |_| (5.0, 4)));
    assert!(!misfits(0.1, jumps, |now_s| (if later(now_s) { 5.9 } else { 5.0 }, 4)));
    // Set to what they were set to before, each time: only the epoch tells.
    assert!(!misfits(0.1, jumps, |now_s| (5.9, 4 + u32::from(later(now_s)))));
    // Lengths that were never set stay unknown.
    assert!(misfits(0.1, jumps, |_| (f64::NAN, 4)));
}
