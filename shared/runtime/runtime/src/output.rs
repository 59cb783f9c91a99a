//! Publishers for outputs of the control chain, with fault injection to test the other processes.
//!
//! Only processes of a system with virtual drives accept fault requests; with real drives an [`Output`] is a plain
//! publisher.

use std::cell::Cell;
use std::collections::VecDeque;
use std::rc::Rc;

use bus::clock::{SECOND_NS, now_ns};
use bus::{Bus, BusError, Publisher, Server};
use messages::schema::{Primitive, Schema};
use messages::{Message, Request};
use robot_state::Reason;
use robot_state::answers::detail;
use tracing::{info, warn};

/// Largest delay of an output, cycles: one second at 100 Hz.
const SLOWEST_CYCLES: usize = 100;
/// Longest duration of a fault, s.
const LONGEST_S: f64 = 3600.0;

/// The faults of an output: word, arguments, effect.
pub const OUTPUT_FAULTS: [(&str, &str, &str); 3] = [
    (
        "slow",
        "PROCESS CYCLES",
        "the output of the process is delayed by this number of cycles; controller or estimator",
    ),
    ("nan", "PROCESS", "every floating-point field that the process publishes is NaN; controller or estimator"),
    ("frozen", "PROCESS", "the process publishes the same sample repeatedly; controller or estimator"),
];

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Fault {
    Slow(usize),
    Nan,
    Frozen,
}

/// Receives requests for faults of the outputs of this process.
#[derive(Debug)]
pub(crate) struct OutputFaultInjector {
    process: String,
    server: Server,
    fault: Rc<Cell<Option<Fault>>>,
    until_ns: u64,
}

impl OutputFaultInjector {
    pub(crate) fn new(bus: &Bus) -> Result<Self, BusError> {
        let process = bus.process().to_owned();
        Ok(Self { server: bus.server(&process)?, process, fault: Rc::default(), until_ns: u64::MAX })
    }

    /// Handles requests, and ends a fault when its time is over.
    pub(crate) fn poll(&mut self) -> Result<(), BusError> {
        if now_ns() >= self.until_ns {
            self.fault.set(None);
            self.until_ns = u64::MAX;
        }
        while let Some(call) = self.server.try_next()? {
            let text = match Request::decode(&call.request) {
                Ok(Request::Fault { text }) => text,
                Ok(_) => {
                    call.answer(&Reason::OtherProcess { takes: detail("faults") }.answer())?;
                    continue;
                }
                Err(error) => {
                    call.answer(&Reason::Undecodable { why: detail(error) }.answer())?;
                    continue;
                }
            };
            let wanted = parse(&text);
            let Some((fault, for_s)) = wanted else {
                let why = detail(format_args!("\"{text}\" is not a fault of this process; accepted: {}", forms()));
                call.answer(&Reason::FaultInvalid { why }.answer())?;
                continue;
            };
            self.fault.set(fault);
            self.until_ns = for_s.map_or(u64::MAX, |s| now_ns().saturating_add((s * SECOND_NS as f64) as u64));
            match fault {
                Some(_) => warn!("fault on request: {text}"),
                None => info!("fault on request: {text}"),
            }
            call.answer(&Reason::FaultDone { fault: detail(named(&text, &self.process)) }.answer())?;
        }
        Ok(())
    }
}

/// Returns a request with the process after the kind of the fault, as `nims fault` has it: the record of a request does
/// not have the process to which it was sent, that of the answer has this text.
fn named(text: &str, process: &str) -> String {
    let mut words: Vec<&str> = text.split_whitespace().collect();
    words.insert(words.len().min(1), process);
    words.join(" ")
}

fn forms() -> String {
    format!("slow CYCLES (1 to {SLOWEST_CYCLES}), nan or frozen, followed by nothing, `off` or `for SECONDS`")
}

/// Parses a request: the fault, `None` for none, and its duration, s.
fn parse(text: &str) -> Option<(Option<Fault>, Option<f64>)> {
    let words: Vec<&str> = text.split_whitespace().collect();
    let (words, for_s) = match words.as_slice() {
        [words @ .., "for", seconds] => {
            (words, Some(seconds.parse::<f64>().ok().filter(|s| *s > 0.0 && *s <= LONGEST_S)?))
        }
        words => (words, None),
    };
    let fault = match words {
        ["slow" | "nan" | "frozen", "off"] if for_s.is_none() => None,
        ["slow", cycles] => {
            Some(Fault::Slow(cycles.parse().ok().filter(|cycles| (1..=SLOWEST_CYCLES).contains(cycles))?))
        }
        ["nan"] => Some(Fault::Nan),
        ["frozen"] => Some(Fault::Frozen),
        _ => return None,
    };
    Some((fault, for_s))
}

/// Publisher for an output of the control chain, with fault injection; created by [`crate::Chassis::output`].
#[derive(Debug)]
pub struct Output<T: Message> {
    port: Publisher<T>,
    faulty: Option<FaultyOutput<T>>,
}

/// State of the fault injection for one output.
#[derive(Debug)]
struct FaultyOutput<T> {
    fault: Rc<Cell<Option<Fault>>>,
    /// The last sample published without a fault.
    last: Option<T>,
    /// Delayed samples, oldest first.
    delayed: VecDeque<T>,
    /// Offset and size of each floating-point field, bytes.
    float_fields: Vec<(usize, usize)>,
}

impl<T: Message> Output<T> {
    pub(crate) fn new(port: Publisher<T>, fault_injector: Option<&OutputFaultInjector>) -> Self {
        let faulty = fault_injector.map(|fault_injector| FaultyOutput {
            fault: Rc::clone(&fault_injector.fault),
            last: None,
            delayed: VecDeque::with_capacity(SLOWEST_CYCLES + 1),
            float_fields: float_fields::<T>(),
        });
        Self { port, faulty }
    }

    /// Publishes a sample as [`Publisher::send`], or what the present fault makes of it.
    ///
    /// # Errors
    /// Those of publishing.
    pub fn send(&mut self, sample: &mut T) -> Result<(), BusError> {
        let output = match &mut self.faulty {
            Some(faulty) => faulty.apply(sample),
            None => Some(*sample),
        };
        if let Some(mut output) = output {
            self.port.send(&mut output)?;
        }
        Ok(())
    }
}

impl<T: Message> FaultyOutput<T> {
    /// Returns the sample to publish instead of this one, if any.
    fn apply(&mut self, sample: &T) -> Option<T> {
        let fault = self.fault.get();
        if !matches!(fault, Some(Fault::Slow(_))) {
            self.delayed.clear();
        }
        match fault {
            None => {
                self.last = Some(*sample);
                self.last
            }
            Some(Fault::Frozen) => self.last,
            Some(Fault::Nan) => {
                let mut wrong = *sample;
                let bytes = bytemuck::bytes_of_mut(&mut wrong);
                // All bits set is NaN, in single and double precision.
                for &(offset, size) in &self.float_fields {
                    bytes[offset..][..size].fill(0xff);
                }
                Some(wrong)
            }
            Some(Fault::Slow(cycles)) => {
                self.delayed.push_back(*sample);
                if self.delayed.len() > cycles { self.delayed.pop_front() } else { None }
            }
        }
    }
}

/// Returns offset and size of each floating-point field of a type, bytes.
fn float_fields<T: Message>() -> Vec<(usize, usize)> {
    let schema = Schema::parse(T::schema());
    let fields = schema.iter().flat_map(Schema::fields);
    let floats = fields.filter(|field| matches!(field.primitive, Primitive::Float32 | Primitive::Float64));
    floats.map(|field| (field.offset, field.size())).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use messages::NodeEstimate;

    fn estimate(cycle: u64) -> NodeEstimate {
        let mut estimate = NodeEstimate { position_m: [1.0, 2.0, 3.0], valid: 1, ..NodeEstimate::default() };
        estimate.header.cycle = cycle;
        estimate
    }

    #[test]
    fn each_fault_has_its_effect_on_the_output() {
        let fault = Rc::new(Cell::new(None));
        let mut faulty = FaultyOutput {
            fault: Rc::clone(&fault),
            last: None,
            delayed: VecDeque::new(),
            float_fields: float_fields::<NodeEstimate>(),
        };
        let mut output = |present, cycle| {
            fault.set(present);
            faulty.apply(&estimate(cycle))
        };
        assert_eq!(output(None, 1), Some(estimate(1)));
        let wrong = output(Some(Fault::Nan), 2).unwrap();
        assert!(wrong.position_m.iter().chain(&wrong.covariance_m2).chain(&wrong.tension_n).all(|x| x.is_nan()));
        assert_eq!((wrong.header, wrong.valid, wrong.incarnation), (estimate(2).header, 1, 0));
        assert_eq!(output(Some(Fault::Frozen), 3), Some(estimate(1)));
        let late: Vec<Option<u64>> =
            (4..8).map(|cycle| output(Some(Fault::Slow(2)), cycle).map(|late| late.header.cycle)).collect();
        assert_eq!(late, [None, None, Some(4), Some(5)]);
        assert_eq!(output(None, 8), Some(estimate(8)));
        assert_eq!(output(Some(Fault::Slow(1)), 9), None);
    }

    #[test]
    fn the_answer_to_a_request_names_the_process() {
        assert_eq!(named("slow 10 for 0.5", "controller"), "slow controller 10 for 0.5");
        assert_eq!(named(" nan", "estimator-b"), "nan estimator-b");
    }

    #[test]
    fn a_request_is_parsed_or_rejected() {
        assert_eq!(parse("slow 10"), Some((Some(Fault::Slow(10)), None)));
        assert_eq!(parse(" nan for 0.5 "), Some((Some(Fault::Nan), Some(0.5))));
        assert_eq!(parse("frozen off"), Some((None, None)));
        for text in ["", "slow", "slow 0", "slow 101", "slow -1", "nan for 0", "nan for NaN", "nan off for 2", "kill"] {
            assert_eq!(parse(text), None, "{text}");
        }
    }
}
