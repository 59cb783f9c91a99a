//! For arbitrary input in any order, limits hold, faults stay, every request is answered, and a replay gives the same
//! bytes.

use crate::rig;

use bytemuck::bytes_of;
use messages::faults::HARD;
use messages::{MotorAuthority as A, MotorInput, Request, RequestBody as R};
use motor_io::Core;
use proptest::prelude::*;
use rig::{Rig, Step};

#[derive(Debug, Clone)]
enum Event {
    Steps(u32),
    Ask(R),
    Controller(Option<[f64; 3]>),
    Offer(f64),
    Unit(usize, u8),
    Jump(usize, i64),
    Dead(usize, bool),
    Push(usize, f64, f64),
    Tension(usize, f64),
    Status(u32),
    Supply(f64),
    Gap(u64),
    Estimate(bool),
    Planner(bool),
    Restart,
}

fn number() -> impl Strategy<Value = f64> {
    prop_oneof![
        8 => -6.0..6.0f64,
        1 => prop_oneof![Just(f64::NAN), Just(f64::INFINITY), Just(f64::NEG_INFINITY), Just(0.0), Just(1e300), Just(-0.0)]
    ]
}

fn velocity() -> impl Strategy<Value = f64> {
    prop_oneof![12 => -0.5..0.5f64, 1 => -20.0..20.0f64, 1 => Just(f64::NAN)]
}

fn event() -> impl Strategy<Value = Event> {
    let verbs = prop_oneof![
        4 => Just(R::VERB_ARM), 2 => Just(R::VERB_RESET), 2 => Just(R::VERB_RESUME), 1 => 0..40u8,
        2 => Just(R::VERB_JOG), 1 => Just(R::VERB_SOFT), 1 => Just(R::VERB_PAUSE), 1 => Just(R::VERB_CONFIRM), 1 => Just(R::VERB_SPEED),
    ];
    prop_oneof![
        6 => (1..40u32).prop_map(Event::Steps),
        5 => (verbs, prop::array::uniform3(number())).prop_map(|(verb, numbers)| Event::Ask(rig::body(verb, numbers))),
        2 => Just(Event::Ask(rig::lengths([5.0, 6.0, 7.0]).body())),
        2 => (1..4u8, -1.0..1.0f64).prop_map(|(cable, distance_m)| Event::Ask(Request::Jog { cable, distance_m }.body())),
        4 => prop::option::weighted(0.9, prop::array::uniform3(velocity())).prop_map(Event::Controller),
        5 => (0.1..20.0f64).prop_map(Event::Offer),
        1 => (0..2usize, 0..5u8).prop_map(|(unit, state)| Event::Unit(unit, state)),
        2 => (0..2usize).prop_map(|unit| Event::Unit(unit, MotorInput::UNIT_OK)),
        1 => (0..3usize, -100_000..100_000i64).prop_map(|(cable, counts)| Event::Jump(cable, counts)),
        1 => (0..3usize, any::<bool>()).prop_map(|(cable, dead)| Event::Dead(cable, dead)),
        1 => (0..3usize, -1.0..1.0f64, number()).prop_map(|(cable, duty, amps)| Event::Push(cable, duty, amps)),
        1 => (0..3usize, -10.0..100.0f64).prop_map(|(cable, n)| Event::Tension(cable, n)),
        1 => prop_oneof![3 => Just(0), 1 => any::<u32>()].prop_map(Event::Status),
        1 => prop_oneof![3 => Just(12.0), 1 => number()].prop_map(Event::Supply),
        1 => prop_oneof![(0..250u64), (250..2000u64)].prop_map(Event::Gap),
        1 => any::<bool>().prop_map(Event::Estimate),
        1 => any::<bool>().prop_map(Event::Planner),
        1 => Just(Event::Restart),
    ]
}

/// Checks one step against the one before.
fn check(config: &motor_io::CoreConfig, before: Option<&Step>, now: &Step, asked: bool) -> Result<(), TestCaseError> {
    let (authority, state, v) = (&now.seen.authority, &now.seen.state, &now.sent.speed_m_s);
    let mode = authority.mode;
    // All outputs are finite.
    prop_assert!(
        v.iter().chain(&state.length_m).chain(&state.velocity_m_s).chain(&state.command_m_s).all(|x| x.is_finite())
    );
    prop_assert!(state.current_a.iter().chain(&state.duty).chain(&state.supply_v).all(|x| x.is_finite()));
    prop_assert!(
        [authority.plan_time_s, authority.plan_rate, authority.plan_rate_target, authority.scale]
            .iter()
            .all(|x| x.is_finite())
    );
    prop_assert!(now.seen.energy.energy_j.iter().chain(&now.seen.energy.loss_j).all(|x| x.is_finite()));
    // Limits.
    prop_assert!(v.iter().all(|v| v.abs() <= config.cable_speed_m_s + 1e-12));
    prop_assert_eq!(&v[3..], &[0.0; 5]);
    let Some(before) = before else { return Ok(()) };
    let gap_s = (now.input.begin_ns - before.input.begin_ns) as f64 * 1e-9;
    let (old, was) = (&before.sent.speed_m_s, before.seen.authority.mode);
    let step = config.cable_acceleration_m_s2 * config.period_s + 1e-12;
    let exempt = gap_s > config.watchdog_s || mode == A::MODE_EMERGENCY_STOP || was == A::MODE_EMERGENCY_STOP;
    if !exempt {
        for i in 0..3 {
            prop_assert!((v[i] - old[i]).abs() <= step, "cable {i}: {} to {} in mode {mode}", old[i], v[i]);
        }
    }
    // Mode of the decision: a fault found in the second half of a cycle acts in the next one.
    let decided = if [A::MODE_FAULTED, A::MODE_EMERGENCY_STOP].contains(&mode) { was } else { mode };
    let still = [A::MODE_DISARMED, A::MODE_HOLDING, A::MODE_EMERGENCY_STOP].contains(&decided);
    prop_assert!(!still || now.sent.is_hold() || asked, "moves in mode {decided}");
    if mode == A::MODE_FAULTED && was == A::MODE_FAULTED {
        let most = |v: &[f64; 8]| v.iter().fold(0.0, |m: f64, x| m.max(x.abs()));
        prop_assert!(most(v) <= most(old));
    }
    if mode == A::MODE_JOGGING && was == A::MODE_JOGGING {
        prop_assert!(v.iter().filter(|v| **v != 0.0).count() <= 1);
        prop_assert!(v.iter().all(|v| v.abs() <= config.jog_speed_m_s + 1e-12));
    }
    if mode == A::MODE_DISARMED && was == A::MODE_DISARMED && !asked {
        prop_assert_eq!(now.sent.released, [true; 8]);
    }
    // The plan clock.
    prop_assert!(authority.plan_time_s >= before.seen.authority.plan_time_s);
    prop_assert!((0.0..=1.0).contains(&authority.plan_rate));
    let change = (authority.plan_rate - before.seen.authority.plan_rate).abs();
    if mode == A::MODE_FOLLOWING && was == A::MODE_FOLLOWING && gap_s <= config.watchdog_s {
        prop_assert!(change <= config.period_s / config.stop_s + 1e-12, "the rate jumps by {change}");
    }
    // Faults stay.
    if !asked && was != A::MODE_DISARMED {
        let lost = before.seen.authority.faults & !authority.faults & HARD;
        prop_assert_eq!(lost, 0, "faults {:#x} went away by themselves", lost);
        if was == A::MODE_FAULTED {
            prop_assert!(mode == A::MODE_FAULTED || mode == A::MODE_EMERGENCY_STOP);
        }
        prop_assert!(was != A::MODE_EMERGENCY_STOP || mode == A::MODE_EMERGENCY_STOP);
    }
    prop_assert!(authority.epoch >= before.seen.authority.epoch);
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]
    #[test]
    fn invariants_hold_for_any_input(events in prop::collection::vec(event(), 10..80)) {
        let config = rig::config();
        let mut rig = Rig::new(config.clone()).ready();
        let mut record: Vec<Step> = Vec::new();
        for event in events {
            let (mut steps, mut gap, mut asked) = (1, 0, false);
            match event {
                Event::Steps(count) => steps = count,
                Event::Ask(body) => {
                    prop_assert!(rig.inbox.request(1, &body));
                    asked = true;
                }
                Event::Controller(answer) => rig.controller = answer.map(|v| [v[0], v[1], v[2], 0.0, 0.0, 0.0, 0.0, 0.0]),
                Event::Offer(seconds) => rig.offer(seconds),
                Event::Unit(unit, state) => rig.unit[unit] = state,
                Event::Jump(cable, counts) => rig.count_offset[cable] = counts,
                Event::Dead(cable, dead) => rig.dead[cable] = dead,
                Event::Push(cable, duty, amps) => (rig.duty[cable], rig.current_a[cable]) = (duty, amps),
                Event::Tension(cable, newtons) => rig.tension_n[cable] = newtons,
                Event::Status(status) => rig.status[0] = status,
                Event::Supply(volts) => rig.supply_v = volts,
                Event::Gap(ms) => gap = ms * 1_000_000,
                Event::Estimate(valid) => rig.estimate_valid = valid,
                Event::Planner(alive) => rig.planner = alive,
                Event::Restart => rig.incarnation += 1,
            }
            for step in 0..steps {
                let now = rig.step_after(if step == 0 { gap as i64 } else { 0 }, if step == 0 { gap } else { 0 }).clone();
                let asked = asked && step == 0;
                check(&config, record.last(), &now, asked)?;
                let verbs = now.input.request.iter().filter(|body| body.verb != 0).count();
                prop_assert_eq!(now.answers.len(), verbs);
                for answer in &now.answers {
                    let sentence = answer.sentence();
                    prop_assert!(sentence.ends_with('.') && sentence.len() > 5, "{sentence}");
                }
                record.push(now);
            }
        }
    }

    #[test]
    fn a_replay_gives_the_same_bytes(events in prop::collection::vec(event(), 10..60)) {
        let config = rig::config();
        let mut rig = Rig::new(config.clone());
        rig.inbox.first(42, Some(rig::stored([5.0; 8], [50_000, -50_000, 60_000, 0, 0, 0, 0, 0])));
        let mut replayed = Core::new(config);
        for event in events {
            let mut steps = 1;
            match event {
                Event::Steps(count) => steps = count,
                Event::Ask(body) => prop_assert!(rig.inbox.request(1, &body)),
                Event::Controller(answer) => rig.controller = answer.map(|v| [v[0], v[1], v[2], 0.0, 0.0, 0.0, 0.0, 0.0]),
                Event::Offer(seconds) if rig.last.is_some() => rig.offer(seconds),
                Event::Unit(unit, state) => rig.unit[unit] = state,
                Event::Jump(cable, counts) => rig.count_offset[cable] = counts,
                Event::Tension(cable, newtons) => rig.tension_n[cable] = newtons,
                Event::Gap(ms) => {
                    // The live core decides before the replies arrive; the replayed one finds them in the same sample.
                    let now = rig.step_after(ms as i64 * 1_000_000, 0).clone();
                    let sent = replayed.decide(&now.input);
                    prop_assert_eq!(sent, now.sent);
                    same(&mut replayed, &now)?;
                    continue;
                }
                _ => {}
            }
            for _ in 0..steps {
                let now = rig.step().clone();
                let sent = replayed.decide(&now.input);
                prop_assert_eq!(sent, now.sent);
                same(&mut replayed, &now)?;
            }
        }
    }
}

fn same(replayed: &mut Core, now: &Step) -> Result<(), TestCaseError> {
    prop_assert_eq!(replayed.answers(), &now.answers[..]);
    let seen = replayed.observe(&now.input);
    prop_assert_eq!(bytes_of(&seen.state), bytes_of(&now.seen.state));
    prop_assert_eq!(bytes_of(&seen.authority), bytes_of(&now.seen.authority));
    prop_assert_eq!(bytes_of(&seen.slots), bytes_of(&now.seen.slots));
    prop_assert_eq!(bytes_of(&seen.energy), bytes_of(&now.seen.energy));
    Ok(())
}
