//! Reading TOML files, with errors that a person at the robot can act on.

use std::path::{Path, PathBuf};

use crate::file;
use serde::de::DeserializeOwned;
use toml::de::{DeTable, DeValue};

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
    /// The file.
    #[must_use]
    pub fn path(&self) -> &Path {
        match self {
            Self::Unreadable { path, .. } | Self::Text { path, .. } | Self::Value { path, .. } => path,
        }
    }

    /// The key that is wrong, if there is one: with the names of its tables where the problem says them.
    #[must_use]
    pub fn key(&self) -> Option<&str> {
        match self {
            Self::Unreadable { .. } => None,
            Self::Text { problem, .. } | Self::Value { problem, .. } => problem.split('`').nth(1),
        }
    }

    /// A file whose text is well-formed and whose values are not usable; `problem` is one clause that names the key, between the first
    /// two backticks, with the names of its tables before it where several tables have such a key. The line is looked up in the file.
    #[must_use]
    pub fn value(path: &Path, problem: impl Into<String>) -> Self {
        let (path, problem) = (path.to_owned(), problem.into());
        let text = file::read_text(&path).unwrap_or_default();
        match problem.split('`').nth(1).and_then(|key| line_of(&text, key)) {
            Some(line) => Self::Text { path, line, problem },
            None => Self::Value { path, problem },
        }
    }
}

/// Reads a TOML file into `T`. Refusing unknown keys is up to the type (`deny_unknown_fields`).
///
/// # Errors
/// [`ConfigError::Unreadable`] or [`ConfigError::Text`].
pub fn load<T: DeserializeOwned>(path: &Path) -> Result<T, ConfigError> {
    let text = file::read_text(path)
        .map_err(|error| ConfigError::Unreadable { path: path.to_owned(), why: error.to_string() })?;
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

/// The line, from 1, on which the dotted `key` stands; `leg.2.speed_m_s` is that of the third table `leg`, also in a table within it. If
/// its tables are not named, the first key of that name in any table.
#[must_use]
pub fn line_of(text: &str, key: &str) -> Option<usize> {
    let table = DeTable::parse(text).ok()?;
    let names: Vec<&str> = key.split('.').collect();
    let at = find(table.get_ref(), &names).or_else(|| anywhere(table.get_ref(), names.last()?))?;
    text.get(..at).map(|before| before.matches('\n').count() + 1)
}

/// Where the key at the end of this way begins, bytes; in the last table also further inside.
fn find(table: &DeTable<'_>, names: &[&str]) -> Option<usize> {
    let (first, rest) = names.split_first()?;
    let found = table.iter().find(|(key, _)| key.get_ref() == *first);
    if rest.is_empty() {
        return found.map(|(key, _)| key.span().start).or_else(|| anywhere(table, first));
    }
    match (found?.1.get_ref(), rest) {
        (DeValue::Table(inner), _) => find(inner, rest),
        (DeValue::Array(items), [number, rest @ ..]) => match items.get(number.parse::<usize>().ok()?)?.get_ref() {
            DeValue::Table(inner) => find(inner, rest),
            _ => None,
        },
        _ => None,
    }
}

/// Where the first key of that name begins, at whatever depth, bytes.
fn anywhere(table: &DeTable<'_>, name: &str) -> Option<usize> {
    table
        .iter()
        .filter_map(
            |(key, value)| {
                if key.get_ref() == name { Some(key.span().start) } else { inside(value.get_ref(), name) }
            },
        )
        .min()
}

fn inside(value: &DeValue<'_>, name: &str) -> Option<usize> {
    match value {
        DeValue::Table(inner) => anywhere(inner, name),
        DeValue::Array(items) => items.iter().filter_map(|item| inside(item.get_ref(), name)).min(),
        _ => None,
    }
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

    /// Line and key of what is wrong, and the clause about it.
    fn refused(text: &str) -> (usize, Option<String>, String) {
        let error = parse::<Example>(text, Path::new("box.toml")).unwrap_err();
        let sentence = error.to_string();
        assert_eq!(sentence.lines().count(), 1, "{sentence}");
        let key = error.key().map(str::to_owned);
        let ConfigError::Text { path, line, problem } = error else { panic!("{sentence}") };
        assert_eq!(path, Path::new("box.toml"));
        assert!(sentence.starts_with("box.toml, ") && sentence.contains(&format!(" {line}: {problem}")), "{sentence}");
        (line, key, problem)
    }

    #[test]
    fn errors_name_file_line_key_and_what_is_accepted() {
        parse::<Example>("speed_m_s = 0.2\nlaw = \"preview\"", Path::new("box.toml")).unwrap();
        let cases: [(&str, usize, &str, &[&str]); 5] = [
            ("speed_m_s = \"0.2\"\nlaw = \"preview\"", 1, "speed_m_s", &["f64"]),
            ("speed_m_s = 0.2\n\nlaw = \"pid\"", 3, "law", &["`pid`", "`lq-endpoint`", "`preview`"]),
            ("speed_m_s = 0.2\nlaw = \"preview\"\nsped = 1", 3, "sped", &["`speed_m_s`"]),
            ("law = \"preview\"", 1, "speed_m_s", &[]),
            ("speed_m_s = 0.2\nlaw = \"preview\"\n[inner]\ncount = -1", 4, "count", &["-1", "u32"]),
        ];
        for (text, line, key, parts) in cases {
            let (at, named, problem) = refused(text);
            assert_eq!((at, named.as_deref()), (line, Some(key)), "{problem}");
            assert!(parts.iter().all(|part| problem.contains(part)), "{problem}");
        }
        assert_eq!(refused("speed_m_s = 0.2\nlaw = \"preview").0, 2);
    }

    #[test]
    fn a_value_that_is_not_accepted_is_found_by_its_key() {
        let text =
            "name = \"x\"\n\n[motor_io]\n# speed_m_s = 3\nramp_s = 90\n[planner]\nspeed_m_s = 9\n[[port]]\nbaud = 1\n";
        for (key, line) in [
            ("name", Some(1)),
            ("motor_io.ramp_s", Some(5)),
            ("planner.speed_m_s", Some(7)),
            ("speed_m_s", Some(7)),
            ("baud", Some(9)),
            ("planner.ramp", None),
        ] {
            assert_eq!(line_of(text, key), line, "{key}");
        }
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), text).unwrap();
        let error = ConfigError::value(file.path(), "`motor_io.ramp_s` is 90");
        assert!(matches!(error, ConfigError::Text { line: 5, .. }), "{error}");
        assert_eq!((error.path(), error.key()), (file.path(), Some("motor_io.ramp_s")));
        assert!(error.to_string().ends_with(": `motor_io.ramp_s` is 90"), "{error}");
    }

    #[test]
    fn a_file_that_is_not_there_is_said_so() {
        let error = load::<Example>(Path::new("/nowhere/box.toml")).unwrap_err();
        let why = file::ReadError::Missing.to_string();
        assert!(error.to_string().contains("/nowhere/box.toml") && error.to_string().ends_with(&why), "{error}");
        assert!(matches!(error, ConfigError::Unreadable { .. }) && error.path() == Path::new("/nowhere/box.toml"));
    }

    #[test]
    fn only_finite_numbers_pass() {
        assert_eq!(finite("x", 1.5), Ok(1.5));
        for value in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            assert!(finite("robot.node_mass_kg", value).unwrap_err().contains("`robot.node_mass_kg`"));
        }
    }
}
