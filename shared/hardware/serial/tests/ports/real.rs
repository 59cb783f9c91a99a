//! Real pseudo-terminals: what a program sees when its device is there, taken, gone, and back.

use std::fs;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};

use serial::{Error, Port, PortState, Pty, PtyLink, ReopeningPort, Transport, monotonic_ns};

const MS: u64 = 1_000_000;
/// Far longer than any of this takes, even on a machine that stands still for a quarter of a second now and then.
const PATIENCE_NS: u64 = 5_000 * MS;

/// A folder of this test's own, removed at its end.
struct Folder(PathBuf);

impl Folder {
    fn new() -> Folder {
        static NEXT: AtomicU32 = AtomicU32::new(0);
        let name = format!("nims-serial-{}-{}", std::process::id(), NEXT.fetch_add(1, Ordering::Relaxed));
        let path = std::env::temp_dir().join(name);
        fs::create_dir_all(&path).unwrap();
        Folder(path)
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}

fn soon() -> u64 {
    monotonic_ns() + PATIENCE_NS
}

fn name_of(pty: &Pty) -> Arc<str> {
    pty.path().to_str().unwrap().into()
}

fn read_bytes(pty: &Pty, wanted: usize) -> Vec<u8> {
    let (mut got, until) = (Vec::new(), soon());
    while got.len() < wanted && monotonic_ns() < until {
        let mut buffer = [0; 64];
        let n = pty.read(&mut buffer).unwrap();
        got.extend_from_slice(&buffer[..n]);
        if n == 0 {
            serial::sleep_until(monotonic_ns() + MS / 5);
        }
    }
    got
}

#[test]
fn every_byte_value_passes_both_ways() {
    let pty = Pty::open().unwrap();
    let mut port = Port::open(&name_of(&pty), 230_400).unwrap();
    let all: Vec<u8> = (0..=255).collect();
    port.write_all(&all, soon()).unwrap();
    assert_eq!(read_bytes(&pty, 256), all);
    assert_eq!(pty.write(&all).unwrap(), 256);
    let mut back = [0; 256];
    assert_eq!(port.fill(&mut back, soon()).unwrap(), 256);
    assert_eq!(back.as_slice(), all);
}

#[test]
fn a_deadline_ends_a_read_and_a_past_one_takes_only_what_is_there() {
    let pty = Pty::open().unwrap();
    let mut port = Port::open(&name_of(&pty), 115_200).unwrap();
    let mut buffer = [0; 8];
    let deadline = monotonic_ns() + 5 * MS;
    assert_eq!(port.read(&mut buffer, deadline).unwrap(), 0);
    assert!(monotonic_ns() >= deadline);
    pty.write(b"abc").unwrap();
    while port.pending().unwrap() < 3 {
        serial::sleep_until(monotonic_ns() + MS / 5);
    }
    assert_eq!(port.fill(&mut buffer, 0).unwrap(), 3);
}

#[test]
fn what_an_earlier_program_left_unread_is_thrown_away() {
    let pty = Pty::open().unwrap();
    pty.write(b"stale").unwrap();
    serial::sleep_until(monotonic_ns() + 5 * MS);
    let mut port = Port::open(&name_of(&pty), 115_200).unwrap();
    assert_eq!(port.pending().unwrap(), 0);
}

#[test]
fn a_port_is_held_by_one_program_alone_and_free_after_it() {
    let pty = Pty::open().unwrap();
    let name = name_of(&pty);
    let first = Port::open(&name, 115_200).unwrap();
    assert!(matches!(Port::open(&name, 115_200), Err(Error::Busy { .. })));
    drop(first);
    pty.release_exclusive();
    Port::open(&name, 115_200).unwrap();
}

#[test]
fn a_missing_device_and_a_thing_that_is_no_port_are_told_apart() {
    let folder = Folder::new();
    let missing: Arc<str> = folder.0.join("no-such-port").to_str().unwrap().into();
    let error = Port::open(&missing, 115_200).unwrap_err();
    assert!(matches!(error, Error::Missing { .. }), "{error:?}");
    let file = folder.0.join("file");
    fs::write(&file, "text").unwrap();
    let file: Arc<str> = file.to_str().unwrap().into();
    let error = Port::open(&file, 115_200).unwrap_err();
    assert!(matches!(&error, Error::Unusable { port, baud: 115_200, .. } if *port == file), "{error:?}");
}

#[test]
fn a_line_finds_its_device_gone_at_once_and_back_after_replugging() {
    let folder = Folder::new();
    let mut jack = PtyLink::new(&folder.0.join("box/port-0"));
    let mut line = ReopeningPort::new(jack.link().to_str().unwrap(), 115_200);
    assert!(matches!(line.connection(), Err(Error::Missing { .. })));

    jack.plug().unwrap();
    let first = connect(&mut line);
    assert_eq!((first, line.state()), (1, PortState::Connected));
    jack.pty().unwrap().write(b"x").unwrap();
    let mut byte = [0];
    assert_eq!(line.fill(&mut byte, soon()).unwrap(), 1);

    jack.unplug();
    assert!(!jack.link().exists());
    // The deadline is far away: the error comes from the unplugging, not from patience running out.
    assert!(matches!(line.read(&mut byte, soon()), Err(Error::Gone { .. })));
    assert!(matches!(line.state(), PortState::Lost(Error::Gone { .. })));
    assert!(line.write_all(b"x", soon()).is_err());
    assert!(line.connection().is_err());

    jack.plug().unwrap();
    assert_eq!(connect(&mut line), 2);
    line.write_all(b"back", soon()).unwrap();
    assert_eq!(read_bytes(jack.pty().unwrap(), 4), b"back");
}

fn connect(line: &mut ReopeningPort) -> u32 {
    let until = soon();
    loop {
        match line.connection() {
            Ok(number) => return number,
            Err(error) => assert!(monotonic_ns() < until, "{error}"),
        }
        serial::sleep_until(line.next_try_ns().unwrap());
    }
}

#[test]
fn a_jack_replaces_an_old_link_but_never_a_file_and_leaves_nothing_behind() {
    let folder = Folder::new();
    let link = folder.0.join("port");
    std::os::unix::fs::symlink("/nowhere", &link).unwrap();
    let mut jack = PtyLink::new(&link);
    jack.plug().unwrap();
    assert_eq!(fs::read_link(&link).unwrap(), jack.pty().unwrap().path());
    drop(jack);
    assert_eq!(fs::read_dir(&folder.0).unwrap().count(), 0);

    fs::write(&link, "precious").unwrap();
    let error = PtyLink::new(&link).plug().unwrap_err();
    assert_eq!(error, Error::NotALink { port: link.to_str().unwrap().into() });
    assert_eq!(fs::read_to_string(&link).unwrap(), "precious");
}

#[test]
fn bytes_nobody_reads_can_be_discarded() {
    let pty = Pty::open().unwrap();
    let mut port = Port::open(&name_of(&pty), 115_200).unwrap();
    pty.write(b"unread").unwrap();
    while port.pending().unwrap() < 6 {
        serial::sleep_until(monotonic_ns() + MS / 5);
    }
    pty.discard_unread();
    assert_eq!(port.pending().unwrap(), 0);
}

/// A simulated device that stood still meanwhile has all of its time to answer.
#[test]
fn what_a_device_leaves_out_does_not_count_against_it() {
    let folder = Folder::new();
    let link = folder.0.join("drive0");
    let mut jack = PtyLink::new(&link);
    jack.plug().unwrap();
    let mut line = ReopeningPort::new(link.to_str().unwrap(), 230_400);
    line.connection().unwrap();
    assert!(!line.clock().unwrap().is_simulated(), "no file tells of any time");
    drop(line);

    let (say, said) = std::sync::mpsc::channel();
    let (go, goes) = std::sync::mpsc::channel::<()>();
    let device = {
        let link = link.clone();
        std::thread::spawn(move || {
            let left_out = serial::LeftOutClock::create(&link).unwrap();
            say.send(()).unwrap();
            goes.recv().unwrap();
            assert!(left_out.program().is_some());
            left_out.write(300 * MS).unwrap();
            goes.recv().unwrap();
        })
    };
    said.recv().unwrap();
    let mut line = ReopeningPort::new(link.to_str().unwrap(), 230_400);
    line.connection().unwrap();
    let (began_ns, deadline_ns) = (monotonic_ns(), line.now_ns() + 50 * MS);
    go.send(()).unwrap();
    assert_eq!(line.read(&mut [0; 8], deadline_ns).unwrap(), 0);
    let passed_ns = monotonic_ns() - began_ns;
    assert!(passed_ns >= 350 * MS, "waited for {passed_ns} ns only");
    // Its clock has reached the deadline, has never gone back, and stamps are those of the machine.
    assert!(line.now_ns() >= deadline_ns && line.stamp_ns() >= began_ns + passed_ns);
    assert_eq!(line.clock().unwrap().left_out_ns(), 300 * MS);
    go.send(()).unwrap();
    device.join().unwrap();
}

/// A device with the file of its clock, and a line that is open to it.
fn plugged(folder: &Folder) -> (PtyLink, serial::LeftOutClock, ReopeningPort) {
    let link = folder.0.join("drive0");
    let mut jack = PtyLink::new(&link);
    jack.plug().unwrap();
    let device = serial::LeftOutClock::create(&link).unwrap();
    let mut line = ReopeningPort::new(link.to_str().unwrap(), 230_400);
    line.connection().unwrap();
    (jack, device, line)
}

/// Closing and opening can block, which a caller with other work must not.
#[test]
fn an_inline_line_neither_closes_a_lost_device_nor_opens_it_again() {
    let folder = Folder::new();
    let (mut jack, device, mut line) = plugged(&folder);
    assert!(device.program().is_some());

    line.set_inline(true);
    jack.unplug();
    assert!(matches!(line.read(&mut [0], soon()), Err(Error::Gone { .. })));
    jack.plug().unwrap();
    serial::sleep_until(line.next_try_ns().unwrap());
    assert!(matches!(line.connection(), Err(Error::Gone { .. })), "it was opened");
    assert!(device.program().is_some(), "it was closed");

    line.set_inline(false);
    assert!(device.program().is_none(), "it is still open");
    assert_eq!(connect(&mut line), 2);
}

/// The operation that finds the device gone returns at once; the device is closed before the next attempt to open it.
#[test]
fn a_line_with_a_thread_of_its_own_reports_a_loss_before_it_closes_the_device() {
    let folder = Folder::new();
    let (mut jack, device, mut line) = plugged(&folder);
    jack.unplug();
    assert!(matches!(line.read(&mut [0], soon()), Err(Error::Gone { .. })));
    assert!(line.connection().is_err());
    assert!(device.program().is_some(), "it was closed");
    serial::sleep_until(line.next_try_ns().unwrap());
    assert!(matches!(line.connection(), Err(Error::Missing { .. })));
    assert!(device.program().is_none(), "it is still open");
}

/// However bytes and reads are cut, no byte that is there is waited for: the deadline never comes.
#[test]
fn bytes_are_read_in_any_pieces() {
    let pty = Pty::open().unwrap();
    let mut port = Port::open(&name_of(&pty), 115_200).unwrap();
    let mut random = serial::Random::new(7);
    let (mut sent, mut got) = (0_usize, 0_usize);
    let deadline = monotonic_ns() + 3_600_000 * MS;
    while got < 100_000 {
        // At times several pieces before a read, at times none.
        for _ in 0..random.byte() % 4 {
            let piece: Vec<u8> = (0..1 + usize::from(random.byte() % 40)).map(|i| (sent + i) as u8).collect();
            if sent - got < 1000 {
                sent += pty.write(&piece).unwrap();
            }
        }
        if sent == got {
            let mut none = [0; 8];
            let soon = monotonic_ns() + u64::from(random.byte() % 3) * MS / 2;
            assert_eq!(port.read(&mut none, soon).unwrap(), 0);
            continue;
        }
        let mut buffer = vec![0; 1 + usize::from(random.byte() % 60)];
        let least = (sent - got).min(1 + usize::from(random.byte() % 20)).min(buffer.len());
        let n = port.fill_at_least(&mut buffer, least, deadline).unwrap();
        assert!(n >= least);
        assert!(buffer[..n].iter().enumerate().all(|(i, byte)| *byte == (got + i) as u8), "after {got} bytes");
        got += n;
    }
}
