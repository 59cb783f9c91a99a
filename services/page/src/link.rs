//! A connection to the gateway: calls out, replies, samples and open files in.

use client::Place;
use command::{Answer, Failure};
use gateway_protocol::{Call, Decoder, Frame, Origin, REPLY_LIMITS, Reply, VERSION, encode};
use rustix::io::Errno;
use rustix::net::{RecvAncillaryBuffer, RecvAncillaryMessage, RecvFlags, recvmsg};
use std::collections::VecDeque;
use std::io::IoSliceMut;
use std::mem::MaybeUninit;
use std::os::fd::OwnedFd;
use tokio::io::{AsyncWriteExt, Interest};
use tokio::net::UnixStream;
use tokio::net::unix::{OwnedReadHalf, OwnedWriteHalf};

/// Bytes that are read at once.
const PIECE: usize = 64 << 10;

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

/// Connects to the gateway of a robot, for the holder of a token or for everyone who opens the page.
///
/// # Errors
/// There is no gateway, it may not be trusted, or it refuses the connection.
pub(crate) async fn connect(place: Place<'_>, token: Option<String>) -> Answer<(Incoming, Outgoing, Welcome)> {
    let socket = client::gateway_socket(place)?;
    let stream = client::connect(&socket)?;
    stream.set_nonblocking(true).map_err(Failure::not_now)?;
    let (read, write) = UnixStream::from_std(stream).map_err(Failure::not_now)?.into_split();
    let decoder = Decoder::new(REPLY_LIMITS);
    let mut incoming = Incoming { stream: read, decoder, bytes: vec![0; PIECE], descriptors: VecDeque::new() };
    let mut outgoing = Outgoing(write);
    outgoing.send(&Call::Hello { version: VERSION, origin: Origin::Page, token }, &[]).await?;
    match incoming.next().await?.0 {
        Reply::Welcome { robot, user, role, .. } => Ok((incoming, outgoing, Welcome { robot, user, role })),
        Reply::Answer { sentence, .. } => Err(Failure::NotNow(sentence)),
        _ => Err(unusable("its first reply is of another kind; use the page of the same installation")),
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
