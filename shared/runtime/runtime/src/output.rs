//! What a process says to the control chain, and how it is spoilt on request, to see what the others make of it.
//!
//! Only a process of a box with virtual drives takes such a request; on real drives an [`Output`] is its publisher and nothing else.

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

/// Most cycles by which an output can be made late: a second at 100 Hz.
const SLOWEST_CYCLES: usize = 100;
/// Longest time that a fault can be asked for, s.
const LONGEST_S: f64 = 3600.0;

/// How an output can be spoilt: word, what stands behind the process's name, what happens.
pub const OUTPUT_FAULTS: [(&str, &str, &str); 3] = [
    ("slow", "PROCESS CYCLES", "what the process says comes later by so many cycles; for a controller or an estimator"),
    (
        "nan",
        "PROCESS",
        "every number with a fraction that the process says is no number; for a controller or an estimator",
    ),
    ("frozen", "PROCESS", "the process says the same again and again; for a controller or an estimator"),
];

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Fault {
    Slow(usize),
    Nan,
    Frozen,
}

/// Takes requests that spoil the outputs of this process.
#[derive(Debug)]
pub(crate) struct OutputFaultInjector {
    server: Server,
    fault: Rc<Cell<Option<Fault>>>,
    until_ns: u64,
}

impl OutputFaultInjector {
    pub(crate) fn new(bus: &Bus) -> Result<Self, BusError> {
        Ok(Self { server: bus.server(bus.process())?, fault: Rc::default(), until_ns: u64::MAX })
    }

    /// Looks for a request; a spoilt output is put right when its time is over.
    pub(crate) fn look(&mut self) -> Result<(), BusError> {
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
            call.answer(&Reason::FaultDone { fault: detail(text) }.answer())?;
        }
        Ok(())
    }
}

fn forms() -> String {
    format!("slow CYCLES (1 to {SLOWEST_CYCLES}), nan and frozen, behind them `off` or `for SECONDS`")
}

/// What is to be from now on, and for how long, s.
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

/// A publisher of what the control chain goes by; from [`crate::Chassis::output`].
#[derive(Debug)]
pub struct Output<T: Message> {
    port: Publisher<T>,
    spoilt: Option<Spoilt<T>>,
}

/// What is kept to spoil an output.
#[derive(Debug)]
struct Spoilt<T> {
    fault: Rc<Cell<Option<Fault>>>,
    /// The last one that went out as it was meant.
    last: Option<T>,
    /// Not yet let go, oldest first.
    held: VecDeque<T>,
    /// Where the numbers with a fraction stand: offset and bytes.
    fractions: Vec<(usize, usize)>,
}

impl<T: Message> Output<T> {
    pub(crate) fn new(port: Publisher<T>, fault_injector: Option<&OutputFaultInjector>) -> Self {
        let spoilt = fault_injector.map(|fault_injector| Spoilt {
            fault: Rc::clone(&fault_injector.fault),
            last: None,
            held: VecDeque::with_capacity(SLOWEST_CYCLES + 1),
            fractions: fractions::<T>(),
        });
        Self { port, spoilt }
    }

    /// As [`Publisher::send`].
    ///
    /// # Errors
    /// Those of publishing.
    pub fn send(&mut self, sample: &mut T) -> Result<(), BusError> {
        let spoilt = match &mut self.spoilt {
            Some(spoilt) => spoilt.of(sample),
            None => Some(*sample),
        };
        if let Some(mut said) = spoilt {
            self.port.send(&mut said)?;
        }
        Ok(())
    }
}

impl<T: Message> Spoilt<T> {
    /// What goes out instead of this sample.
    fn of(&mut self, sample: &T) -> Option<T> {
        let fault = self.fault.get();
        if !matches!(fault, Some(Fault::Slow(_))) {
            self.held.clear();
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
                for &(offset, size) in &self.fractions {
                    bytes[offset..][..size].fill(0xff);
                }
                Some(wrong)
            }
            Some(Fault::Slow(cycles)) => {
                self.held.push_back(*sample);
                if self.held.len() > cycles { self.held.pop_front() } else { None }
            }
        }
    }
}

/// Every bit set is not a number, single or double.
fn fractions<T: Message>() -> Vec<(usize, usize)> {
    let schema = Schema::parse(T::schema());
    let fields = schema.iter().flat_map(Schema::fields);
    let with_fraction = fields.filter(|field| matches!(field.primitive, Primitive::Float32 | Primitive::Float64));
    with_fraction.map(|field| (field.offset, field.size())).collect()
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
    fn what_is_spoilt_is_what_was_asked_for() {
        let fault = Rc::new(Cell::new(None));
        let mut spoilt = Spoilt {
            fault: Rc::clone(&fault),
            last: None,
            held: VecDeque::new(),
            fractions: fractions::<NodeEstimate>(),
        };
        let mut said = |wanted, cycle| {
            fault.set(wanted);
            spoilt.of(&estimate(cycle))
        };
        assert_eq!(said(None, 1), Some(estimate(1)));
        let wrong = said(Some(Fault::Nan), 2).unwrap();
        assert!(wrong.position_m.iter().chain(&wrong.covariance_m2).chain(&wrong.tension_n).all(|x| x.is_nan()));
        assert_eq!((wrong.header, wrong.valid, wrong.incarnation), (estimate(2).header, 1, 0));
        assert_eq!(said(Some(Fault::Frozen), 3), Some(estimate(1)));
        let late: Vec<Option<u64>> =
            (4..8).map(|cycle| said(Some(Fault::Slow(2)), cycle).map(|late| late.header.cycle)).collect();
        assert_eq!(late, [None, None, Some(4), Some(5)]);
        assert_eq!(said(None, 8), Some(estimate(8)));
        assert_eq!(said(Some(Fault::Slow(1)), 9), None);
    }

    #[test]
    fn a_request_is_understood_or_refused() {
        assert_eq!(parse("slow 10"), Some((Some(Fault::Slow(10)), None)));
        assert_eq!(parse(" nan for 0.5 "), Some((Some(Fault::Nan), Some(0.5))));
        assert_eq!(parse("frozen off"), Some((None, None)));
        for text in ["", "slow", "slow 0", "slow 101", "slow -1", "nan for 0", "nan for NaN", "nan off for 2", "kill"] {
            assert_eq!(parse(text), None, "{text}");
        }
    }
}
