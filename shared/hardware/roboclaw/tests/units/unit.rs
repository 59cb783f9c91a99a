//! The virtual unit: packets however they are cut, watchdog, ramps, moves, settings, faults.

use proptest::prelude::*;
use roboclaw::codec::{Motor, Read, Reply, Write};
use roboclaw::crc16;
use roboclaw::unit::{Feeds, Measured, Target, Unit, UnitBus, UnitOptions};
use roboclaw::{Status, StatusWidth};
use serial::{Device, WireQueue};

const MS: u64 = 1_000_000;

/// A line with units, a clock and what was answered.
struct Bench {
    bus: UnitBus,
    now_ns: u64,
}

impl Bench {
    fn new(options: &[UnitOptions]) -> Bench {
        Bench { bus: UnitBus::new(options.iter().map(|options| Unit::new(*options)).collect()), now_ns: 0 }
    }

    fn one() -> Bench {
        Bench::new(&[UnitOptions::new(0x80)])
    }

    fn unit(&mut self) -> &mut Unit {
        &mut self.bus.units_mut()[0]
    }

    fn wait(&mut self, ns: u64) {
        self.now_ns += ns;
        self.bus.advance(self.now_ns);
    }

    /// Send bytes without a pause; all that is answered, and when the first byte of it is ready.
    fn send(&mut self, bytes: &[u8]) -> (Vec<u8>, Option<u64>) {
        let mut wire = WireQueue::new(0);
        for &byte in bytes {
            self.bus.receive(self.now_ns, byte, &mut wire);
        }
        let first_ns = wire.next_ns().map(|at_ns| at_ns - self.now_ns);
        (std::iter::from_fn(|| wire.pop(u64::MAX)).map(|(_, byte)| byte).collect(), first_ns)
    }

    fn write(&mut self, write: Write) {
        assert_eq!(self.send(&write.encode(0x80)).0, [0xFF], "{write:?}");
    }

    fn ask(&mut self, read: Read) -> Reply {
        let (answer, _) = self.send(&read.encode(0x80));
        read.decode(0x80, &answer).unwrap()
    }

    /// A command the codec has no name for.
    fn raw(&mut self, code: u8, payload: &[u8]) -> Vec<u8> {
        let mut packet = vec![0x80, code];
        packet.extend(payload);
        let crc = crc16(&packet);
        packet.extend(crc.to_be_bytes());
        self.send(&packet).0
    }

    /// A question the codec has no name for.
    fn raw_read(&mut self, code: u8) -> Vec<u8> {
        let (mut answer, _) = self.send(&[0x80, code]);
        assert_eq!(crc16(&[&[0x80, code], answer.as_slice()].concat()), 0);
        answer.truncate(answer.len() - 2);
        answer
    }
}

#[test]
fn a_packet_may_come_in_pieces_but_not_with_a_long_pause() {
    let packet = Write::Speeds([1000, -1000]).encode(0x80);
    for pause_ns in [0, 5 * MS, 10 * MS] {
        let mut bench = Bench::one();
        let mut answer = Vec::new();
        for piece in packet.chunks(4) {
            bench.wait(pause_ns);
            answer.extend(bench.send(piece).0);
        }
        assert_eq!(answer, [0xFF], "pause of {pause_ns} ns");
        assert_eq!(bench.unit().target(Motor::Two), Target::Speed(-1000.0));
    }
    let mut bench = Bench::one();
    assert_eq!(bench.send(&packet[..6]).0, []);
    bench.wait(10 * MS + 1);
    assert_eq!(bench.send(&packet[6..]).0, [], "the rest of a forgotten packet is no packet");
    bench.wait(11 * MS);
    bench.write(Write::Speeds([1, 2]));
}

#[test]
fn an_unknown_command_is_not_answered_and_ends_with_a_pause() {
    let mut bench = Bench::one();
    assert_eq!(bench.send(&[0x80, 0xEE, 0x80, 15, 0x80, 15]).0, []);
    assert_eq!(bench.send(&Read::Watchdog.encode(0x80)).0, []);
    bench.wait(11 * MS);
    assert_eq!(bench.ask(Read::Watchdog), Reply::Watchdog(0));
}

proptest! {
    #[test]
    fn a_changed_packet_is_not_obeyed(speeds in any::<[i32; 2]>(), at in 0..12usize, flip in 1..=255u8) {
        let mut packet = Write::Speeds(speeds).encode(0x80).to_vec();
        packet[at] ^= flip;
        let mut bench = Bench::one();
        let _ = bench.send(&packet);
        prop_assert_eq!(bench.unit().commands(), 0);
        // After a pause it understands again.
        bench.wait(11 * MS);
        bench.write(Write::Speeds(speeds));
    }

    #[test]
    fn no_bytes_make_it_stumble(bytes in proptest::collection::vec(any::<u8>(), 0..300), pause_ns in 0..12 * MS) {
        let mut bench = Bench::new(&[UnitOptions::new(0x80), UnitOptions::new(0x87)]);
        for piece in bytes.chunks(17) {
            let _ = bench.send(piece);
            bench.wait(pause_ns);
        }
        bench.wait(11 * MS);
        prop_assert!(matches!(bench.ask(Read::Version), Reply::Version(_)));
    }
}

#[test]
fn units_of_one_line_answer_for_themselves_only() {
    let mut bench = Bench::new(&[UnitOptions::new(0x80), UnitOptions::new(0x81)]);
    bench.bus.measure(0, &Measured { counts: [1, 2], ..Measured::default() });
    bench.bus.measure(1, &Measured { counts: [3, 4], ..Measured::default() });
    for (address, counts) in [(0x80, [1, 2]), (0x81, [3, 4])] {
        let (answer, first_ns) = bench.send(&Read::Encoders.encode(address));
        assert_eq!(Read::Encoders.decode(address, &answer), Ok(Reply::Counts(counts)));
        assert_eq!(first_ns, Some(150_000));
    }
    assert_eq!(bench.send(&Read::Encoders.encode(0x82)).0, []);
}

#[test]
fn the_watchdog_stops_both_motors_and_says_so() {
    for (feeds, trips) in [(Feeds::OwnPackets, 1), (Feeds::AnyPacket, 0)] {
        let mut bench = Bench::new(&[UnitOptions { feeds, ..UnitOptions::new(0x80) }, UnitOptions::new(0x81)]);
        bench.write(Write::Watchdog(3));
        bench.write(Write::Speeds([500, 500]));
        for _ in 0..5 {
            bench.wait(100 * MS);
            let _ = bench.send(&Read::Encoders.encode(0x81));
        }
        assert_eq!(bench.unit().watchdog_trips(), trips, "{feeds:?}");
        let stopped = bench.unit().target(Motor::Two) == Target::Duty(0.0);
        assert_eq!(stopped, trips == 1);
    }
    // A question is enough to keep it quiet, and a unit that stands has nothing to stop.
    let mut bench = Bench::one();
    bench.write(Write::Watchdog(1));
    bench.wait(1000 * MS);
    assert_eq!(bench.unit().watchdog_trips(), 0);
    bench.write(Write::Duties([100, 0]));
    for _ in 0..20 {
        bench.wait(90 * MS);
        bench.ask(Read::Watchdog);
    }
    assert_eq!(bench.unit().watchdog_trips(), 0);
    bench.wait(110 * MS);
    assert_eq!(bench.unit().watchdog_trips(), 1);
}

#[test]
fn a_ramp_rises_as_asked_for() {
    let mut bench = Bench::one();
    bench.write(Write::SpeedsRamps([(1000, 500), (2000, -500)]));
    bench.wait(100 * MS);
    assert_eq!(bench.unit().target(Motor::One), Target::Speed(100.0));
    assert_eq!(bench.unit().target(Motor::Two), Target::Speed(-200.0));
    bench.wait(1000 * MS);
    assert_eq!(bench.unit().target(Motor::Two), Target::Speed(-500.0));
    bench.write(Write::Speed(Motor::One, 7));
    assert_eq!(bench.unit().target(Motor::One), Target::Speed(7.0));
}

/// Turns the encoders as the unit's targets say, in steps of 1 ms.
fn turn(bench: &mut Bench, ms: u64) {
    let mut counts = bench.unit().measured().counts.map(|count| count as f64);
    for _ in 0..ms {
        bench.wait(MS);
        for motor in [Motor::One, Motor::Two] {
            if let Target::Speed(speed) = bench.unit().target(motor) {
                counts[motor.index()] += speed * 1e-3;
            }
        }
        let measured = Measured { counts: counts.map(|count| count.round() as i64), ..Measured::default() };
        bench.unit().measure(&measured);
    }
}

#[test]
fn distances_are_made_one_after_the_other_and_the_buffer_tells() {
    let mut bench = Bench::one();
    assert_eq!(bench.raw_read(47), [0x80, 0x80]);
    let distance =
        |speed: i32, counts: u32, now: u8| [&speed.to_be_bytes()[..], &counts.to_be_bytes(), &[now]].concat();
    assert_eq!(bench.raw(41, &distance(1000, 200, 1)), [0xFF]);
    assert_eq!(bench.raw(41, &distance(-500, 100, 0)), [0xFF]);
    assert_eq!(bench.raw_read(47), [1, 0x80]);
    turn(&mut bench, 100);
    assert_eq!(bench.unit().measured().counts, [100, 0]);
    turn(&mut bench, 120);
    assert_eq!(bench.raw_read(47), [0, 0x80]);
    turn(&mut bench, 300);
    assert_eq!(bench.raw_read(47), [0x80, 0x80]);
    let end = bench.unit().measured().counts[0];
    assert!((95..=105).contains(&end), "{end}");
    assert_eq!(bench.unit().target(Motor::One), Target::Speed(0.0));
}

#[test]
fn a_position_is_reached_and_held() {
    let mut bench = Bench::one();
    let words = [10_000u32, 2000, 10_000, 700];
    let payload: Vec<u8> = words.iter().flat_map(|word| word.to_be_bytes()).chain([1]).collect();
    assert_eq!(bench.raw(65, &payload), [0xFF]);
    turn(&mut bench, 1500);
    let end = bench.unit().measured().counts[0];
    assert!((698..=702).contains(&end), "{end}");
}

#[test]
fn what_was_set_can_be_read_back_and_saved() {
    let mut bench = Bench::one();
    let pid = roboclaw::codec::Pid { p: 1, i: 2, d: 3, counts_s_at_full_duty: 4 };
    bench.write(Write::VelocityPid(Motor::Two, pid));
    bench.write(Write::MaxCurrent(Motor::One, 550));
    assert_eq!(bench.ask(Read::VelocityPid2), Reply::VelocityPid(pid));
    assert_eq!(bench.ask(Read::MaxCurrent1), Reply::MaxCurrent(550));
    assert_eq!(bench.unit().max_current_a(Motor::One), 5.5);
    // Position gains are written D P I and read P I D, as velocity gains are.
    let words = |order: [u32; 7]| order.iter().flat_map(|word| word.to_be_bytes()).collect::<Vec<u8>>();
    assert_eq!(bench.raw(61, &words([3, 1, 2, 4, 5, 6, 7])), [0xFF]);
    assert_eq!(bench.raw_read(63), words([1, 2, 3, 4, 5, 6, 7]));
    assert_eq!(bench.raw_read(64), words([0; 7]));

    bench.unit().reboot(0);
    assert_eq!(bench.ask(Read::MaxCurrent1), Reply::MaxCurrent(3000), "nothing was saved");
    bench.write(Write::MaxCurrent(Motor::One, 550));
    bench.write(Write::Save);
    bench.write(Write::MaxCurrent(Motor::One, 1));
    bench.unit().reboot(0);
    assert_eq!(bench.ask(Read::MaxCurrent1), Reply::MaxCurrent(550));
}

#[test]
fn it_says_what_its_sensors_measure() {
    let mut bench = Bench::new(&[UnitOptions { width: StatusWidth::Narrow, ..UnitOptions::new(0x80) }]);
    bench.unit().measure(&Measured {
        counts: [123_456, -5],
        speeds_counts_s: [1049.0, -1000.0],
        currents_a: [1.234, -400.0],
        duties: [0.5, -1.0],
        supply_v: 24.3,
        logic_v: 5.02,
        temperature_c: -7.26,
        status: Status(Status::TEMPERATURE_1_WARNING),
    });
    assert_eq!(bench.ask(Read::Encoders), Reply::Counts([123_456, -5i32 as u32]));
    assert_eq!(bench.ask(Read::Encoder2), Reply::Count(-5i32 as u32, 2 | 1)); // backward, and it went below zero
    assert_eq!(bench.ask(Read::Encoder2), Reply::Count(-5i32 as u32, 2), "told once");
    assert_eq!(bench.ask(Read::Speed1), Reply::Speed(1049));
    assert_eq!(bench.ask(Read::RawSpeed1), Reply::Speed(900), "counted over 1/300 s");
    assert_eq!(bench.ask(Read::Currents), Reply::Currents([123, i16::MIN]), "saturates");
    assert_eq!(bench.ask(Read::Pwms), Reply::Pwms([16_384, -32_767]));
    assert_eq!(bench.ask(Read::MainBattery), Reply::Battery(243));
    assert_eq!(bench.ask(Read::LogicBattery), Reply::Battery(50));
    assert_eq!(bench.ask(Read::Temperature), Reply::Temperature(-73));
    let status = Reply::Status(Status(Status::TEMPERATURE_1_WARNING), StatusWidth::Narrow);
    assert_eq!(bench.ask(Read::Status), status);
}

#[test]
fn an_error_condition_stops_the_motors_a_warning_does_not() {
    let mut bench = Bench::one();
    bench.write(Write::Speeds([10, 10]));
    bench.unit().measure(&Measured { status: Status(Status::OVER_CURRENT_1), ..Measured::default() });
    assert_eq!(bench.unit().target(Motor::One), Target::Speed(10.0));
    bench.unit().measure(&Measured { status: Status(Status::EMERGENCY_STOP), ..Measured::default() });
    assert_eq!(bench.unit().target(Motor::One), Target::Duty(0.0));
}

#[test]
fn faults_are_as_asked_for() {
    let mut bench = Bench::one();
    bench.unit().answer_late(1, 35 * MS);
    assert_eq!(bench.send(&Read::Encoders.encode(0x80)).1, Some(35 * MS + 150_000));
    assert_eq!(bench.send(&Read::Encoders.encode(0x80)).1, Some(150_000));

    bench.unit().mute_until(50 * MS);
    assert_eq!(bench.send(&Write::Speeds([9, 9]).encode(0x80)).0, []);
    assert_eq!(bench.unit().target(Motor::One), Target::Speed(9.0), "mute, not deaf");

    bench.unit().measure(&Measured { counts: [500, 600], ..Measured::default() });
    bench.write_after_mute();
    bench.unit().reboot(100 * MS);
    assert_eq!(bench.unit().target(Motor::One), Target::Duty(0.0));
    assert_eq!(bench.send(&Read::Watchdog.encode(0x80)).0, []);
    bench.wait(101 * MS);
    assert_eq!(bench.ask(Read::Watchdog), Reply::Watchdog(0));
    assert_eq!(bench.ask(Read::Encoders), Reply::Counts([0, 0]));
}

impl Bench {
    fn write_after_mute(&mut self) {
        self.wait(60 * MS);
        self.write(Write::Watchdog(5));
    }
}
