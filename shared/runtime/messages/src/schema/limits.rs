//! Limits of a definition.

/// Most fields of one sample, after nested types are laid out: more than any sample has, few enough to fit in memory.
pub(super) const FIELDS: usize = 65_536;

/// Largest sample, bytes.
pub(super) const BYTES: usize = 1 << 30;

/// Deepest nesting of types.
pub(super) const DEPTH: usize = 16;

/// Length of the separator between definitions, characters.
pub(super) const SEPARATOR_LENGTH: usize = 80;
