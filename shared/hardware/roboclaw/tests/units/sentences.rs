//! What the crate says, word for word: the only test that a change of wording concerns.

use std::sync::Arc;

use roboclaw::codec::{Motor, Read, Write};
use roboclaw::{Command, Error, Misfit, Status};

fn errors() -> Vec<Error> {
    let port = || Arc::from("/dev/drives");
    let (address, command) = (0x81, Command::Read(Read::Watchdog));
    let mut all = vec![
        Error::NoAnswer { port: port(), address, command, waited_us: 1500 },
        Error::NoAnswer { port: port(), address, command: Command::Write(Write::Watchdog(3)), waited_us: 1500 },
        Error::CutShort { port: port(), address, command, got: 2, wanted: 6 },
        Error::Garbled { port: port(), address, command },
        Error::WrongAck { port: port(), address, command, byte: 0x12 },
        Error::Stray { port: port(), address, command, bytes: 4 },
        Error::Resynchronising { port: port() },
        Error::Silent { port: port(), address },
        Error::Echo { port: port(), address },
        Error::Gibberish { port: port(), address },
        Error::Babble { port: port() },
        Error::Preparing { port: port(), address },
        Error::Interlocked { port: port(), address },
        Error::EncoderJump { port: port(), address, motor: Motor::Two, counts: -70_000 },
        Error::WatchdogRefused { port: port(), address, wanted: 3, got: 0 },
        Error::TooLate { port: port() },
        Error::Unanswered { port: port() },
        Error::Busy { port: port() },
        Error::Line(serial::Error::Missing { port: port() }),
    ];
    all.extend(
        [
            Misfit::NoUnits,
            Misfit::Address,
            Misfit::AddressTwice,
            Misfit::NoWatchdog,
            Misfit::PortTwice,
            Misfit::TooManyUnits,
            Misfit::NoThread,
        ]
        .map(|what| Error::Configuration { port: port(), what }),
    );
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
        (0..32).map(|bit| Status(1 << bit)).map(|status| (format!("{:#010x}", status.0), status.to_string()));
    let errors = errors().into_iter().map(|error| (name(&error), error.to_string()));
    let well = ("0".to_owned(), Status(0).to_string());
    sentences::compare(env!("CARGO_MANIFEST_DIR"), std::iter::once(well).chain(statuses).chain(errors));
}
