//! One batch of lines and its answers.

use arrayvec::ArrayVec;
use drives::{CommandName, Error};
use serial::Transport;

use super::Bus;
use super::ask::{Ask, MAX_ASKS, MAX_ORDERS, Value};
use crate::codec::{Line, MARKS, MAX_LINE, mark, unseal};
use drives::{Heard, Instead};

/// Batches of one exchange: at a byte error in every hundred bytes, a third of the cycles succeed.
const ATTEMPTS: u32 = 8;
/// Bytes of the answer to a mark, and of the longest one to a question.
const MARK_BYTES: usize = 26;
const ANSWER_BYTES: usize = 28;
/// Time of board, adapter and computer for a batch, besides its bytes, ns.
const TURNAROUND_NS: u64 = 500_000;
/// Waking up this long after a deadline means that the whole machine was stopped, ns: the answer may wait in the
/// kernel, or the device, which was stopped as well, is about to send it.
const STOOD_STILL_NS: u64 = 5_000_000;

/// Lines to the board and questions of one batch.
#[derive(Debug, Clone, Default)]
pub(super) struct Batch {
    pub(super) orders: ArrayVec<Line<'static>, MAX_ORDERS>,
    pub(super) asks: ArrayVec<Ask, MAX_ASKS>,
}

/// Answers to the questions of a batch, in their order.
#[derive(Debug, Clone)]
pub(super) struct Answers {
    pub(super) asks: ArrayVec<Ask, MAX_ASKS>,
    pub(super) values: ArrayVec<Value, MAX_ASKS>,
    /// Time of the batch on the machine's clock, ns.
    pub(super) at_ns: u64,
}

impl Answers {
    /// The answer to a question of the batch.
    pub(super) fn value(&self, ask: Ask) -> Option<Value> {
        let place = self.asks.iter().position(|&asked| asked == ask)?;
        self.values.get(place).copied()
    }

    /// A whole number.
    pub(super) fn whole(&self, ask: Ask) -> Option<u32> {
        self.value(ask).map(|[value, _]| value as u32)
    }
}

/// How an attempt ended.
enum Ended {
    /// Every answer is there.
    Whole(ArrayVec<Value, MAX_ASKS>),
    /// Something was changed on the wire, or is missing.
    Garbled,
    /// The time is over.
    Quiet,
}

impl<T: Transport> Bus<T> {
    /// Duration of a batch of so many lines, ns, if nothing goes wrong.
    pub(super) fn likely_ns(&self, lines: usize) -> u64 {
        self.wire_ns((lines + 2) * ANSWER_BYTES + MARK_BYTES) + TURNAROUND_NS
    }

    /// Sends a batch and returns its answers; repeats it as long as `deadline_ns` allows.
    pub(super) fn transact(&mut self, batch: &Batch, words: &'static str, deadline_ns: u64) -> Result<Answers, Error> {
        if self.setup.is_quiet() {
            self.probe(batch)?;
            if self.transport.now_ns() > deadline_ns {
                return Err(Error::Resynchronising { port: self.port() });
            }
        }
        let asked = CommandName { words, code: None };
        let lines = batch.orders.len() + batch.asks.len();
        let began_ns = self.transport.now_ns();
        let mut garbled = false;
        for attempt in 0..ATTEMPTS {
            if attempt > 0 && self.transport.now_ns() + self.likely_ns(lines) > deadline_ns {
                break;
            }
            let at_ns = self.transport.stamp_ns();
            match self.attempt(batch)? {
                Ended::Whole(values) => {
                    self.setup.answered();
                    self.noise.end();
                    return Ok(Answers { asks: batch.asks.clone(), values, at_ns });
                }
                Ended::Garbled => garbled = true,
                Ended::Quiet => self.counters.timeouts += 1,
            }
            self.counters.resyncs += 1;
        }
        let waited_us = u32::try_from((self.transport.now_ns() - began_ns) / 1000).unwrap_or(u32::MAX);
        self.setup.set_quiet(!garbled);
        Err(self.error(|port, unit| match garbled {
            true => Error::Garbled { port, unit, asked },
            false => Error::NoAnswer { port, unit, asked, waited_us },
        }))
    }

    /// Asks a board that has lately been quiet for a single mark: what it still owes would only be delayed further by
    /// more questions.
    fn probe(&mut self, batch: &Batch) -> Result<(), Error> {
        // Velocities feed the watchdog meanwhile; nothing is armed blindly.
        let feeds = |line: &Line<'_>| matches!(line, Line::Velocity(..) | Line::Torque(..) | Line::Feed(_));
        let orders = batch.orders.iter().copied().filter(feeds).collect();
        match self.attempt(&Batch { orders, ..Batch::default() })? {
            Ended::Whole(_) => {
                self.setup.set_quiet(false);
                Ok(())
            }
            Ended::Garbled | Ended::Quiet => {
                self.counters.timeouts += 1;
                self.counters.resyncs += 1;
                let asked = CommandName { words: "mark", code: None };
                let waited_us = (self.config.margin_ns / 1000) as u32;
                Err(self.error(|port, unit| Error::NoAnswer { port, unit, asked, waited_us }))
            }
        }
    }

    fn mark(&mut self) -> u32 {
        let mark = self.next_mark;
        self.next_mark = if mark + 1 < MARKS.end { mark + 1 } else { MARKS.start };
        mark
    }

    fn attempt(&mut self, batch: &Batch) -> Result<Ended, Error> {
        let last = self.mark();
        // A batch without questions is one mark.
        let first = (!batch.asks.is_empty()).then(|| self.mark());
        let marks = [first, Some(last)];
        let mut bytes = ArrayVec::<u8, { MAX_LINE * (MAX_ASKS + MAX_ORDERS + 2) }>::new();
        let orders = batch.orders.iter().copied();
        let asks = batch.asks.iter().map(|ask| ask.line());
        for line in first.map(Line::Mark).into_iter().chain(orders).chain(asks).chain([Line::Mark(last)]) {
            // Room for the longest lines.
            let _ = bytes.try_extend_from_slice(line.encode().as_bytes());
            let _ = bytes.try_push(b'\n');
        }
        self.counters.exchanges += 1;
        let now_ns = self.transport.now_ns();
        let answers = 2 * MARK_BYTES + batch.asks.len() * ANSWER_BYTES;
        let on_wire_ns = now_ns + self.wire_ns(bytes.len() + answers);
        // The port has no other unit that would wait meanwhile.
        let until_ns = on_wire_ns + self.config.margin_ns;
        let written = self.transport.write_all(&bytes, on_wire_ns + self.config.margin_ns);
        written.map_err(|error| self.port_failed(error))?;
        self.collect(&batch.asks, marks, until_ns)
    }

    fn collect(&mut self, asks: &[Ask], marks: [Option<u32>; 2], mut until_ns: u64) -> Result<Ended, Error> {
        let mut values = ArrayVec::new();
        let (mut inside, mut patient) = (marks[0].is_none(), true);
        loop {
            let Some(line) = self.hear(until_ns)? else {
                let now_ns = self.transport.now_ns();
                if std::mem::take(&mut patient) && now_ns > until_ns + STOOD_STILL_NS {
                    until_ns = now_ns + self.config.margin_ns;
                    continue;
                }
                return Ok(Ended::Quiet);
            };
            let Ok((text, true)) = unseal(&line) else {
                self.counters.garbled += 1;
                self.stray(&line);
                // Of this batch or of an older one: a new batch tells.
                return Ok(Ended::Garbled);
            };
            match mark(text) {
                number @ Some(_) if number == marks[0] => inside = true,
                number @ Some(_) if number == marks[1] => {
                    return Ok(if inside && values.len() == asks.len() {
                        Ended::Whole(values)
                    } else {
                        Ended::Garbled
                    });
                }
                // The mark of an older batch.
                Some(_) => self.stray(&line),
                None if !inside => self.stray(&line),
                None => match asks.get(values.len()).and_then(|ask| ask.answer(text)) {
                    Some(value) => values.push(value),
                    None => {
                        self.stray(&line);
                        return Ok(Ended::Garbled);
                    }
                },
            }
        }
    }

    fn stray(&mut self, line: &[u8]) {
        let sent = [b"r ", b"f ", b"v ", b"w ", b"u "].iter().any(|start| line.starts_with(*start));
        self.noise.is(if sent { Instead::Echo } else { Instead::Foreign });
        self.count_stray(line.len() + 1);
    }

    fn count_stray(&mut self, bytes: usize) {
        self.counters.stray_bytes += bytes as u64;
        let now_ns = self.transport.now_ns();
        self.noise.heard(now_ns);
    }

    /// Discards what arrived before a batch.
    pub(super) fn discard(&mut self) -> Result<(), Error> {
        let discarded = self.inbox.discard(&mut self.transport);
        let stray = discarded.map_err(|error| self.port_failed(error))?;
        if stray > 0 {
            self.count_stray(stray);
        }
        Ok(())
    }

    /// The next text line; `None` after `until_ns`.
    fn hear(&mut self, until_ns: u64) -> Result<Option<ArrayVec<u8, MAX_LINE>>, Error> {
        loop {
            let heard = self.inbox.hear(&mut self.transport, until_ns).map_err(|error| self.port_failed(error))?;
            match heard {
                Heard::Line(line) => return Ok(Some(line)),
                Heard::Nothing => return Ok(None),
                Heard::TooLong(bytes) => {
                    self.noise.is(Instead::Foreign);
                    self.count_stray(bytes);
                }
            }
        }
    }
}
