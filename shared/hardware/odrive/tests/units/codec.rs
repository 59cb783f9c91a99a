//! The codec against lines that the firmware's source and documents give.

use odrive::codec::{Flaw, Line, MARKS, checksum, feedback, mark, number, seal, unseal};
use proptest::prelude::*;

#[test]
fn lines_are_those_of_the_firmwares_documents() {
    for (line, text) in [
        (Line::Feedback(0), "f 0*118"),
        (Line::Velocity(0, 150_000), "v 0 1.50000 0*124"),
        (Line::Velocity(1, -1_234), "v 1 -0.01234 0*80"),
        (Line::Feed(0), "u 0*101"),
        (Line::ClearErrors, "sc*16"),
        (Line::Mark(73_451), "f 73451*118"),
        (Line::ReadBoard("vbus_voltage"), "r vbus_voltage*93"),
        (Line::Write(0, "requested_state", 8), "w axis0.requested_state 8*107"),
        (Line::WriteThousandths(1, "config.watchdog_timeout", 300), "w axis1.config.watchdog_timeout 0.300*64"),
    ] {
        let text_of = |text: &str| text.rsplit_once('*').unwrap().0.to_owned();
        assert_eq!(text_of(&line.encode()), text_of(text));
        assert_eq!(unseal(line.encode().as_bytes()), Ok((&*text_of(text), true)));
    }
    // The checksums of the reference: they cover every byte before the star, also a space.
    assert_eq!(checksum(b"f 0"), 118);
    assert_eq!(checksum(b"v 0 1.5"), 108);
    assert_eq!(checksum(b"r vbus_voltage "), 93);
    assert_eq!(checksum(b"24.087744"), 32);
    assert_eq!(checksum(b"1.250000 0.500000"), 35);
}

#[test]
fn answers_are_told_apart() {
    assert_eq!(unseal(b"1.250000 0.500000*35\r"), Ok(("1.250000 0.500000", true)));
    assert_eq!(unseal(b"1.250000 0.500000"), Ok(("1.250000 0.500000", false)));
    for wrong in [&b"24.087744*31"[..], b"24.087744*", b"24.087744*+32", b"24.087744*288", b"\xff*0"] {
        assert_eq!(unseal(wrong), Err(Flaw), "{}", String::from_utf8_lossy(wrong));
    }
    assert_eq!(feedback("1.250000 0.500000"), Some([1.25, 0.5]));
    assert_eq!(feedback("-0.000010 12.000000"), Some([-0.00001, 12.0]));
    for wrong in
        ["1.250000", "1.250000 0.50000", "nan 0.000000", "1.250000 inf", "1e5.000000 0.000000", "invalid motor 9"]
    {
        assert_eq!(feedback(wrong), None, "{wrong}");
    }
    assert_eq!((mark("invalid motor 9"), mark("invalid property"), mark("invalid motor -9")), (Some(9), None, None));
    assert_eq!((number("-21474836"), number("8"), number("unknown command")), (Some(-21_474_836.0), Some(8.0), None));
}

proptest! {
    #[test]
    fn a_velocity_is_written_exactly(axis in 0_usize..2, counts_s in any::<i32>()) {
        let text = Line::Velocity(axis, counts_s).encode();
        let (body, sealed) = unseal(text.as_bytes()).unwrap();
        let word = body.split(' ').nth(2).unwrap();
        let start = format!("v {axis} ");
        prop_assert!(sealed && body.starts_with(&start), "{}", body);
        prop_assert_eq!((number(word).unwrap() * 1e5).round() as i64, i64::from(counts_s));
    }

    #[test]
    fn a_changed_letter_is_found(at in 0_usize..20, bit in 0_u8..7) {
        let mut line = b"1.250000 0.500000*35".to_vec();
        line[at] ^= 1 << bit;
        let read = unseal(&line);
        // Where the star is gone there is no checksum, and the driver requires one.
        prop_assert!(!matches!(read, Ok((_, true))), "{:?}", String::from_utf8_lossy(&line));
    }

    #[test]
    fn no_bytes_end_the_program(bytes in prop::collection::vec(any::<u8>(), 0..120)) {
        if let Ok((text, _)) = unseal(&bytes) {
            let _ = (feedback(text), mark(text), number(text));
        }
    }

    #[test]
    fn marks_are_read_back(number in MARKS) {
        let mut answer = odrive::codec::Text::new();
        answer.push_str(&format!("invalid motor {number}"));
        let line = seal(answer);
        prop_assert_eq!(mark(unseal(line.as_bytes()).unwrap().0), Some(number));
    }
}
