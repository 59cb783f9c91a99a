//! A swap, the death of the controller in charge and the death of the estimator in charge, at instants spread over
//! whole missions: every period is steered, and no cable's velocity changes faster than allowed.
//!
//! `NIMS_INSTANTS=10000 cargo test -p nims-tests --test lockstep -- takeover:: --nocapture` tries ten thousand
//! instants.

use nims_tests::scenarios::Case;
use nims_tests::takeover::{BLOWS, Tally, doubled, try_all};

/// Laws that are swapped with the paper's law, robots, missions, drives.
fn cases() -> [(Case, Option<controller::Law>); 4] {
    let preview =
        nims_tests::laws::law(Some(cable_control::drive_lag::DriveLag::new(0.030, 0.040).unwrap()), true).unwrap();
    [
        (Case { robot: "lab3", mission: "polyline", motor_s: [0.030, 0.040] }, None),
        (Case { robot: "lab4", mission: "polyline", motor_s: [0.030, 0.040] }, None),
        (Case { robot: "lab3", mission: "spiral", motor_s: [0.060, 0.100] }, None),
        (Case { robot: "lab4", mission: "spiral", motor_s: [0.030, 0.040] }, Some(preview)),
    ]
}

#[test]
fn every_period_is_steered_and_no_velocity_jumps() {
    let instants: u64 = std::env::var("NIMS_INSTANTS").map_or(60, |count| count.parse().unwrap());
    let cases = cases();
    let each = instants.div_ceil(cases.len() as u64);
    for (case, law) in &cases {
        let scenario = case.scenario(true).unwrap();
        let core = nims_tests::lockstep::core_config(&scenario).unwrap();
        // The robot file's limit, which the plan keeps; the wider one of motor-io's limiter would hide a step.
        let step = scenario.robot.acceleration_limit_m_s2() * core.period_s;
        let tallies = try_all(doubled(case, *law).unwrap(), each, step).unwrap();
        for (blow, tally) in BLOWS.iter().zip(tallies) {
            println!("{} {} {:?} {blow:?}: {tally:?}", case.robot, case.mission, case.motor_s);
            let Tally { instants, unsteered, failed, step_share, limited, .. } = tally;
            assert!(instants >= each * 9 / 10, "only {instants} instants of {each}");
            assert_eq!((unsteered, failed), (0, 0), "{blow:?}");
            assert!(step_share <= 1.0, "{blow:?}: {step_share} of the acceleration limit");
            assert!(
                limited[0] <= limited[1],
                "{blow:?}: the limiter acts in {} cycles, not in {}",
                limited[0],
                limited[1]
            );
        }
    }
}
