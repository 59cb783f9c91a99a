//! A Modbus RTU slave with its values in registers: functions 3 (holding) and 4 (input), both with the same content.
//!
//! Written from the specification (Modbus application protocol 1.1b3, serial line 1.02), independently of the driver
//! that reads it.

/// Most registers of one request.
const MOST: u16 = 125;
/// Bytes of a request for registers.
const QUESTION: usize = 8;
/// Silence that ends a frame, ns: three and a half bytes at 9600 baud, 4 ms.
const SILENCE_NS: u64 = 4_000_000;

const ILLEGAL_FUNCTION: u8 = 1;
const ILLEGAL_ADDRESS: u8 = 2;
const ILLEGAL_VALUE: u8 = 3;

#[derive(Debug)]
pub struct Slave {
    unit_id: u8,
    first: u16,
    registers: Vec<u16>,
    received: Vec<u8>,
    last_ns: u64,
    answer: Vec<u8>,
}

impl Slave {
    pub fn new(unit_id: u8, first: u16) -> Self {
        let (registers, received, answer) = (Vec::new(), Vec::new(), Vec::new());
        Self { unit_id, first, registers, received, last_ns: 0, answer }
    }

    /// Sets each value as a float32 in two registers, the high word first.
    pub fn store(&mut self, values: &[f64]) {
        self.registers.clear();
        for value in values {
            let bits = (*value as f32).to_bits();
            self.registers.extend([(bits >> 16) as u16, bits as u16]);
        }
    }

    /// Receives a byte; returns the answer at the end of a request.
    pub fn receive(&mut self, at_ns: u64, byte: u8) -> &[u8] {
        if at_ns > self.last_ns + SILENCE_NS {
            self.received.clear();
        }
        self.last_ns = at_ns;
        self.received.push(byte);
        self.answer.clear();
        // Requests of other lengths are for functions that it does not have, and end by silence.
        if self.received.len() == QUESTION {
            let question = std::mem::take(&mut self.received);
            self.answer_to(&question);
        }
        &self.answer
    }

    fn answer_to(&mut self, question: &[u8]) {
        let [unit_id, function, a, b, c, d, low, high] = *question else { return };
        if unit_id != self.unit_id || crc(&question[..6]) != u16::from_le_bytes([low, high]) {
            return;
        }
        let (register, count) = (u16::from_be_bytes([a, b]), u16::from_be_bytes([c, d]));
        self.answer.push(unit_id);
        match self.read(function, register, count) {
            Ok(words) => {
                self.answer.extend([function, 2 * count as u8]);
                self.answer.extend(words.into_iter().flat_map(u16::to_be_bytes));
            }
            Err(exception) => self.answer.extend([function | 0x80, exception]),
        }
        self.answer.extend(crc(&self.answer).to_le_bytes());
    }

    fn read(&self, function: u8, register: u16, count: u16) -> Result<Vec<u16>, u8> {
        if function != 3 && function != 4 {
            return Err(ILLEGAL_FUNCTION);
        }
        if !(1..=MOST).contains(&count) {
            return Err(ILLEGAL_VALUE);
        }
        let from = register.checked_sub(self.first).map(usize::from).ok_or(ILLEGAL_ADDRESS)?;
        let words = self.registers.get(from..from + usize::from(count)).ok_or(ILLEGAL_ADDRESS)?;
        Ok(words.to_vec())
    }
}

/// CRC-16 of Modbus: polynomial 0xA001 (reflected), initial value 0xFFFF.
fn crc(bytes: &[u8]) -> u16 {
    bytes.iter().fold(0xFFFF, |crc, byte| {
        (0..8).fold(crc ^ u16::from(*byte), |crc, _| if crc & 1 == 1 { (crc >> 1) ^ 0xA001 } else { crc >> 1 })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ask(slave: &mut Slave, question: &[u8], at_ns: u64) -> Vec<u8> {
        question.iter().flat_map(|byte| slave.receive(at_ns, *byte).to_vec()).collect()
    }

    #[test]
    fn it_answers_as_the_specification_says() {
        // A widely published request: one register from 0 of slave 1.
        assert_eq!(crc(&[0x01, 0x03, 0x00, 0x00, 0x00, 0x01]).to_le_bytes(), [0x84, 0x0A]);
        let mut slave = Slave::new(1, 0);
        slave.store(&[1.5]);
        let question = [0x01, 0x03, 0x00, 0x00, 0x00, 0x01, 0x84, 0x0A];
        let answer = ask(&mut slave, &question, 10_000_000);
        assert_eq!(answer[..5], [0x01, 0x03, 0x02, 0x3F, 0xC0]);
        assert_eq!(crc(&answer), 0, "a frame with its checksum leaves nothing");
        // A request that was cut off does not affect the next one.
        assert!(ask(&mut slave, &question[..5], 20_000_000).is_empty());
        assert_eq!(ask(&mut slave, &question, 30_000_000), answer);
        // A request for another unit, and one for registers that it does not have.
        let mut other = [0x02, 0x03, 0x00, 0x00, 0x00, 0x01, 0, 0];
        let sum = crc(&other[..6]).to_le_bytes();
        other[6..].copy_from_slice(&sum);
        assert!(ask(&mut slave, &other, 40_000_000).is_empty());
        let mut beyond = [0x01, 0x04, 0x00, 0x01, 0x00, 0x02, 0, 0];
        let sum = crc(&beyond[..6]).to_le_bytes();
        beyond[6..].copy_from_slice(&sum);
        assert_eq!(ask(&mut slave, &beyond, 50_000_000)[..3], [0x01, 0x84, ILLEGAL_ADDRESS]);
    }
}
