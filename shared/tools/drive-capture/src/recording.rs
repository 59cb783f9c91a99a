//! The file: one line per piece of bytes, as it passed.

use command::{Answer, Failure};
use std::fmt::{self, Write as _};
use std::path::Path;

/// First line of a file.
pub const HEAD: &str = "# nims drive capture 1: seconds, > to the drive or < from it, bytes";
/// Begin of the line with the baud rate.
const BAUD: &str = "# baud ";

/// Who sent bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Side {
    /// The program.
    Program,
    /// The drive.
    Drive,
}

/// Bytes that passed together.
#[derive(Debug, Clone, PartialEq)]
pub struct Chunk {
    /// Time since the begin of the recording, s: when the program's bytes were written to the drive, or when the
    /// drive's were read.
    pub at_s: f64,
    /// Who sent them.
    pub side: Side,
    /// The bytes.
    pub bytes: Vec<u8>,
}

impl fmt::Display for Chunk {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let side = if self.side == Side::Program { '>' } else { '<' };
        write!(f, "{:.6} {side}", self.at_s)?;
        self.bytes.iter().try_for_each(|byte| write!(f, " {byte:02x}"))
    }
}

/// The bytes between a program and a drive.
#[derive(Debug, Clone, PartialEq)]
pub struct Recording {
    /// Baud rate of the port; a USB port ignores it.
    pub baud: u32,
    /// The bytes, in the order of time.
    pub chunks: Vec<Chunk>,
}

impl Recording {
    /// Reads a file.
    ///
    /// # Errors
    /// It cannot be read, or a line of it is none of a recording.
    pub fn load(path: &Path) -> Answer<Self> {
        let text = std::fs::read_to_string(path)
            .map_err(|error| Failure::BadInput(format!("{}: cannot be read ({error})", path.display())))?;
        Self::parse(&text).map_err(|problem| Failure::BadInput(format!("{}: {problem}", path.display())))
    }

    /// Reads the text of a file.
    ///
    /// # Errors
    /// The line that is none of a recording, and why.
    pub fn parse(text: &str) -> Result<Self, String> {
        let mut recording = Self { baud: 0, chunks: Vec::new() };
        if text.lines().next() != Some(HEAD) {
            return Err(format!("is no recording: its first line must be `{HEAD}`"));
        }
        // A recorder that was killed leaves a line without its end.
        let whole = text.rfind('\n').map_or("", |end| &text[..end]);
        for (number, line) in (1..).zip(whole.lines()).map(|(number, line)| (number, line.trim())) {
            if let Some(baud) = line.strip_prefix(BAUD) {
                recording.baud = baud.parse().map_err(|_| format!("line {number} has no baud rate but `{baud}`"))?;
            } else if !line.is_empty() && !line.starts_with('#') {
                let chunk = chunk(line).ok_or_else(|| {
                    format!("line {number} is `{line}`; expected seconds, > or <, and bytes of two hexadecimal digits")
                })?;
                if recording.chunks.last().is_some_and(|last| last.at_s > chunk.at_s) {
                    return Err(format!("line {number} is earlier than the one before"));
                }
                recording.chunks.push(chunk);
            }
        }
        Ok(recording)
    }

    /// The begin of a file.
    #[must_use]
    pub fn begin(baud: u32) -> String {
        format!("{HEAD}\n{BAUD}{baud}\n")
    }
}

impl fmt::Display for Recording {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&Self::begin(self.baud))?;
        self.chunks.iter().try_for_each(|chunk| {
            write!(f, "{chunk}")?;
            f.write_char('\n')
        })
    }
}

fn chunk(line: &str) -> Option<Chunk> {
    let mut words = line.split_whitespace();
    let at_s: f64 = words.next()?.parse().ok().filter(|at_s: &f64| at_s.is_finite() && *at_s >= 0.0)?;
    let side = match words.next()? {
        ">" => Side::Program,
        "<" => Side::Drive,
        _ => return None,
    };
    let byte = |word: &str| (word.len() == 2).then(|| u8::from_str_radix(word, 16).ok()).flatten();
    let bytes: Vec<u8> = words.map(byte).collect::<Option<_>>()?;
    (!bytes.is_empty()).then_some(Chunk { at_s, side, bytes })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_file_is_read_as_it_was_written(
            baud in 0..1_000_000_u32,
            pieces in proptest::collection::vec(
                (0..100_000_u32, any::<bool>(), proptest::collection::vec(any::<u8>(), 1..20)), 0..20),
        ) {
            let mut at_us = 0;
            let chunks = pieces.into_iter().map(|(later_us, program, bytes)| {
                at_us += later_us;
                Chunk { at_s: f64::from(at_us) / 1e6, side: if program { Side::Program } else { Side::Drive }, bytes }
            });
            let recording = Recording { baud, chunks: chunks.collect() };
            prop_assert_eq!(Recording::parse(&recording.to_string()), Ok(recording));
        }
    }

    #[test]
    fn what_is_none_is_named() {
        let with = |line: &str| Recording::parse(&format!("{HEAD}\n{line}\n")).unwrap_err();
        for line in ["x > 00", "0.1 ? 00", "0.1 > 0", "0.1 > 0g", "0.1 >", "-1 > 00", "nan < 00"] {
            assert!(with(line).starts_with(&format!("line 2 is `{line}`")), "{}", with(line));
        }
        assert_eq!(with("0.2 > 00\n0.1 < 00"), "line 3 is earlier than the one before");
        assert!(Recording::parse("0.1 > 00").unwrap_err().starts_with("is no recording"));
        let cut = Recording::parse(&format!("{HEAD}\n0.1 > 00\n0.2 < 0")).unwrap();
        assert_eq!(cut.chunks.len(), 1);
    }
}
