//! Several ports with a thread each: real pseudo-terminals for plugging, simulated lines for everything that has to be
//! exact.

use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;

use drives::{Capabilities, Command, CountBound, Error, Fleet, FleetCommand, FleetReply, InvalidConfig};
use roboclaw::driver::WIRE_MARGIN_NS;
use roboclaw::unit::{Unit, UnitBus, UnitOptions};
use roboclaw::{Bus, BusConfig, UnitConfig};
use serial::{Device, Pipe, PtyLink, ReopeningPort, WireQueue, monotonic_ns, sleep_until};

const MS: u64 = 1_000_000;
/// Long enough that a machine which stands still for a quarter of a second makes no test fail.
const PATIENCE_NS: u64 = 400 * MS;

/// Units behind a jack, answered by a thread.
struct Socket {
    jack: Arc<Mutex<PtyLink>>,
    bus: Arc<Mutex<UnitBus>>,
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
    folder: PathBuf,
}

impl Socket {
    fn new(addresses: &[u8]) -> Socket {
        static NEXT: AtomicU32 = AtomicU32::new(0);
        let name = format!("nims-fleet-{}-{}", std::process::id(), NEXT.fetch_add(1, Ordering::Relaxed));
        let folder = std::env::temp_dir().join(name);
        let mut jack = PtyLink::new(&folder.join("port"));
        jack.plug().unwrap();
        let units = addresses.iter().map(|&address| Unit::new(UnitOptions::new(address))).collect();
        let jack = Arc::new(Mutex::new(jack));
        let line = Arc::new(Mutex::new(UnitBus::new(units)));
        let stop = Arc::new(AtomicBool::new(false));
        let thread = std::thread::spawn({
            let (jack, line, stop) = (Arc::clone(&jack), Arc::clone(&line), Arc::clone(&stop));
            move || serve(&jack, &line, &stop)
        });
        Socket { jack, bus: line, stop, thread: Some(thread), folder }
    }

    fn bus(&self, addresses: &[u8]) -> Bus<ReopeningPort> {
        bus_at(self.link().to_str().unwrap(), addresses, PATIENCE_NS)
    }

    fn link(&self) -> PathBuf {
        self.jack.lock().unwrap().link().to_owned()
    }
}

impl Drop for Socket {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
        self.jack.lock().unwrap().unplug();
        let _ = std::fs::remove_dir_all(&self.folder);
    }
}

fn serve(jack: &Mutex<PtyLink>, line: &Mutex<UnitBus>, stop: &AtomicBool) {
    let mut reply = WireQueue::new(0);
    while !stop.load(Ordering::Relaxed) {
        let now_ns = monotonic_ns();
        if let Some(pty) = jack.lock().unwrap().pty() {
            let mut buffer = [0; 256];
            let n = pty.read(&mut buffer).unwrap();
            let mut line = line.lock().unwrap();
            line.advance(now_ns);
            for &byte in &buffer[..n] {
                line.receive(now_ns, byte, &mut reply);
            }
            while let Some((_, byte)) = reply.pop(u64::MAX) {
                pty.write(&[byte]).unwrap();
            }
        }
        sleep_until(now_ns + MS / 4);
    }
}

fn bus_config(addresses: &[u8], margin_ns: u64) -> BusConfig {
    let unit = |&address| UnitConfig { address, watchdog_tenths: 30, bound: CountBound::NONE };
    BusConfig { baud: 0, margin_ns, units: addresses.iter().map(unit).collect(), stop_pin: None }
}

fn bus_at(path: &str, addresses: &[u8], margin_ns: u64) -> Bus<ReopeningPort> {
    Bus::new(ReopeningPort::new(path, 0), &bus_config(addresses, margin_ns)).unwrap()
}

const RUN: Command = Command::Velocity(100.0);

fn all(command: Command, cycle: u64) -> FleetCommand {
    FleetCommand { cycle, units: [[Some(command); 2]; 8] }
}

/// Cycles until a reply is as wanted; the number of cycles is bounded, not the time.
fn until(fleet: &mut Fleet, budget_ns: u64, drive: Command, wanted: impl Fn(&FleetReply) -> bool) -> FleetReply {
    for cycle in 1..2000 {
        let start_ns = monotonic_ns();
        let reply = fleet.exchange(&all(drive, cycle), start_ns + budget_ns);
        assert_eq!(reply.cycle, cycle);
        if wanted(reply) {
            return reply.clone();
        }
        fleet.spend(0);
        sleep_until(start_ns + 5 * MS);
    }
    panic!("never as wanted: {:?}", fleet.exchange(&all(drive, 0), monotonic_ns() + budget_ns));
}

fn well(reply: &FleetReply) -> bool {
    reply.units.iter().all(|unit| unit.outcome.is_ok())
}

#[test]
fn ports_come_up_go_and_come_back_one_by_one() {
    let (one, two) = (Socket::new(&[0x80, 0x81]), Socket::new(&[0x80]));
    let mut fleet = Fleet::open(vec![one.bus(&[0x80, 0x81]), two.bus(&[0x80])], Capabilities::NONE).unwrap();
    assert_eq!(fleet.unit_count(), 3);
    assert_eq!([0, 1, 2].map(|unit| fleet.port_of(unit)), [Some(0), Some(0), Some(1)]);
    until(&mut fleet, PATIENCE_NS, Command::HOLD, well);
    assert!(fleet.units().iter().all(|unit| unit.firmware.is_some() && unit.watchdog_ms == Some(3000)));
    let reply = until(&mut fleet, PATIENCE_NS, RUN, well);
    assert!(reply.ports.iter().all(|port| port.lost.is_none() && port.counters.connections == 1));

    two.jack.lock().unwrap().unplug();
    let reply = until(&mut fleet, PATIENCE_NS, RUN, |reply| reply.ports[1].lost.is_some());
    assert!(reply.units[2].outcome.as_ref().is_err_and(Error::is_lost), "{reply:?}");
    assert!(reply.units[..2].iter().all(|unit| unit.outcome.is_ok()), "the other port continues: {reply:?}");

    two.jack.lock().unwrap().plug().unwrap();
    let interlocked = |reply: &FleetReply| {
        matches!(reply.units[2].outcome, Err(Error::Interlocked { .. })) && reply.ports[1].lost.is_none()
    };
    let reply = until(&mut fleet, PATIENCE_NS, RUN, interlocked);
    assert_eq!(reply.ports[1].counters.connections, 2);
    assert_eq!(reply.units[2].report.reboots, 0);
    until(&mut fleet, PATIENCE_NS, Command::HOLD, well);
    until(&mut fleet, PATIENCE_NS, RUN, well);
}

#[test]
fn a_restart_is_found_out_on_a_real_terminal() {
    let socket = Socket::new(&[0x80]);
    let mut fleet = Fleet::open(vec![socket.bus(&[0x80])], Capabilities::NONE).unwrap();
    until(&mut fleet, PATIENCE_NS, Command::HOLD, well);
    socket.bus.lock().unwrap().units_mut()[0].reboot(0);
    let reply = until(&mut fleet, PATIENCE_NS, RUN, |reply| reply.units[0].report.reboots == 1);
    assert!(reply.units[0].outcome.is_err() || reply.units[0].report.reboots == 1);
}

#[test]
fn a_port_that_was_never_there_is_missing_by_its_name() {
    let missing = std::env::temp_dir().join(format!("nims-no-such-port-{}", std::process::id()));
    let bus = bus_at(missing.to_str().unwrap(), &[0x80], PATIENCE_NS);
    let mut fleet = Fleet::open(vec![bus], Capabilities::NONE).unwrap();
    let reply = until(&mut fleet, PATIENCE_NS, Command::HOLD, |reply| reply.ports[0].lost.is_some());
    let error = reply.units[0].outcome.clone().unwrap_err();
    assert_eq!(error, Error::Serial(serial::Error::Missing { port: missing.to_str().unwrap().into() }));
    assert!(error.to_string().contains(missing.to_str().unwrap()), "{error}");
}

#[test]
fn a_silent_port_is_busy_at_the_deadline_and_the_other_has_answered() {
    let line = |mute_until_ns| {
        let mut unit = Unit::new(UnitOptions::new(0x80));
        unit.mute_until(mute_until_ns);
        UnitBus::new(vec![unit])
    };
    // Simulated lines jump over the waiting, so this is exact whatever the machine does.
    let config = bus_config(&[0x80], WIRE_MARGIN_NS);
    let buses = [("good", 0), ("silent", u64::MAX)]
        .map(|(name, mute_until_ns)| Bus::new(Pipe::new(name, 0, line(mute_until_ns)), &config).unwrap());
    let mut fleet = Fleet::open(buses.into(), Capabilities::NONE).unwrap();
    let reply = until(&mut fleet, PATIENCE_NS, Command::HOLD, |reply| {
        reply.units[0].outcome.is_ok() && matches!(reply.units[1].outcome, Err(Error::Silent { .. }))
    });
    assert_eq!(reply.ports[0].counters.timeouts, 0);
    assert!(reply.ports[1].counters.timeouts > 0);
}

/// Never answers, and takes its time over it.
struct Stuck;

impl Device for Stuck {
    fn receive(&mut self, _now_ns: u64, _byte: u8, _reply: &mut WireQueue) {
        sleep_until(monotonic_ns() + 200 * MS);
    }
}

#[test]
fn a_port_that_hangs_does_not_hold_up_the_caller() {
    let bus = Bus::new(Pipe::new("stuck", 0, Stuck), &bus_config(&[0x80], WIRE_MARGIN_NS)).unwrap();
    let mut fleet = Fleet::open(vec![bus], Capabilities::NONE).unwrap();
    // Once its thread has begun: before, it has no processor, and a busy machine may take milliseconds to give it one.
    let begun = fleet.exchange(&all(Command::HOLD, 0), monotonic_ns() + PATIENCE_NS);
    assert!(matches!(begun.units[0].outcome, Err(Error::Resynchronising { .. })), "{begun:?}");
    // One exchange with it takes most of a second; every call ends by its own deadline all the same, and states what
    // the port is at.
    for cycle in 1..20 {
        let reply = fleet.exchange(&all(Command::HOLD, cycle), monotonic_ns() + 2 * MS);
        assert!(matches!(reply.units[0].outcome, Err(Error::Resynchronising { .. })), "{reply:?}");
    }
}

#[test]
fn ports_and_units_are_counted_and_named_once() {
    let bus = |path: &str, units: usize| {
        bus_at(path, &(0..units as u8).map(|unit| 0x80 + unit).collect::<Vec<_>>(), WIRE_MARGIN_NS)
    };
    let refuse = |buses: Vec<Bus<ReopeningPort>>, needed| Fleet::open(buses, needed).map(|_| ()).unwrap_err();
    let wrong = |what| Error::Configuration { port: "/dev/a".into(), what };
    assert_eq!(refuse(vec![bus("/dev/a", 1), bus("/dev/a", 1)], Capabilities::NONE), wrong(InvalidConfig::PortTwice));
    assert_eq!(
        refuse(vec![bus("/dev/a", 5), bus("/dev/b", 4)], Capabilities::NONE),
        wrong(InvalidConfig::TooManyUnits)
    );
    let torque = Capabilities { torque: true, ..Capabilities::NONE };
    assert_eq!(refuse(vec![bus("/dev/a", 1)], torque), wrong(InvalidConfig::Lacks("closed-loop torque")));
}
