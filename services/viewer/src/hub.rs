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
/// Largest number of requests of a tool for parameters that wait for their values, and of the bytes that they keep;
/// others are not answered. One request that names every parameter has less.
const REQUESTS: usize = 1000;
const REQUEST_BYTES: usize = 2 << 20;
/// Largest size of the name of a parameter or of a request, bytes. No parameter has a longer one.
const NAME_BYTES: usize = 256;
/// What a name in a set takes beside its bytes, about.
const ENTRY_BYTES: usize = 64;

/// A channel and a tool that has begun to show it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
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
    begun: BTreeSet<Begun>,
    last_channel: u32,
    last_tool: u64,
    graph: Graph,
    parameters: Values,
}

/// A request for the values of parameters.
#[derive(Debug)]
struct ParameterRequest {
    id: Option<String>,
    /// `None`: all.
    names: Option<BTreeSet<String>>,
}

impl ParameterRequest {
    fn bytes(&self) -> usize {
        let names = self.names.iter().flatten().chain(&self.id);
        ENTRY_BYTES + names.map(|name| name.len() + ENTRY_BYTES).sum::<usize>()
    }
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
    /// Requests for parameters that wait for their values, and the bytes that they keep.
    requests: Vec<ParameterRequest>,
    request_bytes: usize,
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
    pub(crate) fn take_begun(&self) -> BTreeSet<Begun> {
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
        self.state().tools.values().any(|tool| !tool.requests.is_empty())
    }

    /// Sends changed values to the tools that follow them, and answers the requests for values.
    pub(crate) fn set_parameters(&self, new: Values) {
        let mut state = self.state();
        let State { parameters, tools, .. } = &mut *state;
        let changed: Vec<&Parameter> =
            new.values().filter(|value| parameters.get(&value.name) != Some(value)).collect();
        for tool in tools.values_mut() {
            let mut followed = changed
                .iter()
                .copied()
                .filter(|value| tool.follows_all || tool.follows.contains(&value.name))
                .peekable();
            if followed.peek().is_some() {
                tool.outbox.push_text(protocol::parameter_values(followed, None));
            }
            tool.request_bytes = 0;
            for ParameterRequest { id, names } in std::mem::take(&mut tool.requests) {
                let asked = new.values().filter(|value| names.as_ref().is_none_or(|names| names.contains(&value.name)));
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
        let mut state = self.state();
        state.tools.remove(&number);
        state.begun.retain(|begun| begun.tool != number);
    }

    /// Carries out a request of a tool.
    pub(crate) fn request(&self, number: u64, text: &str) {
        // What takes long for a long text is done before the viewer and the other tools have to wait.
        let asked = serde_json::from_str(text);
        let name = if matches!(asked, Ok(Asked::Other) | Err(_)) { protocol::name_of(text) } else { String::new() };
        let mut state = self.state();
        let State { channels, tools, begun, graph, .. } = &mut *state;
        let Some(tool) = tools.get_mut(&number) else { return };
        match asked {
            Ok(Asked::Subscribe { subscriptions }) => {
                for Subscription { id, channel_id } in subscriptions {
                    if !channels.contains_key(&channel_id) || tool.subscriptions.len() >= SUBSCRIPTIONS {
                        // Withdrawn while the request was on its way.
                        continue;
                    }
                    if tool.subscriptions.insert(channel_id, id) != Some(id) {
                        begun.insert(Begun { channel: channel_id, tool: number });
                    }
                }
            }
            Ok(Asked::Unsubscribe { subscription_ids }) => {
                tool.subscriptions.retain(|_, id| !subscription_ids.contains(id));
            }
            Ok(Asked::GetParameters { parameter_names, id }) => tool.ask(parameter_names, id),
            Ok(Asked::SubscribeParameterUpdates { parameter_names }) => {
                tool.asks = true;
                tool.follows_all |= parameter_names.is_empty();
                let free = SUBSCRIPTIONS.saturating_sub(tool.follows.len());
                tool.follows.extend(parameter_names.into_iter().filter(|name| name.len() <= NAME_BYTES).take(free));
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
            Ok(Asked::Other) => tool.refuse(&name, "only shows, and does not carry out"),
            Err(_) => tool.refuse(&name, "cannot read"),
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
    /// Keeps a request for the values of parameters until they are known.
    fn ask(&mut self, names: BTreeSet<String>, id: Option<String>) {
        if id.as_ref().is_some_and(|id| id.len() > NAME_BYTES) {
            return self.refuse("getParameters", &format!("takes no id of more than {NAME_BYTES} bytes with"));
        }
        self.asks = true;
        // Without the names that no parameter has, a request for some must not become one for all.
        let names = (!names.is_empty()).then(|| names.into_iter().filter(|name| name.len() <= NAME_BYTES).collect());
        let request = ParameterRequest { id, names };
        let bytes = self.request_bytes + request.bytes();
        if self.requests.len() < REQUESTS && bytes <= REQUEST_BYTES {
            self.request_bytes = bytes;
            self.requests.push(request);
        }
    }

    /// A tool that asks for the same again gets no second answer.
    fn refuse(&mut self, request: &str, why: &str) {
        if self.warned.len() < CHANNELS && self.warned.insert(request.to_owned()) {
            self.outbox.push_text(protocol::warning(&format!("the viewer of nims {why} the request {request}")));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn hub_with_channel() -> (Hub, u32) {
        let hub = Hub::new("test", String::new());
        let (topic, schema_name, schema) = ("/a".to_owned(), String::new(), String::new());
        let channel = Advertised { id: 0, topic, encoding: "cdr", schema_name, schema, schema_encoding: "ros2msg" };
        let id = hub.advertise(channel);
        (hub, id)
    }

    #[test]
    fn a_channel_begins_once_however_often_a_tool_asks_for_it() {
        let (hub, channel) = hub_with_channel();
        let (tool, _) = hub.connect();
        for id in 0..100 {
            let asked = json!({"op": "subscribe", "subscriptions": [{"id": id, "channelId": channel}]});
            hub.request(tool, &asked.to_string());
        }
        assert_eq!(hub.state().begun.len(), 1);
        hub.disconnect(tool);
        assert_eq!(hub.take_begun().len(), 0, "of a tool that has gone");
    }

    #[test]
    fn what_a_tool_asks_for_is_bounded_in_bytes_and_ends_with_it() {
        let (hub, _) = hub_with_channel();
        let (tool, _) = hub.connect();
        let names: Vec<String> = (0..3000).map(|at| format!("{at:0>256}")).collect();
        let asked = json!({"op": "getParameters", "parameterNames": names}).to_string();
        for _ in 0..50 {
            hub.request(tool, &asked);
        }
        let kept: usize = hub.state().tools[&tool].requests.iter().map(ParameterRequest::bytes).sum();
        assert!(kept > 0 && kept <= REQUEST_BYTES, "{kept} bytes");
        assert!(hub.awaits_parameters());
        // The requests of another tool still have their place.
        let (other, outbox) = hub.connect();
        hub.request(other, r#"{"op":"getParameters","id":"x"}"#);
        assert_eq!(hub.state().tools[&other].requests.len(), 1);
        drop(outbox);
        hub.disconnect(other);
        hub.disconnect(tool);
        assert!(!hub.awaits_parameters() && !hub.shows_parameters());
    }

    #[test]
    fn names_that_no_parameter_can_have_are_not_kept() {
        let (hub, _) = hub_with_channel();
        let (tool, _) = hub.connect();
        let long = "x".repeat(NAME_BYTES + 1);
        for op in ["getParameters", "subscribeParameterUpdates"] {
            hub.request(tool, &json!({"op": op, "parameterNames": [long]}).to_string());
        }
        hub.request(tool, &json!({"op": "getParameters", "id": long}).to_string());
        let state = hub.state();
        let tool = &state.tools[&tool];
        assert!(tool.follows.is_empty() && !tool.follows_all);
        assert_eq!(tool.requests.len(), 1, "the one with a long id is refused");
        assert_eq!(tool.requests[0].names, Some(BTreeSet::new()), "none, and not all");
    }
}
