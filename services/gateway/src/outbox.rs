//! What waits to be sent to a client: bounded, and a descriptor goes with the first byte of its frame.

use rustix::io::Errno;
use rustix::net::{SendAncillaryBuffer, SendAncillaryMessage, SendFlags, sendmsg};
use std::collections::VecDeque;
use std::io::IoSlice;
use std::mem::MaybeUninit;
use std::os::fd::{AsFd, OwnedFd};

/// Waiting bytes beyond which further samples are left out. A larger sample is taken only while nothing else waits.
pub(crate) const SAMPLES: usize = 512 << 10;
/// Bytes of larger samples that may wait for all clients together: with the rest of what may wait, the gateway stays
/// below its part of `MemoryMax` of its unit.
pub(crate) const LARGE_SAMPLES: usize = 32 << 20;
/// Largest number of waiting descriptors.
pub(crate) const DESCRIPTORS: usize = 2;
/// Waiting bytes of replies beyond which nothing is read from the client: it first has to take them. Samples of any
/// size do not count, so that a client which does not read can still stop the robot.
const PAUSED: usize = 256 << 10;

#[derive(Debug)]
struct Piece {
    bytes: Vec<u8>,
    sent: usize,
    is_sample: bool,
    descriptor: Option<OwnedFd>,
}

/// The queue of a client.
#[derive(Debug, Default)]
pub(crate) struct Outbox {
    pieces: VecDeque<Piece>,
    waiting: usize,
    /// Those of samples.
    samples: usize,
}

impl Outbox {
    /// Adds the frame of a reply.
    pub(crate) fn push(&mut self, bytes: Vec<u8>, descriptor: Option<OwnedFd>) {
        self.waiting += bytes.len();
        self.pieces.push_back(Piece { bytes, sent: 0, is_sample: false, descriptor });
    }

    /// Adds the frame of a sample.
    pub(crate) fn push_sample(&mut self, bytes: Vec<u8>) {
        self.waiting += bytes.len();
        self.samples += bytes.len();
        self.pieces.push_back(Piece { bytes, sent: 0, is_sample: true, descriptor: None });
    }

    /// Returns whether a sample of that size may be added, while `large` bytes of large samples wait for all clients.
    pub(crate) fn has_room(&self, bytes: usize, large: usize) -> bool {
        if is_large(bytes) {
            return self.waiting == 0 && large + bytes <= LARGE_SAMPLES;
        }
        self.waiting + bytes <= SAMPLES
    }

    /// Returns the waiting bytes of large samples. A frame that was sent in part is still there as a whole.
    pub(crate) fn large(&self) -> usize {
        let sizes = self.pieces.iter().filter(|piece| piece.is_sample).map(|piece| piece.bytes.len());
        sizes.filter(|bytes| is_large(*bytes)).sum()
    }

    /// Returns whether the client has to take its replies before more is read from it.
    pub(crate) fn is_paused(&self) -> bool {
        self.waiting - self.samples >= PAUSED
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
                    self.samples -= if piece.is_sample { sent } else { 0 };
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

/// Returns whether a sample is one of those of which few may wait.
pub(crate) fn is_large(bytes: usize) -> bool {
    bytes > SAMPLES
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_client_that_reads_nothing_holds_two_descriptors_and_its_samples_never_pause_it() {
        let (ours, _theirs) = std::os::unix::net::UnixStream::pair().unwrap();
        let mut outbox = Outbox::default();
        let descriptor = || OwnedFd::from(std::fs::File::open("/dev/null").unwrap());
        while outbox.has_room(1000, 0) {
            outbox.push_sample(vec![0; 1000]);
            outbox.send(&ours).unwrap();
        }
        assert!(outbox.waiting() <= SAMPLES && !outbox.is_paused());
        let mut pushed = 0;
        while outbox.has_room_for_a_descriptor() {
            outbox.push(vec![0; 10], Some(descriptor()));
            pushed += 1;
        }
        assert_eq!(pushed, DESCRIPTORS);
    }

    #[test]
    fn a_large_sample_goes_alone_and_does_not_pause_the_client_as_replies_do() {
        let (ours, theirs) = std::os::unix::net::UnixStream::pair().unwrap();
        let mut outbox = Outbox::default();
        let large = 3 << 20;
        assert!(outbox.has_room(large, LARGE_SAMPLES - large) && !outbox.has_room(large, LARGE_SAMPLES - large + 1));
        outbox.push_sample(vec![0; large]);
        outbox.send(&ours).unwrap();
        assert_eq!(outbox.large(), large);
        assert!(outbox.waiting() > PAUSED && !outbox.is_paused());
        assert!(!outbox.has_room(large, 0) && !outbox.has_room(1, 0));
        outbox.push(vec![0; PAUSED], None);
        assert!(outbox.is_paused());
        // What the client takes makes room, whichever kind it was.
        let mut taken = 0;
        theirs.set_nonblocking(true).unwrap();
        while outbox.waiting() > 0 {
            taken += std::io::Read::read(&mut &theirs, &mut vec![0; 1 << 20]).unwrap_or(0);
            outbox.send(&ours).unwrap();
        }
        assert!(taken <= large + PAUSED && !outbox.is_paused() && outbox.large() == 0);
        assert!(outbox.has_room(large, 0));
    }
}
