//! A connection to the gateway: calls out, replies, samples and open files in.

use client::Place;
use command::{Answer, Failure};
use gateway_protocol::{Call, Decoder, Frame, Origin, REPLY_LIMITS, Reply, VERSION, encode};
use robot_state::Reason;
use rustix::io::Errno;
use rustix::net::{RecvAncillaryBuffer, RecvAncillaryMessage, RecvFlags, recvmsg};
use std::collections::VecDeque;
use std::io::IoSliceMut;
use std::mem::MaybeUninit;
use std::net::IpAddr;
use std::os::fd::OwnedFd;
use std::path::Path;
use std::time::Duration;
use tokio::io::{AsyncWriteExt, Interest};
use tokio::net::UnixStream;
use tokio::net::unix::{OwnedReadHalf, OwnedWriteHalf};
use tokio::time::timeout;

/// Bytes that are read at once.
const PIECE: usize = 64 << 10;
/// Time in which a gateway has to take a connection and to greet.
const GREETED: Duration = Duration::from_secs(5);
/// Time between two attempts while more connections wait for the gateway than its socket keeps.
const AGAIN: Duration = Duration::from_millis(10);

/// Why there is no connection.
#[derive(Debug)]
pub(crate) enum NoLink {
    /// The token is unknown or was revoked, which no later attempt changes. With the gateway's sentence.
    TokenInvalid(String),
    /// Anything else, which may pass.
    Failed(Failure),
}

impl From<Failure> for NoLink {
    fn from(failure: Failure) -> Self {
        Self::Failed(failure)
    }
}

impl From<NoLink> for Failure {
    fn from(no_link: NoLink) -> Self {
        match no_link {
            NoLink::TokenInvalid(sentence) => Self::NotNow(sentence),
            NoLink::Failed(failure) => failure,
        }
    }
}

/// For whom a connection is: the holder of a token, or everyone who opens the page; and where.
#[derive(Debug, Clone, Default)]
pub(crate) struct Browser {
    pub(crate) token: Option<String>,
    pub(crate) from: Option<IpAddr>,
}

/// The gateway's reply to `hello`.
#[derive(Debug, Clone)]
pub(crate) struct Welcome {
    /// Name of the robot.
    pub(crate) robot: String,
    /// Name with which requests are recorded.
    pub(crate) user: String,
    /// `look`, `stop` or `fly`.
    pub(crate) role: String,
}

/// What the gateway sends.
#[derive(Debug)]
pub(crate) struct Incoming {
    stream: OwnedReadHalf,
    decoder: Decoder,
    bytes: Vec<u8>,
    descriptors: VecDeque<OwnedFd>,
}

/// What the gateway receives.
#[derive(Debug)]
pub(crate) struct Outgoing(OwnedWriteHalf);

/// Connects to the gateway of a robot. Nothing else waits meanwhile.
///
/// # Errors
/// There is no gateway, it may not be trusted, it does not answer, or it refuses the connection.
pub(crate) async fn connect(place: Place<'_>, browser: &Browser) -> Result<(Incoming, Outgoing, Welcome), NoLink> {
    let socket = client::gateway_socket(place)?;
    greeted_within(GREETED, &socket, browser).await
}

async fn greeted_within(
    limit: Duration,
    socket: &Path,
    browser: &Browser,
) -> Result<(Incoming, Outgoing, Welcome), NoLink> {
    let greeted = timeout(limit, greet(socket, browser)).await;
    greeted.unwrap_or_else(|_| Err(unusable(format_args!("it has not answered for {} s", limit.as_secs())).into()))
}

async fn greet(socket: &Path, browser: &Browser) -> Result<(Incoming, Outgoing, Welcome), NoLink> {
    let stream = loop {
        match UnixStream::connect(socket).await {
            // Its queue of connections is full.
            Err(error) if error.kind() == std::io::ErrorKind::WouldBlock => tokio::time::sleep(AGAIN).await,
            connected => break connected.map_err(|error| client::not_connected(socket, &error))?,
        }
    };
    client::trusted(socket, &stream)?;
    let (read, write) = stream.into_split();
    let decoder = Decoder::new(REPLY_LIMITS);
    let mut incoming = Incoming { stream: read, decoder, bytes: vec![0; PIECE], descriptors: VecDeque::new() };
    let mut outgoing = Outgoing(write);
    let Browser { token, from } = browser.clone();
    outgoing.send(&Call::Hello { version: VERSION, origin: Origin::Page, token, from }, &[]).await?;
    match incoming.next().await?.0 {
        Reply::Welcome { robot, user, role, .. } => Ok((incoming, outgoing, Welcome { robot, user, role })),
        Reply::Answer { reason, sentence, .. } if reason == Reason::TokenInvalid.code() => {
            Err(NoLink::TokenInvalid(sentence))
        }
        Reply::Answer { sentence, .. } => Err(Failure::NotNow(sentence).into()),
        _ => Err(unusable("its first reply is of another kind; use the page of the same installation").into()),
    }
}

impl Outgoing {
    /// Sends a call.
    ///
    /// # Errors
    /// A number that is not finite, or the connection is broken.
    pub(crate) async fn send(&mut self, call: &Call, body: &[u8]) -> Answer {
        let header = call.header().map_err(Failure::BadInput)?;
        self.0.write_all(&encode(&header, body)).await.map_err(unusable)
    }
}

impl Incoming {
    /// Returns the next reply with its body. A wait that is abandoned loses nothing.
    ///
    /// # Errors
    /// The connection is broken.
    pub(crate) async fn next(&mut self) -> Answer<(Reply, Vec<u8>)> {
        loop {
            if let Some(Frame { header, body }) = self.decoder.next_frame().map_err(unusable)? {
                return Ok((Reply::read(&header).map_err(unusable)?, body));
            }
            self.read().await?;
        }
    }

    /// The open file that came with the last reply.
    pub(crate) fn descriptor(&mut self) -> Option<OwnedFd> {
        self.descriptors.pop_front()
    }

    async fn read(&mut self) -> Answer {
        let (stream, bytes, descriptors) = (self.stream.as_ref(), &mut self.bytes, &mut self.descriptors);
        let receive = || {
            let mut space = [MaybeUninit::uninit(); rustix::cmsg_space!(ScmRights(4))];
            let mut attached = RecvAncillaryBuffer::new(&mut space);
            let message = recvmsg(
                stream,
                &mut [IoSliceMut::new(bytes)],
                &mut attached,
                RecvFlags::DONTWAIT | RecvFlags::CMSG_CLOEXEC,
            )?;
            for message in attached.drain() {
                if let RecvAncillaryMessage::ScmRights(received) = message {
                    descriptors.extend(received);
                }
            }
            Ok(message.bytes)
        };
        match self.stream.as_ref().async_io(Interest::READABLE, receive).await {
            Ok(0) => Err(unusable("it has closed the connection")),
            Ok(length) => {
                self.decoder.push(&self.bytes[..length]);
                Ok(())
            }
            Err(error) if error.raw_os_error() == Some(Errno::INTR.raw_os_error()) => Ok(()),
            Err(error) => Err(unusable(error)),
        }
    }
}

fn unusable(why: impl std::fmt::Display) -> Failure {
    Failure::NotNow(format!("the robot's gateway cannot be used: {why}; the page tries again"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use rustix::net::{AddressFamily, SocketAddrUnix, SocketType, bind, listen, socket};
    use std::sync::atomic::{AtomicUsize, Ordering};

    /// A gateway that hangs: its queue of connections is full, and it accepts none.
    #[test]
    fn a_gateway_that_hangs_stops_no_other_task_and_is_given_up() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("robot.sock");
        let listener = socket(AddressFamily::UNIX, SocketType::STREAM, None).unwrap();
        bind(&listener, &SocketAddrUnix::new(&path).unwrap()).unwrap();
        listen(&listener, 0).unwrap();
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
        let turns = AtomicUsize::new(0);
        runtime.block_on(async {
            let unnamed = Browser::default();
            let connect = || greeted_within(Duration::from_secs(1), &path, &unnamed);
            let others = async {
                loop {
                    tokio::time::sleep(AGAIN).await;
                    turns.fetch_add(1, Ordering::Relaxed);
                }
            };
            let attempts = async {
                // The first one is in the queue and is not greeted, the others do not get into it.
                let (first, second, third) = tokio::join!(connect(), connect(), connect());
                [first.is_err(), second.is_err(), third.is_err()]
            };
            tokio::select! {
                () = others => {}
                refused = attempts => assert_eq!(refused, [true; 3]),
            }
        });
        assert!(turns.load(Ordering::Relaxed) > 10);
    }
}
