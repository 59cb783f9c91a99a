//! Several units behind one adapter, or one on a UART.

use serial::{Device, WireQueue};

use super::{Measured, Unit};
use crate::codec::{Checksums, Frame, MAX_LINE, Text, bytes, frame_line, from_unit, number, padded, seal, unseal};

/// Units that receive the same lines and answer on the same wire.
#[derive(Debug, Clone)]
pub struct UnitBus {
    units: Vec<Unit>,
    /// Lines to the computer have checksums.
    checksums: Checksums,
    /// A line with a checksum was received: none without is accepted since.
    sealed: bool,
    line: Text,
    /// The present line is too long to be one.
    lost: bool,
    refused: u64,
}

/// Why a line was not executed, in the adapter's words; they are assumed beyond the first.
const WRONG_CHECKSUM: &[u8] = b"ERR checksum";
const UNKNOWN_COMMAND: &[u8] = b"ERR unknown command";

impl UnitBus {
    /// A bus with these units. On a UART ([`Checksums::Required`]) every answer has a checksum.
    #[must_use]
    pub fn new(units: Vec<Unit>, checksums: Checksums) -> UnitBus {
        UnitBus { units, checksums, sealed: false, line: Text::new(), lost: false, refused: 0 }
    }

    /// The units.
    #[must_use]
    pub fn units(&self) -> &[Unit] {
        &self.units
    }

    /// The units.
    pub fn units_mut(&mut self) -> &mut [Unit] {
        &mut self.units
    }

    /// Sets the sensor readings of a unit.
    pub fn measure(&mut self, unit: usize, measured: &Measured) {
        if let Some(unit) = self.units.get_mut(unit) {
            unit.measure(measured);
        }
    }

    /// Number of lines that were not executed.
    #[must_use]
    pub fn refused(&self) -> u64 {
        self.refused
    }

    fn say(&self, at_ns: u64, text: &[u8], reply: &mut WireQueue) {
        let mut line: Text = text.iter().copied().take(MAX_LINE - 8).collect();
        line = seal(line, self.checksums);
        reply.push(at_ns, &line);
        reply.push(at_ns, b"\r\n");
    }

    /// Executes a line.
    fn obey(&mut self, now_ns: u64, line: &[u8], reply: &mut WireQueue) {
        let turnaround_ns = self.units.first().map_or(0, |unit| unit.options.turnaround_ns);
        let said = match unseal(line) {
            Err(_) => Err(WRONG_CHECKSUM),
            Ok((_, false)) if self.sealed => Err(WRONG_CHECKSUM),
            Ok((body, sealed)) => {
                self.sealed |= sealed && self.checksums == Checksums::Required;
                parse(body).ok_or(UNKNOWN_COMMAND)
            }
        };
        match said {
            Err(words) => {
                self.refused += 1;
                self.say(now_ns + turnaround_ns, words, reply);
            }
            Ok(None) => self.say(now_ns + turnaround_ns, b"OK", reply),
            Ok(Some((identifier, frame))) => {
                self.say(now_ns + turnaround_ns, b"OK", reply);
                for index in 0..self.units.len() {
                    let unit = &mut self.units[index];
                    let (address, after_ns) = (unit.address(), unit.options.turnaround_ns);
                    if identifier & 0x7F != u16::from(address) && identifier & 0x7F != 0x7F {
                        continue;
                    }
                    if let Some(answer) = unit.handle(identifier, &frame) {
                        let host = identifier >> 8 & 0x7F;
                        let text = match self.checksums {
                            Checksums::Required => answer,
                            Checksums::Absent => padded(answer),
                        };
                        let from = u16::from(address) << 8 | host;
                        debug_assert!(host != 0 || from_unit(from) == Some(address));
                        let line = frame_line("rcv", from, &text, "E B F", self.checksums);
                        reply.push(now_ns + after_ns, &line);
                        reply.push(now_ns + after_ns, b"\r\n");
                    }
                }
            }
        }
    }
}

/// A line of the computer: a frame, or `can on` and the like, which change nothing here.
fn parse(body: &[u8]) -> Option<Option<(u16, Frame)>> {
    let mut words = body.split(|&byte| byte == b' ').filter(|word| !word.is_empty());
    match (words.next()?, words.next()?) {
        (b"can", b"send") => Some(Some((number(words.next()?)?, bytes(words.next()?)?))),
        (b"can", b"on" | b"off" | b"status") | (b"conf", _) => Some(None),
        _ => None,
    }
}

impl Device for UnitBus {
    /// Receives a byte; puts the answer onto the wire when a line is complete.
    fn receive(&mut self, now_ns: u64, byte: u8, reply: &mut WireQueue) {
        self.advance(now_ns);
        if !matches!(byte, b'\r' | b'\n') {
            self.lost |= self.line.try_push(byte).is_err();
            return;
        }
        let line = std::mem::take(&mut self.line);
        let lost = std::mem::take(&mut self.lost);
        // The second byte of a line's end ends an empty line, which is none.
        if lost {
            self.refused += 1;
            self.say(now_ns, UNKNOWN_COMMAND, reply);
        } else if !line.is_empty() {
            self.obey(now_ns, &line, reply);
        }
    }

    /// Advances every unit to `now_ns`.
    fn advance(&mut self, now_ns: u64) {
        for unit in &mut self.units {
            unit.advance(now_ns);
        }
    }
}
