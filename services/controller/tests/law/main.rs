//! The path law, and what another law in the free slot may be heard for.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod controller;
mod free_slot;
