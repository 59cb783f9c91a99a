//! The codec against bytes that the maker documents, and that the maker's client sent or accepted.

use moteus::codec::{
    ADDRESSES, Checksums, Flaw, Frame, Line, MAX_FRAME, Resolution, Scale, Subframe, Value, crc8, frame_line,
    from_unit, padded, to_unit,
};
use proptest::prelude::*;

fn frame(hex: &str) -> Frame {
    let line = format!("rcv 0100 {hex}");
    match Line::parse(line.as_bytes(), Checksums::Absent) {
        Ok(Line::Received { frame, .. }) => frame,
        other => panic!("{other:?}"),
    }
}

fn text(verb: &str, identifier: u16, frame: &Frame, flags: &str) -> String {
    String::from_utf8(frame_line(verb, identifier, frame, flags, Checksums::Required).to_vec()).unwrap()
}

fn registers(frame: &Frame) -> Vec<Subframe> {
    frame.subframes().map(Result::unwrap).collect()
}

/// Lines that the maker's client sent to a pseudo-terminal, or accepted there, each with its checksum.
const LINES: [&str; 6] = [
    "can send 8001 11001F01130D BF *AD",
    "can send 8001 01000A0E200000C07F0000803F11001F01130D50 BF *A7",
    "can send 8001 01000011001F01130D BF *B2",
    "can send 8001 1970 BF *AD",
    "OK *BD",
    "rcv 0100 2404000a005000000170ff230d181400 E B F *CF",
];

#[test]
fn the_checksum_is_the_makers() {
    for line in LINES {
        let (body, sum) = line.split_at(line.len() - 3);
        assert_eq!(format!("*{:02X}", crc8(body.as_bytes())), sum, "{line}");
    }
    assert_eq!(crc8(b""), 0);
}

#[test]
fn frames_become_the_lines_that_the_makers_client_sends() {
    for line in &LINES[..4] {
        let hex = line.split(' ').nth(3).unwrap();
        assert_eq!(text("can send", 0x8001, &frame(hex), "BF"), *line);
    }
    assert_eq!((to_unit(1), from_unit(0x0100), from_unit(0x0500), from_unit(0x0501)), (0x8001, Some(1), Some(5), None));
}

#[test]
fn lines_of_adapters_are_read() {
    assert_eq!(Line::parse(b"OK *BD\r", Checksums::Required), Ok(Line::Sent));
    assert_eq!(Line::parse(b"OK", Checksums::Absent), Ok(Line::Sent));
    assert_eq!(Line::parse(b"OK", Checksums::Required), Err(Flaw::Checksum));
    assert_eq!(Line::parse(b"OK *BE", Checksums::Absent), Err(Flaw::Checksum));
    assert_eq!(Line::parse(b"ERR unknown command", Checksums::Absent), Ok(Line::Refused));
    assert_eq!(Line::parse(b"can send 8001 1970 BF *AD", Checksums::Required), Err(Flaw::Form), "an echo");
    let received = Line::parse(LINES[5].as_bytes(), Checksums::Required).unwrap();
    assert_eq!(received, Line::Received { identifier: 0x100, frame: frame("2404000a005000000170ff230d181400") });
}

/// The example of the maker's description of the protocol: mode 10, 0.008 turns, 0.064 turns per second, 12 V.
#[test]
fn the_makers_example_is_read() {
    use Subframe::{Read, Reply, Write};
    let answer = registers(&frame("2404000a005000000170ff230d181400"));
    let reply = |register, value| Reply { register, value };
    assert_eq!(
        answer,
        [
            reply(0, Value::I16(10)),
            reply(1, Value::I16(80)),
            reply(2, Value::I16(256)),
            reply(3, Value::I16(-144)),
            reply(0x0D, Value::I8(24)),
            reply(0x0E, Value::I8(20)),
            reply(0x0F, Value::I8(0)),
        ]
    );
    assert!((Scale::POSITION.decode(Value::I16(80)) - 0.008).abs() < 1e-6);
    assert!((Scale::VELOCITY.decode(Value::I16(256)) - 0.064).abs() < 1e-6);
    assert!((Scale::VOLTAGE.decode(Value::I8(24)) - 12.0).abs() < 1e-6);
    let question = registers(&frame("01000a07206000200150ff140400130d"));
    let write = |register, value| Write { register, value };
    let read = |register, resolution| Read { register, resolution };
    assert_eq!(question[..2], [write(0, Value::I8(10)), write(0x20, Value::I16(0x60))]);
    assert_eq!(question[2..4], [write(0x21, Value::I16(0x120)), write(0x22, Value::I16(-176))]);
    assert_eq!(question[4..8], [0, 1, 2, 3].map(|register| read(register, Resolution::I16)));
    assert_eq!(question[8..], [0x0D, 0x0E, 0x0F].map(|register| read(register, Resolution::I8)));
    // One turn per second from where the motor is, with floats.
    let velocity = registers(&frame("01000A0E200000C07F0000803F11001F01130D50"));
    assert!(matches!(velocity[1], Write { register: 0x20, value: Value::F32(position) } if position.is_nan()));
    assert_eq!(velocity[2], write(0x21, Value::F32(1.0)));
}

#[test]
fn a_frame_is_filled_up_to_a_length_of_can_fd() {
    let mut question = Frame::new();
    for (wanted, registers) in [(0, 0), (2, 1), (8, 4), (12, 5), (32, 16), (48, 17), (64, 32)] {
        while question.as_slice().len() < 2 * registers {
            question.read(0x10, Resolution::I8);
        }
        let filled = padded(question);
        assert_eq!(filled.as_slice().len(), wanted);
        assert_eq!(filled.subframes().count(), registers, "what fills up says nothing");
    }
}

#[test]
fn what_is_no_number_has_its_own_integer() {
    for (resolution, none) in [
        (Resolution::I8, Value::I8(-128)),
        (Resolution::I16, Value::I16(-32_768)),
        (Resolution::I32, Value::I32(i32::MIN)),
    ] {
        assert_eq!(Scale::POSITION.encode(f32::NAN, resolution), none);
        assert!(Scale::POSITION.decode(none).is_nan() && none.integer().is_none());
    }
    // The range ends without wrapping.
    assert_eq!(Scale::POSITION.encode(1e9, Resolution::I32), Value::I32(i32::MAX));
    assert_eq!(Scale::POSITION.encode(-1e9, Resolution::I32), Value::I32(-i32::MAX));
    assert_eq!(Scale::POSITION.encode(-1e9, Resolution::I16), Value::I16(-32_767));
}

fn value() -> impl Strategy<Value = Value> {
    prop_oneof![
        any::<i8>().prop_map(Value::I8),
        any::<i16>().prop_map(Value::I16),
        any::<i32>().prop_map(Value::I32),
        (-1e9_f32..1e9).prop_map(Value::F32),
    ]
}

fn resolution() -> impl Strategy<Value = Resolution> {
    prop_oneof![Just(Resolution::I8), Just(Resolution::I16), Just(Resolution::I32), Just(Resolution::F32)]
}

/// A subframe of any kind and register.
fn subframe() -> impl Strategy<Value = Subframe> {
    prop_oneof![
        (any::<u16>(), value()).prop_map(|(register, value)| Subframe::Write { register: register & 0x7FFF, value }),
        (any::<u16>(), resolution())
            .prop_map(|(register, resolution)| Subframe::Read { register: register & 0x7FFF, resolution }),
        (any::<u16>(), value()).prop_map(|(register, value)| Subframe::Reply { register: register & 0x7FFF, value }),
        (any::<u16>(), any::<u16>()).prop_map(|(register, code)| Subframe::Error { register, code }),
    ]
}

proptest! {
    #[test]
    fn a_frame_holds_what_was_put_into_it(subframes in prop::collection::vec(subframe(), 0..8)) {
        let mut frame = Frame::new();
        for &subframe in &subframes {
            match subframe {
                Subframe::Write { register, value } => frame.write(register, value),
                Subframe::Read { register, resolution } => frame.read(register, resolution),
                Subframe::Reply { register, value } => frame.reply(register, value),
                Subframe::Error { register, code } => frame.read_error(register, code),
            }
        }
        prop_assert_eq!(registers(&padded(frame)), subframes);
        for checksums in [Checksums::Required, Checksums::Absent] {
            let line = frame_line("rcv", 0x2A00, &frame, "E B F", checksums);
            let received = Line::parse(&line, checksums);
            if frame.as_slice().is_empty() {
                prop_assert_eq!(received, Err(Flaw::Form));
                continue;
            }
            prop_assert_eq!(received, Ok(Line::Received { identifier: 0x2A00, frame }));
        }
    }

    #[test]
    fn no_bytes_end_the_program(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
        let _ = Line::parse(&bytes, Checksums::Required);
        let _ = Line::parse(&bytes, Checksums::Absent);
        let hex: String = bytes.iter().take(MAX_FRAME).map(|byte| format!("{byte:02X}")).collect();
        if !hex.is_empty() {
            let frame = frame(&hex);
            prop_assert!(frame.subframes().take(1000).count() < 1000);
        }
    }

    #[test]
    fn a_changed_letter_is_found(position in 0_usize..54, bit in 0_u8..8) {
        let mut line = LINES[5].as_bytes().to_vec();
        let at = position % line.len();
        line[at] ^= 1 << bit;
        let parsed = Line::parse(&line, Checksums::Required);
        // A small letter for a large one in the checksum is the same number.
        let same = at >= line.len() - 2 && line.eq_ignore_ascii_case(LINES[5].as_bytes());
        prop_assert!(parsed.is_err() || same, "{:?} from {}", parsed, String::from_utf8_lossy(&line));
    }

    #[test]
    fn integers_are_the_nearest_steps_below(value in -20_000.0_f32..20_000.0) {
        let Value::I32(steps) = Scale::POSITION.encode(value, Resolution::I32) else { unreachable!() };
        let error = f64::from(steps) * 1e-5 - f64::from(value);
        prop_assert!(error.abs() <= 1.1e-5 + f64::from(value.abs()) * 3e-7, "{} steps for {}", steps, value);
    }

    #[test]
    fn identifiers_name_one_unit(address in ADDRESSES) {
        let [_, unit] = to_unit(address).to_be_bytes();
        prop_assert_eq!(from_unit(u16::from(unit) << 8), Some(address));
    }
}
