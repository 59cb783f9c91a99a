//! `nims paper`: reproduces every figure and table of the paper and the improvements over it on one page.
//!
//! Invariants:
//! * Nothing on the page depends on the clock, the machine or the order of computation: the same program writes the
//!   same bytes.
//! * A verdict is computed from the statements below it, and these from the numbers of the same run.
#![forbid(unsafe_code)]

mod beyond;
mod calibration;
mod control;
mod energy;
mod flight;
mod mapping;
mod page;
pub mod random;
pub mod section;
mod stand_in;
mod tensions;

use command::{Answer, Failure, Output};

use anyhow::Result;
use indicatif::{ProgressBar, ProgressStyle};
use section::{Effort, Section, Verdict};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

/// A figure, table or improvement on the page.
#[derive(Clone, Copy)]
pub struct Entry {
    /// Name on the command line.
    pub key: &'static str,
    /// Function that computes it.
    make: fn(Effort) -> Result<Section>,
    /// Approximate duration, s; the longest entries start first.
    seconds: f64,
}

const fn entry(key: &'static str, seconds: f64, make: fn(Effort) -> Result<Section>) -> Entry {
    Entry { key, make, seconds }
}

/// All entries in the order of the page.
pub const ENTRIES: &[Entry] = &[
    entry("fig3", 3.0, calibration::fig3),
    entry("fig4", 3.0, calibration::fig4),
    entry("fig5", 3.0, calibration::fig5),
    entry("fig6", 1.0, calibration::fig6),
    entry("table2", 1.0, calibration::table2),
    entry("fig7", 20.0, control::fig7),
    entry("fig8", 20.0, control::fig8),
    entry("table3", 20.0, control::table3),
    entry("fig10", 60.0, mapping::fig10),
    entry("fig11", 10.0, energy::fig11),
    entry("fig12", 10.0, energy::fig12),
    entry("fig13", 10.0, energy::fig13),
    entry("table5", 10.0, energy::table5),
    entry("table8", 1.0, energy::table8),
    entry("fig14", 0.1, tensions::fig14),
    entry("fig15", 0.1, tensions::fig15),
    entry("fig16", 0.1, tensions::fig16),
    entry("placement", 2.0, beyond::placement),
    entry("joint", 10.0, beyond::joint),
    entry("stretch", 10.0, beyond::stretch),
    entry("preview", 40.0, beyond::preview),
    entry("lateral", 8.0, beyond::lateral),
];

/// Returns the entries with these names; all of them without names.
///
/// # Errors
/// An unknown name.
pub fn entries(names: &[String]) -> Answer<Vec<Entry>> {
    if names.is_empty() {
        return Ok(ENTRIES.to_vec());
    }
    if let Some(name) = names.iter().find(|name| !ENTRIES.iter().any(|entry| entry.key == **name)) {
        let known: Vec<&str> = ENTRIES.iter().map(|entry| entry.key).collect();
        return Err(Failure::BadInput(format!("figure is {name}; accepted: {}", known.join(", "))));
    }
    Ok(ENTRIES.iter().filter(|entry| names.iter().any(|name| name == entry.key)).copied().collect())
}

/// Computes entries on all processors and returns them in the given order.
///
/// # Errors
/// An entry that could not be computed.
pub fn compute(entries: &[Entry], effort: Effort, progress: &ProgressBar) -> Answer<Vec<Section>> {
    let mut order: Vec<usize> = (0..entries.len()).collect();
    order.sort_by(|a, b| entries[*b].seconds.total_cmp(&entries[*a].seconds));
    let done = command::parallel(&order, command::processors(), |&index| {
        progress.set_message(entries[index].key);
        let section = (entries[index].make)(effort);
        progress.inc(1);
        section
    });
    progress.finish_and_clear();
    let mut done: Vec<(usize, Result<Section>)> = order.into_iter().zip(done).collect();
    done.sort_unstable_by_key(|(index, _)| *index);
    let named = |(index, section): (usize, Result<Section>)| {
        section.map_err(|error| Failure::NotNow(format!("{} could not be computed: {error:#}", entries[index].key)))
    };
    done.into_iter().map(named).collect()
}

/// Writes the plots and the page.
///
/// # Errors
/// A file that cannot be written.
pub fn write(folder: &Path, sections: &[Section]) -> Answer {
    let cannot = |path: &Path, error: std::io::Error| {
        Failure::NotNow(format!("{} cannot be written: {error}; choose another folder with --out", path.display()))
    };
    std::fs::create_dir_all(folder).map_err(|error| cannot(folder, error))?;
    for section in sections {
        for (number, drawn) in section.pictures.iter().enumerate() {
            plot::save(&folder.join(page::stem(section, number)), drawn)?;
        }
    }
    for (name, text) in [("index.html", page::html(sections)), ("index.md", page::markdown(sections))] {
        let path = folder.join(name);
        std::fs::write(&path, text).map_err(|error| cannot(&path, error))?;
    }
    Ok(())
}

/// `nims paper`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Figures such as fig3 or table8; default: all.
    pub figures: Vec<String>,
    /// Folder for the page and its plots.
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
}

/// Computes the entries, writes the page and returns the verdicts.
///
/// # Errors
/// One sentence that the program prints.
pub fn run(args: &Args) -> Answer<Output> {
    let (entries, folder) = (entries(&args.figures)?, args.out.as_path());
    // Hidden automatically where stderr is not a terminal.
    let progress = ProgressBar::new(entries.len() as u64);
    if let Ok(style) = ProgressStyle::with_template("{bar:30} {pos}/{len} {msg} {elapsed}") {
        progress.set_style(style);
    }
    let sections = compute(&entries, Effort::Full, &progress)?;
    write(folder, &sections)?;
    let verdicts: serde_json::Map<String, Value> = sections
        .iter()
        .map(|section| (section.key.to_owned(), json!(Verdict::from_checks(&section.checks).text())))
        .collect();
    let mut words: Vec<String> = sections
        .iter()
        .map(|section| {
            format!("{:<10} {:<22} {}", section.key, Verdict::from_checks(&section.checks).text(), section.title)
        })
        .collect();
    let page = folder.join("index.html");
    words.push(format!("page: {}", page.display()));
    Ok(Output::new(json!({ "page": page, "verdicts": verdicts }), words.join("\n")))
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, clippy::expect_used)]
    use super::*;
    use std::collections::BTreeMap;

    fn files(folder: &Path) -> BTreeMap<String, Vec<u8>> {
        std::fs::read_dir(folder)
            .unwrap()
            .map(|entry| entry.unwrap().path())
            .map(|path| (path.file_name().unwrap().to_string_lossy().into_owned(), std::fs::read(&path).unwrap()))
            .collect()
    }

    /// Computes everything at a reduced size twice: each entry renders, and the page is identical byte for byte.
    #[test]
    fn every_figure_renders_and_repeats() {
        let folder = tempfile::tempdir().unwrap();
        let runs: Vec<_> = ["one", "two"]
            .map(|name| {
                let sections = compute(ENTRIES, Effort::Quick, &ProgressBar::hidden()).unwrap();
                write(&folder.path().join(name), &sections).unwrap();
                (sections, files(&folder.path().join(name)))
            })
            .into_iter()
            .collect();
        assert_eq!(runs[0].1, runs[1].1);
        let (sections, files) = &runs[0];
        for section in sections {
            assert!(!section.checks.is_empty() && !section.claim.is_empty() && !section.stand_in.is_empty());
            assert!(!section.tables.is_empty() || !section.pictures.is_empty(), "{} shows nothing", section.key);
            for number in 0..section.pictures.len() {
                for ending in ["svg", "png"] {
                    let name = format!("{}.{ending}", page::stem(section, number));
                    assert!(files.get(&name).is_some_and(|bytes| bytes.len() > 2000), "{name}");
                }
            }
            let words = Verdict::from_checks(&section.checks).text();
            let markdown = String::from_utf8(files["index.md"].clone()).unwrap();
            assert!(markdown.contains(&format!("## {}", section.title)) && markdown.contains(words));
        }
        assert_eq!(files.len(), 2 + 2 * sections.iter().map(|section| section.pictures.len()).sum::<usize>());
    }

    #[test]
    fn at_full_effort_every_claim_holds() {
        for section in compute(ENTRIES, Effort::Full, &ProgressBar::hidden()).unwrap() {
            for check in section.checks.iter().filter(|check| check.weight == section::Weight::Claim) {
                assert!(check.held, "{}: {}", section.key, check.statement);
            }
        }
    }

    #[test]
    fn the_verdict_on_the_page_follows_the_checks() {
        let mut section = (ENTRIES.iter().find(|entry| entry.key == "fig16").unwrap().make)(Effort::Quick).unwrap();
        assert!(page::html(&[section.clone()]).contains("class=\"verdict holds\""));
        section.checks[0].held = false;
        assert!(page::html(&[section.clone()]).contains("class=\"verdict not\""));
        section.checks[0].weight = section::Weight::Condition;
        assert!(page::html(&[section]).contains("class=\"verdict conditions\""));
    }

    #[test]
    fn an_unknown_name_lists_the_known_ones() {
        let error = entries(&["fig3".to_owned(), "fig99".to_owned()]).err().unwrap();
        assert!(error.to_string().contains("fig99") && error.to_string().contains("table8"));
        assert_eq!(error.exit_code(), 2);
        assert_eq!(entries(&["fig3".to_owned()]).unwrap().len(), 1);
        assert_eq!(entries(&[]).unwrap().len(), ENTRIES.len());
    }
}
