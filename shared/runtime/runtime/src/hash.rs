//! SHA-256 of files and programs, which a run stores to identify what it was recorded with.

use std::path::PathBuf;
use std::thread::JoinHandle;

use rustix::process::setpriority_process;
use rustix::thread::gettid;
use sha2::{Digest, Sha256};

use config::file;

/// Nice value of the thread that reads a program: the lowest priority.
const LOWEST_PRIORITY: i32 = 19;
/// Stack of the thread that reads a program; small, because it may be locked in memory.
const STACK_BYTES: usize = 256 * 1024;

/// The hash of a program, computed in a thread. On a busy computer that takes seconds, for which nothing waits.
#[derive(Debug)]
pub struct ProgramHash(Option<JoinHandle<String>>);

impl ProgramHash {
    /// Starts to read this program.
    #[must_use]
    pub fn begin(program: PathBuf) -> Self {
        let read = move || {
            // Without the permission it runs with the priority of its parent.
            let _ = setpriority_process(Some(gettid()), LOWEST_PRIORITY);
            hash_of(&[program]).unwrap_or_default()
        };
        Self(std::thread::Builder::new().name("hash".to_owned()).stack_size(STACK_BYTES).spawn(read).ok())
    }

    /// Returns the hash once, when the program has been read; empty if it cannot be read.
    pub fn poll(&mut self) -> Option<String> {
        self.0.take_if(|reading| reading.is_finished())?.join().ok()
    }
}

/// Returns the SHA-256 of the concatenation of regular files of any size, as `cat FILES | sha256sum` prints it; `None`
/// if one cannot be read.
#[must_use]
pub fn hash_of(files: &[PathBuf]) -> Option<String> {
    let mut hash = Hasher(Sha256::new());
    for path in files {
        std::io::copy(&mut file::open(path).ok()?, &mut hash).ok()?;
    }
    Some(messages::hex(&hash.0.finalize()))
}

struct Hasher(Sha256);

impl std::io::Write for Hasher {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.0.update(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_hash_is_that_of_sha256sum() {
        let folder = tempfile::tempdir().unwrap();
        let files: Vec<PathBuf> = ["a", "bc"]
            .iter()
            .map(|text| {
                let path = folder.path().join(text);
                std::fs::write(&path, text).unwrap();
                path
            })
            .collect();
        // printf abc | sha256sum
        let known = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
        assert_eq!(hash_of(&files).as_deref(), Some(known));
        assert_eq!(hash_of(&[folder.path().join("x")]), None);
        assert_eq!(hash_of(&[PathBuf::from("/dev/zero")]), None, "an endless file");
    }

    #[test]
    fn a_program_is_read_once() {
        let program = std::env::current_exe().unwrap();
        let mut reading = ProgramHash::begin(program.clone());
        let hash = loop {
            if let Some(hash) = reading.poll() {
                break hash;
            }
            std::thread::yield_now();
        };
        assert_eq!(Some(hash), hash_of(&[program]));
        assert_eq!(reading.poll(), None);
    }
}
