//! Subframes: writes, questions and answers about registers.

use arrayvec::ArrayVec;

/// Most bytes of a CAN-FD frame.
pub const MAX_FRAME: usize = 64;

/// A subframe that does nothing, and fills frames up.
const NOTHING: u8 = 0x50;
/// Kinds of subframes, in the high four bits.
const WRITE: u8 = 0x00;
const READ: u8 = 0x10;
const REPLY: u8 = 0x20;
/// Subframes that report an error of a register.
const WRITE_ERROR: u8 = 0x30;
const READ_ERROR: u8 = 0x31;

/// Type in which a register is written or answered.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Resolution {
    /// One byte.
    I8,
    /// Two bytes.
    I16,
    /// Four bytes.
    I32,
    /// A float of four bytes.
    F32,
}

/// Content of a register as it is on the wire.
#[derive(Debug, Clone, Copy, PartialEq)]
#[allow(missing_docs)] // as `Resolution`
pub enum Value {
    I8(i8),
    I16(i16),
    I32(i32),
    F32(f32),
}

/// One register of a subframe.
#[derive(Debug, Clone, Copy, PartialEq)]
#[allow(missing_docs)] // number of the register, value, code of the error
pub enum Subframe {
    /// Writes a register.
    Write { register: u16, value: Value },
    /// Asks for a register.
    Read { register: u16, resolution: Resolution },
    /// Answers with a register.
    Reply { register: u16, value: Value },
    /// A register that cannot be written or read so.
    Error { register: u16, code: u16 },
}

/// Bytes of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Frame {
    bytes: [u8; MAX_FRAME],
    len: usize,
}

impl Resolution {
    const fn code(self) -> u8 {
        (self as u8) << 2
    }

    fn from_code(head: u8) -> Resolution {
        [Resolution::I8, Resolution::I16, Resolution::I32, Resolution::F32][usize::from((head >> 2) & 3)]
    }
}

impl Value {
    /// Its type.
    #[must_use]
    pub fn resolution(self) -> Resolution {
        match self {
            Value::I8(_) => Resolution::I8,
            Value::I16(_) => Resolution::I16,
            Value::I32(_) => Resolution::I32,
            Value::F32(_) => Resolution::F32,
        }
    }

    /// An integer; `None` for a float, and for the smallest integer, which stands for "not a number".
    #[must_use]
    pub fn integer(self) -> Option<i32> {
        match self {
            Value::I8(value) => (value != i8::MIN).then_some(i32::from(value)),
            Value::I16(value) => (value != i16::MIN).then_some(i32::from(value)),
            Value::I32(value) => (value != i32::MIN).then_some(value),
            Value::F32(_) => None,
        }
    }
}

impl Frame {
    /// An empty frame.
    #[must_use]
    pub const fn new() -> Frame {
        Frame { bytes: [NOTHING; MAX_FRAME], len: 0 }
    }

    /// The bytes.
    #[must_use]
    pub fn as_slice(&self) -> &[u8] {
        self.bytes.get(..self.len).unwrap_or_default()
    }

    /// Appends a byte. Bytes beyond [`MAX_FRAME`] are dropped; no frame of this crate is that long.
    pub(crate) fn push(&mut self, byte: u8) {
        if let Some(slot) = self.bytes.get_mut(self.len) {
            *slot = byte;
            self.len += 1;
        }
    }

    /// Appends a subframe that does nothing.
    pub(crate) fn nothing(&mut self) {
        self.push(NOTHING);
    }

    /// Appends a subframe that writes a register.
    pub fn write(&mut self, register: u16, value: Value) {
        self.put(WRITE | value.resolution().code() | 1, register);
        self.put_value(value);
    }

    /// Appends a subframe that asks for a register.
    pub fn read(&mut self, register: u16, resolution: Resolution) {
        self.put(READ | resolution.code() | 1, register);
    }

    /// Appends a subframe that answers with a register.
    pub fn reply(&mut self, register: u16, value: Value) {
        self.put(REPLY | value.resolution().code() | 1, register);
        self.put_value(value);
    }

    /// Appends a subframe that reports a register which cannot be read.
    pub fn read_error(&mut self, register: u16, code: u16) {
        self.put(READ_ERROR, register);
        self.put_number(code);
    }

    /// Appends a subframe that reports a register which cannot be written.
    pub fn write_error(&mut self, register: u16, code: u16) {
        self.put(WRITE_ERROR, register);
        self.put_number(code);
    }

    fn put(&mut self, head: u8, register: u16) {
        self.push(head);
        self.put_number(register);
    }

    /// A number in groups of seven bits, the lowest first; the high bit announces another group.
    fn put_number(&mut self, mut number: u16) {
        while number > 0x7F {
            self.push(number as u8 | 0x80);
            number >>= 7;
        }
        self.push(number as u8);
    }

    fn put_value(&mut self, value: Value) {
        let mut put = |bytes: &[u8]| bytes.iter().for_each(|&byte| self.push(byte));
        match value {
            Value::I8(value) => put(&value.to_le_bytes()),
            Value::I16(value) => put(&value.to_le_bytes()),
            Value::I32(value) => put(&value.to_le_bytes()),
            Value::F32(value) => put(&value.to_le_bytes()),
        }
    }

    /// Its subframes, register by register.
    #[must_use]
    pub fn subframes(&self) -> Subframes<'_> {
        Subframes { rest: self.as_slice(), group: None }
    }
}

impl Default for Frame {
    fn default() -> Frame {
        Frame::new()
    }
}

/// Registers of one subframe that are not returned yet.
#[derive(Debug, Clone, Copy)]
struct Group {
    head: u8,
    register: u16,
    left: u16,
}

/// Registers of a frame, one after the other; `Err` where the frame is none of the protocol, and then the end.
#[derive(Debug, Clone)]
pub struct Subframes<'a> {
    rest: &'a [u8],
    group: Option<Group>,
}

/// The rest of the frame is none of the protocol, or a kind that this crate does not read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Malformed;

impl Subframes<'_> {
    fn byte(&mut self) -> Option<u8> {
        let (&byte, rest) = self.rest.split_first()?;
        self.rest = rest;
        Some(byte)
    }

    fn array<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (bytes, rest) = self.rest.split_first_chunk()?;
        self.rest = rest;
        Some(*bytes)
    }

    fn number(&mut self) -> Option<u16> {
        let mut groups = ArrayVec::<u8, 3>::new();
        loop {
            let byte = self.byte()?;
            groups.try_push(byte & 0x7F).ok()?;
            if byte & 0x80 == 0 {
                break;
            }
        }
        let number = groups.iter().rev().fold(0_u32, |number, &group| (number << 7) | u32::from(group));
        u16::try_from(number).ok()
    }

    fn value(&mut self, resolution: Resolution) -> Option<Value> {
        Some(match resolution {
            Resolution::I8 => Value::I8(i8::from_le_bytes(self.array()?)),
            Resolution::I16 => Value::I16(i16::from_le_bytes(self.array()?)),
            Resolution::I32 => Value::I32(i32::from_le_bytes(self.array()?)),
            Resolution::F32 => Value::F32(f32::from_le_bytes(self.array()?)),
        })
    }

    /// The next register of the group; `None` where the frame is malformed.
    fn member(&mut self, group: Group) -> Option<Subframe> {
        let resolution = Resolution::from_code(group.head);
        let register = group.register;
        let member = match group.head & 0xF0 {
            READ => Subframe::Read { register, resolution },
            WRITE => Subframe::Write { register, value: self.value(resolution)? },
            _ => Subframe::Reply { register, value: self.value(resolution)? },
        };
        let rest = Group { register: register.checked_add(1)?, left: group.left - 1, ..group };
        self.group = (rest.left > 0).then_some(rest);
        Some(member)
    }

    fn begin(&mut self, head: u8) -> Option<Subframe> {
        match head {
            WRITE_ERROR | READ_ERROR => Some(Subframe::Error { register: self.number()?, code: self.number()? }),
            _ if matches!(head & 0xF0, WRITE | READ | REPLY) => {
                let left = match head & 3 {
                    0 => self.number()?,
                    few => u16::from(few),
                };
                let register = self.number()?;
                // No frame has room for more registers, nor for their answer.
                if (1..=MAX_FRAME as u16).contains(&left) { self.member(Group { head, register, left }) } else { None }
            }
            _ => None,
        }
    }
}

impl Iterator for Subframes<'_> {
    type Item = Result<Subframe, Malformed>;

    fn next(&mut self) -> Option<Self::Item> {
        let found = match self.group.take() {
            Some(group) => self.member(group),
            None => {
                let head = loop {
                    match self.byte()? {
                        NOTHING => {}
                        head => break head,
                    }
                };
                self.begin(head)
            }
        };
        if found.is_none() {
            (self.rest, self.group) = (&[], None);
        }
        Some(found.ok_or(Malformed))
    }
}
