//! The two slots of a role.

/// One of the two places of a role: a process can be swapped for another while both live.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, clap::ValueEnum, serde::Deserialize, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Slot {
    /// The first.
    #[default]
    A,
    /// The second.
    B,
}

impl Slot {
    /// Index in the arrays of samples.
    #[must_use]
    pub fn index(self) -> usize {
        self as usize
    }

    /// How it stands in channel names.
    #[must_use]
    pub fn name(self) -> &'static str {
        messages::SLOT_NAMES[self.index()]
    }
}
