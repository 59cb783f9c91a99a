//! `nims top`: a live view of the robot and its processes in the terminal.

mod draw;
mod feed;
mod snapshot;

use command::{Answer, Failure};

use bus::clock;
use client::Place;
use feed::Feed;
use messages::Request;
use ratatui::crossterm::event::{self, Event, KeyCode, KeyEvent, KeyEventKind, KeyModifiers};
use snapshot::Snapshot;
use std::io::IsTerminal;
use std::sync::atomic::Ordering;
use std::time::Duration;

/// Time between two frames: changing figures remain readable.
const DRAW: Duration = Duration::from_millis(200);
/// Time for which the answer to a key is shown, ns.
const ANSWER_NS: u64 = 6_000_000_000;
/// Time between two searches for a running robot, ns.
const SEARCH_NS: u64 = 1_000_000_000;

/// Shows the robot until the user presses q. With p it pauses, with s it stops.
///
/// # Errors
/// Standard input or output is no terminal, or shared memory fails.
pub fn top(place: Place<'_>, json: bool) -> Answer {
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
    let shown = show(place, &mut terminal, &|| stop.load(Ordering::Relaxed));
    ratatui::restore();
    shown
}

fn show(place: Place<'_>, terminal: &mut ratatui::DefaultTerminal, stopped: &dyn Fn() -> bool) -> Answer {
    let mut feed: Option<Feed> = None;
    let (mut waiting, mut searched_ns) = (String::new(), 0);
    let (mut answer, mut answered_ns) = (String::new(), 0);
    while !stopped() {
        if feed.as_mut().is_some_and(|feed| !feed.is_alive()) {
            // An open channel would prevent the next robot from creating it.
            feed = None;
        }
        if feed.is_none() && clock::now_ns() >= searched_ns + SEARCH_NS {
            searched_ns = clock::now_ns();
            match Feed::join(place) {
                Ok(joined) => feed = Some(joined),
                Err(failure @ Failure::BadInput(_)) => return Err(failure),
                Err(failure) => waiting = failure.to_string(),
            }
        }
        let mut snapshot = match &mut feed {
            Some(feed) => feed.poll()?,
            None => Snapshot::waiting(clock::now_ns(), &waiting),
        };
        if clock::now_ns() < answered_ns + ANSWER_NS {
            snapshot.answer.clone_from(&answer);
        }
        terminal.draw(|frame| draw::draw(frame, &snapshot)).map_err(Failure::not_now)?;
        let request = match key_within(DRAW)? {
            Some(Key::Quit) => break,
            Some(Key::Pause) => Request::Pause,
            Some(Key::Stop) => Request::Stop,
            None => continue,
        };
        if let Some(feed) = &feed {
            (answer, answered_ns) = (feed.request(&request), clock::now_ns());
        }
    }
    Ok(())
}

/// Waits for `time`, or until the user resizes the terminal or presses a key that means something.
fn key_within(time: Duration) -> Answer<Option<Key>> {
    let deadline = clock::now_ns() + time.as_nanos() as u64;
    loop {
        let left = Duration::from_nanos(deadline.saturating_sub(clock::now_ns()));
        match event::poll(left) {
            Ok(true) => {}
            Ok(false) => return Ok(None),
            Err(error) if error.kind() == std::io::ErrorKind::Interrupted => return Ok(None),
            Err(error) => return Err(Failure::not_now(error)),
        }
        match event::read().map_err(Failure::not_now)? {
            Event::Key(event) if event.kind != KeyEventKind::Release => {
                if let Some(key) = Key::from_event(event) {
                    return Ok(Some(key));
                }
            }
            // Redraw in the new size at once.
            Event::Resize(..) => return Ok(None),
            _ => {}
        }
    }
}

/// What a key means. No key starts a motion: a key is pressed by accident more easily than a command is typed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Key {
    Quit,
    Pause,
    Stop,
}

impl Key {
    fn from_event(event: KeyEvent) -> Option<Self> {
        let control = event.modifiers.contains(KeyModifiers::CONTROL);
        match event.code {
            KeyCode::Char('c') if control => Some(Self::Quit),
            _ if control => None,
            KeyCode::Char('q') | KeyCode::Esc => Some(Self::Quit),
            KeyCode::Char('p') => Some(Self::Pause),
            KeyCode::Char('s') => Some(Self::Stop),
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_bring_the_robot_to_rest_and_nothing_else() {
        let plain = |key: char| Key::from_event(KeyEvent::new(KeyCode::Char(key), KeyModifiers::NONE));
        assert_eq!((plain('q'), plain('p'), plain('s')), (Some(Key::Quit), Some(Key::Pause), Some(Key::Stop)));
        for other in ('a'..='z').filter(|key| !"qps".contains(*key)) {
            assert_eq!(plain(other), None, "{other}");
        }
        let with_control = |key| Key::from_event(KeyEvent::new(KeyCode::Char(key), KeyModifiers::CONTROL));
        assert_eq!((with_control('c'), with_control('s')), (Some(Key::Quit), None));
    }
}
