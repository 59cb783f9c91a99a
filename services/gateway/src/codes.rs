//! Codes for pairing: short, for one use and ten minutes, and closed for a time after failures.

use robot_state::Reason;
use sha2::{Digest, Sha256};

/// Crockford's digits: none is taken for another one.
const DIGITS: &[u8; 32] = b"0123456789ABCDEFGHJKMNPQRSTVWXYZ";
/// Digits of a code: 2^40 codes, of which five can be tried in a minute.
const LENGTH: usize = 8;
/// Time for which a code is valid, ns.
const VALID_NS: u64 = 600_000_000_000;
/// Largest number of codes at once.
const MOST: usize = 16;
/// Wrong codes after which none is accepted for a time, and that time, ns.
const FAILURES: usize = 5;
const LOCKED_NS: u64 = 60_000_000_000;

#[derive(Debug)]
struct Code {
    sha256: [u8; 32],
    name: String,
    role: String,
    until_ns: u64,
}

/// The codes that were given out and not used.
#[derive(Debug, Default)]
pub(crate) struct Codes {
    open: Vec<Code>,
    failures: usize,
    locked_ns: u64,
}

impl Codes {
    /// Time for which a code is valid, s.
    pub(crate) const VALID_S: f64 = VALID_NS as f64 * 1e-9;

    /// Makes a code for a holder; an earlier one for the same holder is not valid any more. `random`: as many random
    /// bytes as a code has digits.
    ///
    /// # Errors
    /// One sentence.
    pub(crate) fn add(&mut self, now_ns: u64, name: &str, role: &str, random: [u8; LENGTH]) -> Result<String, String> {
        self.open.retain(|code| code.until_ns > now_ns && code.name != name);
        if self.open.len() >= MOST {
            return Err(format!("{MOST} codes wait to be used; use one, or wait for ten minutes"));
        }
        let code: String = random.iter().map(|byte| char::from(DIGITS[usize::from(byte & 31)])).collect();
        let (name, role, until_ns) = (name.to_owned(), role.to_owned(), now_ns.saturating_add(VALID_NS));
        self.open.push(Code { sha256: hash(&code), name, role, until_ns });
        Ok(format!("{}-{}", &code[..LENGTH / 2], &code[LENGTH / 2..]))
    }

    /// Uses a code: it is not valid any more. Returns its holder and role.
    #[allow(clippy::result_large_err)] // it is the answer
    pub(crate) fn take(&mut self, now_ns: u64, given: &str) -> Result<(String, String), Reason> {
        if now_ns < self.locked_ns {
            return Err(Reason::PairingLocked { for_s: seconds(self.locked_ns - now_ns) });
        }
        let hash = hash(&normal(given));
        self.open.retain(|code| code.until_ns > now_ns);
        if let Some(at) = self.open.iter().position(|code| code.sha256 == hash) {
            self.failures = 0;
            let Code { name, role, .. } = self.open.swap_remove(at);
            return Ok((name, role));
        }
        self.failures += 1;
        if self.failures >= FAILURES {
            (self.failures, self.locked_ns) = (0, now_ns.saturating_add(LOCKED_NS));
            return Err(Reason::PairingLocked { for_s: seconds(LOCKED_NS) });
        }
        Err(Reason::CodeInvalid { left: FAILURES - self.failures })
    }
}

/// A code as it is meant: without separators, and with the digits that are taken for others.
fn normal(given: &str) -> String {
    let meant = given.chars().filter(char::is_ascii_alphanumeric).take(2 * LENGTH);
    meant
        .map(|c| match c.to_ascii_uppercase() {
            'O' => '0',
            'I' | 'L' => '1',
            c => c,
        })
        .collect()
}

/// Whole seconds, not less.
fn seconds(ns: u64) -> f64 {
    ns.div_ceil(1_000_000_000) as f64
}

fn hash(code: &str) -> [u8; 32] {
    Sha256::digest(code.as_bytes()).into()
}

#[cfg(test)]
mod tests {
    use super::*;

    const RANDOM: [u8; LENGTH] = [0, 1, 34, 200, 7, 31, 16, 255];

    #[test]
    fn a_code_is_valid_once_for_ten_minutes_and_as_it_is_read_aloud() {
        let mut codes = Codes::default();
        let code = codes.add(0, "ada", "fly", RANDOM).unwrap();
        assert_eq!(code, "0128-7ZGZ");
        assert_eq!(codes.take(1, "oi28 7zgz"), Ok(("ada".to_owned(), "fly".to_owned())));
        assert_eq!(codes.take(2, &code), Err(Reason::CodeInvalid { left: 4 }));
        codes.add(0, "ada", "fly", RANDOM).unwrap();
        assert_eq!(codes.take(VALID_NS, &code), Err(Reason::CodeInvalid { left: 3 }));
        // A second one for the same holder replaces the first.
        codes.add(0, "ada", "fly", RANDOM).unwrap();
        let other = codes.add(0, "ada", "stop", [9; LENGTH]).unwrap();
        assert!(codes.take(1, &code).is_err() && codes.take(1, &other).is_ok());
        let added = (0..100).filter(|i| codes.add(0, &format!("n{i}"), "fly", [*i as u8; LENGTH]).is_ok()).count();
        assert_eq!(added, MOST);
    }

    #[test]
    fn five_failures_close_it_for_a_minute_also_for_the_right_code() {
        let mut codes = Codes::default();
        let code = codes.add(0, "ada", "fly", RANDOM).unwrap();
        for left in (1..FAILURES).rev() {
            assert_eq!(codes.take(1, "AAAA-AAAA"), Err(Reason::CodeInvalid { left }));
        }
        assert_eq!(codes.take(1, ""), Err(Reason::PairingLocked { for_s: 60.0 }));
        assert!(matches!(codes.take(2, &code), Err(Reason::PairingLocked { .. })));
        assert!(codes.take(1 + LOCKED_NS, &code).is_ok());
    }
}
