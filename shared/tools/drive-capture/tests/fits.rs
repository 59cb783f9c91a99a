//! The turnaround of a virtual drive is stated again by a recording of it, for every family and wire. On a virtual
//! clock, with the drivers of nims, which send several questions together.
#![allow(clippy::unwrap_used)]

use drives::Error::Resynchronising;
use drives::{AXES, Command, CountBound, DriveBus, UnitAnswer, UnitReport};
use nims_drive_capture::{Chunk, Recording, Side, timing};
use serial::{Device, Error, Pipe, StatusPin, Transport};
use std::sync::{Arc, Mutex};

const MS: u64 = 1_000_000;
const PERIOD_NS: u64 = 50 * MS;
const MARGIN_NS: u64 = 10 * MS;
const WATCHDOG_MS: u16 = 500;
/// A byte takes whole nanoseconds on the virtual wire, s: less than this for a hundred of them.
const TOLERANCE_S: f64 = 0.000_001;
const UART_BAUD: u32 = 921_600;

type Notes = Arc<Mutex<Recording>>;

/// Between driver and wire, as the recorder is, without its delays.
struct Tapped<D> {
    pipe: Pipe<D>,
    notes: Notes,
}

impl<D: Device> Tapped<D> {
    fn note(&mut self, side: Side, bytes: &[u8]) {
        let at_s = self.pipe.now_ns() as f64 * 1e-9;
        self.notes.lock().unwrap().chunks.push(Chunk { at_s, side, bytes: bytes.to_vec() });
    }
}

impl<D: Device> Transport for Tapped<D> {
    fn name(&self) -> &Arc<str> {
        self.pipe.name()
    }
    fn now_ns(&self) -> u64 {
        self.pipe.now_ns()
    }
    fn wait_until(&mut self, until_ns: u64) {
        self.pipe.wait_until(until_ns);
    }
    fn connection(&mut self) -> Result<u32, Error> {
        self.pipe.connection()
    }
    fn write_all(&mut self, bytes: &[u8], deadline_ns: u64) -> Result<(), Error> {
        self.note(Side::Program, bytes);
        self.pipe.write_all(bytes, deadline_ns)
    }
    fn read(&mut self, buffer: &mut [u8], deadline_ns: u64) -> Result<usize, Error> {
        let read = self.pipe.read(buffer, deadline_ns)?;
        if read > 0 {
            self.note(Side::Drive, &buffer[..read]);
        }
        Ok(read)
    }
    fn pending(&mut self) -> Result<usize, Error> {
        self.pipe.pending()
    }
    fn clear(&mut self) -> Result<(), Error> {
        self.pipe.clear()
    }
    fn is_on(&mut self, pin: StatusPin) -> Result<bool, Error> {
        self.pipe.is_on(pin)
    }
}

/// A virtual drive of one family on one wire.
struct Kind {
    name: &'static str,
    /// 0: USB.
    baud: u32,
    /// Records a drive with that turnaround, ns.
    hold: fn(u64, u32, Notes),
}

/// Brings a drive into use, and holds until a hundred cycles were good.
fn hold<B: DriveBus>(mut bus: B, wait_until: impl Fn(&mut B, u64)) {
    let blank =
        || UnitAnswer { outcome: Err(Resynchronising { port: Arc::clone(bus.port()) }), report: UnitReport::default() };
    let mut answers: Vec<UnitAnswer> = (0..bus.unit_count()).map(|_| blank()).collect();
    // A moteus has one motor.
    let commands = vec![[Some(Command::HOLD), None]; answers.len()];
    let mut good = 0;
    for cycle in 1..400 {
        let end_ns = cycle * PERIOD_NS;
        bus.exchange(&commands, end_ns - PERIOD_NS / 5, &mut answers);
        let _ = bus.settle(end_ns);
        wait_until(&mut bus, end_ns);
        good += usize::from(answers.iter().all(|answer| answer.outcome.is_ok()));
        if good == 100 {
            return;
        }
    }
    panic!("the drive is not in use: {answers:?}");
}

fn roboclaw(turnaround_ns: u64, baud: u32, notes: Notes) {
    use roboclaw::unit::{Unit, UnitBus, UnitOptions};
    let options = UnitOptions { turnaround_ns, ..UnitOptions::new(0x80) };
    let pipe = Pipe::new("wire", baud, UnitBus::new(vec![Unit::new(options)]));
    let watchdog_tenths = (WATCHDOG_MS / 100) as u8;
    let units = vec![roboclaw::UnitConfig { address: 0x80, watchdog_tenths, bound: CountBound::NONE }];
    let config = roboclaw::BusConfig { baud, margin_ns: MARGIN_NS, units, stop_pin: None };
    let bus = roboclaw::Bus::new(Tapped { pipe, notes }, &config).unwrap();
    hold(bus, |bus, until_ns| bus.transport_mut().wait_until(until_ns));
}

fn moteus(turnaround_ns: u64, baud: u32, notes: Notes) {
    use moteus::codec::Checksums;
    use moteus::unit::{Unit, UnitBus, UnitOptions};
    let addresses: &[u8] = if baud == 0 { &[1, 2, 3, 4] } else { &[1] };
    let checksums = if baud == 0 { Checksums::Absent } else { Checksums::Required };
    let unit = |address: &u8| Unit::new(UnitOptions { turnaround_ns, ..UnitOptions::new(*address) });
    let pipe = Pipe::new("wire", baud, UnitBus::new(addresses.iter().map(unit).collect(), checksums));
    let unit = |address: &u8| moteus::UnitConfig {
        address: *address,
        watchdog_ms: WATCHDOG_MS,
        bound: CountBound::NONE,
        torque_constant_n_m_a: 0.05,
        second: None,
    };
    let units = addresses.iter().map(unit).collect();
    let config = moteus::BusConfig { baud, margin_ns: MARGIN_NS, checksums, units, stop_pin: None };
    let bus = moteus::Bus::new(Tapped { pipe, notes }, &config).unwrap();
    hold(bus, |bus, until_ns| bus.transport_mut().wait_until(until_ns));
}

fn odrive(turnaround_ns: u64, baud: u32, notes: Notes) {
    use odrive::unit::{Board, BoardOptions};
    let pipe = Pipe::new("wire", baud, Board::new(BoardOptions { turnaround_ns, ..BoardOptions::new(0) }));
    let config = odrive::BusConfig {
        baud,
        margin_ns: MARGIN_NS,
        address: 0,
        axes: AXES,
        watchdog_ms: WATCHDOG_MS,
        bound: CountBound::NONE,
        torque_constant_n_m_a: 0.05,
        stop_pin: None,
    };
    let bus = odrive::Bus::new(Tapped { pipe, notes }, &config).unwrap();
    hold(bus, |bus, until_ns| bus.transport_mut().wait_until(until_ns));
}

fn roboteq(turnaround_ns: u64, baud: u32, notes: Notes) {
    use roboteq::unit::{Controller, ControllerOptions};
    let options = ControllerOptions { turnaround_ns, ..ControllerOptions::new(0) };
    let pipe = Pipe::new("wire", baud, Controller::new(options));
    let config = roboteq::BusConfig {
        baud,
        margin_ns: MARGIN_NS,
        address: 0,
        axes: AXES,
        watchdog_ms: WATCHDOG_MS,
        bound: CountBound::NONE,
        stop_pin: None,
    };
    let bus = roboteq::Bus::new(Tapped { pipe, notes }, &config).unwrap();
    hold(bus, |bus, until_ns| bus.transport_mut().wait_until(until_ns));
}

const KINDS: [Kind; 7] = [
    Kind { name: "roboclaw", baud: 230_400, hold: roboclaw },
    Kind { name: "moteus", baud: UART_BAUD, hold: moteus },
    Kind { name: "moteus on USB", baud: 0, hold: moteus },
    Kind { name: "odrive", baud: UART_BAUD, hold: odrive },
    Kind { name: "odrive on USB", baud: 0, hold: odrive },
    Kind { name: "roboteq", baud: 115_200, hold: roboteq },
    Kind { name: "roboteq on USB", baud: 0, hold: roboteq },
];

fn recorded(kind: &Kind, turnaround_ns: u64) -> Recording {
    let notes = Notes::new(Mutex::new(Recording { baud: kind.baud, chunks: Vec::new() }));
    (kind.hold)(turnaround_ns, kind.baud, Arc::clone(&notes));
    Arc::into_inner(notes).unwrap().into_inner().unwrap()
}

#[test]
fn a_recording_states_the_turnaround_of_the_virtual_drive() {
    for kind in &KINDS {
        for turnaround_ns in [100_000, MS / 2, 2 * MS, 5 * MS] {
            let found = timing(&recorded(kind, turnaround_ns));
            let [_, stated_s, ..] = found.turnaround_s.unwrap();
            let twin_s = turnaround_ns as f64 * 1e-9;
            assert!(
                (stated_s - twin_s).abs() < TOLERANCE_S,
                "{}: {twin_s} s are stated as {stated_s} s: {found:?}",
                kind.name
            );
            assert!(found.outrun_baud.is_none() && found.unanswered * 20 < found.questions, "{}: {found:?}", kind.name);
            // A virtual drive that is fitted to it is as fast.
            let fitted = timing(&recorded(kind, (stated_s * 1e9).round() as u64));
            let again_s = fitted.turnaround_s.unwrap()[1];
            assert!((again_s - stated_s).abs() < TOLERANCE_S, "{}: {stated_s} s are stated as {again_s} s", kind.name);
        }
    }
}
