//! One serial wire on a pseudo-terminal, with the delays of a real wire in both directions.

use std::collections::VecDeque;
use std::os::fd::BorrowedFd;
use std::path::Path;

use serial::{Error, Pty, PtyLink, Random, WireQueue, byte_time_ns};

/// A wire whose far end programs open under a stable name.
///
/// A pseudo-terminal delivers bytes at once, so both directions are delayed here until a real wire would have delivered
/// them. Bytes to the units arrive one by one. An answer is delivered as a whole when its last byte is due, because
/// half of it is of no use and every delivery wakes a process.
#[derive(Debug)]
pub struct Wire {
    jack: PtyLink,
    byte_ns: u64,
    to_units: WireQueue,
    /// Time of arrival of the last byte to the units, ns.
    to_units_done_ns: u64,
    from_units: WireQueue,
    answers: VecDeque<(u64, usize)>,
    answer_bytes: VecDeque<u8>,
    /// Fault: the units' answers are dropped.
    pub silent: bool,
    /// Fault: delay of answers, ns.
    pub late_ns: u64,
    /// Fault: probability for each byte, in both directions, that one of its bits is inverted.
    pub noise: f64,
    random: Random,
}

impl Wire {
    /// Creates a wire and publishes it at `link`.
    ///
    /// # Errors
    /// The pseudo-terminal cannot be created or published.
    pub fn new(link: &Path, baud: u32, seed: u64) -> Result<Self, Error> {
        let mut jack = PtyLink::new(link);
        jack.plug()?;
        Ok(Self {
            jack,
            byte_ns: byte_time_ns(baud),
            to_units: WireQueue::new(baud),
            to_units_done_ns: 0,
            from_units: WireQueue::new(baud),
            answers: VecDeque::with_capacity(64),
            answer_bytes: VecDeque::with_capacity(1024),
            silent: false,
            late_ns: 0,
            noise: 0.0,
            random: Random::new(seed),
        })
    }

    /// Descriptor to wait on for bytes from a program; `None` while it is unplugged.
    pub fn descriptor(&self) -> Option<BorrowedFd<'_>> {
        use std::os::fd::AsFd;
        self.jack.pty().map(Pty::as_fd)
    }

    /// Takes bytes that a program wrote; their transit begins at `now_ns`.
    ///
    /// # Errors
    /// The pseudo-terminal failed.
    pub fn take_in(&mut self, now_ns: u64) -> Result<(), Error> {
        let mut buffer = [0; 512];
        let Some(pty) = self.jack.pty() else { return Ok(()) };
        loop {
            let n = pty.read(&mut buffer)?;
            if n == 0 {
                return Ok(());
            }
            spoil(&mut buffer[..n], self.noise, &mut self.random);
            self.to_units.push(now_ns, &buffer[..n]);
            self.to_units_done_ns = self.to_units_done_ns.max(now_ns) + n as u64 * self.byte_ns;
            if n < buffer.len() {
                return Ok(());
            }
        }
    }

    /// Takes the next byte that has reached the units by `now_ns`, with its time of arrival.
    pub fn next_for_units(&mut self, now_ns: u64) -> Option<(u64, u8)> {
        self.to_units.pop(now_ns)
    }

    /// Calls `speak`, which puts an answer on the wire.
    pub fn answer<R>(&mut self, speak: impl FnOnce(&mut WireQueue) -> R) -> R {
        let result = speak(&mut self.from_units);
        let mut bytes = 0;
        let mut done_ns = 0;
        while let Some((at_ns, byte)) = self.from_units.pop(u64::MAX) {
            self.answer_bytes.push_back(byte);
            done_ns = at_ns;
            bytes += 1;
        }
        if bytes > 0 {
            self.answers.push_back((done_ns + self.late_ns, bytes));
        }
        result
    }

    /// Delivers the answers that have arrived by `now_ns`. Bytes that do not fit because no program reads are lost.
    ///
    /// # Errors
    /// The pseudo-terminal failed.
    pub fn hand_out(&mut self, now_ns: u64) -> Result<(), Error> {
        let mut buffer = [0; 512];
        while let Some(&(done_ns, bytes)) = self.answers.front()
            && done_ns <= now_ns
        {
            self.answers.pop_front();
            let mut left = bytes;
            while left > 0 {
                let part = left.min(buffer.len());
                for (slot, byte) in buffer.iter_mut().zip(self.answer_bytes.drain(..part)) {
                    *slot = byte;
                }
                left -= part;
                spoil(&mut buffer[..part], self.noise, &mut self.random);
                if !self.silent
                    && let Some(pty) = self.jack.pty()
                {
                    pty.write(&buffer[..part])?;
                }
            }
        }
        Ok(())
    }

    /// Time of the next event that is not caused by a program, ns.
    pub fn next_ns(&self) -> Option<u64> {
        let to_units = (!self.to_units.is_empty()).then_some(self.to_units_done_ns);
        let from_units = self.answers.front().map(|&(done_ns, _)| done_ns);
        [to_units, from_units].into_iter().flatten().min()
    }

    /// Lifts a killed program's lock on the terminal; called some times a second.
    pub fn maintain(&self) {
        if let Some(pty) = self.jack.pty() {
            pty.release_exclusive();
        }
    }

    /// Unplugs the wire: the name disappears, and a program that has the port open finds it gone. Bytes in transit are
    /// lost.
    pub fn unplug(&mut self) {
        self.jack.unplug();
        self.to_units.clear();
        self.from_units.clear();
        self.answers.clear();
        self.answer_bytes.clear();
    }

    /// Plugs the wire in again, under the same name.
    ///
    /// # Errors
    /// The pseudo-terminal cannot be created or published.
    pub fn plug(&mut self) -> Result<(), Error> {
        if self.jack.pty().is_none() {
            self.jack.plug()?;
        }
        Ok(())
    }
}

/// Inverts one bit of each byte with the given probability.
fn spoil(bytes: &mut [u8], probability: f64, random: &mut Random) {
    if probability <= 0.0 {
        return;
    }
    for byte in bytes {
        if random.chance(probability) {
            *byte ^= 1 << (random.byte() % 8);
        }
    }
}
