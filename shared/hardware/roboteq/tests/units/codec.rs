//! The codec against lines of the maker's manuals and of clients.

use proptest::prelude::*;
use roboteq::codec::{AXES, Answer, FULL_SPEED, Line, Name, numbers};

#[test]
fn lines_are_those_of_the_manuals_and_of_clients() {
    for (text, line) in [
        ("?A", Line::Ask(Name::Amps, None)),
        ("?V", Line::Ask(Name::Volts, None)),
        ("?FF", Line::Ask(Name::Faults, None)),
        ("?FM 1", Line::Ask(Name::MotorFaults, Some(1))),
        ("?FID", Line::Ask(Name::Firmware, None)),
        ("?TRN", Line::Ask(Name::Model, None)),
        ("?M", Line::Ask(Name::Applied, None)),
        ("?C", Line::Ask(Name::Counts, None)),
        ("?CIS", Line::Ask(Name::Command, None)),
        ("?VAR 1", Line::Ask(Name::Variable, Some(1))),
        ("!G 1 0", Line::Go(1, 0)),
        ("!S 2 100", Line::Speed(2, 100)),
        ("!M 200 -1000", Line::Motors([200, -1000])),
        ("!C 1 -5", Line::SetCounter(1, -5)),
        ("!VAR 1 101", Line::SetVariable(1, 101)),
        ("!EX", Line::Stop),
        ("!MG", Line::Resume),
        ("^ECHOF 1", Line::Set(Name::EchoOff, None, 1)),
        ("^RWD 300", Line::Set(Name::Watchdog, None, 300)),
        ("~RWD", Line::Ask(Name::Watchdog, None)),
        ("^MMOD 1 1", Line::Set(Name::Mode, Some(1), 1)),
        ("~MXRPM", Line::Ask(Name::MaxRpm, None)),
        ("# C", Line::ClearHistory),
        ("# 20", Line::Repeat(20)),
    ] {
        assert_eq!((line.encode().as_str(), Line::parse(text)), (text, Ok(line)));
    }
    assert_eq!(Line::parse(" !g  1  -5 "), Ok(Line::Go(1, -5)), "case and spaces do not matter");
    for wrong in
        ["", "!", "?", "!G", "!G 1", "!G 1 2 3", "!G 1 +2", "!X 1 2", "?RWD", "~C", "^C 1", "#", "C=1", "?C 999"]
    {
        assert!(Line::parse(wrong).is_err(), "{wrong}");
    }
}

#[test]
fn answers_are_those_of_the_manuals() {
    for (text, name, values) in [
        ("A=100:200", Name::Amps, &[100, 200][..]),
        ("V=135:246:4730", Name::Volts, &[135, 246, 4730]),
        ("FF=2", Name::Faults, &[2]),
        ("FM=6", Name::MotorFaults, &[6]),
        ("M=800:-1000", Name::Applied, &[800, -1000]),
        ("C=-2147483648:2147483647", Name::Counts, &[i32::MIN, i32::MAX]),
        ("VAR=101", Name::Variable, &[101]),
        ("MMOD=1:1", Name::Mode, &[1, 1]),
    ] {
        let answer = Answer::Numbers(name, numbers(values));
        assert_eq!((answer.to_string().as_str(), Answer::parse(text.as_bytes())), (text, Ok(answer)));
    }
    for (text, name) in [("FID=Roboteq v1.6 RCB500 05/01/2016", Name::Firmware), ("TRN=RCB500:HDC2460", Name::Model)] {
        let answer = Answer::Text(name, text.split_once('=').unwrap().1);
        assert_eq!((answer.to_string().as_str(), Answer::parse(text.as_bytes())), (text, Ok(answer)));
    }
    assert_eq!((Answer::parse(b"+"), Answer::parse(b"-")), (Ok(Answer::Accepted), Ok(Answer::Refused)));
    for wrong in [
        &b"C=1:+2"[..],
        b"C=01",
        b"C=-0",
        b"C=",
        b"C=1:",
        b"C=1:2:3:4",
        b"C=2147483648",
        b"c=1",
        b"C",
        b"=1",
        b"D=1",
        b"C=1 ",
        b"FID=",
        b"FID=\x01",
        b"\xff=1",
        b"++",
        b"",
    ] {
        assert!(Answer::parse(wrong).is_err(), "{}", String::from_utf8_lossy(wrong));
    }
}

/// A single changed bit turns no command of the driver into one that does something else than command.
#[test]
fn a_changed_bit_of_a_speed_sets_no_counter() {
    let becomes = |line: &str, wanted: u8| (0..8).any(|bit| line.as_bytes()[1] ^ (1 << bit) == wanted);
    // The reason for `!M`: the other two can become `!C`, which sets a counter.
    assert!(becomes("!G 1 0", b'C') && becomes("!S 1 0", b'C'));
    assert!(b"BCDHPRX".iter().all(|&other| !becomes(&Line::Motors([0; AXES]).encode(), other)));
}

fn any_line() -> impl Strategy<Value = Line> {
    let value = -FULL_SPEED..=FULL_SPEED;
    let name = (0..Name::ALL.len()).prop_map(|index| Name::ALL[index]);
    let setting = name.clone().prop_filter("a setting", |name| name.is_setting());
    prop_oneof![
        [value.clone(), value.clone()].prop_map(Line::Motors),
        (any::<u8>(), value).prop_map(|(channel, value)| Line::Go(channel, value)),
        (any::<u8>(), any::<i32>()).prop_map(|(channel, rpm)| Line::Speed(channel, rpm)),
        (any::<u8>(), any::<i32>()).prop_map(|(channel, value)| Line::SetCounter(channel, value)),
        (any::<u8>(), any::<i32>()).prop_map(|(variable, value)| Line::SetVariable(variable, value)),
        (name, any::<Option<u8>>()).prop_map(|(name, channel)| Line::Ask(name, channel)),
        (setting, any::<Option<u8>>(), any::<i32>()).prop_map(|(name, channel, value)| Line::Set(name, channel, value)),
        any::<u16>().prop_map(Line::Repeat),
        Just(Line::ClearHistory),
        Just(Line::Stop),
        Just(Line::Resume),
    ]
}

proptest! {
    #[test]
    fn a_line_is_read_as_it_was_written(line in any_line()) {
        prop_assert_eq!(Line::parse(&line.encode()), Ok(line));
    }

    #[test]
    fn an_answer_is_read_as_it_was_written(
        index in 0..Name::ALL.len(),
        values in prop::collection::vec(any::<i32>(), 1..=3),
    ) {
        let name = Name::ALL[index];
        prop_assume!(!name.is_text());
        let answer = Answer::Numbers(name, numbers(&values));
        let text = answer.to_string();
        prop_assert_eq!(Answer::parse(text.as_bytes()), Ok(answer));
    }

    #[test]
    fn no_bytes_end_the_program(bytes in prop::collection::vec(any::<u8>(), 0..120)) {
        let _ = Answer::parse(&bytes);
        let _ = Line::parse(&String::from_utf8_lossy(&bytes));
    }
}
