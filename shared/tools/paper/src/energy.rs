//! Figures 11 to 13 and Tables V and VIII: losses of moves.

mod comparison;
mod current;
mod moves;
mod savings;
mod setup;

pub(crate) use comparison::flown_cost;
pub use current::fig11;
pub use moves::{fig12, fig13};
pub use savings::{table5, table8};
