//! `nims top`: a live view of the robot and its processes in the terminal.

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

/// Time between two frames: changing figures remain readable.
const DRAW: Duration = Duration::from_millis(200);
/// Time between two searches for a running robot, ns.
const SEARCH_NS: u64 = 1_000_000_000;

/// Shows the robot until the user presses q.
///
/// # Errors
/// Standard input or output is no terminal, or shared memory fails.
pub fn top(domain: Option<&str>, json: bool) -> Answer {
    if json || !std::io::stdout().is_terminal() || !std::io::stdin().is_terminal() {
        return Err(Failure::BadInput(
            "`nims top` needs a terminal; elsewhere use `nims status` or `nims status --json`".to_owned(),
        ));
    }
    let stop = command::stop_flag()?;
    // ratatui's panic hook restores the terminal too.
    let mut terminal = ratatui::try_init().map_err(|error| {
        ratatui::restore();
        Failure::NotNow(format!("cannot draw on the terminal: {error}"))
    })?;
    let shown = show(domain, &mut terminal, &|| stop.load(Ordering::Relaxed));
    ratatui::restore();
    shown
}

fn show(domain: Option<&str>, terminal: &mut ratatui::DefaultTerminal, stopped: &dyn Fn() -> bool) -> Answer {
    let mut feed: Option<Feed> = None;
    let (mut waiting, mut searched_ns) = (String::new(), 0);
    while !stopped() {
        if feed.as_mut().is_some_and(|feed| !feed.is_alive()) {
            // An open channel would prevent the next robot from creating it.
            feed = None;
        }
        if feed.is_none() && clock::now_ns() >= searched_ns + SEARCH_NS {
            searched_ns = clock::now_ns();
            match Feed::join(domain) {
                Ok(joined) => feed = Some(joined),
                Err(failure @ Failure::BadInput(_)) => return Err(failure),
                Err(failure) => waiting = failure.to_string(),
            }
        }
        let snapshot = match &mut feed {
            Some(feed) => feed.poll()?,
            None => Snapshot::waiting(clock::now_ns(), &waiting),
        };
        terminal.draw(|frame| draw::draw(frame, &snapshot)).map_err(Failure::not_now)?;
        if quit_within(DRAW)? {
            break;
        }
    }
    Ok(())
}

/// Waits for `time`, or until the user resizes the terminal or quits. Returns whether the user quits.
fn quit_within(time: Duration) -> Answer<bool> {
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
            // Redraw in the new size at once.
            Event::Resize(..) => return Ok(false),
            _ => {}
        }
    }
}
