//! Samples of a channel of any type, as bytes.

use crate::link::{RobotLink, Subscription};
use bus::{BusError, Tap, clock};
use command::{Answer, Failure};
use messages::schema::Schema;

/// Longest wait for the definition of a channel that exists, ns.
const DEFINED_NS: u64 = 2 * clock::SECOND_NS;

/// A subscriber for a channel of any type.
#[derive(Debug)]
pub enum LinkTap {
    /// From shared memory.
    Bus(Box<Tap>),
    /// From a gateway, with the number of samples that were lost up to the last one.
    Gateway(Subscription, u64),
}

impl LinkTap {
    /// Subscribes to an existing channel.
    ///
    /// # Errors
    /// There is no such channel, or it cannot be opened.
    pub fn open(link: &RobotLink, channel: &str) -> Answer<Self> {
        let gateway = match link {
            RobotLink::Bus(bus) => return Ok(Self::Bus(Box::new(bus.tap(channel)?))),
            RobotLink::Gateway(gateway) => gateway,
        };
        if !link.channels()?.iter().any(|row| row.name == channel) {
            let (channel, domain) = (channel.to_owned(), link.name().to_owned());
            return Err(BusError::NoChannel { channel, domain }.into());
        }
        let subscription = gateway.subscribe(channel)?;
        let give_up = clock::now_ns() + DEFINED_NS;
        while subscription.definition().is_none() {
            if clock::now_ns() >= give_up {
                return Err(Failure::NotNow(format!("the gateway cannot subscribe to {channel} now; try again")));
            }
            subscription.wait_until(give_up)?;
        }
        Ok(Self::Gateway(subscription, 0))
    }

    /// Returns the oldest sample that was not received yet, and the number of samples missing before it.
    ///
    /// # Errors
    /// Shared memory is damaged, or the connection is broken.
    pub fn receive(&mut self) -> Answer<Option<(Vec<u8>, u64)>> {
        match self {
            Self::Bus(tap) => Ok(tap.receive(|raw| (raw.bytes.to_vec(), raw.missing))?),
            Self::Gateway(subscription, before) => {
                let sample = subscription.receive()?;
                Ok(sample.map(|bytes| {
                    let lost = subscription.lost();
                    (bytes, lost - std::mem::replace(before, lost))
                }))
            }
        }
    }

    /// Returns the size of the samples and the text of their definition, if they are known.
    #[must_use]
    pub fn definition(&self) -> Option<(usize, String)> {
        let (size, text) = match self {
            Self::Bus(tap) => (tap.info().size, tap.info().schema.clone()),
            Self::Gateway(subscription, _) => {
                let (_, size, text) = subscription.definition()?;
                (size, text)
            }
        };
        Some((size, text?))
    }

    /// Returns the definition of the samples, if it is known and fits their size.
    #[must_use]
    pub fn schema(&self) -> Option<Schema> {
        let (size, text) = self.definition()?;
        Schema::parse(&text).ok().filter(|schema| schema.size() == size)
    }

    /// Returns whether losses can be counted: the samples have sequence numbers.
    #[must_use]
    pub fn has_header(&self) -> bool {
        match self {
            Self::Bus(tap) => tap.has_header(),
            Self::Gateway(..) => self.schema().is_some_and(|schema| schema.has_header()),
        }
    }
}
