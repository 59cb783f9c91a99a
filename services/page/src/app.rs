//! What all requests share, and the files that are offered for download.

use crate::assets::Assets;
use crate::here::Here;
use crate::observer::Topics;
use crate::places::Conversations;
use crate::settings::PlaceArgs;
use messages::Request;
use std::fs::File;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use tokio::sync::Semaphore;

/// Files of a conversation that wait to be fetched, the oldest of which makes room for the next, and the time for it.
const OFFERS: usize = 2;
const FETCHED: Duration = Duration::from_secs(60);

/// Connections for stops at once, and those that only emergency stops take. Together with those of the browsers and of
/// the observer they are not more than the gateway grants one user.
const STOPS: usize = 4;
const EMERGENCY_STOPS: usize = 2;

/// What all requests share.
#[derive(Debug)]
pub(crate) struct App {
    pub(crate) place: PlaceArgs,
    pub(crate) topics: Arc<Topics>,
    pub(crate) assets: Assets,
    pub(crate) downloads: Downloads,
    /// Names of this machine, beside its addresses.
    pub(crate) names: Vec<String>,
    pub(crate) conversations: Arc<Conversations>,
    pub(crate) stops: Places,
    /// For the browser that `start` opens.
    pub(crate) here: Arc<Here>,
    /// One calibration is computed at a time.
    pub(crate) calibrations: Arc<Semaphore>,
}

/// The places for stops.
#[derive(Debug)]
pub(crate) struct Places {
    stops: Semaphore,
    emergency: Semaphore,
}

impl Default for Places {
    fn default() -> Self {
        Self { stops: Semaphore::new(STOPS), emergency: Semaphore::new(EMERGENCY_STOPS) }
    }
}

impl Places {
    /// Those for a request that stops the robot.
    pub(crate) fn of(&self, request: &Request) -> &Semaphore {
        if *request == Request::Estop { &self.emergency } else { &self.stops }
    }
}

/// Files of finished runs that can be fetched once.
#[derive(Debug, Default)]
pub(crate) struct Downloads(Mutex<Waiting>);

#[derive(Debug, Default)]
struct Waiting {
    /// Oldest first.
    offered: Vec<Offered>,
    /// Number of the last conversation.
    last: u64,
}

/// The files that a conversation offers, until it ends.
#[derive(Debug)]
pub(crate) struct Offers<'a> {
    downloads: &'a Downloads,
    number: u64,
}

/// A file that waits to be fetched.
#[derive(Debug)]
pub(crate) struct Offered {
    ticket: String,
    /// Number of the conversation.
    of: u64,
    pub(crate) file: File,
    pub(crate) name: String,
    pub(crate) bytes: u64,
    /// The browser shows it.
    pub(crate) shown: bool,
    until: Instant,
}

impl Downloads {
    fn waiting(&self) -> MutexGuard<'_, Waiting> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Begins a conversation.
    pub(crate) fn begin(&self) -> Offers<'_> {
        let mut waiting = self.waiting();
        waiting.last += 1;
        Offers { downloads: self, number: waiting.last }
    }

    /// Closes the files that were not fetched in time, so that a deleted run does not stay on the disk.
    pub(crate) fn close_late(&self) {
        let now = Instant::now();
        self.waiting().offered.retain(|one| one.until > now);
    }

    /// Takes a file that is still offered.
    pub(crate) fn fetch(&self, ticket: &str) -> Option<Offered> {
        let offered = &mut self.waiting().offered;
        let at = offered.iter().position(|one| one.ticket == ticket)?;
        Some(offered.remove(at)).filter(|one| one.until > Instant::now())
    }
}

impl Offers<'_> {
    /// Offers a file; returns its path, which cannot be guessed. `None`: the kernel gives no random numbers.
    pub(crate) fn offer(&self, file: File, name: String, bytes: u64, shown: bool) -> Option<String> {
        let (ticket, of, until) = (ticket()?, self.number, Instant::now() + FETCHED);
        let path = format!("/download/{ticket}");
        let offered = &mut self.downloads.waiting().offered;
        if offered.iter().filter(|one| one.of == of).count() >= OFFERS
            && let Some(oldest) = offered.iter().position(|one| one.of == of)
        {
            offered.remove(oldest);
        }
        offered.push(Offered { ticket, of, file, name, bytes, shown, until });
        Some(path)
    }
}

impl Drop for Offers<'_> {
    fn drop(&mut self) {
        self.downloads.waiting().offered.retain(|one| one.of != self.number);
    }
}

fn ticket() -> Option<String> {
    let mut bytes = [0_u8; 16];
    let filled = rustix::rand::getrandom(&mut bytes, rustix::rand::GetRandomFlags::empty()).ok()?;
    (filled == bytes.len()).then(|| messages::hex(&bytes))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_download_is_fetched_once_and_two_of_a_conversation_wait() {
        let downloads = Downloads::default();
        let (one, other) = (downloads.begin(), downloads.begin());
        let offer = |of: &Offers<'_>| of.offer(File::open("/dev/null").unwrap(), "x".to_owned(), 0, false).unwrap();
        let fetch = |path: &str| downloads.fetch(path.rsplit('/').next().unwrap()).is_some();
        let path = offer(&one);
        assert!(!fetch("0") && fetch(&path) && !fetch(&path));
        // The oldest one makes room, and none of another conversation.
        let (kept, paths) = (offer(&other), [offer(&one), offer(&one), offer(&one)]);
        assert_eq!(paths.each_ref().map(|path| fetch(path)), [false, true, true]);
        // With the conversation its files are closed.
        let left = offer(&one);
        drop(one);
        assert!(!fetch(&left) && fetch(&kept));
        downloads.close_late();
    }

    #[test]
    fn an_emergency_stop_has_a_place_when_all_others_are_taken() {
        let places = Places::default();
        let taken: Vec<_> = std::iter::from_fn(|| places.of(&Request::Stop).try_acquire().ok()).collect();
        assert_eq!(taken.len(), STOPS);
        assert!(places.of(&Request::Hold).try_acquire().is_err() && places.of(&Request::Estop).try_acquire().is_ok());
    }
}
