//! What waits to be sent to a client: bounded, and a descriptor goes with the first byte of its frame.

use rustix::io::Errno;
use rustix::net::{SendAncillaryBuffer, SendAncillaryMessage, SendFlags, sendmsg};
use std::collections::VecDeque;
use std::io::IoSlice;
use std::mem::MaybeUninit;
use std::os::fd::{AsFd, OwnedFd};

/// Bytes of waiting samples beyond which further ones are left out.
pub(crate) const SAMPLES: usize = 512 << 10;
/// Largest number of waiting descriptors.
pub(crate) const DESCRIPTORS: usize = 2;
/// Waiting bytes beyond which nothing is read from the client: it first has to take its replies. Samples alone never
/// reach it, so that a client which does not read can still stop the robot.
pub(crate) const PAUSED: usize = SAMPLES + (256 << 10);

#[derive(Debug)]
struct Piece {
    bytes: Vec<u8>,
    sent: usize,
    descriptor: Option<OwnedFd>,
}

/// The queue of a client.
#[derive(Debug, Default)]
pub(crate) struct Outbox {
    pieces: VecDeque<Piece>,
    waiting: usize,
}

impl Outbox {
    /// Adds a frame.
    pub(crate) fn push(&mut self, bytes: Vec<u8>, descriptor: Option<OwnedFd>) {
        self.waiting += bytes.len();
        self.pieces.push_back(Piece { bytes, sent: 0, descriptor });
    }

    /// Returns whether a sample of that size may be added.
    pub(crate) fn has_room(&self, bytes: usize) -> bool {
        self.waiting == 0 || self.waiting + bytes <= SAMPLES
    }

    /// Returns whether a descriptor may be added: a client that takes none would exhaust those of the gateway.
    pub(crate) fn has_room_for_a_descriptor(&self) -> bool {
        self.pieces.iter().filter(|piece| piece.descriptor.is_some()).count() < DESCRIPTORS
    }

    /// Returns the number of waiting bytes.
    pub(crate) fn waiting(&self) -> usize {
        self.waiting
    }

    /// Sends as much as the socket takes.
    ///
    /// # Errors
    /// The connection is broken.
    pub(crate) fn send(&mut self, socket: impl AsFd) -> Result<(), Errno> {
        while let Some(piece) = self.pieces.front_mut() {
            let mut space = [MaybeUninit::uninit(); rustix::cmsg_space!(ScmRights(1))];
            let mut attached = SendAncillaryBuffer::new(&mut space);
            let descriptors = piece.descriptor.as_ref().map(|descriptor| [descriptor.as_fd()]);
            if let Some(descriptors) = &descriptors {
                attached.push(SendAncillaryMessage::ScmRights(descriptors));
            }
            let rest = IoSlice::new(&piece.bytes[piece.sent..]);
            match sendmsg(&socket, &[rest], &mut attached, SendFlags::DONTWAIT | SendFlags::NOSIGNAL) {
                Ok(sent) => {
                    piece.descriptor = None;
                    piece.sent += sent;
                    self.waiting -= sent;
                    if piece.sent == piece.bytes.len() {
                        self.pieces.pop_front();
                    }
                }
                Err(Errno::AGAIN | Errno::INTR) => return Ok(()),
                Err(error) => return Err(error),
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_client_that_reads_nothing_holds_two_descriptors_and_its_samples_never_pause_it() {
        let (ours, _theirs) = std::os::unix::net::UnixStream::pair().unwrap();
        let mut outbox = Outbox::default();
        let descriptor = || OwnedFd::from(std::fs::File::open("/dev/null").unwrap());
        while outbox.has_room(1000) {
            outbox.push(vec![0; 1000], None);
            outbox.send(&ours).unwrap();
        }
        assert!(outbox.waiting() < PAUSED);
        let mut pushed = 0;
        while outbox.has_room_for_a_descriptor() {
            outbox.push(vec![0; 10], Some(descriptor()));
            pushed += 1;
        }
        assert_eq!(pushed, DESCRIPTORS);
    }
}
