//! The machine in simulated time: its ports as the far ends of in-process pipes.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use serial::{Device, WireQueue};

use crate::Machine;

/// A machine that several pipes share.
#[derive(Debug, Clone)]
pub struct Shared(Arc<Mutex<Machine>>);

impl Shared {
    /// Makes `machine` available to several pipes.
    pub fn new(machine: Machine) -> Self {
        Self(Arc::new(Mutex::new(machine)))
    }

    /// A port of it as the far end of a [`serial::Pipe`].
    pub fn socket(&self, port: usize) -> Socket {
        Socket { machine: self.clone(), port }
    }

    /// The machine, for its truth and for faults.
    pub fn lock(&self) -> MutexGuard<'_, Machine> {
        // A test that panicked elsewhere leaves a consistent machine.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// One port of a shared machine.
///
/// Each pipe has its own clock. The machine follows the one that is ahead; a byte from another pipe arrives when the
/// machine receives it.
#[derive(Debug)]
pub struct Socket {
    machine: Shared,
    port: usize,
}

impl Device for Socket {
    fn receive(&mut self, now_ns: u64, byte: u8, reply: &mut WireQueue) {
        // The machine rejects only numbers that are not finite, and no packet can hold one.
        let _ = self.machine.lock().receive(self.port, now_ns, byte, reply);
    }

    fn advance(&mut self, now_ns: u64) {
        let _ = self.machine.lock().advance(now_ns);
    }
}
