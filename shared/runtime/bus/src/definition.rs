//! The schema text of a channel's type, stored with the channel.
//!
//! The process that creates a channel stores the text in its attributes: `schema.hash`, and the parts `schema.0`,
//! `schema.1`, ... iceoryx2 has room for 1792 bytes of text there. A longer text continues in the attributes of
//! additional events, `schema/HASH/1`, `schema/HASH/2`, ..., which every process with the channel open keeps open too.
//! So the text outlives its creator, and programs in any language can read it.
//!
//! Types of this build are stored without their comments, which every reader of this build has; so they need few
//! continuations. Other types are stored as they are.

use iceoryx2::node::Node;
use iceoryx2::prelude::{AttributeSpecifier, MessagingPattern, SemanticString, Service, ServiceName, ipc};
use iceoryx2::service::ServiceDetails;
use iceoryx2::service::attribute::AttributeSet;
use iceoryx2::service::builder::event::Builder;
use messages::schema::{is_same, without_comments};
use messages::{CHANNELS, documented, hash_of};
use std::borrow::Cow;
use std::collections::HashMap;

use crate::error::PlaceKind;
use crate::event::{self, Event};
use crate::{BusError, Domain};

/// Bytes of one attribute's value, and attributes of one service (constants of iceoryx2).
const ATTRIBUTE_BYTES: usize = 256;
const ATTRIBUTES: usize = 8;
/// Attribute with the hash of the text.
const HASH: &str = "schema.hash";
/// Prefix of the attributes with the parts of the text, which are numbered from 0 in each service.
const PART: &str = "schema.";
/// Attribute with the largest length of a sample of a channel of blobs, bytes.
const LIMIT: &str = "blob.bytes";
/// Bytes of text in the channel itself, next to the hash.
const FIRST_BYTES: usize = (ATTRIBUTES - 1) * ATTRIBUTE_BYTES;
/// Bytes of text in a continuation.
const CONTINUATION_BYTES: usize = ATTRIBUTES * ATTRIBUTE_BYTES;
/// Largest number of continuations: 32 kB of text, enough for more than a thousand fields.
const CONTINUATIONS: usize = 15;
/// Most bytes of text.
const ROOM: usize = FIRST_BYTES + CONTINUATIONS * CONTINUATION_BYTES;

/// Returns the text that is stored for a type.
pub(crate) fn stored<'a>(type_name: &str, text: &'a str) -> Cow<'a, str> {
    // Comments are no reason to refuse a type.
    let is_plain = documented(type_name).is_none() && text.is_ascii() && text.len() <= ROOM;
    if is_plain { Cow::Borrowed(text) } else { Cow::Owned(without_comments(text)) }
}

/// Returns the attributes of a channel of this type, whose text is [`stored`].
pub(crate) fn attributes(type_name: &str, text: &str) -> Result<AttributeSpecifier, BusError> {
    let unfit = |why: String| BusError::Schema { type_name: type_name.to_owned(), why };
    if !text.is_ascii() {
        return Err(unfit("it has a character that is not ASCII".to_owned()));
    }
    if text.len() > ROOM {
        return Err(unfit(format!("it has {} bytes; accepted: at most {ROOM}", text.len())));
    }
    let specifier = define(AttributeSpecifier::new(), HASH, &hash(text));
    let refused = || unfit("iceoryx2 rejects a part of it".to_owned());
    specifier.and_then(|specifier| parts(specifier, first(text))).ok_or_else(refused)
}

/// Returns the attributes with the largest length of a sample; `None` if there is no room beside the text.
pub(crate) fn with_limit(attributes: &AttributeSpecifier, most_bytes: usize) -> Option<AttributeSpecifier> {
    define(attributes.clone(), LIMIT, &most_bytes.to_string())
}

/// Returns the largest length of a sample of a channel of blobs; 0 if it is not stated.
pub(crate) fn limit(attributes: &AttributeSet) -> usize {
    value(attributes, LIMIT).and_then(|text| text.parse().ok()).unwrap_or_default()
}

/// Creates or opens the continuations of this text. To be called before the channel is created, so that a process that
/// finds the channel can read the whole text. Waits until `give_up` while another process creates one.
pub(crate) fn continuations(
    node: &Node<ipc::Service>,
    domain: &Domain,
    text: &str,
    processes: usize,
    give_up: u64,
) -> Result<Vec<Event>, BusError> {
    let rest = text.get(FIRST_BYTES..).unwrap_or_default();
    (1..)
        .zip(chunks(rest, CONTINUATION_BYTES))
        .map(|(number, part)| {
            continuation(node, domain, &continuation_name(&hash(text), number), part, processes, give_up)
        })
        .collect()
}

/// Returns the number of continuations of all types of this build.
pub(crate) fn own_continuations() -> usize {
    let texts: HashMap<_, _> = CHANNELS.iter().filter_map(|row| Some(((row.type_name?)(), (row.schema?)()))).collect();
    let bytes = |(name, text): (&str, &str)| stored(name, text).len().saturating_sub(FIRST_BYTES);
    texts.into_iter().map(|text| bytes(text).div_ceil(CONTINUATION_BYTES)).sum()
}

fn continuation(
    node: &Node<ipc::Service>,
    domain: &Domain,
    name: &str,
    part: &str,
    processes: usize,
    give_up: u64,
) -> Result<Event, BusError> {
    let service = ServiceName::new(name).map_err(|error| BusError::failed(name, "be named", &error))?;
    let specifier = parts(AttributeSpecifier::new(), part);
    let specifier = specifier.ok_or_else(|| BusError::failed(name, "be written", &"iceoryx2 rejects a part of it"))?;
    let builder = || node.service_builder(&service).event();
    let sized = |event: Builder<ipc::Service>| event.max_notifiers(1).max_listeners(1).max_nodes(processes);
    let create = |event| sized(event).create_with_attributes(&specifier);
    event::open_or_create(domain, name, builder, create, give_up)?.ok_or_else(|| {
        let (channel, what) = (name.to_owned(), PlaceKind::RobotProcesses);
        let limit = details(domain, name).map_or(processes, |found| found.static_details.event().max_nodes());
        BusError::Full { channel, limit, what, holders: String::new() }
    })
}

/// Reads the schema text and its hash from a channel; the text only if it matches the hash. That of a type of this
/// build has its comments.
pub(crate) fn read(domain: &Domain, type_name: &str, attributes: &AttributeSet) -> (Option<String>, Option<String>) {
    let hash_stated = value(attributes, HASH);
    let mut text = joined(attributes);
    let is_whole = |text: &str| hash_stated.as_ref().is_none_or(|stated| *stated == hash(text));
    for number in 1..=CONTINUATIONS {
        if is_whole(&text) || text.len() < FIRST_BYTES {
            break;
        }
        let Some(stated) = &hash_stated else { break };
        let details = details(domain, &continuation_name(stated, number));
        let Some(details) = details else { break };
        text.push_str(&joined(details.static_details.attributes()));
    }
    let whole = !text.is_empty() && is_whole(&text);
    let known = documented(type_name).filter(|known| whole && is_same(known, &text)).map(str::to_owned);
    (known.or(whole.then_some(text)), hash_stated)
}

fn details(domain: &Domain, event: &str) -> Option<ServiceDetails<ipc::Service>> {
    let name = ServiceName::new(event).ok()?;
    ipc::Service::details(&name, domain.config(), MessagingPattern::Event).ok().flatten()
}

/// Opens the continuations of the text that another process has stored with a channel, if it is another text of the
/// same type: they end with the last process that holds them.
pub(crate) fn hold_others(node: &Node<ipc::Service>, own: &str, attributes: &AttributeSet) -> Vec<Event> {
    let Some(stated) = value(attributes, HASH).filter(|stated| *stated != hash(own)) else { return Vec::new() };
    let open = |number| {
        let service = ServiceName::new(&continuation_name(&stated, number)).ok()?;
        node.service_builder(&service).event().open().ok()
    };
    (1..=CONTINUATIONS).map_while(open).collect()
}

fn hash(text: &str) -> String {
    format!("{:08x}", hash_of(text))
}

fn continuation_name(hash: &str, number: usize) -> String {
    format!("schema/{hash}/{number}")
}

fn first(text: &str) -> &str {
    text.get(..FIRST_BYTES).unwrap_or(text)
}

/// Splits an ASCII text into pieces of at most `bytes` bytes.
fn chunks(text: &str, bytes: usize) -> impl Iterator<Item = &str> {
    text.as_bytes().chunks(bytes).filter_map(|part| std::str::from_utf8(part).ok())
}

fn parts(specifier: AttributeSpecifier, text: &str) -> Option<AttributeSpecifier> {
    chunks(text, ATTRIBUTE_BYTES)
        .enumerate()
        .try_fold(specifier, |specifier, (number, part)| define(specifier, &format!("{PART}{number}"), part))
}

fn define(specifier: AttributeSpecifier, key: &str, value: &str) -> Option<AttributeSpecifier> {
    specifier.define(&key.try_into().ok()?, &value.try_into().ok()?).ok()
}

fn joined(attributes: &AttributeSet) -> String {
    (0..).map_while(|part| value(attributes, &format!("{PART}{part}"))).collect()
}

fn value(attributes: &AttributeSet, wanted: &str) -> Option<String> {
    attributes
        .iter()
        .find(|attribute| attribute.key().as_bytes() == wanted.as_bytes())
        .map(|attribute| String::from_utf8_lossy(attribute.value().as_bytes()).into_owned())
}
