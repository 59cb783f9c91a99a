//! What is offered, who looks at what: shared by the viewer, which fills it, and the connections of the tools.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use crate::graph::{self, Graph};
use crate::outbox::Outbox;
use crate::parameters::{Parameter, Values};
use crate::protocol::{self, Advertised, Asked, Subscription};

/// Largest number of channels in one message.
const CHANNELS: usize = 100;
/// Largest number of channels that a tool shows, and of parameters.
const SUBSCRIPTIONS: usize = 10_000;
/// Largest number of requests for parameters that wait for their values; others are not answered.
const REQUESTS: usize = 1000;

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
    graph: Graph,
    parameters: Values,
    requests: Vec<ParameterRequest>,
}

/// A request for the values of parameters.
#[derive(Debug)]
struct ParameterRequest {
    tool: u64,
    id: Option<String>,
    /// Empty: all.
    names: BTreeSet<String>,
}

#[derive(Debug, Default)]
struct Tool {
    outbox: Arc<Outbox>,
    /// By channel, the number that the tool chose.
    subscriptions: BTreeMap<u32, u32>,
    /// Whether it draws the graph.
    graph: bool,
    /// Whether it has asked for parameters.
    asks: bool,
    /// Parameters whose new values it gets.
    follows: BTreeSet<String>,
    follows_all: bool,
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

    /// Returns whether a tool draws the graph.
    pub(crate) fn draws_graph(&self) -> bool {
        self.state().tools.values().any(|tool| tool.graph)
    }

    /// Sends the changes of the graph to the tools that draw it.
    pub(crate) fn set_graph(&self, new: Graph) {
        let mut state = self.state();
        if let Some(text) = graph::update(&state.graph, &new) {
            state.tools.values().filter(|tool| tool.graph).for_each(|tool| tool.outbox.push_text(text.clone()));
        }
        state.graph = new;
    }

    /// Returns whether a connected tool has asked for parameters.
    pub(crate) fn shows_parameters(&self) -> bool {
        self.state().tools.values().any(|tool| tool.asks)
    }

    /// Returns whether a tool waits for values of parameters.
    pub(crate) fn awaits_parameters(&self) -> bool {
        !self.state().requests.is_empty()
    }

    /// Sends changed values to the tools that follow them, and answers the requests for values.
    pub(crate) fn set_parameters(&self, new: Values) {
        let mut state = self.state();
        let changed: Vec<&Parameter> =
            new.values().filter(|value| state.parameters.get(&value.name) != Some(value)).collect();
        for tool in state.tools.values() {
            let mut followed = changed
                .iter()
                .copied()
                .filter(|value| tool.follows_all || tool.follows.contains(&value.name))
                .peekable();
            if followed.peek().is_some() {
                tool.outbox.push_text(protocol::parameter_values(followed, None));
            }
        }
        for ParameterRequest { tool, id, names } in std::mem::take(&mut state.requests) {
            if let Some(tool) = state.tools.get(&tool) {
                let asked = new.values().filter(|value| names.is_empty() || names.contains(&value.name));
                tool.outbox.push_text(protocol::parameter_values(asked, id.as_deref()));
            }
        }
        state.parameters = new;
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
        let tool = Tool { outbox: outbox.clone(), ..Tool::default() };
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
        let State { channels, tools, begun, graph, requests, .. } = &mut *state;
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
            Ok(Asked::GetParameters { parameter_names, id }) => {
                tool.asks = true;
                if requests.len() < REQUESTS {
                    let names = parameter_names.into_iter().collect();
                    requests.push(ParameterRequest { tool: number, id, names });
                }
            }
            Ok(Asked::SubscribeParameterUpdates { parameter_names }) => {
                tool.asks = true;
                tool.follows_all |= parameter_names.is_empty();
                let free = SUBSCRIPTIONS.saturating_sub(tool.follows.len());
                tool.follows.extend(parameter_names.into_iter().take(free));
            }
            Ok(Asked::UnsubscribeParameterUpdates { parameter_names }) => {
                let all = parameter_names.is_empty();
                tool.follows_all &= !all;
                tool.follows.retain(|name| !all && !parameter_names.contains(name));
            }
            Ok(Asked::SubscribeConnectionGraph) => {
                if !std::mem::replace(&mut tool.graph, true) {
                    graph::update(&Graph::new(), graph).into_iter().for_each(|text| tool.outbox.push_text(text));
                }
            }
            Ok(Asked::UnsubscribeConnectionGraph) => tool.graph = false,
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
