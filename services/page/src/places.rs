//! Places for conversations: a few of one address, and some that only holders of tokens get, so that a stranger in the
//! same network takes none of theirs.

use crate::crowd::{Crowd, Most, network};
use std::collections::{BTreeMap, VecDeque};
use std::net::IpAddr;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use tokio::sync::{Notify, Semaphore};

/// Browsers that talk at once. Each has two connections to the gateway; together with those of the observer, of stops
/// and of arriving browsers they are fewer than the 64 that the gateway grants one user.
pub(crate) const BROWSERS: usize = 24;
/// Of them those without a valid token.
pub(crate) const UNPAIRED: usize = 16;
/// Conversations of one address without a valid token: a person has a tablet or two.
pub(crate) const OF_AN_ADDRESS: usize = 6;
/// Conversations that have no place yet: of all, and of one address. A browser says hello at once, so few of them are
/// silent at any time, also where many browsers are behind one address.
const NEW: Most = Most { all: 64, own: 24 };
/// Browsers whose token is asked about at the gateway at once.
const ARRIVING: usize = 4;
/// Addresses of holders of tokens that are remembered.
const KNOWN: usize = 64;

#[derive(Debug, Default)]
struct Taken {
    /// Conversations that have no place yet.
    new: Crowd,
    /// Places of conversations without a valid token by address.
    of: BTreeMap<IpAddr, usize>,
    paired: usize,
    unpaired: usize,
}

impl Taken {
    fn leave(&mut self, address: IpAddr) {
        match self.of.get_mut(&address) {
            Some(count) if *count > 1 => *count -= 1,
            _ => drop(self.of.remove(&address)),
        }
    }
}

/// The places of all conversations.
#[derive(Debug)]
pub(crate) struct Conversations {
    taken: Mutex<Taken>,
    arriving: Semaphore,
    pub(crate) known: Arc<Known>,
}

/// A conversation, with its place once it has one. The place is free again when this is dropped.
#[derive(Debug)]
pub(crate) struct Visit {
    conversations: Arc<Conversations>,
    from: Option<IpAddr>,
    /// The address for which it counts.
    counts_for: Option<IpAddr>,
    /// Its number among those without a place, and what tells it to leave them.
    new: Option<(u64, Arc<Notify>)>,
    /// With a place; whether as one with a valid token.
    seated: Option<bool>,
}

impl Default for Conversations {
    fn default() -> Self {
        Self { taken: Mutex::default(), arriving: Semaphore::new(ARRIVING), known: Arc::default() }
    }
}

impl Conversations {
    fn taken(&self) -> MutexGuard<'_, Taken> {
        self.taken.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Begins a conversation; `None` if too many wait for a place. One that has not said hello is ended if there is no
    /// room for the next. Programs of this machine have no such limit, because a proxy before the page acts for many
    /// browsers.
    pub(crate) fn begin(self: &Arc<Self>, from: Option<IpAddr>) -> Option<Visit> {
        let counts_for = from.filter(|address| !address.is_loopback()).map(network);
        let new = match counts_for {
            // A known address may be that of a stranger too, so it is not preferred.
            Some(address) => Some(self.taken().new.enter(address, false, NEW)?),
            None => None,
        };
        Some(Visit { conversations: Arc::clone(self), from, counts_for, new, seated: None })
    }

    /// The turn to ask the gateway about a token.
    pub(crate) fn turn(&self) -> &Semaphore {
        &self.arriving
    }
}

impl Visit {
    /// Ends when this conversation has to make room for another one.
    pub(crate) async fn sent_away(&self) {
        match &self.new {
            Some((_, leaves)) => leaves.notified().await,
            None => std::future::pending().await,
        }
    }

    /// The browser has said hello, so it is not sent away any more.
    pub(crate) fn said_hello(&self) {
        if let Some((number, _)) = self.new {
            self.conversations.taken().new.set_silent(number, false);
        }
    }

    /// Takes a place; `paired`: with a valid token. Returns whether there was one.
    pub(crate) fn take_place(&mut self, paired: bool) -> bool {
        let mut taken = self.conversations.taken();
        let of_address = |address: &IpAddr| taken.of.get(address).copied().unwrap_or(0);
        let own = self.counts_for.as_ref().map_or(0, of_address);
        let is_full = taken.unpaired >= UNPAIRED || own >= OF_AN_ADDRESS;
        if taken.paired + taken.unpaired >= BROWSERS || !paired && is_full {
            return false;
        }
        if let Some((number, _)) = self.new.take() {
            taken.new.leave(number);
        }
        self.seated = Some(paired);
        if paired {
            taken.paired += 1;
            drop(taken);
            self.from.into_iter().for_each(|address| self.conversations.known.add(address));
        } else {
            // Holders of tokens may all be behind one address, others not.
            taken.unpaired += 1;
            self.counts_for.into_iter().for_each(|address| *taken.of.entry(address).or_default() += 1);
        }
        true
    }
}

impl Drop for Visit {
    fn drop(&mut self) {
        let mut taken = self.conversations.taken();
        match self.seated {
            Some(true) => taken.paired -= 1,
            Some(false) => {
                taken.unpaired -= 1;
                self.counts_for.into_iter().for_each(|address| taken.leave(address));
            }
            None => {}
        }
        if let Some((number, _)) = self.new {
            taken.new.leave(number);
        }
    }
}

/// The addresses from which holders of tokens have come, the latest ones.
#[derive(Debug, Default)]
pub(crate) struct Known(Mutex<VecDeque<IpAddr>>);

impl Known {
    fn add(&self, address: IpAddr) {
        let mut known = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        known.retain(|one| *one != address);
        known.truncate(KNOWN - 1);
        known.push_front(address);
    }

    /// Whether it is one of them, or this machine.
    pub(crate) fn has(&self, address: IpAddr) -> bool {
        address.is_loopback() || self.0.lock().unwrap_or_else(PoisonError::into_inner).contains(&address)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn address(last: usize) -> IpAddr {
        IpAddr::from([10, 0, (last >> 8) as u8, last as u8])
    }

    /// Conversations of that address, until there is no place.
    fn fill(conversations: &Arc<Conversations>, from: IpAddr, paired: bool) -> Vec<Visit> {
        let next = || conversations.begin(Some(from)).and_then(|mut visit| visit.take_place(paired).then_some(visit));
        std::iter::from_fn(next).take(100).collect()
    }

    #[test]
    fn strangers_take_few_places_and_none_of_the_holders_of_tokens() {
        let conversations = Arc::new(Conversations::default());
        let one = fill(&conversations, address(1), false);
        assert_eq!(one.len(), OF_AN_ADDRESS);
        let others: Vec<_> = (2..200).flat_map(|last| fill(&conversations, address(last), false)).collect();
        assert_eq!(one.len() + others.len(), UNPAIRED);
        // Holders of tokens find the rest, also behind one address.
        let holders = fill(&conversations, address(1000), true);
        assert_eq!(holders.len(), BROWSERS - UNPAIRED);
        // Each place is free again.
        drop((one, others, holders));
        assert!(conversations.taken().of.is_empty());
        assert_eq!(fill(&conversations, address(1), false).len(), OF_AN_ADDRESS);
        assert_eq!(fill(&conversations, address(1), true).len(), BROWSERS);
    }

    #[test]
    fn a_paired_browser_finds_its_place_behind_an_address_with_any_number_of_others() {
        let conversations = Arc::new(Conversations::default());
        let unpaired = fill(&conversations, address(1), false);
        assert_eq!(unpaired.len(), OF_AN_ADDRESS);
        // Silent ones of that address and of others make room for one another.
        let silent: Vec<_> = (0..1000).filter_map(|at| conversations.begin(Some(address(1 + at % 7)))).collect();
        assert_eq!(silent.len(), 1000);
        let mut paired = conversations.begin(Some(address(1))).unwrap();
        assert!(paired.take_place(true));
        drop((unpaired, silent));
        assert!(conversations.taken().of.is_empty());
        drop(paired);
        // Those that have said hello wait for the gateway; their number is bounded, and each of them stays.
        let said = |from| conversations.begin(Some(from)).inspect(Visit::said_hello);
        let waiting: Vec<_> = std::iter::from_fn(|| said(address(1))).take(100).collect();
        assert_eq!(waiting.len(), NEW.own);
        assert!(conversations.begin(Some(address(1))).is_none() && conversations.begin(Some(address(2))).is_some());
        drop(waiting);
        assert_eq!(fill(&conversations, address(2), true).len(), BROWSERS);
    }

    #[test]
    fn addresses_of_one_network_of_ipv6_have_the_places_of_one() {
        let conversations = Arc::new(Conversations::default());
        let six = |last: u16| IpAddr::from([0x2001, 0xdb8, 0, 0, 0, 0, 0, last]);
        let places: Vec<_> = (1..100).flat_map(|last| fill(&conversations, six(last), false)).collect();
        assert_eq!(places.len(), OF_AN_ADDRESS);
        // What is known is the address alone.
        drop(places);
        assert_eq!(fill(&conversations, six(1), true).len(), BROWSERS);
        assert!(conversations.known.has(six(1)) && !conversations.known.has(six(2)));
    }

    #[test]
    fn programs_of_this_machine_have_no_limit_of_an_address() {
        let conversations = Arc::new(Conversations::default());
        // A proxy on this machine acts for many.
        let here = IpAddr::from([127, 0, 0, 1]);
        assert_eq!(fill(&conversations, here, false).len(), UNPAIRED);
    }

    #[test]
    fn the_latest_addresses_of_holders_are_known() {
        let conversations = Arc::new(Conversations::default());
        for last in 0..3 * KNOWN {
            assert_eq!(fill(&conversations, address(last), true).len(), BROWSERS);
        }
        let known = |last| conversations.known.has(address(last));
        assert!(known(3 * KNOWN - 1) && known(2 * KNOWN) && !known(2 * KNOWN - 1) && !known(0));
        assert!(conversations.known.has(IpAddr::from([127, 0, 0, 1])));
        let stranger = fill(&conversations, address(9999), false);
        assert!(!known(9999), "{}", stranger.len());
    }
}
