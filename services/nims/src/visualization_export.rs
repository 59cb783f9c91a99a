//! `nims export RUN --visualization OUT`: draws a recorded run in three dimensions, with the code that draws a running
//! robot.

use analysis::report::robot_of;
use command::{Answer, Failure, Output};
use messages::MotorAuthority;
use runlog::{ChannelId, ChannelSpec, RunClock, RunReader, RunWriter};
use serde_json::json;
use std::collections::BTreeMap;
use std::path::Path;
use visualization::{Drawing, Visualization};

/// Time between two frames, ns, as in the visualization process.
const FRAME_NS: u64 = 40_000_000;
/// Time between two frames of the slowly changing drawings, ns.
const SLOW_NS: u64 = 500_000_000;

/// Bytes read between two updates of the progress bar.
const PROGRESS_BYTES: u64 = 1 << 20;

/// Draws a run into a new run file.
///
/// # Errors
/// There is no such run, it holds no robot file, or the new file cannot be written.
pub fn export_visualization(run: &Path, out: &Path) -> Answer<Output> {
    analysis::runs::require_run(run)?;
    if out.exists() {
        return Err(Failure::BadInput(format!("{} exists already: give another name, or remove it", out.display())));
    }
    let mut reader = RunReader::open(run)?;
    let (mut film, mut show): (Option<Film>, _) = (None, analysis::runs::progress("drawing"));
    let mut shown = 0;
    loop {
        if reader.position() - shown >= PROGRESS_BYTES {
            shown = reader.position();
            show(shown, reader.bytes());
        }
        let Some(recorded) = reader.next_sample().map_err(Failure::not_now)? else { break };
        if !Visualization::wants(&recorded.channel.name) {
            continue;
        }
        let (channel, now_ns) = (recorded.channel.clone(), recorded.log_time_ns);
        let (sample, authority) = (recorded.sample.to_vec(), recorded.decode::<MotorAuthority>());
        let film = match &mut film {
            Some(film) => film,
            None => film.insert(Film::begin(run, out, &reader, authority.map(|a| (a.header.stamp_ns, now_ns)))?),
        };
        film.record(&channel.name, &channel.type_name, &sample, now_ns)?;
    }
    show(reader.bytes(), reader.bytes());
    let Some(film) = film else {
        return Err(Failure::NotNow(format!("{} holds no samples that can be drawn", run.display())));
    };
    let (messages, frames) = (film.written, film.frames);
    let path = film.writer.finish(&BTreeMap::from([("reason".to_owned(), "drawn to its end".to_owned())]));
    let path = path.map_err(Failure::not_now)?;
    let words = format!("{frames} frames, {messages} messages in {}", path.display());
    Ok(Output::new(json!({ "file": path, "frames": frames, "messages": messages }), words))
}

/// A visualization and the run file that it is written to.
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
    /// Creates the file. `known` is a stamp with its UNIX time, for run files from other programs, which do not store
    /// the clock.
    fn begin(run: &Path, out: &Path, reader: &RunReader, known: Option<(u64, u64)>) -> Answer<Self> {
        let Some(robot) = robot_of(run, reader.attachments())? else {
            return Err(Failure::NotNow(format!(
                "{} holds no robot.toml that this program accepts, so the anchor positions are unknown",
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

    fn record(&mut self, channel: &str, type_name: &str, sample: &[u8], now_ns: u64) -> Answer {
        if let Some(drawing) = self.visualization.record(channel, type_name, sample) {
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
