//! Everything that the documents name exists: paths, links, sub-commands and options of `nims`, and a line of the code
//! map for every crate.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::process::Command;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap().to_path_buf()
}

/// Every document that describes the present tree, with its text. The changelog also names what was removed.
fn documents() -> Vec<(PathBuf, String)> {
    let mut paths = ["README.md", "ARCHITECTURE.md", "CONTRIBUTING.md"].map(|name| root().join(name)).to_vec();
    let pages = std::fs::read_dir(root().join("docs")).unwrap().map(|entry| entry.unwrap().path());
    paths.extend(pages.filter(|path| path.extension().is_some_and(|ending| ending == "md")));
    assert!(paths.len() > 10, "too few documents found: {paths:?}");
    paths.into_iter().map(|path| (path.clone(), std::fs::read_to_string(path).unwrap())).collect()
}

/// Code of a document: the lines of its fenced blocks, and the spans between single backticks.
fn code(text: &str) -> Vec<String> {
    let mut found = Vec::new();
    for (number, block) in text.split("```").enumerate() {
        if number % 2 == 1 {
            found.extend(block.lines().skip(1).map(str::to_owned));
        } else {
            // A span may continue on the next line, but not in the next paragraph.
            for paragraph in block.split("\n\n") {
                found.extend(paragraph.split('`').skip(1).step_by(2).map(|span| span.replace('\n', " ")));
            }
        }
    }
    found
}

/// Targets of links and pictures.
fn links(text: &str) -> Vec<&str> {
    text.split("](").skip(1).filter_map(|rest| rest.split(')').next()).collect()
}

/// The anchors of a page's headings, as GitHub makes them.
fn anchors(text: &str) -> BTreeSet<String> {
    let anchor = |heading: &str| {
        let kept = heading.trim().to_lowercase().replace(' ', "-");
        kept.chars().filter(|one| one.is_alphanumeric() || "-_".contains(*one)).collect()
    };
    text.lines().filter(|line| line.starts_with('#')).map(|line| anchor(line.trim_start_matches('#'))).collect()
}

#[test]
fn every_path_and_link_exists() {
    let mut wrong = Vec::new();
    for (document, text) in documents() {
        let name = document.strip_prefix(root()).unwrap().display().to_string();
        for link in links(&text).into_iter().filter(|link| !link.contains("://")) {
            let (file, anchor) = link.split_once('#').unwrap_or((link, ""));
            let path = if file.is_empty() { document.clone() } else { document.parent().unwrap().join(file) };
            let heading = || anchors(&std::fs::read_to_string(&path).unwrap()).contains(anchor);
            if !path.exists() || !(anchor.is_empty() || heading()) {
                wrong.push(format!("{name}: link {link}"));
            }
        }
        for word in code(&text).iter().flat_map(|span| span.split_whitespace()) {
            let word = word.trim_matches(|one: char| "\"'(),;:[]".contains(one));
            let ours = ["services/", "shared/", "configs/", "scripts/", "tests/", "docs/"];
            // Capitals, braces and stars stand for names that the reader chooses.
            let pattern = word.contains(['{', '*', '<']) || word.split('/').any(|part| part.starts_with("NAME"));
            if ours.iter().any(|folder| word.starts_with(folder)) && !pattern && !root().join(word).exists() {
                wrong.push(format!("{name}: path {word}"));
            }
        }
    }
    assert!(wrong.is_empty(), "named in the documents, but not there:\n{}", wrong.join("\n"));
}

/// The text of `nims ARGS --help`.
fn help(args: &[&str]) -> String {
    let program = std::env::current_exe().unwrap().ancestors().nth(2).unwrap().join("nims");
    let output = Command::new(program).args(args).arg("--help").output().unwrap();
    String::from_utf8_lossy(&output.stdout).into_owned()
}

#[test]
fn every_command_and_option_exists() {
    let listed = help(&[]);
    let commands: BTreeSet<&str> = listed
        .lines()
        .filter_map(|line| line.strip_prefix("  ").filter(|rest| !rest.starts_with(' ')))
        .filter_map(|line| line.split_whitespace().next())
        .filter(|word| !word.starts_with('-'))
        .collect();
    assert!(commands.contains("status") && commands.contains("paper"), "nims --help lists {commands:?}");
    let (mut wrong, mut helps) = (Vec::new(), BTreeMap::new());
    for (document, text) in documents() {
        let name = document.strip_prefix(root()).unwrap().display().to_string();
        for span in code(&text) {
            let line = span.split(" #").next().unwrap_or_default().replace("target/debug/nims ", "nims ");
            let Some((before, call)) = line.split_once("nims ") else { continue };
            if !(before.is_empty() || before.ends_with(' ')) {
                continue;
            }
            let mut words = call.split_whitespace().skip_while(|word| *word == "nims").peekable();
            if words.peek() == Some(&"--domain") {
                words.nth(1);
            }
            let Some(command) = words.next().filter(|word| word.starts_with(|one: char| one.is_ascii_lowercase()))
            else {
                continue;
            };
            // Listed where it is built, apart from the other programs.
            if command == "page" && !commands.contains(command) {
                continue;
            }
            if !commands.contains(command) {
                wrong.push(format!("{name}: nims {command} ({span})"));
                continue;
            }
            let known = helps.entry(command.to_owned()).or_insert_with(|| help(&[command]));
            let own = words.take_while(|word| *word != "--").filter(|word| word.starts_with("--"));
            for option in own.map(|word| word.trim_end_matches(|one: char| !one.is_ascii_lowercase())) {
                if !known.contains(option) {
                    wrong.push(format!("{name}: nims {command} {option}"));
                }
            }
        }
    }
    assert!(helps.len() > 20, "this test finds only {:?}", helps.keys());
    assert!(wrong.is_empty(), "named in the documents, but not known to nims:\n{}", wrong.join("\n"));
}

#[test]
fn the_code_map_has_every_crate() {
    let text = std::fs::read_to_string(root().join("ARCHITECTURE.md")).unwrap();
    let map = text.split("## Code map").nth(1).and_then(|rest| rest.split("\n## ").next()).expect("a code map");
    let within = |folder: &str| -> Vec<String> {
        let entries = std::fs::read_dir(root().join(folder)).unwrap().map(|entry| entry.unwrap());
        let folders = entries.filter(|entry| entry.path().is_dir());
        folders.map(|entry| format!("{folder}/{}", entry.file_name().to_string_lossy())).collect()
    };
    let mut crates = within("services");
    crates.extend(within("shared").iter().flat_map(|group| within(group)));
    for one in &crates {
        assert!(map.contains(&format!("| `{one}`")), "the code map of ARCHITECTURE.md has no line for {one}");
    }
    for row in map.lines().filter(|line| line.starts_with("| `")) {
        let cells: Vec<&str> = row.split('|').collect();
        let place = root().join(cells[1].trim().trim_matches('`'));
        for file in cells[3].split('`').skip(1).step_by(2) {
            let there =
                [place.join("src").join(file), place.join(file), root().join(file)].iter().any(|path| path.exists());
            assert!(there, "the code map sends the reader of {} to {file}, which is not there", place.display());
        }
    }
}
