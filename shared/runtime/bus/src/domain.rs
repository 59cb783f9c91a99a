//! The domain of one robot: its part of the names in shared memory.

use std::fs;
use std::io::{self, Read, Seek, Write};
use std::os::unix::fs::{DirBuilderExt, MetadataExt, OpenOptionsExt};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Duration;

use iceoryx2::node::NodeView;
use iceoryx2::prelude::{CallbackProgression, Config, FileName, Node, NodeState, SemanticString, ipc};
use rustix::fs::{FlockOperation, flock, statfs};
use rustix::process::geteuid;

use crate::clock::WallClock;
use crate::error::{BadName, BusError, UnusableFolder};

/// Folder of POSIX shared memory on Linux.
pub(crate) const SHARED_MEMORY: &str = "/dev/shm";
/// Largest length of root path plus prefix, bytes: the path of a listener's socket, which starts with both, must fit
/// `sun_path` (108 bytes). Measured.
const ROOT_AND_PREFIX_BYTES: usize = 66;
/// Longest name of a domain, bytes: leaves room for `/dev/shm/nims-<uid>-` with a uid of ten digits, and for the prefix
/// of 13 bytes.
const NAME_BYTES: usize = 20;
/// How long iceoryx2 waits for an incomplete object. Short, because a broken peer stalls a control loop for this time;
/// opening a channel at start-up retries for longer.
const CREATION_TIMEOUT: Duration = Duration::from_millis(200);
/// Publishers of a channel that may end between two calls of a subscriber without a loss. Each subscriber reserves 4 kB
/// of private memory for each, so that iceoryx2's own 128 take 0.5 MB per channel of the recorder.
const ENDED_PUBLISHERS: usize = 32;
/// Lock file of the domain's owner, with its process id.
pub(crate) const CLAIM_FILE: &str = "owner";
/// The socket of motor-io for emergency stops.
pub(crate) const ESTOP_SOCKET: &str = "estop";
/// The socket of motor-io for dead-man stops.
pub(crate) const DEADMAN_SOCKET: &str = "deadman";
/// Marks a folder given by the user as that of a domain; nothing is removed from a folder without it.
const MARKER_FILE: &str = ".nims-domain";
/// File with the path of the socket of the robot's gateway.
const GATEWAY_FILE: &str = "gateway.txt";
/// File with the number of processes for which the robot has places.
pub(crate) const PROCESSES_FILE: &str = "processes.txt";
/// Files of the supervisor and of the gateway (a trailing `.new` marks one that is being written), and the sockets of
/// motor-io.
const OWN_FILES: [&str; 12] = [
    "children.json",
    "children.json.new",
    "running.json",
    "running.json.new",
    CLOCK_FILE,
    "clock.txt.new",
    GATEWAY_FILE,
    "gateway.txt.new",
    PROCESSES_FILE,
    "processes.txt.new",
    ESTOP_SOCKET,
    DEADMAN_SOCKET,
];
/// Ending of the file that a virtual motor box stores for each of its ports (`LeftOut` of the crate `serial`). It
/// remains if the virtual motor box is killed.
const PORT_CLOCKS: &str = ".time";
/// File with one instant of the run on both clocks: UNIX time and CLOCK_MONOTONIC, ns.
const CLOCK_FILE: &str = "clock.txt";
/// Folders of iceoryx2; its files start with the domain's prefix.
const OWN_FOLDERS: [&str; 2] = ["nodes", "services"];
/// Folder of the pseudo-terminals of a virtual motor box, to which its ports are links.
const PSEUDO_TERMINALS: &str = "/dev/pts/";
/// `f_type` of tmpfs and ramfs, statfs(2).
pub(crate) const MEMORY_FILE_SYSTEMS: [u32; 2] = [0x0102_1994, 0x8584_58f6];
/// Largest number of attempts to lock the claim file while other processes remove or replace it.
const CLAIM_ATTEMPTS: usize = 10;

/// One robot's part of shared memory: a folder on tmpfs, and a prefix of the names in /dev/shm.
#[derive(Debug, Clone)]
pub struct Domain {
    name: String,
    root: PathBuf,
    prefix: String,
    config: Config,
}

/// A process in a domain.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct NodeInfo {
    /// Process name; empty if it cannot be read.
    pub name: String,
    /// Process id; 0 if it cannot be read.
    pub pid: u32,
}

/// Processes that were found in a domain.
#[derive(Debug)]
pub(crate) struct Nodes {
    pub(crate) alive: Vec<NodeInfo>,
    /// Number of dead processes that are not removed yet.
    pub(crate) dead: usize,
    /// False if the state of a process could not be determined, e.g. because this one has too many open files.
    pub(crate) complete: bool,
}

impl Default for Nodes {
    fn default() -> Self {
        Self { alive: Vec::new(), dead: 0, complete: true }
    }
}

impl Nodes {
    /// Whether a process of the domain may be alive, so that its objects must stay.
    pub(crate) fn may_live(&self) -> bool {
        !self.alive.is_empty() || !self.complete
    }
}

impl Domain {
    /// Returns this user's domain of that name, and creates its folder under /dev/shm.
    ///
    /// # Errors
    /// [`BusError::DomainName`] unless it is 1 to 20 letters, digits or `-`; [`BusError::DomainFolder`] if the folder
    /// belongs to another user.
    pub fn new(name: &str) -> Result<Self, BusError> {
        let bad = |why| BusError::DomainName { name: name.to_owned(), why };
        if name.is_empty() || name.len() > NAME_BYTES {
            return Err(bad(BadName::Length { most: NAME_BYTES }));
        }
        if !usable(name) {
            return Err(bad(BadName::Characters));
        }
        Self::make(name.to_owned(), Path::new(SHARED_MEMORY).join(format!("nims-{}-{name}", geteuid().as_raw())))
    }

    /// Returns the domain with the folder `root`, an absolute path on tmpfs, e.g. a service manager's runtime folder.
    /// The folder must not exist, be empty, or be a former domain; others are not modified.
    ///
    /// # Errors
    /// [`BusError::DomainName`] if the path is too long, [`BusError::DomainFolder`] if the folder belongs to another
    /// user, is open to others, is on a disk, contains other files, or cannot be created.
    pub fn from_root(root: &Path) -> Result<Self, BusError> {
        let name = root.to_string_lossy().into_owned();
        if !root.is_absolute() {
            return Err(BusError::DomainName { name, why: BadName::Relative });
        }
        Self::make(name, root.to_owned())
    }

    /// Calls [`Domain::from_root`] if the text starts with `/`, otherwise [`Domain::new`]: the inverse of
    /// [`Domain::name`].
    ///
    /// # Errors
    /// As these functions.
    pub fn parse(text: &str) -> Result<Self, BusError> {
        if text.starts_with('/') { Self::from_root(Path::new(text)) } else { Self::new(text) }
    }

    /// As [`Domain::parse`], but creates no folder: returns `None` if there is none.
    ///
    /// # Errors
    /// As [`Domain::parse`].
    pub fn existing(text: &str) -> Result<Option<Self>, BusError> {
        let there =
            if text.starts_with('/') { Path::new(text).join(MARKER_FILE).is_file() } else { folder_of(text).is_dir() };
        // Report an invalid name as an error, not as a domain that does not exist.
        if there || !text.starts_with('/') && !usable(text) { Self::parse(text).map(Some) } else { Ok(None) }
    }

    /// Returns this user's named domains with a folder, by name. [`Domain::alive`] returns whether processes run there.
    #[must_use]
    pub fn all() -> Vec<Self> {
        let beginning = format!("nims-{}-", geteuid().as_raw());
        let mut names: Vec<String> = fs::read_dir(SHARED_MEMORY)
            .into_iter()
            .flatten()
            .flatten()
            .filter(|entry| entry.path().is_dir())
            .filter_map(|entry| entry.file_name().to_str()?.strip_prefix(&beginning).map(str::to_owned))
            .collect();
        names.sort();
        names.iter().filter_map(|name| Self::new(name).ok()).collect()
    }

    /// Returns a new domain for a test, which is removed with all its objects when the guard is dropped.
    ///
    /// # Panics
    /// If /dev/shm cannot be written.
    #[must_use]
    pub fn for_test() -> TestDomain {
        static COUNT: AtomicU32 = AtomicU32::new(0);
        let name = format!("t{}-{}", std::process::id(), COUNT.fetch_add(1, Ordering::Relaxed));
        #[allow(clippy::panic)]
        let domain = Self::new(&name).unwrap_or_else(|error| panic!("{error}"));
        domain.wipe(); // a former process may have had this process id
        let _ = domain.make_folder();
        TestDomain(domain)
    }

    fn make(name: String, root: PathBuf) -> Result<Self, BusError> {
        // One prefix per folder. The hash has a fixed length, so no prefix is the start of another.
        let prefix = format!("nims{:08x}_", messages::hash_of(&root.to_string_lossy()));
        let bytes = root.as_os_str().len() + prefix.len();
        if bytes > ROOT_AND_PREFIX_BYTES {
            let why = BadName::LongFolder { excess: bytes - ROOT_AND_PREFIX_BYTES };
            return Err(BusError::DomainName { name, why });
        }
        let unusable = |_| BusError::DomainName { name: name.clone(), why: BadName::NoPath };
        let mut config = Config::default();
        config.global.prefix = FileName::new(prefix.as_bytes()).map_err(unusable)?;
        config
            .global
            .set_root_path(&iceoryx2::prelude::Path::new(root.as_os_str().as_encoded_bytes()).map_err(unusable)?);
        config.global.creation_timeout = CREATION_TIMEOUT;
        config.defaults.publish_subscribe.subscriber_expired_connection_buffer = ENDED_PUBLISHERS;
        // Dead processes are removed by the owner of the domain, without one when a process joins, and always when no
        // place is free; never in other operations.
        config.global.node.cleanup_dead_nodes_on_creation = true;
        config.global.node.cleanup_dead_nodes_on_destruction = false;
        config.global.service.cleanup_dead_nodes_on_open = false;
        let domain = Self { name, root, prefix, config };
        domain.make_folder()?;
        Ok(domain)
    }

    /// Creates the folder with mode 0700, or checks that an existing one is a domain of this user and closed to others.
    /// The mode of an existing folder is not changed, because the folder may have another purpose.
    fn make_folder(&self) -> Result<(), BusError> {
        let unusable = |why: UnusableFolder| BusError::DomainFolder { path: self.root.clone(), why };
        if self.is_chosen() {
            let existing = if self.root.exists() { Some(self.root.as_path()) } else { self.root.parent() };
            let found = existing.and_then(|path| statfs(path).ok());
            if found.is_some_and(|found| !MEMORY_FILE_SYSTEMS.contains(&(found.f_type as u32))) {
                return Err(unusable(UnusableFolder::NotInMemory));
            }
        }
        match fs::DirBuilder::new().mode(0o700).create(&self.root) {
            Ok(()) => return self.mark(),
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {}
            Err(error) => return Err(unusable(UnusableFolder::NotMade(error.to_string()))),
        }
        let found = fs::symlink_metadata(&self.root).map_err(|error| unusable(error.into()))?;
        if !found.is_dir() {
            return Err(unusable(UnusableFolder::NotAFolder));
        }
        let user = geteuid().as_raw();
        if found.uid() != user {
            return Err(unusable(UnusableFolder::OtherUser { owner: found.uid(), user }));
        }
        if self.is_chosen() && !self.is_marked() {
            let empty = fs::read_dir(&self.root).map_err(|error| unusable(error.into()))?.flatten().next().is_none();
            // Check the mark again: another process may have set it between the two checks.
            if !empty && !self.is_marked() {
                return Err(unusable(UnusableFolder::OtherFiles));
            }
        }
        if found.mode() & 0o077 != 0 {
            return Err(unusable(UnusableFolder::Open { mode: found.mode() & 0o777 }));
        }
        self.mark()
    }

    /// Returns whether the user gave the path of the folder; otherwise the name of the folder contains its user.
    fn is_chosen(&self) -> bool {
        self.name.starts_with('/')
    }

    fn is_marked(&self) -> bool {
        fs::symlink_metadata(self.root.join(MARKER_FILE)).is_ok_and(|found| found.is_file())
    }

    fn mark(&self) -> Result<(), BusError> {
        if !self.is_chosen() || self.is_marked() {
            return Ok(());
        }
        fs::write(self.root.join(MARKER_FILE), "a robot's shared memory; see `nims --help`\n")
            .map_err(|error| BusError::DomainFolder { path: self.root.clone(), why: error.into() })
    }

    /// Returns the name, which [`Domain::parse`] accepts.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Returns the folder.
    #[must_use]
    pub fn root(&self) -> &Path {
        &self.root
    }

    /// Returns the prefix of its names under /dev/shm; a program in another language needs it and [`Domain::root`].
    #[must_use]
    pub fn prefix(&self) -> &str {
        &self.prefix
    }

    /// Returns the clock of the run, for processes that convert stamps to calendar time; `None` if it is not set. It is
    /// stored in memory, so that it is lost at a reboot, when CLOCK_MONOTONIC restarts.
    #[must_use]
    pub fn wall_clock(&self) -> Option<WallClock> {
        let text = fs::read_to_string(self.root.join(CLOCK_FILE)).ok()?;
        let (unix, mono) = text.trim().split_once(' ')?;
        Some(WallClock { unix_ns: unix.parse().ok()?, mono_ns: mono.parse().ok()? })
    }

    /// Sets the clock at the start of a run, or removes it at its end.
    ///
    /// # Errors
    /// [`BusError::DomainFolder`] if the folder cannot be written.
    pub fn set_wall_clock(&self, clock: Option<WallClock>) -> Result<(), BusError> {
        if let Some(WallClock { unix_ns, mono_ns }) = clock {
            return self.put(CLOCK_FILE, &format!("{unix_ns} {mono_ns}"));
        }
        let path = self.root.join(CLOCK_FILE);
        match fs::remove_file(&path) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => {
                Err(BusError::DomainFolder { path, why: error.into() })
            }
            _ => Ok(()),
        }
    }

    /// Writes one of [`OWN_FILES`] atomically: a reader gets the old line or the new one.
    pub(crate) fn put(&self, file: &str, line: &str) -> Result<(), BusError> {
        let (path, fresh) = (self.root.join(file), self.root.join(format!("{file}.new")));
        let written = fs::write(&fresh, format!("{line}\n")).and_then(|()| fs::rename(&fresh, &path));
        written.map_err(|error| BusError::DomainFolder { path, why: error.into() })
    }

    /// Tells the robot's processes the socket of its gateway, through which sensors without shared memory publish. With
    /// several gateways it is that of the last one.
    ///
    /// # Errors
    /// [`BusError::DomainFolder`] if the folder cannot be written.
    pub fn set_gateway(&self, socket: &Path) -> Result<(), BusError> {
        self.put(GATEWAY_FILE, &socket.display().to_string())
    }

    /// Returns the socket of the robot's gateway, if one has joined the robot and its socket still exists.
    #[must_use]
    pub fn gateway(&self) -> Option<PathBuf> {
        let text = fs::read_to_string(self.root.join(GATEWAY_FILE)).ok()?;
        Some(PathBuf::from(text.trim_end())).filter(|socket| socket.exists())
    }

    pub(crate) fn config(&self) -> &Config {
        &self.config
    }

    /// Returns the running processes of the domain.
    #[must_use]
    pub fn alive(&self) -> Vec<NodeInfo> {
        self.nodes().alive
    }

    /// Returns the number of dead processes that are not removed yet.
    #[must_use]
    pub fn dead(&self) -> usize {
        self.nodes().dead
    }

    /// Returns the processes of the domain.
    pub(crate) fn nodes(&self) -> Nodes {
        let mut nodes = Nodes::default();
        let listed = Node::<ipc::Service>::list(&self.config, |state| {
            match state {
                NodeState::Alive(node) => nodes.alive.push(info_of(&node)),
                NodeState::Dead(_) => nodes.dead += 1,
                NodeState::Inaccessible(_) | NodeState::Undefined(_) => nodes.complete = false,
            }
            CallbackProgression::Continue
        });
        // Listing also fails if there is no folder yet.
        nodes.complete &= listed.is_ok() || matches!(self.root.join("nodes").try_exists(), Ok(false));
        nodes
    }

    /// Makes this process the owner of the domain, until the claim is dropped or the process ends in any way. The owner
    /// removes what killed processes leave ([`Domain::sweep`]); while it lives, joining processes do not look for it.
    ///
    /// # Errors
    /// [`BusError::Claimed`] if another process is the owner.
    pub fn claim(&self) -> Result<Claim, BusError> {
        let unusable = |error: io::Error| BusError::DomainFolder { path: self.root.clone(), why: error.into() };
        let path = self.root.join(CLAIM_FILE);
        for _ in 0..CLAIM_ATTEMPTS {
            self.make_folder()?; // the former owner may be removing it
            let opened =
                fs::OpenOptions::new().read(true).write(true).create(true).truncate(false).mode(0o600).open(&path);
            let mut file = match opened {
                Ok(file) => file,
                Err(error) if error.kind() == io::ErrorKind::NotFound => continue,
                Err(error) => return Err(unusable(error)),
            };
            if flock(&file, FlockOperation::NonBlockingLockExclusive).is_err() {
                let mut text = String::new();
                let _ = file.read_to_string(&mut text);
                return Err(BusError::Claimed { name: self.name.clone(), pid: text.trim().parse().unwrap_or(0) });
            }
            let locked = file.metadata().map_err(unusable)?;
            if !fs::symlink_metadata(&path).is_ok_and(|there| there.ino() == locked.ino()) {
                continue; // the locked file has been removed or replaced
            }
            file.set_len(0).map_err(unusable)?;
            file.rewind().map_err(unusable)?;
            write!(file, "{}", std::process::id()).map_err(unusable)?;
            return Ok(Claim { _file: file });
        }
        Err(BusError::Claimed { name: self.name.clone(), pid: 0 })
    }

    /// Gives up the domain: if no process runs in it, removes its objects in shared memory, and its folder unless the
    /// user gave its path. Returns whether no process was left.
    pub fn release(&self, claim: Claim) -> bool {
        if self.nodes().may_live() {
            return false;
        }
        self.wipe();
        let _ = fs::remove_file(self.root.join(CLAIM_FILE));
        if !self.is_chosen() {
            // Fails if it contains other files; then it remains.
            let _ = fs::remove_dir(&self.root);
        }
        drop(claim); // last, so that no other process becomes the owner before
        true
    }

    /// Removes all objects of this domain, except the claim of its owner and files of other programs. Only for a domain
    /// without running processes.
    pub(crate) fn wipe(&self) -> usize {
        self.wipe_except(&[])
    }

    /// As [`Domain::wipe`], except the own files of these names.
    pub(crate) fn wipe_except(&self, kept: &[&str]) -> usize {
        let mut removed = 0;
        for entry in fs::read_dir(&self.root).into_iter().flatten().flatten() {
            let (path, name, kind) = (entry.path(), entry.file_name(), entry.file_type());
            let name = name.to_string_lossy();
            let Ok(kind) = kind else { continue };
            let gone = if kind.is_dir() {
                OWN_FOLDERS.contains(&name.as_ref()) && fs::remove_dir_all(&path).is_ok()
            } else if kind.is_symlink() {
                fs::read_link(&path).is_ok_and(|to| to.starts_with(PSEUDO_TERMINALS)) && fs::remove_file(&path).is_ok()
            } else {
                let own = name.starts_with(&self.prefix)
                    || OWN_FILES.contains(&name.as_ref()) && !kept.contains(&name.as_ref())
                    || kind.is_file() && name.ends_with(PORT_CLOCKS);
                own && fs::remove_file(&path).is_ok()
            };
            removed += usize::from(gone);
        }
        for entry in fs::read_dir(SHARED_MEMORY).into_iter().flatten().flatten() {
            let ours = entry.file_name().as_encoded_bytes().starts_with(self.prefix.as_bytes());
            if ours && entry.file_type().is_ok_and(|kind| kind.is_file()) {
                removed += usize::from(fs::remove_file(entry.path()).is_ok());
            }
        }
        removed
    }
}

/// Returns whether the name of a domain has only accepted characters.
fn usable(name: &str) -> bool {
    name.bytes().all(|byte| byte.is_ascii_alphanumeric() || byte == b'-')
}

/// Returns the folder of this user's domain of that name.
fn folder_of(name: &str) -> PathBuf {
    Path::new(SHARED_MEMORY).join(format!("nims-{}-{name}", geteuid().as_raw()))
}

pub(crate) fn info_of(node: &impl NodeView) -> NodeInfo {
    node.details().as_ref().map_or(NodeInfo { name: String::new(), pid: 0 }, |details| NodeInfo {
        name: details.name().to_string(),
        pid: details.process_id().value().unsigned_abs(),
    })
}

/// Ownership of a domain; see [`Domain::claim`].
#[derive(Debug)]
pub struct Claim {
    _file: fs::File,
}

/// A [`Domain`] that is removed with all its objects when this value is dropped.
#[derive(Debug)]
pub struct TestDomain(Domain);

impl std::ops::Deref for TestDomain {
    type Target = Domain;
    fn deref(&self) -> &Domain {
        &self.0
    }
}

impl Drop for TestDomain {
    fn drop(&mut self) {
        self.0.wipe(); // removes the objects outside its folder too
        let _ = fs::remove_dir_all(&self.0.root);
    }
}
