//! The layouts for Foxglove and PlotJuggler name topics and fields that exist.

use messages::channel_of;
use messages::schema::Schema;
use serde_json::Value;

fn layout(name: &str) -> String {
    std::fs::read_to_string(format!("{}/../configs/layouts/{name}", env!("CARGO_MANIFEST_DIR"))).unwrap()
}

/// Whether a topic has a field, with an index in its range.
fn check(topic: &str, field: &str) {
    let name = topic.strip_prefix('/').unwrap();
    let channel = channel_of(name).unwrap_or_else(|| panic!("there is no channel {name}"));
    let schema = Schema::parse(channel.schema.unwrap()()).unwrap();
    let (path, index) = field
        .split_once('[')
        .map_or((field, None), |(path, rest)| (path, Some(rest.strip_suffix(']').unwrap().parse::<usize>().unwrap())));
    let found = schema.field(path).unwrap_or_else(|| panic!("{topic} has no field {path}"));
    assert_eq!(index.is_some(), found.count.is_some(), "{topic} {field}");
    assert!(index.is_none_or(|index| index < found.count.unwrap()), "{topic} {field}");
}

fn strings(value: &Value, found: &mut Vec<String>) {
    match value {
        Value::String(text) => found.push(text.clone()),
        Value::Array(all) => all.iter().for_each(|one| strings(one, found)),
        Value::Object(all) => all.values().for_each(|one| strings(one, found)),
        _ => {}
    }
}

#[test]
fn foxglove() {
    let layout: Value = serde_json::from_str(&layout("foxglove.json")).unwrap();
    let panels = layout["configById"].as_object().unwrap();
    let mut named = Vec::new();
    strings(&layout["layout"], &mut named);
    named.retain(|name| name.contains('!'));
    named.sort();
    assert_eq!(named, panels.keys().cloned().collect::<Vec<_>>(), "every panel is shown once");
    let mut fields = 0;
    for (name, panel) in panels {
        for path in panel["paths"].as_array().into_iter().flatten() {
            let (topic, field) = path["value"].as_str().unwrap().split_once('.').unwrap();
            check(topic, field);
            fields += 1;
        }
        let topics = panel["topics"].as_object().into_iter().flat_map(|topics| topics.keys().map(String::as_str));
        for topic in topics.chain(panel["topicToRender"].as_str()) {
            assert!(channel_of(&topic[1..]).is_some(), "{name}: there is no channel {topic}");
        }
    }
    assert!(fields > 20);
}

#[test]
fn plotjuggler() {
    let layout = layout("plotjuggler.xml");
    for tag in ["root", "tabbed_widget", "Tab", "Container", "DockSplitter", "DockArea", "plot"] {
        let open = layout.matches(&format!("<{tag} ")).count() + layout.matches(&format!("<{tag}>")).count();
        assert_eq!(open, layout.matches(&format!("</{tag}>")).count(), "<{tag}>");
    }
    let curves: Vec<&str> =
        layout.split("<curve name=\"").skip(1).map(|rest| rest.split('"').next().unwrap()).collect();
    assert!(curves.len() > 20);
    for curve in curves {
        let (topic, field) = curve.rsplit_once('/').unwrap();
        check(topic, field);
    }
}
