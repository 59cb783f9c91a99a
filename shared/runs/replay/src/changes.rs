//! What a replay changes.

/// What is not as it was.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Changes {
    /// Another law for every controller.
    pub law: Option<String>,
    /// Keys of the system file or the robot file, each with its new value.
    pub set: Vec<(String, String)>,
}

impl Changes {
    /// Whether everything is as it was.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        *self == Self::default()
    }
}
