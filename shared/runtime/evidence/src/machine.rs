//! Statistics of the machine: pressure on its CPUs, and the number of runnable threads.

use std::fs::{self, File};

use rustix::io::pread;

/// `/proc/pressure/cpu` (Documentation/accounting/psi.rst in the kernel's sources).
#[derive(Debug)]
pub struct Pressure {
    file: File,
}

impl Pressure {
    /// Opens the file; returns `None` if the kernel has no pressure statistics.
    #[must_use]
    pub fn open() -> Option<Self> {
        // A kernel started with psi=0 has the file, but reading it fails.
        let pressure = Self { file: File::open("/proc/pressure/cpu").ok()? };
        pressure.waiting_us().is_some().then_some(pressure)
    }

    /// Returns the time since the start of the machine in which at least one thread had to wait for a CPU, µs.
    #[must_use]
    pub fn waiting_us(&self) -> Option<u64> {
        let mut buffer = [0; 128];
        let length = pread(&self.file, &mut buffer, 0).ok()?;
        total_us(buffer.get(..length)?)
    }

    /// Returns the fraction of the last ten seconds in which at least one thread had to wait for a CPU, 0 to 1.
    #[must_use]
    pub fn some_share(&self) -> Option<f64> {
        let mut buffer = [0; 128];
        let length = pread(&self.file, &mut buffer, 0).ok()?;
        average_10(buffer.get(..length)?)
    }
}

/// Parses the first text line, `some avg10=0.00 avg60=0.00 avg300=0.00 total=123`.
fn total_us(text: &[u8]) -> Option<u64> {
    number_after(text, b"total=")
}

fn average_10(text: &[u8]) -> Option<f64> {
    let percent: f64 = std::str::from_utf8(field(text, b"avg10=")?).ok()?.parse().ok()?;
    Some(percent / 100.0)
}

fn number_after(text: &[u8], key: &[u8]) -> Option<u64> {
    std::str::from_utf8(field(text, key)?).ok()?.parse().ok()
}

fn field<'a>(text: &'a [u8], key: &[u8]) -> Option<&'a [u8]> {
    let at = text.windows(key.len()).position(|window| window == key)? + key.len();
    let rest = text.get(at..)?;
    let end = rest.iter().position(u8::is_ascii_whitespace).unwrap_or(rest.len());
    rest.get(..end)
}

/// Number of runnable threads and of CPUs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Load {
    /// Mean number of threads that ran or waited for a CPU in the last minute (`/proc/loadavg`).
    pub minute: f64,
    /// Number of threads that now run or wait for a CPU, including the calling one.
    pub now: u32,
    /// Number of CPUs that this process may use.
    pub processors: usize,
}

impl Load {
    /// Reads the load; returns `None` if `/proc` cannot be read.
    #[must_use]
    pub fn read() -> Option<Self> {
        let text = fs::read_to_string("/proc/loadavg").ok()?;
        let (minute, now) = load(&text)?;
        Some(Self { minute, now, processors: std::thread::available_parallelism().map_or(1, usize::from) })
    }
}

/// Parses `0.20 0.18 0.12 1/80 11206`: averages over 1, 5 and 15 minutes, runnable and all threads, the newest process.
fn load(text: &str) -> Option<(f64, u32)> {
    let mut fields = text.split_whitespace();
    let minute = fields.next()?.parse().ok()?;
    let now = fields.nth(2)?.split_once('/')?.0.parse().ok()?;
    Some((minute, now))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texts_of_the_kernel_are_parsed() {
        let text = b"some avg10=12.50 avg60=17.94 avg300=11.34 total=67857332\nfull avg10=0.00 avg60=0.00 avg300=0.00 total=0\n";
        assert_eq!((total_us(text), average_10(text)), (Some(67_857_332), Some(0.125)));
        assert_eq!((total_us(b""), average_10(b"some")), (None, None));
        assert_eq!(load("0.20 0.18 0.12 3/80 11206\n"), Some((0.20, 3)));
        assert_eq!(load(""), None);
    }

    #[test]
    fn the_pressure_of_this_machine_never_decreases() {
        let Some(pressure) = Pressure::open() else { return };
        let first = pressure.waiting_us();
        assert!(first.is_some() && pressure.waiting_us() >= first);
        assert!(pressure.some_share().is_some_and(|share| (0.0..=1.0).contains(&share)));
    }
}
