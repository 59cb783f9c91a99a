//! What is created when it is first needed and then stays; after a failure it is tried again, but not with every call.

use crate::lane::failed;
use bus::BusError;
use messages::RequestAnswer;

/// Least time between a failed attempt and the next one, ns.
const AGAIN_NS: u64 = 1_000_000_000;

/// Something on the bus; or until when it is not tried to create it again, ns, with the reason.
#[derive(Debug)]
pub(crate) struct Lasting<T>(Option<Result<T, (u64, Box<RequestAnswer>)>>);

impl<T> Default for Lasting<T> {
    fn default() -> Self {
        Self(None)
    }
}

impl<T> Lasting<T> {
    /// Returns it, and creates it if it is time.
    ///
    /// # Errors
    /// It cannot be created, or could not a moment ago: the answer.
    pub(crate) fn get(&mut self, create: impl FnOnce() -> Result<T, BusError>) -> Result<&mut T, Box<RequestAnswer>> {
        self.get_at(bus::clock::now_ns, create)
    }

    fn get_at(
        &mut self,
        now_ns: impl Fn() -> u64,
        create: impl FnOnce() -> Result<T, BusError>,
    ) -> Result<&mut T, Box<RequestAnswer>> {
        let stays =
            |kept: &Result<T, (u64, _)>| kept.as_ref().map_or_else(|(again_ns, _)| now_ns() < *again_ns, |_| true);
        let kept = self.0.take().filter(stays);
        let attempt = || {
            let begun_ns = now_ns();
            create().map_err(|error| {
                // An attempt can take seconds. What else waits for this thread has at least as long.
                let ended_ns = now_ns();
                (ended_ns + AGAIN_NS.max(ended_ns.saturating_sub(begun_ns)), failed(&error))
            })
        };
        match self.0.insert(kept.unwrap_or_else(attempt)) {
            Ok(created) => Ok(created),
            Err((_, answer)) => Err(answer.clone()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::cell::Cell;

    fn unjoined() -> BusError {
        BusError::Join { process: "gateway".to_owned(), domain: "lab".to_owned(), why: "it is half made".to_owned() }
    }

    #[test]
    fn a_long_attempt_that_failed_is_repeated_only_after_as_long() {
        let (now_ns, attempts) = (Cell::new(5), Cell::new(0));
        let mut lasting = Lasting::default();
        let mut get = |takes_ns: u64, created: bool| {
            let create = || {
                attempts.set(attempts.get() + 1);
                now_ns.set(now_ns.get() + takes_ns);
                if created { Ok(7) } else { Err(unjoined()) }
            };
            lasting.get_at(|| now_ns.get(), create).copied()
        };
        let long_ns = 4 * AGAIN_NS;
        let refused = get(long_ns, false).unwrap_err();
        // Those that have waited for the attempt get its answer.
        for wait_ns in [0, AGAIN_NS, long_ns - AGAIN_NS - 1] {
            now_ns.set(now_ns.get() + wait_ns);
            assert_eq!(get(long_ns, true).unwrap_err().text, refused.text);
        }
        assert_eq!(attempts.get(), 1);
        now_ns.set(now_ns.get() + 1);
        get(0, false).unwrap_err();
        get(0, true).unwrap_err();
        now_ns.set(now_ns.get() + AGAIN_NS);
        assert_eq!((get(0, true).unwrap(), attempts.get()), (7, 3));
        // What was created stays.
        now_ns.set(now_ns.get() + long_ns);
        assert_eq!((get(0, false).unwrap(), attempts.get()), (7, 3));
    }
}
