//! Observes the robot through one connection to the gateway, for all browsers together.

use crate::fields::Fields;
use crate::history::History;
use crate::link::{self, Browser, Incoming, Outgoing};
use crate::robot::{CHANNELS, Happened, LOGS, Robot};
use crate::scene::Scene;
use crate::settings::PlaceArgs;
use crate::setup;
use axum::extract::ws::Utf8Bytes;
use bus::clock::now_ns;
use command::Answer;
use gateway_protocol::{Call, Reply};
use serde_json::{Value, json};
use site_calibration::setup::captured::{CapturedLengths, UpAndDown};
use std::collections::{BTreeMap, VecDeque};
use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use tokio::sync::{broadcast, watch};
use tokio::time::{MissedTickBehavior, interval};

/// Time between two states that are sent to browsers: 20 per second.
const LIVE: Duration = Duration::from_millis(50);
/// Ticks of that clock between two looks at what changes rarely.
const SLOWLY: u64 = 10;
/// Ticks between two states without a new sample, so that their age is seen.
const AGEING: u64 = 5;
/// Ticks between two questions for the robot and its channels.
const LOOK: u64 = 20;
/// Time until a lost connection is made again.
const AGAIN: Duration = Duration::from_millis(500);
/// Events that are kept for browsers that connect later, and that may wait for a slow one.
const EVENTS: usize = 128;
/// Logs that are subscribed to; a connection to the gateway has 64 subscriptions.
const MOST_LOGS: usize = 48;

/// What browsers receive: of each topic the newest text, and every event.
#[derive(Debug)]
pub(crate) struct Topics {
    begun: Instant,
    robot: Mutex<Robot>,
    scene: Mutex<Option<Arc<Scene>>>,
    history: Mutex<History>,
    pub(crate) fields: Mutex<Fields>,
    /// The newest text of each topic, in the order in which a browser receives them first.
    pub(crate) newest: [watch::Sender<Utf8Bytes>; 5],
    pub(crate) events: broadcast::Sender<Utf8Bytes>,
    recent: Mutex<VecDeque<Utf8Bytes>>,
}

/// Places in `newest`.
const LINK: usize = 0;
const SCENE: usize = 1;
const SLOW: usize = 2;
const PLAN: usize = 3;
const STATE: usize = 4;

impl Default for Topics {
    fn default() -> Self {
        let topic = || watch::Sender::new(Utf8Bytes::default());
        Self {
            begun: Instant::now(),
            robot: Mutex::default(),
            scene: Mutex::default(),
            history: Mutex::default(),
            fields: Mutex::default(),
            newest: [topic(), topic(), topic(), topic(), topic()],
            events: broadcast::Sender::new(EVENTS),
            recent: Mutex::default(),
        }
    }
}

pub(crate) fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Topics {
    /// The robot that is drawn, if its configuration is known.
    pub(crate) fn scene(&self) -> Option<Arc<Scene>> {
        locked(&self.scene).clone()
    }

    /// The time of this server that states carry and that browsers return, ms.
    pub(crate) fn now_ms(&self) -> f64 {
        self.begun.elapsed().as_secs_f64() * 1e3
    }

    /// The state now, for the plain page.
    pub(crate) fn live(&self) -> Value {
        locked(&self.robot).live(now_ns())
    }

    /// The lengths of the robot as the guided calibration captures them.
    pub(crate) fn captured(&self) -> Result<CapturedLengths, String> {
        let counts_per_m = self.scene().map(|scene| scene.counts_per_m.clone());
        let robot = locked(&self.robot);
        let is_fresh = robot.age_s(now_ns()).is_some_and(|age_s| age_s < 1.0);
        setup::captured(robot.motors().filter(|_| is_fresh), counts_per_m)
    }

    /// The place at which the robot hangs, as the measurements with a weight capture it.
    pub(crate) fn place(&self) -> Result<[f64; 3], String> {
        let counts_per_m = self.scene().map(|scene| scene.counts_per_m.clone());
        let robot = locked(&self.robot);
        let is_fresh = robot.age_s(now_ns()).is_some_and(|age_s| age_s < 1.0);
        setup::place(robot.motors().filter(|_| is_fresh), counts_per_m)
    }

    /// The motion of the robot after an instant, ms in time of this server.
    pub(crate) fn moved(&self, after_ms: f64) -> UpAndDown {
        let ago_ns = ((self.now_ms() - after_ms).max(0.0) * 1e6) as u64;
        locked(&self.robot).moved(now_ns().saturating_sub(ago_ns))
    }

    /// When the robot was stopped last by others than browsers of this page, ns.
    pub(crate) fn stopped_ns(&self) -> u64 {
        locked(&self.robot).stopped_ns()
    }

    /// The last ten minutes.
    pub(crate) fn history(&self) -> Value {
        locked(&self.history).told(now_ns())
    }

    /// The events so far, oldest first, and those that follow.
    pub(crate) fn events(&self) -> (Vec<Utf8Bytes>, broadcast::Receiver<Utf8Bytes>) {
        let recent = locked(&self.recent);
        (recent.iter().cloned().collect(), self.events.subscribe())
    }

    fn put(&self, topic: usize, value: &Value) {
        let text = Utf8Bytes::from(value.to_string());
        self.newest[topic].send_if_modified(|held| {
            let is_new = *held != text;
            if is_new {
                *held = text;
            }
            is_new
        });
    }

    fn happened(&self, event: &Happened) {
        let mut recent = locked(&self.recent);
        if recent.len() >= EVENTS {
            recent.pop_front();
        }
        let mut event = event.0.clone();
        event["at_ms"] = json!(self.now_ms());
        let text = Utf8Bytes::from(event.to_string());
        recent.push_back(text.clone());
        // Without a browser nothing receives it now.
        let _ = self.events.send(text);
    }
}

/// Observes the robot until the program ends; a lost connection is made again.
pub(crate) async fn observe(topics: Arc<Topics>, place: PlaceArgs) {
    let mut said = String::new();
    loop {
        if let Err(failure) = follow(&topics, &place).await {
            let sentence = failure.to_string();
            topics.put(LINK, &json!({ "type": "link", "gateway": false, "robot": null, "sentence": sentence }));
            if sentence != said {
                eprintln!("nims-page: {sentence}");
                said = sentence;
            }
        }
        tokio::time::sleep(AGAIN).await;
    }
}

/// A connection and what was asked over it.
struct Observation<'a> {
    topics: &'a Topics,
    outgoing: Outgoing,
    /// Name of the gateway's robot.
    name: String,
    last_id: u64,
    subscriptions: BTreeMap<u64, String>,
    /// The run whose configuration is known or was asked for.
    run: Option<PathBuf>,
    /// Of the state that was sent last.
    sent_cycle: u64,
    plan_key: (u32, u32, u32),
}

async fn follow(topics: &Topics, place: &PlaceArgs) -> Answer {
    let (mut incoming, outgoing, welcome) = link::connect(place.place(), &Browser::default()).await?;
    let mut observation = Observation {
        topics,
        outgoing,
        name: welcome.robot,
        last_id: 0,
        subscriptions: BTreeMap::new(),
        run: None,
        sent_cycle: 0,
        plan_key: (0, 0, 0),
    };
    *locked(&topics.robot) = Robot::default();
    for (channel, rate_hz) in CHANNELS {
        observation.subscribe(channel, rate_hz).await?;
    }
    observation.run(&mut incoming).await
}

impl Observation<'_> {
    fn next_id(&mut self) -> u64 {
        self.last_id += 1;
        self.last_id
    }

    async fn subscribe(&mut self, channel: &str, rate_hz: Option<f64>) -> Answer {
        let id = self.next_id();
        self.subscriptions.insert(id, channel.to_owned());
        self.outgoing.send(&Call::Subscribe { id, channel: channel.to_owned(), rate_hz }, &[]).await
    }

    async fn run(&mut self, incoming: &mut Incoming) -> Answer {
        let mut clock = interval(LIVE);
        clock.set_missed_tick_behavior(MissedTickBehavior::Delay);
        let mut tick = 0;
        loop {
            tokio::select! {
                next = incoming.next() => {
                    let (reply, body) = next?;
                    self.take(reply, &body).await?;
                }
                _ = clock.tick() => {
                    self.tick(tick).await?;
                    tick += 1;
                }
            }
        }
    }

    async fn tick(&mut self, tick: u64) -> Answer {
        if tick.is_multiple_of(LOOK) {
            let (robot, channels) = (self.next_id(), self.next_id());
            self.outgoing.send(&Call::Robot { id: robot }, &[]).await?;
            self.outgoing.send(&Call::Channels { id: channels }, &[]).await?;
        }
        let robot = locked(&self.topics.robot);
        let cycle = robot.cycle();
        if cycle != self.sent_cycle || tick.is_multiple_of(AGEING) {
            self.sent_cycle = cycle;
            let mut state = robot.live(now_ns());
            state["at_ms"] = json!(self.topics.now_ms());
            self.topics.put(STATE, &state);
        }
        if tick.is_multiple_of(SLOWLY) {
            locked(&self.topics.history).note(&robot, now_ns());
            self.topics.put(SLOW, &robot.slow(now_ns()));
        }
        if robot.plan_key() != self.plan_key || tick == 0 {
            self.plan_key = robot.plan_key();
            self.topics.put(PLAN, &robot.drawn_plan());
        }
        Ok(())
    }

    async fn take(&mut self, reply: Reply, body: &[u8]) -> Answer {
        match reply {
            Reply::Definition { id, type_name, size_bytes, .. } => {
                if let Some(channel) = self.subscriptions.get(&id) {
                    locked(&self.topics.robot).define(channel, &type_name, size_bytes);
                }
            }
            Reply::Sample { id, .. } => {
                let Some(channel) = self.subscriptions.get(&id) else { return Ok(()) };
                let event = locked(&self.topics.robot).take(channel, body);
                if let Some(event) = event {
                    self.topics.happened(&event);
                }
            }
            Reply::Robot { robot, .. } => {
                let run = robot.map(|facts| facts.run);
                self.topics.put(
                    LINK,
                    &json!({ "type": "link", "gateway": true, "robot": self.name,
                    "run": run.as_ref().and_then(|run| run.file_name()).map(|name| name.to_string_lossy()) }),
                );
                if run.is_none() && self.run.take().is_some() {
                    // Its processes have ended with it.
                    *locked(&self.topics.robot) = Robot::default();
                }
                if run.is_some() && run != self.run {
                    let id = self.next_id();
                    self.outgoing.send(&Call::Configuration { id }, &[]).await?;
                    self.run = run;
                }
            }
            Reply::Configuration { files, .. } => match Scene::new(&files, body) {
                Ok(scene) => {
                    self.topics.put(SCENE, &scene.value);
                    *locked(&self.topics.scene) = Some(Arc::new(scene));
                }
                Err(failure) => eprintln!("nims-page: the robot cannot be drawn: {failure}"),
            },
            Reply::Channels { channels, .. } => {
                let sensors = channels.iter().filter_map(|row| row.name.strip_prefix("sensor/")).map(str::to_owned);
                locked(&self.topics.robot).sensors = sensors.collect();
                let logs = channels.iter().map(|row| &row.name).filter(|name| name.starts_with(LOGS));
                let known: Vec<&String> = self.subscriptions.values().collect();
                let new: Vec<String> = logs.filter(|name| !known.contains(name)).cloned().collect();
                for channel in new.into_iter().take((CHANNELS.len() + MOST_LOGS).saturating_sub(known.len())) {
                    self.subscribe(&channel, None).await?;
                }
            }
            _ => {}
        }
        Ok(())
    }
}
