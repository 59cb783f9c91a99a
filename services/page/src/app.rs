//! What all requests share, and the files that are offered for download.

use crate::assets::Assets;
use crate::observer::Topics;
use crate::places::Conversations;
use crate::settings::PlaceArgs;
use messages::Request;
use std::collections::BTreeMap;
use std::fs::File;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};
use tokio::sync::Semaphore;

/// Downloads that wait to be fetched, and the time for it.
const DOWNLOADS: usize = 32;
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
pub(crate) struct Downloads(Mutex<BTreeMap<String, Offered>>);

/// A file that waits to be fetched.
#[derive(Debug)]
pub(crate) struct Offered {
    pub(crate) file: File,
    pub(crate) name: String,
    pub(crate) bytes: u64,
    /// The browser shows it.
    pub(crate) shown: bool,
    until: Instant,
}

impl Downloads {
    /// Offers a file; returns its path, which cannot be guessed. `None`: too many wait.
    pub(crate) fn offer(&self, file: File, name: String, bytes: u64, shown: bool) -> Option<String> {
        let mut offered = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let now = Instant::now();
        offered.retain(|_, one| one.until > now);
        let ticket = (offered.len() < DOWNLOADS).then(ticket)??;
        offered.insert(ticket.clone(), Offered { file, name, bytes, shown, until: now + FETCHED });
        Some(format!("/download/{ticket}"))
    }

    /// Takes a file that is still offered.
    pub(crate) fn fetch(&self, ticket: &str) -> Option<Offered> {
        let mut offered = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        offered.remove(ticket).filter(|one| one.until > Instant::now())
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
    fn a_download_is_fetched_once_and_a_bounded_number_waits() {
        let downloads = Downloads::default();
        let offer = || downloads.offer(File::open("/dev/null").unwrap(), "x".to_owned(), 0, false);
        let path = offer().unwrap();
        let ticket = path.rsplit('/').next().unwrap();
        assert!(
            downloads.fetch("0").is_none() && downloads.fetch(ticket).is_some() && downloads.fetch(ticket).is_none()
        );
        assert_eq!((0..DOWNLOADS + 3).filter(|_| offer().is_some()).count(), DOWNLOADS);
    }

    #[test]
    fn an_emergency_stop_has_a_place_when_all_others_are_taken() {
        let places = Places::default();
        let taken: Vec<_> = std::iter::from_fn(|| places.of(&Request::Stop).try_acquire().ok()).collect();
        assert_eq!(taken.len(), STOPS);
        assert!(places.of(&Request::Hold).try_acquire().is_err() && places.of(&Request::Estop).try_acquire().is_ok());
    }
}
