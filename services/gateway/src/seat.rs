//! Who flies: one person at a time among those who use pages. Another one asks to take over, and both see it.

use robot_state::Reason;
use robot_state::answers::detail;

/// Time in which the one who flies can keep the seat, ns.
const KEPT_NS: u64 = 10_000_000_000;

/// Who flies and who asks to.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(crate) struct Seat {
    flyer: Option<String>,
    /// Who asks to take over, and when that happens, ns.
    asks: Option<(String, u64)>,
}

impl Seat {
    /// Who flies.
    pub(crate) fn flyer(&self) -> Option<&str> {
        self.flyer.as_deref()
    }

    /// Who asks to take over, and the time until that happens, s.
    pub(crate) fn asks(&self, now_ns: u64) -> Option<(&str, f64)> {
        let (user, at_ns) = self.asks.as_ref()?;
        Some((user, at_ns.saturating_sub(now_ns) as f64 * 1e-9))
    }

    /// A user requests something that only the flyer may: that takes a free seat.
    #[allow(clippy::result_large_err)] // it is the answer
    pub(crate) fn request(&mut self, user: &str) -> Result<(), Reason> {
        match &self.flyer {
            Some(flyer) if flyer != user => Err(Reason::SeatTaken { flyer: detail(flyer) }),
            Some(_) => Ok(()),
            None => {
                self.flyer = Some(user.to_owned());
                self.asks = None;
                Ok(())
            }
        }
    }

    /// A user asks to fly.
    #[allow(clippy::result_large_err)] // it is the answer
    pub(crate) fn ask(&mut self, now_ns: u64, user: &str) -> Result<(), Reason> {
        if self.request(user).is_ok() {
            return Ok(());
        }
        match &self.asks {
            Some((other, _)) if other != user => Err(Reason::SeatAsked { asks: detail(other) }),
            Some(_) => Ok(()),
            None => {
                self.asks = Some((user.to_owned(), now_ns.saturating_add(KEPT_NS)));
                Ok(())
            }
        }
    }

    /// Who flies gives the seat to the one who asks, or leaves it.
    pub(crate) fn give(&mut self, user: &str) {
        if self.flyer.as_deref() == Some(user) {
            self.flyer = self.asks.take().map(|(asks, _)| asks);
        }
    }

    /// Who flies keeps the seat, or who asked asks no more.
    pub(crate) fn keep(&mut self, user: &str) {
        if self.flyer.as_deref() == Some(user) || self.asks.as_ref().is_some_and(|(asks, _)| asks == user) {
            self.asks = None;
        }
    }

    /// The last page of a person has gone.
    pub(crate) fn gone(&mut self, user: &str) {
        self.asks.take_if(|(asks, _)| asks == user);
        self.give(user);
    }

    /// Some time has passed: a seat that was not kept is taken over.
    pub(crate) fn tick(&mut self, now_ns: u64) {
        if let Some((user, _)) = self.asks.take_if(|(_, at_ns)| now_ns >= *at_ns) {
            self.flyer = Some(user);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_flies_and_another_takes_over_when_it_is_given_or_not_kept() {
        let mut seat = Seat::default();
        assert!(seat.request("ada").is_ok() && seat.request("ada").is_ok());
        assert_eq!(seat.request("bob"), Err(Reason::SeatTaken { flyer: detail("ada") }));
        assert!(seat.ask(5, "bob").is_ok() && seat.ask(6, "bob").is_ok());
        assert_eq!(seat.ask(7, "eve"), Err(Reason::SeatAsked { asks: detail("bob") }));
        assert_eq!((seat.flyer(), seat.asks(5)), (Some("ada"), Some(("bob", 10.0))));
        // Only the flyer keeps or gives it.
        seat.keep("eve");
        seat.give("eve");
        assert!(seat.asks(5).is_some());
        seat.keep("ada");
        assert_eq!((seat.flyer(), seat.asks(5)), (Some("ada"), None));
        seat.ask(100, "bob").unwrap();
        seat.give("ada");
        assert_eq!((seat.flyer(), seat.asks(100)), (Some("bob"), None));
        seat.ask(200, "ada").unwrap();
        seat.tick(199 + KEPT_NS);
        assert_eq!(seat.flyer(), Some("bob"));
        seat.tick(200 + KEPT_NS);
        assert_eq!(seat.flyer(), Some("ada"));
        // Who goes leaves the seat, and asks no more.
        seat.ask(300, "bob").unwrap();
        seat.gone("bob");
        assert_eq!((seat.flyer(), seat.asks(300)), (Some("ada"), None));
        seat.ask(300, "bob").unwrap();
        seat.gone("ada");
        assert_eq!(seat.flyer(), Some("bob"));
        seat.give("bob");
        assert_eq!(seat, Seat::default());
    }
}
