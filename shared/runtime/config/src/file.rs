//! Small files that people and processes write: read with a bound, replaced whole.
//!
//! A path may name anything: a pipe that nobody writes, an endless device, a table of gigabytes. [`read_text`] neither waits for such a
//! thing nor takes it into memory; it refuses it at once, and says what it is.

use rustix::fs::OFlags;
use std::fs::{self, File, FileType, OpenOptions};
use std::io::{self, Read, Write};
use std::os::unix::fs::{FileTypeExt, OpenOptionsExt};
use std::path::{Path, PathBuf};

/// Most bytes that are read: a mission with as many legs and points as are accepted has about 12 MB.
pub const LARGEST_BYTES: u64 = 16 << 20;

/// Why a file was not read, as the clause after "cannot be read".
#[derive(Debug, thiserror::Error)]
pub enum ReadError {
    /// Nothing has that name.
    #[error("there is no such file")]
    Missing,
    /// A folder.
    #[error("it is a folder; name a file in it")]
    Folder,
    /// A pipe, a device, a socket: what only a stream has would have to be waited for, and may never end.
    #[error("it is a {0}; name a regular file")]
    NotRegular(&'static str),
    /// More than [`LARGEST_BYTES`].
    #[error("it has {} MB, and at most {} MB are read; is it the right file?", .0 >> 20, LARGEST_BYTES >> 20)]
    TooLarge(u64),
    /// Its bytes are no text.
    #[error("it is not UTF-8 text")]
    NotText,
    /// The operating system refused.
    #[error("{0}")]
    System(io::Error),
}

impl ReadError {
    fn of(error: io::Error) -> Self {
        match error.kind() {
            io::ErrorKind::NotFound => Self::Missing,
            io::ErrorKind::IsADirectory => Self::Folder,
            _ => Self::System(error),
        }
    }
}

/// Opens a regular file of any size to be read.
///
/// # Errors
/// See [`ReadError`]; a file of another kind is refused without waiting for it.
pub fn open(path: &Path) -> Result<File, ReadError> {
    // Looked at before it is opened, because opening a device may already do something to it ..
    regular(fs::metadata(path).map_err(ReadError::of)?.file_type())?;
    let flags = (OFlags::NONBLOCK | OFlags::NOCTTY).bits();
    let flags = i32::try_from(flags).map_err(|_| ReadError::System(io::ErrorKind::InvalidInput.into()))?;
    let file = OpenOptions::new().read(true).custom_flags(flags).open(path).map_err(ReadError::of)?;
    // .. and again afterwards, because another file may have taken its name meanwhile.
    regular(file.metadata().map_err(ReadError::of)?.file_type())?;
    Ok(file)
}

/// The bytes of a regular file of at most [`LARGEST_BYTES`].
///
/// # Errors
/// See [`ReadError`]; a file of another kind is refused without waiting for it.
pub fn read(path: &Path) -> Result<Vec<u8>, ReadError> {
    let file = open(path)?;
    let length = file.metadata().map_err(ReadError::of)?.len();
    if length > LARGEST_BYTES {
        return Err(ReadError::TooLarge(length));
    }
    let mut bytes = Vec::new();
    file.take(LARGEST_BYTES + 1).read_to_end(&mut bytes).map_err(ReadError::of)?;
    let length = bytes.len() as u64;
    if length > LARGEST_BYTES { Err(ReadError::TooLarge(length)) } else { Ok(bytes) }
}

/// The same as text.
///
/// # Errors
/// As [`read`].
pub fn read_text(path: &Path) -> Result<String, ReadError> {
    String::from_utf8(read(path)?).map_err(|_| ReadError::NotText)
}

/// The same; `None` if there is no such file.
///
/// # Errors
/// As [`read`], but for [`ReadError::Missing`].
pub fn read_text_if_there(path: &Path) -> Result<Option<String>, ReadError> {
    match read_text(path) {
        Ok(text) => Ok(Some(text)),
        Err(ReadError::Missing) => Ok(None),
        Err(error) => Err(error),
    }
}

fn regular(kind: FileType) -> Result<(), ReadError> {
    if kind.is_file() {
        return Ok(());
    }
    Err(match kind {
        kind if kind.is_dir() => ReadError::Folder,
        kind if kind.is_fifo() => ReadError::NotRegular("pipe"),
        kind if kind.is_socket() => ReadError::NotRegular("socket"),
        _ => ReadError::NotRegular("device"),
    })
}

/// Writes a file whole or not at all: beside its place, on the disk, and only then under its name. When it returns, a power cut changes
/// nothing any more; whenever the power goes before, what was there is still there.
///
/// # Errors
/// The operating system's; what was there is untouched then.
pub fn replace(path: &Path, text: &str) -> io::Result<()> {
    let mut beside = path.as_os_str().to_owned();
    beside.push(".new");
    let beside = PathBuf::from(beside);
    let write = || {
        // What is left of a writer that died is no obstacle, whatever it is.
        fs::remove_file(&beside).or_else(|error| match error.kind() {
            io::ErrorKind::NotFound => Ok(()),
            _ => Err(error),
        })?;
        let mut fresh = File::create_new(&beside)?;
        fresh.write_all(text.as_bytes())?;
        fresh.sync_all()?;
        fs::rename(&beside, path)
    };
    write().inspect_err(|_| {
        let _ = fs::remove_file(&beside);
    })?;
    // The name, too, has to survive a power cut.
    File::open(folder_of(path))?.sync_all()
}

/// The folder that a file is in.
#[must_use]
pub fn folder_of(path: &Path) -> &Path {
    match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    }
}

/// `inner` seen from `folder`, without `x/..`.
pub(crate) fn beside(folder: &Path, inner: &Path) -> PathBuf {
    use std::path::Component::{CurDir, Normal, ParentDir};
    let mut result = PathBuf::new();
    for part in folder.join(inner).components() {
        match part {
            CurDir => {}
            ParentDir if matches!(result.components().next_back(), Some(Normal(_))) => {
                result.pop();
            }
            other => result.push(other),
        }
    }
    result
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::net::UnixListener;

    #[test]
    fn a_file_is_read_as_it_is() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.toml");
        assert!(matches!(read_text(&path), Err(ReadError::Missing)));
        assert!(matches!(read_text_if_there(&path), Ok(None)));
        fs::write(&path, "a = 1\n").unwrap();
        assert_eq!(read_text(&path).unwrap(), "a = 1\n");
        assert_eq!(read_text_if_there(&path).unwrap().as_deref(), Some("a = 1\n"));
        fs::write(&path, [0xff, 0xfe]).unwrap();
        assert!(matches!(read_text(&path), Err(ReadError::NotText)));
        assert!(matches!(read_text(folder.path()), Err(ReadError::Folder)));
        // a file of the kernel says that it is empty
        assert!(!read("/proc/self/status".as_ref()).unwrap().is_empty());
    }

    /// None of these reads ends by itself, or only with the memory.
    #[test]
    fn what_has_no_end_is_refused_at_once() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        rustix::fs::mknodat(rustix::fs::CWD, path("pipe"), rustix::fs::FileType::Fifo, 0o600.into(), 0).unwrap();
        let _listener = UnixListener::bind(path("socket")).unwrap();
        let sparse = File::create(path("sparse")).unwrap();
        sparse.set_len(3 << 30).unwrap();
        assert!(matches!(read_text(&path("pipe")), Err(ReadError::NotRegular("pipe"))));
        assert!(matches!(read_text(&path("socket")), Err(ReadError::NotRegular("socket"))));
        assert!(matches!(read_text("/dev/zero".as_ref()), Err(ReadError::NotRegular("device"))));
        assert!(matches!(read_text(&path("sparse")), Err(ReadError::TooLarge(bytes)) if bytes == 3 << 30));
        sparse.set_len(LARGEST_BYTES).unwrap();
        assert_eq!(read(&path("sparse")).unwrap().len() as u64, LARGEST_BYTES);
        sparse.set_len(LARGEST_BYTES + 1).unwrap();
        assert!(matches!(read(&path("sparse")), Err(ReadError::TooLarge(_))));
    }

    #[test]
    fn a_file_is_replaced_whole_or_left_as_it_was() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.toml");
        for text in ["a = 1\n", "", "a = 2\n"] {
            replace(&path, text).unwrap();
            assert_eq!(fs::read_to_string(&path).unwrap(), text);
        }
        // a folder under that name cannot be replaced by a file
        let taken = folder.path().join("taken");
        fs::create_dir(&taken).unwrap();
        assert!(replace(&taken, "a = 3\n").is_err());
        assert!(replace(&folder.path().join("nowhere/a.toml"), "").is_err());
        let mut names: Vec<_> = fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().file_name()).collect();
        names.sort();
        assert_eq!(names, ["a.toml", "taken"], "nothing is left beside them");
    }
}
