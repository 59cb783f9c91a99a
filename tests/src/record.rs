//! Flights in lockstep, written into a run file in the format of the recorder.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::Result;
use config::{ControlLaw, ControllerSection, EstimatorMethod, EstimatorSection, SystemFile};
use controller::{ControllerConfig, Law};
use estimator::EstimatorConfig;
use messages::{Request, Slot, SlotRole};
use nims_sim::Tape;

use crate::lockstep::{Chain, Lockstep};
use crate::scenarios::Case;

/// A flight with all kinds of events: zeroing, arming, moving, a swap of the controllers, a pause, the death of the
/// estimator in charge, a stop.
///
/// # Errors
/// If the files are wrong, or the flight fails.
pub fn fly(path: &Path, system_path: &Path, case: &Case, cycles: u64) -> Result<PathBuf> {
    let file = SystemFile::load(system_path)?;
    let mut scenario = case.scenario(true)?;
    scenario.period_s = file.period_s();
    let mission = scenario.mission.clone();
    let [x, y, z] = scenario.plant.start_m;
    let chain = Chain::from_file(&file)?;
    let section = ControllerSection { law: ControlLaw::PFeedforward, ..file.controller.clone() };
    let controller = ControllerConfig { law: Law::from_section(&section)?, ..*chain.controller.config() };
    let section = EstimatorSection { method: EstimatorMethod::Kalman, ..file.estimator };
    let estimator = EstimatorConfig::from_section(&section, file.robot_file()?.robot()?, 0)?;
    let mut lockstep = Lockstep::with(scenario, chain)?;
    let mut tape = Tape::new(path, system_path)?;
    let share = |percent: u64| cycles * percent / 100;
    for cycle in 1..=cycles {
        if cycle == 3 {
            lockstep.request(Request::ZeroAt { position_m: [x, y, z] });
        } else if cycle == 5 {
            lockstep.request(Request::Arm);
        } else if cycle == 10 {
            lockstep.run(&mission)?;
        } else if cycle == share(10) {
            lockstep.slots_mut().start_controller(1, &controller);
            lockstep.slots_mut().start_estimator(1, &estimator, estimator.method);
        } else if cycle == share(50) {
            lockstep.request(Request::Swap { role: SlotRole::Controller, slot: Slot::B });
        } else if cycle == share(65) {
            lockstep.slots_mut().kill(messages::ESTIMATORS, 0, false);
        } else if cycle == share(75) {
            lockstep.request(Request::Pause);
        } else if cycle == share(85) {
            lockstep.request(Request::Resume);
        } else if cycle == share(95) {
            lockstep.request(Request::Stop);
        }
        let now = lockstep.cycle()?;
        tape.cycle(&now, lockstep.slots())?;
    }
    tape.finish()
}

/// A copy of a system file of `configs/systems` (`name`, without its extension) and of its robot file in `folder`, with
/// replaced values, such as `("controller", "law", "preview")`.
///
/// # Errors
/// If the files are wrong.
pub fn system_with(folder: &Path, name: &str, words: &[(&str, &str, &str)]) -> Result<PathBuf> {
    let path = format!("{}/../configs/systems/{name}.toml", env!("CARGO_MANIFEST_DIR"));
    let file = SystemFile::load(Path::new(&path))?;
    fs::copy(&file.robot, folder.join("robot.toml"))?;
    let mut table: toml::Table = fs::read_to_string(&path)?.parse()?;
    table.insert("robot".into(), "robot.toml".into());
    for (section, key, word) in words {
        let section = table.entry(*section).or_insert_with(|| toml::Table::new().into());
        if let Some(section) = section.as_table_mut() {
            section.insert((*key).into(), (*word).into());
        }
    }
    let path = folder.join("system.toml");
    fs::write(&path, toml::to_string(&table)?)?;
    Ok(path)
}
