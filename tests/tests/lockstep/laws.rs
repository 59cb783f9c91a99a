//! The preview law compared with the paper's law on the same flights, against the plant.

use cable_robot::Vector3;
use controller::Notice;
use messages::{ControlStatus, MotorAuthority};
use nims_tests::laws::{self, HEADING, Knowledge, compare};
use nims_tests::lockstep::Lockstep;
use nims_tests::scenarios::Case;

const QUICK: [f64; 2] = [0.030, 0.040];
const SLOW: [f64; 2] = [0.060, 0.100];

fn columns(names: &[&str]) -> Vec<Knowledge> {
    laws::all().into_iter().filter(|known| names.contains(&known.name)).collect()
}

/// At least `exact` times better with the true drive model, better with an identified one, and never worse than 1.2
/// times with a wrong model and the fallback.
fn better(case: &Case, exact: f64) {
    let names = ["identified", "exact", "half", "double"];
    let found = compare(case, &columns(&names)).unwrap();
    println!("{names:?}\n{HEADING}\n{}", found.row(case));
    assert!(found.ratio(0) > 1.0, "identified in flight: {}", found.ratio(0));
    assert!(found.ratio(1) > exact, "known exactly: {}", found.ratio(1));
    for (i, name) in names.iter().enumerate() {
        assert!(found.ratio(i) > 1.0 / 1.2, "{name}: {}", found.ratio(i));
        let flight = found.preview[i].as_ref().unwrap();
        assert_eq!((flight.slack_cycles, flight.unsteered), (0, 0));
        assert!(flight.tension_share <= 1.0, "{name}: {} N", flight.tension_max_n);
    }
}

#[test]
fn three_lines_polyline() {
    better(&Case { robot: "lab3", mission: "polyline", motor_s: QUICK }, 2.0);
}

#[test]
fn three_lines_spiral_with_slow_motors() {
    better(&Case { robot: "lab3", mission: "spiral", motor_s: SLOW }, 3.0);
}

#[test]
fn four_lines_polyline_with_slow_motors() {
    better(&Case { robot: "lab4", mission: "polyline", motor_s: SLOW }, 3.0);
}

/// The drives change in flight, the law adapts to them and back, and no command jumps by more than ordinary ones do.
#[test]
fn it_falls_back_in_flight_without_a_bump() {
    let case = Case { robot: "lab3", mission: "spiral", motor_s: QUICK };
    let mut scenario = case.scenario(true).unwrap();
    let wrong = laws::identified(&case).unwrap().scaled(2.0);
    scenario.law = laws::law(Some(wrong), true).unwrap();
    let mission = scenario.mission.clone();
    let mut lockstep = Lockstep::new(scenario).unwrap();
    lockstep.zero_and_arm().unwrap();
    lockstep.run(&mission).unwrap();
    let (mut seen, mut last, mut steepest, mut worst) = ([0u32; 2], None::<[f64; 16]>, 0.0f64, 0.0f64);
    let mut fell_back = false;
    for _ in 0..1500 {
        let cycle = lockstep.cycle().unwrap();
        if let Some(Notice::Misfit { misfit, limit }) = lockstep.notice() {
            assert!(misfit > limit && !fell_back);
            fell_back = true;
        }
        if cycle.authority.mode == MotorAuthority::MODE_FOLLOWING {
            seen[usize::from(cycle.control.law == ControlStatus::LAW_PREVIEW)] += 1;
            if let Some(last) = last {
                for (now, before) in cycle.command.velocity_m_s.iter().zip(last) {
                    steepest = steepest.max((now - before).abs());
                }
            }
            last = Some(cycle.command.velocity_m_s);
            worst = worst.max((Vector3::from(cycle.truth_m) - Vector3::from(cycle.control.setpoint_m)).norm());
        }
    }
    assert!(fell_back && seen[0] > 1000 && seen[1] > 5, "{seen:?}");
    // The drives are limited to 1 m/s² anyway; encoder steps alone cause 5 mm/s of it.
    assert!(steepest < 0.02 && worst < 0.02, "{steepest} m/s in a cycle, {worst} m");
}
