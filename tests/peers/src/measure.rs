//! Starts the processes of every way on one schedule, and prints the table.

use crate::link::{BYTES, Way};
use crate::place::Place;
use crate::process::time_ns;
use anyhow::{Context, Result, ensure};
use rustix::event::{EventfdFlags, eventfd};
use rustix::time::ClockId;
use std::collections::HashMap;
use std::io::{BufRead, BufReader, Read, Write};
use std::path::Path;
use std::process::{Child, ChildStderr, ChildStdout, Stdio};

/// Time between the samples of two ways, ns: all fall asleep in between.
const SLOT_NS: u64 = 1_000_000;
/// Time between two samples of a row, ns: longer than the slowest way takes, and the memory that it uses is still in
/// the cache of the processor.
const GAP_NS: u64 = 500_000;
/// Time until the schedule begins, ns.
const HEAD_START_NS: u64 = 200_000_000;

/// What is measured.
#[derive(Debug, Clone, Copy)]
pub struct Plan {
    /// Samples of each way.
    pub samples: u64,
    /// Where the processes run.
    pub cores: Place,
    /// Receivers of each way.
    pub receivers: u64,
    /// Samples that a way sends in a row, before it is the turn of the next one.
    pub row: u64,
}

/// The processes of a way, which are killed when this is dropped.
struct Ends {
    name: &'static str,
    sender: Started<ChildStderr>,
    receivers: Vec<Started<ChildStdout>>,
}

/// A process and what it says; killed when dropped.
struct Started<O> {
    child: Child,
    says: BufReader<O>,
}

impl<O> Drop for Started<O> {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

impl Ends {
    fn start(way: Way, name: &'static str, place: &Path, cores: Place, receivers: u64) -> Result<Self> {
        ensure!(receivers == 1 || way.reaches_several(), "it has one receiver");
        let own = std::env::current_exe()?;
        let program = |role: &str| {
            let mut command = cores.command(&own, role);
            command.arg(role).arg(name).arg(place);
            command
        };
        let bell = eventfd(0, EventfdFlags::CLOEXEC)?;
        let mut started = Vec::new();
        for number in 0..receivers {
            let mut command = program("receive");
            command.arg(number.to_string()).stdin(bell.try_clone()?).stdout(Stdio::piped());
            let mut child = command.spawn()?;
            let mut says = BufReader::new(child.stdout.take().context("no output")?);
            said(&mut says).with_context(|| format!("{name}: the receiver does not open"))?;
            started.push(Started { child, says });
        }
        let mut child = program("send").stdin(Stdio::piped()).stdout(bell).stderr(Stdio::piped()).spawn()?;
        let says = BufReader::new(child.stderr.take().context("no output")?);
        let sender = Started { child, says };
        if way != Way::Nothing {
            for receiver in &mut started {
                said(&mut receiver.says).with_context(|| format!("{name}: the ends do not find each other"))?;
            }
        }
        Ok(Self { name, sender, receivers: started })
    }

    fn begin(&mut self, begin_ns: u64, period_ns: u64, plan: &Plan) -> Result<()> {
        let input = self.sender.child.stdin.as_mut().context("no input")?;
        Ok(writeln!(input, "{begin_ns} {period_ns} {GAP_NS} {} {}", plan.row, plan.samples)?)
    }

    /// Delays until the last receiver had a sample that all have, in rising order, ns, and the processor time of all
    /// processes, ns.
    fn result(&mut self) -> Result<(Vec<u64>, u64)> {
        let mut used_ns: u64 = said(&mut self.sender.says)?.parse()?;
        if self.name == Way::ALL[0].1 {
            return Ok((Vec::new(), used_ns));
        }
        let mut last = HashMap::<u64, (usize, u64)>::new();
        for receiver in &mut self.receivers {
            used_ns += said(&mut receiver.says).context("a receiver has no result")?.parse::<u64>()?;
            let mut text = String::new();
            receiver.says.read_to_string(&mut text)?;
            for line in text.lines() {
                let (sent_ns, delay_ns) = line.split_once(' ').context("a receiver says no delay")?;
                let (arrivals, last_ns) = last.entry(sent_ns.parse()?).or_default();
                *arrivals += 1;
                *last_ns = delay_ns.parse::<u64>()?.max(*last_ns);
            }
        }
        let all = self.receivers.len();
        let mut delays_ns: Vec<u64> =
            last.into_values().filter(|(arrivals, _)| *arrivals == all).map(|(_, last_ns)| last_ns).collect();
        delays_ns.sort_unstable();
        Ok((delays_ns, used_ns))
    }
}

fn said(from: &mut impl BufRead) -> Result<String> {
    let mut line = String::new();
    from.read_line(&mut line)?;
    ensure!(!line.is_empty(), "the process ended");
    Ok(line.trim().to_owned())
}

/// Measures every way, and prints the table.
pub fn measure(plan: Plan) -> Result<()> {
    let place = std::env::temp_dir().join(format!("peers-{}", std::process::id()));
    std::fs::create_dir_all(&place)?;
    let result = in_folder(plan, &place);
    std::fs::remove_dir_all(&place)?;
    result
}

fn in_folder(plan: Plan, place: &Path) -> Result<()> {
    let Plan { samples, cores, receivers, row } = plan;
    let _awake = cores.keep_awake(&std::env::current_exe()?)?;
    let mut all = Vec::new();
    for (way, name) in Way::ALL {
        match Ends::start(*way, name, place, cores, receivers) {
            Ok(ends) => all.push(ends),
            Err(error) => eprintln!("{name} is left out: {error:#}"),
        }
    }
    if cfg!(not(feature = "cyclone")) {
        eprintln!("Cyclone DDS is left out: this program was built without `cyclone`, which needs cmake and libclang");
    }
    let slot_ns = SLOT_NS.max(GAP_NS * row);
    let period_ns = slot_ns * all.len() as u64;
    let begin_ns = time_ns(ClockId::Monotonic) + HEAD_START_NS;
    for (ends, slot) in all.iter_mut().zip(0..) {
        ends.begin(begin_ns + slot * slot_ns, period_ns, &plan)?;
    }
    let whom = if receivers == 1 {
        "a sleeping process".to_owned()
    } else {
        format!("the last of {receivers} sleeping processes")
    };
    let what = if row == 1 { "a sample".to_owned() } else { format!("{row} samples in a row") };
    println!("{BYTES} bytes to {whom}, one way; {what} every {} ms, in turn\n", period_ns as f64 * 1e-6);
    println!("| way | samples | median (quartiles), µs | 99 %, µs | beside nims | processor of all ends, µs |");
    println!("|---|---|---|---|---|---|");
    let mut nims_us = f64::NAN;
    for ends in &mut all {
        let (delays_ns, used_ns) = ends.result().with_context(|| format!("{} has no result", ends.name))?;
        let used_us = used_ns as f64 * 1e-3 / samples as f64;
        let at = |share: f64| {
            let place = ((delays_ns.len().saturating_sub(1)) as f64 * share) as usize;
            delays_ns.get(place).map_or(f64::NAN, |delay_ns| *delay_ns as f64 * 1e-3)
        };
        let [low, median, high, late] = [0.25, 0.5, 0.75, 0.99].map(at);
        if ends.name == Way::ALL[1].1 {
            nims_us = median;
        }
        if delays_ns.is_empty() {
            println!("| {} | | | | | {used_us:.1} |", ends.name);
            continue;
        }
        println!(
            "| {} | {} | {median:.1} ({low:.1} to {high:.1}) | {late:.0} | {:.2} | {used_us:.1} |",
            ends.name,
            delays_ns.len(),
            median / nims_us
        );
    }
    Ok(())
}
