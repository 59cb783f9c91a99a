//! CRC-16/XMODEM: polynomial 0x1021, initial value 0, nothing reflected, sent high byte first.

const POLYNOMIAL: u16 = 0x1021;

const TABLE: [u16; 256] = table();

const fn table() -> [u16; 256] {
    let mut table = [0; 256];
    let mut index = 0;
    while index < 256 {
        let mut value = (index as u16) << 8;
        let mut bit = 0;
        while bit < 8 {
            value = if value & 0x8000 == 0 { value << 1 } else { (value << 1) ^ POLYNOMIAL };
            bit += 1;
        }
        table[index] = value;
        index += 1;
    }
    table
}

/// Running checksum. It is 0 after a message and its checksum.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Crc(u16);

impl Crc {
    /// Adds bytes.
    #[must_use]
    pub fn with(self, bytes: &[u8]) -> Crc {
        Crc(bytes.iter().fold(self.0, |crc, &byte| {
            let [high, low] = crc.to_be_bytes();
            u16::from_be_bytes([low, 0]) ^ TABLE[usize::from(high ^ byte)]
        }))
    }

    /// Checksum of the bytes added.
    #[must_use]
    pub fn value(self) -> u16 {
        self.0
    }
}

/// Checksum of `bytes`.
#[must_use]
pub fn crc16(bytes: &[u8]) -> u16 {
    Crc::default().with(bytes).value()
}
