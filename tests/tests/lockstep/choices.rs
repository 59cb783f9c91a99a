//! What can be chosen and swapped: the plain law, the Kalman filter, a law of one's own; against the plant.

use crate::law;
use config::{ControllerSection, EstimatorSection};
use controller::{Controller, Law};
use estimator::Method;
use messages::PlanStatus;
use nims_tests::lockstep::{Chain, Flight, fly, fly_with};
use nims_tests::scenarios::Case;

const QUICK: [f64; 2] = [0.030, 0.040];
const SLOW: [f64; 2] = [0.060, 0.100];

fn law(name: &str) -> Law {
    Law::of(&ControllerSection { law: name.into(), ..ControllerSection::default() }).unwrap()
}

fn method(name: &str) -> Method {
    Method::of(&EstimatorSection { method: name.into(), ..EstimatorSection::default() }).unwrap()
}

/// What holds for every flight.
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
            // It knows nothing of delays: where the speed changes it is late by them.
            flown("p-feedforward", &case, &fly(scenario).unwrap(), [0.010, 0.025]);
        }
    }
}

/// The same flights with both methods: the filter knows the velocity better, and the position as well, within three per cent.
#[test]
fn the_filter_knows_the_velocity_better_and_the_position_as_well() {
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
