//! Samples between processes over shared memory: typed ports, an untyped tap, waking, and requests.
//!
//! Invariants:
//! * This is the only crate that uses iceoryx2; none of its types is in the interface.
//! * Everything of one robot lives in one [`Domain`]; two domains on a machine share nothing.
//! * A publisher never waits for a subscriber: where the buffer is full, the oldest sample is dropped, and the
//!   subscriber counts the loss by sequence numbers.
//! * Publish, then notify: a process that is woken finds the sample.
//! * Ports stay in the thread that created them. After creation, receiving and waiting do not allocate; sending takes
//!   and returns one counter of fixed size, inside iceoryx2.
//! * Memory is allocated when a channel or connection is created: no page fault ends a process later because others
//!   have filled /dev/shm ([`Memory`]).
//! * Observers leave places to the processes that control ([`Party`]); an emergency stop needs no place at all
//!   ([`estop`]).
//! * The files of a domain are accessible to its user alone: no other user can read it or publish in it.
//! * Connecting to a new peer happens inside the next `send` or `receive`; it costs about 0.1 ms there, once.
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
pub mod clock;
mod definition;
mod domain;
mod error;
pub mod estop;
pub mod fair;
mod losses;
mod memory;
mod node;
mod places;
mod port;
mod privacy;
mod request;
mod requester;
mod shm_sample;
mod sweep;
mod tap;
mod waiter;

pub use domain::{Claim, Domain, NodeInfo, TestDomain};
pub use error::{BadName, BusError, PlaceKind, THIS_PROCESS, Unfit};
pub use memory::Memory;
pub use node::Bus;
pub use places::Party;
pub use port::{Publisher, Subscriber};
pub use privacy::make_private;
pub use request::{Call, Client, Server, request_event};
pub use sweep::Swept;
pub use tap::{ChannelInfo, ChannelWatch, Raw, Tap};
pub use waiter::{Waiter, Wake};

/// The event that says "there is a new channel": wait for it in place of polling [`Bus::channels`].
pub const CHANNELS_EVENT: &str = "system/channels";
