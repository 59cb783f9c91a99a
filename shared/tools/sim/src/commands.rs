//! Commands of custom programs, in which `{KEY}` stands for the value of a key in each flight.

use command::{Answer, Failure};

/// Commands of the custom programs of a flight; `None`: what is built in.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Commands {
    /// That of the law.
    pub law: Option<String>,
    /// That of the estimator.
    pub estimator: Option<String>,
}

impl Commands {
    /// Returns whether a key stands in a command.
    #[must_use]
    pub fn has(&self, key: &str) -> bool {
        self.all().any(|command| keys(command).any(|named| named == key))
    }

    /// Returns whether a key is one of the commands alone: it has no section, so no file has it.
    #[must_use]
    pub fn is_argument(&self, key: &str) -> bool {
        !key.contains('.') && self.has(key)
    }

    /// Returns the commands with the value of each key in its place.
    ///
    /// # Errors
    /// A key without a value.
    pub fn filled(&self, value: impl Fn(&str) -> Option<String>) -> Answer<Self> {
        let filled = |command: &String| -> Answer<String> {
            keys(command).try_fold(command.clone(), |filled, key| {
                let value = value(key).ok_or_else(|| {
                    Failure::BadInput(format!(
                        "{command} names {{{key}}}, which has no value; give one with --sweep {key}=A,B or --set {key}=A"
                    ))
                })?;
                Ok(filled.replace(&format!("{{{key}}}"), &value))
            })
        };
        Ok(Self {
            law: self.law.as_ref().map(filled).transpose()?,
            estimator: self.estimator.as_ref().map(filled).transpose()?,
        })
    }

    fn all(&self) -> impl Iterator<Item = &str> {
        self.law.iter().chain(&self.estimator).map(String::as_str)
    }
}

/// Returns the keys in braces.
fn keys(command: &str) -> impl Iterator<Item = &str> {
    let braced = command.split('{').skip(1).filter_map(|rest| Some(rest.split_once('}')?.0));
    braced.filter(|key| !key.is_empty() && key.chars().all(|one| one.is_ascii_alphanumeric() || "_.".contains(one)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_in_braces_get_their_values() {
        let commands = Commands { law: Some("env P={p} I={p}{law.i} law {}{a b}".to_owned()), estimator: None };
        assert!(commands.has("p") && commands.has("law.i") && !commands.has("a b") && !commands.has("i"));
        assert!(commands.is_argument("p") && !commands.is_argument("law.i"));
        let filled = commands.filled(|key| Some(if key == "p" { "1.5" } else { "0.2" }.to_owned())).unwrap();
        assert_eq!(filled.law.as_deref(), Some("env P=1.5 I=1.50.2 law {}{a b}"));
        let refused = commands.filled(|key| (key == "p").then(|| "1".to_owned())).unwrap_err();
        assert!(refused.exit_code() == 2 && refused.to_string().contains("{law.i}"), "{refused}");
    }
}
