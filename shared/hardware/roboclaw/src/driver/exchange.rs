//! One packet and its answer.

use std::sync::Arc;

use serial::Transport;

use super::step::{Late, Step};
use super::{Bus, Phase};
use drives::{Error, reply_text};

use crate::codec::{ACK, Command, Flaw, MAX_VERSION, Read, Reply, ReplyLength, Write};
use crate::packet::{MAX_PACKET, Packet};
use crate::status::StatusWidth;

/// Waking up this long after a deadline means that the whole machine was stopped, ns: the answer may wait in the
/// kernel, or the device, which was stopped as well, is about to send it.
const STOOD_STILL_NS: u64 = 5_000_000;
/// Extra wait in that case where the caller has other work, ns.
const GRACE_NS: u64 = 10_000_000;
/// Room for bytes after an answer, which answer nothing: that none arrived shows that the port is empty.
const SPARE: usize = 8;

impl<T: Transport> Bus<T> {
    /// Sends a command and waits for its acknowledgement. Any error leaves the bus out of step.
    pub(super) fn write(&mut self, unit: usize, write: Write) -> Result<(), Error> {
        let address = self.address(unit);
        let command = Command::Write(write);
        let sent_ns = self.send(unit, &write.encode(address), command)?;
        let mut ack = [0];
        let got = self.receive(unit, &mut ack, sent_ns, command)?;
        if got == 0 {
            return Err(self.no_answer(unit, command, sent_ns));
        }
        if ack != [ACK] {
            self.counters.wrong_acks += 1;
            self.out_of_step(unit);
            let said = reply_text(format_args!("{:#04x} instead of {ACK:#04x}", ack[0]));
            return Err(Error::Unexpected {
                port: self.port(),
                unit: self.unit_name(unit),
                asked: write.command_name(),
                said,
            });
        }
        self.learn_turnaround(sent_ns, write.encode(address).len() + 1);
        Ok(())
    }

    /// Asks a question; returns the answer and the time of the question. Any error leaves the bus out of step.
    pub(super) fn read(&mut self, unit: usize, read: Read) -> Result<(Reply, u64), Error> {
        let address = self.address(unit);
        let command = Command::Read(read);
        let sent_ns = self.send(unit, &read.encode(address), command)?;
        let mut buffer = [0; MAX_PACKET];
        let (got, wanted) = self.receive_answer(unit, read, &mut buffer, sent_ns)?;
        if got == 0 {
            return Err(self.no_answer(unit, command, sent_ns));
        }
        match read.decode(address, buffer.get(..got).unwrap_or_default()) {
            Ok(reply) => {
                self.learn_turnaround(sent_ns, 2 + got);
                Ok((reply, self.sent_stamp_ns))
            }
            Err(Flaw::Length) if got < wanted => {
                self.too_late(unit);
                Err(Error::CutShort {
                    port: self.port(),
                    unit: self.unit_name(unit),
                    asked: read.command_name(),
                    got,
                    wanted,
                })
            }
            Err(_) => {
                self.counters.garbled += 1;
                self.out_of_step(unit);
                Err(Error::Garbled { port: self.port(), unit: self.unit_name(unit), asked: read.command_name() })
            }
        }
    }

    /// Receives an answer; returns the bytes that arrived, and how many were expected.
    fn receive_answer(
        &mut self,
        unit: usize,
        read: Read,
        buffer: &mut [u8; MAX_PACKET],
        sent_ns: u64,
    ) -> Result<(usize, usize), Error> {
        let command = Command::Read(read);
        match read.reply_length() {
            ReplyLength::Bytes(payload) => {
                let wanted = payload + 2;
                let got = self.receive(unit, buffer.get_mut(..wanted).unwrap_or_default(), sent_ns, command)?;
                Ok((got, wanted))
            }
            ReplyLength::Status => {
                // Where the width is not known, wait for the longer one: nothing follows a short answer.
                let known = self.units.get(unit).and_then(|unit| unit.width);
                let wanted = known.unwrap_or(StatusWidth::Wide).bytes() + 2;
                let got = self.receive(unit, buffer.get_mut(..wanted).unwrap_or_default(), sent_ns, command)?;
                Ok((got, wanted))
            }
            ReplyLength::Text => {
                // The zero byte ends the text; the two bytes of the checksum after it can be zero too.
                let mut got = 0;
                while got < MAX_VERSION && (got == 0 || buffer[got - 1] != 0) {
                    match self.receive(unit, &mut buffer[got..=got], sent_ns, command)? {
                        0 => return Ok((got, got + 1)),
                        n => got += n,
                    }
                }
                let wanted = got + 2;
                got += self.receive(unit, &mut buffer[got..wanted], sent_ns, command)?;
                Ok((got, wanted))
            }
        }
    }

    /// Sends a packet if no received byte is pending; returns the time.
    pub(super) fn send(&mut self, unit: usize, packet: &Packet, command: Command) -> Result<u64, Error> {
        let stray = self.stray_bytes()?;
        if stray > 0 {
            self.counters.stray_bytes += stray as u64;
            self.out_of_step(self.last_unit);
            let (unit, asked) = (self.unit_name(unit), command.command_name());
            return Err(Error::Stray { port: self.port(), unit, asked, bytes: stray });
        }
        let now_ns = self.transport.now_ns();
        if now_ns >= self.call_ends_ns {
            return Err(Error::TooLate { port: self.port() });
        }
        self.last_unit = unit;
        self.counters.exchanges += 1;
        self.sent_stamp_ns = self.transport.stamp_ns();
        let deadline_ns = (now_ns + self.wire_ns(packet.len()) + self.margin_ns).min(self.call_ends_ns);
        if let Err(error) = self.transport.write_all(packet, deadline_ns) {
            self.out_of_step(unit);
            return Err(self.port_failed(error));
        }
        Ok(now_ns)
    }

    /// Takes the bytes that arrived before a question; returns how many.
    fn stray_bytes(&mut self) -> Result<usize, Error> {
        let excess = std::mem::take(&mut self.excess);
        if std::mem::take(&mut self.empty) {
            return Ok(excess);
        }
        let read = self.transport.read(&mut [0; MAX_PACKET], 0).map_err(|error| self.port_failed(error))?;
        Ok(excess + read)
    }

    /// Fills the buffer with the bytes that arrive in time after `sent_ns`; returns how many.
    fn receive(&mut self, unit: usize, buffer: &mut [u8], sent_ns: u64, command: Command) -> Result<usize, Error> {
        let address = self.address(unit);
        let sent = match command {
            Command::Write(write) => write.encode(address).len(),
            Command::Read(_) => 2,
        };
        // A text is read byte by byte, so the wire time of the longest text counts.
        let answer = if command == Command::Read(Read::Version) { MAX_VERSION + 2 } else { buffer.len() };
        // Only a unit that is not in use yet gets more time: a cycle has none.
        let in_setup = !self.in_cycle && self.units.get(unit).is_some_and(|unit| matches!(unit.phase, Phase::Setup(_)));
        let margin_ns = if in_setup { self.patience_ns(unit) } else { self.margin_ns };
        let deadline_ns = sent_ns + self.wire_ns(sent + answer) + margin_ns;
        // The end of a text is not known before it is read.
        let spare = if command == Command::Read(Read::Version) { 0 } else { SPARE };
        let mut room = [0; MAX_PACKET + SPARE];
        let (wanted, end) = (buffer.len(), (buffer.len() + spare).min(room.len()));
        let until_ns = deadline_ns.min(self.call_ends_ns);
        let got = self.fill_awake(&mut room[..end], wanted, until_ns)?;
        if got < wanted && until_ns < deadline_ns && self.transport.now_ns() < deadline_ns {
            let late = Late::new(unit, command, [sent_ns, self.sent_stamp_ns], deadline_ns, wanted).with(&room[..got]);
            return Err(self.leave(late));
        }
        self.excess = got.saturating_sub(wanted);
        self.empty = got >= wanted && got < end;
        let got = got.min(wanted);
        buffer[..got].copy_from_slice(&room[..got]);
        Ok(got)
    }

    /// Fills the buffer, also with bytes that are there only after the deadline because the whole machine stood still.
    pub(super) fn fill_awake(&mut self, buffer: &mut [u8], least: usize, deadline_ns: u64) -> Result<usize, Error> {
        let mut got = self.fill(buffer, least, deadline_ns)?;
        if got < least {
            let now_ns = self.transport.now_ns();
            if now_ns > deadline_ns + STOOD_STILL_NS {
                let more_ns = if self.inline { GRACE_NS } else { self.margin_ns };
                got += self.fill(buffer.get_mut(got..).unwrap_or_default(), least - got, now_ns + more_ns)?;
            }
        }
        Ok(got)
    }

    pub(super) fn fill(&mut self, buffer: &mut [u8], least: usize, deadline_ns: u64) -> Result<usize, Error> {
        self.transport.fill_at_least(buffer, least, deadline_ns).map_err(|error| self.port_failed(error))
    }

    fn no_answer(&mut self, unit: usize, command: Command, sent_ns: u64) -> Error {
        self.too_late(unit);
        let waited_us = u32::try_from((self.transport.now_ns() - sent_ns) / 1000).unwrap_or(u32::MAX);
        Error::NoAnswer { port: self.port(), unit: self.unit_name(unit), asked: command.command_name(), waited_us }
    }

    /// Records an answer that did not arrive in time, or not completely.
    pub(super) fn too_late(&mut self, unit: usize) {
        self.counters.timeouts += 1;
        if self.units.get(unit).is_some_and(|unit| matches!(unit.phase, Phase::Setup(_))) {
            self.be_more_patient(unit);
        }
        self.out_of_step(unit);
    }

    /// Starts a resynchronisation: bytes of this unit can no longer be attributed to a question, so the
    /// port is drained and the unit fenced.
    pub(super) fn out_of_step(&mut self, unit: usize) {
        let now_ns = self.transport.now_ns();
        self.forget_excess();
        if matches!(self.step, Step::Settled | Step::Late(_)) {
            self.counters.resyncs += 1;
        }
        self.step = Step::Draining { quiet_from_ns: now_ns };
        if let Some(unit) = self.units.get_mut(unit)
            && !matches!(unit.phase, Phase::Suspect { .. })
        {
            unit.phase = Phase::Suspect { failed: 0, due_ns: now_ns };
        }
    }

    fn forget_excess(&mut self) {
        self.counters.stray_bytes += std::mem::take(&mut self.excess) as u64;
        self.empty = false;
    }

    pub(super) fn port_failed(&mut self, error: serial::Error) -> Error {
        self.forget_excess();
        self.step = Step::Draining { quiet_from_ns: self.transport.now_ns() };
        if error.is_lost() {
            self.lose_all();
        }
        Error::Serial(error)
    }

    /// A unit's name in messages.
    pub(super) fn unit_name(&self, unit: usize) -> Arc<str> {
        self.units.get(unit).map_or_else(|| self.port(), |unit| Arc::clone(&unit.name))
    }

    pub(super) fn address(&self, unit: usize) -> u8 {
        self.units.get(unit).map_or(0, |unit| unit.config.address)
    }

    pub(super) fn wire_ns(&self, bytes: usize) -> u64 {
        bytes as u64 * self.byte_ns
    }

    /// Likely duration of an exchange of so many bytes, ns.
    pub(super) fn likely_ns(&self, bytes: usize) -> u64 {
        // Twice the usual turnaround, so that a slow question seldom makes the cycle late.
        self.wire_ns(bytes) + 2 * self.turnaround_ns
    }

    fn learn_turnaround(&mut self, sent_ns: u64, bytes: usize) {
        let took_ns = (self.transport.now_ns() - sent_ns).saturating_sub(self.wire_ns(bytes));
        // A moving average over about eight exchanges; a stop of the machine counts for no more than a timeout.
        let took_ns = took_ns.min(self.margin_ns);
        self.turnaround_ns = self.turnaround_ns - self.turnaround_ns / 8 + took_ns / 8;
    }
}
