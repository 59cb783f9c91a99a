//! The control that a person holds: the newest of what the gateway has not got yet, and nothing before it.

use gateway_protocol::Call;
use messages::Request;
use robot_state::Reason;
use serde::Deserialize;
use std::sync::{Mutex, MutexGuard, PoisonError};
use tokio::sync::Notify;

/// Age from which a sign of a browser does not count, ms. The gateway counts the same time from its arrival here.
pub(crate) const OLD_MS: f64 = 300.0;
/// Age of the picture from which no motion is steered by it, ms: the page dims it then.
pub(crate) const UNSEEN_MS: f64 = 1000.0;
/// Number of calls whose reply no browser waits for; those of browsers count from 1.
const UNHEARD: u64 = 0;

/// Time of this server as a browser knows it, ms.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Sign {
    /// When it was made.
    pub(crate) made_ms: f64,
    /// Of when the robot is that the person could see: the newest state, less its age.
    pub(crate) seen_ms: f64,
}

impl Sign {
    /// Why it does not count; `None` if it does.
    pub(crate) fn too_old(self, now_ms: f64) -> Option<Reason> {
        let (made_ms, seen_ms) = (now_ms - self.made_ms, now_ms - self.seen_ms);
        // What is no number is old.
        match (made_ms < OLD_MS, seen_ms < UNSEEN_MS) {
            (true, true) => None,
            (false, _) => Some(Reason::HeldTooOld { age_s: made_ms * 1e-3 }),
            (true, false) => Some(Reason::HeldUnseen { age_s: seen_ms * 1e-3 }),
        }
    }
}

/// A motion that is requested.
#[derive(Debug)]
pub(crate) struct Begins {
    pub(crate) id: u64,
    pub(crate) request: Request,
    /// When the request came, and the first one of the same press, ns.
    pub(crate) at_ns: u64,
    pub(crate) pressed_ns: u64,
}

/// The newest press of a browser: its number and when its first attempt came, ns. It replaces those before it.
#[derive(Debug, Default)]
pub(crate) struct Presses(u64, u64);

impl Presses {
    /// When the first attempt of a press came, of which one comes now.
    pub(crate) fn at_ns(&mut self, number: u64, now_ns: u64) -> u64 {
        if number > self.0 {
            *self = Self(number, now_ns);
        }
        // An attempt of an older press is older than any stop.
        if number == self.0 { self.1 } else { 0 }
    }
}

#[derive(Debug, Default)]
struct Slot {
    /// A stop that ends what was sent before it.
    stop: Option<Request>,
    /// Number of stops.
    stops: u64,
    begins: Option<Begins>,
    beat_ns: Option<u64>,
    released: bool,
}

/// One place for what a person does with a control; what is newer replaces what waits.
#[derive(Debug, Default)]
pub(crate) struct Control {
    slot: Mutex<Slot>,
    notify: Notify,
}

impl Control {
    fn slot(&self) -> MutexGuard<'_, Slot> {
        self.slot.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A motion is requested. Returns the number of a request that it replaces.
    pub(crate) fn hold(&self, begins: Begins) -> Option<u64> {
        let mut slot = self.slot();
        let before = slot.begins.replace(begins);
        (slot.beat_ns, slot.released) = (None, false);
        self.notify.notify_one();
        before.map(|begins| begins.id)
    }

    /// The control was held at that instant, ns.
    pub(crate) fn beat(&self, at_ns: u64) {
        self.slot().beat_ns = Some(at_ns);
        self.notify.notify_one();
    }

    /// The control was released. Returns the number of a request that is not made any more.
    pub(crate) fn release(&self) -> Option<u64> {
        let mut slot = self.slot();
        let before = slot.begins.take();
        (slot.beat_ns, slot.released) = (None, true);
        self.notify.notify_one();
        before.map(|begins| begins.id)
    }

    /// The robot was told to stop, over another connection. Returns the number of a request that is not made any more.
    /// `sent`: requests without an answer were sent, which the gateway may read after the stop: then it is told again.
    pub(crate) fn stop(&self, request: &Request, sent: bool) -> Option<u64> {
        let mut slot = self.slot();
        let before = slot.begins.take();
        (slot.beat_ns, slot.released) = (None, slot.released || before.is_some());
        slot.stops += 1;
        if sent {
            slot.stop = Some(request.clone());
        }
        self.notify.notify_one();
        before.map(|begins| begins.id)
    }

    /// Number of stops so far: what was asked before the last one is not sent any more.
    pub(crate) fn stops(&self) -> u64 {
        self.slot().stops
    }

    /// Waits for something that [`Control::take`] returns.
    pub(crate) async fn changed(&self) {
        self.notify.notified().await;
    }

    /// The next call to the gateway.
    pub(crate) fn take(&self) -> Option<Call> {
        let mut slot = self.slot();
        if let Some(request) = slot.stop.take() {
            return Some(Call::Ask { id: UNHEARD, request, process: None, held: false, at_ns: None, pressed_ns: None });
        }
        if std::mem::take(&mut slot.released) {
            return Some(Call::Release { id: UNHEARD });
        }
        if let Some(Begins { id, request, at_ns, pressed_ns }) = slot.begins.take() {
            let (at_ns, pressed_ns) = (Some(at_ns), Some(pressed_ns));
            return Some(Call::Ask { id, request, process: None, held: true, at_ns, pressed_ns });
        }
        slot.beat_ns.take().map(|at_ns| Call::Beat { at_ns: Some(at_ns) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn jog(id: u64, at_ns: u64) -> Begins {
        Begins { id, request: Request::Jog { cable: 1, distance_m: 0.1 }, at_ns, pressed_ns: 4 }
    }

    #[test]
    fn only_the_newest_waits() {
        let control = Control::default();
        assert_eq!((control.take(), control.hold(jog(1, 5))), (None, None));
        for at_ns in 6..100 {
            control.beat(at_ns);
        }
        let (request, at_ns, pressed_ns) = (jog(1, 5).request, Some(5), Some(4));
        let held = Call::Ask { id: 1, request, process: None, held: true, at_ns, pressed_ns };
        assert_eq!(control.take(), Some(held));
        assert_eq!((control.take(), control.take()), (Some(Call::Beat { at_ns: Some(99) }), None));
        // A motion that is released or replaced before the gateway got it is not requested.
        assert_eq!((control.hold(jog(2, 100)), control.hold(jog(3, 101))), (None, Some(2)));
        assert_eq!(control.release(), Some(3));
        control.beat(102);
        assert_eq!(control.take(), Some(Call::Release { id: UNHEARD }));
        // A sign that follows belongs to no motion, and begins none.
        assert_eq!((control.take(), control.take()), (Some(Call::Beat { at_ns: Some(102) }), None));
    }

    #[test]
    fn all_attempts_of_a_press_are_as_old_as_the_first_one() {
        let mut presses = Presses::default();
        assert_eq!([presses.at_ns(1, 10), presses.at_ns(1, 20), presses.at_ns(3, 30)], [10, 10, 30]);
        assert_eq!([presses.at_ns(1, 40), presses.at_ns(3, 50), presses.at_ns(4, 60)], [0, 30, 60]);
    }

    #[test]
    fn a_stop_comes_before_what_waits_and_ends_what_was_sent() {
        let control = Control::default();
        control.hold(jog(1, 5));
        assert_eq!((control.stop(&Request::Stop, false), control.stops()), (Some(1), 1));
        assert_eq!((control.take(), control.take()), (Some(Call::Release { id: UNHEARD }), None));
        control.hold(jog(2, 5));
        control.take();
        assert_eq!(control.stop(&Request::Estop, true), None);
        control.hold(jog(3, 6));
        let told = control.take();
        assert!(matches!(told, Some(Call::Ask { request: Request::Estop, held: false, .. })), "{told:?}");
        assert!(matches!(control.take(), Some(Call::Ask { id: 3, held: true, .. })));
    }

    #[test]
    fn a_sign_counts_while_it_is_young_and_the_picture_is_seen() {
        let old = |made_ms, seen_ms| Sign { made_ms, seen_ms }.too_old(10_000.0);
        assert_eq!((old(9_900.0, 9_800.0), old(9_701.0, 9_001.0)), (None, None));
        assert_eq!(old(9_700.0, 9_900.0), Some(Reason::HeldTooOld { age_s: 0.3 }));
        assert_eq!(old(9_900.0, 9_000.0), Some(Reason::HeldUnseen { age_s: 1.0 }));
        assert_eq!(old(10_050.0, 10_050.0), None);
        assert!(old(f64::NAN, 9_900.0).is_some() && old(9_900.0, f64::NAN).is_some());
    }
}
