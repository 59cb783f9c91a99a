//! One batch of lines and its answers.

use arrayvec::ArrayVec;
use drives::{CommandName, Error};
use serial::Transport;

use super::Bus;
use super::parts::{Answers, Batch, Item, MARKS, MAX_ITEMS, Tail, Value, answer_bytes, mark, unacknowledged};
use crate::codec::{Answer, Flaw, Line, MAX_LINE, Name, Text};

/// Batches of one exchange, as far as the time allows.
const ATTEMPTS: u32 = 8;
/// Time of controller, adapter and computer for a batch, besides its bytes, ns.
const TURNAROUND_NS: u64 = 500_000;
/// Waking up this long after a deadline means that the whole machine was stopped, ns: the answer may wait in the
/// kernel, or the device, which was stopped as well, is about to send it.
const STOOD_STILL_NS: u64 = 5_000_000;

/// How an attempt ended.
enum Ended {
    /// Every answer is there.
    Whole,
    /// Something was changed on the wire, or is missing.
    Garbled,
    /// The time is over.
    Quiet,
}

/// Lines on the wire and their times after the first byte, ns.
struct Posted {
    bytes: ArrayVec<u8, { MAX_LINE * MAX_ITEMS }>,
    /// Beginning of the first question about the counters.
    counts_ns: u64,
    /// End of the answers that are waited for, and of all.
    head_ns: u64,
    all_ns: u64,
}

impl<T: Transport> Bus<T> {
    fn post(&self, items: impl Iterator<Item = Item> + Clone, tail: usize) -> Posted {
        let mut bytes = ArrayVec::new();
        let asks = items.clone().filter(|item| matches!(item, Item::Ask(..))).count();
        let (mut counts_at, mut arrived, mut head, mut asked) = (None, 0, 0, 0);
        for item in items {
            if matches!(item, Item::Ask(Name::Counts, _)) {
                counts_at.get_or_insert(bytes.len());
            }
            // Room for the longest lines.
            let _ = bytes.try_extend_from_slice(item.text().as_bytes());
            let _ = bytes.try_push(b'\r');
            arrived = arrived.max(bytes.len());
            match item {
                Item::End => {}
                Item::Order(_) => arrived += 2,
                Item::Ask(name, _) => {
                    arrived += answer_bytes(name);
                    asked += 1;
                    if asked + tail == asks {
                        head = arrived;
                    }
                }
            }
        }
        let wire_ns = |bytes: usize| bytes as u64 * self.byte_ns;
        let counts_ns = wire_ns(counts_at.unwrap_or(0));
        Posted { bytes, counts_ns, head_ns: wire_ns(head), all_ns: wire_ns(arrived) }
    }

    /// Duration of a batch, ns, if nothing goes wrong.
    pub(super) fn likely_ns(&self, batch: &Batch) -> u64 {
        let first = batch.marked.then_some(Item::Ask(Name::Variable, Some(1)));
        self.post(first.into_iter().chain(batch.items.iter().copied()), batch.tail).head_ns + TURNAROUND_NS
    }

    /// Order of the questions: it changes when the numbered variables begin again.
    pub(super) fn is_turned(&self) -> bool {
        self.turn / MARKS % 2 == 1
    }

    /// A variable other than that of the last batches.
    pub(super) fn variable(&self, further: usize) -> u8 {
        ((self.turn + further) % MARKS) as u8 + 1
    }

    /// Sends a batch and returns its answers; repeats it as long as `deadline_ns` allows.
    pub(super) fn transact(&mut self, batch: &Batch, words: &'static str, deadline_ns: u64) -> Result<Answers, Error> {
        if self.setup.is_quiet() && batch.marked {
            self.probe(batch)?;
            if self.transport.now_ns() > deadline_ns {
                return Err(Error::Resynchronising { port: self.port() });
            }
        }
        let began_ns = self.transport.now_ns();
        let mut garbled = false;
        for attempt in 0..ATTEMPTS {
            if attempt > 0 && self.transport.now_ns() + self.likely_ns(batch) > deadline_ns {
                break;
            }
            let mut answers = Answers::default();
            match self.attempt(batch, &mut answers)? {
                Ended::Whole => {
                    self.setup.answered();
                    self.noise.end();
                    return Ok(answers);
                }
                Ended::Garbled => garbled = true,
                Ended::Quiet => self.counters.timeouts += 1,
            }
            self.counters.resyncs += 1;
        }
        let waited_us = u32::try_from((self.transport.now_ns() - began_ns) / 1000).unwrap_or(u32::MAX);
        self.setup.set_quiet(!garbled);
        Err(self.missing(words, garbled, waited_us))
    }

    /// The error of an answer that was changed on the wire, or did not arrive.
    pub(super) fn missing(&self, words: &'static str, garbled: bool, waited_us: u32) -> Error {
        let asked = CommandName { words, code: None };
        self.error(|port, unit| match garbled {
            true => Error::Garbled { port, unit, asked },
            false => Error::NoAnswer { port, unit, asked, waited_us },
        })
    }

    /// Asks a controller that has lately been quiet for a number only: what it still owes would only be delayed
    /// further by more questions.
    fn probe(&mut self, batch: &Batch) -> Result<(), Error> {
        // A command feeds the watchdog meanwhile; nothing else is changed blindly.
        let feeds = |item: &Item| matches!(item, Item::Order(Line::Motors(_)));
        let items = batch.items.iter().copied().filter(feeds).collect();
        let mut answers = Answers::default();
        match self.attempt(&Batch { items, marked: true, ..Batch::default() }, &mut answers)? {
            Ended::Whole => {
                self.setup.set_quiet(false);
                Ok(())
            }
            Ended::Garbled | Ended::Quiet => {
                self.counters.timeouts += 1;
                self.counters.resyncs += 1;
                Err(self.missing("read a variable", false, (self.config.margin_ns / 1000) as u32))
            }
        }
    }

    fn attempt(&mut self, batch: &Batch, answers: &mut Answers) -> Result<Ended, Error> {
        let variable = self.variable(0);
        self.turn += 1;
        let first = batch.marked.then_some(Item::Ask(Name::Variable, Some(variable)));
        let items = first.into_iter().chain(batch.items.iter().copied());
        let posted = self.post(items, batch.tail);
        self.counters.exchanges += 1;
        (self.tail, answers.at_ns) = (None, self.transport.stamp_ns());
        answers.counts_at_ns = answers.at_ns + posted.counts_ns;
        let asks = batch.items.iter().filter_map(|item| if let Item::Ask(name, _) = item { Some(*name) } else { None });
        answers.names = asks.collect();
        let tail = answers.names.drain(answers.names.len().saturating_sub(batch.tail)..).collect();
        // The port has no other unit that would wait meanwhile.
        let now_ns = self.transport.now_ns();
        let [until_ns, tail_until_ns] = [posted.head_ns, posted.all_ns].map(|ns| now_ns + ns + self.config.margin_ns);
        let written = self.transport.write_all(&posted.bytes, until_ns);
        written.map_err(|error| self.port_failed(error))?;
        let mark = batch.marked.then(|| mark(variable));
        let ended = self.collect(answers, mark, batch.lenient, until_ns)?;
        match &ended {
            Ended::Whole => {
                self.tail = Some(Tail { asks: tail, at_ns: answers.at_ns, until_ns: tail_until_ns });
            }
            // Without numbers, the rest of the answers must not answer the next batch.
            Ended::Garbled if !batch.marked => self.transport.wait_until(until_ns),
            _ => {}
        }
        Ok(ended)
    }

    fn collect(
        &mut self,
        answers: &mut Answers,
        mark: Option<i32>,
        lenient: bool,
        mut until_ns: u64,
    ) -> Result<Ended, Error> {
        let (mut inside, mut patient) = (mark.is_none(), true);
        loop {
            if inside && answers.values.len() == answers.names.len() {
                return Ok(Ended::Whole);
            }
            let Some(line) = self.hear(until_ns)? else {
                let now_ns = self.transport.now_ns();
                if std::mem::take(&mut patient) && now_ns > until_ns + STOOD_STILL_NS {
                    until_ns = now_ns + self.config.margin_ns;
                    continue;
                }
                return Ok(Ended::Quiet);
            };
            let Some(line) = unacknowledged(&line) else { continue };
            let answer = Answer::parse(line);
            if !inside {
                if let (Ok(Answer::Numbers(Name::Variable, given)), Some(mark)) = (&answer, mark)
                    && given.as_slice() == [mark]
                {
                    inside = true;
                } else {
                    self.notice_late(&answer);
                    self.suspect(line, &answer);
                    self.stray(line);
                }
                continue;
            }
            let wanted = answers.names.get(answers.values.len()).copied();
            let value = match answer {
                Ok(Answer::Numbers(name, given)) if Some(name) == wanted => Some(Value::Numbers(given)),
                Ok(Answer::Text(name, given)) if Some(name) == wanted => Text::from(given).ok().map(Value::Text),
                _ => None,
            };
            let Some(value) = value else {
                if lenient {
                    continue;
                }
                self.counters.garbled += 1;
                self.suspect(line, &Answer::parse(line));
                self.stray(line);
                return Ok(Ended::Garbled);
            };
            answers.values.push(value);
        }
    }

    /// Listens to a controller that has lately been quiet, for as long as the time allows or until it has caught up.
    pub(super) fn listen(&mut self, deadline_ns: u64) -> Result<(), Error> {
        let newest = mark(self.variable(MARKS - 1));
        while let Some(line) = self.hear(deadline_ns)? {
            let Some(line) = unacknowledged(&line) else { continue };
            let answer = Answer::parse(line);
            self.stray(line);
            if self.notice_late(&answer) == Some(newest) {
                self.setup.set_quiet(false);
                break;
            }
        }
        Ok(())
    }

    /// A number that is answered late shows that the controller is there, though the answer is of no use.
    fn notice_late(&mut self, answer: &Result<Answer<'_>, Flaw>) -> Option<i32> {
        let Ok(Answer::Numbers(Name::Variable, given)) = answer else { return None };
        let number = given.first().copied().filter(|number| (1..=MARKS as u8).any(|place| mark(place) == *number))?;
        let quiet = self.setup.is_quiet();
        self.setup.answered();
        self.setup.set_quiet(quiet);
        Some(number)
    }

    /// Looks for a restart: the controller sends back what it receives, or its variables are empty.
    fn suspect(&mut self, line: &[u8], answer: &Result<Answer<'_>, Flaw>) {
        let echo = [&b"?VAR "[..], b"?CIS", b"!M "].iter().any(|start| line.starts_with(start));
        let empty = matches!(answer, Ok(Answer::Numbers(Name::Variable, given)) if given.as_slice() == [0]);
        if echo {
            self.hushed = false;
        }
        if (echo || empty) && self.setup.is_ready() {
            self.setup.doubt();
        }
    }
}
