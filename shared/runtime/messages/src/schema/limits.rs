//! Limits of a definition.

/// Fields of one sample at most, after nested types are laid out; more than any sample has, little enough to be kept in
/// memory.
pub(super) const FIELDS: usize = 65_536;

/// Bytes of one sample at most.
pub(super) const BYTES: usize = 1 << 30;

/// Types within types at most.
pub(super) const DEPTH: usize = 16;

/// Between the definitions.
pub(super) const SEPARATOR_LENGTH: usize = 80;
