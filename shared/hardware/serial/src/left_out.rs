//! Time that does not pass in a simulated device, and how the program at the other end of its line learns of it.
//!
//! A simulated device and the program that drives it share a computer. Where that computer has no time for one of them, the other must
//! not take it for a fault: a deadline that passes while the device has no processor says nothing about the device. So the device keeps a
//! small file beside its port, [`LeftOut`], and the two tell each other who they are and how much time was left out. A program that does not
//! know of the file, or does not use this crate, sees a device that runs on the machine's clock.
//!
//! A device that is killed leaves its file: who runs the domain removes it with the rest (`Domain::sweep` of the crate `bus`, which knows the
//! end of its name).
//!
//! The file holds numbers, each followed by its complement, so that half a number is never taken for one.

use std::fs::{File, OpenOptions};
use std::io;
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

use evidence::{State, Thread};
use rustix::io::{pread, pwrite};
use rustix::thread::gettid;

use crate::clock::monotonic_ns;

/// Where each number stands, bytes from the beginning.
const LEFT_OUT: u64 = 0;
const DEVICE: u64 = 16;
const PROGRAM: u64 = 32;
const WAKES: u64 = 48;

/// A device that sleeps for so much longer than it wanted to was not woken, ns: every wake-up takes some.
const OVERSLEPT_NS: u64 = 500_000;

/// A program at the far end of a simulated device's line, by its threads.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Program {
    /// Its first thread, which is also the number of the process.
    pub main: u32,
    /// The thread that has the line.
    pub port: u32,
}

/// The device's side of the file.
#[derive(Debug)]
pub struct LeftOut {
    file: File,
    path: PathBuf,
}

impl LeftOut {
    /// Makes the file beside a port; the calling thread is the one that has to run for the device to live.
    ///
    /// # Errors
    /// The file cannot be made or written.
    pub fn create(link: &Path) -> io::Result<Self> {
        let path = beside(link);
        let file = OpenOptions::new().read(true).write(true).create(true).truncate(true).mode(0o600).open(&path)?;
        let left_out = Self { file, path };
        write(&left_out.file, LEFT_OUT, 0)?;
        write(&left_out.file, WAKES, 0)?;
        write(&left_out.file, DEVICE, thread_id())?;
        Ok(left_out)
    }

    /// Tells how much time has been left out so far, ns.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn tell(&self, left_out_ns: u64) -> io::Result<()> {
        write(&self.file, LEFT_OUT, left_out_ns)
    }

    /// Tells until when the device sleeps, monotonic ns, before it has something to say or to take in; 0 where it only waits to be asked.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn sleeps_until(&self, wakes_ns: u64) -> io::Result<()> {
        write(&self.file, WAKES, wakes_ns)
    }

    /// The program that has said that it goes by this file.
    #[must_use]
    pub fn program(&self) -> Option<Program> {
        let both = read(&self.file, PROGRAM).filter(|both| *both != 0)?;
        Some(Program { main: (both >> 32) as u32, port: both as u32 })
    }
}

impl Drop for LeftOut {
    fn drop(&mut self) {
        let _ = std::fs::remove_file(&self.path);
    }
}

/// The program's side: what a line goes by beside the machine's clock. Nothing where the device is a real one.
#[derive(Debug)]
pub struct PortClock {
    path: PathBuf,
    far_side: Mutex<FarSide>,
}

#[derive(Debug, Default)]
struct FarSide {
    file: Option<File>,
    device: Option<Thread>,
    port: Option<Thread>,
    /// What the device told last, and what of it, or of devices before it, was left out while this line was connected.
    told_ns: u64,
    left_out_ns: u64,
}

impl PortClock {
    pub(crate) fn new(link: &str) -> Self {
        Self { path: beside(Path::new(link)), far_side: Mutex::default() }
    }

    /// The port was opened by the calling thread: looks for the file, and says who has the line.
    pub(crate) fn connected(&self) {
        let mut far_side = self.far_side();
        far_side.file = OpenOptions::new().read(true).write(true).open(&self.path).ok();
        far_side.told_ns = far_side.file.as_ref().and_then(|file| read(file, LEFT_OUT)).unwrap_or_default();
        (far_side.device, far_side.port) = (None, None);
        if let Some(file) = &far_side.file {
            let both = u64::from(std::process::id()) << 32 | thread_id();
            // A device that does not learn of this program lives on the machine's clock.
            let _ = write(file, PROGRAM, both);
            let device = read(file, DEVICE).and_then(|tid| Thread::of(tid as u32).ok());
            far_side.device = device;
        }
        far_side.port = Thread::of(thread_id() as u32).ok();
    }

    /// The port was closed: the device goes on without this program.
    pub(crate) fn closed(&self) {
        let mut far_side = self.far_side();
        if let Some(file) = far_side.file.take() {
            let _ = write(&file, PROGRAM, 0);
        }
        (far_side.device, far_side.port) = (None, None);
    }

    /// Time that the device has left out so far, while this line was connected, ns; never goes back.
    #[must_use]
    pub fn left_out_ns(&self) -> u64 {
        let mut far_side = self.far_side();
        if let Some(told_ns) = far_side.file.as_ref().and_then(|file| read(file, LEFT_OUT)) {
            // Less than before: another device has taken over the file, and begins at 0.
            let more_ns = told_ns.checked_sub(far_side.told_ns).unwrap_or(told_ns);
            far_side.left_out_ns += more_ns;
            far_side.told_ns = told_ns;
        }
        far_side.left_out_ns
    }

    /// Whether the device wants a processor at this moment, or the memory that a crowded computer took from it, so that its answer may only be
    /// late: it waits for one, or sleeps on when its time is over, as on a processor of a virtual machine that its host does not run.
    /// One that was stopped, or has ended, does not.
    #[must_use]
    pub fn device_wants_to_run(&self) -> bool {
        let mut far_side = self.far_side();
        let FarSide { file, device: Some(device), .. } = &mut *far_side else { return false };
        let now_ns = monotonic_ns();
        match device.look(now_ns).map(|_| device.state()) {
            Some(State::Runnable | State::Blocked) => true,
            Some(State::Asleep) => file
                .as_ref()
                .and_then(|file| read(file, WAKES))
                .is_some_and(|wakes_ns| wakes_ns != 0 && now_ns > wakes_ns.saturating_add(OVERSLEPT_NS)),
            _ => false,
        }
    }

    /// Whether the device, or the thread that has the line, wants a processor at this moment. For a third one: a thread that asks runs.
    #[must_use]
    pub fn either_wants_to_run(&self) -> bool {
        self.is_simulated() && (self.device_wants_to_run() || !self.port_sleeps())
    }

    /// Whether the thread that has the line sleeps, which it does only where it waits for what the device says, and the device could say
    /// it. For a third one: a thread that asks runs.
    #[must_use]
    pub fn port_waits_for_device(&self) -> bool {
        !self.device_wants_to_run() && self.port_sleeps()
    }

    fn port_sleeps(&self) -> bool {
        let mut far_side = self.far_side();
        let sleeps = |thread: &mut Thread| thread.look(monotonic_ns()).is_some() && thread.state() == State::Asleep;
        far_side.port.as_mut().is_some_and(sleeps)
    }

    /// Whether the far side is a simulated device that tells of its time.
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

/// A number, unless it is not there or just being written.
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
        let device = LeftOut::create(&link)?;
        assert_eq!(device.program(), None);
        let line = PortClock::new(&link.to_string_lossy());
        assert_eq!((line.left_out_ns(), line.is_simulated()), (0, false));
        line.connected();
        let own = Program { main: std::process::id(), port: thread_id() as u32 };
        assert_eq!((device.program(), line.is_simulated()), (Some(own), true));
        device.tell(7)?;
        assert_eq!(line.left_out_ns(), 7);
        // the device is this very thread
        assert!(line.device_wants_to_run());
        line.closed();
        assert!(!line.device_wants_to_run());
        assert_eq!((device.program(), line.left_out_ns()), (None, 7));
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
            let _ = tell.send(LeftOut::create(&path));
            let _ = ended.recv();
        });
        let Ok(file) = told.recv() else { panic!("no device") };
        let file = file?;
        let line = PortClock::new(&link.to_string_lossy());
        line.connected();
        // Once its thread sleeps, what it said decides.
        while line.device_wants_to_run() {
            std::thread::yield_now();
        }
        let now_ns = monotonic_ns();
        file.sleeps_until(now_ns + 60_000_000_000)?;
        assert!(!line.device_wants_to_run());
        file.sleeps_until(now_ns - 2 * OVERSLEPT_NS)?;
        assert!(line.device_wants_to_run());
        file.sleeps_until(0)?;
        assert!(!line.device_wants_to_run());
        drop(end);
        device.join().map_err(|_| io::Error::other("the device"))
    }

    #[test]
    fn what_was_left_out_never_goes_back() -> io::Result<()> {
        let link = link("back");
        let line = PortClock::new(&link.to_string_lossy());
        let first = LeftOut::create(&link)?;
        line.connected();
        first.tell(5)?;
        assert_eq!(line.left_out_ns(), 5);
        // another one in its place, in the same file
        let second = LeftOut::create(&link)?;
        assert_eq!(line.left_out_ns(), 5);
        second.tell(2)?;
        assert_eq!(line.left_out_ns(), 7);
        // the same one again
        line.connected();
        assert_eq!(line.left_out_ns(), 7);
        Ok(())
    }

    #[test]
    fn half_a_number_is_none() -> io::Result<()> {
        let link = link("half");
        let device = LeftOut::create(&link)?;
        pwrite(&device.file, &[1], LEFT_OUT)?;
        assert_eq!(read(&device.file, LEFT_OUT), None);
        assert_eq!(read(&device.file, 1000), None);
        Ok(())
    }
}
