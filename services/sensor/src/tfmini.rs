//! Benewake TFmini, TFmini Plus and TF-Luna in their standard output (product manuals): nine bytes, `59 59 distance(2)
//! strength(2) temperature(2) checksum`, little-endian, the checksum being the low byte of the sum of the rest.

use messages::Reading;

use crate::{Frame, Protocol, VALUES};

const LENGTH: usize = 9;
const HEAD: u8 = 0x59;
/// Distances from this value on are error codes (TFmini Plus manual: -4 too bright, -2 saturated, -1 too weak).
const ERROR_CODES: u16 = 0xFFFC;
/// Signal strength below which a distance is not reliable (manuals, "signal strength").
const WEAK: u16 = 100;
/// Signal strength of a saturated receiver.
const SATURATED: u16 = 0xFFFF;

/// Decoder of rangefinder frames.
#[derive(Debug)]
pub struct Tfmini {
    resolution_m: f64,
    bytes: Vec<u8>,
    /// Bytes skipped since the last whole frame.
    skipped: usize,
}

impl Tfmini {
    /// Creates a decoder for a device whose distances are multiples of `resolution_m`.
    pub fn new(resolution_m: f64) -> Self {
        Self { resolution_m, bytes: Vec::with_capacity(LENGTH), skipped: 0 }
    }

    fn values(&self) -> Option<Frame> {
        let [HEAD, HEAD, d0, d1, s0, s1, _, _, sum] = *self.bytes else { return None };
        if self.bytes[..LENGTH - 1].iter().fold(0, |sum: u8, byte| sum.wrapping_add(*byte)) != sum {
            return None;
        }
        let (distance, strength) = (u16::from_le_bytes([d0, d1]), u16::from_le_bytes([s0, s1]));
        let mut values = [0.0; VALUES];
        values[1] = f64::from(strength);
        // TF-Luna sends 0 instead of an error code.
        if distance == 0 || distance >= ERROR_CODES {
            values[0] = f64::NAN;
            return Some(Frame::Values(values, Reading::QUALITY_INVALID));
        }
        values[0] = f64::from(distance) * self.resolution_m;
        let doubtful = strength < WEAK || strength == SATURATED;
        Some(Frame::Values(values, if doubtful { Reading::QUALITY_DOUBTFUL } else { Reading::QUALITY_GOOD }))
    }
}

impl Protocol for Tfmini {
    fn reset(&mut self) {
        self.bytes.clear();
        self.skipped = 0;
    }

    fn push(&mut self, byte: u8) -> Option<Frame> {
        self.bytes.push(byte);
        if self.bytes.len() < LENGTH {
            return None;
        }
        if let Some(frame) = self.values() {
            self.bytes.clear();
            self.skipped = 0;
            return Some(frame);
        }
        // Advance by one byte, because a frame may start inside the damaged bytes. After opening the port, less than a
        // frame may be skipped; then every skipped frame length is a bad frame.
        self.bytes.remove(0);
        self.skipped += 1;
        self.skipped.is_multiple_of(LENGTH).then_some(Frame::Bad)
    }
}
