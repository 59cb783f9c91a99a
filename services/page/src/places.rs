//! Places for conversations: a few of one address, and some that only holders of tokens get, so that a stranger in the
//! same network takes none of theirs.

use std::collections::{BTreeMap, VecDeque};
use std::net::IpAddr;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use tokio::sync::Semaphore;

/// Browsers that talk at once. Each has two connections to the gateway; together with those of the observer, of stops
/// and of arriving browsers they are fewer than the 64 that the gateway grants one user.
pub(crate) const BROWSERS: usize = 24;
/// Of them those without a valid token.
pub(crate) const UNPAIRED: usize = 16;
/// Conversations of one address without a valid token: a person has a tablet or two.
pub(crate) const OF_AN_ADDRESS: usize = 6;
/// Browsers whose token is asked about at the gateway at once.
const ARRIVING: usize = 4;
/// Addresses of holders of tokens that are remembered.
const KNOWN: usize = 64;

#[derive(Debug, Default)]
struct Taken {
    /// Conversations without a valid token by address, also those that have not said hello.
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
    /// It counts for its address.
    counts_for: Option<IpAddr>,
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

    /// Begins a conversation; `None` if this address has too many. Programs of this machine have no such limit, because
    /// a proxy before the page acts for many browsers.
    pub(crate) fn begin(self: &Arc<Self>, from: Option<IpAddr>) -> Option<Visit> {
        let counts_for = from.filter(|address| !address.is_loopback());
        if let Some(address) = counts_for {
            let mut taken = self.taken();
            let own = taken.of.entry(address).or_default();
            if *own >= OF_AN_ADDRESS {
                return None;
            }
            *own += 1;
        }
        Some(Visit { conversations: Arc::clone(self), from, counts_for, seated: None })
    }

    /// The turn to ask the gateway about a token.
    pub(crate) fn turn(&self) -> &Semaphore {
        &self.arriving
    }
}

impl Visit {
    /// Takes a place; `paired`: with a valid token. Returns whether there was one.
    pub(crate) fn take_place(&mut self, paired: bool) -> bool {
        let mut taken = self.conversations.taken();
        if taken.paired + taken.unpaired >= BROWSERS || !paired && taken.unpaired >= UNPAIRED {
            return false;
        }
        *(if paired { &mut taken.paired } else { &mut taken.unpaired }) += 1;
        self.seated = Some(paired);
        if paired {
            // Holders of tokens may all be behind one address.
            if let Some(address) = self.counts_for.take() {
                taken.leave(address);
            }
            drop(taken);
            self.from.into_iter().for_each(|address| self.conversations.known.add(address));
        }
        true
    }
}

impl Drop for Visit {
    fn drop(&mut self) {
        let mut taken = self.conversations.taken();
        match self.seated {
            Some(true) => taken.paired -= 1,
            Some(false) => taken.unpaired -= 1,
            None => {}
        }
        if let Some(address) = self.counts_for {
            taken.leave(address);
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
    fn one_that_has_not_said_hello_counts_for_its_address_alone() {
        let conversations = Arc::new(Conversations::default());
        let silent: Vec<_> = std::iter::from_fn(|| conversations.begin(Some(address(1)))).collect();
        assert_eq!(silent.len(), OF_AN_ADDRESS);
        assert_eq!(fill(&conversations, address(2), true).len(), BROWSERS);
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
