//! Log events to the terminal and to `system/log/NAME`; logging never blocks.
//!
//! The logging thread formats an event and puts it into two bounded queues. A separate thread writes one queue to the
//! terminal (a full pipe blocks only this thread); the loop of the process publishes the other in its idle time. Events
//! that do not fit are counted, and the count is logged.

use std::io::Write;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::sync::{Arc, OnceLock};
use std::time::Duration;

use bus::{Bus, BusError, Publisher, clock};
use messages::{LogEvent, put_sentence, put_text};
use tracing::field::{Field, Visit};
use tracing::level_filters::LevelFilter;
use tracing::{Event, Level, Subscriber};
use tracing_subscriber::layer::{Context, Layer, SubscriberExt};

/// Capacity of each queue, events: more than a start-up logs.
const QUEUE: usize = 256;
/// Largest number of events published per call (1 µs each), which spreads a burst over several passes.
const AT_ONCE: usize = 16;
/// Stack of the terminal thread, which formats nothing and calls little, bytes.
const STACK_BYTES: usize = 64 * 1024;
/// Longest time that the end of the process waits for the terminal.
const FLUSH: Duration = Duration::from_millis(300);

struct LogLine {
    stamp_ns: u64,
    level: Level,
    target: &'static str,
    text: String,
}

enum ToTerminal {
    Line(String),
    Flush(SyncSender<()>),
}

struct Queues {
    terminal: SyncSender<ToTerminal>,
    channel: SyncSender<LogLine>,
    dropped: Arc<AtomicU64>,
    unprinted: Arc<AtomicU64>,
    process: String,
}

/// Sender of the terminal queue, for flushing.
static TERMINAL: OnceLock<SyncSender<ToTerminal>> = OnceLock::new();

/// The log events of this process that are not published yet; [`Log::publish`] publishes them.
pub(crate) struct Log {
    lines: Receiver<LogLine>,
    dropped: Arc<AtomicU64>,
    publisher: Publisher<LogEvent>,
    sample: LogEvent,
}

/// Starts logging for the process. Only the first call in a process receives the events (tests may call it several
/// times).
///
/// # Errors
/// Those of creating the channel.
pub(crate) fn start(bus: &Bus, verbose: bool) -> Result<Log, BusError> {
    let process = bus.process().to_owned();
    let (channel, lines) = sync_channel(QUEUE);
    let dropped = Arc::new(AtomicU64::new(0));
    let (terminal, to_print) = sync_channel(QUEUE);
    let unprinted = Arc::new(AtomicU64::new(0));
    let queues = Queues {
        terminal: terminal.clone(),
        channel,
        dropped: dropped.clone(),
        unprinted: unprinted.clone(),
        process: process.clone(),
    };
    let level = if verbose { LevelFilter::DEBUG } else { LevelFilter::INFO };
    let registry = tracing_subscriber::registry().with(queues.with_filter(level));
    if tracing::subscriber::set_global_default(registry).is_ok() {
        let printing = std::thread::Builder::new()
            .name("log".to_owned())
            .stack_size(STACK_BYTES)
            .spawn(move || print(&to_print, &unprinted));
        if printing.is_ok() {
            let _ = TERMINAL.set(terminal);
        }
        std::panic::set_hook(Box::new(|info| tracing::error!("{}", info.to_string().replace('\n', " "))));
    }
    let publisher = bus.publisher(&format!("system/log/{process}"))?;
    let mut sample = LogEvent { pid: std::process::id(), ..LogEvent::default() };
    put_text(&mut sample.process, &process);
    Ok(Log { lines, dropped, publisher, sample })
}

fn print(queue: &Receiver<ToTerminal>, unprinted: &AtomicU64) {
    // Ignore the errors of a closed terminal.
    let write = |text: &str| _ = std::io::stderr().write_all(text.as_bytes());
    while let Ok(next) = queue.recv() {
        match next {
            ToTerminal::Line(line) => write(&line),
            ToTerminal::Flush(done) => _ = done.send(()),
        }
        match unprinted.swap(0, Ordering::Relaxed) {
            0 => {}
            count => write(&format!("({count} log lines were not printed, because the terminal is too slow)\n")),
        }
    }
}

/// Waits until the events logged so far are written to the terminal, at most [`FLUSH`].
pub(crate) fn flush() {
    if let Some(terminal) = TERMINAL.get() {
        let (done, wait) = sync_channel(1);
        if terminal.try_send(ToTerminal::Flush(done)).is_ok() {
            let _ = wait.recv_timeout(FLUSH);
        }
    }
}

impl Log {
    /// Publishes up to [`AT_ONCE`] events; returns whether no event is left.
    ///
    /// # Errors
    /// Those of [`Publisher::send`].
    pub(crate) fn publish(&mut self) -> Result<bool, BusError> {
        for _ in 0..AT_ONCE {
            let Ok(line) = self.lines.try_recv() else {
                self.report_dropped()?;
                return Ok(true);
            };
            self.send(line.stamp_ns, line.level, line.target, &line.text)?;
        }
        Ok(false)
    }

    /// Sends the history to subscribers created since the last event, which may be long ago.
    pub(crate) fn serve_late_subscribers(&mut self) {
        self.publisher.update_connections();
    }

    fn report_dropped(&mut self) -> Result<(), BusError> {
        match self.dropped.swap(0, Ordering::Relaxed) {
            0 => Ok(()),
            count => self.send(
                clock::now_ns(),
                Level::WARN,
                "service",
                &format!("{count} log events were dropped in a burst"),
            ),
        }
    }

    fn send(&mut self, stamp_ns: u64, level: Level, target: &str, text: &str) -> Result<(), BusError> {
        let sample = &mut self.sample;
        (sample.header.stamp_ns, sample.header.oldest_input_ns) = (stamp_ns, stamp_ns);
        sample.level = match level {
            Level::ERROR => LogEvent::LEVEL_ERROR,
            Level::WARN => LogEvent::LEVEL_WARN,
            Level::INFO => LogEvent::LEVEL_INFO,
            Level::DEBUG => LogEvent::LEVEL_DEBUG,
            Level::TRACE => LogEvent::LEVEL_TRACE,
        };
        put_text(&mut sample.target, target);
        put_sentence(&mut sample.text, text);
        self.publisher.send(sample).map(|_| ())
    }
}

impl<S: Subscriber> Layer<S> for Queues {
    fn on_event(&self, event: &Event<'_>, _: Context<'_, S>) {
        let mut text = Text::default();
        event.record(&mut text);
        let (level, target) = (*event.metadata().level(), event.metadata().target());
        let line = format!("{level:5} {}: {}\n", self.process, text.0);
        if matches!(self.terminal.try_send(ToTerminal::Line(line)), Err(TrySendError::Full(_))) {
            self.unprinted.fetch_add(1, Ordering::Relaxed);
        }
        let line = LogLine { stamp_ns: clock::now_ns(), level, target, text: text.0 };
        if matches!(self.channel.try_send(line), Err(TrySendError::Full(_))) {
            self.dropped.fetch_add(1, Ordering::Relaxed);
        }
    }
}

/// The text of an event: the message, then `key=value` for every other field.
#[derive(Default)]
struct Text(String);

impl Visit for Text {
    fn record_debug(&mut self, field: &Field, value: &dyn std::fmt::Debug) {
        use std::fmt::Write as _;
        // Writing to a String cannot fail.
        if field.name() == "message" {
            let rest = std::mem::take(&mut self.0);
            let _ = write!(self.0, "{value:?}{rest}");
        } else {
            let _ = write!(self.0, " {}={value:?}", field.name());
        }
    }
}
