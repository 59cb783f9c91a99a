//! The driver against virtual units over a pipe with a virtual clock: in order, under faults, and after them.

mod clockwork;
mod cycle;
mod faults;
mod inline;
mod slow;
mod strangers;
