//! Flights in lockstep, written into a run file in the format of the recorder.

use std::collections::HashMap;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::Result;
use config::{ControlLaw, ControllerSection, EstimatorMethod, EstimatorSection, SystemFile};
use controller::{ControllerConfig, Law};
use estimator::EstimatorConfig;
use messages::{Message, Request, SLOT_NAMES, Slot, SlotRole};
use runlog::{Attachment, ChannelId, ChannelSpec, RunClock, RunWriter};

use crate::lockstep::{Chain, Cycle, Lockstep, Slots};
use crate::scenarios::Case;

/// Cycles between two samples of `energy`, as in motor-io.
const ENERGY_CYCLES: u64 = 10;
/// Start time of every such flight, UNIX time, ns; fixed, so that the file always has the same bytes.
const BEGAN_UNIX_NS: u64 = 1_767_225_600_000_000_000;

/// A run file that is being written.
pub struct Tape {
    writer: RunWriter,
    channels: HashMap<String, (ChannelId, u64)>,
    beat: u64,
}

impl Tape {
    /// Begins a file with the system file at `system_path` and its robot file inside.
    ///
    /// # Errors
    /// If the files are wrong.
    pub fn new(path: &Path, system_path: &Path) -> Result<Self> {
        let robot = SystemFile::load(system_path)?.robot;
        let attachment = |name: &str, path: &Path| -> Result<Attachment> {
            Ok(Attachment { name: name.into(), media_type: "application/toml".into(), data: fs::read(path)? })
        };
        let attachments = [attachment("system.toml", system_path)?, attachment("robot.toml", &robot)?];
        let clock = RunClock { t0_unix_ns: BEGAN_UNIX_NS, t0_mono_ns: 0 };
        let writer = RunWriter::create(path, clock, &Default::default(), &attachments)?;
        Ok(Self { writer, channels: HashMap::new(), beat: 0 })
    }

    /// Numbers a sample and writes it.
    ///
    /// # Errors
    /// If writing fails.
    pub fn write<T: Message>(&mut self, channel: &str, mut sample: T) -> Result<()> {
        if !self.channels.contains_key(channel) {
            let id = self.writer.add_channel(&ChannelSpec::for_type::<T>(channel))?;
            self.channels.insert(channel.to_owned(), (id, 0));
        }
        let Some((id, seq)) = self.channels.get_mut(channel) else { return Ok(()) };
        *seq += 1;
        sample.header_mut().seq = *seq;
        let stamp_ns = sample.header().stamp_ns;
        Ok(self.writer.write(*id, *seq, stamp_ns, stamp_ns, bytemuck::bytes_of(&sample))?)
    }

    /// Counts a sample that was published and not recorded.
    pub fn miss(&mut self, channel: &str) {
        if let Some((_, seq)) = self.channels.get_mut(channel) {
            *seq += 1;
        }
    }

    /// Writes everything that a cycle produced.
    ///
    /// # Errors
    /// If writing fails.
    pub fn cycle(&mut self, cycle: &Cycle, slots: &Slots) -> Result<()> {
        self.write("motor/input", cycle.input)?;
        self.write("motor/state", cycle.state)?;
        self.write("motor/authority", cycle.authority)?;
        self.write("motor/slots", cycle.slots)?;
        if cycle.input.header.cycle.is_multiple_of(ENERGY_CYCLES) {
            self.write("energy", cycle.energy)?;
        }
        for (slot, estimate) in slots.estimates() {
            self.write(&format!("node/estimate/{}", SLOT_NAMES[slot]), *estimate)?;
        }
        for output in slots.outputs() {
            self.write(&format!("motor/command/{}", SLOT_NAMES[output.slot]), output.command)?;
            self.write(&format!("control/status/{}", SLOT_NAMES[output.slot]), output.status)?;
        }
        if cycle.motion.beat != self.beat {
            self.beat = cycle.motion.beat;
            self.write("plan/motion", cycle.motion)?;
        }
        Ok(())
    }

    /// Closes the file.
    ///
    /// # Errors
    /// If writing fails.
    pub fn finish(self) -> Result<PathBuf> {
        Ok(self.writer.finish(&Default::default())?)
    }
}

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
