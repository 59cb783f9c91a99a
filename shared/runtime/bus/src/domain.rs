//! The domain of one robot: its own names in shared memory.

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
use crate::error::{BadName, BusError, Unfit};

/// Where POSIX shared memory lies on Linux.
pub(crate) const SHARED_MEMORY: &str = "/dev/shm";
/// A listener's socket must fit `sun_path` (108 bytes) behind root path and prefix; measured: 66 bytes for both are safe.
const ROOT_AND_PREFIX_BYTES: usize = 66;
/// Leaves room for `/dev/shm/nims-<uid>-` with a uid of ten digits, and for the prefix of 13 bytes.
const NAME_BYTES: usize = 20;
/// How long a peer waits inside iceoryx2 for something half made. Short, because a broken peer would stall a control loop for this long;
/// opening a channel at start-up waits longer by trying again.
const CREATION_TIMEOUT: Duration = Duration::from_millis(200);
const CLAIM_FILE: &str = "owner";
/// The socket of motor-io for emergency stops.
pub(crate) const ESTOP_SOCKET: &str = "estop";
/// Says that a folder that a person chose is a domain's: nothing is ever removed from one without it.
const MARKER_FILE: &str = ".nims-domain";
/// What the supervisor keeps here, a trailing `.new` is one that is being written; and the socket of motor-io.
const OWN_FILES: [&str; 7] = [
    "children.json",
    "children.json.new",
    "running.json",
    "running.json.new",
    CLOCK_FILE,
    "clock.txt.new",
    ESTOP_SOCKET,
];
/// How the name of a file ends that a virtual motor box keeps beside each of its ports (`LeftOut` of the crate `serial`): one that was killed
/// leaves it.
const PORT_CLOCKS: &str = ".time";
/// Both clocks at one instant of the run: UNIX time and CLOCK_MONOTONIC, ns.
const CLOCK_FILE: &str = "clock.txt";
/// What iceoryx2 keeps here, besides the files that begin with the domain's prefix.
const OWN_FOLDERS: [&str; 2] = ["nodes", "services"];
/// Where the links to a virtual motor box's ports lead.
const PSEUDO_TERMINALS: &str = "/dev/pts/";
/// `f_type` of tmpfs and ramfs, statfs(2).
pub(crate) const MEMORY_FILE_SYSTEMS: [u32; 2] = [0x0102_1994, 0x8584_58f6];
/// Another process may remove or renew the file that is claimed in the same instant; more often than this it does not.
const CLAIM_ATTEMPTS: usize = 10;

/// One robot's part of shared memory: a folder on tmpfs, and a prefix of its own.
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
    /// The process's name; empty if it cannot be read.
    pub name: String,
    /// Its process id; 0 if it cannot be read.
    pub pid: u32,
}

impl Domain {
    /// The domain of that name and this user, in a folder of its own under /dev/shm; makes the folder.
    ///
    /// # Errors
    /// [`BusError::DomainName`] unless it is 1 to 20 letters, digits or `-`; [`BusError::DomainFolder`] if the folder is another user's.
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

    /// The domain whose folder is `root`, an absolute path on tmpfs, e.g. a service manager's runtime folder: one that does not exist, is
    /// empty, or was a domain before. Anything else is left alone.
    ///
    /// # Errors
    /// [`BusError::DomainName`] if the path is too long, [`BusError::DomainFolder`] if the folder is another user's, open to others, on a
    /// disk, used for something else, or cannot be made.
    pub fn from_root(root: &Path) -> Result<Self, BusError> {
        let name = root.to_string_lossy().into_owned();
        if !root.is_absolute() {
            return Err(BusError::DomainName { name, why: BadName::Relative });
        }
        Self::make(name, root.to_owned())
    }

    /// [`Domain::from_root`] if the text begins with `/`, otherwise [`Domain::new`]: the inverse of [`Domain::name`].
    ///
    /// # Errors
    /// As those.
    pub fn parse(text: &str) -> Result<Self, BusError> {
        if text.starts_with('/') { Self::from_root(Path::new(text)) } else { Self::new(text) }
    }

    /// [`Domain::parse`], but nothing is made: `None` if there is no such folder.
    ///
    /// # Errors
    /// As [`Domain::parse`].
    pub fn existing(text: &str) -> Result<Option<Self>, BusError> {
        let there =
            if text.starts_with('/') { Path::new(text).join(MARKER_FILE).is_file() } else { folder_of(text).is_dir() };
        // a bad name is reported as such, not as one that does not exist
        if there || !text.starts_with('/') && !usable(text) { Self::parse(text).map(Some) } else { Ok(None) }
    }

    /// This user's named domains that have a folder, by name; whether anything lives there [`Domain::alive`] says.
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

    /// A domain that no other test has, removed with everything in it when the guard is dropped.
    ///
    /// # Panics
    /// If /dev/shm cannot be written.
    #[must_use]
    pub fn for_test() -> TestDomain {
        static COUNT: AtomicU32 = AtomicU32::new(0);
        let name = format!("t{}-{}", std::process::id(), COUNT.fetch_add(1, Ordering::Relaxed));
        #[allow(clippy::panic)]
        let domain = Self::new(&name).unwrap_or_else(|error| panic!("{error}"));
        domain.wipe(); // an earlier process may have had this id
        let _ = domain.make_folder();
        TestDomain(domain)
    }

    fn make(name: String, root: PathBuf) -> Result<Self, BusError> {
        // One prefix per folder. The hash has a fixed length, so no domain's prefix begins another's.
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
        // Dead processes are removed when a process joins and when a place is missing, never inside the life of a running one.
        config.global.node.cleanup_dead_nodes_on_creation = true;
        config.global.node.cleanup_dead_nodes_on_destruction = false;
        config.global.service.cleanup_dead_nodes_on_open = false;
        let domain = Self { name, root, prefix, config };
        domain.make_folder()?;
        Ok(domain)
    }

    /// Makes the folder, mode 0700, or checks that the one that is there is this user's alone and a domain's. Its mode is never changed: it
    /// may be a folder that someone else made for something else.
    fn make_folder(&self) -> Result<(), BusError> {
        let unusable = |why: Unfit| BusError::DomainFolder { path: self.root.clone(), why };
        if self.is_chosen() {
            let existing = if self.root.exists() { Some(self.root.as_path()) } else { self.root.parent() };
            let found = existing.and_then(|path| statfs(path).ok());
            if found.is_some_and(|found| !MEMORY_FILE_SYSTEMS.contains(&(found.f_type as u32))) {
                return Err(unusable(Unfit::NotInMemory));
            }
        }
        match fs::DirBuilder::new().mode(0o700).create(&self.root) {
            Ok(()) => return self.mark(),
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {}
            Err(error) => return Err(unusable(Unfit::NotMade(error.to_string()))),
        }
        let found = fs::symlink_metadata(&self.root).map_err(|error| unusable(error.into()))?;
        if !found.is_dir() {
            return Err(unusable(Unfit::NotAFolder));
        }
        let user = geteuid().as_raw();
        if found.uid() != user {
            return Err(unusable(Unfit::OtherUser { owner: found.uid(), user }));
        }
        if self.is_chosen() && !self.is_marked() {
            let empty = fs::read_dir(&self.root).map_err(|error| unusable(error.into()))?.flatten().next().is_none();
            // another process may have marked it between the two looks
            if !empty && !self.is_marked() {
                return Err(unusable(Unfit::OtherFiles));
            }
        }
        if found.mode() & 0o077 != 0 {
            return Err(unusable(Unfit::Open { mode: found.mode() & 0o777 }));
        }
        self.mark()
    }

    /// Whether a person gave the folder; otherwise its name says whose it is.
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

    /// The text that [`Domain::parse`] turns into this domain again.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Its folder.
    #[must_use]
    pub fn root(&self) -> &Path {
        &self.root
    }

    /// What its names under /dev/shm begin with; a program in another language needs it together with [`Domain::root`].
    #[must_use]
    pub fn prefix(&self) -> &str {
        &self.prefix
    }

    /// The clock of the run, for every process that turns stamps into calendar time; `None` where nobody has set it. It goes with the memory
    /// that it stands in, as does the meaning of CLOCK_MONOTONIC.
    #[must_use]
    pub fn wall_clock(&self) -> Option<WallClock> {
        let text = fs::read_to_string(self.root.join(CLOCK_FILE)).ok()?;
        let (unix, mono) = text.trim().split_once(' ')?;
        Some(WallClock { unix_ns: unix.parse().ok()?, mono_ns: mono.parse().ok()? })
    }

    /// Sets it, at the beginning of a run, or takes it back at its end.
    ///
    /// # Errors
    /// [`BusError::DomainFolder`] if the folder cannot be written.
    pub fn set_wall_clock(&self, clock: Option<WallClock>) -> Result<(), BusError> {
        let (path, fresh) = (self.root.join(CLOCK_FILE), self.root.join(format!("{CLOCK_FILE}.new")));
        let done = match clock {
            Some(WallClock { unix_ns, mono_ns }) => {
                fs::write(&fresh, format!("{unix_ns} {mono_ns}\n")).and_then(|()| fs::rename(&fresh, &path))
            }
            None => fs::remove_file(&path),
        };
        match done {
            Err(error) if clock.is_some() || error.kind() != io::ErrorKind::NotFound => {
                Err(BusError::DomainFolder { path, why: error.into() })
            }
            _ => Ok(()),
        }
    }

    pub(crate) fn config(&self) -> &Config {
        &self.config
    }

    /// The processes that live in it.
    #[must_use]
    pub fn alive(&self) -> Vec<NodeInfo> {
        self.nodes().0
    }

    /// How many processes have died in it without being removed.
    #[must_use]
    pub fn dead(&self) -> usize {
        self.nodes().1
    }

    /// The living, and how many have died without being removed.
    pub(crate) fn nodes(&self) -> (Vec<NodeInfo>, usize) {
        let (mut alive, mut dead) = (Vec::new(), 0);
        // a failure to list is an empty list: there is no folder yet
        let _ = Node::<ipc::Service>::list(&self.config, |state| {
            match state {
                NodeState::Alive(node) => alive.push(info_of(&node)),
                NodeState::Dead(_) => dead += 1,
                NodeState::Inaccessible(_) | NodeState::Undefined(_) => {}
            }
            CallbackProgression::Continue
        });
        (alive, dead)
    }

    /// Becomes the one who runs this domain, until the claim is dropped or the process ends, however it ends.
    ///
    /// # Errors
    /// [`BusError::Claimed`] if another process does.
    pub fn claim(&self) -> Result<Claim, BusError> {
        let unusable = |error: io::Error| BusError::DomainFolder { path: self.root.clone(), why: error.into() };
        let path = self.root.join(CLAIM_FILE);
        for _ in 0..CLAIM_ATTEMPTS {
            self.make_folder()?; // whoever ran the domain before may just be removing it
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
                continue; // locked, but no longer the file of that name
            }
            file.set_len(0).map_err(unusable)?;
            file.rewind().map_err(unusable)?;
            write!(file, "{}", std::process::id()).map_err(unusable)?;
            return Ok(Claim { _file: file });
        }
        Err(BusError::Claimed { name: self.name.clone(), pid: 0 })
    }

    /// Gives the domain up in good order: if no process lives in it, its names in shared memory go, and its folder, unless a person chose
    /// that. Returns whether nobody was left.
    pub fn retire(&self, claim: Claim) -> bool {
        if !self.alive().is_empty() {
            return false;
        }
        self.wipe();
        let _ = fs::remove_file(self.root.join(CLAIM_FILE));
        if !self.is_chosen() {
            // fails if something is in it that is not ours; then it stays
            let _ = fs::remove_dir(&self.root);
        }
        drop(claim); // last: until here nobody else can begin
        true
    }

    /// Removes every name of this domain, except the claim of whoever runs it and what it did not make. Only where no process lives in it.
    pub(crate) fn wipe(&self) -> usize {
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
                    || OWN_FILES.contains(&name.as_ref())
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

/// The characters that the name of a domain may have.
fn usable(name: &str) -> bool {
    name.bytes().all(|byte| byte.is_ascii_alphanumeric() || byte == b'-')
}

/// Where this user's domain of that name has its folder.
fn folder_of(name: &str) -> PathBuf {
    Path::new(SHARED_MEMORY).join(format!("nims-{}-{name}", geteuid().as_raw()))
}

pub(crate) fn info_of(node: &impl NodeView) -> NodeInfo {
    node.details().as_ref().map_or(NodeInfo { name: String::new(), pid: 0 }, |details| NodeInfo {
        name: details.name().to_string(),
        pid: details.process_id().value().unsigned_abs(),
    })
}

/// Whoever holds this runs the domain; see [`Domain::claim`].
#[derive(Debug)]
pub struct Claim {
    _file: fs::File,
}

/// A [`Domain`] that is removed with everything in it when this is dropped.
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
        self.0.wipe(); // first what lies outside its folder
        let _ = fs::remove_dir_all(&self.0.root);
    }
}
