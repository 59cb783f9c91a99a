//! What is refused of a mission, with the place and the excess, and what a dry run computes.

use crate::world::{config, config_of, mission, parts};
use cable_robot::motion::Cause;
use cable_robot::motor::DriveLimits;
use cable_robot::{RobotParts, Vector3};
use planner::dry_run;
use planner::mission::Mission;
use planner::plan::{Plan, PlanError};

#[test]
fn a_rejection_names_the_place_the_cable_and_the_excess() {
    let start = [4.8, 3.0, 0.3];
    let refusal = |text: &str| match dry_run(&mission(text), &config(), start) {
        Err(error) => {
            assert_eq!(error.to_string().lines().count(), 1, "{error}");
            error
        }
        other => panic!("{text}: {other:?}"),
    };
    let cause = |text: &str| match refusal(text) {
        PlanError::Refused { leg, refusal, .. } => {
            assert!(refusal.path_s_m >= 0.0 && refusal.position.iter().all(|value| value.is_finite()), "{refusal}");
            (leg, refusal.cause)
        }
        other => panic!("{text}: {other:?}"),
    };
    let (leg, upper) = cause("[[leg]]\nline = { to_m = [4.8, 3.0, 2.95] }");
    assert!(matches!(upper, Cause::Tension(limit) if limit.limit_n == 60.0 && limit.excess_n() > 0.0), "{upper}");
    assert_eq!(leg, 1);
    let (_, ground) = cause("[[leg]]\nline = { to_m = [4.8, 3.0, -0.1] }");
    assert!(matches!(ground, Cause::Ground { below_m, .. } if below_m > 0.0), "{ground}");
    let (_, lower) = cause("[[leg]]\nline = { to_m = [9.7, 0.1, 0.3] }");
    assert!(matches!(lower, Cause::Tension(limit) if limit.limit_n == 2.0 && limit.tension_n < 2.0), "{lower}");
    let keep_out = "[[leg]]\nline = { to_m = [4.9, 3.0, 0.3] }\n[[leg]]\nline = { to_m = [6.75, 1.25, 0.5] }";
    assert!(matches!(cause(keep_out), (2, Cause::KeepOut { number: 0 })), "{}", refusal(keep_out));
    let rise = "[[leg]]\nspiral = { rise_m = 2.7, radius_m = 0.6, turns = 3 }";
    assert!(matches!(cause(rise), (1, Cause::Tension(_) | Cause::NoTension(_))), "{}", refusal(rise));
    assert_eq!(
        refusal("speed_m_s = 0.5\n[[leg]]\nline = { to_m = [4.9, 3.0, 0.3] }"),
        PlanError::TooFast { leg: 1, speed_m_s: 0.5, limit_m_s: 0.4 }
    );
    assert_eq!(
        refusal("acceleration_m_s2 = 2.0\n[[leg]]\nline = { to_m = [4.9, 3.0, 0.3] }"),
        PlanError::TooHard { asked_m_s2: 2.0, limit_m_s2: 0.5 }
    );
    assert_eq!(refusal("[[leg]]\nline = { to_m = [4.8, 3.0, 0.3] }"), PlanError::AlreadyThere);
    let upright = refusal("[[leg]]\nparabola = { to_m = [4.8, 3.0, 1.3], mu_per_m = 0.1 }");
    assert!(matches!(upright, PlanError::Path { leg: 1, .. }), "{upright:?}");
}

#[test]
fn a_dry_run_gives_length_duration_and_energy() {
    let text =
        "[[leg]]\nspiral = { rise_m = 1.125, radius_m = 0.60, turns = 4 }\n[[leg]]\ndwell = { duration_s = 2.0 }";
    let summary = dry_run(&mission(text), &config(), [4.8, 3.0, 0.3]).unwrap();
    assert_eq!((summary.legs, summary.segments), (2, 2));
    // Archimedes: about π R turns, a little more for the rise.
    assert!((7.5..7.9).contains(&summary.length_m), "{summary:?}");
    assert!(summary.duration_s > summary.length_m / 0.2 + 2.0 && summary.duration_s < summary.length_m / 0.2 + 10.0);
    assert!((summary.end_m[0] - 5.4).abs() < 1e-9 && (summary.end_m[2] - 1.425).abs() < 1e-9);
    assert!(summary.least_tension_n > 2.0 && summary.peak_tension_n < 60.0);
    assert!(summary.peak_cable_speed_m_s <= 0.2);
}

/// The limit of the lines is the robot file's own, not that of the node: where it is lower, the plan is refused, and
/// not slowed in flight.
#[test]
fn a_cable_faster_than_its_limit_is_rejected_with_place_cable_and_excess() {
    // Straight to the first anchor: its line runs as fast as the node.
    let text = "[[leg]]\nline = { to_m = [3.8, 2.375, 1.2], speed_m_s = 0.2 }";
    let limited = |cable_speed_limit_m_s| {
        let config = config_of(RobotParts { cable_speed_limit_m_s, ..parts() });
        dry_run(&mission(text), &config, [4.8, 3.0, 0.3])
    };
    let peak_m_s = limited(None).unwrap().peak_cable_speed_m_s;
    assert!(peak_m_s > 0.15, "{peak_m_s}");
    assert!(limited(Some(1.001 * peak_m_s)).is_ok());
    let refusal = limited(Some(0.15)).unwrap_err();
    let PlanError::Refused { leg: 1, refusal, .. } = refusal else { panic!("{refusal}") };
    let Cause::CableSpeed { cable: 0, speed_m_s, limit_m_s: 0.15 } = refusal.cause else { panic!("{refusal}") };
    assert!(speed_m_s > 0.15 && speed_m_s <= peak_m_s && refusal.path_s_m > 0.0, "{refusal}");
}

#[test]
fn points_may_count_from_the_start() {
    let text = "relative = true\n[[leg]]\npolyline = { points_m = [[0.2, 0.0, 0.1], [0.0, 0.3, 0.1]] }";
    let summary = dry_run(&mission(text), &config(), [4.8, 3.0, 0.3]).unwrap();
    assert!((summary.end_m[1] - 3.3).abs() < 1e-12 && (summary.end_m[2] - 0.4).abs() < 1e-12);
}

#[test]
fn a_speed_beyond_the_motors_is_rejected_with_the_highest_that_can_be_flown() {
    let drive_limits = DriveLimits { current_a: 5.0, voltage_v: 19.0 };
    let config = config_of(RobotParts { speed_limit_m_s: 1.0, drive_limits, ..parts() });
    let mission = |speed_m_s: f64| {
        Mission::parse(&format!(
            "name = \"up\"\nspeed_m_s = {speed_m_s}\n[[leg]]\nline = {{ to_m = [3.0, 1.6, 1.8] }}\n"
        ))
        .unwrap()
    };
    let plan = |speed_m_s| Plan::new(&mission(speed_m_s), &config, Vector3::new(6.0, 3.0, 0.4), 0.0, 1);
    let Err(PlanError::Refused { leg: 1, refusal, feasible_m_s: Some(feasible_m_s), .. }) = plan(1.0) else {
        panic!("{:?}", plan(1.0))
    };
    let Cause::Voltage { cable, load, limit_v } = refusal.cause else { panic!("{refusal}") };
    assert!(cable < 3 && limit_v == 19.0 && load.voltage_v.abs() > 19.0, "{refusal}");
    // At constant speed the motors generate 40 V per m/s.
    assert!((0.3..0.6).contains(&feasible_m_s), "{feasible_m_s}");
    plan(feasible_m_s).unwrap();
    // The advice is accurate to a 128th of the rejected speed.
    assert!(matches!(plan(feasible_m_s + 0.01), Err(PlanError::Refused { .. })), "{feasible_m_s}");
}
