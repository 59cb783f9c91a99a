//! The server and the channels that it offers.

use std::net::{IpAddr, TcpListener};
use std::sync::Arc;

use bus::clock::{SECOND_NS, now_ns};
use bus::{Bus, BusError, ChannelWatch};
use runlog::{Definitions, RunClock};

use crate::graph::{Graph, Survey};
use crate::hub::Hub;
use crate::offer::Offer;
use crate::parameters::Parameters;
use crate::permission::Permission;
use crate::server::Server;

/// Time between two searches for channels that were not announced, ns.
const SEARCH_NS: u64 = SECOND_NS;

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
    /// Users and, after `@`, groups of this machine that may look beside the user of this process and root.
    pub look: Vec<String>,
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

/// Serves every channel of a domain to connected tools.
pub struct Viewer {
    server: Server,
    port: u16,
    hub: Arc<Hub>,
    clock: RunClock,
    rate_hz: f64,
    watch: ChannelWatch,
    definitions: Definitions,
    offers: Vec<Offer>,
    lost: u64,
    next_search_ns: u64,
    next_graph_ns: u64,
    /// The graph that is being read, while a tool draws it.
    survey: Option<Survey>,
    /// While a tool shows them.
    parameters: Option<Parameters>,
}

impl Viewer {
    /// Starts to listen, with one thread for all tools.
    ///
    /// # Errors
    /// [`ViewerError::Listen`].
    pub fn open(settings: &Settings) -> Result<Self, ViewerError> {
        let Settings { name, address, port, rate_hz, look, clock } = settings;
        let refused = |error: std::io::Error| {
            let why = error.to_string();
            ViewerError::Listen { address: *address, port: *port, why }
        };
        let listener = TcpListener::bind((*address, *port)).map_err(refused)?;
        let own = listener.local_addr().map_err(refused)?;
        let hub = Arc::new(Hub::new(name, clock.unix_of(now_ns()).to_string()));
        let server = Server::start(listener, hub.clone(), Permission::new(look.clone())).map_err(refused)?;
        Ok(Self {
            server,
            port: own.port(),
            hub,
            clock: *clock,
            rate_hz: *rate_hz,
            watch: ChannelWatch::new(),
            definitions: Definitions::default(),
            offers: Vec::new(),
            lost: 0,
            next_search_ns: 0,
            next_graph_ns: 0,
            survey: None,
            parameters: None,
        })
    }

    /// Returns the port on which it listens.
    #[must_use]
    pub fn port(&self) -> u16 {
        self.port
    }

    /// Returns the time of the next poll, CLOCK_MONOTONIC, ns; `None` without connected tools, when a few polls per
    /// second suffice.
    #[must_use]
    pub fn next_poll_ns(&self, now_ns: u64) -> Option<u64> {
        let busy = self.survey.is_some() || self.offers.iter().any(Offer::is_subscribed);
        busy.then(|| now_ns + (SECOND_NS as f64 / self.rate_hz) as u64)
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
        for begun in self.hub.take_begun() {
            if let Some(offer) = self.offers.iter().find(|offer| offer.id() == begun.channel) {
                offer.send_last(&self.hub, begun.tool);
            }
        }
        self.describe_robot(bus, now)?;
        let mut lost = 0;
        for offer in &mut self.offers {
            offer.update_subscription(&self.hub, bus, self.rate_hz, now);
            offer.forward(&self.hub, self.clock, self.rate_hz, now)?;
            lost += offer.lost();
        }
        self.lost = lost;
        Ok(())
    }

    /// Sends the graph and the parameters, while a tool shows them.
    fn describe_robot(&mut self, bus: &Bus, now_ns: u64) -> Result<(), BusError> {
        let names = || self.offers.iter().map(|offer| offer.info().name.as_str());
        if !self.hub.draws_graph() {
            self.survey = None;
            self.hub.set_graph(Graph::new());
        } else if self.survey.is_none() && now_ns >= self.next_graph_ns {
            self.next_graph_ns = now_ns + SEARCH_NS;
            self.survey = Some(Survey::begin(bus, names()));
        }
        if let Some(graph) = self.survey.as_mut().and_then(|survey| survey.step(bus)) {
            self.survey = None;
            self.hub.set_graph(graph);
        }
        if self.hub.shows_parameters() {
            let parameters = self.parameters.get_or_insert_with(|| Parameters::new(now_ns));
            let values = parameters.poll(bus, names(), self.hub.awaits_parameters(), now_ns)?;
            values.into_iter().for_each(|values| self.hub.set_parameters(values));
        } else {
            self.parameters = None;
        }
        Ok(())
    }

    fn discover(&mut self, bus: &Bus) -> Result<(), BusError> {
        for info in self.watch.new_channels(bus)? {
            // A channel that was created again, perhaps with another type, replaces the old one.
            if let Some(at) = self.offers.iter().position(|offer| offer.info().name == info.name) {
                self.offers.swap_remove(at).withdraw(&self.hub);
            }
            self.offers.push(Offer::new(&self.hub, info, &mut self.definitions));
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
        drop(self.server);
    }
}
