//! Settings that a unit stores: those it acts on, and those it only returns.

use crate::codec::Pid;

/// Full duty on the wire.
pub(super) const FULL_DUTY: f64 = 32_767.0;

/// Settings that a unit acts on; it can store them over a power cut.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Settings {
    pub(super) watchdog_tenths: u8,
    pub(super) velocity_pids: [Pid; 2],
    pub(super) max_centiamps: [u32; 2],
}

impl Settings {
    pub(super) fn new(watchdog_tenths: u8) -> Settings {
        // A 2x15A unit: 30 A at most.
        Settings { watchdog_tenths, velocity_pids: [Pid::default(); 2], max_centiamps: [3000; 2] }
    }
}

/// A setting that a client writes and reads back: the payload of command `write` is the part from `offset` of the
/// answer to `read`, which has `block` bytes.
#[derive(Debug, Clone, Copy)]
pub(super) struct Stored {
    pub(super) write: u8,
    pub(super) read: u8,
    pub(super) offset: usize,
    pub(super) length: usize,
    pub(super) block: usize,
}

const fn stored(write: u8, read: u8, offset: usize, length: usize, block: usize) -> Stored {
    Stored { write, read, offset, length, block }
}

/// Settings the unit stores without acting on, by the command numbers of the manual and the vendor's client.
#[rustfmt::skip]
pub(super) const STORED: [Stored; 40] = [
    stored(57, 59, 0, 5, 5),    // main voltages: lowest, highest, automatic offset
    stored(58, 60, 0, 4, 4),    // logic voltages
    stored(61, 63, 0, 28, 28),  // position gains: written D P I .., read P I D ..
    stored(62, 64, 0, 28, 28),
    stored(68, 81, 0, 8, 16),   // default accelerations
    stored(69, 81, 8, 8, 16),
    stored(70, 72, 0, 2, 4),    // default speeds
    stored(71, 72, 2, 2, 4),
    stored(74, 75, 0, 5, 5),    // functions of the pins
    stored(76, 77, 0, 24, 24),  // control inputs
    stored(92, 91, 0, 1, 2),    // encoder modes
    stored(93, 91, 1, 1, 2),
    stored(96, 97, 0, 37, 37),  // serial number: length, text
    stored(98, 99, 0, 2, 2),    // configuration
    stored(102, 104, 0, 10, 10),// auxiliary duties
    stored(105, 107, 0, 4, 8),  // automatic homing
    stored(106, 107, 4, 4, 8),
    stored(109, 110, 0, 4, 4),  // limits of the speed error
    stored(112, 113, 0, 4, 4),  // limits of the position error
    stored(115, 116, 0, 2, 2),  // offsets
    stored(128, 130, 0, 8, 8),  // inductance and resistance
    stored(129, 131, 0, 8, 8),
    stored(139, 140, 0, 3, 3),  // priorities of the inputs
    stored(141, 142, 0, 2, 2),  // address and mixing
    stored(148, 149, 0, 2, 2),  // PWM mode
    stored(150, 151, 0, 1, 1),  // CAN node
    stored(160, 161, 0, 2, 2),  // PWM idle
    stored(201, 202, 0, 1, 1),  // lock of the emergency stop
    stored(246, 247, 0, 4, 4),  // script at power-on
    // read only: readings that this unit does not have
    stored(0, 103, 0, 0, 2),    // states of the encoders
    stored(0, 111, 0, 0, 4),    // speed errors
    stored(0, 114, 0, 0, 4),    // position errors
    stored(0, 180, 0, 0, 4),    // CAN error state
    stored(0, 138, 0, 0, 1),    // digital outputs: none
    stored(0, 144, 0, 0, 1),    // signals: none
    stored(0, 146, 0, 0, 1),    // streams: none
    stored(0, 147, 0, 0, 1),    // data of signals: none
    // no payload
    stored(95, 0, 0, 0, 0),     // settings from memory
    stored(200, 0, 0, 0, 0),    // reset of the emergency stop
    stored(249, 0, 0, 0, 0),    // stop of the script
];

/// Stored bytes.
#[derive(Debug, Clone)]
pub(super) struct Registers {
    bytes: Vec<u8>,
}

impl Registers {
    pub(super) fn new() -> Registers {
        let length = STORED.iter().map(|row| row.block).sum();
        let mut registers = Registers { bytes: vec![0; length] };
        // Lowest and highest supply of a 2x15A unit, 0.1 V.
        registers.write(57, &[0, 60, 1, 84, 0]);
        registers.write(58, &[0, 45, 0, 55]);
        registers
    }

    /// Start of the block of a question; rows of one question share the first one's block.
    fn block(&self, read: u8) -> Option<(usize, usize)> {
        let first = STORED.iter().position(|row| row.read == read && read != 0)?;
        Some((STORED[..first].iter().map(|row| row.block).sum(), STORED[first].block))
    }

    /// Length of the payload of a command that stores a setting.
    pub(super) fn payload_of(write: u8) -> Option<usize> {
        STORED.iter().find(|row| row.write == write && write != 0).map(|row| row.length)
    }

    /// True for a question about a stored setting.
    pub(super) fn answers(read: u8) -> bool {
        read != 0 && STORED.iter().any(|row| row.read == read)
    }

    pub(super) fn write(&mut self, write: u8, payload: &[u8]) -> bool {
        let Some(row) = STORED.iter().find(|row| row.write == write && write != 0) else { return false };
        if payload.len() != row.length {
            return false;
        }
        let Some((start, _)) = self.block(row.read) else { return row.length == 0 };
        if let Some(place) = self.bytes.get_mut(start + row.offset..start + row.offset + row.length) {
            place.copy_from_slice(payload);
            if matches!(write, 61 | 62) {
                // D P I becomes P I D.
                place[..12].rotate_left(4);
            }
        }
        true
    }

    pub(super) fn read(&self, read: u8) -> Option<&[u8]> {
        let (start, length) = self.block(read)?;
        self.bytes.get(start..start + length)
    }
}
