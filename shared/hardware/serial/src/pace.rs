//! Bytes on a wire: each takes ten bit times.

use std::collections::VecDeque;

/// Bits per byte: start bit, eight data bits, stop bit.
const BITS_PER_BYTE: u64 = 10;

/// Time that one byte takes on a wire of `baud` bits per second, ns. 0 baud: a wire without a baud rate (USB).
#[must_use]
pub fn byte_time_ns(baud: u32) -> u64 {
    if baud == 0 { 0 } else { (BITS_PER_BYTE * 1_000_000_000).div_ceil(u64::from(baud)) }
}

/// One direction of a wire: bytes that were sent and not taken yet.
#[derive(Debug, Clone)]
pub struct WireQueue {
    byte_ns: u64,
    /// Time at which the wire is free for the next byte, ns.
    free_ns: u64,
    /// Arrival times never decrease, so the front arrives first.
    on_the_way: VecDeque<(u64, u8)>,
}

impl WireQueue {
    /// An empty wire of `baud` bits per second (0: no baud rate).
    #[must_use]
    pub fn new(baud: u32) -> WireQueue {
        // 512 bytes is more than any exchange of the protocols here, so that a wire in use does not allocate.
        WireQueue { byte_ns: byte_time_ns(baud), free_ns: 0, on_the_way: VecDeque::with_capacity(512) }
    }

    /// Sends `bytes` from `start_ns`, or as soon as the wire is free after that.
    pub fn push(&mut self, start_ns: u64, bytes: &[u8]) {
        self.free_ns = self.free_ns.max(start_ns);
        for &byte in bytes {
            self.free_ns += self.byte_ns;
            self.on_the_way.push_back((self.free_ns, byte));
        }
    }

    /// Takes the next byte that has arrived by `now_ns`, with its time of arrival.
    pub fn pop(&mut self, now_ns: u64) -> Option<(u64, u8)> {
        if self.on_the_way.front()?.0 <= now_ns { self.on_the_way.pop_front() } else { None }
    }

    /// Time of arrival of the next byte, ns.
    #[must_use]
    pub fn next_ns(&self) -> Option<u64> {
        self.on_the_way.front().map(|&(at_ns, _)| at_ns)
    }

    /// Number of bytes that have arrived by `now_ns`.
    #[must_use]
    pub fn arrived(&self, now_ns: u64) -> usize {
        self.on_the_way.partition_point(|&(at_ns, _)| at_ns <= now_ns)
    }

    /// Number of bytes in transit or arrived.
    #[must_use]
    pub fn len(&self) -> usize {
        self.on_the_way.len()
    }

    /// True if no byte is in transit or arrived.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.on_the_way.is_empty()
    }

    /// Discards bytes that have arrived by `now_ns`.
    pub fn discard_arrived(&mut self, now_ns: u64) {
        while self.pop(now_ns).is_some() {}
    }

    /// Discards all bytes; the wire is free at once.
    pub fn clear(&mut self) {
        self.on_the_way.clear();
        self.free_ns = 0;
    }
}
