//! The graph of processes and channels, for tools that draw it.

use std::collections::{BTreeMap, BTreeSet, VecDeque};

use bus::{Bus, BusError};
use serde_json::{Value, json};

/// The processes at a channel, by name.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(crate) struct Ends {
    pub(crate) publishers: BTreeSet<String>,
    pub(crate) subscribers: BTreeSet<String>,
}

/// By topic, the processes that publish and subscribe.
pub(crate) type Graph = BTreeMap<String, Ends>;

/// Channels that are read at once. One takes about a quarter of a millisecond, and meanwhile no sample is forwarded.
const AT_ONCE: usize = 4;

/// Reads who publishes and who subscribes, a few channels at a time.
#[derive(Debug)]
pub(crate) struct Survey {
    waiting: VecDeque<String>,
    /// Names of the processes, by their ids.
    names: BTreeMap<u32, String>,
    graph: Graph,
}

impl Survey {
    /// Begins to read these channels.
    pub(crate) fn begin<'a>(bus: &Bus, channels: impl Iterator<Item = &'a str>) -> Self {
        let names = bus.domain().alive().into_iter().map(|process| (process.pid, process.name)).collect();
        Self { waiting: channels.map(str::to_owned).collect(), names, graph: Graph::new() }
    }

    /// Reads a few channels; returns the graph after the last one. A channel that was removed meanwhile is left out.
    pub(crate) fn step(&mut self, bus: &Bus) -> Option<Graph> {
        self.step_by(|channel| bus.ends(channel))
    }

    fn step_by(&mut self, ends_of: impl Fn(&str) -> Result<(Vec<(u128, u32)>, Vec<u32>), BusError>) -> Option<Graph> {
        let Self { waiting, names, graph } = self;
        let name_of = |pid: u32| names.get(&pid).cloned().unwrap_or_else(|| format!("process {pid}"));
        for channel in waiting.drain(..waiting.len().min(AT_ONCE)) {
            if let Ok((publishers, subscribers)) = ends_of(&channel) {
                let publishers = publishers.into_iter().map(|(_, pid)| name_of(pid)).collect();
                let subscribers = subscribers.into_iter().map(name_of).collect();
                graph.insert(format!("/{channel}"), Ends { publishers, subscribers });
            }
        }
        self.waiting.is_empty().then(|| std::mem::take(&mut self.graph))
    }
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
    use std::cell::RefCell;

    #[test]
    fn a_survey_reads_each_channel_once_and_few_at_a_time() {
        let channels: Vec<String> = (0..60).map(|at| format!("sensor/{at}")).collect();
        let names = BTreeMap::from([(1, "p".to_owned())]);
        let mut survey = Survey { waiting: channels.clone().into(), names, graph: Graph::new() };
        let read = RefCell::new(Vec::new());
        let mut before = 0;
        let graph = loop {
            let graph = survey.step_by(|channel| {
                read.borrow_mut().push(channel.to_owned());
                Ok((vec![(7, 1)], vec![2]))
            });
            let count = read.borrow().len();
            assert!(count - before <= AT_ONCE, "{count} after {before}");
            before = count;
            if let Some(graph) = graph {
                break graph;
            }
        };
        assert_eq!(read.into_inner(), channels);
        assert_eq!(graph.len(), channels.len());
        assert_eq!(graph["/sensor/59"], ends(&["p"], &["process 2"]));
    }

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
