//! The two slots of a role.

crate::choice! {
    /// One of the two places of a role: a process can be swapped for the one in the other slot while both run.
    #[derive(Default, clap::ValueEnum)]
    pub enum Slot {
        /// First slot.
        #[default]
        A = "a",
        /// Second slot.
        B = "b",
    }
}

impl Slot {
    /// Returns the index in the arrays of samples.
    #[must_use]
    pub fn index(self) -> usize {
        self as usize
    }
}
