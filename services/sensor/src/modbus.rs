//! Registers of a Modbus RTU device. Questions, checksums and decoding are the crate `rmodbus`'s; where an answer begins and ends is found
//! here, so that what is not an answer is left out byte by byte.

use messages::Reading;
use rmodbus::client::ModbusRequest;
use rmodbus::{ErrorKind, ModbusProto};

use crate::settings::{ModbusSection, NumberKind, RegisterTable, ValueSection};
use crate::{Frame, Protocol, VALUES};

/// Unit, function, and the number of bytes or the reason of a refusal.
const HEAD: usize = 3;
/// Behind the data.
const CHECKSUM: usize = 2;
/// Set in the function of an answer that refuses.
const REFUSED: u8 = 0x80;

/// Values out of registers.
#[derive(Debug)]
pub struct Modbus {
    request: ModbusRequest,
    /// The question as it is sent.
    question: Vec<u8>,
    values: Vec<ValueSection>,
    first: u16,
    count: u16,
    received: Vec<u8>,
    asked: bool,
}

impl Modbus {
    /// For these registers.
    ///
    /// # Errors
    /// The question cannot be written.
    pub fn new(section: &ModbusSection, values: &[ValueSection]) -> Result<Self, ErrorKind> {
        let of = |value: &ValueSection| (value.register.unwrap_or(0), value.number.registers());
        let first = values.iter().map(|value| of(value).0).min().unwrap_or(0);
        let end = values.iter().map(|value| u32::from(of(value).0) + u32::from(of(value).1)).max().unwrap_or(1);
        let count = end.saturating_sub(u32::from(first)).min(u32::from(u16::MAX)) as u16;
        let mut request = ModbusRequest::new(section.unit_id, ModbusProto::Rtu);
        let (mut question, received) = (Vec::new(), Vec::with_capacity(260));
        match section.table {
            RegisterTable::Holding => request.generate_get_holdings(first, count, &mut question)?,
            RegisterTable::Input => request.generate_get_inputs(first, count, &mut question)?,
        }
        Ok(Self { request, question, values: values.to_vec(), first, count, received, asked: false })
    }

    /// How long the answer is that what has been received may be the beginning of; `None`: of none.
    fn length(&self) -> Option<usize> {
        let (unit, function) = (self.request.unit_id, self.request.func.byte());
        let data = 2 * usize::from(self.count);
        match self.received.as_slice() {
            [] => Some(HEAD),
            [u] => (*u == unit).then_some(HEAD),
            [u, f] => (*u == unit && f & !REFUSED == function).then_some(HEAD),
            [u, f, _, ..] if *u == unit && *f == function | REFUSED => Some(HEAD + CHECKSUM),
            [u, f, bytes, ..] => {
                (*u == unit && *f == function && usize::from(*bytes) == data).then_some(HEAD + data + CHECKSUM)
            }
        }
    }

    /// `Err` if it is no answer after all.
    fn answer(&self) -> Result<Frame, ErrorKind> {
        let mut words: Vec<u16> = Vec::with_capacity(usize::from(self.count));
        match self.request.parse_u16(&self.received, &mut words) {
            Ok(()) => {}
            Err(error @ (ErrorKind::FrameCRCError | ErrorKind::FrameBroken)) => return Err(error),
            // The device refuses: it is there, and has no such value.
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
        self.asked = false;
    }

    fn question(&mut self) -> Option<(&[u8], bool)> {
        self.received.clear();
        let unanswered = std::mem::replace(&mut self.asked, true);
        Some((&self.question, unanswered))
    }

    fn take(&mut self, byte: u8) -> Option<Frame> {
        // Nobody has asked: it is noise, or an answer that comes too late to be told from the next one.
        if !self.asked {
            return None;
        }
        self.received.push(byte);
        while !self.received.is_empty() {
            match self.length() {
                Some(length) if self.received.len() < length => return None,
                Some(_) => {
                    if let Ok(frame) = self.answer() {
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
    /// A number out of its registers, the high word first unless `swapped`.
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
