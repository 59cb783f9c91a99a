//! Places kept free: who only looks on never takes the last place of who controls.
//!
//! A channel has a fixed number of places, and a process that hangs keeps its own. So each kind of participant leaves some to the kinds after
//! it. The kind stands in the name of a port, where every other process reads it.

use iceoryx2::prelude::{PortName, SemanticStringError};

/// Who takes a place.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
pub enum Party {
    /// Looks on: `nims channel echo`, `nims top`, the viewer.
    Guest,
    /// An operator's command, for as long as it takes: `nims status`, `nims swap`.
    Command,
    /// A process of the robot, and what stops it.
    #[default]
    Member,
}

impl Party {
    /// Of so many places, how many this kind and those before it may have together.
    #[must_use]
    pub const fn ceiling(self, limit: usize) -> usize {
        match self {
            Self::Guest => limit * 2 / 5,
            Self::Command => limit * 2 / 3,
            Self::Member => limit,
        }
    }

    /// Shared memory that has to be left after it has taken what it needs, bytes.
    pub(crate) const fn margin(self) -> u64 {
        match self {
            Self::Guest => 4 << 20,
            Self::Command => 2 << 20,
            Self::Member => 1 << 20,
        }
    }

    pub(crate) fn port_name(self, process: &str) -> Result<PortName, SemanticStringError> {
        match self.mark() {
            Some(mark) => PortName::new(&format!("{mark}{process}")),
            None => PortName::new(process),
        }
    }

    /// What stands before the name of its ports.
    const fn mark(self) -> Option<char> {
        match self {
            Self::Guest => Some('?'),
            Self::Command => Some('>'),
            Self::Member => None,
        }
    }

    fn of(name: &PortName) -> Self {
        [Self::Guest, Self::Command]
            .into_iter()
            .find(|party| party.mark().is_some_and(|mark| name.as_str().starts_with(mark)))
            .unwrap_or_default()
    }

    /// Whether so many ports of these names are within what this kind may have; a member is only bound by the limit itself.
    pub(crate) fn within(self, names: &[PortName], limit: usize, coming: usize) -> bool {
        let taken = names.iter().filter(|name| Self::of(name) <= self).count();
        self == Self::Member || taken + coming <= self.ceiling(limit)
    }
}

/// Why there is no port.
pub(crate) enum Refused<E> {
    /// This kind has its places already: so many.
    NoPlace(usize),
    /// iceoryx2 refused.
    Error(E),
}

/// What a listing of ports gives.
pub(crate) fn listed<T>(list: impl FnOnce(&mut dyn FnMut(T))) -> Vec<T> {
    let mut ports = Vec::new();
    list(&mut |port| ports.push(port));
    ports
}

#[cfg(test)]
mod tests {
    use super::*;
    use messages::CHANNELS;

    fn port(party: Party) -> PortName {
        party.port_name("x").unwrap_or_else(|_| PortName::new_empty())
    }

    #[test]
    fn each_kind_leaves_places_to_the_next() {
        for limit in 1..100 {
            let [guests, commands, all] = [Party::Guest, Party::Command, Party::Member].map(|one| one.ceiling(limit));
            assert!(guests <= commands && commands <= all && all == limit);
            assert!(limit < 8 || (guests >= 3 && commands - guests >= 2 && all - commands >= 3), "{limit}");
        }
    }

    /// Five processes of a robot hear what `nims set` says on `system/config/nims`, and one that is started again hears it beside them.
    #[test]
    fn the_robot_has_six_places_on_every_channel() {
        for row in CHANNELS {
            let limit = row.quality.subscribers;
            assert!(limit - Party::Command.ceiling(limit) >= 6, "{}", row.pattern);
        }
    }

    #[test]
    fn a_kind_counts_itself_and_those_before_it() {
        let taken: Vec<PortName> =
            [Party::Guest, Party::Guest, Party::Guest, Party::Command, Party::Member].map(port).to_vec();
        assert!(!Party::Guest.within(&taken, 8, 1) && Party::Guest.within(&taken, 8, 0));
        assert!(Party::Command.within(&taken, 8, 1) && !Party::Command.within(&taken, 8, 2));
        assert!(Party::Member.within(&taken, 5, 1), "iceoryx2 itself says that it is full");
    }
}
