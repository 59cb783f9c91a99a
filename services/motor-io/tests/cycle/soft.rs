//! Soft mode: when it begins, which currents it gives, and what ends it.

use crate::counting::allocations;
use crate::rig::{COUNTS_PER_M, PERIOD_S, Rig, config, lengths};
use cable_robot::motor::Motor;
use cable_robot::{Robot, Vector3, elastic, tension};
use messages::{CABLES, MotorAuthority as A, MotorInput, MotorState, Request};
use motor_io::CoreConfig;
use proptest::prelude::*;
use robot_state::Reason;

/// Force constant of the motors, N/A.
const FORCE_N_A: f64 = 20.0;

/// The rig's robot with motors that a hand can drive back.
fn back_drivable() -> CoreConfig {
    let before = config();
    let motor = Motor { gear_friction: 0.1, coulomb_n: 1.0, force_constant_n_a: FORCE_N_A, ..Motor::default() };
    let robot = Robot::new(cable_robot::RobotParts { motor, ..crate::rig::parts() }).unwrap();
    CoreConfig { robot, current_limit_a: 10.0, ..before }
}

/// Cycles at rest after which the loops of the drives hold the node, and their currents are its load.
const WAIT_CYCLES: u32 = 420;

/// Lengths at which the node hangs well, m.
const LENGTHS_M: [f64; 3] = [6.2; 3];

fn ready(config: CoreConfig) -> Rig {
    let wait = config.cycles(f64::from(WAIT_CYCLES) * PERIOD_S);
    let mut rig = Rig::new(config);
    rig.length_m[..3].copy_from_slice(&LENGTHS_M);
    rig = rig.ready();
    rig.demand(lengths(LENGTHS_M));
    rig.steps(wait);
    rig
}

fn armed() -> Rig {
    ready(back_drivable())
}

fn soft() -> Rig {
    let mut rig = armed();
    rig.demand(Request::Soft);
    assert_eq!(rig.mode(), A::MODE_SOFT);
    rig
}

/// A hand moves the cables at these speeds, m/s, for so many cycles.
fn lead(rig: &mut Rig, m_s: [f64; 3], cycles: u32) {
    for _ in 0..cycles {
        let period_s = rig.period_s;
        for (length_m, v) in rig.length_m.iter_mut().zip(m_s) {
            *length_m += v * period_s;
        }
        rig.step();
    }
}

fn currents_a(rig: &Rig) -> [f64; CABLES] {
    rig.last.as_ref().unwrap().sent.current_a.unwrap()
}

#[test]
fn at_rest_the_currents_carry_the_weight() {
    let mut rig = soft();
    let robot = back_drivable().robot;
    // They begin with what held the node before.
    assert!(currents_a(&rig)[..3].iter().all(|a| (a - 0.5).abs() < 0.01), "{:?}", currents_a(&rig));
    rig.steps(400);
    let at = elastic::equilibrium(&robot, &LENGTHS_M, &Vector3::zeros(), None).unwrap().position;
    let held = tension::at(&robot, &at, &Vector3::zeros(), back_drivable().distribution).unwrap();
    for (current_a, tension_n) in currents_a(&rig).iter().zip(held.tensions_n.iter()) {
        assert!((current_a - tension_n / FORCE_N_A).abs() < 0.01, "{current_a} A for {tension_n} N");
    }
    assert!(rig.last.as_ref().unwrap().sent.speed_m_s == [0.0; CABLES]);
}

/// The loop of a drive turns its motor to and fro by a step of the encoder, so that no single reading is the load.
#[test]
fn it_begins_with_the_currents_that_held_the_node_on_average() {
    let mut rig = armed();
    for _ in 0..50 {
        for current_a in [0.2, 0.5, 0.7, 0.6] {
            rig.current_a[0] = current_a;
            rig.step();
        }
    }
    rig.current_a[0] = 0.2;
    rig.demand(Request::Soft);
    assert_eq!(rig.mode(), A::MODE_SOFT);
    assert!((currents_a(&rig)[0] - 0.5).abs() < 0.02, "{:?}", currents_a(&rig));
}

#[test]
fn a_sinking_node_is_carried_with_more_and_a_rising_one_with_less() {
    let mut rig = soft();
    rig.steps(300);
    let at_rest = currents_a(&rig);
    lead(&mut rig, [0.02; 3], 20);
    assert!((0..3).all(|i| currents_a(&rig)[i] > 1.05 * at_rest[i]), "{at_rest:?} {:?}", currents_a(&rig));
    // What the hand has left stays there, and is pulled back by the added friction only.
    rig.steps(100);
    assert!((0..3).all(|i| currents_a(&rig)[i] < 1.3 * at_rest[i]), "{at_rest:?} {:?}", currents_a(&rig));
    lead(&mut rig, [-0.02; 3], 60);
    assert!((0..3).all(|i| currents_a(&rig)[i] < at_rest[i]), "{at_rest:?} {:?}", currents_a(&rig));
    assert_eq!((rig.mode(), rig.faults()), (A::MODE_SOFT, 0));
}

#[test]
fn it_begins_only_where_it_can() {
    let mut rig = Rig::new(back_drivable());
    rig.length_m[..3].copy_from_slice(&LENGTHS_M);
    rig.steps(3);
    assert_eq!(rig.reason(Request::Soft), Reason::NotSoftDisarmed);
    rig.demand(Request::Arm);
    assert_eq!(rig.reason(Request::Soft), Reason::NotSoftPosition);
    rig.demand(lengths(LENGTHS_M));
    rig.steps(WAIT_CYCLES);
    rig.demand(Request::Soft);
    assert_eq!(rig.reason(Request::Soft), Reason::AlreadySoft);
    for request in [Request::Reset, lengths(LENGTHS_M), Request::Jog { cable: 1, distance_m: 0.1 }, Request::Resume] {
        assert!(!rig.ask(request).0);
        assert_eq!(rig.mode(), A::MODE_SOFT);
    }
    rig.demand(Request::Estop);
    assert_eq!(rig.reason(Request::Soft), Reason::NotSoftFault);

    let mut rig = ready(CoreConfig { port_without_torque: Some(2), ..back_drivable() });
    assert_eq!(rig.reason(Request::Soft), Reason::NotSoftDrives { port: 2 });
    let mut rig = ready(config());
    assert!(matches!(rig.reason(Request::Soft), Reason::NotSoftGear { cable: 1, .. }), "a gear of 0.85");
    let mut rig = armed();
    rig.demand(Request::Jog { cable: 1, distance_m: 0.1 });
    assert_eq!(rig.reason(Request::Soft), Reason::NotSoftMoving);
    let mut rig = armed();
    rig.unit[0] = MotorInput::UNIT_SILENT;
    rig.step();
    assert_eq!(rig.reason(Request::Soft), Reason::NotSoftYet);
}

/// After each end the cables come to rest and hold, and the lengths were counted on.
fn assert_held(rig: &mut Rig, mode: u8, stops: u32) {
    rig.until(100, |rig| rig.mode() != A::MODE_STOPPING);
    assert_eq!((rig.mode(), rig.faults() & messages::faults::STOPS), (mode, stops));
    rig.step();
    assert_eq!(rig.last.as_ref().unwrap().sent.current_a, None);
    assert_eq!(rig.last.as_ref().unwrap().sent.speed_m_s, [0.0; CABLES]);
    assert_eq!(rig.seen().state.position_known, MotorState::POSITION_KNOWN);
    for (i, counts_per_m) in COUNTS_PER_M.iter().enumerate() {
        let step_m = 1.0 / counts_per_m.abs();
        assert!((rig.seen().state.length_m[i] - rig.length_m[i]).abs() < 2.0 * step_m);
    }
}

/// A drive whose loop was reset gives no current for a moment.
#[test]
fn it_does_not_begin_with_currents_of_a_reset_loop() {
    for waits in [50, 51, 100, 299, 300, 301, 320, 390] {
        let mut rig = Rig::new(back_drivable());
        rig.length_m[..3].copy_from_slice(&LENGTHS_M);
        rig = rig.ready();
        rig.demand(lengths(LENGTHS_M));
        for _ in 0..waits {
            let released = rig.step().sent.released[..3] == [true; 3];
            rig.current_a = [if released { 0.0 } else { 0.5 }; CABLES];
        }
        assert_eq!(rig.reason(Request::Soft), Reason::NotSoftYet, "{waits} cycles");
        // After the wait it takes a current of each unit.
        rig.slow = 0;
        rig.steps(WAIT_CYCLES - waits);
        assert_eq!(rig.reason(Request::Soft), Reason::NotSoftYet, "without readings, {waits} cycles");
        rig.slow = MotorInput::SLOW_ALL;
        rig.step();
        rig.demand(Request::Soft);
        assert!(currents_a(&rig)[..3].iter().all(|a| (a - 0.5).abs() < 0.01), "{:?}", currents_a(&rig));
    }
}

#[test]
fn requests_end_it() {
    for (request, mode) in [
        (Request::Hold, A::MODE_HOLDING),
        (Request::Pause, A::MODE_HOLDING),
        (Request::Stop, A::MODE_HOLDING),
        (Request::Estop, A::MODE_EMERGENCY_STOP),
    ] {
        let mut rig = soft();
        lead(&mut rig, [0.05, -0.03, 0.01], 100);
        rig.demand(request);
        assert_held(&mut rig, mode, 0);
    }
}

/// The cables brake from the velocities that the hand gave them, as after any other motion.
#[test]
fn the_node_brakes_where_it_is_held() {
    let config = back_drivable();
    let (cables_m_s, nodes_m_s) = (config.cable_acceleration_m_s2 * PERIOD_S, config.node_acceleration_m_s2 * PERIOD_S);
    for m_s in [[0.15, -0.1, 0.05], [-0.1, -0.1, -0.1], [0.02, 0.0, 0.0]] {
        let mut rig = soft();
        lead(&mut rig, m_s, 60);
        rig.velocity_m_s[..3].copy_from_slice(&m_s);
        let mut before_m_s: [f64; 3] = m_s;
        rig.demand(Request::Hold);
        let mut node_before: Option<Vector3<f64>> = None;
        for _ in 0..100 {
            let sent_m_s = rig.last.as_ref().unwrap().sent.speed_m_s;
            for (i, before) in before_m_s.iter_mut().enumerate() {
                // Readings have steps of a tenth of a millimetre.
                let allowed_m_s = cables_m_s + if node_before.is_none() { 0.012 } else { 1e-9 };
                assert!((sent_m_s[i] - *before).abs() <= allowed_m_s, "cable {}: {before} to {sent_m_s:?}", i + 1);
                *before = sent_m_s[i];
            }
            let now = Vector3::from(rig.seen().state.node_command_m_s);
            if let Some(before) = node_before.replace(now) {
                assert!((now - before).norm() <= nodes_m_s + 0.002, "{before} to {now} m/s");
            }
            if rig.mode() == A::MODE_HOLDING {
                break;
            }
            rig.step();
        }
        assert_held(&mut rig, A::MODE_HOLDING, 0);
    }
}

#[test]
fn a_led_node_is_not_let_go() {
    let mut rig = soft();
    lead(&mut rig, [0.05, -0.03, 0.01], 100);
    assert_eq!(rig.reason(Request::Disarm), Reason::NotDisarmedMoving);
    assert_eq!(rig.mode(), A::MODE_SOFT);
    rig.demand(Request::Hold);
    rig.until(100, |rig| rig.mode() == A::MODE_HOLDING);
    rig.demand(Request::Disarm);
    assert_eq!(rig.mode(), A::MODE_DISARMED);
}

#[test]
fn a_cable_that_runs_away_ends_it_in_three_cycles() {
    let limit_m_s = 0.5 * back_drivable().cable_speed_m_s;
    let mut rig = soft();
    lead(&mut rig, [0.9 * limit_m_s, 0.0, 0.0], 60);
    assert_eq!(rig.mode(), A::MODE_SOFT);
    let mut rig = soft();
    rig.steps(50);
    // A cable that breaks is reeled in by its motor.
    lead(&mut rig, [0.0, -1.6 * limit_m_s, 0.0], 8);
    assert_held(&mut rig, A::MODE_HOLDING, A::FAULT_SOFT_SPEED);
    rig.steps(WAIT_CYCLES);
    assert_eq!(rig.mode(), A::MODE_HOLDING);
    rig.demand(Request::Soft);
    assert_eq!(rig.faults(), 0);
}

/// Time for which a cable may run away, s.
fn runs_away_for_s(rate_hz: f64) -> f64 {
    let config = CoreConfig { period_s: 1.0 / rate_hz, ..back_drivable() };
    let limit_m_s = 0.5 * config.cable_speed_m_s;
    let mut rig = ready(config);
    rig.demand(Request::Soft);
    rig.steps(50);
    for cycle in 1..100 {
        lead(&mut rig, [0.0, -1.6 * limit_m_s, 0.0], 1);
        if rig.mode() != A::MODE_SOFT {
            assert_eq!(rig.faults() & A::FAULT_SOFT_SPEED, A::FAULT_SOFT_SPEED, "{rate_hz} Hz: {:#x}", rig.faults());
            return f64::from(cycle) / rate_hz;
        }
    }
    panic!("{rate_hz} Hz: still soft");
}

/// A reading that a hiccup of the machine has made late is not shorter at a higher rate.
#[test]
fn above_250_hz_a_cable_may_run_away_for_as_long_as_at_250_hz() {
    let at_250_hz_s = runs_away_for_s(250.0);
    assert!((runs_away_for_s(500.0) - at_250_hz_s).abs() < 0.003, "{} {at_250_hz_s}", runs_away_for_s(500.0));
}

#[test]
fn a_border_ends_it_before_it_is_reached() {
    let mut config = back_drivable();
    config.robot = Robot::new(cable_robot::RobotParts {
        motor: *config.robot.motor(),
        length_limits_m: Some(vec![[0.3, 6.4]; 3]),
        ..crate::rig::parts()
    })
    .unwrap();
    let mut rig = ready(config);
    rig.demand(Request::Soft);
    for _ in 0..400 {
        lead(&mut rig, [0.05, 0.0, 0.0], 1);
        if rig.mode() != A::MODE_SOFT {
            break;
        }
    }
    assert_held(&mut rig, A::MODE_HOLDING, A::FAULT_BORDER);
    assert!((6.3..6.4).contains(&rig.length_m[0]), "{} m", rig.length_m[0]);
}

#[test]
fn gaps_missing_readings_and_a_lost_supervisor_end_it() {
    let mut rig = soft();
    rig.steps(20);
    rig.step_after(400_000_000, 50_000);
    assert_held(&mut rig, A::MODE_HOLDING, A::FAULT_LONG_GAP);

    let mut rig = soft();
    rig.steps(20);
    rig.unit[1] = MotorInput::UNIT_RESYNC;
    rig.steps(3);
    assert_eq!(rig.mode(), A::MODE_SOFT);
    rig.step();
    rig.unit[1] = MotorInput::UNIT_OK;
    assert_held(&mut rig, A::MODE_HOLDING, A::FAULT_LONG_GAP);

    let mut rig = soft();
    rig.supervisor = None;
    rig.until(400, |rig| rig.mode() != A::MODE_SOFT);
    assert_held(&mut rig, A::MODE_HOLDING, A::FAULT_SUPERVISOR_LOST);
}

#[test]
fn hard_faults_end_it_as_ever() {
    let mut rig = soft();
    rig.unit[1] = MotorInput::UNIT_LOST;
    rig.steps(4);
    assert_eq!(rig.mode(), A::MODE_FAULTED);
    assert_eq!(rig.last.as_ref().unwrap().sent.current_a, None);
    let mut rig = soft();
    rig.supply_v = 5.0;
    rig.until(20, |rig| rig.mode() == A::MODE_FAULTED);
    let mut rig = soft();
    rig.current_a[0] = 12.0;
    rig.until(60, |rig| rig.mode() == A::MODE_FAULTED);
    assert_ne!(rig.faults() & A::FAULT_OVER_CURRENT, 0);
}

#[test]
fn it_allocates_nothing() {
    let mut rig = soft();
    let mut core = rig.core.clone();
    let mut inputs = Vec::new();
    for cycle in 0..60 {
        lead(&mut rig, [0.1, -0.1, 0.05], 1);
        let mut input = rig.last.as_ref().unwrap().input;
        if cycle == 59 {
            input.request[0] = Request::Hold.body();
        }
        inputs.push(input);
    }
    let count = allocations(|| {
        for input in &inputs {
            std::hint::black_box((core.decide(input), core.observe(input)));
        }
    });
    assert_eq!(count, 0);
}

#[test]
fn no_motion_begins_in_it() {
    let mut rig = soft();
    rig.offer(1000.0);
    rig.steps(50);
    assert_eq!((rig.mode(), rig.seen().authority.motion), (A::MODE_SOFT, 0));
    rig.demand(Request::Hold);
    rig.until(100, |rig| rig.mode() == A::MODE_HOLDING);
    rig.offer(1000.0);
    rig.until(20, |rig| rig.mode() == A::MODE_FOLLOWING);
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 40, failure_persistence: None, ..ProptestConfig::default() })]

    /// Whatever a hand does: currents stay within what the tension limits allow and the drives give, and the robot is
    /// soft or holds.
    #[test]
    fn currents_stay_within_the_limits(ways in prop::collection::vec(prop::array::uniform3(-0.4..0.4f64), 1..30)) {
        let mut rig = soft();
        let most_a = back_drivable().robot.tension_limits_n()[1] / FORCE_N_A + 0.5;
        for m_s in ways {
            lead(&mut rig, m_s, 10);
            let sent = rig.last.as_ref().unwrap().sent;
            match rig.mode() {
                A::MODE_SOFT => {
                    let current_a = sent.current_a.unwrap_or_default();
                    prop_assert!(current_a[..3].iter().all(|a| (-0.5..=most_a).contains(a)), "{current_a:?} A");
                    prop_assert!(current_a[3..].iter().all(|a| *a == 0.0));
                }
                A::MODE_HOLDING | A::MODE_STOPPING => break,
                mode => prop_assert!(mode == A::MODE_FAULTED, "mode {mode}"),
            }
        }
    }
    /// The currents that held the node fade within the drives' limit, and none ever pays out a cable.
    #[test]
    fn currents_that_held_the_node_fade_within_the_limit(
        held_a in prop::array::uniform3(-3.0..4.0f64), led_m_s in prop::array::uniform3(-0.1..0.1f64)
    ) {
        let mut rig = ready(CoreConfig { current_limit_a: 4.0, ..back_drivable() });
        rig.current_a[..3].copy_from_slice(&held_a);
        rig.steps(WAIT_CYCLES);
        rig.demand(Request::Soft);
        for cycle in 0..250 {
            if rig.mode() != A::MODE_SOFT {
                break;
            }
            let current_a = currents_a(&rig);
            prop_assert!(current_a.iter().all(|a| (0.0..=4.0).contains(a)), "{current_a:?} A after {cycle} cycles");
            lead(&mut rig, led_m_s, 1);
        }
    }
}
