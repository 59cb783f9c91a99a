//! Fresh deciding parts that receive a recorded flight again allocate nothing. `replay` checks that they compute the
//! same bits.
#![allow(clippy::unwrap_used, clippy::expect_used)]

#[path = "../../shared/robot/cable-robot/tests/mathematics/counting/mod.rs"]
mod counting;
/// The template for a custom estimation method.
#[path = "../../scripts/templates/estimator/src/method.rs"]
mod method;

use cable_control::law::PFeedforward;
use config::EstimatorSection;
use controller::Law;
use counting::allocations;
use estimator::{Estimator, Method};
use messages::Request;
use nims_tests::lockstep::{Chain, Cycle, Lockstep};
use nims_tests::scenarios::{self, Case};
use planner::mission::PathShape;
use std::hint::black_box;

/// A flight with all kinds of events: zeroing, arming, moving, a pause, resuming, a stop.
fn flight(robot: &'static str, shape: PathShape, law: Option<Law>, method: &str) -> (Chain, Vec<Cycle>) {
    let mut scenario = match robot {
        "aq4" => scenarios::planar().unwrap(),
        _ => Case { robot, mission: "polyline", motor_s: [0.030, 0.040] }.scenario(true).unwrap(),
    };
    scenario.mission.path = shape;
    scenario.law = law.unwrap_or(scenario.law);
    scenario.method =
        Method::from_section(&EstimatorSection { method: method.parse().unwrap(), ..EstimatorSection::default() })
            .unwrap();
    let chain = Chain::new(&scenario).unwrap();
    let mission = scenario.mission.clone();
    let [x, y, z] = scenario.plant.start_m;
    let mut lockstep = Lockstep::new(scenario).unwrap();
    let mut cycles = Vec::new();
    for cycle in 1..=1200 {
        match cycle {
            10 => lockstep.request(Request::ZeroAt { position_m: [x, y, z] }),
            20 => lockstep.request(Request::Arm),
            50 => drop(lockstep.run(&mission).unwrap()),
            500 => lockstep.request(Request::Pause),
            700 => lockstep.request(Request::Resume),
            1000 => lockstep.request(Request::Stop),
            _ => {}
        }
        cycles.push(lockstep.cycle().unwrap());
    }
    (chain, cycles)
}

#[test]
fn estimation_control_and_arbitration_allocate_nothing() {
    // The preview law identifies the drives on the way.
    let preview = nims_tests::laws::law(None, true).unwrap();
    let plain = Law::PFeedforward(PFeedforward::new(2.0).unwrap());
    let own =
        |chain: &Chain| Estimator::with_method(chain.estimator.config(), Box::new(method::MyEstimator::default()));
    for (robot, shape, law, method) in [
        ("lab3", PathShape::Line, None, "phi"),
        ("lab4", PathShape::Line, None, "phi"),
        ("lab3", PathShape::Parabola, Some(preview), "phi"),
        ("lab4", PathShape::Lateral, Some(preview), "kalman"),
        ("lab3", PathShape::Line, Some(plain), "kalman"),
        ("aq4", PathShape::Line, None, "phi"),
    ] {
        let (mut chain, cycles) = flight(robot, shape, law, method);
        let mut own = own(&chain);
        let count = allocations(|| {
            for cycle in &cycles {
                black_box(own.step(&cycle.state, Some(&cycle.authority)));
                chain.core.decide(&cycle.input);
                black_box(chain.core.observe(&cycle.input));
                black_box(chain.estimator.step(&cycle.state, Some(&cycle.authority)));
                black_box(chain.controller.step(&controller::Inputs {
                    estimates: [Some(&cycle.estimate), None],
                    motion: Some(&cycle.motion),
                    authority: Some(&cycle.authority),
                    state: Some(&cycle.state),
                }));
            }
        });
        assert_eq!(count, 0, "{robot}, {shape:?}, {law:?}, {method}");
        assert!(cycles.iter().any(|cycle| cycle.control.error_norm_m > 0.0));
    }
}
