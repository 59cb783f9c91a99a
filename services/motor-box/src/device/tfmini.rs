//! Benewake TFmini, TFmini Plus and TF-Luna in their standard output (product manual, "standard 9 bytes"): `59 59
//! distance(2) strength(2) temperature(2) checksum`, little-endian, the checksum being the low byte of the sum of the
//! rest.

/// Range, m.
const FARTHEST_M: f64 = 12.0;
/// Distance and strength that it sends beyond its range.
const NOTHING: (u16, u16) = (0xFFFF, 20);
/// Strength of a good echo.
const STRENGTH: u16 = 1200;
/// 31 degrees Celsius, in eighths of a degree above -256.
const TEMPERATURE: u16 = (31 + 256) * 8;

#[derive(Debug)]
pub struct Tfmini {
    /// Width of its beam, rad.
    pub beam_rad: f64,
    /// Resolution, m.
    pub resolution_m: f64,
}

impl Tfmini {
    /// Frame for a distance, m.
    pub fn frame(&self, distance_m: f64) -> [u8; 9] {
        let (distance, strength) = if (0.0..=FARTHEST_M).contains(&distance_m) {
            ((distance_m / self.resolution_m).round() as u16, STRENGTH)
        } else {
            NOTHING
        };
        let mut frame = [0x59; 9];
        for (place, word) in frame[2..8].chunks_exact_mut(2).zip([distance, strength, TEMPERATURE]) {
            place.copy_from_slice(&word.to_le_bytes());
        }
        frame[8] = frame[..8].iter().fold(0, |sum: u8, byte| sum.wrapping_add(*byte));
        frame
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_frame_is_as_in_the_manual() {
        let centimetres = Tfmini { beam_rad: 0.0, resolution_m: 0.01 };
        // 2.56 m: 0x0100; strength 1200: 0x04b0; temperature 2296: 0x08f8
        assert_eq!(centimetres.frame(2.56), [0x59, 0x59, 0x00, 0x01, 0xB0, 0x04, 0xF8, 0x08, 0x67]);
        let millimetres = Tfmini { resolution_m: 0.001, ..centimetres };
        assert_eq!(millimetres.frame(2.56)[2..4], 2560_u16.to_le_bytes());
        assert_eq!(millimetres.frame(20.0)[2..4], [0xFF, 0xFF]);
    }
}
