//! Frames and calls: what is encoded is decoded, in any pieces; no bytes make a decoder panic or grow without bound.

#![allow(clippy::unwrap_used)]

use gateway_protocol::*;
use messages::{Request, RequestAnswer, Slot, SlotRole};
use proptest::collection::vec;
use proptest::prelude::*;

const SMALL: Limits = Limits { header: 64, body: 256 };

fn frames() -> impl Strategy<Value = Vec<Frame>> {
    let frame = (vec(any::<u8>(), 0..=SMALL.header), vec(any::<u8>(), 0..=SMALL.body))
        .prop_map(|(header, body)| Frame { header, body });
    vec(frame, 0..6)
}

/// Feeds pieces of these lengths, and collects what comes out.
fn fed(decoder: &mut Decoder, mut bytes: &[u8], pieces: &[usize]) -> Result<Vec<Frame>, FrameError> {
    let (mut frames, mut pieces) = (Vec::new(), pieces.iter().cycle());
    while !bytes.is_empty() {
        let (piece, rest) = bytes.split_at((*pieces.next().unwrap()).clamp(1, bytes.len()));
        decoder.push(piece);
        while let Some(frame) = decoder.next_frame()? {
            frames.push(frame);
        }
        bytes = rest;
    }
    Ok(frames)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 2000, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn frames_arrive_whole_in_whatever_pieces(frames in frames(), pieces in vec(1..40_usize, 1..8)) {
        let bytes: Vec<u8> = frames.iter().flat_map(|frame| encode(&frame.header, &frame.body)).collect();
        let mut decoder = Decoder::new(SMALL);
        prop_assert_eq!(fed(&mut decoder, &bytes, &pieces).unwrap(), frames);
        prop_assert_eq!(decoder.waiting(), 0);
    }

    #[test]
    fn no_bytes_panic_or_fill_the_memory(bytes in vec(any::<u8>(), 0..4000), pieces in vec(1..300_usize, 1..8)) {
        let mut decoder = Decoder::new(SMALL);
        let _ = fed(&mut decoder, &bytes, &pieces);
        // One frame and the last piece, at most, unless the frame was refused: then the connection is closed.
        if decoder.next_frame().is_ok() {
            prop_assert!(decoder.waiting() <= 8 + SMALL.header + SMALL.body);
        }
        let _ = (Call::read(&bytes), Reply::read(&bytes));
    }

    #[test]
    fn a_frame_beyond_the_limits_is_refused_by_its_first_bytes(more in 1..1000_u32, of_body in any::<bool>()) {
        let (header, body) = if of_body { (3, SMALL.body as u32 + more) } else { (SMALL.header as u32 + more, 3) };
        let mut decoder = Decoder::new(SMALL);
        decoder.push(&[header.to_le_bytes(), body.to_le_bytes()].concat());
        prop_assert!(decoder.next_frame().is_err());
    }

    #[test]
    fn an_answer_is_the_same_after_its_travel(
        (accepted, reason) in (0..3_u8, any::<u16>()),
        number in any::<[u64; 6]>(),
        value in any::<[f64; 6]>(),
        (sentence, detail) in ("[ -~äß]{0,200}", "[ -~äß]{0,200}"),
    ) {
        let mut answer = RequestAnswer { accepted, reason, number, value, ..RequestAnswer::default() };
        // JSON holds no infinity; it stands for the same as NaN: no number.
        answer.value = answer.value.map(|value| if value.is_finite() { value } else { f64::NAN });
        messages::put_text(&mut answer.text, &sentence);
        messages::put_text(&mut answer.detail, &detail);
        let read = Reply::read(&Reply::answer(7, &answer).header()).unwrap();
        prop_assert_eq!(read.id(), 7);
        prop_assert_eq!(read.request_answer().unwrap(), answer);
    }
}

#[test]
fn every_call_is_read_as_it_was_written() {
    let (run, file) = ("2026-01-01".to_owned(), "log/motor-io.txt".to_owned());
    let calls = [
        Call::Hello { version: VERSION, origin: Origin::Page, token: Some("x".to_owned()), from: None },
        Call::Ask {
            id: 1,
            request: Request::Swap { role: SlotRole::Estimator, slot: Slot::B },
            process: None,
            held: false,
            at_ns: None,
            pressed_ns: None,
        },
        Call::Ask {
            id: 2,
            request: Request::Fault { text: "stall 2".to_owned() },
            process: Some("a".to_owned()),
            held: false,
            at_ns: None,
            pressed_ns: None,
        },
        Call::Ask {
            id: 3,
            request: Request::Jog { cable: 1, distance_m: 0.1 },
            process: None,
            held: true,
            at_ns: Some(7),
            pressed_ns: Some(5),
        },
        Call::Release { id: 4 },
        Call::Robot { id: 5 },
        Call::Configuration { id: 6 },
        Call::Channels { id: 7 },
        Call::Subscribe { id: 8, channel: "motor/state".to_owned(), rate_hz: Some(2.5) },
        Call::Unsubscribe { id: 9, subscription: 6 },
        Call::Runs { id: 10 },
        Call::Files { id: 11, run: run.clone() },
        Call::Open { id: 12, run, file },
        Call::TokenAdd { id: 13, name: "tablet".to_owned(), role: "stop".to_owned() },
        Call::TokenList { id: 14 },
        Call::TokenRevoke { id: 15, name: "tablet".to_owned() },
        Call::Seat { id: 16, what: SeatCall::Ask },
        Call::CodeAdd { id: 17, name: "tablet".to_owned(), role: "fly".to_owned() },
        Call::CodeUse { id: 18, code: "0128-7ZGZ".to_owned() },
        Call::Declare { id: 19, sensor: "soil".to_owned(), message: "Soil".to_owned() },
        Call::Sample { id: 20, sensor: "soil".to_owned(), stamp_ns: Some(5) },
        Call::Make { id: 21, run: "first".to_owned(), what: RunFiles::Parquet },
        Call::Remove { id: 22, run: "first".to_owned() },
        Call::Doctor { id: 23 },
        Call::RobotFile { id: 24, calibration_bytes: Some(7), made_from: Some("0a".repeat(32)) },
        Call::RobotFile { id: 25, calibration_bytes: None, made_from: None },
    ];
    for (number, call) in calls.iter().enumerate() {
        assert_eq!(Call::read(&call.header().unwrap()).unwrap(), *call);
        assert_eq!(call.id(), number as u64);
    }
    for at_ns in [None, Some(u64::MAX)] {
        let beat = Call::Beat { at_ns };
        assert_eq!((Call::read(&beat.header().unwrap()).unwrap(), beat.id()), (Call::Beat { at_ns }, 0));
    }
}

#[test]
fn a_number_that_json_cannot_hold_is_never_left_out() {
    let goto = |speed_m_s| Request::Goto { to_m: [1.0, 2.0, 0.1 + 0.2], path: messages::GotoPath::Line, speed_m_s };
    let call = |speed| Call::Ask {
        id: 1,
        request: goto(Some(speed)),
        process: None,
        held: false,
        at_ns: None,
        pressed_ns: None,
    };
    assert!(call(0.3).header().is_ok());
    for speed in [f64::NAN, f64::INFINITY] {
        assert!(call(speed).header().is_err());
    }
}

#[test]
fn a_misspelt_key_is_refused() {
    for header in [
        r#"{"call":"subscribe","id":1,"channel":"motor/state","rate":5}"#,
        r#"{"call":"ask","id":1,"request":{"verb":"jog","cable":1,"distance_m":0.1,"speed":1}}"#,
        r#"{"call":"fly","id":1}"#,
        "[]",
        "",
    ] {
        assert!(Call::read(header.as_bytes()).is_err(), "{header}");
    }
}
