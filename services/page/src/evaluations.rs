//! Answers of Set up of a browser, evaluated on a thread of their own: a stop does not wait for them.

use crate::app::App;
use crate::protocol::refusal;
use crate::setup::{self, Given};
use crate::weigh;
use serde_json::{Value, json};
use std::sync::Arc;
use tokio::sync::{OwnedSemaphorePermit, Semaphore, mpsc};

/// Answers of Set up of a browser that are evaluated or wait for it: one of each kind of measurements.
const EVALUATIONS: usize = 2;
/// Longest line that is typed as such an answer, bytes: the lengths of eight cables have 50.
const LINE: usize = 1 << 10;

/// The answers of a browser.
pub(crate) struct Evaluations {
    app: Arc<App>,
    local: mpsc::Sender<Value>,
    /// The role permits to fly.
    flies: bool,
    turns: Arc<Semaphore>,
}

impl Evaluations {
    pub(crate) fn new(app: Arc<App>, local: mpsc::Sender<Value>, flies: bool) -> Self {
        Self { app, local, flies, turns: Arc::new(Semaphore::new(EVALUATIONS)) }
    }

    /// Evaluates an answer of the guided calibration.
    pub(crate) fn set_up(&self, id: u64, name: String, measurements: String, line: Option<String>) {
        let Some(turn) = self.turn(id, &measurements, line.as_deref()) else { return };
        let topics = &self.app.topics;
        let given = Given {
            name,
            measurements,
            line,
            captured: topics.captured(),
            robot_file: topics.scene().map(|scene| scene.robot_file.clone()),
            date: runlog::utc(bus::clock::unix_ns()),
        };
        self.evaluate(turn, id, move || setup::step(&given));
    }

    /// Evaluates an answer of the measurements with a known weight.
    pub(crate) fn weigh(&self, id: u64, measurements: String, line: Option<String>, after_ms: Option<f64>) {
        let Some(turn) = self.turn(id, &measurements, line.as_deref()) else { return };
        let topics = &self.app.topics;
        let given = weigh::Given {
            measurements,
            line,
            scene: topics.scene(),
            place: topics.place(),
            motion: after_ms.map(|after_ms| topics.moved(after_ms)),
        };
        self.evaluate(turn, id, move || weigh::step(&given));
    }

    /// The turn of an answer of Set up, which keeps it from being evaluated beside too many others of this browser.
    fn turn(&self, id: u64, measurements: &str, line: Option<&str>) -> Option<OwnedSemaphorePermit> {
        if !self.flies {
            self.answer(not_for_this_role(id));
            return None;
        }
        if measurements.len() > setup::MEASUREMENTS || line.is_some_and(|line| line.len() > LINE) {
            self.answer(refusal(
                id,
                &format!("the measurements have more than {} kB; begin again", setup::MEASUREMENTS >> 10),
            ));
            return None;
        }
        let turn = Arc::clone(&self.turns).try_acquire_owned().ok();
        if turn.is_none() {
            self.answer(refusal(id, "answers of this browser are being evaluated; wait for their questions"));
        }
        turn
    }

    /// Evaluates an answer of Set up from a role that flies, on a thread of its own: a stop does not wait for it.
    fn evaluate(
        &self,
        turn: OwnedSemaphorePermit,
        id: u64,
        step: impl FnOnce() -> Result<Value, String> + Send + 'static,
    ) {
        let (app, local) = (Arc::clone(&self.app), self.local.clone());
        tokio::spawn(async move {
            let _own = turn;
            // It is never closed. A browser that has gone waits no more.
            let _turn = app.calibrations.acquire().await;
            if local.is_closed() {
                return;
            }
            let stepped = tokio::task::spawn_blocking(step).await;
            let value = match stepped {
                Ok(Ok(mut value)) => {
                    (value["reply"], value["id"]) = (json!("setup"), json!(id));
                    value
                }
                Ok(Err(why)) => refusal(id, &why),
                Err(_) => refusal(id, "these measurements cannot be evaluated; take the last answer back with undo"),
            };
            let _ = local.try_send(value);
        });
    }

    fn answer(&self, value: Value) {
        // A browser that asks faster than it takes answers loses them.
        let _ = self.local.try_send(value);
    }
}

fn not_for_this_role(id: u64) -> Value {
    refusal(id, "a site is calibrated by who may fly; pair this browser first")
}
