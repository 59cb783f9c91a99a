//! Small files: bounded reads and atomic replacement.
//!
//! A path may name anything: a pipe without a writer, an endless device, a file of gigabytes. [`read_text`] rejects
//! such files at once, without waiting and without reading them into memory.

use rustix::fs::OFlags;
use sha2::{Digest, Sha256};
use std::fs::{self, File, FileType, OpenOptions};
use std::io::{self, Read, Write};
use std::os::unix::fs::{FileTypeExt, OpenOptionsExt};
use std::path::{Path, PathBuf};

/// Largest file that is read, bytes: a mission with the largest accepted number of legs and points has about 12 MB.
pub const LARGEST_BYTES: u64 = 16 << 20;

/// SHA-256 of a text, in hexadecimal digits.
#[must_use]
pub fn text_hash(text: &str) -> String {
    messages::hex(&<[u8; 32]>::from(Sha256::digest(text.as_bytes())))
}

/// Why a file was not read, as the clause after "cannot be read".
#[derive(Debug, thiserror::Error)]
pub enum ReadError {
    /// There is no such file.
    #[error("there is no such file")]
    Missing,
    /// The path is a folder.
    #[error("it is a folder; give a file in it")]
    Folder,
    /// The path is a pipe, a device or a socket. Reading a stream would have to wait and might never end.
    #[error("it is a {0}; give a regular file")]
    NotRegular(&'static str),
    /// The file is larger than [`LARGEST_BYTES`]; its size in bytes.
    #[error("it has {} MB; accepted: at most {} MB; is it the right file?", .0 >> 20, LARGEST_BYTES >> 20)]
    TooLarge(u64),
    /// The content is not UTF-8.
    #[error("it is not UTF-8 text")]
    NotText,
    /// An error of the operating system.
    #[error("{0}")]
    System(io::Error),
}

impl ReadError {
    fn from_io(error: io::Error) -> Self {
        match error.kind() {
            io::ErrorKind::NotFound => Self::Missing,
            io::ErrorKind::IsADirectory => Self::Folder,
            _ => Self::System(error),
        }
    }
}

/// Opens a regular file of any size for reading.
///
/// # Errors
/// See [`ReadError`]; a file of another kind is rejected without waiting for it.
pub fn open(path: &Path) -> Result<File, ReadError> {
    // Check before opening, because opening a device may already have an effect on it.
    regular(fs::metadata(path).map_err(ReadError::from_io)?.file_type())?;
    let flags = (OFlags::NONBLOCK | OFlags::NOCTTY).bits();
    let flags = i32::try_from(flags).map_err(|_| ReadError::System(io::ErrorKind::InvalidInput.into()))?;
    let file = OpenOptions::new().read(true).custom_flags(flags).open(path).map_err(ReadError::from_io)?;
    // Check again, because the file may have been replaced between the check and the opening.
    regular(file.metadata().map_err(ReadError::from_io)?.file_type())?;
    Ok(file)
}

/// Reads a regular file of at most [`LARGEST_BYTES`].
///
/// # Errors
/// See [`ReadError`]; a file of another kind is rejected without waiting for it.
pub fn read(path: &Path) -> Result<Vec<u8>, ReadError> {
    let file = open(path)?;
    let length = file.metadata().map_err(ReadError::from_io)?.len();
    if length > LARGEST_BYTES {
        return Err(ReadError::TooLarge(length));
    }
    let mut bytes = Vec::new();
    file.take(LARGEST_BYTES + 1).read_to_end(&mut bytes).map_err(ReadError::from_io)?;
    let length = bytes.len() as u64;
    if length > LARGEST_BYTES { Err(ReadError::TooLarge(length)) } else { Ok(bytes) }
}

/// Reads a regular file of at most [`LARGEST_BYTES`] as text.
///
/// # Errors
/// As [`read`], and [`ReadError::NotText`].
pub fn read_text(path: &Path) -> Result<String, ReadError> {
    String::from_utf8(read(path)?).map_err(|_| ReadError::NotText)
}

/// As [`read_text`]; returns `None` if there is no such file.
///
/// # Errors
/// As [`read_text`], except [`ReadError::Missing`].
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

/// Replaces a file atomically: writes a temporary file next to it, syncs it to the disk, and renames it. After a power
/// cut the file has either the old or the new content; after the function has returned, the new one.
///
/// # Errors
/// An error of the operating system; the file then keeps its old content.
pub fn replace(path: &Path, content: impl AsRef<[u8]>) -> io::Result<()> {
    let mut beside = path.as_os_str().to_owned();
    beside.push(".new");
    let beside = PathBuf::from(beside);
    let write = || {
        // Remove the temporary file of a writer that died.
        fs::remove_file(&beside).or_else(|error| match error.kind() {
            io::ErrorKind::NotFound => Ok(()),
            _ => Err(error),
        })?;
        let mut fresh = File::create_new(&beside)?;
        fresh.write_all(content.as_ref())?;
        fresh.sync_all()?;
        fs::rename(&beside, path)
    };
    write().inspect_err(|_| {
        let _ = fs::remove_file(&beside);
    })?;
    // Sync the folder as well, so that the new name survives a power cut.
    File::open(folder_of(path))?.sync_all()
}

/// Removes a file, if it is there; after the function has returned, a power cut does not bring it back.
///
/// # Errors
/// An error of the operating system.
pub fn remove(path: &Path) -> io::Result<()> {
    match fs::remove_file(path) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => Err(error),
        _ => File::open(folder_of(path))?.sync_all(),
    }
}

/// Returns the folder of a file.
#[must_use]
pub fn folder_of(path: &Path) -> &Path {
    match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    }
}

/// Joins `inner` to `folder` and removes `x/..` from the result.
pub(crate) fn join_normalized(folder: &Path, inner: &Path) -> PathBuf {
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
        // Files in /proc report a size of 0.
        assert!(!read("/proc/self/status".as_ref()).unwrap().is_empty());
    }

    /// Reading these files would block, or exhaust the memory.
    #[test]
    fn endless_files_are_rejected_at_once() {
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
        // A folder cannot be replaced by a file.
        let taken = folder.path().join("taken");
        fs::create_dir(&taken).unwrap();
        assert!(replace(&taken, "a = 3\n").is_err());
        assert!(replace(&folder.path().join("nowhere/a.toml"), "").is_err());
        let mut names: Vec<_> = fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().file_name()).collect();
        names.sort();
        assert_eq!(names, ["a.toml", "taken"], "no temporary file is left");
    }
}
