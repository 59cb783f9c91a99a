//! Findings about a configuration or a machine, and their texts.

use serde::Serialize;
use serde_json::{Value, json};

/// Severity of a finding.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Level {
    /// Information.
    Note,
    /// Usable, with less margin than it should have.
    Warning,
    /// Not usable.
    Error,
}

/// A fact about a configuration or a machine that the operator should know.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Finding {
    /// Severity.
    pub level: Level,
    /// The fact.
    pub finding: String,
    /// Remedy; empty for a note.
    pub cure: String,
}

/// Returns a finding that needs no action.
#[must_use]
pub fn note(finding: String) -> Finding {
    Finding { level: Level::Note, finding, cure: String::new() }
}

/// Returns a finding about insufficient margin.
#[must_use]
pub fn warning(finding: String, cure: &str) -> Finding {
    Finding { level: Level::Warning, finding, cure: cure.to_owned() }
}

/// Returns a finding about something that cannot work.
#[must_use]
pub fn error(finding: String, cure: &str) -> Finding {
    Finding { level: Level::Error, finding, cure: cure.to_owned() }
}

/// Returns the number of findings that are errors.
#[must_use]
pub fn errors(findings: &[Finding]) -> usize {
    findings.iter().filter(|finding| finding.level == Level::Error).count()
}

/// Returns the findings as JSON.
#[must_use]
pub fn to_json(findings: &[Finding]) -> Value {
    json!({ "usable": usable(findings), "findings": findings })
}

/// Returns the findings as text, one line each.
#[must_use]
pub fn to_text(findings: &[Finding]) -> String {
    let lines: Vec<String> = findings
        .iter()
        .map(|finding| match (finding.level, finding.cure.as_str()) {
            (Level::Note, _) => format!("note: {}", finding.finding),
            (Level::Warning, cure) => format!("warning: {}; {cure}", finding.finding),
            (Level::Error, cure) => format!("error: {}; {cure}", finding.finding),
        })
        .collect();
    lines.join("\n")
}

/// Returns the last sentence of a check.
pub(crate) fn verdict(findings: &[Finding]) -> String {
    let warnings = findings.iter().filter(|finding| finding.level == Level::Warning).count();
    match (errors(findings), warnings) {
        (0, 0) => "fine: no errors, no warnings".to_owned(),
        (0, warnings) => format!("usable: no errors, {}", counted(warnings, "warning")),
        (errors, warnings) => format!("not usable: {}, {}", counted(errors, "error"), counted(warnings, "warning")),
    }
}

/// Returns a number of things in words.
pub(crate) fn counted(count: usize, what: &str) -> String {
    match count {
        0 => format!("no {what}s"),
        1 => format!("1 {what}"),
        _ => format!("{count} {what}s"),
    }
}

/// Returns whether none of the findings is an error.
#[must_use]
pub fn usable(findings: &[Finding]) -> bool {
    findings.iter().all(|finding| finding.level != Level::Error)
}
