//! What goes into the core of the gateway, and what comes out of it.

use crate::plugin::Verb;
use crate::robot_file::RobotTexts;
use crate::roles::Peer;
use crate::tokens::Tokens;
use gateway_protocol::{Reply, RunFiles};
use messages::{Declaration, Header, OperatorRequest, Reading, RequestAnswer};
use std::sync::Arc;

/// Number of a connection, never used twice.
pub type ClientId = u64;
/// Number of a call that the process carries out, never used twice.
pub type Ticket = u64;

/// What happened.
#[derive(Debug)]
pub enum Event<'a> {
    /// A client has connected.
    Connected {
        /// Its number.
        client: ClientId,
        /// Its process.
        peer: Peer,
    },
    /// Bytes have arrived.
    Received {
        /// From this client.
        client: ClientId,
        /// The bytes.
        bytes: &'a [u8],
    },
    /// A connection was closed.
    Gone {
        /// The client.
        client: ClientId,
    },
    /// A call was carried out.
    Answered {
        /// Its number.
        ticket: Ticket,
        /// The reply, whose `id` is filled in here.
        reply: Done,
    },
    /// The request of a held motion was not sent, because its dead-man stop could not be deposited.
    Undeposited {
        /// The number of its call.
        ticket: Ticket,
    },
    /// A change of the tokens was stored, or could not be.
    Stored {
        /// The change.
        change: Box<TokenChange>,
        /// One sentence: why it could not be stored.
        stored: Result<(), String>,
    },
    /// motor-io has published what it does. It is observed while a client holds a motion.
    Moved(Motion),
    /// Some time has passed.
    Tick,
    /// The gateway ends: no held motion goes on without it.
    Ending,
}

/// What motor-io does, of `motor/authority`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Motion {
    /// When it was published, ns.
    pub stamp_ns: u64,
    /// Its mode.
    pub mode: u8,
    /// Number of the motion that it has, also of a paused one; 0: none.
    pub number: u32,
}

/// Result of a call.
#[derive(Debug)]
pub enum Done {
    /// The robot's or the gateway's answer.
    Answer(Box<RequestAnswer>),
    /// Another reply, with its body and perhaps a descriptor.
    Reply(Box<Reply>, Vec<u8>, Option<std::os::fd::OwnedFd>),
}

/// What the process has to do.
#[derive(Debug)]
pub enum Action {
    /// Send a reply.
    Send {
        /// To this client.
        client: ClientId,
        /// The reply.
        reply: Reply,
        /// The body of its frame.
        body: Vec<u8>,
        /// A descriptor that goes with it.
        descriptor: Option<std::os::fd::OwnedFd>,
    },
    /// Close a connection after what was sent to it.
    Close {
        /// The client.
        client: ClientId,
    },
    /// Send a request to a process of the robot.
    Ask {
        /// Its number.
        ticket: Ticket,
        /// Name of the process.
        process: String,
        /// The request with its sender.
        request: Box<OperatorRequest>,
        /// The text of a mission, to be stored before.
        mission: Option<String>,
    },
    /// Send an emergency stop.
    Estop {
        /// Its number.
        ticket: Ticket,
        /// The request with its sender.
        request: Box<OperatorRequest>,
    },
    /// Deposit with motor-io a request that it carries out unless this is repeated, or withdrawn, before.
    Deposit {
        /// The call that requests the motion which it ends. That is not sent without a deposit.
        ticket: Ticket,
        /// When it is due, ns.
        due_ns: u64,
        /// The request with its sender.
        request: Box<OperatorRequest>,
    },
    /// Withdraw what is deposited.
    Withdraw,
    /// Start or stop a plug-in.
    Plugin {
        /// Its number.
        ticket: Ticket,
        /// What to do.
        verb: Verb,
        /// Name of the plug-in.
        name: String,
    },
    /// Publish a reading.
    Publish {
        /// Its number.
        ticket: Ticket,
        /// Name of the sensor.
        sensor: String,
        /// The sample.
        reading: Box<Reading>,
    },
    /// Open the channel of a declared message.
    Declare {
        /// Its number.
        ticket: Ticket,
        /// Whose channel.
        sensor: OwnMessage,
    },
    /// Publish a sample of a declared message.
    PublishSample {
        /// Its number.
        ticket: Ticket,
        /// Whose sample.
        sensor: OwnMessage,
        /// Its header.
        header: Header,
        /// The whole sample.
        sample: Vec<u8>,
    },
    /// Find something out.
    Look {
        /// Its number.
        ticket: Ticket,
        /// What.
        what: Question,
    },
    /// Subscribe a client to a channel.
    Subscribe {
        /// The client.
        client: ClientId,
        /// Number of the subscription.
        id: u64,
        /// Name of the channel.
        channel: String,
        /// Largest number of samples per second.
        rate_hz: Option<f64>,
    },
    /// End a subscription.
    Unsubscribe {
        /// The client.
        client: ClientId,
        /// Number of the subscription.
        id: u64,
    },
    /// Store the tokens; they are valid, and the client gets its reply, when that is done.
    StoreTokens(Box<TokenChange>),
}

/// A sensor with its own message.
#[derive(Debug, Clone, PartialEq)]
pub struct OwnMessage {
    /// Its name.
    pub name: String,
    /// Its message.
    pub message: Arc<Declaration>,
    /// Largest number of samples per second.
    pub rate_hz: f64,
}

/// A change of the tokens that is being stored.
#[derive(Debug)]
pub struct TokenChange {
    pub(crate) client: ClientId,
    pub(crate) id: u64,
    pub(crate) tokens: Tokens,
    pub(crate) reply: Reply,
    pub(crate) revoked: Option<String>,
    /// The holder whose code is used with it.
    pub(crate) paired: Option<String>,
}

impl TokenChange {
    /// Returns the tokens after the change.
    #[must_use]
    pub fn tokens(&self) -> &Tokens {
        &self.tokens
    }
}

/// Something to find out.
#[derive(Debug, PartialEq, Eq)]
pub enum Question {
    /// Which robot runs.
    Robot,
    /// The files of its configuration.
    Configuration,
    /// Its channels.
    Channels,
    /// The finished runs.
    Runs,
    /// The files of a run.
    Files(String),
    /// A file of a run.
    Open(String, String),
    /// Files to be made of a run.
    Make(String, RunFiles),
    /// The removal of a run.
    Remove(String),
    /// What is wrong with the machine.
    Doctor,
    /// A robot file to be stored.
    RobotFile(Box<RobotTexts>),
}
