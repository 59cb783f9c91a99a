//! Roles with two slots.

use serde::{Deserialize, Serialize};

use crate::{CONTROLLERS, ESTIMATORS, SLOT_NAMES};

/// A role with two slots.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SlotRole {
    /// Position and motion to velocities.
    Controller,
    /// Lengths to position.
    Estimator,
}

impl SlotRole {
    /// Every role, by index.
    pub const ALL: [Self; 2] = [Self::Controller, Self::Estimator];

    /// Index in arrays per role.
    #[must_use]
    pub fn index(self) -> usize {
        match self {
            Self::Controller => CONTROLLERS,
            Self::Estimator => ESTIMATORS,
        }
    }
}

/// One of the two slots of a role: a process can be swapped for the one in the other slot while both run.
#[derive(Debug, Default, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Slot {
    /// First slot.
    #[default]
    A,
    /// Second slot.
    B,
}

impl Slot {
    /// Every slot, by index.
    pub const ALL: [Self; 2] = [Self::A, Self::B];

    /// Index in arrays per slot.
    #[must_use]
    pub fn index(self) -> usize {
        match self {
            Self::A => 0,
            Self::B => 1,
        }
    }

    /// `a` or `b`.
    #[must_use]
    pub fn name(self) -> &'static str {
        SLOT_NAMES[self.index()]
    }
}
