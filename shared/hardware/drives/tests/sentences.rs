//! The sentences of the crate, word for word: the only test that a change of wording concerns.

#![allow(clippy::unwrap_used)]

use std::sync::Arc;

use drives::{CommandName, DriveStatus, Error, InvalidConfig, reply_text};

fn errors() -> Vec<Error> {
    let port = || Arc::from("/dev/drives");
    let unit = || Arc::from("unit 0x81");
    let asked = CommandName { words: "read watchdog", code: Some(15) };
    let text = CommandName { words: "?C (read counts)", code: None };
    let mut all = vec![
        Error::NoAnswer { port: port(), unit: unit(), asked, waited_us: 1500 },
        Error::NoAnswer { port: port(), unit: unit(), asked: text, waited_us: 1500 },
        Error::CutShort { port: port(), unit: unit(), asked, got: 2, wanted: 6 },
        Error::Garbled { port: port(), unit: unit(), asked },
        Error::Unexpected {
            port: port(),
            unit: unit(),
            asked,
            said: reply_text(format_args!("{:#04x} instead of {:#04x}", 0x12, 0xff)),
        },
        Error::Unexpected {
            port: port(),
            unit: unit(),
            asked: text,
            said: reply_text(format_args!("{}", "-".repeat(99))),
        },
        Error::Stray { port: port(), unit: unit(), asked, bytes: 4 },
        Error::Resynchronising { port: port() },
        Error::Silent { port: port(), unit: unit() },
        Error::Echo { port: port(), unit: unit() },
        Error::Foreign { port: port(), unit: unit() },
        Error::Babble { port: port() },
        Error::Preparing { port: port(), unit: unit() },
        Error::Interlocked { port: port(), unit: unit() },
        Error::EncoderJump { port: port(), unit: unit(), axis: 1, counts: -70_000 },
        Error::WatchdogRefused { port: port(), unit: unit(), wanted_ms: 300, got_ms: 0 },
        Error::Unsupported { port: port(), unit: unit(), what: "torque command" },
        Error::TooLate { port: port() },
        Error::Unanswered { port: port() },
        Error::Busy { port: port() },
        Error::Serial(serial::Error::Missing { port: port() }),
    ];
    let misfits = [
        InvalidConfig::NoUnits,
        InvalidConfig::Address { given: 1, accepted: "128 to 135 (0x80 to 0x87)" },
        InvalidConfig::AddressTwice,
        InvalidConfig::Watchdog { given_ms: 0, accepted: "100 to 25500 ms in steps of 100" },
        InvalidConfig::Lacks("closed-loop velocity"),
        InvalidConfig::PortTwice,
        InvalidConfig::TooManyUnits,
        InvalidConfig::NoThread,
    ];
    all.extend(misfits.map(|what| Error::Configuration { port: port(), what }));
    all
}

/// The variant of an error without its fields, and what was wrong with a configuration.
fn name(error: &Error) -> String {
    let text = match error {
        Error::Configuration { what, .. } => format!("{what:?}"),
        other => format!("{other:?}"),
    };
    text.split([' ', '(']).next().unwrap().to_owned()
}

#[test]
fn the_sentences_are_those_of_the_file() {
    let statuses =
        (0..32).map(|bit| DriveStatus(1 << bit)).map(|status| (format!("{:#010x}", status.0), status.to_string()));
    let errors = errors().into_iter().map(|error| (name(&error), error.to_string()));
    let well = ("0".to_owned(), DriveStatus(0).to_string());
    sentences::compare(env!("CARGO_MANIFEST_DIR"), std::iter::once(well).chain(statuses).chain(errors));
}
