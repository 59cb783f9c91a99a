//! Evidence from the kernel about motor-io and the processes that answer it, written into
//! [`MotorInput`] once per cycle.
//!
//! The numbers are cumulative over a life of motor-io, never decrease, and are 0 where the kernel
//! does not provide them.

use bus::clock::now_ns;
use evidence::{Pressure, Thread};
use messages::{CONTROLLERS, ESTIMATORS, MotorCommand, MotorInput, NodeEstimate, ROLE_SLOTS, SLOTS};

/// Cycles between two readings of the machine's pressure, which cost more than a thread's and change slowly.
const PRESSURE_EVERY: u64 = 10;

/// Reader of the kernel's evidence. It allocates only for the first reading of another thread.
#[derive(Debug)]
pub struct Evidence {
    own: Option<Thread>,
    pressure: Option<Pressure>,
    pressure_us: u64,
    threads: [ChainThread; ROLE_SLOTS],
    /// Per estimator: cycle of its newest estimate, and its publication time, ns.
    estimated: [(u64, u64); SLOTS],
}

/// Thread of a controller or an estimator.
#[derive(Debug, Default)]
struct ChainThread {
    number: u32,
    thread: Option<Thread>,
    /// The kernel's counter for this thread at the previous reading, ns.
    counted_ns: Option<u64>,
    delay_ns: u64,
}

impl Evidence {
    /// Evidence about the calling thread.
    #[must_use]
    pub fn new() -> Self {
        Self {
            own: Thread::current().ok(),
            pressure: Pressure::open(),
            pressure_us: 0,
            threads: Default::default(),
            estimated: [(0, 0); SLOTS],
        }
    }

    /// Records the thread of a controller that answers.
    pub fn command(&mut self, slot: usize, command: &MotorCommand) {
        self.threads[CONTROLLERS * SLOTS + slot].set_thread(command.thread);
    }

    /// Records the thread of an estimator that answers.
    pub fn estimate(&mut self, slot: usize, estimate: &NodeEstimate) {
        self.threads[ESTIMATORS * SLOTS + slot].set_thread(estimate.thread);
        self.estimated[slot] = (estimate.header.cycle, estimate.header.published_ns);
    }

    /// Reads the evidence and writes it into the input. `published_ns`: publication time of the previous cycle's state,
    /// for which estimators wait.
    pub fn read(&mut self, box_left_out_ns: u64, published_ns: u64, input: &mut MotorInput) {
        let now_ns = now_ns();
        if input.header.cycle % PRESSURE_EVERY == 1 {
            self.pressure_us = self.pressure.as_ref().and_then(Pressure::waiting_us).unwrap_or(self.pressure_us);
        }
        input.pressure_us = self.pressure_us;
        input.run_delay_ns =
            self.own.as_mut().and_then(|own| own.run_delay_since_ns(now_ns, None)).map_or(input.run_delay_ns, known);
        let given_ns = self.given_ns(published_ns, input);
        for ((delay_ns, thread), given_ns) in input.chain_delay_ns.iter_mut().zip(&mut self.threads).zip(given_ns) {
            *delay_ns = thread.poll(now_ns, given_ns);
        }
        input.box_left_out_ns = box_left_out_ns;
    }
}

impl Evidence {
    /// Time since which each thread owes an answer to the previous cycle, ns: an estimator since the state, a
    /// controller since the first estimate.
    fn given_ns(&self, published_ns: u64, input: &MotorInput) -> [Option<u64>; ROLE_SLOTS] {
        if published_ns == 0 {
            return [None; ROLE_SLOTS];
        }
        let (life, cycle) = (input.header.life, input.header.cycle);
        let of_last = |of: u64| of.checked_add(1) == Some(cycle);
        // No estimate is older than its state, whatever its stamp.
        let estimates = self.estimated.iter().filter(|(of, _)| of_last(*of)).map(|(_, at_ns)| published_ns.max(*at_ns));
        let estimated_ns = estimates.min();
        std::array::from_fn(|index| match index.checked_sub(ESTIMATORS * SLOTS) {
            Some(slot) => (!of_last(self.estimated[slot].0)).then_some(published_ns),
            None => {
                let command = &input.command[index - CONTROLLERS * SLOTS];
                let answered = command.header.life == life && of_last(command.based_on_cycle);
                estimated_ns.filter(|_| !answered)
            }
        })
    }
}

impl Default for Evidence {
    fn default() -> Self {
        Self::new()
    }
}

impl ChainThread {
    fn set_thread(&mut self, number: u32) {
        if number != self.number {
            self.number = number;
            self.thread = if number == 0 { None } else { Thread::with_id(number).ok() };
            self.counted_ns = None;
        }
    }

    fn poll(&mut self, now_ns: u64, given_ns: Option<u64>) -> u64 {
        let counted_ns = self.thread.as_mut().and_then(|thread| thread.run_delay_since_ns(now_ns, given_ns));
        if let Some(counted_ns) = counted_ns {
            let before_ns = self.counted_ns.replace(counted_ns).unwrap_or(counted_ns);
            self.delay_ns = known(self.delay_ns) + (counted_ns - before_ns);
        }
        self.delay_ns
    }
}

/// Distinguishes a thread that has never waited (1 ns) from a kernel that provides no numbers (0).
fn known(delay_ns: u64) -> u64 {
    delay_ns.max(1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn statistics_of_an_answering_thread_are_read_and_those_of_a_dead_one_stay() {
        let mut evidence = Evidence::new();
        let mut input = MotorInput::default();
        let mut child = std::process::Command::new("sleep").arg("100").spawn().unwrap();
        evidence.estimate(1, &NodeEstimate { thread: child.id(), ..NodeEstimate::default() });
        input.header.cycle = 1;
        evidence.read(5, 0, &mut input);
        let first = input;
        assert!(first.run_delay_ns > 0 || Thread::current().is_err());
        assert_eq!((first.box_left_out_ns, first.chain_delay_ns), (5, [0, 0, 0, 1]));
        child.kill().unwrap();
        child.wait().unwrap();
        input.header.cycle = 2;
        evidence.read(6, 0, &mut input);
        assert_eq!((input.chain_delay_ns, input.pressure_us), (first.chain_delay_ns, first.pressure_us));
        assert!(input.run_delay_ns >= first.run_delay_ns);
        // A number without a thread does not reset what the previous thread had waited.
        evidence.estimate(1, &NodeEstimate { thread: u32::MAX >> 1, ..NodeEstimate::default() });
        evidence.read(6, 0, &mut input);
        assert_eq!(input.chain_delay_ns, first.chain_delay_ns);
    }
}
