//! What can go wrong, each as one sentence: what, where, what to do.

use std::path::PathBuf;

/// Why something on the bus did not work.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BusError {
    /// The name of a domain cannot be used.
    #[error("the domain `{name}` cannot be used: {why}")]
    DomainName {
        /// As it was given.
        name: String,
        /// What is wrong with it.
        why: BadName,
    },
    /// The folder of a domain cannot be used.
    #[error("the folder {path} of the domain cannot be used: {why}")]
    DomainFolder {
        /// The folder.
        path: PathBuf,
        /// What is wrong with it.
        why: Unfit,
    },
    /// Another supervisor runs this domain.
    #[error(
        "the domain `{name}` is already run by process {pid}: stop that one first, or choose another name with --domain"
    )]
    Claimed {
        /// The domain.
        name: String,
        /// Who holds it; 0 if it cannot be read.
        pid: u32,
    },
    /// The process could not become part of the domain.
    #[error("process `{process}` could not join the domain `{domain}`: {why}")]
    Join {
        /// The process.
        process: String,
        /// The domain.
        domain: String,
        /// One clause.
        why: String,
    },
    /// A channel's name cannot be used.
    #[error("`{name}` is not a channel name: lower-case words of a-z, 0-9, `_`, `-`, joined by `/`, 64 bytes at most")]
    ChannelName {
        /// As it was given.
        name: String,
    },
    /// Nobody has opened this channel.
    #[error("there is no channel `{channel}` in the domain `{domain}`: no process has opened it")]
    NoChannel {
        /// The channel.
        channel: String,
        /// The domain.
        domain: String,
    },
    /// Two builds disagree about a sample.
    #[error("channel `{channel}` carries `{found}`, and this process speaks `{wanted}`: {}", way_out(channel, holders))]
    TypeMismatch {
        /// The channel.
        channel: String,
        /// Type name there.
        found: String,
        /// Type name here.
        wanted: String,
        /// Who holds the channel.
        holders: String,
    },
    /// The channel was made with a smaller quality of service.
    #[error(
        "channel `{channel}` was made with other settings than the channel table has ({why}): stop {} first",
        known(holders)
    )]
    QualityMismatch {
        /// The channel.
        channel: String,
        /// One clause.
        why: String,
        /// Who holds the channel.
        holders: String,
    },
    /// All places are taken.
    #[error("channel `{channel}` already has its {limit} {what}{}: stop one of them first", held(holders))]
    Full {
        /// The channel.
        channel: String,
        /// How many there may be.
        limit: usize,
        /// What has all its places.
        what: PlaceKind,
        /// Who holds the channel; empty where that is not known.
        holders: String,
    },
    /// Shared memory is full, or nearly.
    #[error(
        "shared memory has {} left, and `{what}` needs {} with the margin that is kept: remove what fills /dev/shm, or make it larger (mount -o remount,size=..)",
        megabytes(*free), megabytes(*needed)
    )]
    NoMemory {
        /// A channel or a process.
        what: String,
        /// Bytes, with the margin.
        needed: u64,
        /// Bytes.
        free: u64,
    },
    /// Too many things to wait for.
    #[error("a process can wait for {limit} channels and descriptors at most")]
    TooManyToWaitFor {
        /// How many.
        limit: usize,
    },
    /// Schema text does not fit.
    #[error("the schema text of `{type_name}` does not fit its channel: {why}")]
    Schema {
        /// The type.
        type_name: String,
        /// One clause.
        why: String,
    },
    /// No process answers requests of that name.
    #[error("no process answers as `{process}` in the domain `{domain}`: it is not running")]
    NoServer {
        /// Who was asked.
        process: String,
        /// The domain.
        domain: String,
    },
    /// It was there, and did not answer.
    #[error("`{process}` did not answer within {seconds:.1} s: it {why}")]
    NoAnswer {
        /// Who was asked.
        process: String,
        /// How long.
        seconds: f64,
        /// One clause.
        why: &'static str,
    },
    /// Anything that is nobody's mistake.
    #[error("channel `{channel}` failed to {what}: {why}")]
    Failed {
        /// The channel.
        channel: String,
        /// An infinitive.
        what: &'static str,
        /// One clause.
        why: String,
    },
}

/// The name of the process itself where the holders of a channel are named.
pub const THIS_PROCESS: &str = "this process";

/// What has places in a channel, or beside it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum PlaceKind {
    /// Who publishes.
    #[error("publisher(s)")]
    Publishers,
    /// Who subscribes.
    #[error("subscribers")]
    Subscribers,
    /// Who subscribes with the whole buffer.
    #[error("subscribers that hear everything")]
    DeepSubscribers,
    /// Who subscribes from the same party.
    #[error("subscribers of this kind")]
    SubscribersOfParty,
    /// Who opens it.
    #[error("processes")]
    Processes,
    /// Who wakes others.
    #[error("processes that wake it")]
    Wakers,
    /// Who is woken.
    #[error("processes that wait for it")]
    Waiters,
    /// Who answers requests.
    #[error("answering process")]
    Server,
    /// Who asks.
    #[error("commands that wait for an answer")]
    Clients,
}

/// Why a name cannot be that of a domain.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum BadName {
    /// None, or too many characters.
    #[error("give it 1 to {most} characters")]
    Length {
        /// As many as it may have.
        most: usize,
    },
    /// Other characters than those of names.
    #[error("use only letters, digits and `-`")]
    Characters,
    /// A folder that depends on where the process stands.
    #[error("give the folder as an absolute path")]
    Relative,
    /// A folder whose path leaves no room for what is in it.
    #[error("its folder is {excess} bytes too long")]
    LongFolder {
        /// Bytes.
        excess: usize,
    },
    /// A character that the shared memory cannot have in a path.
    #[error("it has a character that a path cannot have")]
    NoPath,
}

/// Why the folder of a domain cannot be used.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum Unfit {
    /// It stands on a disk.
    #[error("it is not in memory; give a folder on tmpfs, such as one in /dev/shm or /run")]
    NotInMemory,
    /// The system does not make it; in its words.
    #[error("it cannot be made ({0})")]
    NotMade(String),
    /// Something else has its name.
    #[error("it is not a folder; remove it")]
    NotAFolder,
    /// It is another user's.
    #[error("it belongs to user {owner}, and this is user {user}; run everything as one user")]
    OtherUser {
        /// Whose it is.
        owner: u32,
        /// Whose process this is.
        user: u32,
    },
    /// It is used for something else.
    #[error("it holds files that are no robot's; give a folder that is empty or does not exist")]
    OtherFiles,
    /// Other users may enter it.
    #[error("other users may enter it (mode {mode:o}); make it private with `chmod 700`")]
    Open {
        /// Its permissions.
        mode: u32,
    },
    /// No thread could be started that removes what the dead have left; in the system's words.
    #[error("no cleaner could be started ({0})")]
    NoCleaner(String),
    /// What the dead have left cannot be removed in time.
    #[error("removing what killed processes left takes too long; end every process of the domain and start again")]
    CleanerHangs,
    /// The system refuses something else; in its words.
    #[error("{0}")]
    System(String),
}

impl From<std::io::Error> for Unfit {
    fn from(error: std::io::Error) -> Self {
        Self::System(error.to_string())
    }
}

fn megabytes(bytes: u64) -> String {
    format!("{:.1} MB", bytes as f64 * 1e-6)
}

/// Who has to be stopped, also where nobody could be named.
fn known(holders: &str) -> &str {
    if holders.is_empty() { "the processes that hold it" } else { holders }
}

/// Who holds a channel, as the end of a clause; nothing where that is not known.
fn held(holders: &str) -> String {
    if holders.is_empty() { String::new() } else { format!("; it is held by {holders}") }
}

/// What helps where two types meet on one channel: a changed sensor gets a new name, everything else comes from one build.
fn way_out(channel: &str, holders: &str) -> String {
    let holders = known(holders);
    match channel.strip_prefix("sensor/") {
        Some(name) => format!(
            "a changed type needs a new name, because the old channel is still held (by {holders}): plug it in as e.g. `{name}-2`"
        ),
        None => format!(
            "they come from different builds; stop {holders} and start everything from one build, or give the new type a new channel name"
        ),
    }
}

impl BusError {
    /// A refusal by iceoryx2 at a channel.
    pub(crate) fn failed(channel: &str, what: &'static str, error: &impl std::fmt::Debug) -> Self {
        Self::Failed { channel: channel.to_owned(), what, why: format!("iceoryx2 says {error:?}") }
    }

    /// True where the caller gave something unusable (a program then exits with 2).
    #[must_use]
    pub fn is_bad_input(&self) -> bool {
        matches!(self, Self::DomainName { .. } | Self::ChannelName { .. } | Self::Claimed { .. })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_full_channel_names_its_holders_where_they_are_known() {
        let holders = "a (process 1)";
        assert_eq!(held(""), "", "no clause about a name that is not known");
        assert!(held(holders).contains(holders));
        for holders in ["", holders] {
            let channel = "motor/state".to_owned();
            let full = BusError::Full { channel, limit: 2, what: PlaceKind::Subscribers, holders: holders.to_owned() };
            let sentence = full.to_string();
            assert!(
                ["motor/state", &format!("2 {}", PlaceKind::Subscribers), &held(holders)]
                    .iter()
                    .all(|part| sentence.contains(part)),
                "{sentence}"
            );
        }
    }
}
