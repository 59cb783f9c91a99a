//! Requested changes to the recorded configuration.

/// Requested changes to the recorded configuration.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Changes {
    /// Law for all controllers.
    pub law: Option<String>,
    /// Custom law for all controllers: the command of its program.
    pub program: Option<String>,
    /// Keys of the system file or the robot file, each with its new value.
    pub set: Vec<(String, String)>,
}

impl Changes {
    /// Returns whether no change is requested.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        *self == Self::default()
    }
}
