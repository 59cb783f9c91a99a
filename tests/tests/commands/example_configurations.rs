//! Every example configuration loads.

use std::path::{Path, PathBuf};

#[test]
fn every_example_configuration_loads() {
    let configs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../configs");
    let files = |folder: &str| -> Vec<PathBuf> {
        std::fs::read_dir(configs.join(folder)).unwrap().map(|entry| entry.unwrap().path()).collect()
    };
    for path in files("robots") {
        config::RobotFile::load(&path).unwrap();
    }
    for path in files("systems") {
        let file = config::SystemFile::load(&path).unwrap();
        motor_box::MotorBoxSection::from_file(&file, &file.robot_file().unwrap()).unwrap();
    }
    for path in files("sensors") {
        sensor::SensorFile::load(&path).unwrap();
    }
    for path in files("ground") {
        motor_box::GroundFile::load(&path).unwrap();
    }
    for path in files("missions") {
        planner::mission::Mission::read(&path).unwrap();
    }
}
