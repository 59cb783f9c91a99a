//! Samples on slots that are not in charge change no bit of the commands to the drives.

use crate::rig;

use messages::{CABLES, Header, MotorCommand, NodeEstimate, Request};
use proptest::prelude::*;
use rig::Rig;

/// Requests to the robot, and the answers of the rig's controller.
#[derive(Debug, Clone)]
enum Event {
    Ask(Request),
    Controller([f64; 3]),
    Offer(f64),
    Gap(u64),
    Steps(u32),
}

fn event() -> impl Strategy<Value = Event> {
    let plain = prop_oneof![
        Just(Request::Pause),
        Just(Request::Resume),
        Just(Request::Stop),
        Just(Request::Reset),
        Just(Request::Arm),
        Just(Request::Estop)
    ];
    prop_oneof![
        6 => (1..60u32).prop_map(Event::Steps),
        1 => plain.prop_map(Event::Ask),
        1 => (0.1..1.0f64).prop_map(|rate| Event::Ask(Request::Speed { rate })),
        1 => (1..4u8, -0.1..0.1f64).prop_map(|(cable, distance_m)| Event::Ask(Request::Jog { cable, distance_m })),
        4 => prop::array::uniform3(-0.3..0.3f64).prop_map(Event::Controller),
        3 => (0.1..20.0f64).prop_map(Event::Offer),
        1 => (0..200u64).prop_map(Event::Gap),
    ]
}

/// Header of a foreign process: of this life and near this cycle, or arbitrary.
fn header() -> impl Strategy<Value = (u64, Option<u64>, u64)> {
    let life = prop_oneof![6 => Just(0_u64), 1 => Just(u64::MAX), 1 => any::<u64>()];
    // `None`: the very cycle that is answered.
    let cycle = prop_oneof![
        6 => Just(None), 2 => (0..2000_u64).prop_map(Some), 1 => Just(Some(1 << 63)), 1 => Just(Some(u64::MAX))
    ];
    (life, cycle, any::<u64>())
}

fn number() -> impl Strategy<Value = f64> {
    prop_oneof![8 => -1.0..1.0f64, 1 => Just(f64::NAN), 1 => Just(f64::INFINITY), 1 => Just(-1e300)]
}

type Stranger = ((u64, Option<u64>, u64), [f64; 3], u8, u32, u32);

/// For each cycle perhaps a command, perhaps an estimate.
fn foreign_instance() -> impl Strategy<Value = (Option<Stranger>, Option<Stranger>)> {
    let flag = || prop_oneof![6 => Just(1_u8), 1 => any::<u8>()];
    let sample = || (header(), prop::array::uniform3(number()), flag(), 0..3_u32, 0..4_u32);
    (prop::option::weighted(0.7, sample()), prop::option::weighted(0.7, sample()))
}

fn whisper(rig: &mut Rig, (command, estimate): &(Option<Stranger>, Option<Stranger>)) {
    let of = |&(life, cycle, stamp_ns): &(u64, Option<u64>, u64), now: u64| Header {
        life,
        cycle: cycle.unwrap_or(now),
        stamp_ns,
        ..Header::default()
    };
    let epoch = rig.seen().authority.epoch;
    if let Some((header, values, valid, incarnation, segment)) = command {
        let header = of(header, rig.cycle);
        let mut command = MotorCommand {
            header,
            based_on_cycle: header.cycle,
            epoch: epoch + (incarnation / 2),
            incarnation: *incarnation,
            segment: rig.motion.current.id + segment / 3,
            ttl_cycles: u32::from(*valid),
            valid: [*valid; 2],
            ..MotorCommand::default()
        };
        for row in 0..2 {
            command.velocity_m_s[row * CABLES..][..3].copy_from_slice(values);
        }
        rig.inbox.command(1, &command);
    }
    if let Some((header, values, valid, incarnation, _)) = estimate {
        let header = of(header, rig.cycle);
        let (position_m, tension_n) = (*values, [values[0] * 100.0; CABLES]);
        let estimate = NodeEstimate {
            header,
            position_m,
            tension_n,
            valid: *valid,
            incarnation: *incarnation,
            ..NodeEstimate::default()
        };
        rig.inbox.estimate(1, &estimate);
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, failure_persistence: None, ..ProptestConfig::default() })]
    #[test]
    fn an_unqualified_process_in_a_free_slot_changes_nothing(
        events in prop::collection::vec(event(), 10..60),
        strangers in prop::collection::vec(foreign_instance(), 1..200),
    ) {
        let (mut alone, mut beside) = (Rig::default().ready(), Rig::default().ready());
        let mut turn = 0;
        for event in events {
            let (mut steps, mut gap_ns) = (1, 0);
            for rig in [&mut alone, &mut beside] {
                match &event {
                    Event::Ask(request) => prop_assert!(rig.inbox.request(1, &request.body())),
                    Event::Controller([a, b, c]) => rig.controller = Some([*a, *b, *c, 0.0, 0.0, 0.0, 0.0, 0.0]),
                    Event::Offer(seconds) => rig.offer(*seconds),
                    Event::Gap(ms) => gap_ns = ms * 1_000_000,
                    Event::Steps(count) => steps = *count,
                }
            }
            for step in 0..steps {
                whisper(&mut beside, &strangers[turn % strangers.len()]);
                turn += 1;
                let gap_ns = if step == 0 { gap_ns as i64 } else { 0 };
                let expected = alone.step_after(gap_ns, 50_000).clone();
                let now = beside.step_after(gap_ns, 50_000);
                prop_assert_eq!(now.sent.speed_m_s.map(f64::to_bits), expected.sent.speed_m_s.map(f64::to_bits));
                prop_assert_eq!(now.sent.released, expected.sent.released);
                prop_assert_eq!(now.seen.authority.mode, expected.seen.authority.mode);
                prop_assert_eq!(now.seen.authority.faults, expected.seen.authority.faults);
                prop_assert_eq!(now.seen.authority.in_charge, [0, 0]);
                prop_assert_eq!(&now.answers, &expected.answers);
            }
        }
    }
}
