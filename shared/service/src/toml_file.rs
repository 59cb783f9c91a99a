//! Reading TOML files, with errors that a person at the robot can act on.

use std::path::{Path, PathBuf};

use serde::de::DeserializeOwned;

/// What is wrong with a configuration file, as one sentence: file, line, key, what is accepted.
#[derive(Debug, thiserror::Error)]
pub enum ConfigError {
    /// It cannot be read.
    #[error("the file {path} cannot be read: {why}")]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// One clause.
        why: String,
    },
    /// Its text is not what is expected.
    #[error("{path}, line {line}: {problem}")]
    Text {
        /// The file.
        path: PathBuf,
        /// From 1.
        line: usize,
        /// One clause, with the key where there is one.
        problem: String,
    },
    /// Its values do not fit.
    #[error("{path}: {problem}")]
    Value {
        /// The file.
        path: PathBuf,
        /// One clause, with the key.
        problem: String,
    },
}

impl ConfigError {
    /// A file whose text is well-formed and whose values are not usable; `problem` is one clause that names the key.
    #[must_use]
    pub fn value(path: &Path, problem: impl Into<String>) -> Self {
        Self::Value { path: path.to_owned(), problem: problem.into() }
    }
}

/// Reads a TOML file into `T`. Refusing unknown keys is up to the type (`deny_unknown_fields`).
///
/// # Errors
/// [`ConfigError::Unreadable`] or [`ConfigError::Text`].
pub fn load<T: DeserializeOwned>(path: &Path) -> Result<T, ConfigError> {
    let text = std::fs::read_to_string(path).map_err(|error| {
        let why = match error.kind() {
            std::io::ErrorKind::NotFound => "there is no such file".to_owned(),
            std::io::ErrorKind::IsADirectory => "it is a folder; name a file in it".to_owned(),
            std::io::ErrorKind::InvalidData => "it is not UTF-8 text".to_owned(),
            _ => error.to_string(),
        };
        ConfigError::Unreadable { path: path.to_owned(), why }
    })?;
    parse(&text, path)
}

/// [`load`] from a text in hand; `path` is only named in errors.
///
/// # Errors
/// [`ConfigError::Text`].
pub fn parse<T: DeserializeOwned>(text: &str, path: &Path) -> Result<T, ConfigError> {
    toml::from_str(text).map_err(|error| {
        let at = error.span().map_or(0, |span| span.start.min(text.len()));
        let before = text.get(..at).unwrap_or(text);
        let line = before.matches('\n').count() + 1;
        let here = text.lines().nth(line - 1).unwrap_or("");
        let message = error.message().trim().replace('\n', "; ");
        // serde names unknown and missing keys itself, but not the key of a wrong value
        let key =
            here.split_once('=').map(|(key, _)| key.trim()).filter(|key| !key.is_empty() && !key.starts_with('#'));
        let problem = match key {
            Some(key) if !message.contains(&format!("`{key}`")) && !message.contains("field `") => {
                format!("`{key}`: {message}")
            }
            _ => message,
        };
        ConfigError::Text { path: path.to_owned(), line, problem }
    })
}

/// The value itself, unless it is NaN or infinite (which TOML can express).
///
/// # Errors
/// One clause that names the key, for [`ConfigError::value`].
pub fn finite(key: &str, value: f64) -> Result<f64, String> {
    if value.is_finite() { Ok(value) } else { Err(format!("`{key}` is {value}; give a finite number")) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Debug, serde::Deserialize)]
    #[serde(deny_unknown_fields)]
    #[allow(dead_code)]
    struct Example {
        speed_m_s: f64,
        law: Law,
        #[serde(default)]
        inner: Option<Inner>,
    }

    #[derive(Debug, serde::Deserialize)]
    #[serde(rename_all = "kebab-case")]
    enum Law {
        LqEndpoint,
        Preview,
    }

    #[derive(Debug, serde::Deserialize)]
    #[serde(deny_unknown_fields)]
    #[allow(dead_code)]
    struct Inner {
        count: u32,
    }

    fn sentence(text: &str) -> String {
        let sentence = parse::<Example>(text, Path::new("box.toml")).unwrap_err().to_string();
        assert_eq!(sentence.lines().count(), 1, "{sentence}");
        sentence
    }

    #[test]
    fn errors_name_file_line_key_and_what_is_accepted() {
        parse::<Example>("speed_m_s = 0.2\nlaw = \"preview\"", Path::new("box.toml")).unwrap();
        let wrong_type = sentence("speed_m_s = \"0.2\"\nlaw = \"preview\"");
        assert!(
            wrong_type.starts_with("box.toml, line 1: `speed_m_s`: ") && wrong_type.contains("expected f64"),
            "{wrong_type}"
        );
        let wrong_choice = sentence("speed_m_s = 0.2\n\nlaw = \"pid\"");
        assert!(wrong_choice.starts_with("box.toml, line 3: `law`: "), "{wrong_choice}");
        assert!(wrong_choice.contains("`lq-endpoint`") && wrong_choice.contains("`preview`"), "{wrong_choice}");
        let unknown = sentence("speed_m_s = 0.2\nlaw = \"preview\"\nsped = 1");
        assert!(
            unknown.starts_with("box.toml, line 3: unknown field `sped`, expected one of `speed_m_s`"),
            "{unknown}"
        );
        let missing = sentence("law = \"preview\"");
        assert!(missing.contains("missing field `speed_m_s`"), "{missing}");
        let nested = sentence("speed_m_s = 0.2\nlaw = \"preview\"\n[inner]\ncount = -1");
        assert!(nested.starts_with("box.toml, line 4: `count`: "), "{nested}");
        let broken = sentence("speed_m_s = 0.2\nlaw = \"preview");
        assert!(broken.starts_with("box.toml, line 2: "), "{broken}");
    }

    #[test]
    fn a_file_that_is_not_there_is_said_so() {
        let error = load::<Example>(Path::new("/nowhere/box.toml")).unwrap_err();
        assert_eq!(error.to_string(), "the file /nowhere/box.toml cannot be read: there is no such file");
    }

    #[test]
    fn only_finite_numbers_pass() {
        assert_eq!(finite("x", 1.5), Ok(1.5));
        for value in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            assert!(finite("robot.node_mass_kg", value).unwrap_err().contains("`robot.node_mass_kg`"));
        }
    }
}
