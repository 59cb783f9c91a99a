//! The fixed-size samples that the processes exchange, their ROS 2 schemas, and the channel table.
//!
//! Invariants:
//! * A sample is `#[repr(C)]`, has no hidden padding (`bytemuck` proves it when this crate compiles) and every number
//!   stands at a multiple of its own size. It is therefore, byte for byte, a little-endian CDR body: the recorder
//!   writes it as it lies in memory.
//! * A sample begins with a [`Header`].
//! * No `bool`, no Rust `enum`, no `Option` in a sample: another process may have written any byte. Choices are `u8`
//!   constants.
//! * The type name that peers compare ends in a hash of the schema text without comments, so two builds that disagree
//!   refuse to connect, and those that only explain a type in other words connect.
//! * Every field has a comment, which is part of the definition in run files.
//! * This crate does no I/O and depends on no other crate of this project.
//!
//! ```
//! use messages::{Message, MotorState};
//! assert!(MotorState::type_name().starts_with("nims_msgs/MotorState/"));
//! assert!(MotorState::schema().contains("\nnims_msgs/Header header\n"));
//! ```
#![forbid(unsafe_code)]

// the macros refer to this crate by its name
extern crate self as messages;

pub mod blob;
pub mod cdr;
mod channels;
mod config;
mod declaration;
pub mod faults;
mod hexadecimal;
mod live;
mod message;
mod motion;
mod motor;
mod node;
mod request;
mod request_sample;
pub mod ros;
pub mod schema;
mod slot;
mod system;
mod text;

pub use channels::{
    CHANNELS, Channel, ChannelVisitor, PROCESSES, Quality, channel_of, documented, quality_for, quality_of,
    quality_of_blobs, visit_first_channels,
};
pub use config::SystemConfig;
pub use declaration::{Declaration, DeclarationError};
pub use live::{AUTHORITY_LAG, Freshness, Rule, blended_estimate, freshness, newer, same_life};
#[doc(hidden)]
pub use message::{Field, Header, Message, expanded, hash_of, schema_name};
pub use motion::{KNOTS, PlanMotion, PlanSegment, PlanStatus};
pub use motor::{Energy, MotorAuthority, MotorCommand, MotorInput, MotorSlots, MotorState};
pub use node::{ControlStatus, FieldMap, NodeEstimate, Reading, Sample, SensorFlag, TruthNode};
pub use request::{DecodeError, EncodeError, GotoPath, Request};
pub use request_sample::{DETAIL_BYTES, OperatorRequest, RequestAnswer, RequestBody};
pub use slot::{Slot, SlotRole};
pub use system::{Heartbeat, LogEvent, ProcessState, RecorderGap, RecorderStatus};
pub use text::{MORE, hex, name_at, parted, put_sentence, put_text, text_of, words_within};

/// Most cables of one robot; every per-cable array has this length.
pub const CABLES: usize = 8;
/// Most drive units of one robot (a unit drives one or two cables).
pub const UNITS: usize = 8;
/// Number of roles with slots.
pub const ROLES: usize = 2;
/// Index of the controllers in arrays per role.
pub const CONTROLLERS: usize = 0;
/// Index of the estimators in arrays per role.
pub const ESTIMATORS: usize = 1;
/// Length of arrays per role and slot; the index is [`SLOTS`] x role + slot.
pub const ROLE_SLOTS: usize = ROLES * SLOTS;
/// Slots per role (controller, estimator): a and b.
pub const SLOTS: usize = 2;
/// Names of the slots in channel names.
pub const SLOT_NAMES: [&str; SLOTS] = ["a", "b"];
