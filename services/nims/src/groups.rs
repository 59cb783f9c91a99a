//! The commands of `nims --help`, in groups by task.

use crate::programs;

/// Each group with its commands, in the order of their use.
const GROUPS: [(&str, &[&str]); 9] = [
    ("Try it without a robot", &["demo", "sim", "truth"]),
    (
        "Before a flight",
        &["check", "doctor", "bench", "setup", "calibrate", "loads", "motor-table", "identify", "drive-capture"],
    ),
    ("Start and end", &["up", "arm", "disarm", "zero", "confirm-position", "reset"]),
    ("Fly", &["goto", "run", "pause", "resume", "speed", "jog", "soft", "hold", "stop", "estop", "mark"]),
    ("Look", &["status", "top", "channel", "page"]),
    ("Change in flight", &["swap", "set", "start", "stop-process", "restart", "plug", "unplug", "fault", "token"]),
    ("Write your own", &["new-sensor", "new-law", "new-estimator"]),
    ("After a flight", &["runs", "fetch", "report", "map", "info", "export", "replay", "recover"]),
    ("Compute", &["ik", "fk", "tension", "plan", "workspace", "solve", "paper"]),
];
/// Columns of a narrow terminal.
const COLUMNS: usize = 80;
/// Columns of the names.
const NAMES: usize = 20;

/// Template of the help: like clap's, with the groups in place of the list of commands.
pub const TEMPLATE: &str =
    "{about-with-newline}\n{usage-heading} {usage}\n\n{before-help}Options:\n{options}{after-help}";

/// Returns the groups as text; `commands` are the names and descriptions of the commands that are built in.
#[must_use]
pub fn text(commands: &[(String, String)]) -> String {
    let about = |name: &str| {
        let built_in = commands.iter().find(|(command, _)| command == name).map(|(_, about)| about.as_str());
        built_in.or(programs::COMPANIONS.iter().find(|(program, _)| *program == name).map(|(_, about)| *about))
    };
    let mut lines = Vec::new();
    for (title, names) in GROUPS {
        lines.push(format!("{title}:"));
        // The page is built apart from the other programs.
        for name in names.iter().filter(|name| **name != "page" || programs::sibling("nims-page").is_ok()) {
            let mut name = *name;
            for part in wrapped(short(about(name).unwrap_or_default())) {
                lines.push(format!("  {name:<width$}{part}", width = NAMES - 2));
                name = "";
            }
        }
        lines.push(String::new());
    }
    lines.push("`nims COMMAND --help` explains a command. Any other `nims X` runs the program".to_owned());
    lines.push("nims-X in the same folder.".to_owned());
    lines.join("\n")
}

/// Returns the first clause of a description that does not fit into a text line, otherwise the description.
fn short(about: &str) -> &str {
    if about.len() <= COLUMNS - NAMES {
        return about;
    }
    let end = [". ", "; ", ": ", " ("].iter().filter_map(|end| about.find(end)).min();
    &about[..end.unwrap_or(about.len())]
}

/// Breaks a description into text lines beside the names.
fn wrapped(about: &str) -> Vec<String> {
    let mut lines = vec![String::new()];
    for word in about.split(' ') {
        let line = lines.last().map_or(0, |line| line.chars().count());
        if line > 0 && line + 1 + word.chars().count() > COLUMNS - NAMES {
            lines.push(String::new());
        }
        if let Some(line) = lines.last_mut() {
            let space = if line.is_empty() { "" } else { " " };
            line.push_str(&format!("{space}{word}"));
        }
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli;
    use clap::CommandFactory;
    use std::collections::BTreeMap;

    #[test]
    fn every_command_is_in_one_group() {
        let mut counts: BTreeMap<&str, usize> = BTreeMap::new();
        for name in GROUPS.iter().flat_map(|(_, names)| *names) {
            *counts.entry(name).or_default() += 1;
        }
        let command = cli::Cli::command();
        let built_in =
            command.get_subcommands().filter(|command| !command.is_hide_set()).map(|command| command.get_name());
        let all: Vec<&str> = built_in.chain(programs::COMPANIONS.iter().map(|(name, _)| *name)).collect();
        for name in &all {
            assert_eq!(counts.get(name), Some(&1), "{name}");
        }
        assert_eq!(counts.len(), all.len(), "a group names a command that does not exist");
    }

    #[test]
    fn a_narrow_terminal_shows_the_groups_without_wrapping() {
        let help = cli::Cli::command().render_help().to_string();
        let groups: Vec<&str> = help.lines().skip_while(|line| !line.starts_with("Try it")).collect();
        let wide: Vec<&&str> = groups
            .iter()
            .take_while(|line| !line.starts_with('`'))
            .filter(|line| line.chars().count() > COLUMNS)
            .collect();
        assert!(groups.len() > 50 && wide.is_empty(), "{wide:?}");
    }
}
