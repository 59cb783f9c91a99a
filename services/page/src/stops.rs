//! Stops: over a connection that is ready for them and carries nothing else, so that nothing that was asked before
//! delays them, and a press is one message.

use crate::app::App;
use crate::link::{self, Browser, Incoming, Outgoing};
use crate::places::Visit;
use crate::protocol::{ask, refusal};
use command::{Answer, Failure};
use gateway_protocol::Reply;
use messages::Request;
use serde_json::Value;
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;
use tokio::sync::{mpsc, oneshot};
use tokio::time::timeout;

/// Time for a stop: its place, its connection and its answer.
const ANSWERED: Duration = Duration::from_secs(3);
/// Presses of a browser that one stop under way answers.
const PRESSES: usize = 32;
/// Presses that may wait for the ready connection: one of each kind is under way.
const KINDS: usize = 4;
/// Time until a ready connection that was lost is made again.
const AGAIN: Duration = Duration::from_millis(500);

/// Stops the robot over a connection of its own.
///
/// # Errors
/// The gateway cannot be reached, or has not answered in time.
pub(crate) async fn stop(app: &App, browser: &Browser, request: Request) -> Answer<Reply> {
    within(ANSWERED, stop_anew(app, browser, request)).await
}

async fn stop_anew(app: &App, browser: &Browser, request: Request) -> Answer<Reply> {
    // It is never closed.
    let _place = app.stops.of(&request).acquire().await;
    let (mut incoming, mut outgoing) = connected(app, browser).await?;
    outgoing.send(&ask(1, request, None), &[]).await?;
    loop {
        // Who flies is told to every page.
        match incoming.next().await?.0 {
            Reply::Seat { .. } => {}
            reply => return Ok(reply),
        }
    }
}

async fn connected(app: &App, browser: &Browser) -> Answer<(Incoming, Outgoing)> {
    let found = match link::connect(app.place.place(), browser).await {
        // A token that was taken back stops as the page.
        Err(_) if browser.token.is_some() => {
            link::connect(app.place.place(), &Browser { token: None, from: browser.from }).await
        }
        found => found,
    };
    found.map(|(incoming, outgoing, _)| (incoming, outgoing)).map_err(Failure::from)
}

/// A press on its way; without an answer it is made again over another connection.
struct Press(Request, oneshot::Sender<Reply>);

/// Keeps a connection ready for the stops of a browser, until the browser is gone.
async fn keep_ready(app: Arc<App>, browser: Browser, mut presses: mpsc::Receiver<Press>) {
    loop {
        let connecting = connected(&app, &browser);
        let link = tokio::select! {
            biased;
            link = connecting => link,
            // What is pressed meanwhile has a connection of its own.
            press = presses.recv() => if press.is_some() { continue } else { return },
        };
        if let Ok((incoming, outgoing)) = link
            && carry(incoming, outgoing, &mut presses).await.is_none()
        {
            return;
        }
        tokio::select! {
            () = tokio::time::sleep(AGAIN) => {}
            press = presses.recv() => if press.is_none() { return },
        }
    }
}

/// Carries presses until the connection is lost; `None` when the browser is gone.
async fn carry(mut incoming: Incoming, mut outgoing: Outgoing, presses: &mut mpsc::Receiver<Press>) -> Option<()> {
    let (mut waiting, mut last_id) = (BTreeMap::new(), 0);
    loop {
        tokio::select! {
            biased;
            press = presses.recv() => {
                let Press(request, answered) = press?;
                last_id += 1;
                if outgoing.send(&ask(last_id, request, None), &[]).await.is_err() {
                    return Some(());
                }
                waiting.insert(last_id, answered);
            }
            reply = incoming.next() => match reply {
                Ok((reply, _)) => {
                    // Who flies is told too, and no press waits for it.
                    if let Some(answered) = waiting.remove(&reply.id()) {
                        let _ = answered.send(reply);
                    }
                }
                Err(_) => return Some(()),
            },
        }
    }
}

async fn within(limit: Duration, stopped: impl Future<Output = Answer<Reply>>) -> Answer<Reply> {
    timeout(limit, stopped).await.unwrap_or_else(|_| {
        Err(Failure::NotNow(format!(
            "no answer to the stop has come for {} s: look at the robot, and use the hardware stop if it moves",
            limit.as_secs()
        )))
    })
}

/// The stops of one browser.
pub(crate) struct Stops {
    app: Arc<App>,
    browser: Browser,
    answers: mpsc::Sender<Value>,
    /// The browser's place, which it keeps until its last stop has ended.
    place: Arc<Visit>,
    /// By verb the presses that the stop under way answers.
    under_way: Arc<Mutex<BTreeMap<u8, Vec<u64>>>>,
    /// To the connection that is ready.
    ready: mpsc::Sender<Press>,
}

impl Stops {
    pub(crate) fn new(app: Arc<App>, browser: Browser, answers: mpsc::Sender<Value>, place: Visit) -> Self {
        let (ready, presses) = mpsc::channel(KINDS);
        tokio::spawn(keep_ready(Arc::clone(&app), browser.clone(), presses));
        Self { app, browser, answers, place: Arc::new(place), under_way: Arc::default(), ready }
    }

    /// Stops the robot; the answer goes to the browser. A press during an equal one is answered together with it.
    pub(crate) fn press(&self, id: u64, request: Request) {
        let verb = request.verb();
        if !joins(&mut locked(&self.under_way), verb, id) {
            return;
        }
        let (answered, answer) = oneshot::channel();
        // Without room for it, it is made over another connection.
        let _ = self.ready.try_send(Press(request.clone(), answered));
        let (app, browser, answers) = (Arc::clone(&self.app), self.browser.clone(), self.answers.clone());
        let (under_way, place) = (Arc::clone(&self.under_way), Arc::clone(&self.place));
        tokio::spawn(async move {
            let stopped = within(ANSWERED, async {
                match answer.await {
                    Ok(reply) => Ok(reply),
                    Err(_) => stop_anew(&app, &browser, request).await,
                }
            });
            let stopped = stopped.await;
            let ids = locked(&under_way).remove(&verb).unwrap_or_default();
            for id in ids {
                let value = match &stopped {
                    Ok(reply) => serde_json::to_value(reply.clone().with_id(id)).unwrap_or_default(),
                    Err(failure) => refusal(id, &failure.to_string()),
                };
                // A browser that asks faster than it takes answers loses them.
                let _ = answers.try_send(value);
            }
            drop(place);
        });
    }
}

/// Adds a press; returns whether no equal one is under way.
fn joins(under_way: &mut BTreeMap<u8, Vec<u64>>, verb: u8, id: u64) -> bool {
    let ids = under_way.entry(verb).or_default();
    if ids.len() < PRESSES {
        ids.push(id);
    }
    ids.len() == 1
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_stop_of_each_kind_is_under_way() {
        let mut under_way = BTreeMap::new();
        let begun = (0..1000).filter(|id| joins(&mut under_way, (id % 3) as u8, *id)).count();
        assert_eq!((begun, under_way.values().map(Vec::len).max()), (3, Some(PRESSES)));
    }

    #[test]
    fn a_stop_without_an_answer_ends_with_a_sentence() {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_time().build().unwrap();
        let failure = runtime.block_on(within(Duration::from_secs(1), std::future::pending())).unwrap_err().to_string();
        assert!(failure.contains("1 s") && failure.contains("hardware stop"), "{failure}");
    }
}
