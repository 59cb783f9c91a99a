//! Registers of a Modbus RTU device. The crate `rmodbus` generates requests, checks checksums and decodes responses;
//! this module finds the start and end of a response and skips other bytes.

use messages::Reading;
use rmodbus::client::ModbusRequest;
use rmodbus::{ErrorKind, ModbusProto};

use crate::settings::{ModbusSection, NumberKind, RegisterTable, ValueSection};
use crate::{Frame, Protocol, VALUES};

/// Bytes of the header of a response: unit, function, and number of data bytes or exception code.
const HEAD: usize = 3;
/// Bytes of the checksum after the data.
const CHECKSUM: usize = 2;
/// Bit in the function code of an exception response.
const EXCEPTION: u8 = 0x80;

/// Decoder of registers.
#[derive(Debug)]
pub struct Modbus {
    request: ModbusRequest,
    /// The bytes of the request.
    request_bytes: Vec<u8>,
    values: Vec<ValueSection>,
    first: u16,
    count: u16,
    received: Vec<u8>,
    /// Whether a request awaits its response.
    pending: bool,
}

impl Modbus {
    /// Creates a decoder for these registers.
    ///
    /// # Errors
    /// The request cannot be generated.
    pub fn new(section: &ModbusSection, values: &[ValueSection]) -> Result<Self, ErrorKind> {
        let of = |value: &ValueSection| (value.register.unwrap_or(0), value.number.registers());
        let first = values.iter().map(|value| of(value).0).min().unwrap_or(0);
        let end = values.iter().map(|value| u32::from(of(value).0) + u32::from(of(value).1)).max().unwrap_or(1);
        let count = end.saturating_sub(u32::from(first)).min(u32::from(u16::MAX)) as u16;
        let mut request = ModbusRequest::new(section.unit_id, ModbusProto::Rtu);
        let (mut request_bytes, received) = (Vec::new(), Vec::with_capacity(260));
        match section.table {
            RegisterTable::Holding => request.generate_get_holdings(first, count, &mut request_bytes)?,
            RegisterTable::Input => request.generate_get_inputs(first, count, &mut request_bytes)?,
        }
        Ok(Self { request, request_bytes, values: values.to_vec(), first, count, received, pending: false })
    }

    /// Returns the length of the response whose start the received bytes may be; `None` if they are no start of a
    /// response.
    fn length(&self) -> Option<usize> {
        let (unit, function) = (self.request.unit_id, self.request.func.byte());
        let data = 2 * usize::from(self.count);
        match self.received.as_slice() {
            [] => Some(HEAD),
            [u] => (*u == unit).then_some(HEAD),
            [u, f] => (*u == unit && f & !EXCEPTION == function).then_some(HEAD),
            [u, f, _, ..] if *u == unit && *f == function | EXCEPTION => Some(HEAD + CHECKSUM),
            [u, f, bytes, ..] => {
                (*u == unit && *f == function && usize::from(*bytes) == data).then_some(HEAD + data + CHECKSUM)
            }
        }
    }

    /// Decodes the received bytes; fails if they are no response.
    fn decode(&self) -> Result<Frame, ErrorKind> {
        let mut words: Vec<u16> = Vec::with_capacity(usize::from(self.count));
        match self.request.parse_u16(&self.received, &mut words) {
            Ok(()) => {}
            Err(error @ (ErrorKind::FrameCRCError | ErrorKind::FrameBroken)) => return Err(error),
            // An exception response: the device has no such register.
            Err(_) => return Ok(Frame::Bad),
        }
        let mut values = [0.0; VALUES];
        let mut quality = Reading::QUALITY_GOOD;
        for (place, section) in values.iter_mut().zip(&self.values) {
            let from = usize::from(section.register.unwrap_or(0).saturating_sub(self.first));
            let Some(number) = section.number.read(words.get(from..).unwrap_or_default(), section.swapped) else {
                return Ok(Frame::Bad);
            };
            *place = number * section.scale + section.offset;
            if !place.is_finite() {
                (*place, quality) = (f64::NAN, Reading::QUALITY_INVALID);
            }
        }
        Ok(Frame::Values(values, quality))
    }
}

impl Protocol for Modbus {
    fn reset(&mut self) {
        self.received.clear();
        self.pending = false;
    }

    fn request(&mut self) -> Option<(&[u8], bool)> {
        self.received.clear();
        let unanswered = std::mem::replace(&mut self.pending, true);
        Some((&self.request_bytes, unanswered))
    }

    fn push(&mut self, byte: u8) -> Option<Frame> {
        // Without a request, bytes are noise or a late response.
        if !self.pending {
            return None;
        }
        self.received.push(byte);
        while !self.received.is_empty() {
            match self.length() {
                Some(length) if self.received.len() < length => return None,
                Some(_) => {
                    if let Ok(frame) = self.decode() {
                        self.reset();
                        return Some(frame);
                    }
                }
                None => {}
            }
            self.received.remove(0);
        }
        None
    }
}

impl NumberKind {
    /// Decodes a number from its registers, high word first unless `swapped`.
    fn read(self, words: &[u16], swapped: bool) -> Option<f64> {
        let double = || {
            let [a, b, ..] = *words else { return None };
            let (high, low) = if swapped { (b, a) } else { (a, b) };
            Some(u32::from(high) << 16 | u32::from(low))
        };
        Some(match self {
            Self::U16 => f64::from(*words.first()?),
            Self::I16 => f64::from(words.first()?.cast_signed()),
            Self::U32 => f64::from(double()?),
            Self::I32 => f64::from(double()?.cast_signed()),
            Self::F32 => f64::from(f32::from_bits(double()?)),
        })
    }
}
