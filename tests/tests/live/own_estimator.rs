//! A custom estimator in a separate program takes over while the robot moves: the template, compiled with the other
//! programs.

use crate::robot::{Robot, steadily};
use estimator::METHOD_OTHER;
use messages::{ESTIMATORS, NodeEstimate, SystemConfig, text_of};
use rustix::process::Signal;

/// Amplitude with which the node swings on its cables after a stop, m.
const SWING_M: f64 = 0.01;

const OWN: &str =
    "\n[[process]]\nname = \"my-estimator\"\nrole = \"estimator\"\ncommand = [\"my-estimator\"]\nstart = false\n";

#[test]
fn a_custom_estimator_is_swapped_in_during_a_flight() {
    steadily(|| {
        let mut robot = Robot::up(OWN);
        robot.arm();
        robot.fly_at(0.05);
        robot.swapped(&["swap", "estimator", "my-estimator"]);
        robot.until("it is in charge", |robot| robot.slots.in_charge[ESTIMATORS] == 1);
        let mut estimates = robot.bus.subscriber::<NodeEstimate>("node/estimate/b").unwrap();
        robot.for_cycles(5);
        let estimate = estimates.latest().unwrap().unwrap();
        assert_eq!((estimate.method, estimate.valid), (METHOD_OTHER, 1));
        // Its parameters, its constants, and the program.
        let mut configs = robot.bus.subscriber::<SystemConfig>("system/config/estimator-b").unwrap();
        // The hash follows once the program file has been read.
        let mut said = None;
        while said.as_ref().is_none_or(|said: &SystemConfig| text_of(&said.program_sha256).is_empty()) {
            robot.for_cycles(20);
            said = configs.latest().unwrap().or(said);
        }
        let said = said.unwrap();
        assert_eq!(text_of(&said.law), "my-estimator");
        let parameters: toml::Table = text_of(&said.parameters).parse().unwrap();
        assert_eq!(parameters["estimator"]["eta"].as_integer(), Some(50));
        assert_eq!(parameters["method"]["alpha"].as_float(), Some(0.5));
        // Here the template is a program of the tests.
        assert_eq!(parameters["program"]["name"].as_str(), Some("nims-tests"));
        assert_eq!(parameters["program"]["sources"].as_str(), Some(env!("CARGO_MANIFEST_DIR")));
        let version = text_of(&said.version);
        assert!(version.ends_with(" of nims-tests"), "{version}");
        robot.accepted(&["set", "estimator.sigma_length_m", "0.002"]);
        robot.arrive();
        robot.for_cycles(50);
        let off_m = robot.distance_m(robot.goal);
        assert!(off_m < SWING_M, "{off_m} m from the goal");
        assert_eq!(robot.down(Signal::INT), Some(0), "{}", robot.printed());
        let manifest = std::fs::read_to_string(robot.run().join("manifest.json")).unwrap();
        let manifest: serde_json::Value = serde_json::from_str(&manifest).unwrap();
        let processes = manifest["processes"].as_array().unwrap();
        let entry = processes.iter().find(|process| process["name"] == "estimator-b").unwrap();
        assert_eq!(entry["version"].as_str(), Some(version.as_str()));
        // nims cannot recompute its samples, but it recomputes all others.
        let replayed = replay::run(&robot.run(), &replay::Changes::default(), &mut |_| {}).unwrap();
        assert_eq!(replayed.different(), 0, "{:#?}", replayed.channels);
    });
}
