//! Several units on one bus.

use serial::{Device, WireQueue};

use super::answer::{Form, form};
use super::{Measured, Unit};
use crate::codec::{ADDRESSES, BYTE_GAP_NS};
use crate::crc::crc16;
use crate::packet::{MAX_PACKET, Packet};

/// Units that receive the same bytes and answer on the same wire.
#[derive(Debug, Clone)]
pub struct UnitBus {
    units: Vec<Unit>,
    parser: Parser,
    /// Number of packets with a wrong checksum.
    refused: u64,
}

/// Assembles packets from bytes.
#[derive(Debug, Clone)]
struct Parser {
    bytes: [u8; MAX_PACKET],
    len: usize,
    last_ns: u64,
    /// In an unknown command, whose end only a pause shows.
    lost: bool,
}

/// A complete packet.
struct Received {
    address: u8,
    code: u8,
    payload: Packet,
}

enum Progress {
    Incomplete,
    Refused,
    Whole(Received),
}

impl Parser {
    fn push(&mut self, now_ns: u64, byte: u8) -> Progress {
        if now_ns.saturating_sub(self.last_ns) > BYTE_GAP_NS {
            self.len = 0;
            self.lost = false;
        }
        self.last_ns = now_ns;
        if self.lost || (self.len == 0 && !ADDRESSES.contains(&byte)) {
            return Progress::Incomplete;
        }
        self.bytes[self.len] = byte;
        self.len += 1;
        let packet = &self.bytes[..self.len];
        let &[address, code, ref rest @ ..] = packet else { return Progress::Incomplete };
        let wanted = match form(code) {
            None => {
                self.lost = true;
                self.len = 0;
                return Progress::Incomplete;
            }
            Some(Form::Question) => 0,
            Some(Form::Order(payload)) => payload + 2,
        };
        if rest.len() < wanted {
            return Progress::Incomplete;
        }
        self.len = 0;
        // A question has no checksum.
        if wanted > 0 && crc16(packet) != 0 {
            return Progress::Refused;
        }
        let mut payload = Packet::new();
        payload.extend(&rest[..wanted.saturating_sub(2)]);
        Progress::Whole(Received { address, code, payload })
    }
}

impl UnitBus {
    /// A bus with these units.
    #[must_use]
    pub fn new(units: Vec<Unit>) -> UnitBus {
        UnitBus { units, parser: Parser { bytes: [0; MAX_PACKET], len: 0, last_ns: 0, lost: false }, refused: 0 }
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

    /// Number of packets that were not answered because of a wrong checksum.
    #[must_use]
    pub fn refused(&self) -> u64 {
        self.refused
    }
}

impl Device for UnitBus {
    /// Receives a byte; puts the answer onto the wire when a packet is complete.
    fn receive(&mut self, now_ns: u64, byte: u8, reply: &mut WireQueue) {
        self.advance(now_ns);
        match self.parser.push(now_ns, byte) {
            Progress::Incomplete => {}
            Progress::Refused => self.refused += 1,
            Progress::Whole(packet) => {
                for unit in &mut self.units {
                    if unit.address() == packet.address {
                        if let Some((answer, after_ns)) = unit.handle(packet.code, &packet.payload) {
                            reply.push(now_ns + after_ns, &answer);
                        }
                    } else {
                        unit.overhear();
                    }
                }
            }
        }
    }

    /// Advances every unit to `now_ns`.
    fn advance(&mut self, now_ns: u64) {
        for unit in &mut self.units {
            unit.advance(now_ns);
        }
    }
}
