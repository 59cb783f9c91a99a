//! `nims export RUN --visualization OUT`: an old run as tools draw it in three dimensions, by the same core that draws a living one.

use analysis::report::robot_of;
use command::{Answer, Failure, Output};
use messages::MotorAuthority;
use runlog::{ChannelId, ChannelSpec, RunClock, RunReader, RunWriter};
use serde_json::json;
use std::collections::BTreeMap;
use std::path::Path;
use visualization::{Drawing, Visualization};

/// Between two frames, ns: as the process draws them.
const FRAME_NS: u64 = 40_000_000;
/// Between two frames of what changes slowly, ns.
const SLOW_NS: u64 = 500_000_000;

/// Between two looks at how far it is, bytes.
const SHOW_BYTES: u64 = 1 << 20;

/// Draws a run into a file of its own; JSON and words.
///
/// # Errors
/// There is no run, no robot file in it, or the file cannot be written.
pub fn export_visualization(run: &Path, out: &Path) -> Answer<Output> {
    analysis::runs::there(run)?;
    if out.exists() {
        return Err(Failure::BadInput(format!("{} exists already: give another name, or remove it", out.display())));
    }
    let mut reader = RunReader::open(run)?;
    let (mut film, mut show): (Option<Film>, _) = (None, analysis::runs::progress("drawing"));
    let mut shown = 0;
    loop {
        if reader.position() - shown >= SHOW_BYTES {
            shown = reader.position();
            show(shown, reader.bytes());
        }
        let Some(recorded) = reader.next_sample().map_err(Failure::not_now)? else { break };
        if !Visualization::wants(&recorded.channel.name) {
            continue;
        }
        let (channel, now_ns) = (recorded.channel.clone(), recorded.log_time_ns);
        let (sample, authority) = (recorded.sample.to_vec(), recorded.to::<MotorAuthority>());
        let film = match &mut film {
            Some(film) => film,
            None => film.insert(Film::begin(run, out, &reader, authority.map(|a| (a.header.stamp_ns, now_ns)))?),
        };
        film.take(&channel.name, &channel.type_name, &sample, now_ns)?;
    }
    show(reader.bytes(), reader.bytes());
    let Some(film) = film else {
        return Err(Failure::NotNow(format!("{} holds nothing that could be drawn", run.display())));
    };
    let (messages, frames) = (film.written, film.frames);
    let path = film.writer.finish(&BTreeMap::from([("reason".to_owned(), "drawn to its end".to_owned())]));
    let path = path.map_err(Failure::not_now)?;
    let words = format!("{frames} frames, {messages} messages in {}", path.display());
    Ok(Output::new(json!({ "file": path, "frames": frames, "messages": messages }), words))
}

/// A visualization that is being drawn into a file.
struct Film {
    visualization: Visualization,
    clock: RunClock,
    writer: RunWriter,
    channels: BTreeMap<String, ChannelId>,
    next_frame_ns: u64,
    next_slow_ns: u64,
    written: u64,
    frames: u64,
}

impl Film {
    /// `known` is a stamp with its UNIX time, for files of other origin, which say nothing of their clock.
    fn begin(run: &Path, out: &Path, reader: &RunReader, known: Option<(u64, u64)>) -> Answer<Self> {
        let Some(robot) = robot_of(run, reader.attachments()) else {
            return Err(Failure::NotNow(format!(
                "{} holds no robot.toml that this program accepts, so it is not known where the anchors are",
                run.display()
            )));
        };
        let known = known.map(|(t0_mono_ns, t0_unix_ns)| RunClock { t0_unix_ns, t0_mono_ns });
        let clock = reader.clock().or(known).unwrap_or(RunClock { t0_unix_ns: 0, t0_mono_ns: 0 });
        let visualization = Visualization::new(&robot, clock.t0_unix_ns as i64 - clock.t0_mono_ns as i64);
        let about = BTreeMap::from([("drawn_from".to_owned(), run.display().to_string())]);
        let writer = RunWriter::create(out, clock, &about, &[]).map_err(Failure::not_now)?;
        let (next_frame_ns, next_slow_ns) = (0, 0);
        Ok(Self {
            visualization,
            clock,
            writer,
            channels: BTreeMap::new(),
            next_frame_ns,
            next_slow_ns,
            written: 0,
            frames: 0,
        })
    }

    fn take(&mut self, channel: &str, type_name: &str, sample: &[u8], now_ns: u64) -> Answer {
        if let Some(drawing) = self.visualization.note(channel, type_name, sample) {
            self.write(&drawing, now_ns)?;
        }
        if now_ns >= self.next_frame_ns {
            self.next_frame_ns = now_ns + FRAME_NS;
            self.frames += 1;
            for drawing in self.visualization.frame() {
                self.write(&drawing, now_ns)?;
            }
        }
        if now_ns >= self.next_slow_ns {
            self.next_slow_ns = now_ns + SLOW_NS;
            for drawing in self.visualization.slow_frame() {
                self.write(&drawing, now_ns)?;
            }
        }
        Ok(())
    }

    fn write(&mut self, drawing: &Drawing, now_ns: u64) -> Answer {
        let id = match self.channels.get(&drawing.channel) {
            Some(id) => *id,
            None => {
                let (type_name, schema, size) = drawing.kind.definition();
                let (name, type_name, schema) = (drawing.channel.clone(), type_name.to_owned(), schema.to_owned());
                let spec = ChannelSpec { name, type_name, schema, size };
                let id = self.writer.add_channel(&spec).map_err(Failure::not_now)?;
                *self.channels.entry(drawing.channel.clone()).or_insert(id)
            }
        };
        self.written += 1;
        let (logged_ns, stamp_ns) = (self.clock.mono_of(now_ns), self.clock.mono_of(drawing.unix_ns));
        self.writer.write(id, self.written, logged_ns, stamp_ns, &drawing.body).map_err(Failure::not_now)
    }
}
