//! The conversation with a browser: its messages to the gateway, and the robot's state to the browser.

use crate::app::{App, Offers};
use crate::control::{Begins, Control, Presses, Sign};
use crate::evaluations::Evaluations;
use crate::fields::Fields;
use crate::link::{self, Browser, Incoming, NoLink, Outgoing, Welcome};
use crate::places::{BROWSERS, OF_AN_ADDRESS, UNPAIRED, Visit};
use crate::protocol::{FromBrowser, ask, refusal};
use crate::stops::Stops;
use axum::extract::ws::{Message, Utf8Bytes, WebSocket};
use bus::clock::now_ns;
use command::Failure;
use futures_util::stream::{SplitSink, SplitStream};
use futures_util::{SinkExt, StreamExt};
use gateway_protocol::{Call, Reply};
use messages::Request;
use robot_state::Reason;
use serde_json::{Value, json};
use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::net::IpAddr;
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
/// Calls that may wait for the gateway to take them; a mission has up to 256 kB.
const QUEUED: usize = 4;

/// What both directions of a conversation share.
#[derive(Debug, Default)]
struct Shared {
    /// The files that were asked for, by the number of the call, and whether the browser shows them.
    opens: BTreeMap<u64, (String, bool)>,
    /// Requests of the robot without an answer, by the number of the call.
    asked: BTreeSet<u64>,
}

/// The directions take turns on one thread, so nothing waits for this lock.
type Both = Mutex<Shared>;

fn locked(shared: &Both) -> MutexGuard<'_, Shared> {
    shared.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Talks to a browser until one of them ends it.
pub(crate) async fn converse(socket: WebSocket, app: Arc<App>, from: Option<IpAddr>, mut visit: Visit) {
    let (mut sink, mut stream) = socket.split();
    let said = tokio::select! {
        said = hello(&mut stream) => said,
        () = visit.sent_away() => None,
    };
    let Some(token) = said else { return };
    visit.said_hello();
    let (link, refused) = arrive(&app, token.clone(), from).await;
    let paired = token.is_some() && refused.is_none();
    let placed = link.map_err(|no_link| Failure::from(no_link).to_string()).and_then(|link| {
        let full = || {
            let unpaired = format!("{UNPAIRED} that are not paired, or {OF_AN_ADDRESS} of these at this address");
            format!("{BROWSERS} pages are open already, or {unpaired}; close one")
        };
        visit.take_place(paired).then_some(link).ok_or_else(full)
    });
    let (incoming, outgoing, welcome) = match placed {
        Ok(link) => link,
        Err(sentence) => {
            let _ = send(&mut sink, &json!({ "type": "unreachable", "sentence": sentence })).await;
            let _ = sink.close().await;
            return;
        }
    };
    let greeting = json!({ "type": "welcome", "robot": welcome.robot, "user": welcome.user, "role": welcome.role,
        "paired": paired, "sentence": refused, "version": env!("CARGO_PKG_VERSION") });
    if send(&mut sink, &greeting).await.is_err() {
        return;
    }
    let (local, answers) = mpsc::channel(WAITING);
    // A role that may not stop stops as the page, because that is open to every role.
    let stopping = Browser { token: token.filter(|_| refused.is_none() && welcome.role != "look"), from };
    let stops = Stops::new(Arc::clone(&app), stopping, local.clone(), visit);
    let (shared, control, presses) = (Both::default(), Control::default(), Presses::default());
    let flies = ["fly", "owner"].contains(&welcome.role.as_str());
    let (calls, queue) = mpsc::channel(QUEUED);
    let evaluations = Evaluations::new(Arc::clone(&app), local.clone(), flies);
    let mut inbound = Inbound {
        app: &app,
        stream,
        calls,
        control: &control,
        local: local.clone(),
        stops,
        shared: &shared,
        presses,
        evaluations,
    };
    let offers = app.downloads.begin();
    let outbound = outbound(&app, sink, incoming, answers, &shared, &offers);
    tokio::select! {
        () = inbound.run() => {}
        () = outbound => {}
        () = write(outgoing, &control, queue, &shared, &local) => {}
    }
}

/// Connects to the gateway with the browser's token; with the gateway's sentence and without the token if that is not
/// valid.
async fn arrive(
    app: &App,
    token: Option<String>,
    from: Option<IpAddr>,
) -> (Result<(Incoming, Outgoing, Welcome), NoLink>, Option<String>) {
    // It is never closed.
    let _turn = app.conversations.turn().acquire().await;
    match link::connect(app.place.place(), &Browser { token, from }).await {
        // Only then does the browser forget its token: other failures pass.
        Err(NoLink::TokenInvalid(sentence)) => {
            let anyone = Browser { token: None, from };
            (link::connect(app.place.place(), &anyone).await, Some(sentence))
        }
        link => (link, None),
    }
}

/// A call that waits for the gateway to take it.
struct Queued {
    call: Call,
    body: Vec<u8>,
    /// Number of stops before it.
    stops: u64,
}

/// From the browser's calls to the gateway; what is done with a control comes before everything else.
async fn write(
    mut outgoing: Outgoing,
    control: &Control,
    mut queue: mpsc::Receiver<Queued>,
    shared: &Both,
    answers: &mpsc::Sender<Value>,
) {
    loop {
        let (call, body) = match control.take() {
            Some(call) => (call, Vec::new()),
            None => tokio::select! {
                biased;
                () = control.changed() => continue,
                queued = queue.recv() => match queued {
                    None => return,
                    Some(Queued { call: Call::Ask { id, .. }, stops, .. }) if stops != control.stops() => {
                        locked(shared).asked.remove(&id);
                        let _ = answers.try_send(refused(id, &Reason::OvertakenByStop));
                        continue;
                    }
                    Some(Queued { call, body, .. }) => (call, body),
                },
            },
        };
        if outgoing.send(&call, &body).await.is_err() {
            return;
        }
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
    offers: &Offers<'_>,
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
                Ok((reply, _)) => Utf8Bytes::from(replied(offers, reply, &mut incoming, shared).to_string()),
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
                app.downloads.close_late();
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
fn replied(offers: &Offers<'_>, reply: Reply, incoming: &mut Incoming, shared: &Both) -> Value {
    let name = {
        let shared = &mut locked(shared);
        shared.asked.remove(&reply.id());
        shared.opens.remove(&reply.id())
    };
    match &reply {
        Reply::Opened { id, bytes } => match (incoming.descriptor(), name) {
            (Some(file), Some((name, shown))) => {
                let path = offers.offer(File::from(file), name, *bytes, shown);
                path.map_or_else(
                    || refusal(*id, "the kernel gives no random numbers now; try again"),
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
    calls: mpsc::Sender<Queued>,
    control: &'a Control,
    local: mpsc::Sender<Value>,
    stops: Stops,
    shared: &'a Both,
    presses: Presses,
    evaluations: Evaluations,
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
            match message {
                Message::Text(text) => self.take(text.as_str()),
                Message::Close(_) | Message::Binary(_) => return,
                Message::Ping(_) | Message::Pong(_) => {}
            }
        }
    }

    /// Nothing is awaited here, so that a stop is taken whatever was sent before it.
    fn take(&mut self, text: &str) {
        let message = match FromBrowser::read(text) {
            Ok(message) => message,
            Err(why) => return self.answer(refusal(0, &why)),
        };
        match message {
            FromBrowser::Hello { .. } => {}
            FromBrowser::Ask { id, request, .. } if request.is_stop() => {
                let sent = !locked(self.shared).asked.is_empty();
                let unmade = self.control.stop(&request, sent);
                self.stops.press(id, request);
                self.unmade(unmade);
            }
            FromBrowser::Ask { id, request, press } => {
                if let Some(pressed_ns) = self.pressed(id, press) {
                    self.call(ask(id, request, Some(pressed_ns)), Vec::new());
                }
            }
            // The gateway ends a held motion, so that it ends also with this program.
            FromBrowser::Held { id, request, sign, press } => self.hold(id, request, sign, press),
            FromBrowser::Beat { sign } => {
                if sign.too_old(self.app.topics.now_ms()).is_none() {
                    self.control.beat(now_ns());
                }
            }
            FromBrowser::Release {} => {
                let unmade = self.control.release();
                self.unmade(unmade);
            }
            FromBrowser::Fly { id, name, text, continues } => {
                let request = Request::Run { mission: name, hash: config::mission_hash(&text), continues };
                self.call(ask(id, request, Some(now_ns())), text.into_bytes());
            }
            FromBrowser::Pair { id, code } => self.call(Call::CodeUse { id, code }, Vec::new()),
            FromBrowser::Seat { id, what } => self.call(Call::Seat { id, what }, Vec::new()),
            other => self.look(other),
        }
    }

    /// When the control was pressed for this request, ns. `None`: the robot was stopped since, which is answered.
    fn pressed(&mut self, id: u64, press: Option<u64>) -> Option<u64> {
        let now_ns = now_ns();
        let pressed_ns = press.map_or(now_ns, |number| self.presses.at_ns(number, now_ns));
        // The gateway compares with the stops of its own clients.
        if pressed_ns < self.app.topics.stopped_ns() {
            self.answer(refused(id, &Reason::OvertakenByStop));
            return None;
        }
        Some(pressed_ns)
    }

    /// Requests a motion that is held. The gateway ends it, so that it ends also with this program.
    fn hold(&mut self, id: u64, request: Request, sign: Sign, press: Option<u64>) {
        let Some(pressed_ns) = self.pressed(id, press) else { return };
        if let Some(why) = sign.too_old(self.app.topics.now_ms()) {
            return self.answer(refused(id, &why));
        }
        let replaced = self.control.hold(Begins { id, request, at_ns: now_ns(), pressed_ns });
        locked(self.shared).asked.insert(id);
        self.unmade(replaced);
    }

    /// What moves nothing.
    fn look(&self, message: FromBrowser) {
        match message {
            FromBrowser::Check { id, to_m } => {
                let (possible, sentence) = match self.app.topics.scene() {
                    Some(scene) => scene.check(to_m),
                    None => (false, "the robot's configuration is not known yet; try again".to_owned()),
                };
                self.answer(json!({ "reply": "check", "id": id, "possible": possible, "sentence": sentence }));
            }
            FromBrowser::Setup { id, name, measurements, line } => {
                self.evaluations.set_up(id, name, measurements, line);
            }
            FromBrowser::Weigh { id, measurements, line, after_ms } => {
                self.evaluations.weigh(id, measurements, line, after_ms);
            }
            FromBrowser::Fields { id } => {
                let channels = locked_fields(self.app).told();
                self.answer(json!({ "reply": "fields", "id": id, "channels": channels }));
            }
            FromBrowser::Series { id, channel, field, after_ms } => {
                let found = locked_fields(self.app).series(&channel, &field, after_ms);
                self.answer(match found {
                    Some((at_ms, values)) => json!({ "reply": "series", "id": id, "at_ms": at_ms, "values": values }),
                    None => refusal(id, &format!("{channel} has no number {field} now; choose another one")),
                });
            }
            FromBrowser::Runs { id } => self.call(Call::Runs { id }, Vec::new()),
            FromBrowser::Files { id, run } => self.call(Call::Files { id, run }, Vec::new()),
            FromBrowser::Make { id, run, what } => self.call(Call::Make { id, run, what }, Vec::new()),
            FromBrowser::Doctor { id } => self.call(Call::Doctor { id }, Vec::new()),
            FromBrowser::Remove { id, run } => self.call(Call::Remove { id, run }, Vec::new()),
            FromBrowser::RobotFile { id, robot, calibration, made_from } => {
                let calibration_bytes = calibration.as_ref().map(String::len);
                let body = robot + calibration.as_deref().unwrap_or_default();
                let made_from = Some(made_from);
                self.call(Call::RobotFile { id, calibration_bytes, made_from }, body.into_bytes());
            }
            FromBrowser::Open { id, run, file, show } => {
                let name = (format!("{run}-{}", file.replace('/', "-")), show);
                {
                    let opens = &mut locked(self.shared).opens;
                    // The gateway refuses more unanswered calls than that.
                    if opens.len() >= WAITING {
                        opens.clear();
                    }
                    opens.insert(id, name);
                }
                self.call(Call::Open { id, run, file }, Vec::new());
            }
            // They were carried out before.
            FromBrowser::Hello { .. }
            | FromBrowser::Ask { .. }
            | FromBrowser::Held { .. }
            | FromBrowser::Beat { .. }
            | FromBrowser::Release {}
            | FromBrowser::Fly { .. }
            | FromBrowser::Pair { .. }
            | FromBrowser::Seat { .. } => {}
        }
    }

    fn call(&self, call: Call, body: Vec<u8>) {
        let id = call.id();
        let (asks, stops) = (matches!(call, Call::Ask { .. }), self.control.stops());
        let why = match call.header() {
            Err(why) => why,
            Ok(_) => match self.calls.try_send(Queued { call, body, stops }) {
                Ok(()) => {
                    if asks {
                        locked(self.shared).asked.insert(id);
                    }
                    return;
                }
                Err(_) => format!("the robot's gateway has not taken {QUEUED} calls yet; wait for their answers"),
            },
        };
        self.answer(refusal(id, &why));
    }

    /// Answers a held motion that was released or replaced before the gateway got it.
    fn unmade(&self, id: Option<u64>) {
        if let Some(id) = id {
            locked(self.shared).asked.remove(&id);
            self.answer(refusal(id, "the control was released before the robot's gateway took the motion"));
        }
    }

    /// An answer of the page itself. A browser that asks faster than it takes answers loses them.
    fn answer(&self, value: Value) {
        let _ = self.local.try_send(value);
    }
}

fn locked_fields(app: &App) -> MutexGuard<'_, Fields> {
    crate::observer::locked(&app.topics.fields)
}

/// A refusal of the page itself, with a reason of the catalogue.
fn refused(id: u64, reason: &Reason) -> Value {
    as_value(&Reply::answer(id, &reason.answer()))
}
