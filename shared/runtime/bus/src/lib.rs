//! Samples between processes over shared memory: typed ports, an untyped tap, waiting, and requests.
//!
//! Invariants:
//! * This is the only crate that depends on iceoryx2; the interface does not expose it.
//! * All objects of one robot belong to one [`Domain`]; domains on a machine are isolated from each other.
//! * A publisher never waits for a subscriber: if a buffer is full, the oldest sample is overwritten, and the
//!   subscriber counts it as lost by its sequence number.
//! * A publisher notifies after it has published, so a waiter that wakes up finds the sample.
//! * Ports stay in the thread that created them. After creation, receiving and waiting do not allocate; sending
//!   allocates and frees one counter of fixed size, inside iceoryx2.
//! * A created object has all its memory: no later page fault ends a process because /dev/shm is full ([`Memory`]).
//! * Observers leave places to control processes ([`Participant`]); an emergency stop ([`estop`]) and a dead-man stop
//!   ([`deadman`]) need no place at all.
//! * Only the user who runs a domain can access its objects.
//! * The next `send` or `receive` connects to a new peer, which costs about 0.1 ms once.
//!
//! ```
//! use bus::{Bus, Domain};
//! use messages::MotorState;
//!
//! let domain = Domain::for_test();
//! let motor = Bus::join(&domain, "motor-io")?;
//! let mut out = motor.publisher::<MotorState>("motor/state")?;
//!
//! let estimator = Bus::join(&domain, "estimator")?;
//! let mut states = estimator.subscriber::<MotorState>("motor/state")?;
//! let mut waiter = estimator.waiter(&["motor/state"])?;
//!
//! out.send(&mut MotorState { cable_count: 3, ..Default::default() })?;
//! assert!(waiter.wait_until(Some(bus::clock::now_ns() + 1_000_000_000))?.channel(0));
//! assert_eq!(states.receive()?.unwrap().cable_count, 3);
//! assert_eq!(states.lost(), 0);
//! # Ok::<(), bus::BusError>(())
//! ```

mod admission;
mod blob;
pub mod clock;
pub mod deadman;
mod declared;
mod definition;
mod domain;
mod error;
pub mod estop;
mod event;
pub mod fair;
mod former_places;
mod limits;
mod losses;
mod memory;
mod newest;
mod node;
mod places;
mod port;
mod privacy;
mod request;
mod requester;
mod shm_sample;
mod sweep;
mod tap;
mod untyped;
mod waiter;

pub use blob::BlobPublisher;
pub use declared::DeclaredPublisher;
pub use domain::{Claim, Domain, NodeInfo, TestDomain};
pub use error::{BadName, BusError, PlaceKind, THIS_PROCESS, UnusableFolder};
pub use former_places::FormerPlaces;
pub use limits::{places_bytes, recorder_files};
pub use memory::Memory;
pub use newest::Newest;
pub use node::{Bus, is_channel_name};
pub use places::Participant;
pub use port::{Publisher, Subscriber};
pub use privacy::make_private;
pub use request::{Call, Client, Pending, Server, request_event};
pub use sweep::SweepReport;
pub use tap::{ChannelInfo, ChannelWatch, Raw, Tap};
pub use waiter::{Waiter, Wake};

/// The event that a new channel raises: wait for it instead of polling [`Bus::channels`].
pub const CHANNELS_EVENT: &str = "system/channels";
