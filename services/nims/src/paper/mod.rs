//! `nims paper`: every figure and table of the paper from this code, and what goes beyond it, on one page.
//!
//! Invariants:
//! * Nothing on the page depends on the clock, the machine or the order of computation: the same program writes the same
//!   bytes.
//! * A verdict is computed from the statements below it, and these from the numbers of the same run.

mod page;
mod random;
pub mod section;
mod stand_in;
mod tensions;

use crate::failure::{Answer, Failure};
use crate::picture;
use anyhow::Result;
use indicatif::{ProgressBar, ProgressStyle};
use section::{Effort, Section, Verdict};
use serde_json::{Value, json};
use std::path::Path;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

/// One entry of the page.
#[derive(Clone, Copy)]
pub struct Entry {
    /// Name on the command line.
    pub key: &'static str,
    /// Computes it.
    make: fn(Effort) -> Result<Section>,
    /// About how long it takes, s: the longest are begun first.
    seconds: f64,
}

const fn entry(key: &'static str, seconds: f64, make: fn(Effort) -> Result<Section>) -> Entry {
    Entry { key, make, seconds }
}

/// Everything there is, in the order of the page.
pub const ENTRIES: &[Entry] =
    &[entry("fig14", 0.1, tensions::fig14), entry("fig15", 0.1, tensions::fig15), entry("fig16", 0.1, tensions::fig16)];

/// The entries of these names; all of them if none is named.
///
/// # Errors
/// A name that is none.
pub fn entries(names: &[String]) -> Answer<Vec<Entry>> {
    if names.is_empty() {
        return Ok(ENTRIES.to_vec());
    }
    if let Some(name) = names.iter().find(|name| !ENTRIES.iter().any(|entry| entry.key == **name)) {
        let known: Vec<&str> = ENTRIES.iter().map(|entry| entry.key).collect();
        return Err(Failure::BadInput(format!("there is no figure {name}; accepted: {}", known.join(", "))));
    }
    Ok(ENTRIES.iter().filter(|entry| names.iter().any(|name| name == entry.key)).copied().collect())
}

/// Computes entries on all processors, in the order given.
///
/// # Errors
/// What an entry could not compute.
pub fn compute(entries: &[Entry], effort: Effort, progress: &ProgressBar) -> Answer<Vec<Section>> {
    let mut order: Vec<usize> = (0..entries.len()).collect();
    order.sort_by(|a, b| entries[*b].seconds.total_cmp(&entries[*a].seconds));
    let next = AtomicUsize::new(0);
    let done: Mutex<Vec<Option<Result<Section>>>> = Mutex::new(entries.iter().map(|_| None).collect());
    let work = || {
        while let Some(index) = order.get(next.fetch_add(1, Ordering::Relaxed)) {
            progress.set_message(entries[*index].key);
            let section = (entries[*index].make)(effort);
            progress.inc(1);
            if let Ok(mut done) = done.lock() {
                done[*index] = Some(section);
            }
        }
    };
    let threads = std::thread::available_parallelism().map_or(1, std::num::NonZero::get).min(entries.len());
    std::thread::scope(|scope| {
        for _ in 0..threads {
            scope.spawn(work);
        }
    });
    progress.finish_and_clear();
    let done = done.into_inner().map_err(|_| Failure::NotNow("a figure's computation ended early".to_owned()))?;
    entries
        .iter()
        .zip(done)
        .map(|(entry, section)| match section {
            Some(Ok(section)) => Ok(section),
            Some(Err(error)) => Err(Failure::NotNow(format!("{} could not be computed: {error:#}", entry.key))),
            None => Err(Failure::NotNow(format!("{} was not computed", entry.key))),
        })
        .collect()
}

/// Writes pictures and page.
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
            picture::save(&folder.join(page::stem(section, number)), drawn)?;
        }
    }
    for (name, text) in [("index.html", page::html(sections)), ("index.md", page::markdown(sections))] {
        let path = folder.join(name);
        std::fs::write(&path, text).map_err(|error| cannot(&path, error))?;
    }
    Ok(())
}

/// `nims paper`: computes, writes, and gives the verdicts.
///
/// # Errors
/// One sentence.
pub fn paper(names: &[String], folder: &Path) -> Answer<(Value, String)> {
    let entries = entries(names)?;
    // Hidden by itself where stderr is not a terminal.
    let progress = ProgressBar::new(entries.len() as u64);
    if let Ok(style) = ProgressStyle::with_template("{bar:30} {pos}/{len} {msg} {elapsed}") {
        progress.set_style(style);
    }
    let sections = compute(&entries, Effort::Full, &progress)?;
    write(folder, &sections)?;
    let verdicts: serde_json::Map<String, Value> =
        sections.iter().map(|section| (section.key.to_owned(), json!(Verdict::of(&section.checks).words()))).collect();
    let mut words: Vec<String> = sections
        .iter()
        .map(|section| format!("{:<10} {:<22} {}", section.key, Verdict::of(&section.checks).words(), section.title))
        .collect();
    let page = folder.join("index.html");
    words.push(format!("the page is {}", page.display()));
    Ok((json!({ "page": page, "verdicts": verdicts }), words.join("\n")))
}
