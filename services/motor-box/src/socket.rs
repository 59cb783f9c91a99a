//! The machine without real time: its ports as the far ends of in-process pipes.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use serial::{Device, Paced};

use crate::Machine;

/// A machine that several pipes share.
#[derive(Debug, Clone)]
pub struct Shared(Arc<Mutex<Machine>>);

impl Shared {
    /// Shares `machine` out.
    pub fn new(machine: Machine) -> Self {
        Self(Arc::new(Mutex::new(machine)))
    }

    /// One port of it, to be the far end of a [`serial::Pipe`].
    pub fn socket(&self, port: usize) -> Socket {
        Socket { machine: self.clone(), port }
    }

    /// The machine, for looking at truth and for faults.
    pub fn lock(&self) -> MutexGuard<'_, Machine> {
        // A test that panicked elsewhere leaves a machine that is as good as any.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// One port of a shared machine.
///
/// Pipes have clocks of their own. The machine goes by the one that is ahead; a byte from another one arrives when the machine
/// sees it.
#[derive(Debug)]
pub struct Socket {
    machine: Shared,
    port: usize,
}

impl Device for Socket {
    fn receive(&mut self, now_ns: u64, byte: u8, reply: &mut Paced) {
        // The machine refuses only what is not a number, and no packet can say that.
        let _ = self.machine.lock().receive(self.port, now_ns, byte, reply);
    }

    fn advance(&mut self, now_ns: u64) {
        let _ = self.machine.lock().advance(now_ns);
    }
}
