//! The two slots of a role.

crate::choice! {
    /// One of the two places of a role: a process can be swapped for another while both live.
    #[derive(Default, clap::ValueEnum)]
    pub enum Slot {
        /// The first.
        #[default]
        A = "a",
        /// The second.
        B = "b",
    }
}

impl Slot {
    /// Index in the arrays of samples.
    #[must_use]
    pub fn index(self) -> usize {
        self as usize
    }
}

impl From<Slot> for messages::Slot {
    fn from(slot: Slot) -> Self {
        Self::ALL[slot.index()]
    }
}

impl From<messages::Slot> for Slot {
    fn from(slot: messages::Slot) -> Self {
        match slot {
            messages::Slot::A => Self::A,
            messages::Slot::B => Self::B,
        }
    }
}
