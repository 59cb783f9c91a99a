//! Reading of TOML files, with errors that name file, line, key and accepted values.

use std::ops::Range;
use std::path::{Path, PathBuf};

use crate::choice::IS;
use crate::{Problem, file};
use serde::de::DeserializeOwned;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

/// An error in a configuration file; its message is one sentence with file, line, key and accepted values.
#[derive(Debug, thiserror::Error)]
pub enum ConfigError {
    /// The file cannot be read.
    #[error("the file {path} cannot be read: {why}")]
    Unreadable {
        /// Path of the file.
        path: PathBuf,
        /// The reason, as a clause.
        why: String,
    },
    /// The text cannot be parsed, or a value in it is not accepted.
    #[error("{path}, line {line}: {problem}")]
    Text {
        /// Path of the file.
        path: PathBuf,
        /// Line number, from 1.
        line: usize,
        /// The dotted key, if the problem is about one.
        key: Option<String>,
        /// The problem, including the key.
        problem: String,
    },
    /// The file is of another kind than the wanted one.
    #[error("{path} is a {found}, and a {wanted} is needed here: {cure}")]
    OfAnotherKind {
        /// Path of the file.
        path: PathBuf,
        /// Kind of the file.
        found: &'static str,
        /// Wanted kind.
        wanted: &'static str,
        /// What to give instead.
        cure: &'static str,
    },
    /// A value is not accepted, and its key is not in the file.
    #[error("{path}: {problem}")]
    Value {
        /// Path of the file.
        path: PathBuf,
        /// The dotted key.
        key: String,
        /// The problem, including the key.
        problem: String,
    },
}

impl ConfigError {
    /// Returns the path of the file.
    #[must_use]
    pub fn path(&self) -> &Path {
        match self {
            Self::Unreadable { path, .. }
            | Self::Text { path, .. }
            | Self::OfAnotherKind { path, .. }
            | Self::Value { path, .. } => path,
        }
    }

    /// Returns the dotted key of the problem, if it is about one; the tables of an array are numbered from 0.
    #[must_use]
    pub fn key(&self) -> Option<&str> {
        match self {
            Self::Unreadable { .. } | Self::OfAnotherKind { .. } => None,
            Self::Text { key, .. } => key.as_deref(),
            Self::Value { key, .. } => Some(key),
        }
    }
}

/// The text of a TOML file; adds line numbers to problems.
#[derive(Debug, Clone)]
pub struct Source {
    path: PathBuf,
    text: String,
}

impl Source {
    /// Reads a file.
    ///
    /// # Errors
    /// [`ConfigError::Unreadable`].
    pub fn read(path: &Path) -> Result<Self, ConfigError> {
        let text = file::read_text(path)
            .map_err(|error| ConfigError::Unreadable { path: path.to_owned(), why: error.to_string() })?;
        Ok(Self { path: path.to_owned(), text })
    }

    /// Returns the text.
    pub(crate) fn text(&self) -> &str {
        &self.text
    }

    /// Creates a source from a text; the path is used in errors only.
    pub(crate) fn from_text(path: PathBuf, text: String) -> Self {
        Self { path, text }
    }

    /// Returns the path of the file.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Parses the text. Whether unknown keys are errors depends on the type (`deny_unknown_fields`).
    ///
    /// # Errors
    /// [`ConfigError::Text`].
    pub fn parse<T: DeserializeOwned>(&self) -> Result<T, ConfigError> {
        toml::from_str(&self.text).map_err(|error| {
            let span = error.span().unwrap_or(0..0);
            // An error about the whole document has an empty span.
            let table = DeTable::parse(&self.text).ok().filter(|_| !span.is_empty());
            let place = table.and_then(|table| place_of(table.get_ref(), &span));
            let message = error.message().trim().replace('\n', "; ");
            // toml's message names an unknown or missing key, but not the key of a wrong value.
            let subject = match &place {
                Some(Place::Key(key)) => key.rsplit_once('.').map(|(table, _)| table),
                Some(Place::Value(key)) => Some(key.as_str()),
                None => None,
            };
            let problem = match subject {
                Some(key) if message.starts_with(IS) => format!("`{key}` {message}"),
                Some(key) => format!("`{key}`: {message}"),
                None => message,
            };
            let key = place.map(|(Place::Key(key) | Place::Value(key))| key);
            ConfigError::Text { path: self.path.clone(), line: line_at(&self.text, span.start), key, problem }
        })
    }

    /// Returns the problem with the path of the file, and with the line of its key or, if the key is absent, of its
    /// table.
    #[must_use]
    pub fn error(&self, problem: &Problem) -> ConfigError {
        let (path, key, sentence) = (self.path.clone(), problem.key().to_owned(), problem.to_string());
        match line_of(&self.text, problem.key()) {
            Some(line) => ConfigError::Text { path, line, key: Some(key), problem: sentence },
            None => ConfigError::Value { path, key, problem: sentence },
        }
    }
}

/// Reads and parses a TOML file. Whether unknown keys are errors depends on the type (`deny_unknown_fields`).
///
/// # Errors
/// [`ConfigError::Unreadable`] or [`ConfigError::Text`].
pub fn load<T: DeserializeOwned>(path: &Path) -> Result<T, ConfigError> {
    Source::read(path)?.parse()
}

/// Reads and parses a TOML file, and checks its values.
///
/// # Errors
/// As [`load`], or the problem that `check` finds, with the file and the line.
pub fn load_checked<T: DeserializeOwned>(
    path: &Path,
    check: impl FnOnce(&T) -> Result<(), Problem>,
) -> Result<T, ConfigError> {
    let source = Source::read(path)?;
    let file = source.parse()?;
    check(&file).map_err(|problem| source.error(&problem))?;
    Ok(file)
}

/// Parses a text; `path` is used in errors only.
///
/// # Errors
/// [`ConfigError::Text`].
pub fn parse<T: DeserializeOwned>(text: &str, path: &Path) -> Result<T, ConfigError> {
    Source { path: path.to_owned(), text: text.to_owned() }.parse()
}

/// Returns the number, from 1, of the text line with the dotted `key`; the tables of an array are numbered from 0.
///
/// The last name may also be in a table inside the named one: `leg.2.speed_m_s` may be a key of that leg's `line`.
/// If the key is absent, the result is the text line of the innermost of its tables that is present.
#[must_use]
pub fn line_of(text: &str, key: &str) -> Option<usize> {
    let table = DeTable::parse(text).ok()?;
    let names: Vec<&str> = key.split('.').collect();
    find(table.get_ref(), &names).map(|at| line_at(text, at))
}

fn line_at(text: &str, at: usize) -> usize {
    text.get(..at).unwrap_or(text).matches('\n').count() + 1
}

/// Returns the byte offset of the key at the end of this path, or of the innermost table on the path.
fn find(table: &DeTable<'_>, names: &[&str]) -> Option<usize> {
    let (first, rest) = names.split_first()?;
    let Some((key, value)) = table.iter().find(|(key, _)| key.get_ref() == *first) else {
        return if rest.is_empty() { find_nested(table, first) } else { None };
    };
    let inner = match (value.get_ref(), rest) {
        (DeValue::Table(inner), _) => find(inner, rest),
        (DeValue::Array(items), [number, rest @ ..]) => {
            let item = number.parse::<usize>().ok().and_then(|number| items.get(number));
            item.and_then(|item| match item.get_ref() {
                DeValue::Table(inner) => find(inner, rest).or_else(|| Some(item.span().start)),
                _ => None,
            })
        }
        _ => None,
    };
    inner.or_else(|| Some(key.span().start))
}

/// Returns the byte offset of the first key of this name in the tables inside this one.
fn find_nested(table: &DeTable<'_>, name: &str) -> Option<usize> {
    let inner = table.iter().filter_map(|(_, value)| match value.get_ref() {
        DeValue::Table(inner) => Some(inner),
        _ => None,
    });
    let of_key = |(key, _): (&Spanned<_>, &_)| (key.get_ref() == name).then(|| key.span().start);
    inner.filter_map(|inner| inner.iter().find_map(of_key).or_else(|| find_nested(inner, name))).min()
}

/// The element at a span of the text: a key, or the value of a key; both with the dotted key.
enum Place {
    Key(String),
    Value(String),
}

impl Place {
    fn below(self, name: &str) -> Self {
        match self {
            Self::Key(key) => Self::Key(format!("{name}.{key}")),
            Self::Value(key) => Self::Value(format!("{name}.{key}")),
        }
    }
}

/// Returns the innermost key or value of the table that contains this span.
fn place_of(table: &DeTable<'_>, at: &Range<usize>) -> Option<Place> {
    table.iter().find_map(|(key, value)| {
        let name: &str = key.get_ref();
        if let Some(inner) = place_in(value.get_ref(), at) {
            return Some(inner.below(name));
        }
        // A table with a header has the span of the header, which also contains its name.
        if contains(&value.span(), at) {
            return Some(Place::Value(name.to_owned()));
        }
        contains(&key.span(), at).then(|| Place::Key(name.to_owned()))
    })
}

fn place_in(value: &DeValue<'_>, at: &Range<usize>) -> Option<Place> {
    match value {
        DeValue::Table(inner) => place_of(inner, at),
        DeValue::Array(items) => items.iter().enumerate().find_map(|(index, item)| {
            let name = index.to_string();
            let inner = place_in(item.get_ref(), at).map(|inner| inner.below(&name));
            let is_table = matches!(item.get_ref(), DeValue::Table(_));
            inner.or_else(|| (is_table && contains(&item.span(), at)).then_some(Place::Value(name)))
        }),
        _ => None,
    }
}

fn contains(outer: &Range<usize>, inner: &Range<usize>) -> bool {
    outer.start <= inner.start && inner.end <= outer.end
}

/// Returns the value if it is finite; TOML can express NaN and infinities.
///
/// # Errors
/// The value is NaN or infinite: a problem at the key.
pub fn finite(key: &str, value: f64) -> Result<f64, Problem> {
    if value.is_finite() {
        Ok(value)
    } else {
        Err(Problem::with_clause(key, format!("is {value}; accepted: a finite number")))
    }
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

    crate::choice! {
        /// Two laws.
        pub enum Law {
            /// The first.
            LqEndpoint = "lq-endpoint",
            /// The second.
            Preview = "preview",
        }
    }

    #[derive(Debug, serde::Deserialize)]
    #[serde(deny_unknown_fields)]
    #[allow(dead_code)]
    struct Inner {
        count: u32,
    }

    /// Returns line, key and clause of the error in a text.
    fn error_in(text: &str) -> (usize, Option<String>, String) {
        let error = parse::<Example>(text, Path::new("system.toml")).unwrap_err();
        let sentence = error.to_string();
        assert_eq!(sentence.lines().count(), 1, "{sentence}");
        let key = error.key().map(str::to_owned);
        let ConfigError::Text { path, line, problem, .. } = error else { panic!("{sentence}") };
        assert_eq!(path, Path::new("system.toml"));
        assert!(
            sentence.starts_with("system.toml, ") && sentence.contains(&format!(" {line}: {problem}")),
            "{sentence}"
        );
        (line, key, problem)
    }

    #[test]
    fn errors_name_file_line_key_and_what_is_accepted() {
        parse::<Example>("speed_m_s = 0.2\nlaw = \"preview\"", Path::new("system.toml")).unwrap();
        let cases: [(&str, usize, Option<&str>, &[&str]); 6] = [
            ("speed_m_s = \"0.2\"\nlaw = \"preview\"", 1, Some("speed_m_s"), &["`speed_m_s`", "f64"]),
            ("speed_m_s = 0.2\n\nlaw = \"pid\"", 3, Some("law"), &["`law` is \"pid\"; accepted: lq-endpoint, preview"]),
            ("speed_m_s = 0.2\n\nlaw = \"previews\"", 3, Some("law"), &["; did you mean preview?"]),
            ("speed_m_s = 0.2\nlaw = \"preview\"\nsped = 1", 3, Some("sped"), &["`sped`", "`speed_m_s`"]),
            ("law = \"preview\"", 1, None, &["`speed_m_s`"]),
            (
                "speed_m_s = 0.2\nlaw = \"preview\"\n[inner]\ncount = -1",
                4,
                Some("inner.count"),
                &["`inner.count`", "-1", "u32"],
            ),
        ];
        for (text, line, key, parts) in cases {
            let (at, named, problem) = error_in(text);
            assert_eq!((at, named.as_deref()), (line, key), "{problem}");
            assert!(parts.iter().all(|part| problem.contains(part)), "{problem}");
        }
        assert_eq!(error_in("speed_m_s = 0.2\nlaw = \"preview").0, 2);
    }

    #[test]
    fn the_line_of_a_problem_is_found_by_its_key() {
        let text = "name = \"x\"\n\n[motor_io]\n# speed_m_s = 3\nramp_s = 90\n[planner]\nspeed_m_s = 9\n[[port]]\nbaud = 1\n\
                    [[port]]\nunits = [\n{ address = 1 },\n{ address = 2, cables = [1] },\n]\n[[leg]]\nline = { to_m = 1 }\n";
        for (key, line) in [
            ("name", Some(1)),
            ("motor_io.ramp_s", Some(5)),
            ("planner.speed_m_s", Some(7)),
            ("port.0.baud", Some(9)),
            ("port.1.units.1.address", Some(13)),
            // in a nested table
            ("leg.0.to_m", Some(16)),
            // absent: the innermost of its tables
            ("planner.ramp", Some(6)),
            ("port.1.baud", Some(10)),
            ("port.1.units.0.cables", Some(12)),
            ("rate_hz", None),
            ("arbiter.fade_s", None),
        ] {
            assert_eq!(line_of(text, key), line, "{key}");
        }
        let source = Source { path: "system.toml".into(), text: text.to_owned() };
        let error = source.error(&Problem::with_clause("motor_io.ramp_s", "is 90"));
        assert!(matches!(error, ConfigError::Text { line: 5, .. }), "{error}");
        assert_eq!((error.path(), error.key()), (Path::new("system.toml"), Some("motor_io.ramp_s")));
        assert_eq!(error.to_string(), "system.toml, line 5: `motor_io.ramp_s` is 90");
        assert_eq!(source.error(&Problem::with_clause("rate_hz", "is 1")).to_string(), "system.toml: `rate_hz` is 1");
    }

    #[test]
    fn the_error_for_a_missing_file_names_it() {
        let error = load::<Example>(Path::new("/nowhere/system.toml")).unwrap_err();
        let why = file::ReadError::Missing.to_string();
        assert!(error.to_string().contains("/nowhere/system.toml") && error.to_string().ends_with(&why), "{error}");
        assert!(matches!(error, ConfigError::Unreadable { .. }) && error.path() == Path::new("/nowhere/system.toml"));
    }

    #[test]
    fn only_finite_numbers_are_accepted() {
        assert_eq!(finite("x", 1.5), Ok(1.5));
        for value in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            assert!(finite("robot.node_mass_kg", value).unwrap_err().to_string().contains("`robot.node_mass_kg`"));
        }
    }
}
