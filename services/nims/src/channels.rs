//! `nims channel`: lists, counts and prints channels of any type.

use bus::{Participant, clock};
use client::{LinkTap, Place, RobotLink};
use command::values::seconds;
use command::{Answer, Failure, Output};
use serde_json::json;
use std::time::Duration;

/// `nims channel`.
#[derive(Debug, clap::Subcommand)]
pub enum Command {
    /// List every channel with its type.
    List,
    /// Say what a channel carries: who publishes it, its type, and what each field means.
    Info {
        /// Name of the channel.
        name: String,
    },
    /// Count the samples that arrive per second, and the lost ones.
    Hz {
        /// Channel; default: all.
        name: Option<String>,
        /// Time to count, s.
        #[arg(long = "for", value_name = "SECONDS", default_value = "3", value_parser = seconds, allow_negative_numbers = true)]
        seconds: f64,
    },
    /// Print samples as they arrive, one JSON object per line.
    Echo {
        /// Name of the channel.
        name: String,
        /// Stop after this many samples.
        #[arg(long, short = 'n', value_name = "N")]
        count: Option<u64>,
        /// Stop after this many seconds.
        #[arg(long = "for", value_name = "SECONDS", value_parser = seconds, allow_negative_numbers = true)]
        seconds: Option<f64>,
    },
}

impl Command {
    /// Runs the command.
    ///
    /// # Errors
    /// Shared memory cannot be read, or there is no such channel.
    pub fn run(&self, place: Place<'_>) -> Answer<Option<Output>> {
        let link = client::link_as(place, Participant::Guest)?;
        match self {
            Self::List => list(&link).map(Some),
            Self::Info { name } => info(&link, name).map(Some),
            Self::Hz { name, seconds } => rates(&link, name.as_deref(), *seconds).map(Some),
            Self::Echo { name, count, seconds } => echo(&link, name, *count, *seconds).map(|()| None),
        }
    }
}

/// Time between two polls of the counted channels: shorter than the time in which any channel's buffer fills.
const POLL: Duration = Duration::from_millis(20);

/// `nims channel list`.
///
/// # Errors
/// Shared memory cannot be read.
fn list(link: &RobotLink) -> Answer<Output> {
    let channels = link.channels()?;
    let width = channels.iter().map(|channel| channel.name.len()).max().unwrap_or(0);
    let mut lines = Vec::new();
    let mut rows = Vec::new();
    for channel in &channels {
        lines.push(format!("{:width$}  {:6} B  {}", channel.name, channel.size_bytes, channel.type_name));
        rows.push(json!({
            "name": channel.name, "type": channel.type_name, "size_bytes": channel.size_bytes, "buffer": channel.buffer,
            "history": channel.history, "has_schema": channel.has_schema, "processes": channel.processes,
        }));
    }
    Ok(Output::new(json!({ "channels": rows }), lines.join("\n")))
}

/// `nims channel info`: what a channel carries, of plug-ins too.
///
/// # Errors
/// There is no such channel.
fn info(link: &RobotLink, name: &str) -> Answer<Output> {
    let tap = LinkTap::open(link, name)?;
    let Some(row) = link.channels()?.into_iter().find(|row| row.name == name) else {
        return Err(Failure::NotNow(format!("channel {name} has just ended: ask again once its process runs")));
    };
    let known = messages::channel_of(name);
    let publisher = known.map_or("a plug-in", |channel| channel.publisher);
    let kept = messages::quality_for(name, row.size_bytes).kept();
    let definition = messages::documented(&row.type_name).map(str::to_owned).or(tap.definition().map(|(_, text)| text));
    let shown = definition.as_deref().unwrap_or("# Its publisher does not say what the fields are.");
    let words = format!(
        "{name}: {}, {} bytes, published by {publisher}; a late reader receives {kept}\n\n{}",
        row.type_name,
        row.size_bytes,
        shown.trim_end()
    );
    let fields = json!({
        "name": name, "type": row.type_name, "size_bytes": row.size_bytes, "publisher": publisher,
        "late_samples": messages::quality_for(name, row.size_bytes).late, "definition": definition,
    });
    Ok(Output::new(fields, words))
}

/// `nims channel hz`: counts for some seconds.
///
/// # Errors
/// There is no such channel, or the time is out of range.
fn rates(link: &RobotLink, name: Option<&str>, seconds: f64) -> Answer<Output> {
    let time = duration(seconds)?;
    let names = match name {
        Some(name) => vec![name.to_owned()],
        None => link.channels()?.into_iter().map(|channel| channel.name).collect(),
    };
    let mut taps = names.iter().map(|name| LinkTap::open(link, name)).collect::<Answer<Vec<_>>>()?;
    // Discard the samples from before the start.
    for tap in &mut taps {
        while tap.receive()?.is_some() {}
    }
    let mut counts = vec![(0_u64, 0_u64); taps.len()];
    let started = clock::now_ns();
    let end = started + time.as_nanos() as u64;
    while clock::now_ns() < end {
        clock::sleep_until(end.min(clock::now_ns() + POLL.as_nanos() as u64));
        for (tap, (received, lost)) in taps.iter_mut().zip(&mut counts) {
            while let Some((_, missing)) = tap.receive()? {
                *received += 1;
                *lost += missing;
            }
        }
    }
    let elapsed = (clock::now_ns() - started) as f64 * 1e-9;
    let width = names.iter().map(String::len).max().unwrap_or(0);
    let mut lines = Vec::new();
    let mut rows = Vec::new();
    for ((name, (received, lost)), tap) in names.iter().zip(&counts).zip(&taps) {
        let hz = *received as f64 / elapsed;
        // Losses can be counted only if the samples carry sequence numbers.
        let lost = tap.has_header().then_some(*lost);
        let words = lost.map_or_else(|| "-".to_owned(), |lost| lost.to_string());
        lines.push(format!("{name:width$}  {hz:7.1} Hz  {words} lost"));
        rows.push(json!({ "name": name, "hz": hz, "received": received, "lost": lost }));
    }
    Ok(Output::new(json!({ "seconds": elapsed, "channels": rows }), lines.join("\n")))
}

/// `nims channel echo`: prints samples until the count or the time is reached, or standard output is closed.
///
/// # Errors
/// There is no such channel.
fn echo(link: &RobotLink, name: &str, count: Option<u64>, seconds: Option<f64>) -> Answer {
    let end = match seconds {
        Some(seconds) => Some(clock::now_ns() + duration(seconds)?.as_nanos() as u64),
        None => None,
    };
    let mut tap = LinkTap::open(link, name)?;
    let schema = tap.schema();
    let mut waiter = link.waiter(&[name])?;
    let mut left = count.unwrap_or(u64::MAX);
    while left > 0 && end.is_none_or(|end| clock::now_ns() < end) {
        while left > 0
            && let Some((bytes, _)) = tap.receive()?
        {
            left -= 1;
            if !command::print_line(&replay::sample_value(schema.as_ref(), &bytes).to_string()) {
                return Ok(());
            }
        }
        if left > 0 {
            // Poll as well: a publisher outside this project may not notify.
            let poll_ns = clock::now_ns() + 50_000_000;
            waiter.wait_until(Some(end.map_or(poll_ns, |end| end.min(poll_ns))))?;
        }
    }
    Ok(())
}

fn duration(seconds: f64) -> Answer<Duration> {
    if seconds > 0.0 && seconds <= 86_400.0 {
        Ok(Duration::from_secs_f64(seconds))
    } else {
        Err(Failure::BadInput(format!("--for is {seconds}; accepted: above 0, at most 86400 s")))
    }
}
