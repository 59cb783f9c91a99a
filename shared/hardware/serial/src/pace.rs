//! Bytes on a wire: each takes ten bit times, one after the other.

use std::collections::VecDeque;

/// Start bit, eight data bits, stop bit.
const BITS_PER_BYTE: u64 = 10;

/// Time one byte takes on a wire of `baud` bits per second, ns. 0 baud stands for a wire without a speed of its own (USB).
#[must_use]
pub fn byte_time_ns(baud: u32) -> u64 {
    if baud == 0 { 0 } else { (BITS_PER_BYTE * 1_000_000_000).div_ceil(u64::from(baud)) }
}

/// One direction of a wire: bytes that were sent and have not arrived yet.
#[derive(Debug, Clone)]
pub struct Paced {
    byte_ns: u64,
    /// When the wire is free for the next byte.
    free_ns: u64,
    /// Arrival times never go back, so the front arrives first.
    on_the_way: VecDeque<(u64, u8)>,
}

impl Paced {
    /// An empty wire of `baud` bits per second (0: no speed of its own).
    #[must_use]
    pub fn new(baud: u32) -> Paced {
        // 512 bytes is more than any exchange of the protocols here, so that a wire in use does not allocate.
        Paced { byte_ns: byte_time_ns(baud), free_ns: 0, on_the_way: VecDeque::with_capacity(512) }
    }

    /// Begin to send `bytes` at `start_ns`, or as soon as the wire is free after that.
    pub fn push(&mut self, start_ns: u64, bytes: &[u8]) {
        self.free_ns = self.free_ns.max(start_ns);
        for &byte in bytes {
            self.free_ns += self.byte_ns;
            self.on_the_way.push_back((self.free_ns, byte));
        }
    }

    /// The next byte that has arrived by `now_ns`, with its time of arrival.
    pub fn pop(&mut self, now_ns: u64) -> Option<(u64, u8)> {
        if self.on_the_way.front()?.0 <= now_ns { self.on_the_way.pop_front() } else { None }
    }

    /// When the next byte arrives, ns.
    #[must_use]
    pub fn next_ns(&self) -> Option<u64> {
        self.on_the_way.front().map(|&(at_ns, _)| at_ns)
    }

    /// Bytes that have arrived by `now_ns`.
    #[must_use]
    pub fn arrived(&self, now_ns: u64) -> usize {
        self.on_the_way.partition_point(|&(at_ns, _)| at_ns <= now_ns)
    }

    /// Bytes on the way or arrived, not yet taken.
    #[must_use]
    pub fn len(&self) -> usize {
        self.on_the_way.len()
    }

    /// True where nothing is on the way.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.on_the_way.is_empty()
    }

    /// Lose what has arrived by `now_ns` and was not taken.
    pub fn discard_arrived(&mut self, now_ns: u64) {
        while self.pop(now_ns).is_some() {}
    }

    /// Lose everything; the wire is free at once.
    pub fn clear(&mut self) {
        self.on_the_way.clear();
        self.free_ns = 0;
    }
}
