//! Tokens: secrets of clients that act for a person, stored as SHA-256.

use crate::roles::Role;
use gateway_protocol::TokenRow;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use std::path::Path;

/// Bytes of a secret: cannot be guessed, so that its plain hash is as good as a slow one.
const SECRET: usize = 32;
/// Largest number of tokens.
const MOST: usize = 256;
/// Longest name of a holder, bytes: it is recorded with each request.
const NAME: usize = 32;

/// Without random numbers there is no secret.
pub(crate) const NO_RANDOM: &str = "the kernel gives no random numbers now; try again";

#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
struct Token {
    name: String,
    role: String,
    /// SHA-256 of the secret, in hexadecimal digits.
    sha256: String,
    created: String,
}

/// The tokens of a robot.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Tokens(Vec<Token>);

impl Tokens {
    /// Reads the file with the tokens; none if there is no file.
    ///
    /// # Errors
    /// The file cannot be read.
    pub fn read(path: &Path) -> Result<Self, String> {
        let text = config::file::read_text_if_there(path).map_err(|error| format!("{}: {error}", path.display()))?;
        let Some(text) = text else { return Ok(Self::default()) };
        serde_json::from_str(&text).map_err(|error| format!("{} holds no tokens: {error}", path.display()))
    }

    /// Writes the file, which only its user can read.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn write(&self, path: &Path) -> Result<(), String> {
        let text = serde_json::to_string(self).map_err(|error| error.to_string())?;
        // The robot makes its state folder when it is started, which may come later.
        let made = path.parent().map_or(Ok(()), std::fs::create_dir_all);
        made.map_err(|error| format!("the folder of {} cannot be created: {error}", path.display()))?;
        config::file::replace(path, &text).map_err(|error| format!("{} cannot be written: {error}", path.display()))
    }

    /// Creates a token and returns its secret.
    ///
    /// # Errors
    /// The name or the role is not accepted, or there are too many tokens.
    pub fn add(&mut self, name: &str, role: &str) -> Result<String, String> {
        let usable = |byte: u8| byte.is_ascii_alphanumeric() || byte == b'-' || byte == b'_';
        if name.is_empty() || name.len() > NAME || !name.bytes().all(usable) {
            return Err(format!("the name of a token is `{name}`; accepted: 1 to {NAME} letters, digits, `-` and `_`"));
        }
        if Role::of_token(role).is_none() {
            return Err(format!("the role of a token is `{role}`; accepted: look, stop, fly"));
        }
        if self.0.iter().any(|token| token.name == name) {
            return Err(format!("there is a token `{name}` already; revoke it, or give another name"));
        }
        if self.0.len() >= MOST {
            return Err(format!("there are {MOST} tokens already; revoke one"));
        }
        let secret = secret().ok_or(NO_RANDOM)?;
        let created = runlog::utc(bus::clock::unix_ns());
        self.0.push(Token { name: name.to_owned(), role: role.to_owned(), sha256: hash(&secret), created });
        self.0.sort_by(|a, b| a.name.cmp(&b.name));
        Ok(secret)
    }

    /// Revokes a token.
    ///
    /// # Errors
    /// There is no such token.
    pub fn revoke(&mut self, name: &str) -> Result<(), String> {
        let before = self.0.len();
        self.0.retain(|token| token.name != name);
        if self.0.len() < before {
            Ok(())
        } else {
            Err(format!("there is no token `{name}`; the list has their names"))
        }
    }

    /// Returns the name and the role of the holder of a secret.
    #[must_use]
    pub fn of(&self, secret: &str) -> Option<(String, Role)> {
        // Hashes are compared, so the time of the comparison says nothing about the secret.
        let hash = hash(secret);
        let token = self.0.iter().find(|token| token.sha256 == hash)?;
        Some((token.name.clone(), Role::of_token(&token.role)?))
    }

    /// Returns the tokens without their secrets.
    #[must_use]
    pub fn rows(&self) -> Vec<TokenRow> {
        let row = |token: &Token| TokenRow {
            name: token.name.clone(),
            role: token.role.clone(),
            created: token.created.clone(),
        };
        self.0.iter().map(row).collect()
    }
}

fn secret() -> Option<String> {
    random::<SECRET>().map(|bytes| messages::hex(&bytes))
}

/// Random bytes of the kernel.
pub(crate) fn random<const N: usize>() -> Option<[u8; N]> {
    let mut bytes = [0_u8; N];
    let filled = rustix::rand::getrandom(&mut bytes, rustix::rand::GetRandomFlags::empty()).ok()?;
    (filled == N).then_some(bytes)
}

fn hash(secret: &str) -> String {
    messages::hex(&Sha256::digest(secret.as_bytes()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_token_is_valid_until_it_is_revoked_and_its_secret_is_not_stored() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("state/tokens.json");
        let mut tokens = Tokens::read(&path).unwrap();
        let (tablet, phone) = (tokens.add("tablet", "fly").unwrap(), tokens.add("phone", "stop").unwrap());
        assert!(tablet != phone && tablet.len() == 2 * SECRET);
        tokens.write(&path).unwrap();
        let text = std::fs::read_to_string(&path).unwrap();
        assert!(!text.contains(&tablet) && !text.contains(&phone));
        let mut tokens = Tokens::read(&path).unwrap();
        assert_eq!(tokens.of(&tablet), Some(("tablet".to_owned(), Role::Fly)));
        assert_eq!(tokens.of(&phone), Some(("phone".to_owned(), Role::Stop)));
        // The stored hash is no secret.
        let stored: Vec<&str> = text.split('"').filter(|word| word.len() == 64).collect();
        assert_eq!(stored.len(), 2);
        assert!(stored.iter().all(|hash| tokens.of(hash).is_none()));
        tokens.revoke("tablet").unwrap();
        assert_eq!((tokens.of(&tablet), tokens.rows().len()), (None, 1));
    }

    #[test]
    fn wrong_tokens_are_refused() {
        let mut tokens = Tokens::default();
        tokens.add("a", "look").unwrap();
        for (name, role, why) in
            [("", "fly", "name"), ("b c", "fly", "name"), ("b", "owner", "role"), ("a", "fly", "already")]
        {
            assert!(tokens.add(name, role).unwrap_err().contains(why), "{name} {role}");
        }
        assert!(tokens.revoke("z").is_err());
        assert_eq!(tokens.of(""), None);
    }
}
