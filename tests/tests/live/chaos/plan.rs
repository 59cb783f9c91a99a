//! Plan of the faults to inject: drawn from the table of faults, the same for the same seed.

use messages::MotorAuthority;
use nims::fault::{ROWS, Row};
use rustix::process::Signal;

/// Faults between two starts of the robot.
const ROUND: usize = 8;
const CABLES: usize = 3;
/// Drive units of the system file, all on port 1.
const UNITS: [u8; 2] = [128, 129];

/// SplitMix64: the faults must be irregular, not unpredictable.
pub struct Random(pub u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    pub fn below(&mut self, end: usize) -> usize {
        (self.next() % end as u64) as usize
    }

    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * (self.next() >> 11) as f64 / (1u64 << 53) as f64
    }
}

/// Action of a fault.
#[derive(Debug, Clone)]
pub enum How {
    /// On the motor box: the request, and the one that ends the fault.
    Box(String, Option<String>),
    /// On a process.
    Signal(Signal),
    /// On the samples of a process.
    Output(String),
}

#[derive(Debug, Clone)]
pub struct Fault {
    /// Its name for `nims fault`.
    pub what: String,
    /// Its row of the table.
    pub row: Row,
    pub how: How,
    /// The process; of two, the one in charge.
    pub process: &'static str,
    /// The cable that may become slack, from 0.
    pub cable: Option<usize>,
    /// Time that it lasts after detection, s.
    pub lasts_s: f64,
}

/// How a round ends.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ending {
    /// With Ctrl-C in flight.
    Plain,
    /// With a broken cable, which only a person can repair.
    Break(usize),
    /// The supervisor is killed in flight.
    Supervisor,
    /// All processes are killed in flight.
    Everything,
}

/// The time from one start of the robot to its end.
#[derive(Debug)]
pub struct Round {
    /// Whether every process runs twice.
    pub standby: bool,
    pub faults: Vec<Fault>,
    pub ending: Ending,
}

/// Every fault from which the robot can be recovered.
fn rows() -> Vec<Row> {
    let back = |row: &&Row| !["plug", "continue", "break"].contains(&row.kind());
    let widened = |row: &Row| {
        // A jam may show in the motor's current before it shows in the cable.
        let current = MotorAuthority::FAULT_OVER_CURRENT | MotorAuthority::FAULT_OVER_TENSION;
        Row { bits: row.bits | if row.kind() == "stall" { current } else { 0 }, ..*row }
    };
    ROWS.iter().filter(back).map(widened).collect()
}

/// So many faults, in rounds with and without standbys; every kind occurs before any occurs again.
pub fn rounds(count: usize, random: &mut Random) -> Vec<Round> {
    let number = count.div_ceil(ROUND).max(2);
    let mut bags: [Vec<Row>; 2] = Default::default();
    (0..number)
        .map(|i| {
            let standby = i % 2 == 1;
            let size = (i + 1) * count / number - i * count / number;
            let bag = &mut bags[usize::from(standby)];
            let faults = (0..size)
                .map(|_| {
                    if bag.is_empty() {
                        *bag = rows();
                    }
                    let row = bag.swap_remove(random.below(bag.len()));
                    fault(row, random)
                })
                .collect();
            let ending = match i % 4 {
                _ if i + 1 == number => Ending::Plain,
                0 => Ending::Everything,
                1 => Ending::Break(random.below(CABLES)),
                2 => Ending::Supervisor,
                _ => Ending::Plain,
            };
            Round { standby, faults, ending }
        })
        .collect()
}

fn fault(row: Row, random: &mut Random) -> Fault {
    let cable = random.below(CABLES);
    let unit = UNITS[random.below(UNITS.len())];
    let number = cable + 1;
    let off = |text: &str| Some(text.to_owned());
    let (text, repair) = match row.kind() {
        "noise" => (format!("noise 1 {:.5}", random.between(0.0002, 0.001)), off("noise 1 off")),
        "silence" => ("silence 1".to_owned(), off("silence 1 off")),
        "late" => (format!("late 1 {:.3}", random.between(0.04, 0.2)), off("late 1 off")),
        "mute" => (format!("mute 1 {unit}"), None),
        "unplug" => ("unplug 1".to_owned(), off("plug 1")),
        "reboot" => (format!("reboot 1 {unit} for {:.2}", random.between(0.1, 0.5)), None),
        "supply" => (format!("supply {:.1}", random.between(6.0, 15.0)), off("supply 24")),
        "jump" => {
            let sign = if random.below(2) == 0 { "" } else { "-" };
            (format!("jump {number} {sign}{}", 300 + random.below(2700)), None)
        }
        "slip" => (format!("slip {number} 1.0"), Some(format!("slip {number} off"))),
        "estop" => (format!("estop 1 {unit}"), Some(format!("estop 1 {unit} off"))),
        kind @ ("stall" | "dead") => (format!("{kind} {number}"), Some(format!("{kind} {number} off"))),
        _ => (String::new(), None),
    };
    let lasts_s = if row.bits == 0 { random.between(0.5, 1.5) } else { random.between(0.0, 0.6) };
    let process = row.example.split(' ').nth(1).filter(|_| text.is_empty()).unwrap_or("motor-box");
    let (what, how, cable) = match row.kind() {
        "stop" => (row.example.to_owned(), How::Signal(Signal::STOP), None),
        "kill" => (row.example.to_owned(), How::Signal(Signal::KILL), None),
        "slow" => {
            let cycles = 1 + random.below(50);
            (format!("slow {process} {cycles}"), How::Output(format!("slow {cycles}")), None)
        }
        kind @ ("nan" | "frozen") => (row.example.to_owned(), How::Output(kind.to_owned()), None),
        kind => {
            let of_cable = ["stall", "dead", "slip", "jump"].contains(&kind);
            (text.clone(), How::Box(text, repair), of_cable.then_some(cable))
        }
    };
    Fault { what, row, how, process, cable, lasts_s }
}

/// Every drawn fault is a fault of the motor box or names a process, so each row of the table can be injected.
#[test]
fn every_row_can_be_struck() {
    let mut random = Random(1);
    for row in rows() {
        let fault = fault(row, &mut random);
        match fault.how {
            How::Box(text, repair) => {
                for text in std::iter::once(text).chain(repair) {
                    assert!(text.parse::<motor_box::FaultRequest>().is_ok(), "{}: `{text}`", row.example);
                }
                assert_eq!(fault.process, "motor-box");
            }
            How::Signal(_) | How::Output(_) => assert!(row.example.contains(fault.process), "{}", row.example),
        }
    }
}
