//! The protocol of the gateway: frames on a Unix socket, the calls of a client, and the gateway's replies.
//!
//! `docs/gateway.md` describes it for authors of clients in any language.
//!
//! Invariants:
//! * No bytes make a decoder panic, and a decoder holds at most one frame of the allowed size.
//! * What is encoded is decoded again, whatever pieces it arrives in.
//! * A call that is not understood is refused as a whole: an unknown key is an error, so that a misspelt option is
//!   never left out silently.
#![forbid(unsafe_code)]

mod call;
mod frame;
mod reply;

pub use call::{Call, Origin, Published, ReadingQuality, RunFiles, SeatCall};
pub use frame::{CALL_LIMITS, Decoder, Frame, FrameError, Limits, REPLY_LIMITS, encode};
pub use reply::{
    Accepted, ChannelRow, DiskFigures, FileRow, FindingRow, MemoryFigures, Reply, RobotFacts, RunRow, TokenRow,
};

/// Version of the protocol. A gateway refuses the others in the reply to `hello`.
pub const VERSION: u32 = 1;
/// Folder of the sockets of gateways that run as services; each is named after its robot.
pub const SOCKETS: &str = "/run/nims-gateway";
/// Ending of the name of a socket.
pub const SOCKET_ENDING: &str = ".sock";
