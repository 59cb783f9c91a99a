//! Time that a simulated device leaves out, shared with the program at the other end of its port.
//!
//! A simulated device and the program that drives it share a computer. Where that computer has no time for one of them,
//! the other must not count it as a fault: a deadline that passes while the device has no processor says nothing about
//! the device. The device therefore keeps a small file beside its port, [`LeftOutClock`], in which both write their
//! threads and the device the time that it left out. For a program that does not use the file the device runs on the
//! machine's clock.
//!
//! A killed device leaves its file; the owner of the domain removes it (`Domain::sweep` of the crate `bus`, which has
//! its suffix).
//!
//! The file holds numbers, each followed by its complement, so that a half-written number is detected.

use std::fs::{File, OpenOptions};
use std::io;
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

use evidence::{State, Thread};
use rustix::io::{pread, pwrite};
use rustix::thread::gettid;

use crate::clock::monotonic_ns;

/// Offset of each number, bytes.
const LEFT_OUT: u64 = 0;
const DEVICE: u64 = 16;
const PROGRAM: u64 = 32;
const WAKES: u64 = 48;

/// A device that sleeps this much longer than planned has no processor, ns; an ordinary wake-up takes less.
const OVERSLEPT_NS: u64 = 500_000;

/// Threads of the program at the far end of a simulated device's port.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Program {
    /// First thread, whose number is that of the process.
    pub main: u32,
    /// Thread that owns the port.
    pub port: u32,
}

/// The device's side of the file.
#[derive(Debug)]
pub struct LeftOutClock {
    file: File,
    path: PathBuf,
}

impl LeftOutClock {
    /// Creates the file beside a port. The calling thread is the one that runs the device.
    ///
    /// # Errors
    /// The file cannot be created or written.
    pub fn create(link: &Path) -> io::Result<Self> {
        let path = beside(link);
        let file = OpenOptions::new().read(true).write(true).create(true).truncate(true).mode(0o600).open(&path)?;
        let left_out = Self { file, path };
        write(&left_out.file, LEFT_OUT, 0)?;
        write(&left_out.file, WAKES, 0)?;
        write(&left_out.file, DEVICE, thread_id())?;
        Ok(left_out)
    }

    /// Writes the time that has been left out so far, ns.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn write(&self, left_out_ns: u64) -> io::Result<()> {
        write(&self.file, LEFT_OUT, left_out_ns)
    }

    /// Writes the monotonic time until which the device sleeps, ns; 0 where it only waits for bytes.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn sleeps_until(&self, wakes_ns: u64) -> io::Result<()> {
        write(&self.file, WAKES, wakes_ns)
    }

    /// Program that uses this file.
    #[must_use]
    pub fn program(&self) -> Option<Program> {
        let both = read(&self.file, PROGRAM).filter(|both| *both != 0)?;
        Some(Program { main: (both >> 32) as u32, port: both as u32 })
    }
}

impl Drop for LeftOutClock {
    fn drop(&mut self) {
        let _ = std::fs::remove_file(&self.path);
    }
}

/// The program's side of the file: corrections to the machine's clock. No file, and no correction, for a real device.
#[derive(Debug)]
pub struct PortClock {
    link: PathBuf,
    path: PathBuf,
    far_side: Mutex<FarSide>,
}

#[derive(Debug, Default)]
struct FarSide {
    file: Option<File>,
    device: Option<Thread>,
    port: Option<Thread>,
    /// Last number of the device, and the time left out by this and earlier devices while the port was connected, ns.
    told_ns: u64,
    left_out_ns: u64,
}

impl PortClock {
    pub(crate) fn new(link: &str) -> Self {
        let link = PathBuf::from(link);
        Self { path: beside(&link), link, far_side: Mutex::default() }
    }

    /// Looks for the file after the calling thread opened the port, and writes the thread into it.
    pub(crate) fn connected(&self) {
        let mut far_side = self.far_side();
        far_side.file = OpenOptions::new().read(true).write(true).open(&self.path).ok();
        far_side.told_ns = far_side.file.as_ref().and_then(|file| read(file, LEFT_OUT)).unwrap_or_default();
        (far_side.device, far_side.port) = (None, None);
        if let Some(file) = &far_side.file {
            let both = u64::from(std::process::id()) << 32 | thread_id();
            // Without this entry the device runs on the machine's clock.
            let _ = write(file, PROGRAM, both);
            let device = read(file, DEVICE).and_then(|tid| Thread::with_id(tid as u32).ok());
            far_side.device = device;
        }
        far_side.port = Thread::with_id(thread_id() as u32).ok();
    }

    /// Removes this program from the file after the port was closed.
    pub(crate) fn closed(&self) {
        let mut far_side = self.far_side();
        if let Some(file) = far_side.file.take() {
            let _ = write(&file, PROGRAM, 0);
        }
        (far_side.device, far_side.port) = (None, None);
    }

    /// Time that the device has left out while this port was connected, ns; never decreases.
    #[must_use]
    pub fn left_out_ns(&self) -> u64 {
        let mut far_side = self.far_side();
        if let Some(told_ns) = far_side.file.as_ref().and_then(|file| read(file, LEFT_OUT)) {
            // Less than before: a new device has taken over the file and begins at 0.
            let more_ns = told_ns.checked_sub(far_side.told_ns).unwrap_or(told_ns);
            far_side.left_out_ns += more_ns;
            far_side.told_ns = told_ns;
        }
        far_side.left_out_ns
    }

    /// True while the device waits for a processor or for memory that a crowded computer took from it, so that its
    /// answer may only be late. That includes a device that sleeps past its time, as on a virtual machine whose host
    /// does not run it. A device that was stopped or has ended does not wait.
    #[must_use]
    pub fn device_wants_to_run(&self) -> bool {
        let mut far_side = self.far_side();
        let FarSide { file, device: Some(device), .. } = &mut *far_side else { return false };
        let now_ns = monotonic_ns();
        match device.run_delay_ns(now_ns).map(|_| device.state()) {
            Some(State::Runnable | State::Blocked) => true,
            Some(State::Asleep) => file
                .as_ref()
                .and_then(|file| read(file, WAKES))
                .is_some_and(|wakes_ns| wakes_ns != 0 && now_ns > wakes_ns.saturating_add(OVERSLEPT_NS)),
            _ => false,
        }
    }

    /// True while the device or the thread that owns the port waits for a processor. To be called by another thread.
    #[must_use]
    pub fn either_wants_to_run(&self) -> bool {
        self.is_simulated() && (self.device_wants_to_run() || !self.port_sleeps())
    }

    /// True while the thread that owns the port sleeps, which it does only while it waits for the device, and the
    /// device has a processor. To be called by another thread.
    #[must_use]
    pub fn port_waits_for_device(&self) -> bool {
        !self.device_wants_to_run() && self.port_sleeps()
    }

    /// True where no device has the name of the port. It may be called while another thread waits for the device.
    #[must_use]
    pub fn device_is_gone(&self) -> bool {
        !self.link.exists()
    }

    fn port_sleeps(&self) -> bool {
        let mut far_side = self.far_side();
        let sleeps =
            |thread: &mut Thread| thread.run_delay_ns(monotonic_ns()).is_some() && thread.state() == State::Asleep;
        far_side.port.as_mut().is_some_and(sleeps)
    }

    /// True where the far side is a simulated device with a file.
    #[must_use]
    pub fn is_simulated(&self) -> bool {
        self.far_side().file.is_some()
    }

    fn far_side(&self) -> MutexGuard<'_, FarSide> {
        self.far_side.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

fn thread_id() -> u64 {
    u64::from(gettid().as_raw_nonzero().get().unsigned_abs())
}

fn beside(link: &Path) -> PathBuf {
    let mut name = link.as_os_str().to_owned();
    name.push(".time");
    name.into()
}

fn write(file: &File, at: u64, number: u64) -> io::Result<()> {
    let mut bytes = [0; 16];
    bytes[..8].copy_from_slice(&number.to_ne_bytes());
    bytes[8..].copy_from_slice(&(!number).to_ne_bytes());
    pwrite(file, &bytes, at)?;
    Ok(())
}

/// Reads a number; `None` if it is missing or half-written.
fn read(file: &File, at: u64) -> Option<u64> {
    let mut bytes = [0; 16];
    if pread(file, &mut bytes, at).ok()? != bytes.len() {
        return None;
    }
    let half = |from: usize| Some(u64::from_ne_bytes(bytes.get(from..from + 8)?.try_into().ok()?));
    let number = half(0)?;
    (half(8)? == !number).then_some(number)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn link(name: &str) -> PathBuf {
        std::env::temp_dir().join(format!("nims-left-out-{}-{name}", std::process::id()))
    }

    #[test]
    fn both_sides_learn_of_each_other() -> io::Result<()> {
        let link = link("both");
        let device = LeftOutClock::create(&link)?;
        assert_eq!(device.program(), None);
        let port = PortClock::new(&link.to_string_lossy());
        assert_eq!((port.left_out_ns(), port.is_simulated()), (0, false));
        port.connected();
        let own = Program { main: std::process::id(), port: thread_id() as u32 };
        assert_eq!((device.program(), port.is_simulated()), (Some(own), true));
        device.write(7)?;
        assert_eq!(port.left_out_ns(), 7);
        // The device is this thread.
        assert!(port.device_wants_to_run());
        port.closed();
        assert!(!port.device_wants_to_run());
        assert_eq!((device.program(), port.left_out_ns()), (None, 7));
        drop(device);
        assert!(!beside(&link).exists());
        Ok(())
    }

    #[test]
    fn a_device_that_sleeps_longer_than_it_wanted_to_wants_to_run() -> io::Result<()> {
        let link = link("overslept");
        let (tell, told) = std::sync::mpsc::channel();
        let (end, ended) = std::sync::mpsc::channel::<()>();
        let path = link.clone();
        let device = std::thread::spawn(move || {
            let _ = tell.send(LeftOutClock::create(&path));
            let _ = ended.recv();
        });
        let Ok(file) = told.recv() else { panic!("no device") };
        let file = file?;
        let port = PortClock::new(&link.to_string_lossy());
        port.connected();
        // Once its thread sleeps, the time in the file decides.
        while port.device_wants_to_run() {
            std::thread::yield_now();
        }
        let now_ns = monotonic_ns();
        file.sleeps_until(now_ns + 60_000_000_000)?;
        assert!(!port.device_wants_to_run());
        file.sleeps_until(now_ns - 2 * OVERSLEPT_NS)?;
        assert!(port.device_wants_to_run());
        file.sleeps_until(0)?;
        assert!(!port.device_wants_to_run());
        drop(end);
        device.join().map_err(|_| io::Error::other("the device"))
    }

    #[test]
    fn what_was_left_out_never_goes_back() -> io::Result<()> {
        let link = link("back");
        let port = PortClock::new(&link.to_string_lossy());
        let first = LeftOutClock::create(&link)?;
        port.connected();
        first.write(5)?;
        assert_eq!(port.left_out_ns(), 5);
        // Another device in the same file.
        let second = LeftOutClock::create(&link)?;
        assert_eq!(port.left_out_ns(), 5);
        second.write(2)?;
        assert_eq!(port.left_out_ns(), 7);
        // The same device again.
        port.connected();
        assert_eq!(port.left_out_ns(), 7);
        Ok(())
    }

    #[test]
    fn half_a_number_is_none() -> io::Result<()> {
        let link = link("half");
        let device = LeftOutClock::create(&link)?;
        pwrite(&device.file, &[1], LEFT_OUT)?;
        assert_eq!(read(&device.file, LEFT_OUT), None);
        assert_eq!(read(&device.file, 1000), None);
        Ok(())
    }
}
