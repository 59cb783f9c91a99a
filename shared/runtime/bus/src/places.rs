//! Reserved places: an observer never takes the last place of a control process.
//!
//! A channel has a fixed number of places, and a process that hangs keeps its place. So each kind of participant leaves
//! some places to more important kinds. The name of a port contains the kind, so that other processes can read it.

use iceoryx2::prelude::{PortName, SemanticStringError};

/// Kind of participant, in ascending order of importance.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
pub enum Participant {
    /// An observer: `nims channel echo`, `nims top`, the viewer.
    Guest,
    /// A command of an operator: `nims status`, `nims swap`.
    Command,
    /// A process of the robot, or a command that stops the robot.
    #[default]
    Member,
}

impl Participant {
    /// Returns how many of `limit` places this kind and the less important kinds may have together.
    #[must_use]
    pub const fn ceiling(self, limit: usize) -> usize {
        match self {
            Self::Guest => limit * 2 / 5,
            Self::Command => limit * 2 / 3,
            Self::Member => limit,
        }
    }

    /// Shared memory that must remain free after an allocation by this kind, bytes.
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

    /// Prefix of the names of its ports.
    const fn mark(self) -> Option<char> {
        match self {
            Self::Guest => Some('?'),
            Self::Command => Some('>'),
            Self::Member => None,
        }
    }

    fn from_port_name(name: &PortName) -> Self {
        [Self::Guest, Self::Command]
            .into_iter()
            .find(|party| party.mark().is_some_and(|mark| name.as_str().starts_with(mark)))
            .unwrap_or_default()
    }

    /// Whether so many ports of these names are within what this kind may have; a member is only bound by the limit
    /// itself.
    pub(crate) fn within(self, names: &[PortName], limit: usize, coming: usize) -> bool {
        let taken = names.iter().filter(|name| Self::from_port_name(name) <= self).count();
        self == Self::Member || taken + coming <= self.ceiling(limit)
    }
}

/// Reason why a port was not created.
pub(crate) enum Refused<E> {
    /// All places of this kind are taken; their number.
    NoPlace(usize),
    /// An error of iceoryx2.
    Error(E),
}

/// Collects the items that `list` passes to its callback.
pub(crate) fn collect_listed<T>(list: impl FnOnce(&mut dyn FnMut(T))) -> Vec<T> {
    let mut ports = Vec::new();
    list(&mut |port| ports.push(port));
    ports
}

#[cfg(test)]
mod tests {
    use super::*;
    use messages::CHANNELS;

    fn port(party: Participant) -> PortName {
        party.port_name("x").unwrap_or_else(|_| PortName::new_empty())
    }

    #[test]
    fn each_kind_leaves_places_to_more_important_kinds() {
        for limit in 1..100 {
            let [guests, commands, all] =
                [Participant::Guest, Participant::Command, Participant::Member].map(|one| one.ceiling(limit));
            assert!(guests <= commands && commands <= all && all == limit);
            assert!(limit < 8 || (guests >= 3 && commands - guests >= 2 && all - commands >= 3), "{limit}");
        }
    }

    /// Five processes of a robot subscribe to `system/config/nims`, and during a restart a sixth one does.
    #[test]
    fn the_robot_has_six_places_on_every_channel() {
        for row in CHANNELS {
            let limit = row.quality.subscribers;
            assert!(limit - Participant::Command.ceiling(limit) >= 6, "{}", row.pattern);
        }
    }

    #[test]
    fn a_kind_counts_itself_and_less_important_kinds() {
        let taken: Vec<PortName> =
            [Participant::Guest, Participant::Guest, Participant::Guest, Participant::Command, Participant::Member]
                .map(port)
                .to_vec();
        assert!(!Participant::Guest.within(&taken, 8, 1) && Participant::Guest.within(&taken, 8, 0));
        assert!(Participant::Command.within(&taken, 8, 1) && !Participant::Command.within(&taken, 8, 2));
        assert!(Participant::Member.within(&taken, 5, 1), "iceoryx2 itself enforces the limit");
    }
}
