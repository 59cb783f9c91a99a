//! Choices and swaps: the plain law, the Kalman filter, a custom law and a custom estimation method, against the plant.

use crate::law;
use crate::method::MyEstimator;
use config::{ControllerSection, EstimatorSection};
use controller::{Controller, Law};
use estimator::{Estimator, METHOD_OTHER, Method};
use messages::{ESTIMATORS, MotorSlots, PlanStatus, Request, SLOTS, Slot, SlotRole};
use nims_tests::lockstep::{Chain, Flight, Lockstep, fly, fly_with};
use nims_tests::scenarios::Case;

const QUICK: [f64; 2] = [0.030, 0.040];
const SLOW: [f64; 2] = [0.060, 0.100];

fn law(name: &str) -> Law {
    Law::from_section(&ControllerSection { law: name.parse().unwrap(), ..ControllerSection::default() }).unwrap()
}

fn method(name: &str) -> Method {
    Method::from_section(&EstimatorSection { method: name.parse().unwrap(), ..EstimatorSection::default() }).unwrap()
}

/// Checks what holds for every flight.
fn flown(what: &str, case: &Case, flight: &Flight, [rms_m, max_m]: [f64; 2]) {
    println!(
        "{what:13} {} {:4.0}/{:3.0} ms: truth - setpoint {:.2} / {:.2} mm, truth - estimate {:.2} mm, {:.2} mm/s, tensions within {:.0} %",
        case.robot,
        case.motor_s[0] * 1e3,
        case.motor_s[1] * 1e3,
        flight.truth.rms_m * 1e3,
        flight.truth.max_m * 1e3,
        flight.between.rms_m * 1e3,
        flight.velocity_rms_m_s * 1e3,
        flight.tension_share * 100.0,
    );
    assert_eq!((flight.state, flight.slack_cycles, flight.unsteered), (PlanStatus::STATE_DONE, 0, 0));
    assert!(flight.moving_cycles > 3000 && flight.saturation < 1.0, "{flight:?}");
    assert!(flight.tension_share <= 1.0, "true tensions are up to {} N off", flight.tension_max_n);
    assert!(flight.truth.rms_m <= rms_m && flight.truth.max_m <= max_m, "{:?}", flight.truth);
}

#[test]
fn the_plain_law_flies_with_quick_and_slow_drives() {
    for (robot, mission) in [("lab3", "spiral"), ("lab4", "polyline")] {
        for motor_s in [QUICK, SLOW] {
            let case = Case { robot, mission, motor_s };
            let mut scenario = case.scenario(true).unwrap();
            scenario.law = law("p-feedforward");
            // It has no model of delays, so it lags where the speed changes.
            flown("p-feedforward", &case, &fly(scenario).unwrap(), [0.010, 0.025]);
        }
    }
}

/// The same flights with both methods: the filter estimates the velocity better, and the position as well, within three
/// per cent.
#[test]
fn the_filter_estimates_velocity_better_and_position_equally_well() {
    for (robot, mission, motor_s) in [("lab3", "spiral", SLOW), ("lab4", "polyline", QUICK)] {
        let case = Case { robot, mission, motor_s };
        let [phi, kalman] = ["phi", "kalman"].map(|name| {
            let mut scenario = case.scenario(true).unwrap();
            scenario.method = method(name);
            let flight = fly(scenario).unwrap();
            flown(name, &case, &flight, [0.003, 0.010]);
            flight
        });
        assert!(kalman.between.rms_m <= 1.03 * phi.between.rms_m, "{kalman:?}\n{phi:?}");
        assert!(kalman.truth.rms_m <= 1.01 * phi.truth.rms_m, "{kalman:?}\n{phi:?}");
        assert!(kalman.velocity_rms_m_s < phi.velocity_rms_m_s, "{kalman:?}\n{phi:?}");
    }
}

#[test]
fn the_template_of_a_law_flies() {
    let case = Case { robot: "lab3", mission: "polyline", motor_s: QUICK };
    let scenario = case.scenario(true).unwrap();
    let own = |chain: Chain| Chain {
        controller: Controller::with_law(*chain.controller.config(), Box::new(law::MyLaw::default())),
        ..chain
    };
    flown("the template", &case, &fly_with(scenario, own).unwrap(), [0.010, 0.020]);
}

/// The template of an estimation method, in place of the configured one.
fn own_estimator(configured: &Estimator) -> Estimator {
    Estimator::with_method(configured.config(), Box::new(MyEstimator::default()))
}

#[test]
fn the_template_of_an_estimator_flies() {
    for (robot, mission, motor_s) in [("lab3", "polyline", QUICK), ("lab4", "polyline", SLOW)] {
        let case = Case { robot, mission, motor_s };
        let own = |chain: Chain| Chain { estimator: own_estimator(&chain.estimator), ..chain };
        flown("the template", &case, &fly_with(case.scenario(true).unwrap(), own).unwrap(), [0.003, 0.010]);
    }
}

/// It computes in standby beside the standard one, qualifies, and takes over while the node moves.
#[test]
fn the_template_of_an_estimator_is_swapped_in_in_flight() {
    let scenario = Case { robot: "lab3", mission: "polyline", motor_s: QUICK }.scenario(true).unwrap();
    let mission = scenario.mission.clone();
    let own = own_estimator(&Chain::new(&scenario).unwrap().estimator);
    let mut lockstep = Lockstep::new(scenario).unwrap();
    lockstep.zero_and_arm().unwrap();
    lockstep.run(&mission).unwrap();
    for _ in 0..200 {
        lockstep.cycle().unwrap();
    }
    lockstep.slots_mut().put_estimator(1, own);
    let seat = SLOTS * ESTIMATORS + 1;
    let mut last = lockstep.cycle().unwrap();
    for _ in 0..200 {
        last = lockstep.cycle().unwrap();
    }
    assert_eq!(last.slots.phase[seat], MotorSlots::PHASE_QUALIFIED);
    lockstep.request(Request::Swap { role: SlotRole::Estimator, slot: Slot::B });
    for _ in 0..300 {
        last = lockstep.cycle().unwrap();
    }
    assert_eq!((last.authority.active_estimator, last.authority.unsteered()), (1, 0));
    assert_eq!((last.estimate.method, last.estimate.valid), (METHOD_OTHER, 1));
    assert!(last.control.error_norm_m < 0.01, "{} m", last.control.error_norm_m);
}

/// A copy of a flight with a custom method computes the same bits.
#[test]
fn a_custom_estimator_is_forked_with_its_state() {
    let scenario = Case { robot: "lab3", mission: "polyline", motor_s: QUICK }.scenario(true).unwrap();
    let mission = scenario.mission.clone();
    let chain = Chain::new(&scenario).unwrap();
    let own = Chain { estimator: own_estimator(&chain.estimator), ..chain };
    let mut lockstep = Lockstep::with(scenario, own).unwrap();
    lockstep.zero_and_arm().unwrap();
    lockstep.run(&mission).unwrap();
    for _ in 0..200 {
        lockstep.cycle().unwrap();
    }
    let mut copy = lockstep.fork().unwrap();
    for _ in 0..100 {
        assert_eq!(lockstep.cycle().unwrap().estimate, copy.cycle().unwrap().estimate);
    }
}
