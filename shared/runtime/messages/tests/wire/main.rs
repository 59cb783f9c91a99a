//! What processes and readers of run files rely on: layouts and schemas.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod layout;
mod reference;
mod request;
mod schema;
