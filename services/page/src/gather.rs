//! Gathers the numbers of all channels for the charts, over a connection of its own with few samples per second.

use crate::fields::STEP_MS;
use crate::link::{self, Browser};
use crate::observer::{Topics, locked};
use crate::settings::PlaceArgs;
use command::Answer;
use gateway_protocol::{Call, Reply};
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;
use tokio::time::{MissedTickBehavior, interval};

/// Samples per second of each channel: one for each kept value.
const RATE_HZ: f64 = 1000.0 / STEP_MS;
/// Kept values between two questions for new channels.
const LOOK: u64 = 8;
/// Largest number of channels; a connection to the gateway has 64 subscriptions.
const CHANNELS: usize = 60;
/// Time until a lost connection is made again.
const AGAIN: Duration = Duration::from_secs(1);
/// Channels without numbers to draw: texts, pictures of the robot, and rows of tables.
const LEFT_OUT: [&str; 7] = ["system/", "visualization/", "operator/", "recorder/", "tf", "log", "map/"];

/// Gathers until the program ends. Where it cannot, the observer says why.
pub(crate) async fn gather(topics: Arc<Topics>, place: PlaceArgs) {
    loop {
        let _ = follow(&topics, &place).await;
        tokio::time::sleep(AGAIN).await;
    }
}

async fn follow(topics: &Topics, place: &PlaceArgs) -> Answer {
    let (mut incoming, mut outgoing, _) = link::connect(place.place(), &Browser::default()).await?;
    let mut subscriptions: BTreeMap<u64, String> = BTreeMap::new();
    let mut clock = interval(Duration::from_millis(STEP_MS as u64));
    clock.set_missed_tick_behavior(MissedTickBehavior::Delay);
    let (mut last_id, mut tick) = (0, 0_u64);
    loop {
        tokio::select! {
            next = incoming.next() => match next? {
                (Reply::Definition { id, size_bytes, schema, .. }, _) => {
                    if let Some(channel) = subscriptions.get(&id) {
                        locked(&topics.fields).define(channel, schema.as_deref(), size_bytes);
                    }
                }
                (Reply::Sample { id, .. }, body) => {
                    if let Some(channel) = subscriptions.get(&id) {
                        locked(&topics.fields).take(channel, &body);
                    }
                }
                (Reply::Channels { channels, .. }, _) => {
                    let is_gone = |name: &String| !channels.iter().any(|row| row.name == *name);
                    let gone: Vec<u64> =
                        subscriptions.iter().filter(|(_, name)| is_gone(name)).map(|(id, _)| *id).collect();
                    for subscription in gone {
                        subscriptions.remove(&subscription);
                        last_id += 1;
                        outgoing.send(&Call::Unsubscribe { id: last_id, subscription }, &[]).await?;
                    }
                    for row in channels {
                        let known = subscriptions.values().any(|name| *name == row.name);
                        if known || !row.has_schema || LEFT_OUT.iter().any(|begins| row.name.starts_with(begins)) {
                            continue;
                        }
                        if subscriptions.len() >= CHANNELS {
                            break;
                        }
                        last_id += 1;
                        subscriptions.insert(last_id, row.name.clone());
                        let call = Call::Subscribe { id: last_id, channel: row.name, rate_hz: Some(RATE_HZ) };
                        outgoing.send(&call, &[]).await?;
                    }
                }
                _ => {}
            },
            _ = clock.tick() => {
                locked(&topics.fields).note(topics.now_ms());
                if tick.is_multiple_of(LOOK) {
                    last_id += 1;
                    outgoing.send(&Call::Channels { id: last_id }, &[]).await?;
                }
                tick += 1;
            }
        }
    }
}
