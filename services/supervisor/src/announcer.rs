//! Messages of the supervisor: on the terminal, and on `system/log/nims`, and so in the run file.

use bus::{Bus, Publisher, clock};
use command::Answer;
use messages::{LogEvent, put_sentence, put_text};
use std::io::Write;

/// Publishes messages for the operator.
pub struct Announcer {
    log: Publisher<LogEvent>,
}

impl Announcer {
    pub(super) fn new(bus: &Bus) -> Answer<Self> {
        Ok(Self { log: bus.publisher("system/log/nims")? })
    }

    pub(super) fn info(&mut self, text: &str) {
        self.publish(LogEvent::LEVEL_INFO, "", text);
    }

    pub(super) fn warn(&mut self, text: &str) {
        self.publish(LogEvent::LEVEL_WARN, "warning: ", text);
    }

    pub(super) fn error(&mut self, text: &str) {
        self.publish(LogEvent::LEVEL_ERROR, "ERROR: ", text);
    }

    fn publish(&mut self, level: u8, mark: &str, text: &str) {
        // A closed terminal must not end the supervision of a robot.
        let _ = writeln!(std::io::stderr(), "nims: {mark}{text}");
        let now = clock::now_ns();
        let mut event = LogEvent { pid: std::process::id(), level, ..LogEvent::default() };
        event.header.stamp_ns = now;
        event.header.oldest_input_ns = now;
        put_text(&mut event.process, "nims");
        put_text(&mut event.target, "nims::supervisor");
        put_sentence(&mut event.text, text);
        // The terminal has the message; a log that cannot be published must not stop the supervisor.
        let _ = self.log.send(&mut event);
    }
}
