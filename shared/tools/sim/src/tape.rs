//! A run file of a flight in lockstep, in the format of the recorder.

use std::collections::{BTreeMap, HashMap};
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::Result;
use cable_robot::rate;
use config::SystemFile;
use lockstep::{Cycle, Slots};
use messages::{Message, SLOT_NAMES, TruthNode};
use runlog::{Attachment, ChannelId, ChannelSpec, RunClock, RunWriter};
use runtime::build;

/// Time between two samples of `energy`, as in motor-io, s.
const ENERGY_S: f64 = 0.1;
/// Start time of every flight, UNIX time, ns; fixed, so that the file always has the same bytes.
const BEGAN_UNIX_NS: u64 = 1_767_225_600_000_000_000;

/// A run file that is being written.
pub struct Tape {
    writer: RunWriter,
    channels: HashMap<String, (ChannelId, u64)>,
    beat: u64,
}

impl Tape {
    /// Begins a file with the system file at `system_path`, its robot file, and the files that this one names inside.
    ///
    /// # Errors
    /// If the files are wrong.
    pub fn new(path: &Path, system_path: &Path) -> Result<Self> {
        let file = SystemFile::load(system_path)?;
        let robot = &file.robot;
        let attachment = |name: &str, path: &Path| -> Result<Attachment> {
            Ok(Attachment { name: name.into(), media_type: "application/toml".into(), data: fs::read(path)? })
        };
        let mut attachments = vec![attachment("system.toml", system_path)?, attachment("robot.toml", robot)?];
        for named in file.robot_file()?.named_files(robot.parent().unwrap_or(Path::new(""))) {
            let name = named.file_name().unwrap_or_default().to_string_lossy().into_owned();
            attachments.push(attachment(&name, &named)?);
        }
        let about = BTreeMap::from([
            ("nims_version".to_owned(), build::VERSION.to_owned()),
            ("system".to_owned(), file.name.clone()),
        ]);
        let clock = RunClock { t0_unix_ns: BEGAN_UNIX_NS, t0_mono_ns: 0 };
        let writer = RunWriter::create(path, clock, &about, &attachments)?;
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
        if is_turn(cycle, ENERGY_S) {
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

/// True in one cycle of each such time.
pub(crate) fn is_turn(cycle: &Cycle, seconds: f64) -> bool {
    cycle.input.header.cycle.is_multiple_of(rate::cycles(seconds, cycle.authority.period_s).into())
}

/// What the virtual motor box publishes of a cycle's truth.
#[must_use]
pub fn true_node(cycle: &Cycle) -> TruthNode {
    let mut node = TruthNode {
        header: cycle.state.header,
        position_m: cycle.truth_m,
        velocity_m_s: cycle.truth_m_s,
        cable_count: cycle.state.cable_count,
        ..TruthNode::default()
    };
    for (into, tension_n) in node.tension_n.iter_mut().zip(cycle.truth_n.iter()) {
        *into = *tension_n;
    }
    node
}
