//! The server and the channels that it offers.

use std::net::IpAddr;
use std::sync::{Arc, Mutex, PoisonError};

use bus::clock::{SECOND_NS, now_ns};
use bus::{Bus, BusError, ChannelWatch};
use foxglove::websocket::{ChannelView, Client, ServerListener};
use foxglove::{ChannelId, Context, FoxgloveError, SinkId, WebSocketServer, WebSocketServerHandle};
use runlog::{Definitions, RunClock};

use crate::offer::Offer;

/// Time between two searches for channels that were not announced, ns.
const SEARCH_NS: u64 = SECOND_NS;
/// Largest number of samples that wait for a slow tool; then the oldest are dropped.
const BACKLOG: usize = 1024;

/// Settings of a viewer.
#[derive(Debug, Clone)]
pub struct Settings {
    /// Name of the source in the tools.
    pub name: String,
    /// Address to listen on.
    pub address: IpAddr,
    /// TCP port; 0: any free port.
    pub port: u16,
    /// Largest number of samples per second and channel.
    pub rate_hz: f64,
    /// The clock of the run.
    pub clock: RunClock,
}

/// Error of a viewer.
#[derive(Debug, thiserror::Error)]
pub enum ViewerError {
    /// Error of the bus.
    #[error(transparent)]
    Bus(#[from] BusError),
    /// The address is in use, or does not belong to this machine.
    #[error("cannot listen at {address}, port {port}: {why}; choose others in [viewer] or with --address and --port")]
    Listen {
        /// The address.
        address: IpAddr,
        /// The port.
        port: u16,
        /// Message of the operating system.
        why: String,
    },
}

/// Subscriptions by tools since the last poll.
#[derive(Default)]
struct NewSubscriptions(Mutex<Vec<(ChannelId, SinkId)>>);

impl ServerListener for NewSubscriptions {
    fn on_subscribe(&self, client: Client, channel: ChannelView) {
        if let Some(sink) = client.sink_id() {
            self.0.lock().unwrap_or_else(PoisonError::into_inner).push((channel.id(), sink));
        }
    }
}

/// Serves every channel of a domain to connected tools.
pub struct Viewer {
    server: WebSocketServerHandle,
    context: Arc<Context>,
    new_subscriptions: Arc<NewSubscriptions>,
    clock: RunClock,
    rate_hz: f64,
    watch: ChannelWatch,
    definitions: Definitions,
    offers: Vec<Offer>,
    lost: u64,
    next_search_ns: u64,
}

impl Viewer {
    /// Starts to listen, with a thread for each CPU.
    ///
    /// # Errors
    /// [`ViewerError::Listen`].
    pub fn open(settings: &Settings) -> Result<Self, ViewerError> {
        let Settings { name, address, port, rate_hz, clock } = settings;
        let (context, new_subscriptions) = (Context::new(), Arc::new(NewSubscriptions::default()));
        let server = WebSocketServer::new()
            .name(name)
            .bind(address.to_string(), *port)
            .context(&context)
            .message_backlog_size(BACKLOG)
            .listener(new_subscriptions.clone())
            .start_blocking()
            .map_err(|error| ViewerError::Listen { address: *address, port: *port, why: error.to_string() })?;
        Ok(Self {
            server,
            context,
            new_subscriptions,
            clock: *clock,
            rate_hz: *rate_hz,
            watch: ChannelWatch::new(),
            definitions: Definitions::default(),
            offers: Vec::new(),
            lost: 0,
            next_search_ns: 0,
        })
    }

    /// Returns the port on which it listens.
    #[must_use]
    pub fn port(&self) -> u16 {
        self.server.port()
    }

    /// Returns the time of the next poll, CLOCK_MONOTONIC, ns; `None` without connected tools, when a few polls per
    /// second suffice.
    #[must_use]
    pub fn next_poll_ns(&self, now_ns: u64) -> Option<u64> {
        let subscribed = self.offers.iter().any(Offer::is_subscribed);
        subscribed.then(|| now_ns + (SECOND_NS as f64 / self.rate_hz) as u64)
    }

    /// Offers new channels, and forwards new samples. `announced`: a new channel may exist.
    ///
    /// # Errors
    /// The domain cannot be used any more.
    pub fn poll(&mut self, bus: &Bus, announced: bool) -> Result<(), ViewerError> {
        let now = now_ns();
        if announced || now >= self.next_search_ns {
            self.next_search_ns = now + SEARCH_NS;
            self.discover(bus)?;
        }
        let new_subscriptions =
            std::mem::take(&mut *self.new_subscriptions.0.lock().unwrap_or_else(PoisonError::into_inner));
        for (id, sink) in new_subscriptions {
            if let Some(offer) = self.offers.iter().find(|offer| offer.id() == id) {
                offer.send_last(sink);
            }
        }
        let mut lost = 0;
        for offer in &mut self.offers {
            offer.update_subscription(bus, self.rate_hz, now);
            offer.forward(self.clock, self.rate_hz, now)?;
            lost += offer.lost();
        }
        self.lost = lost;
        Ok(())
    }

    fn discover(&mut self, bus: &Bus) -> Result<(), BusError> {
        for info in self.watch.new_channels(bus)? {
            // A channel that was created again, perhaps with another type, replaces the old one.
            if let Some(at) = self.offers.iter().position(|offer| offer.info().name == info.name) {
                self.offers.swap_remove(at).withdraw();
            }
            let name = info.name.clone();
            match Offer::new(&self.context, info, &mut self.definitions) {
                Ok(offer) => self.offers.push(offer),
                Err(error) => warn_not_shown(&name, &error),
            }
        }
        Ok(())
    }

    /// Returns the number of samples of subscribed channels that were overwritten before they were received.
    #[must_use]
    pub fn lost(&self) -> u64 {
        self.lost
    }

    /// Ends every connection, also that of a tool that has stopped reading.
    pub fn close(self) {
        drop(self.server.stop());
    }
}

fn warn_not_shown(name: &str, error: &FoxgloveError) {
    tracing::warn!("channel {name} is not shown: {error}");
}
