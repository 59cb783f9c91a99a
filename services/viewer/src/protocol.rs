//! The messages of Foxglove's WebSocket protocol that the viewer reads and writes.
//!
//! `foxglove.sdk.v1` and the older `foxglove.websocket.v1` are two names for the same messages, as far as a server that
//! only shows needs them. Their description: <https://github.com/foxglove/ws-protocol/blob/main/docs/spec.md>.

use std::collections::BTreeSet;

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::parameters::Parameter;

/// The versions of the protocol, the preferred one first.
pub(crate) const VERSIONS: [&str; 2] = ["foxglove.sdk.v1", "foxglove.websocket.v1"];
/// What the server can do beyond channels.
const CAPABILITIES: [&str; 3] = ["connectionGraph", "parameters", "parametersSubscribe"];
/// First byte of a binary message that contains a sample.
const SAMPLE: u8 = 1;
/// Severity of a status.
const WARNING: u8 = 1;

/// A channel as tools see it.
#[derive(Debug, Clone, Serialize)]
#[serde(rename_all = "camelCase")]
pub(crate) struct Advertised {
    /// Identifies the channel on every connection; never used again.
    pub(crate) id: u32,
    pub(crate) topic: String,
    /// Encoding of the samples.
    pub(crate) encoding: &'static str,
    pub(crate) schema_name: String,
    pub(crate) schema: String,
    pub(crate) schema_encoding: &'static str,
}

/// A request of a tool.
#[derive(Debug, PartialEq, Eq, Deserialize)]
#[serde(tag = "op", rename_all = "camelCase")]
pub(crate) enum Asked {
    /// Send the samples of these channels.
    Subscribe {
        /// The channels.
        subscriptions: Vec<Subscription>,
    },
    /// Send no more samples of these.
    #[serde(rename_all = "camelCase")]
    Unsubscribe {
        /// Numbers that the tool chose.
        subscription_ids: BTreeSet<u32>,
    },
    /// Send the values of these parameters; none named: of all.
    #[serde(rename_all = "camelCase")]
    GetParameters {
        #[serde(default)]
        parameter_names: BTreeSet<String>,
        /// The answer contains it.
        id: Option<String>,
    },
    /// Send each new value of these parameters; none named: of all.
    #[serde(rename_all = "camelCase")]
    SubscribeParameterUpdates {
        #[serde(default)]
        parameter_names: BTreeSet<String>,
    },
    /// Send no more new values of these parameters; none named: of all.
    #[serde(rename_all = "camelCase")]
    UnsubscribeParameterUpdates {
        #[serde(default)]
        parameter_names: BTreeSet<String>,
    },
    /// Send who publishes and subscribes, and each change of it.
    SubscribeConnectionGraph,
    /// Send no more of it.
    UnsubscribeConnectionGraph,
    /// Anything else.
    #[serde(other)]
    Other,
}

/// A channel that a tool shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(crate) struct Subscription {
    /// The number under which the tool expects the samples.
    pub(crate) id: u32,
    pub(crate) channel_id: u32,
}

/// Describes the server.
pub(crate) fn server_info(name: &str, session: &str) -> String {
    json!({ "op": "serverInfo", "name": name, "capabilities": CAPABILITIES, "supportedEncodings": ["cdr"],
            "metadata": {}, "sessionId": session })
    .to_string()
}

/// Offers channels.
pub(crate) fn advertise<'a>(channels: impl IntoIterator<Item = &'a Advertised>) -> String {
    json!({ "op": "advertise", "channels": channels.into_iter().collect::<Vec<_>>() }).to_string()
}

/// Values of parameters; with the name of the request that it answers.
pub(crate) fn parameter_values<'a>(values: impl Iterator<Item = &'a Parameter>, id: Option<&str>) -> String {
    let mut message = json!({ "op": "parameterValues", "parameters": values.collect::<Vec<_>>() });
    if let Some(id) = id {
        message["id"] = json!(id);
    }
    message.to_string()
}

/// Withdraws a channel.
pub(crate) fn unadvertise(id: u32) -> String {
    json!({ "op": "unadvertise", "channelIds": [id] }).to_string()
}

/// Tells the user of a tool something.
pub(crate) fn warning(message: &str) -> String {
    json!({ "op": "status", "level": WARNING, "message": message }).to_string()
}

/// A sample under the number that the tool chose, with the UNIX time of its publication.
pub(crate) fn sample(subscription: u32, unix_ns: u64, body: &[u8]) -> Vec<u8> {
    let mut message = Vec::with_capacity(1 + 4 + 8 + body.len());
    message.push(SAMPLE);
    message.extend(subscription.to_le_bytes());
    message.extend(unix_ns.to_le_bytes());
    message.extend(body);
    message
}

/// Returns the name of the request that a text contains, for a sentence about it.
pub(crate) fn name_of(text: &str) -> String {
    let parsed: Option<Value> = serde_json::from_str(text).ok();
    let name = parsed.as_ref().and_then(|value| value.get("op")?.as_str()).unwrap_or("?");
    name.chars().filter(|letter| letter.is_ascii_alphanumeric() || *letter == '?').take(40).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn requests_are_read_as_tools_write_them() {
        let text = r#"{"op":"subscribe","subscriptions":[{"id":0,"channelId":3},{"id":1,"channelId":5}]}"#;
        let subscriptions = vec![Subscription { id: 0, channel_id: 3 }, Subscription { id: 1, channel_id: 5 }];
        assert_eq!(serde_json::from_str::<Asked>(text).unwrap(), Asked::Subscribe { subscriptions });
        let text = r#"{"op":"unsubscribe","subscriptionIds":[0,1]}"#;
        assert_eq!(
            serde_json::from_str::<Asked>(text).unwrap(),
            Asked::Unsubscribe { subscription_ids: BTreeSet::from([0, 1]) }
        );
        let text = r#"{"op":"getParameters","parameterNames":[],"id":"get-all-params"}"#;
        let id = Some("get-all-params".to_owned());
        let all = BTreeSet::new();
        assert_eq!(serde_json::from_str::<Asked>(text).unwrap(), Asked::GetParameters { parameter_names: all, id });
        let text = r#"{"op":"subscribeConnectionGraph"}"#;
        assert_eq!(serde_json::from_str::<Asked>(text).unwrap(), Asked::SubscribeConnectionGraph);
        let text = r#"{"op":"advertise","channels":[{"id":1}]}"#;
        assert_eq!(serde_json::from_str::<Asked>(text).unwrap(), Asked::Other);
        assert_eq!(name_of(text), "advertise");
        for text in ["", "{}", "[]", r#"{"op":7}"#, r#"{"op":"subscribe","subscriptions":[{"id":-1,"channelId":0}]}"#] {
            assert!(serde_json::from_str::<Asked>(text).is_err(), "{text}");
        }
        assert_eq!(name_of(r#"{"op":"a b\n[31m"}"#), "ab31m");
    }

    #[test]
    fn a_sample_has_its_number_and_its_time_in_front() {
        assert_eq!(sample(7, 258, b"ab"), [1, 7, 0, 0, 0, 2, 1, 0, 0, 0, 0, 0, 0, b'a', b'b']);
    }
}
