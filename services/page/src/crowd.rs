//! Those who have come and have no place yet. Where they are too many, the oldest silent one makes room for the next,
//! so that nothing is gained by coming early and saying nothing.

use std::collections::BTreeMap;
use std::net::{IpAddr, Ipv6Addr};
use std::sync::Arc;
use tokio::sync::Notify;

/// One of them.
#[derive(Debug)]
struct Guest {
    network: IpAddr,
    /// A holder of a token has come from its address.
    known: bool,
    /// Nothing is being done for it.
    silent: bool,
    leaves: Arc<Notify>,
}

/// All of them, by numbers that grow.
#[derive(Debug, Default)]
pub(crate) struct Crowd {
    guests: BTreeMap<u64, Guest>,
    last: u64,
}

/// How many there may be: of all, and of one network.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Most {
    pub(crate) all: usize,
    pub(crate) own: usize,
}

impl Crowd {
    /// Admits one of that network, which is silent at first. `known`: a holder of a token has come from its address;
    /// such a one yields to no stranger. Returns its number and what tells it to leave; `None` if there is no room.
    pub(crate) fn enter(&mut self, network: IpAddr, known: bool, most: Most) -> Option<(u64, Arc<Notify>)> {
        if self.count(network) >= most.own {
            let own = self.guests.iter().filter(|(_, one)| one.silent && one.network == network && one.known <= known);
            let first = own.min_by_key(|(number, one)| (one.known, **number)).map(|(number, _)| *number);
            self.send_away(first?);
        }
        if self.guests.len() >= most.all {
            let strangers = self.guests.iter().filter(|(_, one)| one.silent && !one.known);
            // Of the network that has most of them.
            let first = strangers.max_by_key(|(number, one)| (self.count(one.network), u64::MAX - **number));
            let first = first.map(|(number, _)| *number);
            self.send_away(first?);
        }
        self.last += 1;
        let leaves = Arc::new(Notify::new());
        self.guests.insert(self.last, Guest { network, known, silent: true, leaves: Arc::clone(&leaves) });
        Some((self.last, leaves))
    }

    /// How many are of that network.
    fn count(&self, network: IpAddr) -> usize {
        self.guests.values().filter(|one| one.network == network).count()
    }

    fn send_away(&mut self, number: u64) {
        if let Some(guest) = self.guests.remove(&number) {
            guest.leaves.notify_one();
        }
    }

    /// Says whether something is being done for that one: then it is not sent away.
    pub(crate) fn set_silent(&mut self, number: u64, silent: bool) {
        if let Some(guest) = self.guests.get_mut(&number) {
            guest.silent = silent;
        }
    }

    /// That one has left, or has a place.
    pub(crate) fn leave(&mut self, number: u64) {
        self.guests.remove(&number);
    }
}

/// What counts as one address: of IPv6 a network of 64 bits, in which one machine may have any number of addresses.
pub(crate) fn network(address: IpAddr) -> IpAddr {
    match address.to_canonical() {
        IpAddr::V6(six) if !six.is_loopback() => {
            let [a, b, c, d, ..] = six.segments();
            Ipv6Addr::new(a, b, c, d, 0, 0, 0, 0).into()
        }
        other => other,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use futures_util::FutureExt;

    const MOST: Most = Most { all: 8, own: 3 };

    fn from(last: u8) -> IpAddr {
        IpAddr::from([10, 0, 0, last])
    }

    fn numbers(crowd: &Crowd) -> Vec<u64> {
        crowd.guests.keys().copied().collect()
    }

    /// Whether it was told to leave.
    fn is_told(leaves: &Notify) -> bool {
        leaves.notified().now_or_never().is_some()
    }

    #[test]
    fn the_oldest_silent_one_makes_room() {
        let mut crowd = Crowd::default();
        let first = crowd.enter(from(1), false, MOST).unwrap();
        assert!((2..=3).all(|number| crowd.enter(from(1), false, MOST).is_some_and(|one| one.0 == number)));
        assert!(!is_told(&first.1));
        // Of its own network while that has too many.
        assert_eq!(crowd.enter(from(1), false, MOST).unwrap().0, 4);
        assert!(is_told(&first.1) && numbers(&crowd) == [2, 3, 4]);
        // One for which something is being done stays.
        crowd.set_silent(2, false);
        crowd.enter(from(1), false, MOST).unwrap();
        assert_eq!(numbers(&crowd), [2, 4, 5]);
        // With many networks, of that which has most.
        assert!((2..=6).all(|last| crowd.enter(from(last), false, MOST).is_some()));
        crowd.enter(from(7), false, MOST).unwrap();
        assert_eq!(numbers(&crowd), [2, 5, 6, 7, 8, 9, 10, 11]);
        // Each number is free once.
        numbers(&crowd).into_iter().for_each(|number| crowd.leave(number));
        assert!(crowd.guests.is_empty());
    }

    #[test]
    fn any_number_of_strangers_keeps_no_one_out_and_sends_no_known_one_away() {
        let strangers = Most { all: 5, own: 3 };
        let mut crowd = Crowd::default();
        let (known, leaves) = crowd.enter(from(200), true, MOST).unwrap();
        for at in 0..1000_u32 {
            assert!(crowd.enter(from((at % 100) as u8), false, strangers).is_some(), "{at}");
            assert!(crowd.guests.len() <= strangers.all && crowd.guests.contains_key(&known));
        }
        assert!(!is_told(&leaves));
        // A stranger behind the address of a known one takes none of its places.
        for _ in 0..10 {
            crowd.enter(from(200), false, strangers).unwrap();
            assert!(crowd.guests.contains_key(&known));
        }
        // A known one sends a stranger away first, and an older known one only of its own network.
        assert!((0..10).all(|_| crowd.enter(from(200), true, MOST).is_some()));
        assert!(crowd.count(from(200)) == MOST.own && is_told(&leaves));
        let mut known = Crowd::default();
        assert!((0..8).all(|last| known.enter(from(last), true, MOST).is_some()));
        assert!(known.enter(from(9), true, MOST).is_none() && known.enter(from(9), false, strangers).is_none());
    }

    #[test]
    fn addresses_of_a_network_of_ipv6_count_as_one() {
        let of = |text: &str| network(text.parse().unwrap());
        assert_eq!(of("2001:db8::1"), of("2001:db8::ffff:2"));
        assert_ne!(of("2001:db8::1"), of("2001:db8:0:1::1"));
        assert_eq!(of("::ffff:10.0.0.66"), of("10.0.0.66"));
        assert_ne!(of("10.0.0.66"), of("10.0.0.67"));
        assert!(of("::1").is_loopback());
    }
}
