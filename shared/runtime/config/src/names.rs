//! Names of systems and processes.

use crate::problem::Problem;

/// Longest name, characters: it becomes part of the path of a socket, whose length is limited.
const NAME_MAX: usize = 16;

/// Checks the name of a system or process, which becomes part of names in shared memory.
pub(crate) fn check(key: &str, value: &str) -> Result<(), Problem> {
    let fine = value.bytes().all(|byte| byte.is_ascii_lowercase() || byte.is_ascii_digit() || byte == b'-');
    if fine && (1..=NAME_MAX).contains(&value.len()) {
        Ok(())
    } else {
        Err(Problem::with_clause(key, format!("is \"{value}\"; accepted: 1 to {NAME_MAX} of a-z, 0-9 and -")))
    }
}
