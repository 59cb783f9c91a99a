//! The graph of processes and channels, for tools that draw it.

use std::collections::{BTreeMap, BTreeSet};

use bus::Bus;
use serde_json::{Value, json};

/// The processes at a channel, by name.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(crate) struct Ends {
    pub(crate) publishers: BTreeSet<String>,
    pub(crate) subscribers: BTreeSet<String>,
}

/// By topic, the processes that publish and subscribe.
pub(crate) type Graph = BTreeMap<String, Ends>;

/// Reads who publishes and who subscribes to these channels; one that was removed meanwhile is left out. Takes about
/// half a millisecond per channel.
pub(crate) fn read<'a>(bus: &Bus, channels: impl Iterator<Item = &'a str>) -> Graph {
    let names: BTreeMap<u32, String> =
        bus.domain().alive().into_iter().map(|process| (process.pid, process.name)).collect();
    let name_of = |pid: u32| names.get(&pid).cloned().unwrap_or_else(|| format!("process {pid}"));
    let mut graph = Graph::new();
    for channel in channels {
        if let (Ok(publishers), Ok(subscribers)) = (bus.publishers(channel), bus.subscribers(channel)) {
            let publishers = publishers.into_iter().map(|(_, pid)| name_of(pid)).collect();
            let subscribers = subscribers.into_iter().map(name_of).collect();
            graph.insert(format!("/{channel}"), Ends { publishers, subscribers });
        }
    }
    graph
}

/// Returns what a tool that shows `old` needs to show `new`; `None` if they are equal.
pub(crate) fn update(old: &Graph, new: &Graph) -> Option<String> {
    let changed: Vec<(&String, &Ends)> = new.iter().filter(|(topic, ends)| old.get(*topic) != Some(*ends)).collect();
    let removed: Vec<&String> = old.keys().filter(|topic| !new.contains_key(*topic)).collect();
    if changed.is_empty() && removed.is_empty() {
        return None;
    }
    let published: Vec<Value> =
        changed.iter().map(|(topic, ends)| json!({ "name": topic, "publisherIds": ends.publishers })).collect();
    let subscribed: Vec<Value> =
        changed.iter().map(|(topic, ends)| json!({ "name": topic, "subscriberIds": ends.subscribers })).collect();
    let update = json!({ "op": "connectionGraphUpdate", "publishedTopics": published, "subscribedTopics": subscribed,
                         "advertisedServices": [], "removedTopics": removed, "removedServices": [] });
    Some(update.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ends(publishers: &[&str], subscribers: &[&str]) -> Ends {
        let set = |names: &[&str]| names.iter().map(|name| (*name).to_owned()).collect();
        Ends { publishers: set(publishers), subscribers: set(subscribers) }
    }

    #[test]
    fn an_update_contains_what_changed_and_nothing_else() {
        let old = Graph::from([("/a".to_owned(), ends(&["p"], &[])), ("/b".to_owned(), ends(&["p"], &["q"]))]);
        let new = Graph::from([("/b".to_owned(), ends(&["p"], &[])), ("/c".to_owned(), ends(&["q"], &["p", "r"]))]);
        let text = update(&old, &new).unwrap();
        let found: Value = serde_json::from_str(&text).unwrap();
        assert_eq!(found["removedTopics"], json!(["/a"]));
        let published = [json!({"name": "/b", "publisherIds": ["p"]}), json!({"name": "/c", "publisherIds": ["q"]})];
        assert_eq!(found["publishedTopics"], json!(published));
        assert_eq!(found["subscribedTopics"][0]["subscriberIds"], json!([]));
        assert_eq!(found["subscribedTopics"][1]["subscriberIds"], json!(["p", "r"]));
        assert_eq!(update(&new, &new), None);
    }
}
