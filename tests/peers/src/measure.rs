//! Starts the processes of every way on one schedule, and prints the table.

use crate::link::{BYTES, Way};
use crate::place::Place;
use crate::process::time_ns;
use anyhow::{Context, Result};
use rustix::event::{EventfdFlags, eventfd};
use rustix::time::ClockId;
use std::io::{BufRead, BufReader, Read, Write};
use std::path::Path;
use std::process::{Child, ChildStderr, ChildStdout, Stdio};

/// Time between the samples of two ways, ns: all fall asleep in between.
const SLOT_NS: u64 = 1_000_000;
/// Time until the schedule begins, ns.
const HEAD_START_NS: u64 = 200_000_000;

/// The processes of a way, which are killed when this is dropped.
struct Pair {
    name: &'static str,
    sender: Child,
    receiver: Child,
    sent: BufReader<ChildStderr>,
    received: BufReader<ChildStdout>,
}

impl Drop for Pair {
    fn drop(&mut self) {
        for child in [&mut self.sender, &mut self.receiver] {
            let _ = child.kill();
            let _ = child.wait();
        }
    }
}

impl Pair {
    fn start(way: Way, name: &'static str, place: &Path, cores: Place) -> Result<Self> {
        let own = std::env::current_exe()?;
        let program = |role: &str| {
            let mut command = cores.command(&own, role);
            command.arg(role).arg(name).arg(place);
            command
        };
        let bell = eventfd(0, EventfdFlags::CLOEXEC)?;
        let mut receiver = program("receive").stdin(bell.try_clone()?).stdout(Stdio::piped()).spawn()?;
        let mut received = BufReader::new(receiver.stdout.take().context("no output")?);
        said(&mut received).with_context(|| format!("{name}: the receiver does not open"))?;
        let mut sender = program("send").stdin(Stdio::piped()).stdout(bell).stderr(Stdio::piped()).spawn()?;
        let sent = BufReader::new(sender.stderr.take().context("no output")?);
        if way != Way::Nothing {
            said(&mut received).with_context(|| format!("{name}: the ends do not find each other"))?;
        }
        Ok(Self { name, sender, receiver, sent, received })
    }

    fn begin(&mut self, begin_ns: u64, period_ns: u64, samples: u64) -> Result<()> {
        let input = self.sender.stdin.as_mut().context("no input")?;
        Ok(writeln!(input, "{begin_ns} {period_ns} {samples}")?)
    }

    /// Delays in rising order, ns, and the processor time of both processes, ns.
    fn result(&mut self) -> Result<(Vec<u64>, u64)> {
        let sender_ns: u64 = said(&mut self.sent)?.parse()?;
        if self.name == Way::ALL[0].1 {
            return Ok((Vec::new(), sender_ns));
        }
        let mut text = String::new();
        self.received.read_to_string(&mut text)?;
        let numbers = text.lines().map(str::parse).collect::<Result<Vec<u64>, _>>()?;
        let (receiver_ns, delays_ns) = numbers.split_first().context("the receiver has no result")?;
        let mut delays_ns = delays_ns.to_vec();
        delays_ns.sort_unstable();
        Ok((delays_ns, sender_ns + receiver_ns))
    }
}

fn said(from: &mut impl BufRead) -> Result<String> {
    let mut line = String::new();
    from.read_line(&mut line)?;
    anyhow::ensure!(!line.is_empty(), "the process ended");
    Ok(line.trim().to_owned())
}

/// Measures every way with so many samples on these processors, and prints the table.
pub fn measure(samples: u64, cores: Place) -> Result<()> {
    let place = std::env::temp_dir().join(format!("peers-{}", std::process::id()));
    std::fs::create_dir_all(&place)?;
    let result = in_folder(samples, &place, cores);
    std::fs::remove_dir_all(&place)?;
    result
}

fn in_folder(samples: u64, place: &Path, cores: Place) -> Result<()> {
    let _awake = cores.keep_awake(&std::env::current_exe()?)?;
    let mut pairs = Vec::new();
    for (way, name) in Way::ALL {
        match Pair::start(*way, name, place, cores) {
            Ok(pair) => pairs.push(pair),
            Err(error) => eprintln!("{name} is left out: {error:#}"),
        }
    }
    let period_ns = SLOT_NS * pairs.len() as u64;
    let begin_ns = time_ns(ClockId::Monotonic) + HEAD_START_NS;
    for (pair, slot) in pairs.iter_mut().zip(0..) {
        pair.begin(begin_ns + slot * SLOT_NS, period_ns, samples)?;
    }
    println!("{BYTES} bytes to a sleeping process, one way; every {} ms, in turn\n", period_ns as f64 * 1e-6);
    println!("| way | samples | median (quartiles), µs | 99 %, µs | beside nims | processor of both ends, µs |");
    println!("|---|---|---|---|---|---|");
    let mut nims_us = f64::NAN;
    for pair in &mut pairs {
        let (delays_ns, used_ns) = pair.result().with_context(|| format!("{} has no result", pair.name))?;
        let used_us = used_ns as f64 * 1e-3 / samples as f64;
        let at = |share: f64| {
            let place = ((delays_ns.len().saturating_sub(1)) as f64 * share) as usize;
            delays_ns.get(place).map_or(f64::NAN, |delay_ns| *delay_ns as f64 * 1e-3)
        };
        let [low, median, high, late] = [0.25, 0.5, 0.75, 0.99].map(at);
        if pair.name == Way::ALL[1].1 {
            nims_us = median;
        }
        if delays_ns.is_empty() {
            println!("| {} | | | | | {used_us:.1} |", pair.name);
            continue;
        }
        println!(
            "| {} | {} | {median:.1} ({low:.1} to {high:.1}) | {late:.0} | {:.2} | {used_us:.1} |",
            pair.name,
            delays_ns.len(),
            median / nims_us
        );
    }
    Ok(())
}
