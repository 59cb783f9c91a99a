//! NIMS-AQ: a planar robot of four cables whose node floats. Only the preload holds it, so the two redundant modes of
//! its cables are controlled as well as its position.

use cable_robot::Vector3;
use messages::{MotorAuthority, PlanStatus, Request};
use nims_tests::lockstep::{Flight, Lockstep, Scenario, fly};

/// System file and mission as distributed with the project.
fn scenario() -> Scenario {
    let scenario = nims_tests::scenarios::planar().unwrap();
    let robot = &scenario.robot;
    assert_eq!((robot.dimensions(), robot.redundancy(), robot.net_weight_n()), (2, 2, 0.0));
    scenario
}

fn accurate(flight: &Flight) {
    let Flight { estimate, truth, .. } = flight;
    println!(
        "{:.1} s moving; estimate - setpoint {:.2} / {:.2} mm; truth - setpoint {:.2} / {:.2} mm; tensions {:.1} to {:.1} N, \
         {:.2} / {:.2} N off, {:.0} % of what is allowed",
        0.01 * flight.moving_cycles as f64,
        1e3 * estimate.rms_m,
        1e3 * estimate.max_m,
        1e3 * truth.rms_m,
        1e3 * truth.max_m,
        flight.tension_range_n[0],
        flight.tension_range_n[1],
        flight.tension_rms_n,
        flight.tension_max_n,
        100.0 * flight.tension_share
    );
    assert_eq!(flight.state, PlanStatus::STATE_DONE);
    assert!(flight.moving_cycles > 3000, "{flight:?}");
    assert!(estimate.rms_m <= 0.005, "estimate against setpoint: {estimate:?}");
    assert!(truth.rms_m <= 0.010, "truth against setpoint: {truth:?}");
    assert!(truth.max_m <= 0.020, "truth against setpoint: {truth:?}");
    // 15 % of the chosen tension or 2 N, whichever is more.
    assert!(flight.tension_share <= 1.0, "true tensions are up to {} N off", flight.tension_max_n);
    assert!(flight.tension_range_n[0] > 5.0, "the preload is lost: {:?}", flight.tension_range_n);
    assert_eq!((flight.slack_cycles, flight.unsteered), (0, 0));
    assert!(flight.saturation < 1.0, "{flight:?}");
}

#[test]
fn the_node_follows_its_mission_with_the_chosen_tensions() {
    accurate(&fly(scenario()).unwrap());
}

#[test]
fn slower_drives_and_lines_that_are_softer_than_believed_do_not_lose_the_preload() {
    let mut slow = scenario();
    (slow.plant.drive.delay_s, slow.plant.drive.lag_s, slow.horizon) = (0.060, 0.100, 35);
    slow.plant.line.stiffness_n *= 0.9;
    let flight = fly(slow).unwrap();
    println!("{flight:?}");
    assert_eq!((flight.state, flight.slack_cycles, flight.unsteered), (PlanStatus::STATE_DONE, 0, 0));
    assert!(flight.truth.rms_m <= 0.010, "{flight:?}");
}

/// Only the preload holds the node, so released cables would release it.
#[test]
fn a_pause_and_a_stop_keep_the_lines_taut() {
    let scenario = scenario();
    let mission = scenario.mission.clone();
    let mut lockstep = Lockstep::new(scenario).unwrap();
    lockstep.zero_and_arm().unwrap();
    lockstep.run(&mission).unwrap();
    for (request, mode) in [
        (Request::Pause, MotorAuthority::MODE_HOLDING),
        (Request::Resume, MotorAuthority::MODE_FOLLOWING),
        (Request::Stop, MotorAuthority::MODE_HOLDING),
    ] {
        let (mut last, mut fastest_m_s) = (lockstep.cycle().unwrap(), 0.0f64);
        for cycle in 0..1100 {
            if cycle == 800 {
                assert_ne!(last.authority.mode, mode);
                lockstep.request(request.clone());
            }
            let before = Vector3::from(last.truth_m);
            last = lockstep.cycle().unwrap();
            assert!(last.truth_n.iter().all(|tension| *tension > 5.0), "{:?}", last.truth_n);
            let speed_m_s = (Vector3::from(last.truth_m) - before).norm() / 0.01;
            assert!(speed_m_s < 0.25, "{speed_m_s} m/s");
            // It comes to rest between the legs of the mission, so the last speed does not show whether it continues.
            fastest_m_s = if cycle < 900 { 0.0 } else { speed_m_s.max(fastest_m_s) };
            if cycle == 1099 {
                assert_eq!(last.authority.mode, mode);
                if mode == MotorAuthority::MODE_HOLDING {
                    assert!(speed_m_s < 0.005, "{speed_m_s} m/s");
                } else {
                    assert!(fastest_m_s > 0.05, "{fastest_m_s} m/s");
                }
                assert_eq!(last.truth_m[1], 0.0);
            }
        }
    }
}
