//! Compares all sentences of the crate with `sentences.txt`: the only test that depends on their wording.

#![allow(clippy::unwrap_used, clippy::expect_used)]

use std::fmt::{Debug, Display};
use std::io;
use std::path::PathBuf;

use messages::RecorderGap;
use runlog::*;

/// Pairs a sentence with the name of its variant, the innermost one where errors are nested.
fn named(kind: impl Debug, sentence: impl Display) -> (String, String) {
    (format!("{kind:?}").split([' ', '(']).next().unwrap().to_owned(), sentence.to_string())
}

#[test]
fn the_sentences_are_those_of_the_file() {
    let path = || PathBuf::from("/runs/one/run.mcap");
    let mut sentences = Vec::new();
    for error in [
        RunError::Io { path: path(), what: "open the run file", source: io::ErrorKind::NotFound.into() },
        RunError::Write { path: path(), why: "no space left on device".into() },
        RunError::Removed { path: path() },
        RunError::Busy { path: path() },
        RunError::NoRoom { path: path(), free_bytes: 600_000_000, needed_bytes: 2_500_000_000 },
        RunError::Size { channel: "motor/state".into(), got: 8, expected: 16 },
        RunError::Type { channel: "motor/state".into(), found: "a/A/1".into(), wanted: "b/B/2".into() },
    ] {
        sentences.push(named(&error, &error));
    }
    for what in [
        NotARunReason::NoFiles,
        NotARunReason::NotRegular,
        NotARunReason::Name,
        NotARunReason::RecoveredBefore { beside: "/runs/one/run-recovered.mcap".into() },
        NotARunReason::Empty,
        NotARunReason::NotMcap,
        NotARunReason::NoSamples,
        NotARunReason::NoChannel {
            wanted: vec!["motor/*".into()],
            there: vec!["truth/node".into(), "node/estimate".into()],
        },
        NotARunReason::NoSampleThen,
    ] {
        sentences.push(named(&what, RunError::NotARun { path: path(), what: what.clone() }));
    }
    for refusal in [
        SchemaRefusal::TypeName("wind".into()),
        SchemaRefusal::NoDefinition,
        SchemaRefusal::Schema(messages::schema::Schema::parse("string x\n").unwrap_err()),
        SchemaRefusal::Size { described: 9, sample: 16 },
    ] {
        sentences.push(named(&refusal, &refusal));
    }
    for finding in [
        Finding::Silent { path: path(), silent_s: 60 },
        Finding::Recording { path: path() },
        Finding::Damaged { path: path(), places: 2 },
        Finding::NotClosed { path: path() },
        Finding::Recovered { path: path(), lack: MissingData::NotOnDisk },
        Finding::Recovered { path: path(), lack: MissingData::Unknown },
        Finding::Recovered { path: path(), lack: MissingData::Nothing },
        Finding::Unrecorded { seconds: 1.25 },
        Finding::Lost { channel: "motor/state".into(), samples: 4, gaps: 2 },
        Finding::Orphaned { samples: 3 },
        Finding::NoSamples,
    ] {
        sentences.push(named(&finding, &finding));
    }
    for cause in [RecorderGap::CAUSE_OVERFLOW, RecorderGap::CAUSE_DISK_FULL, RecorderGap::CAUSE_FAILED] {
        sentences.push((format!("cause {cause}"), cause_phrase(cause).to_owned()));
    }
    sentences::compare(env!("CARGO_MANIFEST_DIR"), sentences);
}
