//! Bytes of a packet, on the stack.

/// Longest packet of the protocol that this crate uses: a version text of 48 bytes and its checksum.
pub const MAX_PACKET: usize = 64;

/// Bytes of one command or one answer. Bytes beyond [`MAX_PACKET`] are dropped; no packet of the protocol is that long.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct Packet {
    bytes: [u8; MAX_PACKET],
    len: usize,
}

impl Packet {
    /// An empty packet.
    #[must_use]
    pub const fn new() -> Packet {
        Packet { bytes: [0; MAX_PACKET], len: 0 }
    }

    /// Appends bytes.
    pub fn extend(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            if let Some(slot) = self.bytes.get_mut(self.len) {
                *slot = byte;
                self.len += 1;
            }
        }
    }

    /// The bytes as a slice.
    #[must_use]
    pub fn as_slice(&self) -> &[u8] {
        self.bytes.get(..self.len).unwrap_or_default()
    }
}

impl Default for Packet {
    fn default() -> Packet {
        Packet::new()
    }
}

impl std::ops::Deref for Packet {
    type Target = [u8];

    fn deref(&self) -> &[u8] {
        self.as_slice()
    }
}

impl std::fmt::Debug for Packet {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        for (index, byte) in self.as_slice().iter().enumerate() {
            write!(f, "{}{byte:02x}", if index == 0 { "" } else { " " })?;
        }
        Ok(())
    }
}
