//! `nims plan`, `nims check`, a dry run and the planner give the same verdict on a move, and on the speed that its
//! motors can do.
#![allow(clippy::unwrap_used)]

use commissioning::{check, plan};
use config::{Point, SystemFile};
use planner::plan::{Plan, PlanError};
use planner::{Mission, PlannerConfig, dry_run};
use proptest::prelude::*;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

/// The example system with a speed limit that its winches do not reach everywhere.
fn system() -> &'static PathBuf {
    static FOLDER: OnceLock<(tempfile::TempDir, PathBuf)> = OnceLock::new();
    let (_, path) = FOLDER.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        let configs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../configs");
        let changed = |name: &str, changes: &[(&str, &str)]| {
            let text = std::fs::read_to_string(configs.join(name)).unwrap();
            changes.iter().fold(text, |text, (old, new)| {
                assert!(text.contains(old), "{name} has no {old}");
                text.replace(old, new)
            })
        };
        let robot = changed("robots/lab3.toml", &[("\nspeed_limit_m_s = 0.4", "\nspeed_limit_m_s = 1.0")]);
        std::fs::write(folder.path().join("robot.toml"), robot).unwrap();
        let path = folder.path().join("system.toml");
        std::fs::write(&path, changed("systems/demo3.toml", &[("../robots/lab3.toml", "robot.toml")])).unwrap();
        (folder, path)
    });
    path
}

fn place() -> impl Strategy<Value = [f64; 3]> {
    (2.0..8.0f64, 0.5..6.0f64, 0.2..2.4f64).prop_map(|(x, y, z)| [x, y, z])
}

proptest! {
    #[test]
    fn every_command_gives_the_planners_verdict(from in place(), to in place(), speed_m_s in 0.1..1.0f64) {
        let file = SystemFile::load(system()).unwrap();
        let robot = file.robot_file().unwrap().robot().unwrap();
        let config = PlannerConfig { check_step_m: 0.01, ..PlannerConfig::from_files(&file, robot) };
        let mission = |speed_m_s: f64| Mission::parse(&format!(
            "name = \"move\"\nspeed_m_s = {speed_m_s:?}\nacceleration_m_s2 = {:?}\n[[leg]]\nline = {{ to_m = {to:?} }}\n",
            robot.acceleration_limit_m_s2()
        )).unwrap();
        let planned = Plan::new(&mission(speed_m_s), &config, from.into(), 0.0, 1);

        let args = plan::Args {
            config: system().clone(), from: Point::from(from), to: Point::from(to), path: None, mu: None,
            time_weight: 0.0, method: None, speed: Some(speed_m_s), constant_speed: false,
        };
        let answer = plan::run(&args).unwrap().value;
        prop_assert_eq!(answer["feasible"].as_bool().unwrap(), planned.is_ok(), "{} {:?}", answer, planned.err());
        prop_assert_eq!(check::fly(&mission(speed_m_s), &file, &from).is_ok(), planned.is_ok());
        prop_assert_eq!(dry_run(&mission(speed_m_s), &config, from).is_ok(), planned.is_ok());
        if let Err(PlanError::Refused { feasible_m_s: Some(feasible_m_s), .. }) = planned {
            prop_assert!(feasible_m_s < speed_m_s);
            prop_assert!(Plan::new(&mission(feasible_m_s), &config, from.into(), 0.0, 1).is_ok());
        }
    }
}
