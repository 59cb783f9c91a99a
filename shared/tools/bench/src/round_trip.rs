//! `bus`: round-trip time of a sample of the size of `motor/state` to another process, over the bus as in the control
//! chain, and over a pair of Unix datagram sockets between the same processes. Both are measured once per millisecond,
//! one after the other.

use super::figures::{Ratio, Spread, record};
use super::peer::{self, FROM_PEER, TO_PEER};
use super::place::PrivateDomain;
use super::scheduling;
use super::settings::Settings;
use super::watch::Watch;
use bus::clock::{Pacer, now_ns};
use bus::{Bus, Publisher, Subscriber, Waiter};
use command::{Answer, Failure};
use messages::{Message, MotorState};
use runtime::Timing;
use serde::Serialize;
use std::io::ErrorKind;
use std::os::fd::OwnedFd;
use std::os::unix::net::UnixDatagram;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::Duration;

/// Pause between two pairs of round trips, ns: long enough for both processes to fall asleep, as in the control chain.
const PAUSE_NS: u64 = 1_000_000;
/// Number of round trips that are not counted, because connecting takes extra time once.
const WARM_UP: u64 = 20;
/// Interval between two checks whether the peer is alive.
const POLL_INTERVAL: Duration = Duration::from_millis(200);
/// Number of checks without an answer from a living peer before giving up. The machine may stall for any time in
/// between.
const PATIENCE: u32 = 150;

/// Result of `bus`.
#[derive(Debug, Clone, Serialize)]
pub struct BusResult {
    /// Size of the sample, bytes.
    pub sample_bytes: usize,
    /// Round trips over the bus.
    pub ours: Spread,
    /// Round trips over datagram sockets.
    pub plain: Spread,
    /// Sockets divided by bus.
    pub ratio: Ratio,
    /// Scheduling of both processes.
    pub scheduling: scheduling::AchievedScheduling,
}

/// The peer process, killed on drop.
struct Peer {
    child: Child,
    socket: UnixDatagram,
}

impl Peer {
    /// Starts this program as the peer.
    fn start(domain: &PrivateDomain) -> Answer<Self> {
        let cannot = |error: std::io::Error| Failure::NotNow(format!("the other process cannot be started: {error}"));
        let (socket, theirs) = UnixDatagram::pair().map_err(cannot)?;
        socket.set_read_timeout(Some(POLL_INTERVAL)).map_err(cannot)?;
        let own = std::env::current_exe().map_err(cannot)?;
        let child = Command::new(own)
            .args([peer::COMMAND, domain.domain().name()])
            .stdin(Stdio::piped()) // the peer ends when this pipe is closed
            .stdout(Stdio::from(OwnedFd::from(theirs)))
            .stderr(Stdio::null())
            .spawn()
            .map_err(cannot)?;
        Ok(Self { child, socket })
    }

    /// Returns an error if the peer has ended or does not answer after this many checks.
    fn check_alive(&mut self, looks: u32, watch: &Watch) -> Answer {
        watch.check_stop()?;
        if let Ok(Some(status)) = self.child.try_wait() {
            return Err(ended(&status));
        }
        if looks < PATIENCE { Ok(()) } else { Err(Failure::NotNow("the other process does not answer".to_owned())) }
    }

    /// Converts a socket error, which means that the peer closed its end.
    fn socket_failure(&mut self, error: &std::io::Error) -> Failure {
        // It is about to end, if it has not ended yet.
        let _ = self.child.kill();
        match self.child.wait() {
            Ok(status) => ended(&status),
            Err(_) => Failure::NotNow(format!("the other process cannot be reached over its socket: {error}")),
        }
    }

    /// Receives the next datagram.
    fn receive(&mut self, buffer: &mut [u8], watch: &Watch) -> Answer<usize> {
        for looks in 0.. {
            match self.socket.recv(buffer) {
                Ok(bytes) => return Ok(bytes),
                Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted) => {
                    self.check_alive(looks, watch)?;
                }
                Err(error) => return Err(self.socket_failure(&error)),
            }
        }
        Err(Failure::NotNow("the other process does not answer".to_owned()))
    }

    /// Waits until the peer is ready.
    fn wait_ready(&mut self, watch: &Watch) -> Answer {
        let mut said = [0; 512];
        let bytes = self.receive(&mut said, watch)?;
        match &said[..bytes] {
            said if said == peer::READY => Ok(()),
            sentence => Err(Failure::NotNow(format!("the other process: {}", String::from_utf8_lossy(sentence)))),
        }
    }
}

fn ended(status: &ExitStatus) -> Failure {
    Failure::NotNow(format!("the other process ended before the end of the measurement ({status})"))
}

impl Drop for Peer {
    fn drop(&mut self) {
        // It may have ended already.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Ports of this process on the bus.
struct Ports {
    there: Publisher<MotorState>,
    back: Subscriber<MotorState>,
    waiter: Waiter,
}

impl Ports {
    fn open(bus: &Bus) -> Answer<Self> {
        Ok(Self { there: bus.publisher(TO_PEER)?, back: bus.subscriber(FROM_PEER)?, waiter: bus.waiter(&[FROM_PEER])? })
    }

    fn round(&mut self, number: u64, peer: &mut Peer, watch: &Watch) -> Answer<(u64, u64)> {
        let mut sample = sample(number);
        let begin_ns = now_ns();
        self.there.send(&mut sample)?;
        for looks in 0.. {
            self.waiter.wait_until(Some(now_ns() + POLL_INTERVAL.as_nanos() as u64))?;
            while let Some(back) = self.back.receive()? {
                if back.header().cycle == number {
                    return Ok((begin_ns, now_ns()));
                }
            }
            if now_ns().saturating_sub(begin_ns) > POLL_INTERVAL.as_nanos() as u64 {
                peer.check_alive(looks, watch)?;
            }
        }
        Err(Failure::NotNow("the other process does not answer".to_owned()))
    }
}

fn sample(number: u64) -> MotorState {
    let mut sample = MotorState { cable_count: 4, ..MotorState::default() };
    sample.header_mut().cycle = number;
    sample
}

fn by_socket(number: u64, peer: &mut Peer, watch: &Watch) -> Answer<(u64, u64)> {
    let (sample, mut back) = (sample(number), MotorState::default());
    let begin_ns = now_ns();
    if let Err(error) = peer.socket.send(bytemuck::bytes_of(&sample)) {
        return Err(peer.socket_failure(&error));
    }
    while back.header().cycle != number {
        peer.receive(bytemuck::bytes_of_mut(&mut back), watch)?;
    }
    Ok((begin_ns, now_ns()))
}

/// Measures for this many seconds.
///
/// # Errors
/// The benchmark was stopped, the peer ended, or shared memory is full.
pub fn measure(settings: &Settings, seconds: f64, watch: &mut Watch) -> Answer<BusResult> {
    let wanted = ((seconds * 1e9 / PAUSE_NS as f64).round() as u64).max(1);
    // The domain outlives the thread, which holds the ports.
    let domain = PrivateDomain::create()?;
    let quiet = Watch::quiet(watch.stop());
    std::thread::scope(|scope| {
        let measured = scope.spawn(|| measure_in_thread(settings, &domain, wanted, &quiet));
        while !measured.is_finished() {
            watch.update();
            std::thread::sleep(Watch::INTERVAL);
        }
        measured.join().map_err(|_| Failure::NotNow("the thread that measures ended early".to_owned()))?
    })
}

/// Measures in a separate thread, whose scheduling the peer inherits.
fn measure_in_thread(settings: &Settings, domain: &PrivateDomain, wanted: u64, watch: &Watch) -> Answer<BusResult> {
    let (scheduling, _awake) = scheduling::apply(&settings.realtime);
    let mut peer = Peer::start(domain)?;
    peer.wait_ready(watch)?;
    let bus = Bus::join(domain.domain(), "bench")?;
    let mut ports = Ports::open(&bus)?;
    let (mut ours, mut plain) = (Timing::new(), Timing::new());
    let (mut pacer, mut passed) = (Pacer::new(PAUSE_NS), 0);
    for number in 1_u64.. {
        passed += 1 + pacer.next().skipped;
        // The second round trip finds the peer recently awake, so the order alternates.
        let first_ours = number % 2 == 0;
        let mut trip = None;
        if first_ours {
            trip = Some(ports.round(number, &mut peer, watch)?);
        }
        let by_socket = by_socket(number, &mut peer, watch)?;
        let (begin_ns, end_ns) = match trip {
            Some(trip) => trip,
            None => ports.round(number, &mut peer, watch)?,
        };
        if number <= WARM_UP {
            passed = 0;
            continue;
        }
        record(&mut ours, begin_ns, end_ns);
        record(&mut plain, by_socket.0, by_socket.1);
        watch.check_stop()?;
        if passed >= wanted {
            break;
        }
    }
    let (ours, plain) = (Spread::from_timing(&ours), Spread::from_timing(&plain));
    let ratio = Ratio::between(&plain, &ours);
    Ok(BusResult { sample_bytes: size_of::<MotorState>(), ours, plain, ratio, scheduling })
}
