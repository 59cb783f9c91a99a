//! One serial device of this machine, opened exclusively.

use std::fs;
use std::os::fd::OwnedFd;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use rustix::event::{PollFd, PollFlags, epoll, poll};
use rustix::fs::{Mode, OFlags};
use rustix::io::Errno;
use rustix::time::Timespec;
use serialport::{ClearBuffer, SerialPort, TTYPort};

use crate::Error;
use crate::clock::{monotonic_ns, sleep_until};
use crate::transport::{StatusPin, Transport};

/// Time for which the adapter may hold received bytes back.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Latency {
    /// The adapter has no such timer (native UART, USB-CDC, pseudo-terminal).
    Immediate,
    /// The adapter's timer was set to, or already was, its shortest: 1 ms.
    Short,
    /// The adapter waits this many milliseconds, and the user has no permission to change it.
    Long(u32),
}

/// An open serial port, 8 data bits, no parity, 1 stop bit, no flow control.
#[derive(Debug)]
pub struct Port {
    name: Arc<str>,
    tty: TTYPort,
    /// The same device, for its bytes: serialport asks before each piece whether the device is ready, and reports the
    /// end of a wait by an error on the heap. Reads and writes of it never wait.
    bytes: OwnedFd,
    /// Tells that bytes have arrived. The kernel asks a terminal that is polled, and then waits until its worker has
    /// finished with the last bytes, which is a second sleep for every answer; of an event it is told.
    arrivals: Option<OwnedFd>,
    /// The last read took all bytes that were there, so the next ones are an event.
    drained: bool,
    latency: Latency,
}

impl Port {
    /// Opens the device exclusively, sets its adapter to low latency, and discards bytes that an earlier program left
    /// unread.
    ///
    /// A protocol on top should still wait for silence and ask something harmless first: the far side may be in the
    /// middle of an answer.
    pub fn open(name: &Arc<str>, baud: u32) -> Result<Port, Error> {
        // Before the exclusive mode, which refuses it.
        let flags = OFlags::RDWR | OFlags::NOCTTY | OFlags::NONBLOCK | OFlags::CLOEXEC;
        let bytes = rustix::fs::open(&**name, flags, Mode::empty());
        let tty = serialport::new(&**name, baud)
            .timeout(Duration::ZERO)
            .exclusive(true)
            .open_native()
            .map_err(|error| Error::from_open(name, baud, &error))?;
        let bytes = bytes.map_err(|_| Error::Gone { port: Arc::clone(name), doing: "opening" })?;
        let latency = lower_latency(Path::new(&**name));
        let arrivals = events_of(&bytes).ok();
        let mut port = Port { name: Arc::clone(name), tty, bytes, arrivals, drained: false, latency };
        port.clear()?;
        Ok(port)
    }

    /// Time for which this port's adapter may hold received bytes back.
    #[must_use]
    pub fn latency(&self) -> Latency {
        self.latency
    }

    fn gone(&self, doing: &'static str) -> Error {
        Error::Gone { port: Arc::clone(&self.name), doing }
    }

    /// Waits until the device has bytes, or is gone; false after the deadline.
    fn has_bytes(&self, deadline_ns: u64) -> bool {
        while self.drained
            && let Some(arrivals) = &self.arrivals
        {
            // Whole milliseconds, because older kernels have no others here.
            let left_ms = deadline_ns.saturating_sub(monotonic_ns()) / 1_000_000;
            if left_ms == 0 {
                break;
            }
            let left = Timespec { tv_sec: (left_ms / 1000) as i64, tv_nsec: (left_ms % 1000 * 1_000_000) as i64 };
            let mut event = [epoll::Event { flags: epoll::EventFlags::empty(), data: epoll::EventData::new_u64(0) }];
            match epoll::wait(arrivals, &mut event, Some(&left)) {
                Ok(0) | Err(Errno::INTR) => {}
                // What is done next tells what is wrong.
                Ok(_) | Err(_) => return true,
            }
        }
        self.is_ready(PollFlags::IN, deadline_ns)
    }

    /// Waits until the device has bytes or room for them, or is gone; false after the deadline.
    fn is_ready(&self, what: PollFlags, deadline_ns: u64) -> bool {
        loop {
            let left_ns = deadline_ns.saturating_sub(monotonic_ns());
            let left = Timespec { tv_sec: (left_ns / 1_000_000_000) as i64, tv_nsec: (left_ns % 1_000_000_000) as i64 };
            match poll(&mut [PollFd::new(&self.bytes, what)], Some(&left)) {
                Ok(0) => return false,
                Err(Errno::INTR) => {}
                // What is done next tells what is wrong.
                Ok(_) | Err(_) => return true,
            }
        }
    }
}

impl Transport for Port {
    fn name(&self) -> &Arc<str> {
        &self.name
    }

    fn now_ns(&self) -> u64 {
        monotonic_ns()
    }

    fn wait_until(&mut self, until_ns: u64) {
        sleep_until(until_ns);
    }

    fn connection(&mut self) -> Result<u32, Error> {
        Ok(1)
    }

    fn write_all(&mut self, bytes: &[u8], deadline_ns: u64) -> Result<(), Error> {
        let mut rest = bytes;
        while !rest.is_empty() {
            match rustix::io::write(&self.bytes, rest) {
                Ok(0) => return Err(self.gone("writing")),
                Ok(n) => rest = rest.get(n..).unwrap_or_default(),
                Err(Errno::INTR) => {}
                Err(Errno::AGAIN) => {
                    if monotonic_ns() >= deadline_ns || !self.is_ready(PollFlags::OUT, deadline_ns) {
                        return Err(Error::Stuck { port: Arc::clone(&self.name) });
                    }
                }
                Err(_) => return Err(self.gone("writing")),
            }
        }
        Ok(())
    }

    fn read(&mut self, buffer: &mut [u8], deadline_ns: u64) -> Result<usize, Error> {
        if buffer.is_empty() {
            return Ok(0);
        }
        loop {
            // Only what is there is read after the deadline, so there is nothing to wait for.
            let late = monotonic_ns() >= deadline_ns;
            if !late && !self.has_bytes(deadline_ns) {
                return Ok(0);
            }
            let read = rustix::io::read(&self.bytes, &mut *buffer);
            self.drained = read.map_or(true, |n| n < buffer.len());
            match read {
                // A readable terminal with no data: some adapters report unplugging like this.
                Ok(0) => return Err(self.gone("reading")),
                Ok(n) => return Ok(n),
                Err(Errno::AGAIN | Errno::INTR) if late => return Ok(0),
                Err(Errno::AGAIN | Errno::INTR) => {}
                Err(_) => return Err(self.gone("reading")),
            }
        }
    }

    fn pending(&mut self) -> Result<usize, Error> {
        self.tty.bytes_to_read().map(|n| n as usize).map_err(|_| self.gone("asking for received bytes"))
    }

    fn clear(&mut self) -> Result<(), Error> {
        self.tty.clear(ClearBuffer::All).map_err(|_| self.gone("clearing the port"))
    }

    fn is_on(&mut self, pin: StatusPin) -> Result<bool, Error> {
        let state = match pin {
            StatusPin::Cts => self.tty.read_clear_to_send(),
            StatusPin::Dsr => self.tty.read_data_set_ready(),
            StatusPin::Cd => self.tty.read_carrier_detect(),
        };
        // A lost device and one without such an input give the same error; the next byte shows which.
        state.map_err(|_| Error::NoPin { port: Arc::clone(&self.name) })
    }
}

/// The events of a device: each arrival of bytes is one.
fn events_of(device: &OwnedFd) -> Result<OwnedFd, Errno> {
    let events = epoll::create(epoll::CreateFlags::CLOEXEC)?;
    epoll::add(&events, device, epoll::EventData::new_u64(0), epoll::EventFlags::IN | epoll::EventFlags::ET)?;
    Ok(events)
}

/// Sets the latency timer of an FTDI adapter, which holds short answers back for 16 ms by default: a file that the
/// device's owner can write.
fn lower_latency(path: &Path) -> Latency {
    let Some(timer) = fs::canonicalize(path)
        .ok()
        .and_then(|device| Some(Path::new("/sys/class/tty").join(device.file_name()?).join("device/latency_timer")))
    else {
        return Latency::Immediate;
    };
    let read = || fs::read_to_string(&timer).ok()?.trim().parse::<u32>().ok();
    match read() {
        None => Latency::Immediate,
        Some(0 | 1) => Latency::Short,
        Some(before) => {
            let _ = fs::write(&timer, "1");
            match read() {
                Some(0 | 1) => Latency::Short,
                after => Latency::Long(after.unwrap_or(before)),
            }
        }
    }
}
