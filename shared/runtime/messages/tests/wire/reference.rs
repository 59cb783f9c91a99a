//! Every field says what it means, and `docs/channels.md` says it to readers of run files.

use messages::schema::split;
use messages::{CHANNELS, Channel, Message, RecorderGap};
use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::path::Path;

/// Set to `1`, the document is written, and not compared.
const RENEW: &str = "NIMS_RENEW";

const HEAD: &str = "\
# Channels

Every channel of a robot, the type of its samples, and what their fields mean. The same texts are in every run file as
the definitions of its schemas, so Foxglove, `mcap info` and other readers show them. Written by
`NIMS_RENEW=1 cargo test -p messages --test wire`; the comments are those of `shared/runtime/messages/src`.

Lengths are in m, forces in N, angles in rad, times in ns of CLOCK_MONOTONIC or in s, as the suffix of the name says.
Arrays by cable and by unit have room for the largest robot; `cable_count` says how many entries are used. Choices are
numbers with names. `pad0` and the like are unused bytes.

| channel | published by | type | bytes | kept for late readers |
|---|---|---|---|---|
";

/// Type name without its hash, and the documented definition, of the types of this project.
fn own(channel: &Channel) -> Option<(&'static str, &'static str)> {
    let name = (channel.type_name?)().strip_prefix("nims_msgs/")?.split('/').next()?;
    Some((name, (channel.schema?)()))
}

fn types() -> Vec<(&'static str, &'static str)> {
    let mut seen = BTreeSet::new();
    let table = CHANNELS.iter().filter_map(own).chain([("RecorderGap", RecorderGap::schema())]);
    table.filter(|(name, _)| seen.insert(*name)).collect()
}

fn document() -> String {
    let mut text = HEAD.to_owned();
    for channel in CHANNELS {
        let name = channel.type_name.map(|name| name().rsplit_once('/').map_or("", |(name, _)| name));
        let bytes = own(channel).map(|(_, schema)| messages::schema::Schema::parse(schema).unwrap().size().to_string());
        let own = own(channel).map(|(name, _)| format!("[{name}](#{})", name.to_lowercase()));
        let kind = own.or(name.map(|name| format!("`{name}` of ROS 2"))).unwrap_or("any".to_owned());
        let bytes = bytes.unwrap_or("varies".to_owned());
        let Channel { pattern, publisher, quality, .. } = channel;
        let kept = quality.kept();
        writeln!(text, "| `{pattern}` | {publisher} | {kind} | {bytes} | {kept} |").unwrap();
    }
    text.push_str("\nEvery sample begins with this header:\n");
    let mut nested = BTreeSet::new();
    let (_, any) = types()[0];
    block(&mut text, split(any).iter().find(|(name, _)| *name == "nims_msgs/Header").unwrap().1);
    nested.insert("nims_msgs/Header");
    for (name, schema) in types() {
        write!(text, "\n## {name}\n").unwrap();
        for (at, (nested_name, lines)) in split(schema).into_iter().enumerate() {
            if at > 0 && types().iter().any(|(name, _)| nested_name.strip_prefix("nims_msgs/") == Some(name)) {
                continue;
            }
            if at == 0 {
                block(&mut text, lines);
            } else if nested.insert(nested_name) {
                write!(text, "\n`{nested_name}`:\n").unwrap();
                block(&mut text, lines);
            }
        }
    }
    text
}

fn block(text: &mut String, lines: &str) {
    writeln!(text, "\n```\n{}\n```", lines.trim_end()).unwrap();
}

#[test]
fn the_reference_of_channels_is_up_to_date() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../docs/channels.md");
    let text = document();
    if std::env::var_os(RENEW).is_some_and(|value| value == "1") {
        std::fs::write(&path, text).unwrap();
        return;
    }
    let before = std::fs::read_to_string(&path).unwrap_or_default();
    assert!(before == text, "docs/channels.md is older than the messages; run this test with {RENEW}=1 to renew it");
}

/// A field of which the comment is missing would be the one that a reader asks about.
#[test]
fn every_field_says_what_it_means() {
    for (name, schema) in types() {
        for (part, lines) in split(schema) {
            let mut explained = false;
            for line in lines.lines() {
                let field = line.split(' ').nth(1).unwrap_or_default();
                let needs_none = field.starts_with("pad") || line == "nims_msgs/Header header";
                // A constant belongs to the field below it, and has a name that speaks.
                if line.starts_with('#') {
                    explained = true;
                } else if !line.contains('=') {
                    assert!(explained || needs_none, "{name} {part}: `{line}` has no comment");
                    explained = false;
                }
            }
        }
    }
}
