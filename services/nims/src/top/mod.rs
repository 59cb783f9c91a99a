//! `nims top`: the robot and its processes, live in the terminal.

mod draw;
mod feed;
mod snapshot;

use command::{Answer, Failure};

use bus::clock;
use feed::Feed;
use ratatui::crossterm::event::{self, Event, KeyCode, KeyEventKind, KeyModifiers};
use snapshot::Snapshot;
use std::io::IsTerminal;
use std::sync::atomic::Ordering;
use std::time::Duration;

/// How often it draws: as fast as figures can be read.
const DRAW: Duration = Duration::from_millis(200);
/// How often it looks for a robot while there is none, ns.
const LOOK_NS: u64 = 1_000_000_000;

/// Shows what the robot does until someone presses q.
///
/// # Errors
/// Without a terminal; or shared memory fails.
pub fn top(domain: Option<&str>, json: bool) -> Answer {
    if json || !std::io::stdout().is_terminal() || !std::io::stdin().is_terminal() {
        return Err(Failure::BadInput(
            "`nims top` draws on a terminal; use `nims status`, or `nims status --json`, for anything else".to_owned(),
        ));
    }
    let stop = command::stop_flag()?;
    // Its panic hook puts the terminal back too.
    let mut terminal = ratatui::try_init().map_err(|error| {
        ratatui::restore();
        Failure::NotNow(format!("the terminal cannot be drawn on: {error}"))
    })?;
    let shown = show(domain, &mut terminal, &|| stop.load(Ordering::Relaxed));
    ratatui::restore();
    shown
}

fn show(domain: Option<&str>, terminal: &mut ratatui::DefaultTerminal, stopped: &dyn Fn() -> bool) -> Answer {
    let mut feed: Option<Feed> = None;
    let (mut waiting, mut looked_ns) = (String::new(), 0);
    while !stopped() {
        if feed.as_mut().is_some_and(|feed| !feed.is_alive()) {
            // Whoever holds a channel keeps the next robot from making it anew.
            feed = None;
        }
        if feed.is_none() && clock::now_ns() >= looked_ns + LOOK_NS {
            looked_ns = clock::now_ns();
            match Feed::join(domain) {
                Ok(joined) => feed = Some(joined),
                Err(failure @ Failure::BadInput(_)) => return Err(failure),
                Err(failure) => waiting = failure.to_string(),
            }
        }
        let snapshot = match &mut feed {
            Some(feed) => feed.look()?,
            None => Snapshot::waiting(clock::now_ns(), &waiting),
        };
        terminal.draw(|frame| draw::draw(frame, &snapshot)).map_err(Failure::not_now)?;
        if is_over(DRAW)? {
            break;
        }
    }
    Ok(())
}

/// Waits; true if someone wants to leave meanwhile.
fn is_over(time: Duration) -> Answer<bool> {
    let deadline = clock::now_ns() + time.as_nanos() as u64;
    loop {
        let left = Duration::from_nanos(deadline.saturating_sub(clock::now_ns()));
        match event::poll(left) {
            Ok(true) => {}
            Ok(false) => return Ok(false),
            Err(error) if error.kind() == std::io::ErrorKind::Interrupted => return Ok(false),
            Err(error) => return Err(Failure::not_now(error)),
        }
        match event::read().map_err(Failure::not_now)? {
            Event::Key(key) if key.kind != KeyEventKind::Release => {
                let control = key.modifiers.contains(KeyModifiers::CONTROL);
                if matches!(key.code, KeyCode::Char('q') | KeyCode::Esc) || control && key.code == KeyCode::Char('c') {
                    return Ok(true);
                }
            }
            // drawn in the new size at once
            Event::Resize(..) => return Ok(false),
            _ => {}
        }
    }
}
