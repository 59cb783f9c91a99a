//! What is offered, who looks at what: shared by the viewer, which fills it, and the connections of the tools.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use crate::outbox::Outbox;
use crate::protocol::{self, Advertised, Asked, Subscription};

/// Largest number of channels in one message.
const CHANNELS: usize = 100;
/// Largest number of channels that a tool shows.
const SUBSCRIPTIONS: usize = 10_000;

/// A channel and a tool that has begun to show it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Begun {
    pub(crate) channel: u32,
    pub(crate) tool: u64,
}

/// The channels and the tools.
#[derive(Debug)]
pub(crate) struct Hub {
    name: String,
    /// A tool that connects again recognizes by it whether this is still the same server.
    session: String,
    state: Mutex<State>,
}

#[derive(Debug, Default)]
struct State {
    channels: BTreeMap<u32, Advertised>,
    tools: BTreeMap<u64, Tool>,
    begun: Vec<Begun>,
    last_channel: u32,
    last_tool: u64,
}

#[derive(Debug)]
struct Tool {
    outbox: Arc<Outbox>,
    /// By channel, the number that the tool chose.
    subscriptions: BTreeMap<u32, u32>,
    /// Requests that were answered with a warning already.
    warned: BTreeSet<String>,
}

impl Hub {
    /// Creates a hub without channels.
    pub(crate) fn new(name: &str, session: String) -> Self {
        Self { name: name.to_owned(), session, state: Mutex::default() }
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Offers a channel to every tool and returns its number.
    pub(crate) fn advertise(&self, channel: Advertised) -> u32 {
        let mut state = self.state();
        state.last_channel += 1;
        let id = state.last_channel;
        let channel = Advertised { id, ..channel };
        state.tell_all(&protocol::advertise([&channel]));
        state.channels.insert(id, channel);
        id
    }

    /// Withdraws a channel from all tools.
    pub(crate) fn withdraw(&self, id: u32) {
        let mut state = self.state();
        if state.channels.remove(&id).is_some() {
            for tool in state.tools.values_mut() {
                tool.subscriptions.remove(&id);
            }
            state.tell_all(&protocol::unadvertise(id));
        }
    }

    /// Returns whether a tool shows a channel.
    pub(crate) fn is_shown(&self, id: u32) -> bool {
        self.state().tools.values().any(|tool| tool.subscriptions.contains_key(&id))
    }

    /// Returns the tools that have begun to show a channel since the last call.
    pub(crate) fn take_begun(&self) -> Vec<Begun> {
        std::mem::take(&mut self.state().begun)
    }

    /// Sends a sample to every tool that shows the channel, or to `only` one.
    pub(crate) fn send(&self, id: u32, unix_ns: u64, body: &[u8], only: Option<u64>) {
        let state = self.state();
        for (number, tool) in &state.tools {
            if let Some(subscription) = tool.subscriptions.get(&id)
                && only.is_none_or(|only| only == *number)
            {
                tool.outbox.push_sample(protocol::sample(*subscription, unix_ns, body));
            }
        }
    }

    /// Adds a tool and tells it what is offered.
    pub(crate) fn connect(&self) -> (u64, Arc<Outbox>) {
        let mut state = self.state();
        state.last_tool += 1;
        let (number, outbox) = (state.last_tool, Arc::new(Outbox::default()));
        outbox.push_text(protocol::server_info(&self.name, &self.session));
        let channels: Vec<&Advertised> = state.channels.values().collect();
        for some in channels.chunks(CHANNELS) {
            outbox.push_text(protocol::advertise(some.iter().copied()));
        }
        let tool = Tool { outbox: outbox.clone(), subscriptions: BTreeMap::default(), warned: BTreeSet::default() };
        state.tools.insert(number, tool);
        (number, outbox)
    }

    /// Forgets a tool.
    pub(crate) fn disconnect(&self, number: u64) {
        self.state().tools.remove(&number);
    }

    /// Carries out a request of a tool.
    pub(crate) fn request(&self, number: u64, text: &str) {
        let mut state = self.state();
        let State { channels, tools, begun, .. } = &mut *state;
        let Some(tool) = tools.get_mut(&number) else { return };
        match serde_json::from_str(text) {
            Ok(Asked::Subscribe { subscriptions }) => {
                for Subscription { id, channel_id } in subscriptions {
                    if !channels.contains_key(&channel_id) || tool.subscriptions.len() >= SUBSCRIPTIONS {
                        // Withdrawn while the request was on its way.
                        continue;
                    }
                    if tool.subscriptions.insert(channel_id, id) != Some(id) {
                        begun.push(Begun { channel: channel_id, tool: number });
                    }
                }
            }
            Ok(Asked::Unsubscribe { subscription_ids }) => {
                tool.subscriptions.retain(|_, id| !subscription_ids.contains(id));
            }
            Ok(Asked::Other) => tool.refuse(&protocol::name_of(text), "only shows, and does not carry out"),
            Err(_) => tool.refuse(&protocol::name_of(text), "cannot read"),
        }
    }
}

impl State {
    fn tell_all(&self, text: &str) {
        for tool in self.tools.values() {
            tool.outbox.push_text(text.to_owned());
        }
    }
}

impl Tool {
    /// A tool that asks for the same again gets no second answer.
    fn refuse(&mut self, request: &str, why: &str) {
        if self.warned.len() < CHANNELS && self.warned.insert(request.to_owned()) {
            self.outbox.push_text(protocol::warning(&format!("the viewer of nims {why} the request {request}")));
        }
    }
}
