//! One serial wire on a pseudo-terminal, with the delays of a real wire in both directions.

use std::collections::VecDeque;
use std::os::fd::BorrowedFd;
use std::path::Path;

use serial::{Error, Pty, PtyLink, Random, WireQueue, byte_time_ns};

/// A wire whose far end programs open under a stable name.
///
/// A pseudo-terminal delivers bytes at once, so both directions are delayed here until a real wire would have delivered
/// them. Bytes to the units arrive one by one; the box looks when the first text line of several and when the last byte
/// has arrived. An answer is delivered as a whole when its last byte is due, because half of it is of no use and every
/// delivery wakes a process.
#[derive(Debug)]
pub struct Wire {
    jack: PtyLink,
    byte_ns: u64,
    to_units: WireQueue,
    /// Time of arrival of the last byte to the units, ns.
    to_units_done_ns: u64,
    /// Time of arrival of the first end of a text line among several, ns: a unit answers it while the others arrive.
    first_line_ns: Option<u64>,
    /// An end of a line was among the bytes since the wire was empty.
    has_line: bool,
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
            first_line_ns: None,
            has_line: false,
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
            let begin_ns = self.to_units_done_ns.max(now_ns);
            self.has_line &= !self.to_units.is_empty();
            if !self.has_line
                && let Some(end) = buffer[..n].iter().position(|byte| matches!(byte, b'\r' | b'\n'))
            {
                self.has_line = true;
                self.first_line_ns = Some(begin_ns + (end as u64 + 1) * self.byte_ns);
            }
            self.to_units.push(now_ns, &buffer[..n]);
            self.to_units_done_ns = begin_ns + n as u64 * self.byte_ns;
            if n < buffer.len() {
                return Ok(());
            }
        }
    }

    /// Takes the next byte that has reached the units by `now_ns`, with its time of arrival.
    pub fn next_for_units(&mut self, now_ns: u64) -> Option<(u64, u8)> {
        let arrived = self.to_units.pop(now_ns);
        self.first_line_ns = self.first_line_ns.filter(|line_ns| arrived.is_none_or(|(at_ns, _)| at_ns < *line_ns));
        arrived
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
        let to_units = (!self.to_units.is_empty()).then(|| self.first_line_ns.unwrap_or(self.to_units_done_ns));
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
        self.first_line_ns = None;
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

#[cfg(test)]
mod tests {
    use super::*;
    use serial::{Port, Transport};
    use std::sync::Arc;

    #[test]
    fn the_first_of_several_lines_arrives_before_the_others() {
        let link = std::env::temp_dir().join(format!("nims-wire-{}", std::process::id()));
        // 10 us for each byte.
        let mut wire = Wire::new(&link, 1_000_000, 0).unwrap();
        let mut port = Port::open(&Arc::from(link.to_string_lossy()), 115_200).unwrap();
        let mut ask = |wire: &mut Wire, now_ns: u64, question: &[u8]| {
            port.write_all(question, u64::MAX).unwrap();
            // The kernel passes the bytes on when it has a processor.
            while wire.next_ns().is_none() {
                std::thread::yield_now();
                wire.take_in(now_ns).unwrap();
            }
        };
        let arrived = |wire: &mut Wire, now_ns| std::iter::from_fn(|| wire.next_for_units(now_ns)).count();
        ask(&mut wire, 1_000, b"r a\nr bc\nr d\n");
        assert_eq!(wire.next_ns(), Some(41_000));
        assert_eq!(arrived(&mut wire, 41_000), 4);
        assert_eq!(wire.next_ns(), Some(131_000));
        assert_eq!((arrived(&mut wire, 131_000), wire.next_ns()), (9, None));
        // A packet is whole with its last byte.
        ask(&mut wire, 200_000, &[0x80, 0x23, 0x01]);
        assert_eq!(wire.next_ns(), Some(230_000));
    }
}
