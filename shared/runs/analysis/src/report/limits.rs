//! Limits on the figures of a report: a file of keys as in `nims report --json`, for continuous integration.

use command::{Answer, Failure};
use serde::Serialize;
use serde_json::Value;
use std::path::Path;

/// Jaro similarity above which a name is suggested.
const SIMILAR: f64 = 0.7;
/// Keys by which an element of a list is named.
const NAMES: [&str; 5] = ["name", "channel", "what", "role", "number"];

/// What a figure must be.
#[derive(Debug, Clone, PartialEq)]
struct Limit {
    key: String,
    min: Option<f64>,
    max: Option<f64>,
    is: Option<Value>,
}

/// The limits of a file.
#[derive(Debug, Clone, PartialEq)]
pub struct Limits {
    file: String,
    limits: Vec<Limit>,
}

/// A figure beside its limit.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Row {
    /// Name of the run.
    pub run: String,
    /// Key of the figure.
    pub key: String,
    /// The figure; null: the run has none.
    pub value: Value,
    /// Least accepted value.
    pub min: Option<f64>,
    /// Greatest accepted value.
    pub max: Option<f64>,
    /// Only accepted value.
    pub is: Option<Value>,
    /// One sentence; `None`: the limit is kept.
    pub broken: Option<String>,
}

/// Result of a check.
#[derive(Debug, Clone, PartialEq)]
pub struct Checked {
    file: String,
    /// Every figure that has a limit.
    pub rows: Vec<Row>,
}

impl Checked {
    fn broken(&self) -> impl Iterator<Item = &String> {
        self.rows.iter().filter_map(|row| row.broken.as_ref())
    }

    /// Returns one text line for each broken limit.
    #[must_use]
    pub fn words(&self) -> Vec<String> {
        match self.broken().count() {
            0 => vec![format!("limits     all {} limits of {} are kept", self.rows.len(), self.file)],
            _ => self.broken().map(|sentence| format!("limits     {sentence}")).collect(),
        }
    }

    /// Returns why the command fails; `None` if every limit is kept.
    #[must_use]
    pub fn failure(&self) -> Option<Failure> {
        let (broken, all) = (self.broken().count(), self.rows.len());
        (broken > 0).then(|| Failure::NotNow(format!("{broken} of {all} limits of {} are broken", self.file)))
    }
}

impl Limits {
    /// Reads a file of limits.
    ///
    /// # Errors
    /// The file cannot be read, or a key has no limit.
    pub fn read(path: &Path) -> Answer<Self> {
        let file = path.display().to_string();
        let text = std::fs::read_to_string(path).map_err(|error| Failure::BadInput(format!("{file}: {error}")))?;
        Self::parse(&file, &text)
    }

    /// Reads the text of a file of limits; `file` is its name in sentences.
    ///
    /// # Errors
    /// The text is not TOML, or a key has no limit.
    pub fn parse(file: &str, text: &str) -> Answer<Self> {
        let table: toml::Table = text.parse().map_err(|error| Failure::bad(format!("{file}: {error}")))?;
        let mut limits = Vec::new();
        collect(file, "", &table, &mut limits)?;
        if limits.is_empty() {
            let example = "analysis.estimate.max_m.max = 0.02";
            return Err(Failure::BadInput(format!("{file} has no limit; write one like {example}")));
        }
        Ok(Self { file: file.to_owned(), limits })
    }

    /// Compares the figures of every run, as below `runs` of `nims report --json`.
    ///
    /// # Errors
    /// A key names no figure, or the report has no run.
    pub fn check(&self, report: &Value) -> Answer<Checked> {
        let mut rows = Vec::new();
        for run in report["runs"].as_array().into_iter().flatten() {
            let name = run["run"].as_str().unwrap_or_default();
            for limit in &self.limits {
                let mut found = Vec::new();
                let path: Vec<&str> = limit.key.split('.').collect();
                figures(&self.file, run, &path, String::new(), &mut found)?;
                rows.extend(found.into_iter().map(|(key, value)| limit.row(name, key, value)));
            }
        }
        // Limits that nothing was compared with are not kept.
        if rows.is_empty() {
            let what = format!("{}: the report has no run to check; give at least one run", self.file);
            return Err(Failure::BadInput(what));
        }
        Ok(Checked { file: self.file.clone(), rows })
    }
}

/// Collects the limits of a table and of those below it.
fn collect(file: &str, path: &str, table: &toml::Table, limits: &mut Vec<Limit>) -> Answer {
    // A figure could have the name of a limit; then a table stands below it.
    let states =
        |(key, value): (&String, &toml::Value)| ["min", "max", "is"].contains(&key.as_str()) && !value.is_table();
    let is_limit = !path.is_empty() && table.iter().any(states);
    if is_limit {
        limits.push(limit(file, path, table)?);
        return Ok(());
    }
    if table.is_empty() && !path.is_empty() {
        let what = format!("{file}: {path} has no limit; accepted: {path}.min, {path}.max or {path}.is");
        return Err(Failure::BadInput(what));
    }
    for (key, value) in table {
        let path = if path.is_empty() { key.clone() } else { format!("{path}.{key}") };
        match value {
            toml::Value::Table(inner) => collect(file, &path, inner, limits)?,
            _ => {
                let what = format!("{file}: {path} is {value}; accepted: {path}.min, {path}.max or {path}.is");
                return Err(Failure::BadInput(what));
            }
        }
    }
    Ok(())
}

fn limit(file: &str, key: &str, table: &toml::Table) -> Answer<Limit> {
    let mut limit = Limit { key: key.to_owned(), min: None, max: None, is: None };
    for (name, value) in table {
        let wrong =
            |accepted: &str| Failure::BadInput(format!("{file}: {key}.{name} is {value}; accepted: {accepted}"));
        let number =
            value.as_float().or(value.as_integer().map(|number| number as f64)).filter(|value| value.is_finite());
        match name.as_str() {
            "min" => limit.min = Some(number.ok_or_else(|| wrong("a number"))?),
            "max" => limit.max = Some(number.ok_or_else(|| wrong("a number"))?),
            "is" if value.is_float() && number.is_none() => return Err(wrong("a number, a text or a truth value")),
            "is" if !value.is_table() && !value.is_array() => {
                limit.is = Some(serde_json::to_value(value).map_err(Failure::bad)?);
            }
            _ => return Err(wrong("a key min, max or is with a number, a text or a truth value")),
        }
    }
    Ok(limit)
}

impl Limit {
    fn row(&self, run: &str, key: String, value: Value) -> Row {
        let number = value.as_f64().or(value.as_bool().map(|value| f64::from(u8::from(value))));
        let sentence = |must: String| Some(format!("{run}: {key} is {value}, {must}"));
        let broken = match (self.min, self.max, &self.is, number) {
            (_, _, Some(is), _) if !is_equal(is, &value) => sentence(format!("but must be {is}")),
            (None, None, ..) => None,
            (.., None) => Some(format!("{run}: {key} has no number in this run")),
            (Some(min), _, _, Some(number)) if number < min => sentence(format!("below its least value {min}")),
            (_, Some(max), _, Some(number)) if number > max => sentence(format!("above its greatest value {max}")),
            _ => None,
        };
        Row { run: run.to_owned(), key, value, min: self.min, max: self.max, is: self.is.clone(), broken }
    }
}

/// Returns whether two values are equal; 0 and 0.0 are the same number.
fn is_equal(one: &Value, other: &Value) -> bool {
    match (one.as_f64(), other.as_f64()) {
        // Compare two integers as integers: 64 bits do not fit in a float.
        (Some(one_number), Some(other_number)) if one.is_f64() || other.is_f64() => one_number == other_number,
        _ => one == other,
    }
}

/// Finds the figures of a key; a `*` stands for every element. A missing value is null.
fn figures(file: &str, at: &Value, path: &[&str], key: String, found: &mut Vec<(String, Value)>) -> Answer {
    let Some((name, rest)) = path.split_first() else {
        found.push((key, at.clone()));
        return Ok(());
    };
    let below = |name: &str| if key.is_empty() { name.to_owned() } else { format!("{key}.{name}") };
    match at {
        Value::Object(fields) if *name == "*" && fields.is_empty() => found.push((below(&path.join(".")), Value::Null)),
        Value::Object(fields) if *name == "*" => {
            for (own, value) in fields {
                figures(file, value, rest, below(own), found)?;
            }
        }
        Value::Object(fields) => match fields.get(*name) {
            Some(value) => figures(file, value, rest, below(name), found)?,
            None => return Err(unknown(file, &below(name), fields.keys().map(String::as_str), &key)),
        },
        Value::Array(elements) if elements.is_empty() => found.push((below(&path.join(".")), Value::Null)),
        Value::Array(elements) if *name == "*" => {
            for (number, value) in elements.iter().enumerate() {
                figures(file, value, rest, below(&number.to_string()), found)?;
            }
        }
        Value::Array(elements) => {
            let named = |value: &&Value| NAMES.iter().any(|own| value[*own].as_str() == Some(name));
            let number = name.parse::<usize>().ok();
            match number.and_then(|number| elements.get(number)).or_else(|| elements.iter().find(named)) {
                Some(value) => figures(file, value, rest, below(name), found)?,
                // A run may have fewer legs or sensors than the file names.
                None if number.is_some() => found.push((below(&path.join(".")), Value::Null)),
                None => {
                    let names = elements.iter().filter_map(|value| NAMES.iter().find_map(|own| value[*own].as_str()));
                    return Err(unknown(file, &below(name), names, &key));
                }
            }
        }
        // A figure that this run lacks may have any figures below it.
        Value::Null => found.push((below(&path.join(".")), Value::Null)),
        _ => return Err(Failure::BadInput(format!("{file}: {key} is a figure and has no {}", path.join(".")))),
    }
    Ok(())
}

fn unknown<'a>(file: &str, key: &str, names: impl Iterator<Item = &'a str>, parent: &str) -> Failure {
    let last = key.rsplit('.').next().unwrap_or(key);
    let mut names: Vec<&str> = names.collect();
    names.sort_by(|one, other| strsim::jaro(last, other).total_cmp(&strsim::jaro(last, one)));
    let near = names.first().filter(|near| strsim::jaro(last, near) > SIMILAR);
    let whole = |name: &str| if parent.is_empty() { name.to_owned() } else { format!("{parent}.{name}") };
    let meant = near.map_or_else(String::new, |near| format!("; did you mean {}?", whole(near)));
    Failure::BadInput(format!("{file}: {key} is no figure of the report; accepted: {}{meant}", names.join(", ")))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use serde_json::json;

    fn report() -> Value {
        json!({ "runs": [{
            "run": "one", "verdict": { "grade": "good" }, "analysis": { "estimate": { "max_m": 0.008 }, "truth": null },
            "cables": [{ "tension_n": [12.0, 80.5] }, { "tension_n": [9.0, 95.0] }], "healthy": true, "legs": [],
            "times": [{ "what": "wake", "max_ns": 900 }],
            "processes": {}, "faults": 0, "period_s": 1.0,
        }] })
    }

    fn check(text: &str) -> Answer<Checked> {
        Limits::parse("limits.toml", text)?.check(&report())
    }

    #[test]
    fn kept_limits_are_listed_and_broken_ones_have_a_sentence_each() {
        let kept = "analysis.estimate.max_m.max = 0.01\nhealthy.min = 1\nverdict.grade.is = \"good\"\ntimes.wake.max_ns.max = 1000";
        let checked = check(kept).unwrap();
        assert_eq!((checked.rows.len(), checked.failure()), (4, None));
        let checked =
            check("cables.\"*\".tension_n.1 = { min = 5, max = 90.0 }\nanalysis.estimate.max_m.min = 0.01").unwrap();
        let broken: Vec<&String> = checked.broken().collect();
        assert_eq!((checked.rows.len(), broken.len()), (3, 2));
        assert!(
            broken.iter().any(|one| one.contains("cables.1.tension_n.1") && one.contains("95") && one.contains("90"))
        );
        assert_eq!(checked.failure().unwrap().exit_code(), 1);
    }

    #[test]
    fn a_figure_that_the_run_lacks_breaks_its_limit() {
        for text in ["analysis.truth.max_m.max = 1", "legs.\"*\".truth.max_m.max = 1", "cables.7.tension_n.1.max = 1"] {
            assert_eq!(check(text).unwrap().broken().count(), 1, "{text}");
        }
    }

    #[test]
    fn a_limit_that_no_number_can_keep_is_refused() {
        for text in ["faults.is = nan", "faults.is = inf", "faults.max = nan", "faults.min = -inf"] {
            assert_eq!(check(text).unwrap_err().exit_code(), 2, "{text}");
        }
    }

    #[test]
    fn a_limit_that_nothing_is_compared_with_is_not_kept() {
        for text in ["processes.\"*\".lost.max = 0", "processes.\"*\".lost.is = 0", "legs.\"*\".kind.is = \"line\""] {
            assert_eq!(check(text).unwrap().broken().count(), 1, "{text}");
        }
        let limits = Limits::parse("limits.toml", "faults.max = 0").unwrap();
        for report in [json!({ "runs": [] }), json!({})] {
            assert_eq!(limits.check(&report).unwrap_err().exit_code(), 2, "{report}");
        }
        // A key without a limit beside another one.
        let failure = check("faults.max = 0\n[analysis.estimate.max_m]").unwrap_err();
        assert!(failure.exit_code() == 2 && failure.to_string().contains("analysis.estimate.max_m.min"), "{failure}");
    }

    #[test]
    fn numbers_are_equal_however_they_are_written() {
        for text in ["faults.is = 0", "faults.is = 0.0", "faults.is = -0.0", "period_s.is = 1", "period_s.is = 1.0"] {
            assert_eq!(check(text).unwrap().failure(), None, "{text}");
        }
        for text in ["faults.is = 0.5", "faults.is = false", "faults.is = \"0\"", "period_s.is = 2"] {
            assert_eq!(check(text).unwrap().broken().count(), 1, "{text}");
        }
        let report = json!({ "runs": [{ "run": "one", "lost": i64::MAX - 1 }] });
        let limits = Limits::parse("limits.toml", "lost.is = 9223372036854775807").unwrap();
        assert_eq!(limits.check(&report).unwrap().broken().count(), 1, "they differ by one");
    }

    #[test]
    fn an_unknown_key_is_refused_with_near_names() {
        for (text, meant) in [
            ("analysis.estimate.max.max = 1", "analysis.estimate.max_m"),
            ("verdicts.grade.is = \"good\"", "verdict"),
            ("times.wakes.max_ns.max = 1", "times.wake"),
        ] {
            let failure = check(text).unwrap_err();
            assert!(failure.exit_code() == 2 && failure.to_string().contains(meant), "{failure}");
        }
        for text in
            ["", "healthy = 1", "healthy.max = \"x\"", "healthy = { max = 1, most = 2 }", "healthy.deep.max = 1"]
        {
            assert_eq!(check(text).unwrap_err().exit_code(), 2, "{text}");
        }
    }
}
