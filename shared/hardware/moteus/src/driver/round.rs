//! One frame to each of several units, and their answers.

use arrayvec::ArrayVec;
use drives::{CommandName, Error, reply_text};
use serial::Transport;

use super::clock::ClockReading;
use super::question::{CLOCK, Question, Unfit, Values, cycle};
use super::receive::Heard;
use super::{Bus, MAX_UNITS, SecondInput};
use crate::codec::{
    Checksums, Frame, Line, MAX_LINE, Mode, Register, Text, Value, frame_line, from_unit, padded, to_unit,
};

/// Frames to one unit in one round: at a byte error in every hundred bytes, a third of them arrive and are answered.
const ATTEMPTS: u8 = 6;
/// Bytes of the longest answer, with the adapter's `OK`, and of a second encoder in it.
const ANSWER_BYTES: usize = 90;
const SECOND_BYTES: usize = 8;
/// Bytes of the question about what changes slowly, and of its answer with `OK`.
const SLOW_BYTES: usize = 50 + 93;
/// Time of unit, adapter and computer for an exchange, besides its bytes, ns.
const TURNAROUND_NS: u64 = 500_000;
/// The same of one unit on a UART, as `nims check` counts it.
const UART_TURNAROUND_NS: u64 = 300_000;
/// The same in a cycle whose time is over: an answer that is about to arrive is worth it, ns.
const LAST_NS: u64 = 1_000_000;

/// Waking up this long after a deadline means that the whole machine was stopped, ns: the answer may wait in the
/// kernel, or the device, which was stopped as well, is about to send it.
const STOOD_STILL_NS: u64 = 5_000_000;

/// A command to a unit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Order {
    /// No drive output; clears faults.
    Stop,
    /// Velocity in counts per second.
    Velocity(i32),
    /// Torque in N m, as the bits of a float.
    Torque(u32),
}

/// What a unit is told and asked in a round.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Plan {
    pub(super) order: Option<Order>,
    pub(super) question: Question,
}

/// One plan for each unit.
pub(super) type Plans = [Option<Plan>; MAX_UNITS];

/// An accepted answer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Reading {
    pub(super) values: Values,
    /// Time of the question on the machine's clock, ns.
    pub(super) at_ns: u64,
}

/// Result of a round for each unit that had a plan.
pub(super) type Results = [Option<Result<Reading, Error>>; MAX_UNITS];

/// A question whose answer is awaited.
#[derive(Debug, Clone, Copy)]
struct Asked {
    plan: Plan,
    /// Number among all questions.
    number: u32,
    /// Number among the unit's questions.
    tag: u32,
    attempt: u8,
    sent_ns: u64,
    stamp_ns: u64,
    /// Waiting for its answer ends at this time, ns.
    until_ns: u64,
    /// The same where another unit of the port has answered, which then waits for this one, ns.
    soon_ns: u64,
}

impl Plan {
    pub(super) const QUERY: Plan = Plan { order: None, question: Question::Cycle { torque: false, second: None } };

    pub(super) fn order(order: Order) -> Plan {
        let torque = matches!(order, Order::Torque(_));
        Plan { order: Some(order), question: Question::Cycle { torque, second: None } }
    }

    /// The same for a unit with or without a second encoder.
    fn with(self, second: Option<SecondInput>) -> Plan {
        match self.question {
            Question::Cycle { torque, .. } => {
                let second = second.map(|second| second.source);
                Plan { question: Question::Cycle { torque, second }, ..self }
            }
            _ => self,
        }
    }

    fn name(self) -> CommandName {
        let words = match (self.order, self.question) {
            (Some(Order::Stop), _) => "stop",
            (Some(Order::Velocity(_)), _) => "set velocity",
            (Some(Order::Torque(_)), _) => "set torque",
            (None, Question::Cycle { .. }) => "read position",
            (None, Question::Slow) => "read supply and status",
            (None, Question::Identity) => "read firmware",
        };
        CommandName { words, code: None }
    }

    fn frame(self, tag: u32, watchdog_ms: u16) -> Frame {
        let mut frame = Frame::new();
        if let Some(order) = self.order {
            let mode = if order == Order::Stop { Mode::STOPPED } else { Mode::POSITION };
            frame.write(Register::MODE, Value::I8(mode.0));
            if let Order::Velocity(counts_s) = order {
                // No position: the velocity continues from where the motor is.
                frame.write(Register::COMMAND_POSITION, Value::I8(i8::MIN));
                frame.write(Register::COMMAND_VELOCITY, Value::I32(counts_s));
            }
            if let Order::Torque(bits) = order {
                frame.write(Register::COMMAND_POSITION, Value::I8(i8::MIN));
                frame.write(Register::COMMAND_TORQUE, Value::F32(f32::from_bits(bits)));
                // Neither a position, nor a velocity, nor what the loop has summed up adds to it.
                frame.write(Register::COMMAND_KP_SCALE, Value::I8(0));
                frame.write(Register::COMMAND_KD_SCALE, Value::I8(0));
                frame.write(Register::COMMAND_KI_LIMIT_SCALE, Value::I8(0));
            }
            frame.write(Register::COMMAND_TIMEOUT, Value::I16(watchdog_ms.cast_signed()));
        }
        self.question.ask(tag, &mut frame);
        frame
    }
}

impl Order {
    /// True where the unit has read this command back.
    fn is_read_back(self, got: Option<i32>) -> bool {
        match self {
            Order::Stop => same(0, got),
            Order::Velocity(counts_s) => same(counts_s, got),
            Order::Torque(bits) => got == Some(bits.cast_signed()),
        }
    }
}

/// True where the unit, which computes with floats of 24 bits and cuts off, can read `wanted` back as `got`.
fn same(wanted: i32, got: Option<i32>) -> bool {
    // Two roundings, each half of 1 / 2^23.
    let tolerance = 1.0 + f64::from(wanted).abs() / f64::from(1 << 22);
    got.is_some_and(|got| (f64::from(got) - f64::from(wanted)).abs() <= tolerance)
}

impl<T: Transport> Bus<T> {
    /// Duration of a round with so many units, ns, if nothing goes wrong.
    pub(super) fn likely_ns(&self, units: usize) -> u64 {
        // Frame and answer have about the same length; the second unit's frame is sent during the first one's answer.
        self.wire_ns((units + 1) * self.answer_bytes()) + TURNAROUND_NS
    }

    /// The same of the question about what changes slowly. Alone on a UART a unit answers after the question, and a
    /// rate that `nims check` accepts has to leave the time that it counts.
    pub(super) fn likely_slow_ns(&self, units: usize) -> u64 {
        if units == 1 && self.byte_ns > 0 {
            self.wire_ns(SLOW_BYTES) + UART_TURNAROUND_NS
        } else {
            self.likely_ns(units)
        }
    }

    fn answer_bytes(&self) -> usize {
        let second = self.units.iter().any(|unit| unit.config.second.is_some());
        if second { ANSWER_BYTES + SECOND_BYTES } else { ANSWER_BYTES }
    }

    /// Sends a frame to each unit with a plan and collects the answers; repeats what was lost as long as `deadline_ns`
    /// allows. `in_cycle`: the caller waits, and no unit that has answered waits for another one beyond the deadline.
    pub(super) fn round(&mut self, plans: &Plans, deadline_ns: u64, in_cycle: bool) -> Results {
        let mut results: Results = [const { None }; MAX_UNITS];
        let mut asked = [None; MAX_UNITS];
        let open = |plan: &Option<Plan>| plan.map(|plan| (plan, 0));
        let first = std::array::from_fn(|unit| plans.get(unit).and_then(open));
        let ended = match self.send(first, &mut asked, deadline_ns, in_cycle) {
            Ok(()) => self.collect(&mut asked, &mut results, deadline_ns, in_cycle),
            Err(error) => Err(error),
        };
        for (unit, result) in results.iter_mut().enumerate() {
            let open = plans.get(unit).copied().flatten().filter(|_| result.is_none());
            if let (Some(_), Err(error)) = (open, &ended) {
                *result = Some(Err(error.clone()));
            }
        }
        results
    }

    /// Sends frames in one write.
    fn send(
        &mut self,
        plans: [Option<(Plan, u8)>; MAX_UNITS],
        asked: &mut [Option<Asked>; MAX_UNITS],
        deadline_ns: u64,
        in_cycle: bool,
    ) -> Result<(), Error> {
        let mut bytes = ArrayVec::<u8, { MAX_LINE * MAX_UNITS }>::new();
        let count = plans.iter().flatten().count();
        let now_ns = self.transport.now_ns();
        let stamp_ns = self.transport.stamp_ns();
        for (unit, plan) in plans.into_iter().enumerate() {
            let (Some((plan, attempt)), Some(state)) = (plan, self.units.get_mut(unit)) else { continue };
            state.tag = state.tag.wrapping_add(1);
            let (config, tag) = (state.config, state.tag);
            let plan = plan.with(config.second);
            self.asked = self.asked.wrapping_add(1);
            self.counters.exchanges += 1;
            let line = self.line(config.address, plan.frame(tag, config.watchdog_ms));
            // Room for the longest lines of all units.
            let _ = bytes.try_extend_from_slice(&line);
            let _ = bytes.try_push(b'\n');
            let number = self.asked;
            asked[unit] =
                Some(Asked { plan, number, tag, attempt, sent_ns: now_ns, stamp_ns, until_ns: 0, soon_ns: 0 });
        }
        let on_wire_ns = now_ns + self.wire_ns(bytes.len() + count * self.answer_bytes());
        let until_ns = on_wire_ns + self.margin_ns;
        let soon_ns = if in_cycle { until_ns.min(deadline_ns.max(on_wire_ns + LAST_NS)) } else { until_ns };
        for (asked, _) in asked.iter_mut().zip(plans).filter(|(_, plan)| plan.is_some()) {
            asked.iter_mut().for_each(|asked| (asked.until_ns, asked.soon_ns) = (until_ns, soon_ns));
        }
        self.transport.write_all(&bytes, on_wire_ns + self.margin_ns).map_err(|error| self.port_failed(error))
    }

    fn line(&self, address: u8, frame: Frame) -> Text {
        // A UART has no lengths that a frame must have.
        let frame = if self.checksums == Checksums::Required { frame } else { padded(frame) };
        frame_line("can send", to_unit(address), &frame, "BF", self.checksums)
    }

    fn collect(
        &mut self,
        asked: &mut [Option<Asked>; MAX_UNITS],
        results: &mut Results,
        deadline_ns: u64,
        in_cycle: bool,
    ) -> Result<(), Error> {
        let mut garbled = false;
        let mut patient = true;
        loop {
            let answered = results.iter().any(Option::is_some);
            let limit = |asked: &Asked| if answered { asked.soon_ns } else { asked.until_ns };
            let Some(until_ns) = asked.iter().flatten().map(limit).max() else { return Ok(()) };
            match self.hear(until_ns)? {
                None if patient && self.transport.now_ns() > until_ns + STOOD_STILL_NS => {
                    patient = false;
                    let until_ns = self.transport.now_ns() + self.margin_ns;
                    asked.iter_mut().flatten().for_each(|asked| (asked.until_ns, asked.soon_ns) = (until_ns, until_ns));
                }
                None => {
                    self.counters.timeouts += asked.iter().flatten().count() as u64;
                    self.counters.resyncs += 1;
                    if !self.repeat(asked, usize::MAX, deadline_ns, in_cycle)? {
                        self.give_up(asked, results, garbled);
                        return Ok(());
                    }
                }
                Some(Heard::Line(Line::Sent)) => {}
                Some(Heard::Line(Line::Received { identifier, frame })) => {
                    // A frame that fits no question is late; asking again would only make the next ones late too.
                    self.take(asked, results, identifier, &frame);
                }
                // Units answer in the order of their frames, so it is most likely the first one's that is missing; the
                // tags tell, if it is not.
                Some(Heard::Line(Line::Refused) | Heard::Garbled { short: false }) => {
                    garbled = true;
                    self.counters.resyncs += 1;
                    self.repeat(asked, 1, deadline_ns, in_cycle)?;
                }
                Some(Heard::Garbled { short: true }) => {}
            }
        }
    }

    /// Asks the first `most` units again, if the time allows; false where nothing was asked.
    fn repeat(
        &mut self,
        asked: &mut [Option<Asked>; MAX_UNITS],
        most: usize,
        deadline_ns: u64,
        in_cycle: bool,
    ) -> Result<bool, Error> {
        if self.transport.now_ns() + self.likely_ns(1) > deadline_ns {
            return Ok(false);
        }
        let mut open: ArrayVec<(usize, Asked), MAX_UNITS> =
            asked.iter().enumerate().filter_map(|(unit, asked)| Some((unit, (*asked)?))).collect();
        open.sort_unstable_by_key(|(_, asked)| self.asked.wrapping_sub(asked.number));
        let mut plans = [None; MAX_UNITS];
        // The oldest question last in this order, so from the end.
        for &(unit, asked) in open.iter().rev() {
            // A unit that has lately been quiet is asked once: what it still owes would only be delayed further.
            let quiet = self.units.get(unit).is_none_or(|unit| unit.setup.is_quiet());
            if asked.attempt + 1 < if quiet { 1 } else { ATTEMPTS } && plans.iter().flatten().count() < most {
                plans[unit] = Some((asked.plan, asked.attempt + 1));
            }
        }
        let any = plans.iter().any(Option::is_some);
        if any {
            self.send(plans, asked, deadline_ns, in_cycle)?;
        }
        Ok(any)
    }

    fn give_up(&mut self, asked: &mut [Option<Asked>; MAX_UNITS], results: &mut Results, garbled: bool) {
        let now_ns = self.transport.now_ns();
        for (unit, asked) in asked.iter_mut().enumerate() {
            let Some(asked) = asked.take() else { continue };
            let name = asked.plan.name();
            let waited_us = u32::try_from((now_ns - asked.sent_ns) / 1000).unwrap_or(u32::MAX);
            results[unit] = Some(Err(self.error(unit, |port, unit| match garbled {
                true => Error::Garbled { port, unit, asked: name },
                false => Error::NoAnswer { port, unit, asked: name, waited_us },
            })));
        }
    }

    /// Uses a frame, if it is the answer to a question that is open.
    fn take(&mut self, asked: &mut [Option<Asked>; MAX_UNITS], results: &mut Results, identifier: u16, frame: &Frame) {
        let address = from_unit(identifier);
        let unit = self.units.iter().position(|unit| Some(unit.config.address) == address);
        let Some((unit, question)) = unit.and_then(|unit| Some((unit, asked[unit]?))) else {
            self.count_stray(frame.as_slice().len());
            return;
        };
        match question.plan.question.answer(question.tag, frame) {
            // An older question's answer: late, or of a unit that was asked again too early.
            Err(Unfit::Other) => {
                self.count_stray(frame.as_slice().len());
            }
            Err(Unfit::Refused { register }) => {
                let said = reply_text(format_args!("no register {register:#05x}: update its firmware"));
                let name = question.plan.name();
                let error = |port, unit| Error::Unexpected { port, unit, asked: name, said };
                (results[unit], asked[unit]) = (Some(Err(self.error(unit, error))), None);
            }
            Ok(values) => {
                self.noise.end();
                (results[unit], asked[unit]) = (Some(self.accept(unit, &question, values)), None);
            }
        }
    }

    /// Checks the clock and the command of an answer.
    fn accept(&mut self, unit: usize, asked: &Asked, values: Values) -> Result<Reading, Error> {
        let received_ns = self.transport.now_ns();
        let name = asked.plan.name();
        let clock = ClockReading { ms: values[CLOCK].unwrap_or(i32::MIN), sent_ns: asked.sent_ns, received_ns };
        self.judge_clock(unit, clock, name)?;
        if let Some(order) = asked.plan.order
            && !order.is_read_back(values[cycle::COMMAND])
        {
            self.counters.wrong_acks += 1;
            let got = values[cycle::COMMAND].unwrap_or(i32::MIN);
            let said = match order {
                Order::Torque(_) => reply_text(format_args!("a torque of {}", f32::from_bits(got.cast_unsigned()))),
                _ => reply_text(format_args!("a velocity of {got}")),
            };
            return Err(self.error(unit, |port, unit| Error::Unexpected { port, unit, asked: name, said }));
        }
        Ok(Reading { values, at_ns: asked.stamp_ns })
    }

    /// Compares the unit's clock with its last reading. A reading that does not follow from it is not used; if the next
    /// one agrees with it, the unit has restarted.
    fn judge_clock(&mut self, index: usize, now: ClockReading, asked: CommandName) -> Result<(), Error> {
        let Some(unit) = self.units.get_mut(index) else { return Ok(()) };
        if unit.clock.is_none_or(|before| before.explains(&now)) {
            (unit.clock, unit.suspect) = (Some(now), None);
            return Ok(());
        }
        if unit.suspect.is_some_and(|suspect| suspect.explains(&now)) {
            let restarted = unit.clock.is_some_and(|before| before.allows_restart(&now));
            (unit.clock, unit.suspect) = (Some(now), None);
            if !restarted {
                // One of the clocks has slipped.
                return Ok(());
            }
            self.has_restarted(index);
            return Err(self.error(index, |port, unit| Error::Preparing { port, unit }));
        }
        unit.suspect = Some(now);
        let said = reply_text(format_args!("a clock of {} ms", now.ms));
        Err(self.error(index, |port, unit| Error::Unexpected { port, unit, asked, said }))
    }
}
