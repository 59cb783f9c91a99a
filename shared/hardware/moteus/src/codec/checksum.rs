//! Checksum of a text line.

/// Polynomial of the checksum, from the maker's description of the UART.
const POLYNOMIAL: u8 = 0x97;

/// Remainders of four bits.
const TABLE: [u8; 16] = {
    let mut table = [0; 16];
    let mut index = 0;
    while index < 16 {
        // The nibble is the high half of the remainder.
        let mut rest = (index as u8) << 4;
        let mut bit = 0;
        while bit < 4 {
            rest = if rest & 0x80 != 0 { (rest << 1) ^ POLYNOMIAL } else { rest << 1 };
            bit += 1;
        }
        table[index] = rest;
        index += 1;
    }
    table
};

/// CRC-8 of the maker, beginning at 0.
#[must_use]
pub fn crc8(bytes: &[u8]) -> u8 {
    let step = |crc: u8, nibble: u8| TABLE[usize::from((crc >> 4) ^ nibble)] ^ (crc << 4);
    bytes.iter().fold(0, |crc, byte| step(step(crc, byte >> 4), byte & 0x0F))
}
