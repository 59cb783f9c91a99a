//! The pipe: pacing, virtual time, faults.

use proptest::prelude::*;
use serial::{Device, Error, Faults, Pipe, Transport, WireQueue, byte_time_ns};

/// Answers each byte with itself after a pause, and remembers when the clock was shown to it.
#[derive(Debug, Default)]
struct Echo {
    pause_ns: u64,
    heard: Vec<u8>,
    last_ns: u64,
}

impl Device for Echo {
    fn receive(&mut self, now_ns: u64, byte: u8, reply: &mut WireQueue) {
        assert_eq!(now_ns, self.last_ns, "the clock is shown before the byte");
        self.heard.push(byte);
        reply.push(now_ns + self.pause_ns, &[byte]);
    }

    fn advance(&mut self, now_ns: u64) {
        assert!(now_ns >= self.last_ns, "time went back");
        self.last_ns = now_ns;
    }
}

#[test]
fn a_byte_takes_ten_bit_times() {
    assert_eq!(byte_time_ns(115_200), 86_806); // 10 / 115200 s, rounded up
    assert_eq!(byte_time_ns(1_000_000), 10_000);
    assert_eq!(byte_time_ns(0), 0);
}

#[test]
fn bytes_follow_each_other_on_the_wire_and_never_overtake() {
    let mut wire = WireQueue::new(1_000_000);
    wire.push(100_000, b"ab");
    wire.push(0, b"c"); // asked for earlier, but the wire is busy
    assert_eq!(wire.arrived(110_000), 1);
    assert_eq!(wire.pop(109_999), None);
    assert_eq!(wire.pop(130_000), Some((110_000, b'a')));
    assert_eq!(wire.pop(130_000), Some((120_000, b'b')));
    assert_eq!(wire.next_ns(), Some(130_000));
    assert_eq!(wire.pop(130_000), Some((130_000, b'c')));
    assert!(wire.is_empty());
}

#[test]
fn time_passes_only_as_far_as_it_is_waited_for() {
    let mut pipe = Pipe::new("pipe", 1_000_000, Echo { pause_ns: 500_000, ..Echo::default() });
    pipe.write_all(&[7], 0).unwrap();
    assert_eq!(pipe.now_ns(), 0);
    let mut byte = [0];
    // There and back are 10 us each, the pause between them 500 us.
    assert_eq!(pipe.read(&mut byte, 519_999).unwrap(), 0);
    assert_eq!(pipe.now_ns(), 519_999);
    assert_eq!(pipe.pending().unwrap(), 0);
    assert_eq!(pipe.read(&mut byte, u64::MAX).unwrap(), 1);
    assert_eq!((pipe.now_ns(), byte), (520_000, [7]));
    pipe.wait_until(2_000_000);
    assert_eq!((pipe.now_ns(), pipe.device().last_ns), (2_000_000, 2_000_000));
}

#[test]
fn unplugging_loses_what_is_on_the_way_and_replugging_is_a_new_connection() {
    let mut pipe = Pipe::new("pipe", 1_000_000, Echo::default());
    assert_eq!(pipe.connection().unwrap(), 1);
    pipe.write_all(b"lost", 0).unwrap();
    pipe.unplug();
    assert!(matches!(pipe.read(&mut [0], 1_000), Err(Error::Gone { .. })));
    assert!(matches!(pipe.connection(), Err(Error::Missing { .. })));
    pipe.plug();
    assert_eq!(pipe.connection().unwrap(), 2);
    pipe.write_all(b"ok", 0).unwrap();
    let mut answer = [0; 4];
    assert_eq!(pipe.fill(&mut answer, 1_000_000).unwrap(), 2);
    assert_eq!(pipe.device().heard, b"ok");
}

#[test]
fn noise_silence_and_late_answers_come_as_asked_for() {
    let mut pipe = Pipe::new("pipe", 1_000_000, Echo::default());
    pipe.inject(&[0xFF]);
    assert_eq!(pipe.pending().unwrap(), 0); // it takes its time on the wire as well
    pipe.wait_until(10_000);
    assert_eq!(pipe.pending().unwrap(), 1);
    pipe.clear().unwrap();
    assert_eq!(pipe.pending().unwrap(), 0);

    pipe.silence_until(100_000);
    pipe.write_all(&[1], 0).unwrap();
    assert_eq!(pipe.read(&mut [0], 200_000).unwrap(), 0);

    pipe.set_faults(Faults { late: 1.0, late_ns: 35_000_000, ..Faults::default() }, 1);
    pipe.write_all(&[2], 0).unwrap();
    assert_eq!(pipe.read(&mut [0], 35_000_000).unwrap(), 0);
    assert_eq!(pipe.read(&mut [0], 36_000_000).unwrap(), 1);
    assert_eq!(pipe.counts().late, 1);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn faults_are_rare_as_asked_and_the_same_every_time(seed in any::<u64>(), p in 0.0..0.1f64) {
        let run = || {
            let mut pipe = Pipe::new("pipe", 1_000_000, Echo::default());
            pipe.set_faults(Faults { drop: p, corrupt: p, duplicate: p, insert: p, ..Faults::default() }, seed);
            pipe.write_all(&[0x55; 500], 0).unwrap();
            let mut answer = vec![0; 4096];
            let n = pipe.fill(&mut answer, 50_000_000).unwrap();
            answer.truncate(n);
            (answer, pipe.counts())
        };
        let (answer, counts) = run();
        prop_assert_eq!(&(answer, counts), &run());
        // Four kinds of fault, about a thousand bytes, five standard deviations. Above a tenth it shows that a byte
        // that is lost cannot also be changed or doubled.
        let bytes = (counts.written + counts.answered) as f64;
        prop_assert!((counts.faults as f64 - 4.0 * p * bytes).abs() <= 5.0 * (4.0 * p * bytes).sqrt() + 5.0);
    }

    #[test]
    fn without_faults_every_byte_comes_back_in_order(bytes in proptest::collection::vec(any::<u8>(), 0..200), pause_ns in 0..1_000_000u64) {
        let mut pipe = Pipe::new("pipe", 460_800, Echo { pause_ns, ..Echo::default() });
        pipe.write_all(&bytes, 0).unwrap();
        let mut answer = vec![0; bytes.len() + 1];
        prop_assert_eq!(pipe.fill(&mut answer, 1_000_000_000).unwrap(), bytes.len());
        prop_assert_eq!(&answer[..bytes.len()], &bytes[..]);
        prop_assert_eq!(&pipe.device().heard, &bytes);
    }
}
