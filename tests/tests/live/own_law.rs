//! A custom law in a separate program flies by configuration alone: the template, compiled with the other programs.

use crate::robot::{Robot, steadily};
use messages::{ControlStatus, SystemConfig, text_of};

/// Amplitude with which the node swings on its cables after a stop, m.
const SWING_M: f64 = 0.01;

#[test]
fn a_custom_law_flies_by_configuration_alone() {
    steadily(|| {
        let mut robot = Robot::up("\n[[process]]\nname = \"my-law\"\nrole = \"controller\"\ncommand = [\"my-law\"]\n");
        let mut statuses = robot.bus.subscriber::<ControlStatus>("control/status/a").unwrap();
        robot.arm();
        robot.fly();
        let status = statuses.latest().unwrap().unwrap();
        assert_eq!((status.law, status.valid), (ControlStatus::LAW_OTHER, 1));
        // The run stores what flew, also for a law unknown to nims.
        let mut configs = robot.bus.subscriber::<SystemConfig>("system/config/controller").unwrap();
        // The hash follows once the program file has been read.
        let mut said = None;
        while said.as_ref().is_none_or(|said: &SystemConfig| text_of(&said.program_sha256).is_empty()) {
            robot.for_cycles(50);
            said = configs.latest().unwrap().or(said);
        }
        let said = said.unwrap();
        let (law, parameters) = (text_of(&said.law), text_of(&said.parameters));
        assert_eq!(law, "my-law");
        // Here the template is a program of the tests.
        assert!(parameters.contains("\n[law]\ngain_per_s = 1.5\n\n[program]\nname = \"nims-tests\"\n"), "{parameters}");
        assert!(text_of(&said.version).ends_with(" of nims-tests"), "{}", text_of(&said.version));
        assert!(
            parameters.starts_with("[controller]\n") && parameters.contains("horizon_cycles = 20\n"),
            "{parameters}"
        );
        let program = crate::robot::program().canonicalize().unwrap().with_file_name("my-law");
        assert_eq!(text_of(&said.program_sha256), runtime::hash_of(&[program]).unwrap());
        robot.arrive();
        robot.for_cycles(50);
        let off_m = robot.distance_m(robot.goal);
        assert!(off_m < SWING_M, "{off_m} m from the goal");
    });
}
