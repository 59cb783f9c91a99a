//! Cleaning up after processes that were killed.

use std::fs;
use std::os::unix::fs::MetadataExt;
use std::time::{Duration, SystemTime};

use iceoryx2::prelude::{NodeBuilder, SignalHandlingMode, ipc};

use crate::{BusError, Domain};

/// A service file stays at mode 0600 only while it is being made, about a millisecond; one that is older was left by a killed process.
const HALF_MADE: Duration = Duration::from_secs(2);
/// Removing one dead process takes a millisecond; a cleaner that needs this long hangs.
const PATIENCE: Duration = Duration::from_secs(5);

/// What [`Domain::sweep`] did.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Swept {
    /// Processes that live in the domain.
    pub alive: usize,
    /// Dead processes whose traces were removed.
    pub removed: u64,
    /// Dead processes whose traces could not be removed.
    pub failed: u64,
    /// Files removed: everything if nobody lives, otherwise half-made channels.
    pub files: usize,
}

impl Domain {
    /// Cleans up after killed processes: wipes the domain if no process lives in it, otherwise removes what the dead have left.
    ///
    /// For whoever runs the domain ([`Domain::claim`]), before it starts the first process and after one has died.
    ///
    /// # Errors
    /// [`BusError::DomainFolder`] if the cleaner itself hangs: then nothing helps but to end every process of the domain and to start again.
    pub fn sweep(&self) -> Result<Swept, BusError> {
        let (alive, dead) = self.nodes();
        if alive.is_empty() {
            return Ok(Swept { files: self.wipe(), ..Swept::default() });
        }
        let files = self.remove_half_made();
        let mut swept = Swept { alive: alive.len(), files, ..Swept::default() };
        if dead > 0 {
            // In a thread of its own: a cleaner can hang on what a process killed in its first millisecond has left.
            let (config, (done, result)) = (self.config().clone(), std::sync::mpsc::sync_channel(1));
            let cleaner = std::thread::Builder::new().name("sweep".to_owned()).spawn(move || {
                let mut config = config;
                config.global.node.cleanup_dead_nodes_on_creation = false;
                let node = NodeBuilder::new()
                    .config(&config)
                    .signal_handling_mode(SignalHandlingMode::Disabled)
                    .create::<ipc::Service>();
                let _ = done.send(node.map(|node| node.try_cleanup_dead_nodes()).ok());
            });
            let hangs = |why: &str| BusError::DomainFolder { path: self.root().to_owned(), why: why.to_owned() };
            cleaner.map_err(|error| hangs(&format!("no cleaner could be started ({error})")))?;
            match result.recv_timeout(PATIENCE) {
                Ok(Some(state)) => (swept.removed, swept.failed) = (state.cleanups, state.failed_cleanups),
                Ok(None) => swept.failed = dead as u64,
                Err(_) => {
                    return Err(hangs(
                        "removing what killed processes left takes too long; end every process of the domain and start again",
                    ));
                }
            }
        }
        Ok(swept)
    }

    /// Removes channels whose maker was killed while it made them: nobody could ever open them.
    pub(crate) fn remove_half_made(&self) -> usize {
        let mut removed = 0;
        for entry in fs::read_dir(self.root().join("services")).into_iter().flatten().flatten() {
            let Ok(found) = entry.metadata() else { continue };
            let old = found
                .modified()
                .ok()
                .and_then(|at| SystemTime::now().duration_since(at).ok())
                .is_some_and(|age| age > HALF_MADE);
            if found.is_file() && found.mode() & 0o777 == 0o600 && old {
                removed += usize::from(fs::remove_file(entry.path()).is_ok());
            }
        }
        removed
    }
}
