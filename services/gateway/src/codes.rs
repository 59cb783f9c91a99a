//! Codes for pairing: short, for one use and ten minutes, and closed for a time to an address that fails.

use crate::budget::Budget;
use robot_state::Reason;
use sha2::{Digest, Sha256};
use std::net::IpAddr;

/// Crockford's digits: none is taken for another one.
const DIGITS: &[u8; 32] = b"0123456789ABCDEFGHJKMNPQRSTVWXYZ";
/// Digits of a code: 2^40 codes, of which a few thousand can be tried while one is valid.
const LENGTH: usize = 8;
/// Time for which a code is valid, ns.
const VALID_NS: u64 = 600_000_000_000;
/// Largest number of codes at once.
const MOST: usize = 16;
/// Wrong codes after which none is accepted from an address for a time, and that time, ns.
const FAILURES: usize = 5;
const LOCKED_NS: u64 = 60_000_000_000;
/// Codes that are tried per second, and in a burst, from all addresses together: at most 6100 in ten minutes, so that
/// one of 2^40 is not found with any number of addresses, of which one machine may have many in a network of IPv6.
const TRIED_PER_S: f64 = 10.0;
const TRIED: f64 = 100.0;
/// Addresses with wrong codes that are remembered.
const ADDRESSES: usize = 256;

#[derive(Debug)]
struct Code {
    sha256: [u8; 32],
    name: String,
    role: String,
    until_ns: u64,
}

/// The wrong codes of an address, also of IPv6: a whole team may share a network of it, and one stranger there does not
/// lock the others out. Clients without an address count as one.
#[derive(Debug)]
struct Failures {
    from: Option<IpAddr>,
    count: usize,
    /// They count until then.
    until_ns: u64,
}

/// The codes that were given out and not used.
#[derive(Debug)]
pub(crate) struct Codes {
    open: Vec<Code>,
    failures: Vec<Failures>,
    tried: Budget,
}

impl Default for Codes {
    fn default() -> Self {
        Self { open: Vec::new(), failures: Vec::new(), tried: Budget::new(TRIED_PER_S, TRIED, 0) }
    }
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

    /// Returns the holder and the role of a code that was entered at an address. It is valid until it is used.
    #[allow(clippy::result_large_err)] // it is the answer
    pub(crate) fn holder(
        &mut self,
        now_ns: u64,
        from: Option<IpAddr>,
        given: &str,
    ) -> Result<(String, String), Reason> {
        let from = from.map(|address| address.to_canonical());
        self.failures.retain(|one| one.until_ns > now_ns);
        if let Some(locked) = self.failures.iter().find(|one| one.from == from && one.count >= FAILURES) {
            return Err(Reason::PairingLocked { for_s: seconds(locked.until_ns - now_ns) });
        }
        if !self.tried.spend(now_ns) {
            return Err(Reason::PairingLocked { for_s: 1.0 });
        }
        let hash = hash(&normal(given));
        self.open.retain(|code| code.until_ns > now_ns);
        if let Some(code) = self.open.iter().find(|code| code.sha256 == hash) {
            self.failures.retain(|one| one.from != from);
            return Ok((code.name.clone(), code.role.clone()));
        }
        let count = self.failed(from, now_ns.saturating_add(LOCKED_NS));
        Err(match FAILURES.checked_sub(count) {
            None | Some(0) => Reason::PairingLocked { for_s: seconds(LOCKED_NS) },
            Some(left) => Reason::CodeInvalid { left },
        })
    }

    /// The code of a holder is used: the token is stored.
    pub(crate) fn used(&mut self, name: &str) {
        self.open.retain(|code| code.name != name);
    }

    /// Counts a wrong code of an address; returns how many there are.
    fn failed(&mut self, from: Option<IpAddr>, until_ns: u64) -> usize {
        if let Some(known) = self.failures.iter_mut().find(|one| one.from == from) {
            (known.count, known.until_ns) = (known.count + 1, until_ns);
            return known.count;
        }
        // The oldest one makes room.
        if self.failures.len() >= ADDRESSES
            && let Some(at) = (0..ADDRESSES).min_by_key(|at| self.failures[*at].until_ns)
        {
            self.failures.swap_remove(at);
        }
        self.failures.push(Failures { from, count: 1, until_ns });
        1
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

    impl Codes {
        /// Uses a code.
        #[allow(clippy::result_large_err)] // it is the answer
        fn take(&mut self, now_ns: u64, from: Option<IpAddr>, given: &str) -> Result<(String, String), Reason> {
            self.holder(now_ns, from, given).inspect(|(name, _)| self.used(name))
        }
    }

    #[test]
    fn a_code_is_valid_once_for_ten_minutes_and_as_it_is_read_aloud() {
        let mut codes = Codes::default();
        let code = codes.add(0, "ada", "fly", RANDOM).unwrap();
        assert_eq!(code, "0128-7ZGZ");
        assert_eq!(codes.take(1, None, "oi28 7zgz"), Ok(("ada".to_owned(), "fly".to_owned())));
        assert_eq!(codes.take(2, None, &code), Err(Reason::CodeInvalid { left: 4 }));
        codes.add(0, "ada", "fly", RANDOM).unwrap();
        assert_eq!(codes.take(VALID_NS, None, &code), Err(Reason::CodeInvalid { left: 4 }));
        // A second one for the same holder replaces the first.
        codes.add(0, "ada", "fly", RANDOM).unwrap();
        let other = codes.add(0, "ada", "stop", [9; LENGTH]).unwrap();
        assert!(codes.take(1, None, &code).is_err() && codes.take(1, None, &other).is_ok());
        let added = (0..100).filter(|i| codes.add(0, &format!("n{i}"), "fly", [*i as u8; LENGTH]).is_ok()).count();
        assert_eq!(added, MOST);
    }

    #[test]
    fn five_failures_close_it_to_their_address_for_a_minute_also_for_the_right_code() {
        let mut codes = Codes::default();
        let code = codes.add(0, "ada", "fly", RANDOM).unwrap();
        let from = |text: &str| Some(text.parse::<IpAddr>().unwrap());
        // An IPv4 address counts in either form.
        for stranger in [["10.0.0.66", "::ffff:10.0.0.66"], ["2001:db8::1", "2001:db8:0:0::1"]] {
            for left in (1..FAILURES).rev() {
                assert_eq!(codes.take(1, from(stranger[left % 2]), "AAAA-AAAA"), Err(Reason::CodeInvalid { left }));
            }
            assert_eq!(codes.take(1, from(stranger[0]), ""), Err(Reason::PairingLocked { for_s: 60.0 }));
            assert!(matches!(codes.take(2, from(stranger[1]), &code), Err(Reason::PairingLocked { .. })));
        }
        // Another address is not locked out, also of the same network.
        assert_eq!(codes.take(2, from("2001:db8::2"), "AAAA-AAAA"), Err(Reason::CodeInvalid { left: 4 }));
        assert_eq!(codes.take(2, from("10.0.0.7"), "AAAA-AAAA"), Err(Reason::CodeInvalid { left: 4 }));
        assert!(codes.take(2, from("10.0.0.7"), &code).is_ok());
        let code = codes.add(0, "ada", "fly", RANDOM).unwrap();
        assert!(codes.take(1 + LOCKED_NS, from("10.0.0.66"), &code).is_ok());
    }

    #[test]
    fn with_any_number_of_addresses_few_codes_are_tried_while_one_is_valid() {
        let four = |at: u32| IpAddr::from((0x0a00_0000 + at % 5_000).to_be_bytes());
        // Of one machine, which takes another address of its network for each try.
        let six = |at: u32| IpAddr::from(((0x2001_0db8_u128 << 96) + u128::from(at)).to_be_bytes());
        for address in [&four as &dyn Fn(u32) -> IpAddr, &six] {
            let mut codes = Codes::default();
            codes.add(0, "ada", "fly", RANDOM).unwrap();
            let (mut tried, mut most) = (0, 0);
            for at in 0..60_000_u32 {
                let given = codes.take(u64::from(at) * VALID_NS / 60_000, Some(address(at)), "AAAA-AAAA");
                tried += usize::from(matches!(given, Err(Reason::CodeInvalid { .. })));
                most = most.max(codes.failures.len());
            }
            assert!((6000..=6100).contains(&tried) && most <= ADDRESSES, "{tried}, {most}");
        }
    }
}
