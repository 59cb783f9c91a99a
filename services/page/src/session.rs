//! The conversation with a browser: its messages to the gateway, and the robot's state to the browser.

use crate::app::App;
use crate::link::{self, Incoming, Outgoing, Welcome};
use crate::protocol::{FromBrowser, ask, refusal, stops};
use axum::extract::ws::{Message, Utf8Bytes, WebSocket};
use command::Answer;
use futures_util::stream::{SplitSink, SplitStream};
use futures_util::{SinkExt, StreamExt};
use gateway_protocol::{Call, Reply};
use messages::Request;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::fs::File;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use tokio::sync::{broadcast, mpsc};
use tokio::time::{interval, timeout};

/// Time in which a browser has to send `hello`.
const HELLO: Duration = Duration::from_secs(10);
/// A browser is asked for a sign of life in this interval, and its conversation ends without any for three of them.
const PING: Duration = Duration::from_secs(5);
/// A browser that takes nothing for this time is disconnected.
const SLOW: Duration = Duration::from_secs(5);
/// Messages of a browser per second, and in a burst; more end the conversation. The page sends at most 20 per second.
const MESSAGES_PER_S: f64 = 100.0;
const BURST: f64 = 200.0;
/// Answers of the page itself that may wait for the browser.
const WAITING: usize = 64;
/// Number of a release, whose reply no browser waits for; they count from 1.
const RELEASED: u64 = 0;

/// What both directions of a conversation share.
#[derive(Debug, Default)]
struct Shared {
    /// The files that were asked for, by the number of the call.
    opens: BTreeMap<u64, String>,
}

/// The directions take turns on one thread, so nothing waits for this lock.
type Both = Mutex<Shared>;

fn locked(shared: &Both) -> MutexGuard<'_, Shared> {
    shared.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Talks to a browser until one of them ends it.
pub(crate) async fn converse(socket: WebSocket, app: Arc<App>) {
    let (mut sink, mut stream) = socket.split();
    let Some(token) = hello(&mut stream).await else { return };
    let (link, refused) = match link::connect(app.place.place(), token.clone()).await {
        Err(failure) if token.is_some() => (link::connect(app.place.place(), None).await, Some(failure.to_string())),
        link => (link, None),
    };
    let (incoming, outgoing, welcome) = match link {
        Ok(link) => link,
        Err(failure) => {
            let _ = send(&mut sink, &json!({ "type": "unreachable", "sentence": failure.to_string() })).await;
            let _ = sink.close().await;
            return;
        }
    };
    let greeting = json!({ "type": "welcome", "robot": welcome.robot, "user": welcome.user, "role": welcome.role,
        "paired": token.is_some() && refused.is_none(), "sentence": refused, "version": env!("CARGO_PKG_VERSION") });
    if send(&mut sink, &greeting).await.is_err() {
        return;
    }
    let (local, answers) = mpsc::channel(WAITING);
    let shared = Both::default();
    let mut inbound = Inbound { app: &app, stream, outgoing, local, welcome, shared: &shared };
    let outbound = outbound(&app, sink, incoming, answers, &shared);
    tokio::select! {
        () = inbound.run() => {}
        () = outbound => {}
    }
}

async fn hello(stream: &mut SplitStream<WebSocket>) -> Option<Option<String>> {
    let first = timeout(HELLO, stream.next()).await.ok()??.ok()?;
    match FromBrowser::read(first.to_text().ok()?) {
        Ok(FromBrowser::Hello { token }) => Some(token.filter(|token| !token.is_empty())),
        _ => None,
    }
}

async fn send(sink: &mut SplitSink<WebSocket, Message>, value: &Value) -> Result<(), ()> {
    send_text(sink, Utf8Bytes::from(value.to_string())).await
}

async fn send_text(sink: &mut SplitSink<WebSocket, Message>, text: Utf8Bytes) -> Result<(), ()> {
    put(sink, Message::Text(text)).await
}

async fn put(sink: &mut SplitSink<WebSocket, Message>, message: Message) -> Result<(), ()> {
    match timeout(SLOW, sink.send(message)).await {
        Ok(Ok(())) => Ok(()),
        _ => Err(()),
    }
}

/// From the gateway and the topics to the browser.
async fn outbound(
    app: &App,
    mut sink: SplitSink<WebSocket, Message>,
    mut incoming: Incoming,
    mut answers: mpsc::Receiver<Value>,
    shared: &Both,
) {
    let [mut link, mut scene, mut slow, mut plan, mut state] = app.topics.newest.each_ref().map(|one| one.subscribe());
    for topic in [&mut link, &mut scene, &mut slow, &mut plan, &mut state] {
        topic.mark_changed();
    }
    let (recent, mut events) = app.topics.events();
    if send(&mut sink, &app.topics.history()).await.is_err() {
        return;
    }
    for event in recent {
        if send_text(&mut sink, event).await.is_err() {
            return;
        }
    }
    let mut ping = interval(PING);
    loop {
        let text = tokio::select! {
            biased;
            next = incoming.next() => match next {
                Ok((reply, _)) => Utf8Bytes::from(replied(app, reply, &mut incoming, shared).to_string()),
                Err(_) => break,
            },
            Some(answer) = answers.recv() => Utf8Bytes::from(answer.to_string()),
            event = events.recv() => match event {
                Ok(event) => event,
                Err(broadcast::error::RecvError::Lagged(_)) => continue,
                Err(broadcast::error::RecvError::Closed) => break,
            },
            Ok(()) = link.changed() => link.borrow_and_update().clone(),
            Ok(()) = scene.changed() => scene.borrow_and_update().clone(),
            Ok(()) = slow.changed() => slow.borrow_and_update().clone(),
            Ok(()) = plan.changed() => plan.borrow_and_update().clone(),
            Ok(()) = state.changed() => state.borrow_and_update().clone(),
            _ = ping.tick() => {
                if put(&mut sink, Message::Ping(Default::default())).await.is_err() { break }
                continue;
            }
        };
        // A topic without a text so far.
        if !text.is_empty() && send_text(&mut sink, text).await.is_err() {
            break;
        }
    }
    let _ = timeout(SLOW, sink.close()).await;
}

/// The gateway's reply for the browser; of an opened file the path of its download.
fn replied(app: &App, reply: Reply, incoming: &mut Incoming, shared: &Both) -> Value {
    let name = locked(shared).opens.remove(&reply.id());
    match &reply {
        Reply::Opened { id, bytes } => match (incoming.descriptor(), name) {
            (Some(file), Some(name)) => {
                let path = app.downloads.offer(File::from(file), name, *bytes);
                path.map_or_else(
                    || refusal(*id, "too many downloads wait to be fetched; try again in a minute"),
                    |path| json!({ "reply": "download", "id": id, "path": path, "bytes": bytes }),
                )
            }
            _ => refusal(*id, "the gateway's reply has no file; use the page of the same installation"),
        },
        _ => as_value(&reply),
    }
}

fn as_value(reply: &Reply) -> Value {
    serde_json::to_value(reply).unwrap_or_else(|_| refusal(reply.id(), "the reply cannot be shown"))
}

/// From the browser to the gateway.
struct Inbound<'a> {
    app: &'a Arc<App>,
    stream: SplitStream<WebSocket>,
    outgoing: Outgoing,
    local: mpsc::Sender<Value>,
    welcome: Welcome,
    shared: &'a Both,
}

impl Inbound<'_> {
    async fn run(&mut self) {
        let (mut saved, mut counted) = (BURST, Instant::now());
        loop {
            // A browser answers each ping.
            let Ok(message) = timeout(3 * PING, self.stream.next()).await else { return };
            let Some(Ok(message)) = message else { return };
            let now = Instant::now();
            saved = (saved + now.duration_since(counted).as_secs_f64() * MESSAGES_PER_S).min(BURST) - 1.0;
            counted = now;
            if saved < 0.0 {
                return;
            }
            let done = match message {
                Message::Text(text) => self.take(text.as_str()).await,
                Message::Close(_) => return,
                Message::Binary(_) => return,
                Message::Ping(_) | Message::Pong(_) => Ok(()),
            };
            if done.is_err() {
                return;
            }
        }
    }

    async fn take(&mut self, text: &str) -> Answer {
        let message = match FromBrowser::read(text) {
            Ok(message) => message,
            Err(why) => {
                self.answer(refusal(0, &why));
                return Ok(());
            }
        };
        match message {
            FromBrowser::Hello { .. } => Ok(()),
            FromBrowser::Ask { id, request } => self.ask(id, request).await,
            // The gateway ends a held motion, so that it ends also with this program.
            FromBrowser::Held { id, request } => {
                self.outgoing.send(&Call::Ask { id, request, process: None, held: true }, &[]).await
            }
            FromBrowser::Beat {} => self.outgoing.send(&Call::Beat {}, &[]).await,
            FromBrowser::Release {} => self.outgoing.send(&Call::Release { id: RELEASED }, &[]).await,
            FromBrowser::Fly { id, name, text, continues } => {
                let request = Request::Run { mission: name, hash: config::mission_hash(&text), continues };
                self.outgoing.send(&ask(id, request), text.as_bytes()).await
            }
            FromBrowser::Check { id, to_m } => {
                let (possible, sentence) = match self.app.topics.scene() {
                    Some(scene) => scene.check(to_m),
                    None => (false, "the robot's configuration is not known yet; try again".to_owned()),
                };
                self.answer(json!({ "reply": "check", "id": id, "possible": possible, "sentence": sentence }));
                Ok(())
            }
            FromBrowser::Runs { id } => self.outgoing.send(&Call::Runs { id }, &[]).await,
            FromBrowser::Files { id, run } => self.outgoing.send(&Call::Files { id, run }, &[]).await,
            FromBrowser::Open { id, run, file } => {
                let name = format!("{run}-{}", file.replace('/', "-"));
                {
                    let opens = &mut locked(self.shared).opens;
                    // The gateway refuses more unanswered calls than that.
                    if opens.len() >= WAITING {
                        opens.clear();
                    }
                    opens.insert(id, name);
                }
                self.outgoing.send(&Call::Open { id, run, file }, &[]).await
            }
        }
    }

    async fn ask(&mut self, id: u64, request: Request) -> Answer {
        if !stops(&request) || self.welcome.role != "look" {
            return self.outgoing.send(&ask(id, request), &[]).await;
        }
        // A stop is open to every role, so it goes as that of the page.
        let (app, local) = (Arc::clone(self.app), self.local.clone());
        tokio::spawn(async move {
            let value = match stop(&app, request).await {
                Ok(reply) => serde_json::to_value(reply.with_id(id)).unwrap_or_default(),
                Err(failure) => refusal(id, &failure.to_string()),
            };
            let _ = local.send(value).await;
        });
        Ok(())
    }

    /// An answer of the page itself. A browser that asks faster than it takes answers loses them.
    fn answer(&self, value: Value) {
        let _ = self.local.try_send(value);
    }
}

/// Stops the robot as the page, over a connection of its own.
///
/// # Errors
/// The gateway cannot be reached.
pub(crate) async fn stop(app: &App, request: Request) -> Answer<Reply> {
    let (mut incoming, mut outgoing, _) = link::connect(app.place.place(), None).await?;
    outgoing.send(&ask(1, request), &[]).await?;
    Ok(incoming.next().await?.0)
}
