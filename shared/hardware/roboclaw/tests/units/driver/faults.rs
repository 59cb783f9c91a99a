//! Noise, silence, restarts, cables pulled: nothing stale, nothing falsely acknowledged, and back as soon as may be.

use drives::Error;
use roboclaw::codec::{Motor, Version, Write};
use roboclaw::driver::WIRE_MARGIN_NS;
use roboclaw::unit::{Target, Unit, UnitBus, UnitOptions};
use roboclaw::{Bus, BusConfig, Drive};
use serial::{Device, Faults, Pipe, Transport, WireQueue};

use super::clockwork::*;

/// The heart of the matter: whatever happens to the bytes, no sample is stale and no command counts as given that was
/// not.
#[test]
fn no_stale_sample_and_no_false_acknowledgement_under_faults() {
    let mixes = [
        ("late answers", Faults { late: 0.02, late_ns: 35 * MS, ..Faults::default() }),
        (
            "few errors",
            Faults {
                corrupt: 0.001,
                drop: 0.0005,
                duplicate: 0.0005,
                late: 0.005,
                late_ns: 35 * MS,
                ..Faults::default()
            },
        ),
        (
            "many errors",
            Faults {
                corrupt: 0.005,
                drop: 0.0025,
                duplicate: 0.0025,
                late: 0.01,
                late_ns: 20 * MS,
                ..Faults::default()
            },
        ),
        ("late just after the deadline", Faults { late: 0.05, late_ns: 13 * MS, ..Faults::default() }),
        ("very late", Faults { late: 0.02, late_ns: 90 * MS, ..Faults::default() }),
    ];
    for (seed, (name, faults)) in mixes.into_iter().enumerate() {
        let mut run = Run::connected(two_units());
        run.bus.transport_mut().set_faults(faults, seed as u64);
        let mut good = 0;
        let cycles = 1500;
        let mut last_counts = [i64::MIN; 2];
        for cycle in 1..=cycles {
            let start_ns = run.tick_ns;
            // A unit that was stopped because it was not heard waits for this.
            if run.answers.iter().any(|answer| matches!(answer.outcome, Err(Error::Interlocked { .. }))) {
                run.cycle(Drive::HOLD);
                continue;
            }
            run.cycle(Drive::Speed(cycle));
            for (unit, last) in last_counts.iter_mut().enumerate() {
                let answer = &run.answers[unit];
                assert!(answer.report.counts.value[0] >= *last, "{name}: time went back");
                *last = answer.report.counts.value[0];
                if answer.outcome.is_ok() {
                    good += 1;
                    assert!(answer.report.counts.at_ns >= start_ns, "{name}: a sample of an earlier cycle");
                    let age_ns = age_ns(answer, 0);
                    assert!((-1000..=300_000).contains(&age_ns), "{name}: cycle {cycle}, unit {unit}: {age_ns} ns off");
                    let told = run.bus.transport().device().told[unit].last().copied();
                    assert_eq!(
                        told,
                        Some(f64::from(cycle)),
                        "{name}: cycle {cycle}, unit {unit} counts as told, but was not"
                    );
                }
            }
        }
        let counters = run.bus.counters();
        println!("{name}: {good}/{} good, {counters:?}", 2 * cycles);
        assert!(counters.resyncs > 10, "{name}: the faults did not come: {counters:?}");
        assert!(good > cycles / 3, "{name}: only {good} of {}", 2 * cycles);
        assert_eq!(run.bus.report(0).unwrap().reboots + run.bus.report(1).unwrap().reboots, 0, "{name}");
        // When the faults end, so does the trouble.
        run.bus.transport_mut().set_faults(Faults::default(), 0);
        assert!(run.recover() < 120, "{name}");
    }
}

#[test]
fn one_lost_answer_costs_a_few_cycles_and_no_more() {
    let mut run = Run::connected(two_units());
    let silent_until_ns = run.tick_ns + MS;
    run.bus.transport_mut().silence_until(silent_until_ns);
    assert!(matches!(run.cycle(Drive::HOLD)[0].outcome, Err(Error::NoAnswer { .. })));
    let cycles = run.recover();
    assert!(cycles <= 4, "{cycles}");
    assert_eq!(run.bus.counters().resyncs, 1);
    assert_eq!(run.bus.report(0).unwrap().setups, 1);
}

#[test]
fn a_retry_happens_within_the_cycle_when_there_is_time() {
    let mut run = Run::connected(two_units());
    run.bus.transport_mut().wait_until(run.tick_ns);
    let start_ns = run.bus.transport().now_ns();
    run.bus.transport_mut().silence_until(start_ns + MS);
    run.bus.cycle(&[[Drive::Speed(7); 2]; 2], start_ns + 100 * MS, &mut run.answers);
    assert!(run.answers.iter().all(|answer| answer.outcome.is_ok()), "{:?}", run.answers);
    assert_eq!(run.bus.counters().resyncs, 1);
}

#[test]
fn noise_between_cycles_is_noticed_before_anything_is_sent() {
    for noise in [&[0xFF][..], &[0x00, 0x12], &[0xFF; 40]] {
        let mut run = Run::connected(two_units());
        run.bus.transport_mut().inject(noise);
        let commands = units(&mut run.bus)[0].commands();
        assert!(matches!(run.cycle(Drive::HOLD)[0].outcome, Err(Error::Stray { .. })));
        assert_eq!(units(&mut run.bus)[0].commands(), commands);
        assert_eq!(run.bus.counters().stray_bytes, noise.len() as u64);
        assert!(run.recover() <= 4);
    }
}

#[test]
fn endless_noise_holds_nobody_up() {
    let mut run = Run::connected(two_units());
    for _ in 0..20 {
        run.bus.transport_mut().inject(&[0x55; 200]);
        let start_ns = run.tick_ns;
        let answers = run.cycle(Drive::Speed(1));
        assert!(answers.iter().all(|answer| answer.outcome.is_err()));
        assert!(run.bus.transport().now_ns() <= start_ns + BUDGET_NS + WIRE_MARGIN_NS);
    }
    assert!(run.recover() <= 4);
}

#[test]
fn a_silent_unit_costs_the_others_little() {
    let mut run = Run::connected(two_units());
    units(&mut run.bus)[0].mute_until(u64::MAX);
    let (mut good, mut longest_gap, mut gap) = (0, 0, 0);
    for _ in 0..300 {
        let answers = run.cycle(Drive::Speed(3));
        assert!(answers[0].outcome.is_err());
        if answers[1].outcome.is_ok() {
            (good, gap) = (good + 1, 0);
        } else {
            gap += 1;
            longest_gap = longest_gap.max(gap);
        }
    }
    println!("the other unit: {good} of 300 cycles good, longest gap {longest_gap}");
    assert!(matches!(run.answers[0].outcome, Err(Error::Silent { .. } | Error::Resynchronising { .. })));
    assert!(good > 250, "{good}");
    // Its watchdog of 300 ms never had to help.
    assert!(longest_gap <= 10, "{longest_gap}");
    assert_eq!(units(&mut run.bus)[1].watchdog_trips(), 0);
    units(&mut run.bus)[0].mute_until(0);
    assert!(run.recover() < 80);
    assert_eq!(run.bus.report(0).unwrap().reboots, 0);
}

/// The driver has stopped it, and its caller, which commands motion all the time, does not know.
#[test]
fn a_unit_that_was_stopped_unheard_waits_for_a_command_to_hold() {
    let moves = |run: &mut Run| matches!(units(&mut run.bus)[0].target(Motor::One), Target::Speed(v) if v != 0.0);
    let mut run = Run::connected(two_units());
    run.cycle(Drive::Speed(700));
    units(&mut run.bus)[0].mute_until(u64::MAX);
    let give_up_ns = run.tick_ns + 1_000 * MS;
    while moves(&mut run) {
        run.cycle(Drive::Speed(700));
        assert!(run.tick_ns < give_up_ns, "it is never stopped");
    }
    // It is heard again before its watchdog would have stopped it.
    units(&mut run.bus)[0].mute_until(0);
    for _ in 0..60 {
        run.cycle(Drive::Speed(700));
        assert!(!moves(&mut run), "it moves again by itself");
    }
    assert!(matches!(run.answers[0].outcome, Err(Error::Interlocked { .. })), "{:?}", run.answers[0]);
    run.recover();
    run.cycle(Drive::Speed(700));
    assert!(moves(&mut run));
}

#[test]
fn a_restarted_unit_is_found_out_and_its_encoders_are_not_a_movement() {
    for down_ms in [0, 30, 400] {
        let mut run = Run::connected(two_units());
        for _ in 0..20 {
            run.cycle(Drive::Speed(50));
        }
        let before = run.answers[0].report.counts.value;
        units(&mut run.bus)[0].reboot(down_ms * MS);
        let mut moved_after = false;
        for _ in 0..150 {
            let answer = &run.cycle(Drive::Speed(50))[0];
            let counts = answer.report.counts.value[0];
            assert!(counts >= before[0], "the encoders' zero was taken for a movement");
            moved_after |= answer.outcome.is_ok();
        }
        let answer = &run.answers[0];
        assert_eq!(answer.report.reboots, 1, "down for {down_ms} ms");
        assert!(!moved_after, "it moved again by itself");
        assert!(matches!(answer.outcome, Err(Error::Interlocked { .. })), "{:?}", answer.outcome);
        assert_eq!(run.answers[1].outcome, Ok(()));
        // Told to stand still once, it can be used again.
        run.cycle(Drive::RELEASE);
        assert_eq!(run.cycle(Drive::Speed(50))[0].outcome, Ok(()));
        assert!(format!("{:?}", units(&mut run.bus)[0]).contains("watchdog_tenths: 3"));
    }
}

/// A unit that was just switched on, and of whose setup one answer or the other is lost, has not been running before:
/// its watchdog is then there because this driver has set it.
#[test]
fn a_new_unit_is_new_whatever_answer_of_its_setup_is_lost() {
    let mut lost = 0;
    for seed in 0..200 {
        let mut bus = bus_of(&[UnitOptions::new(0x80)]);
        bus.transport_mut().set_faults(Faults { drop: 0.02, ..Faults::default() }, seed);
        let until_ns = 5_000 * MS;
        while bus.settle(until_ns).is_err() {
            assert!(bus.transport().now_ns() < until_ns, "never set up");
        }
        lost += bus.counters().timeouts;
        assert!(!bus.report(0).unwrap().was_alive, "seed {seed}");
    }
    assert!(lost > 100, "only {lost} answers were lost");
}

#[test]
fn an_encoder_that_jumps_is_refused_once_and_counted_when_it_stays() {
    let mut run = Run::connected(two_units());
    run.cycle(Drive::HOLD);
    let before = run.answers[0].report.counts.value[0];
    let packet = Write::SetEncoder(roboclaw::codec::Motor::Two, 1_000_000_000).encode(0x80);
    let now_ns = run.bus.transport().now_ns();
    let mut reply = WireQueue::new(0);
    for &byte in packet.iter() {
        run.bus.transport_mut().device_mut().receive(now_ns, byte, &mut reply);
    }
    let answer = &run.cycle(Drive::HOLD)[0];
    assert!(matches!(answer.outcome, Err(Error::EncoderJump { axis: 1, .. })), "{answer:?}");
    assert_eq!(answer.report.counts.value[0], before, "a refused sample changes nothing");
    let answer = &run.cycle(Drive::HOLD)[0];
    assert_eq!((answer.outcome.clone(), answer.report.jumps, answer.report.reboots), (Ok(()), 1, 0));
}

#[test]
fn unplugged_it_fails_at_once_and_replugged_it_waits_to_be_told_to_hold() {
    let mut run = Run::connected(two_units());
    run.cycle(Drive::Speed(10));
    run.bus.transport_mut().unplug();
    let start_ns = run.tick_ns;
    assert!(run.cycle(Drive::Speed(10)).iter().all(|answer| answer.outcome.as_ref().is_err_and(Error::is_lost)));
    assert_eq!(run.bus.transport().now_ns(), start_ns, "a lost line costs no time");
    for _ in 0..20 {
        run.cycle(Drive::Speed(10));
    }
    run.bus.transport_mut().plug();
    for _ in 0..30 {
        run.cycle(Drive::Speed(10));
    }
    for answer in &run.answers {
        assert!(matches!(answer.outcome, Err(Error::Interlocked { .. })), "{answer:?}");
        // The encoders went on meanwhile, and the line's position with them.
        assert!((-1000..=300_000).contains(&age_ns(answer, 0)));
        assert_eq!((answer.report.reboots, answer.report.setups), (0, 2));
    }
    run.cycle(Drive::HOLD);
    assert!(run.cycle(Drive::Speed(10)).iter().all(|answer| answer.outcome.is_ok()));
}

#[test]
fn a_unit_that_stops_hearing_stops_its_motors() {
    let mut run = Run::connected(two_units());
    run.cycle(Drive::Speed(1000));
    let last_ns = run.bus.transport().now_ns();
    run.bus.transport_mut().wait_until(last_ns + 290 * MS);
    assert_eq!(units(&mut run.bus)[0].target(roboclaw::codec::Motor::One), Target::Speed(1000.0));
    run.bus.transport_mut().wait_until(last_ns + 301 * MS);
    assert_eq!(units(&mut run.bus)[0].target(roboclaw::codec::Motor::One), Target::Duty(0.0));
    assert_eq!(units(&mut run.bus)[0].watchdog_trips(), 1);
}

#[test]
fn a_missing_unit_is_silent_and_the_present_one_works() {
    let mut bus = bus_of(&[UnitOptions { version: Version::new("other"), ..UnitOptions::new(0x80) }]);
    let config = config(vec![unit_config(0x82), unit_config(0x80)]);
    let pipe = std::mem::replace(
        bus.transport_mut(),
        Pipe::new("spare", BAUD, Clockwork { bus: UnitBus::new(Vec::new()), told: Vec::new() }),
    );
    let mut bus = Bus::new(pipe, &config).unwrap();
    let mut answers = bus.blank_answers();
    for tick in 1..40 {
        bus.transport_mut().wait_until(tick * PERIOD_NS);
        bus.cycle(&[[Drive::HOLD; 2]; 2], tick * PERIOD_NS + BUDGET_NS, &mut answers);
    }
    assert!(matches!(&answers[0].outcome, Err(Error::Silent { unit, .. }) if &**unit == "unit 0x82"), "{answers:?}");
    assert_eq!(answers[1].outcome, Ok(()));
    assert_eq!(bus.version(1).unwrap().as_str(), "other");
}

#[test]
fn an_open_stop_input_requires_stop_and_one_that_cannot_be_read_too() {
    use drives::StopInput;
    use roboclaw::StatusPin;
    let bus = UnitBus::new(vec![Unit::new(UnitOptions::new(0x80))]);
    let pipe = Pipe::new("test line", BAUD, Clockwork { bus, told: vec![Vec::new()] });
    let config = BusConfig { stop_pin: Some(StatusPin::Dsr), ..config(vec![unit_config(0x80)]) };
    let mut run = Run::connected(Bus::new(pipe, &config).unwrap());
    assert!(matches!(run.bus.stop(), StopInput::Unreadable(_)) && run.bus.stop().requires_stop());
    for (on, wanted) in [(true, StopInput::Released), (false, StopInput::Pressed), (true, StopInput::Released)] {
        run.bus.transport_mut().set_pins(on);
        assert_eq!(run.cycle(Drive::HOLD)[0].outcome, Ok(()));
        assert_eq!((run.bus.stop(), run.bus.stop().requires_stop()), (&wanted, !on), "within the cycle");
    }
    // While a unit is silent it is looked at all the same.
    units(&mut run.bus)[0].mute_until(u64::MAX);
    for _ in 0..30 {
        run.cycle(Drive::HOLD);
    }
    run.bus.transport_mut().set_pins(false);
    run.cycle(Drive::HOLD);
    assert_eq!(run.bus.stop(), &StopInput::Pressed);
    run.bus.transport_mut().unplug();
    run.cycle(Drive::HOLD);
    assert!(run.bus.stop().requires_stop(), "the state of the button is unknown");
}
