//! The server, and the channels it offers.

use std::net::IpAddr;
use std::sync::{Arc, Mutex, PoisonError};

use bus::clock::{SECOND_NS, now_ns};
use bus::{Bus, BusError, ChannelWatch};
use foxglove::websocket::{ChannelView, Client, ServerListener};
use foxglove::{ChannelId, Context, FoxgloveError, SinkId, WebSocketServer, WebSocketServerHandle};
use runlog::{Definitions, RunClock};

use crate::offer::Offer;

/// Between two searches for channels that did not announce themselves.
const SEARCH_NS: u64 = SECOND_NS;
/// Samples that wait for one slow tool at most; then the oldest are dropped.
const BACKLOG: usize = 1024;

/// Where a viewer listens, and how much it passes on.
#[derive(Debug, Clone)]
pub struct Settings {
    /// What tools show as the name of the source.
    pub name: String,
    /// Address to listen on.
    pub address: IpAddr,
    /// Port; 0: any that is free.
    pub port: u16,
    /// Samples per second and channel at most.
    pub rate_hz: f64,
    /// The clock of the run.
    pub clock: RunClock,
}

/// Why a viewer cannot work.
#[derive(Debug, thiserror::Error)]
pub enum ViewerError {
    /// Shared memory.
    #[error(transparent)]
    Bus(#[from] BusError),
    /// The address is taken, or not this machine's.
    #[error(
        "nothing can be shown at {address}, port {port}: {why}; choose others in [viewer] or with --address and --port"
    )]
    Listen {
        /// The address.
        address: IpAddr,
        /// The port.
        port: u16,
        /// In the words of the system.
        why: String,
    },
}

/// Who has begun to want what since the last look.
#[derive(Default)]
struct Wishes(Mutex<Vec<(ChannelId, SinkId)>>);

impl ServerListener for Wishes {
    fn on_subscribe(&self, client: Client, channel: ChannelView) {
        if let Some(sink) = client.sink_id() {
            self.0.lock().unwrap_or_else(PoisonError::into_inner).push((channel.id(), sink));
        }
    }
}

/// Shows every channel of a domain to whoever connects.
pub struct Viewer {
    server: WebSocketServerHandle,
    context: Arc<Context>,
    wishes: Arc<Wishes>,
    clock: RunClock,
    rate_hz: f64,
    watch: ChannelWatch,
    definitions: Definitions,
    offers: Vec<Offer>,
    lost: u64,
    next_search_ns: u64,
}

impl Viewer {
    /// Begins to listen, with a thread for each processor.
    ///
    /// # Errors
    /// [`ViewerError::Listen`].
    pub fn open(settings: &Settings) -> Result<Self, ViewerError> {
        let Settings { name, address, port, rate_hz, clock } = settings;
        let (context, wishes) = (Context::new(), Arc::new(Wishes::default()));
        let server = WebSocketServer::new()
            .name(name)
            .bind(address.to_string(), *port)
            .context(&context)
            .message_backlog_size(BACKLOG)
            .listener(wishes.clone())
            .start_blocking()
            .map_err(|error| ViewerError::Listen { address: *address, port: *port, why: error.to_string() })?;
        Ok(Self {
            server,
            context,
            wishes,
            clock: *clock,
            rate_hz: *rate_hz,
            watch: ChannelWatch::new(),
            definitions: Definitions::default(),
            offers: Vec::new(),
            lost: 0,
            next_search_ns: 0,
        })
    }

    /// The port it listens on.
    #[must_use]
    pub fn port(&self) -> u16 {
        self.server.port()
    }

    /// When the next look is due, CLOCK_MONOTONIC, ns; `None` while nobody looks: then a few times a second is enough.
    #[must_use]
    pub fn next_look_ns(&self, now_ns: u64) -> Option<u64> {
        let heard = self.offers.iter().any(Offer::is_heard);
        heard.then(|| now_ns + (SECOND_NS as f64 / self.rate_hz) as u64)
    }

    /// Offers what is new, and passes on what has come. `announced`: there may be a new channel.
    ///
    /// # Errors
    /// The domain cannot be used any more.
    pub fn look(&mut self, bus: &Bus, announced: bool) -> Result<(), ViewerError> {
        let now = now_ns();
        if announced || now >= self.next_search_ns {
            self.next_search_ns = now + SEARCH_NS;
            self.discover(bus)?;
        }
        let wishes = std::mem::take(&mut *self.wishes.0.lock().unwrap_or_else(PoisonError::into_inner));
        for (id, sink) in wishes {
            if let Some(offer) = self.offers.iter().find(|offer| offer.id() == id) {
                offer.pass_last(sink);
            }
        }
        let mut lost = 0;
        for offer in &mut self.offers {
            offer.attend(bus, self.rate_hz, now);
            offer.pass_on(self.clock, self.rate_hz, now)?;
            lost += offer.lost();
        }
        self.lost = lost;
        Ok(())
    }

    fn discover(&mut self, bus: &Bus) -> Result<(), BusError> {
        for info in self.watch.new_channels(bus)? {
            // one that was made again, with another type perhaps, takes the place of the old one
            if let Some(at) = self.offers.iter().position(|offer| offer.info().name == info.name) {
                self.offers.swap_remove(at).withdraw();
            }
            let name = info.name.clone();
            match Offer::new(&self.context, info, &mut self.definitions) {
                Ok(offer) => self.offers.push(offer),
                Err(error) => say_not_shown(&name, &error),
            }
        }
        Ok(())
    }

    /// Samples of what is listened to that were overwritten before they could be taken.
    #[must_use]
    pub fn lost(&self) -> u64 {
        self.lost
    }

    /// Ends every connection, also of a tool that has stopped reading.
    pub fn close(self) {
        drop(self.server.stop());
    }
}

fn say_not_shown(name: &str, error: &FoxgloveError) {
    tracing::warn!("channel {name} is not shown: {error}");
}
