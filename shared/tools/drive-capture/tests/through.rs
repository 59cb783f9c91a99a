//! The driver of a drive family speaks through the recorder with a virtual unit, and again with what was recorded.
#![allow(clippy::unwrap_used)]

use drives::{AXES, Command, CountBound, DriveBus};
use nims_drive_capture::{Counts, Ended, Recording, Side, answer, record, timing};
use roboclaw::unit::{Measured, Unit, UnitBus, UnitOptions};
use roboclaw::{Bus, BusConfig, UnitConfig};
use serial::{Device, PtyLink, ReopeningPort, WireQueue, monotonic_ns, sleep_until};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;

const MS: u64 = 1_000_000;
/// Long enough that a machine that stands still for a quarter of a second makes no test fail.
const PATIENCE_NS: u64 = 400 * MS;
const COUNTS: [i64; AXES] = [123_456, -77];

/// Ends the other thread when the test is over or has failed.
struct Ends<'a>(&'a AtomicBool);

impl Drop for Ends<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

/// A virtual unit on a pseudo-terminal until `stop`.
fn drive(jack: &mut PtyLink, stop: &AtomicBool) {
    let mut unit = UnitBus::new(vec![Unit::new(UnitOptions::new(0x80))]);
    unit.measure(0, &Measured { counts: COUNTS, ..Measured::default() });
    let mut reply = WireQueue::new(0);
    while !stop.load(Ordering::Relaxed) {
        let (now_ns, mut buffer) = (monotonic_ns(), [0; 256]);
        let pty = jack.pty().unwrap();
        let heard = pty.read(&mut buffer).unwrap();
        unit.advance(now_ns);
        buffer[..heard].iter().for_each(|byte| unit.receive(now_ns, *byte, &mut reply));
        while let Some((_, byte)) = reply.pop(u64::MAX) {
            pty.write(&[byte]).unwrap();
        }
        sleep_until(now_ns + MS / 4);
    }
}

/// Brings the unit on a port into use, holds it for some cycles, and returns the counts that it read.
fn hold(port: &Path) -> [i64; AXES] {
    let unit = UnitConfig { address: 0x80, watchdog_tenths: 30, bound: CountBound::NONE };
    let config = BusConfig { baud: 0, margin_ns: PATIENCE_NS, units: vec![unit], stop_pin: None };
    let mut bus = Bus::new(ReopeningPort::new(port.to_str().unwrap(), 0), &config).unwrap();
    let mut answers = bus.blank_answers();
    let mut good = 0;
    for _ in 0..2000 {
        let begin_ns = monotonic_ns();
        bus.exchange(&[[Some(Command::HOLD); AXES]], begin_ns + PATIENCE_NS, &mut answers);
        let _ = bus.settle(monotonic_ns() + PATIENCE_NS);
        good += usize::from(answers[0].outcome.is_ok());
        if good == 20 {
            return answers[0].report.counts.value;
        }
        sleep_until(begin_ns + 5 * MS);
    }
    panic!("the unit is not in use: {answers:?}");
}

#[test]
fn a_driver_speaks_through_the_recorder_and_with_the_recording() {
    let folder = tempfile::tempdir().unwrap();
    let [device, link, again, file] = ["device", "link", "again", "drive.capture"].map(|name| folder.path().join(name));
    let stop = AtomicBool::new(false);
    let mut jack = PtyLink::new(&device);
    jack.plug().unwrap();
    let until_linked = |link: &Path| {
        (0..1000).any(|_| {
            sleep_until(monotonic_ns() + 5 * MS);
            link.exists()
        })
    };
    thread::scope(|scope| {
        let _ends = Ends(&stop);
        let unit = scope.spawn(|| drive(&mut jack, &stop));
        let recorder = scope.spawn(|| record(&device, 115_200, &link, &file, &stop));
        assert!(until_linked(&link));
        assert_eq!(hold(&link), COUNTS);
        stop.store(true, Ordering::Relaxed);
        unit.join().unwrap();
        assert_eq!(recorder.join().unwrap().unwrap(), Ended::Signal);
    });
    let recording = Recording::load(&file).unwrap();
    let found = timing(&recording);
    assert!(found.questions >= 40 && found.unanswered * 10 < found.questions, "{found:?}");
    assert!(recording.chunks.iter().any(|chunk| chunk.side == Side::Program && chunk.bytes[0] == 0x80));
    // The virtual unit again, this time by the file alone.
    stop.store(false, Ordering::Relaxed);
    thread::scope(|scope| {
        let _ends = Ends(&stop);
        let replayed = scope.spawn(|| answer(&recording, &again, &stop));
        assert!(until_linked(&again));
        assert_eq!(hold(&again), COUNTS);
        stop.store(true, Ordering::Relaxed);
        let Counts { answered, .. } = replayed.join().unwrap().unwrap();
        assert!(answered >= 40, "{answered}");
    });
    // A recording is never overwritten.
    assert!(record(&device, 115_200, &link, &file, &stop).is_err());
}
