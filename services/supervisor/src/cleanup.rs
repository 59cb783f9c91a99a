//! Removes what killed processes leave in shared memory: it occupies places that their successors need.
//!
//! A sweep can take seconds, so it runs on its own thread.

use bus::{BusError, Domain, SweepReport, clock};
use std::sync::mpsc::{Receiver, TryRecvError, sync_channel};

/// Time between two sweeps without a request, ns: commands and observers die too, and nothing reports it.
const EVERY_NS: u64 = 10_000_000_000;
/// Pause before a failed sweep is repeated, ns.
const RETRY_NS: u64 = 2_000_000_000;

/// Sweeps a domain on request, and now and then without one.
pub struct Cleanup {
    domain: Domain,
    due_ns: u64,
    running: Option<Receiver<Result<SweepReport, BusError>>>,
}

impl Cleanup {
    /// Without a pending request.
    pub fn new(domain: &Domain) -> Self {
        Self { domain: domain.clone(), due_ns: clock::now_ns() + EVERY_NS, running: None }
    }

    /// Requests a sweep, because a process has died.
    pub fn request(&mut self, now_ns: u64) {
        self.due_ns = now_ns;
    }

    /// Starts a sweep that is due, or collects the result of the last one: why it failed.
    pub fn poll(&mut self, now_ns: u64) -> Option<String> {
        let result = match self.running.as_ref().map(Receiver::try_recv) {
            Some(Err(TryRecvError::Empty)) => return None,
            Some(Ok(Ok(_))) | None => None,
            Some(Ok(Err(error))) => Some(error.to_string()),
            Some(Err(TryRecvError::Disconnected)) => Some("the cleanup thread ended early".to_owned()),
        };
        let has_ended = self.running.take().is_some();
        if has_ended && self.due_ns > now_ns {
            // A sweep that takes seconds is not followed by the next one at once.
            self.due_ns = now_ns + EVERY_NS;
        }
        if result.is_some() {
            self.due_ns = now_ns + RETRY_NS;
        } else if self.due_ns <= now_ns {
            self.due_ns = now_ns + EVERY_NS;
            let (domain, (done, running)) = (self.domain.clone(), sync_channel(1));
            let spawned = std::thread::Builder::new().name("cleanup".to_owned()).spawn(move || {
                let _ = done.send(domain.sweep());
            });
            match spawned {
                Ok(_) => self.running = Some(running),
                Err(_) => self.due_ns = now_ns + RETRY_NS,
            }
        }
        result
    }
}
