//! Errors of the bus. Each message is one sentence: what is wrong, where, and what to do.

use std::path::PathBuf;

/// An error of the bus.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BusError {
    /// The name of a domain is not valid.
    #[error("the domain `{name}` cannot be used: {why}")]
    DomainName {
        /// The given name.
        name: String,
        /// The problem.
        why: BadName,
    },
    /// The folder of a domain cannot be used.
    #[error("the folder {path} of the domain cannot be used: {why}")]
    DomainFolder {
        /// Path of the folder.
        path: PathBuf,
        /// The problem.
        why: UnusableFolder,
    },
    /// Another supervisor runs this domain.
    #[error(
        "the domain `{name}` is already run by process {pid}: stop that process first, or choose another name with --domain"
    )]
    Claimed {
        /// Name of the domain.
        name: String,
        /// Process id of its owner; 0 if unknown.
        pid: u32,
    },
    /// The process could not join the domain.
    #[error("process `{process}` could not join the domain `{domain}`: {why}")]
    Join {
        /// Name of the process.
        process: String,
        /// Name of the domain.
        domain: String,
        /// The reason, as a clause.
        why: String,
    },
    /// The name of a channel is not valid.
    #[error(
        "`{name}` is not a channel name; accepted: lower-case words of a-z, 0-9, `_`, `-`, joined by `/`, at most 64 bytes"
    )]
    ChannelName {
        /// The given name.
        name: String,
    },
    /// The channel does not exist.
    #[error("there is no channel `{channel}` in the domain `{domain}`: no process has opened it")]
    NoChannel {
        /// Name of the channel.
        channel: String,
        /// Name of the domain.
        domain: String,
    },
    /// The channel carries another type.
    #[error("channel `{channel}` carries `{found}`, and this process uses `{wanted}`: {}", type_cure(channel, holders))]
    TypeMismatch {
        /// Name of the channel.
        channel: String,
        /// Type name of the channel.
        found: String,
        /// Type name of this process.
        wanted: String,
        /// Processes that have the channel open.
        holders: String,
    },
    /// The channel was created with incompatible settings.
    #[error(
        "channel `{channel}` was created with other settings than those of the channel table ({why}): stop {} first",
        holders_or_default(holders)
    )]
    QualityMismatch {
        /// Name of the channel.
        channel: String,
        /// The reason, as a clause.
        why: String,
        /// Processes that have the channel open.
        holders: String,
    },
    /// All places of a kind are taken.
    #[error(
        "channel `{channel}` already has its {limit} {what}{}: {}",
        holders_clause(holders), full_cure(*what)
    )]
    Full {
        /// Name of the channel.
        channel: String,
        /// Number of places.
        limit: usize,
        /// Kind of places.
        what: PlaceKind,
        /// Processes that have the channel open; empty if unknown.
        holders: String,
    },
    /// There is not enough free shared memory.
    #[error(
        "shared memory has {} left, and `{what}` needs {} including the reserved margin: free space in /dev/shm, or enlarge it (mount -o remount,size=..)",
        megabytes(*free), megabytes(*needed)
    )]
    NoMemory {
        /// Name of the channel or process.
        what: String,
        /// Needed memory including the margin, bytes.
        needed: u64,
        /// Free memory, bytes.
        free: u64,
    },
    /// A waiter has too many channels and descriptors.
    #[error("a process can wait for at most {limit} channels and descriptors")]
    TooManyToWaitFor {
        /// Largest number.
        limit: usize,
    },
    /// The schema text cannot be stored with the channel.
    #[error("the schema text of `{type_name}` cannot be stored with its channel: {why}")]
    Schema {
        /// Name of the type.
        type_name: String,
        /// The reason, as a clause.
        why: String,
    },
    /// The process has no server for requests.
    #[error("no process `{process}` answers requests in the domain `{domain}`: it is not running")]
    NoServer {
        /// Name of the process.
        process: String,
        /// Name of the domain.
        domain: String,
    },
    /// The process did not answer.
    #[error("`{process}` did not answer within {seconds:.1} s: it {why}")]
    NoAnswer {
        /// Name of the process.
        process: String,
        /// Timeout, s.
        seconds: f64,
        /// The reason, as a verb phrase.
        why: &'static str,
    },
    /// An operation failed for another reason.
    #[error("channel `{channel}` failed to {what}: {why}")]
    Failed {
        /// Name of the channel.
        channel: String,
        /// The operation, as an infinitive.
        what: &'static str,
        /// The reason, as a clause.
        why: String,
    },
}

/// Name of the calling process in a list of the processes that have a channel open.
pub const THIS_PROCESS: &str = "this process";

/// Kind of the places of a channel, of its event, or of its requests.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum PlaceKind {
    /// Publishers.
    #[error("publisher(s)")]
    Publishers,
    /// Subscribers.
    #[error("subscribers")]
    Subscribers,
    /// Subscribers with the whole buffer.
    #[error("subscribers with the whole buffer")]
    DeepSubscribers,
    /// Subscribers of the same party.
    #[error("subscribers of this kind")]
    SubscribersOfParty,
    /// Processes that have the channel open.
    #[error("processes")]
    Processes,
    /// Processes of the robot, for which its system file sets the number.
    #[error("processes of the robot")]
    RobotProcesses,
    /// Notifiers of the event.
    #[error("processes that notify it")]
    Wakers,
    /// Listeners of the event.
    #[error("processes that wait for it")]
    Waiters,
    /// Server of the requests.
    #[error("answering process")]
    Server,
    /// Clients of the requests.
    #[error("commands that wait for an answer")]
    Clients,
}

/// Reason why a name is not that of a domain.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum BadName {
    /// The name is empty or too long.
    #[error("give it 1 to {most} characters")]
    Length {
        /// Largest number of characters.
        most: usize,
    },
    /// The name has other characters.
    #[error("use only letters, digits and `-`")]
    Characters,
    /// The folder is a relative path.
    #[error("give the folder as an absolute path")]
    Relative,
    /// The path of the folder is too long for the names of its files.
    #[error("its folder is {excess} bytes too long")]
    LongFolder {
        /// Number of bytes in excess.
        excess: usize,
    },
    /// The path has a character that iceoryx2 does not accept.
    #[error("it has a character that a path cannot have")]
    NoPath,
}

/// Reason why the folder of a domain cannot be used.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum UnusableFolder {
    /// The folder is on a disk.
    #[error("it is not in memory; give a folder on tmpfs, such as one in /dev/shm or /run")]
    NotInMemory,
    /// The folder cannot be created; message of the operating system.
    #[error("it cannot be created ({0})")]
    NotMade(String),
    /// The path is not a folder.
    #[error("it is not a folder; remove it")]
    NotAFolder,
    /// The folder belongs to another user.
    #[error("it belongs to user {owner}, and this is user {user}; run everything as one user")]
    OtherUser {
        /// User id of its owner.
        owner: u32,
        /// User id of this process.
        user: u32,
    },
    /// The folder is used for something else.
    #[error("it contains files that nims did not create; give a folder that is empty or does not exist")]
    OtherFiles,
    /// Other users may enter the folder.
    #[error("other users may enter it (mode {mode:o}); make it private with `chmod 700`")]
    Open {
        /// Permissions of the folder.
        mode: u32,
    },
    /// The thread that removes the objects of dead processes could not be started; message of the operating system.
    #[error("no cleaner could be started ({0})")]
    NoCleaner(String),
    /// Removing the objects of dead processes takes too long.
    #[error("removing the objects of killed processes takes too long; end every process of the domain and start again")]
    CleanerHangs,
    /// Another error; message of the operating system.
    #[error("{0}")]
    System(String),
}

impl From<std::io::Error> for UnusableFolder {
    fn from(error: std::io::Error) -> Self {
        Self::System(error.to_string())
    }
}

fn megabytes(bytes: u64) -> String {
    format!("{:.1} MB", bytes as f64 * 1e-6)
}

/// Returns the processes that have the channel open, or a general term if they are unknown.
fn holders_or_default(holders: &str) -> &str {
    if holders.is_empty() { "the processes that have it open" } else { holders }
}

/// Returns a clause with the processes that have the channel open; empty if they are unknown.
fn holders_clause(holders: &str) -> String {
    if holders.is_empty() { String::new() } else { format!("; open in {holders}") }
}

/// Returns what to do about places that are all taken.
fn full_cure(what: PlaceKind) -> &'static str {
    match what {
        PlaceKind::RobotProcesses => {
            "end one of them and start this one again, or raise `processes` of [bus] in the system file and start the robot again"
        }
        _ => "stop one of them first",
    }
}

/// Returns what to do about two types on one channel: give a changed sensor a new name, and start all else from one
/// build.
fn type_cure(channel: &str, holders: &str) -> String {
    let holders = holders_or_default(holders);
    match channel.strip_prefix("sensor/") {
        Some(name) => format!(
            "a changed type needs a new name, because the old channel is still open (in {holders}): plug it in as e.g. `{name}-2`"
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

    /// A refusal of an event by iceoryx2 that lasts longer than this process waits; `None`: another process has not
    /// made it yet.
    pub(crate) fn unfinished(channel: &str, error: Option<String>) -> Self {
        let why = error.map_or_else(
            || "another process has begun to make it and does not finish".to_owned(),
            |error| format!("iceoryx2 says {error}"),
        );
        Self::Failed { channel: channel.to_owned(), what: "open its event", why }
    }

    /// Returns whether the caller's input is wrong (a program then exits with 2).
    #[must_use]
    pub fn is_bad_input(&self) -> bool {
        matches!(self, Self::DomainName { .. } | Self::ChannelName { .. } | Self::Claimed { .. })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_error_of_an_unfinished_event_says_why() {
        let said = |error: Option<&str>| BusError::unfinished("system/channels", error.map(str::to_owned)).to_string();
        assert!(said(Some("HangsInCreation")).ends_with("iceoryx2 says HangsInCreation"));
        assert!(!said(None).contains("None") && said(None).contains("another process"), "{}", said(None));
    }

    #[test]
    fn the_error_of_a_full_channel_names_its_holders_if_they_are_known() {
        let holders = "a (process 1)";
        assert_eq!(holders_clause(""), "", "no clause if the holders are unknown");
        assert!(holders_clause(holders).contains(holders));
        for holders in ["", holders] {
            let channel = "motor/state".to_owned();
            let full = BusError::Full { channel, limit: 2, what: PlaceKind::Subscribers, holders: holders.to_owned() };
            let sentence = full.to_string();
            assert!(
                ["motor/state", &format!("2 {}", PlaceKind::Subscribers), &holders_clause(holders)]
                    .iter()
                    .all(|part| sentence.contains(part)),
                "{sentence}"
            );
        }
    }
}
