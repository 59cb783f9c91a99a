//! Requests: what is encoded is decoded, and no bytes make decoding panic.

use bytemuck::Zeroable;
use messages::*;
use proptest::collection::vec;
use proptest::prelude::*;

fn number() -> impl Strategy<Value = f64> {
    prop_oneof![any::<f64>(), Just(0.0), Just(-0.0), Just(f64::INFINITY)]
        .prop_filter("equal to itself", |x| !x.is_nan())
}

fn point() -> impl Strategy<Value = [f64; 3]> {
    [number(), number(), number()]
}

/// A text without a zero, which ends a text.
fn text(most: usize) -> impl Strategy<Value = String> {
    vec(any::<char>().prop_filter("no zero", |c| *c != '\0'), 0..most / 4).prop_map(String::from_iter)
}

/// A text without a line break, which separates arguments.
fn words(most: usize) -> impl Strategy<Value = String> {
    text(most).prop_map(|text| text.replace('\n', " "))
}

fn role() -> impl Strategy<Value = SlotRole> {
    prop::sample::select(&SlotRole::ALL)
}

fn slot() -> impl Strategy<Value = Slot> {
    prop::sample::select(&Slot::ALL)
}

fn path() -> impl Strategy<Value = GotoPath> {
    prop_oneof![
        Just(GotoPath::Line),
        Just(GotoPath::Lateral),
        prop::option::of(number()).prop_map(|mu_per_m| GotoPath::Parabola { mu_per_m }),
    ]
}

/// Every variant; the order is that of [`Request`].
fn request() -> impl Strategy<Value = Request> {
    let plain = [
        Request::Arm,
        Request::Disarm,
        Request::Hold,
        Request::Stop,
        Request::Estop,
        Request::Reset,
        Request::ConfirmPosition,
        Request::Soft,
        Request::Pause,
        Request::Resume,
    ];
    let motor = prop_oneof![
        prop::sample::select(plain.to_vec()),
        point().prop_map(|position_m| Request::ZeroAt { position_m }),
        vec(number(), 0..=CABLES)
            .prop_map(|lengths_m| Request::ZeroLengths { lengths_m: lengths_m.into_iter().collect() }),
        (any::<u8>(), number()).prop_map(|(cable, distance_m)| Request::Jog { cable, distance_m }),
        number().prop_map(|rate| Request::Speed { rate }),
        (role(), slot()).prop_map(|(role, slot)| Request::Swap { role, slot }),
        (role(), slot()).prop_map(|(role, slot)| Request::Admit { role, slot }),
    ];
    let planner = prop_oneof![
        (point(), path(), prop::option::of(number())).prop_map(|(to_m, path, speed_m_s)| Request::Goto {
            to_m,
            path,
            speed_m_s
        }),
        (text(128), any::<[u8; 32]>(), any::<bool>()).prop_map(|(mission, hash, continues)| Request::Run {
            mission,
            hash,
            continues
        }),
        text(512).prop_map(|text| Request::Fault { text }),
    ];
    let supervisor = prop_oneof![
        (text(128), prop::option::of(slot()), prop::option::of(text(512)))
            .prop_map(|(name, slot, law)| Request::StartProcess { name, slot, law }),
        text(128).prop_map(|name| Request::StopProcess { name }),
        text(128).prop_map(|name| Request::RestartProcess { name }),
        (text(128), words(120), vec(words(40), 0..9), any::<bool>())
            .prop_map(|(name, folder, command, replace)| Request::Plug { name, folder, command, replace }),
        text(128).prop_map(|name| Request::Unplug { name }),
        (text(128), text(512)).prop_map(|(key, value)| Request::Set { key, value }),
        text(512).prop_map(|text| Request::Mark { text }),
    ];
    prop_oneof![motor, planner, supervisor]
}

/// The numbers of a request that may be out of the range of JSON.
fn numbers_of(request: &Request) -> Vec<f64> {
    match request {
        Request::ZeroAt { position_m } => position_m.to_vec(),
        Request::ZeroLengths { lengths_m } => lengths_m.to_vec(),
        Request::Jog { distance_m, .. } => vec![*distance_m],
        Request::Speed { rate } => vec![*rate],
        Request::Goto { to_m, path, speed_m_s } => {
            let mu_per_m = if let GotoPath::Parabola { mu_per_m } = path { *mu_per_m } else { None };
            to_m.iter().copied().chain(mu_per_m).chain(*speed_m_s).collect()
        }
        _ => Vec::new(),
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 2000, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn what_is_encoded_is_decoded(request in request()) {
        let sample = request.encode().unwrap();
        prop_assert_eq!(Request::decode(&sample).unwrap(), request.clone());
        prop_assert_eq!(sample.body, request.body());
        // Without its texts a request is of the same verb.
        prop_assert_eq!(Request::from_body(&sample.body).unwrap().verb(), request.verb());
    }

    /// JSON has no NaN and no infinity: such a request is not readable, instead of another one.
    #[test]
    fn a_request_is_the_same_after_json(request in request()) {
        let read = serde_json::from_str::<Request>(&serde_json::to_string(&request).unwrap());
        if numbers_of(&request).iter().all(|number| number.is_finite()) {
            prop_assert_eq!(read.unwrap(), request);
        } else if let Ok(read) = read {
            // Where a number may be left out, none stands for one that JSON cannot hold.
            let is_goto = matches!(read, Request::Goto { .. });
            prop_assert!(is_goto, "{:?}", read);
        }
    }

    /// And what is decoded from any bytes is a request that travels unchanged from then on.
    #[test]
    fn no_bytes_are_a_panic(bytes in vec(any::<u8>(), size_of::<OperatorRequest>()), verb in 0..50_u8, small in any::<bool>()) {
        let mut sample = OperatorRequest::zeroed();
        bytemuck::bytes_of_mut(&mut sample).copy_from_slice(&bytes);
        let _ = Request::decode(&sample);
        sample.body.verb = verb;
        if small {
            let body = &mut sample.body;
            for choice in [&mut body.slot, &mut body.slot_role, &mut body.path, &mut body.cable_count] {
                *choice %= 4;
            }
            (sample.name, sample.text) = ([b'x'; 128], [b'y'; 512]);
        }
        if let Ok(request) = Request::decode(&sample)
            && let Ok(again) = request.encode()
        {
            let twice = Request::decode(&again).unwrap().encode().unwrap();
            prop_assert_eq!(bytemuck::bytes_of(&twice), bytemuck::bytes_of(&again));
        }
        let _ = Request::from_body(&sample.body);
    }
}

#[test]
fn numbers_that_are_none_travel_unchanged() {
    let request = Request::ZeroAt { position_m: [f64::NAN, f64::from_bits(0x7ff8_0000_dead_beef), 0.0] };
    let again = Request::decode(&request.encode().unwrap()).unwrap();
    assert_eq!(bytemuck::bytes_of(&again.body()), bytemuck::bytes_of(&request.body()));
}

#[test]
fn texts_that_do_not_fit_are_refused_and_not_cut() {
    let plug = |argument: String| Request::Plug {
        name: "wind".to_owned(),
        folder: "/".to_owned(),
        command: vec!["sh".to_owned(), argument],
        replace: false,
    };
    assert!(matches!(plug("a\nb".to_owned()).encode(), Err(EncodeError::Separator { .. })));
    assert!(plug("x".repeat(600)).encode().unwrap_err().to_string().contains("512"));
    assert!(plug("x".repeat(500)).encode().is_ok());
    assert!(Request::Unplug { name: "a\0b".to_owned() }.encode().is_err());
    assert!(Request::Unplug { name: "x".repeat(129) }.encode().is_err());
}

#[test]
fn choices_without_a_meaning_are_named() {
    let mut sample = Request::Swap { role: SlotRole::Estimator, slot: Slot::B }.encode().unwrap();
    sample.body.slot = RequestBody::SLOT_ANY;
    assert_eq!(
        Request::decode(&sample),
        Err(DecodeError::Field { verb: RequestBody::VERB_SWAP, field: "slot", value: 2 })
    );
    sample.body.verb = 0;
    assert_eq!(Request::decode(&sample), Err(DecodeError::Verb(0)));
    let mut sample = Request::ZeroLengths { lengths_m: [1.0; CABLES].into() }.encode().unwrap();
    sample.body.cable_count = 9;
    assert_eq!(
        Request::decode(&sample),
        Err(DecodeError::Field { verb: RequestBody::VERB_ZERO_LENGTHS, field: "cable_count", value: 9 })
    );
    let mut sample = Request::StopProcess { name: "recorder".to_owned() }.encode().unwrap();
    sample.name[2] = 0xff;
    assert!(matches!(Request::decode(&sample), Err(DecodeError::Text { field: "name", .. })));
}
