//! The processes of a way.

use crate::link::Way;
use anyhow::{Context, Result};
use rustix::time::{ClockId, Timespec, clock_gettime};
use std::io::{BufRead, Write};
use std::path::Path;
use std::time::Duration;

/// Times in samples below this one are marks.
const MARKS: u64 = 1000;
/// Sent until the receiver has it: the connection stands.
const CONNECT: u64 = 1;
/// The first one after the samples.
const END: u64 = 2;
/// Time between two attempts to connect.
const CONNECT_PAUSE: Duration = Duration::from_millis(20);

/// Time of a clock, ns.
pub fn time_ns(clock: ClockId) -> u64 {
    let Timespec { tv_sec, tv_nsec } = clock_gettime(clock);
    tv_sec.unsigned_abs() * 1_000_000_000 + tv_nsec.unsigned_abs()
}

/// Waits for a sample, again and again; prints `ready` after the first, and all at the end: processor time, and the
/// time and delay of each sample, ns. `number` is unique among the receivers of the way.
pub fn receive(way: Way, place: &Path, number: &str) -> Result<()> {
    let mut receiver = way.receiver(place, number)?;
    let mut out = std::io::stdout().lock();
    writeln!(out, "open")?;
    let mut ready = false;
    let (mut begun_ns, mut delays_ns) = (0, Vec::with_capacity(1 << 20));
    loop {
        let sent_ns = receiver.receive()?;
        let now_ns = time_ns(ClockId::Monotonic);
        match sent_ns {
            CONNECT if !ready => {
                ready = true;
                writeln!(out, "ready")?;
                out.flush()?;
            }
            CONNECT => {}
            END => break,
            // The schedule has begun, so the first one is not counted.
            _ if begun_ns == 0 => begun_ns = time_ns(ClockId::ProcessCPUTime),
            MARKS.. => delays_ns.push((sent_ns, now_ns.saturating_sub(sent_ns))),
            _ => {}
        }
    }
    let used_ns = time_ns(ClockId::ProcessCPUTime) - begun_ns;
    writeln!(out, "{used_ns}")?;
    for (sent_ns, delay_ns) in delays_ns {
        writeln!(out, "{sent_ns} {delay_ns}")?;
    }
    Ok(())
}

/// Sends marks until a text line comes with the times of begin, period and gap and the numbers of samples in a row and
/// in all, then samples at these times, then the end. Prints the processor time to the standard error.
pub fn send(way: Way, place: &Path) -> Result<()> {
    let mut sender = way.sender(place)?;
    let (tell, told) = std::sync::mpsc::channel();
    std::thread::spawn(move || {
        let mut line = String::new();
        let _ = std::io::stdin().lock().read_line(&mut line);
        tell.send(line)
    });
    let line = loop {
        sender.send(CONNECT)?;
        if let Ok(line) = told.recv_timeout(CONNECT_PAUSE) {
            break line;
        }
    };
    let numbers = line.split_whitespace().map(str::parse).collect::<Result<Vec<u64>, _>>()?;
    let [begin_ns, period_ns, gap_ns, row, samples] = numbers[..] else { anyhow::bail!("{line:?} is no schedule") };
    let mut used_ns = 0;
    for number in 0..=samples {
        bus::clock::sleep_until(begin_ns + number / row * period_ns + number % row * gap_ns);
        if number == 1 {
            used_ns = time_ns(ClockId::ProcessCPUTime);
        }
        sender.send(time_ns(ClockId::Monotonic))?;
    }
    used_ns = time_ns(ClockId::ProcessCPUTime) - used_ns;
    writeln!(std::io::stderr(), "{used_ns}").context("the result cannot be written")?;
    for _ in 0..10 {
        std::thread::sleep(CONNECT_PAUSE);
        // A receiver that has ended takes no more.
        let _ = sender.send(END);
    }
    Ok(())
}
