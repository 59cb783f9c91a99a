//! What waits to be sent to one tool, in bounded memory.

use std::collections::VecDeque;
use std::sync::{Mutex, MutexGuard, PoisonError};

use tokio::sync::Notify;
use tokio_tungstenite::tungstenite::{Bytes, Message};

/// Largest number of samples that wait for a slow tool, and of their bytes; then the oldest are dropped.
const SAMPLES: usize = 1024;
const SAMPLE_BYTES: usize = 16 << 20;
/// Largest size of other messages that wait, bytes; a tool that does not take them is disconnected.
const TEXT_BYTES: usize = 16 << 20;

/// The messages for one tool: filled by the viewer, emptied by the connection.
#[derive(Debug, Default)]
pub(crate) struct Outbox {
    waiting: Mutex<Waiting>,
    changed: Notify,
}

#[derive(Debug, Default)]
struct Waiting {
    texts: VecDeque<String>,
    text_bytes: usize,
    samples: VecDeque<Vec<u8>>,
    sample_bytes: usize,
    closed: bool,
}

impl Outbox {
    fn waiting(&self) -> MutexGuard<'_, Waiting> {
        self.waiting.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Adds a message that must arrive, before any sample that waits. The connection ends if too many wait.
    pub(crate) fn push_text(&self, text: String) {
        let mut waiting = self.waiting();
        if waiting.text_bytes + text.len() > TEXT_BYTES {
            waiting.closed = true;
        } else {
            waiting.text_bytes += text.len();
            waiting.texts.push_back(text);
        }
        drop(waiting);
        self.changed.notify_one();
    }

    /// Adds a sample; the oldest ones are dropped if too many wait.
    pub(crate) fn push_sample(&self, sample: Vec<u8>) {
        let mut waiting = self.waiting();
        waiting.sample_bytes += sample.len();
        waiting.samples.push_back(sample);
        // A sample that is larger than the limit waits alone.
        while waiting.samples.len() > SAMPLES || (waiting.sample_bytes > SAMPLE_BYTES && waiting.samples.len() > 1) {
            let dropped = waiting.samples.pop_front().map_or(0, |sample| sample.len());
            waiting.sample_bytes -= dropped;
        }
        drop(waiting);
        self.changed.notify_one();
    }

    fn take(&self) -> Option<Result<Message, Closed>> {
        let mut waiting = self.waiting();
        if waiting.closed {
            return Some(Err(Closed));
        }
        if let Some(text) = waiting.texts.pop_front() {
            waiting.text_bytes -= text.len();
            return Some(Ok(Message::from(text)));
        }
        let sample = waiting.samples.pop_front()?;
        waiting.sample_bytes -= sample.len();
        Some(Ok(Message::Binary(Bytes::from(sample))))
    }

    /// Waits for the next message.
    ///
    /// # Errors
    /// The tool does not take what it has to.
    pub(crate) async fn next(&self) -> Result<Message, Closed> {
        loop {
            if let Some(message) = self.take() {
                return message;
            }
            self.changed.notified().await;
        }
    }
}

/// The connection has to end.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Closed;

#[cfg(test)]
mod tests {
    use super::*;

    /// Number and bytes of the samples that wait.
    fn size(outbox: &Outbox) -> (usize, usize) {
        let waiting = outbox.waiting();
        (waiting.samples.len(), waiting.sample_bytes)
    }

    #[test]
    fn the_oldest_samples_are_dropped_by_number_and_by_size() {
        let outbox = Outbox::default();
        for at in 0..2 * SAMPLES {
            outbox.push_sample(vec![(at % 251) as u8]);
        }
        assert_eq!(size(&outbox), (SAMPLES, SAMPLES));
        assert_eq!(outbox.waiting().samples[0], [(SAMPLES % 251) as u8]);
        for _ in 0..9 {
            outbox.push_sample(vec![0; SAMPLE_BYTES / 4]);
        }
        assert_eq!(size(&outbox), (4, SAMPLE_BYTES));
        outbox.push_sample(vec![0; 2 * SAMPLE_BYTES]);
        assert_eq!(size(&outbox).0, 1, "a large one passes too, alone");
        assert_eq!(outbox.take().map(|message| message.unwrap().len()), Some(2 * SAMPLE_BYTES));
        assert_eq!(outbox.take(), None);
        assert_eq!(size(&outbox), (0, 0));
    }

    #[test]
    fn texts_come_first_and_all_or_the_connection_ends() {
        let outbox = Outbox::default();
        outbox.push_sample(vec![1]);
        outbox.push_text("a".to_owned());
        outbox.push_text("b".to_owned());
        let texts: Vec<Message> = std::iter::from_fn(|| outbox.take()).map(Result::unwrap).collect();
        assert_eq!(texts, [Message::from("a"), Message::from("b"), Message::Binary(Bytes::from_static(&[1]))]);
        outbox.push_text(" ".repeat(TEXT_BYTES));
        assert_eq!(outbox.waiting().texts.len(), 1);
        outbox.push_text("c".to_owned());
        assert_eq!(outbox.take(), Some(Err(Closed)));
    }
}
