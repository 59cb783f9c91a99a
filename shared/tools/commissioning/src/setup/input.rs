//! Interruptible text lines from a terminal or a pipe.

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fd::BorrowedFd;
use rustix::io::Errno;

/// Poll interval: maximum delay until a signal that arrives just before the wait takes effect.
const POLL_INTERVAL: Timespec = Timespec { tv_sec: 0, tv_nsec: 200_000_000 };

/// Poll interval while something in addition to the input is watched: a few cycles of the robot.
const WATCH_INTERVAL: Timespec = Timespec { tv_sec: 0, tv_nsec: 20_000_000 };

/// Input event.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum InputEvent {
    /// A text line.
    Line(String),
    /// End of input.
    End,
    /// Interrupted, for example by Ctrl-C.
    Stopped,
}

/// Reader of text lines.
#[derive(Debug)]
pub struct LineReader<'a> {
    from: BorrowedFd<'a>,
    read: Vec<u8>,
    ended: bool,
}

impl<'a> LineReader<'a> {
    /// Creates a reader of this file.
    pub fn new(from: BorrowedFd<'a>) -> Self {
        Self { from, read: Vec::new(), ended: false }
    }

    /// Returns the next text line without its line feed; the last line needs none. Invalid UTF-8 becomes replacement
    /// characters.
    ///
    /// # Errors
    /// The file cannot be read.
    pub fn next(&mut self, stopped: &dyn Fn() -> bool) -> Result<InputEvent, std::io::Error> {
        self.next_within(&POLL_INTERVAL, &mut || stopped())
    }

    /// Like [`LineReader::next`]; `stopped` is called every few cycles of the robot.
    ///
    /// # Errors
    /// The file cannot be read.
    pub fn next_while_watching(&mut self, stopped: &mut dyn FnMut() -> bool) -> Result<InputEvent, std::io::Error> {
        self.next_within(&WATCH_INTERVAL, stopped)
    }

    fn next_within(
        &mut self,
        interval: &Timespec,
        stopped: &mut dyn FnMut() -> bool,
    ) -> Result<InputEvent, std::io::Error> {
        let text = |bytes: &[u8]| InputEvent::Line(String::from_utf8_lossy(bytes).into_owned());
        loop {
            if stopped() {
                return Ok(InputEvent::Stopped);
            }
            if let Some(end) = self.read.iter().position(|byte| *byte == b'\n') {
                let line: Vec<u8> = self.read.drain(..=end).collect();
                return Ok(text(&line[..end]));
            }
            if self.ended {
                let rest = std::mem::take(&mut self.read);
                return Ok(if rest.is_empty() { InputEvent::End } else { text(&rest) });
            }
            match poll(&mut [PollFd::from_borrowed_fd(self.from, PollFlags::IN)], Some(interval)) {
                Ok(0) | Err(Errno::INTR) => continue,
                Ok(_) => {}
                Err(error) => return Err(error.into()),
            }
            let mut part = [0; 4096];
            match rustix::io::read(self.from, &mut part) {
                Ok(0) => self.ended = true,
                Ok(count) => self.read.extend_from_slice(&part[..count]),
                Err(Errno::INTR) => {}
                Err(error) => return Err(error.into()),
            }
        }
    }
}
