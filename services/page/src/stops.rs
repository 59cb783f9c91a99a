//! Stops: each over a connection of its own, so that nothing that was asked before delays it.

use crate::app::App;
use crate::link;
use crate::protocol::{ask, refusal};
use command::{Answer, Failure};
use gateway_protocol::Reply;
use messages::Request;
use serde_json::Value;
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;
use tokio::sync::{OwnedSemaphorePermit, mpsc};
use tokio::time::timeout;

/// Time for a stop: its place, its connection and its answer.
const ANSWERED: Duration = Duration::from_secs(3);
/// Presses of a browser that one stop under way answers.
const PRESSES: usize = 32;

/// Stops the robot, for the holder of a token or for everyone who opens the page.
///
/// # Errors
/// The gateway cannot be reached, or has not answered in time.
pub(crate) async fn stop(app: &App, token: Option<String>, request: Request) -> Answer<Reply> {
    within(ANSWERED, async {
        // It is never closed.
        let _place = app.stops.of(&request).acquire().await;
        let as_page = || link::connect(app.place.place(), None);
        let connected = match token {
            // A token that was taken back stops as the page.
            Some(token) => match link::connect(app.place.place(), Some(token)).await {
                Err(_) => as_page().await,
                connected => connected,
            },
            None => as_page().await,
        };
        let (mut incoming, mut outgoing, _) = connected?;
        outgoing.send(&ask(1, request), &[]).await?;
        loop {
            // Who flies is told to every page.
            match incoming.next().await?.0 {
                Reply::Seat { .. } => {}
                reply => return Ok(reply),
            }
        }
    })
    .await
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
    token: Option<String>,
    answers: mpsc::Sender<Value>,
    /// The browser's place, which it keeps until its last stop has ended.
    place: Arc<OwnedSemaphorePermit>,
    /// By verb the presses that the stop under way answers.
    under_way: Arc<Mutex<BTreeMap<u8, Vec<u64>>>>,
}

impl Stops {
    pub(crate) fn new(
        app: Arc<App>,
        token: Option<String>,
        answers: mpsc::Sender<Value>,
        place: OwnedSemaphorePermit,
    ) -> Self {
        Self { app, token, answers, place: Arc::new(place), under_way: Arc::default() }
    }

    /// Stops the robot; the answer goes to the browser. A press during an equal one is answered together with it.
    pub(crate) fn press(&self, id: u64, request: Request) {
        let verb = request.verb();
        if !joins(&mut locked(&self.under_way), verb, id) {
            return;
        }
        let (app, token, answers) = (Arc::clone(&self.app), self.token.clone(), self.answers.clone());
        let (under_way, place) = (Arc::clone(&self.under_way), Arc::clone(&self.place));
        tokio::spawn(async move {
            let stopped = stop(&app, token, request).await;
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
