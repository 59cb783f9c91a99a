//! Random faults in flight, one after the other: after each, the operator's commands recover the robot, and it flies
//! on.
//!
//! `NIMS_CHAOS=200 cargo test --workspace --test live -- chaos:: --nocapture` injects two hundred faults;
//! `NIMS_CHAOS_SEED` sets another seed, and `NIMS_CHAOS_TABLE=FILE` stores the table.

mod judge;
mod plan;

use crate::robot::{Robot, root, steadily};
use bus::{Subscriber, clock};
use config::RobotFile;
use judge::{Blow, Evidence, Verdict};
use messages::{
    CONTROLLERS, ESTIMATORS, MotorAuthority, MotorSlots, MotorState, NodeEstimate, Request, SLOTS, Slot, SlotRole,
    TruthNode,
};
use plan::{Ending, Fault, How, Random, Round};
use rustix::process::Signal;
use std::path::PathBuf;
use std::time::Duration;

/// Longest time until a fault is detected, and until the robot flies again, ns.
const PATIENCE_NS: u64 = 60_000_000_000;
/// Error up to which an operator who looks at the node accepts the robot's position, m.
const TRUSTED_M: f64 = 0.03;
/// Speed below which a node hangs still, m/s; the position is only read then.
const STILL_M_S: f64 = 0.05;
/// Cycles of undisturbed flight after which the robot counts as recovered.
const WELL_CYCLES: u64 = 50;
/// Largest number of cycles from a death to the standby's first command in charge.
const TAKEN_OVER_CYCLES: u64 = 10;
/// Every process is restarted when it dies; the faults come faster than the system file's limits allow.
const AGAIN: &str = "restart = true\nrestart_pause_s = 0.1\nrestart_limit = 1000\n";

fn processes(standby: bool) -> String {
    let names = ["recorder", "motor-io", "estimator", "controller", "planner"];
    let section = |name: &str, role: &str, more: &str| {
        format!("\n[[process]]\nname = \"{name}\"\nrole = \"{role}\"\n{more}{AGAIN}")
    };
    let mut text: String = names.iter().map(|name| section(name, name, &format!("command = [\"{name}\"]\n"))).collect();
    if standby {
        text += &section("controller-b", "controller", "standby = true\nlaw = \"p-feedforward\"\n");
        text += &section("estimator-b", "estimator", "standby = true\nlaw = \"kalman\"\n");
    }
    text
}

/// A robot, its published state, and its true position.
struct Chaos {
    robot: Robot,
    estimates: [Subscriber<NodeEstimate>; SLOTS],
    newest: [NodeEstimate; SLOTS],
    nodes: Subscriber<TruthNode>,
    truth: Vec<TruthNode>,
    standby: bool,
    /// Largest error of a position that the robot published as known, since the last fault, m.
    off_m: Option<f64>,
}

impl Chaos {
    fn new(standby: bool) -> Self {
        let robot = Robot::up(&processes(standby));
        // A motion to and fro, longer than any round.
        let leg =
            "[[leg]]\npolyline = { points_m = [[5.6, 3.4, 0.6], [4.8, 4.0, 0.9], [4.0, 3.4, 0.6], [4.8, 3.0, 0.3]] }\n";
        let mission = format!("name = \"to and fro\"\nspeed_m_s = 0.15\n{}", leg.repeat(20));
        std::fs::write(robot.folder().join("configs/missions/fro.toml"), mission).unwrap();
        let (nodes, estimates) = ports(&robot);
        let mut chaos = Self {
            robot,
            estimates,
            nodes,
            newest: [NodeEstimate::default(); SLOTS],
            truth: Vec::new(),
            standby,
            off_m: None,
        };
        chaos.begin();
        chaos
    }

    fn again(&mut self, standby: bool) {
        self.standby = standby;
        self.robot.up_again(&processes(standby));
        (self.nodes, self.estimates) = ports(&self.robot);
        self.newest = [NodeEstimate::default(); SLOTS];
        self.begin();
    }

    /// Starts the robot and its mission.
    fn begin(&mut self) {
        self.robot.arm();
        self.bring_back("the start");
    }

    fn poll(&mut self) {
        self.robot.poll();
        for (newest, port) in self.newest.iter_mut().zip(&mut self.estimates) {
            *newest = port.latest().unwrap().unwrap_or(*newest);
        }
        while let Some(sample) = self.nodes.receive().unwrap() {
            self.truth.push(sample);
        }
        let half_a_second = self.truth.len().saturating_sub(50);
        self.truth.drain(..half_a_second);
    }

    fn nap(&mut self) {
        std::thread::sleep(Duration::from_millis(5));
        self.poll();
    }

    fn sleep(&mut self, seconds: f64) {
        let until_ns = clock::now_ns() + (seconds * 1e9) as u64;
        while clock::now_ns() < until_ns {
            self.nap();
        }
    }

    fn in_flight(&self) -> bool {
        (self.robot.last.mode, self.robot.last.faults) == (MotorAuthority::MODE_FOLLOWING, 0)
    }

    /// Whether all processes that should run twice do.
    fn complete(&self) -> bool {
        let role = |role: usize| {
            let phases = &self.robot.slots.phase[SLOTS * role..][..SLOTS];
            phases.contains(&MotorSlots::PHASE_ACTIVE) && phases.contains(&MotorSlots::PHASE_QUALIFIED)
        };
        !self.standby || (role(CONTROLLERS) && role(ESTIMATORS) && self.robot.slots.fade == [1.0; 2])
    }

    fn ask(&mut self, process: &str, request: Request) -> bool {
        matches!(self.robot.request(process, &request), Some((true, _)))
    }

    /// Does what an operator does until the robot flies again.
    fn bring_back(&mut self, after: &str) {
        let give_up = clock::now_ns() + PATIENCE_NS;
        let mut since = None;
        loop {
            self.nap();
            assert!(
                clock::now_ns() < give_up,
                "the robot does not recover from {after}: mode {}, faults {:#x}, phases {:?}, causes {:?}\n{}",
                self.robot.last.mode,
                self.robot.last.faults,
                self.robot.slots.phase,
                self.robot.slots.cause,
                self.robot.printed()
            );
            let cycle = self.robot.last.header.cycle;
            if self.in_flight() && self.complete() {
                let since = *since.get_or_insert(cycle);
                if cycle >= since + WELL_CYCLES {
                    return;
                }
                continue;
            }
            since = None;
            match self.robot.last.mode {
                MotorAuthority::MODE_DISARMED => {
                    self.ask("motor-io", Request::Arm);
                }
                MotorAuthority::MODE_FAULTED | MotorAuthority::MODE_EMERGENCY_STOP => {
                    self.ask("motor-io", Request::Reset);
                }
                MotorAuthority::MODE_HOLDING => self.go_on(),
                _ => {}
            }
            self.admit();
            self.sleep(0.05);
        }
    }

    /// Admits a quarantined slot again.
    fn admit(&mut self) {
        for slot in 0..self.robot.slots.phase.len() {
            if self.robot.slots.phase[slot] == MotorSlots::PHASE_QUARANTINED {
                let (role, slot) = (SlotRole::ALL[slot / SLOTS], Slot::ALL[slot % SLOTS]);
                self.ask("motor-io", Request::Admit { role, slot });
            }
        }
    }

    /// Whether this holds for half a second.
    fn hangs_still(&self) -> bool {
        let speed = |sample: &TruthNode| sample.velocity_m_s.iter().map(|v| v * v).sum::<f64>().sqrt();
        !self.truth.is_empty() && self.truth.iter().all(|sample| speed(sample) < STILL_M_S)
    }

    /// From Holding: reads where the node is, and resumes or restarts the mission.
    fn go_on(&mut self) {
        self.sleep(0.6);
        let MotorAuthority { mode, position_known, header, in_charge, .. } = self.robot.last;
        if mode != MotorAuthority::MODE_HOLDING || !self.hangs_still() {
            return;
        }
        let count = self.truth.len() as f64;
        let place = [0, 1, 2].map(|i| self.truth.iter().map(|sample| sample.position_m[i]).sum::<f64>() / count);
        let estimate = self.newest[usize::from(in_charge[ESTIMATORS])];
        let fresh = estimate.valid == 1 && estimate.header.cycle + 20 > header.cycle;
        let square: f64 = place.iter().zip(estimate.position_m).map(|(a, b)| (a - b).powi(2)).sum();
        let off_m = square.sqrt();
        let trusted = fresh && off_m < TRUSTED_M;
        match position_known {
            MotorState::POSITION_KNOWN if !fresh => return,
            MotorState::POSITION_KNOWN if trusted => {}
            MotorState::POSITION_RESTORED if trusted => {
                self.ask("motor-io", Request::ConfirmPosition);
            }
            known => {
                if known == MotorState::POSITION_KNOWN {
                    self.off_m = Some(self.off_m.unwrap_or(0.0).max(off_m));
                }
                self.ask("motor-io", Request::Stop);
                self.ask("motor-io", Request::ZeroAt { position_m: place });
                self.sleep(0.1);
            }
        }
        if !self.ask("motor-io", Request::Resume) {
            self.ask("motor-io", Request::Stop);
            let mission = self.robot.mission("fro");
            self.ask("planner", mission);
        }
        self.sleep(0.2);
    }

    /// Waits for an effect that shows in flight; if this machine stopped the robot meanwhile, the robot first flies on.
    fn wait(&mut self, fault: &str, shows: impl Fn(&Self) -> bool) {
        let give_up = clock::now_ns() + PATIENCE_NS;
        // `judge` handles a fault that is reported under another name than that of the table.
        while !shows(self) && self.robot.last.faults & messages::faults::HARD == 0 {
            assert!(
                clock::now_ns() < give_up,
                "{fault}: no effect; mode {}, faults {:#x}\n{}",
                self.robot.last.mode,
                self.robot.last.faults,
                self.robot.printed()
            );
            if self.robot.last.mode == MotorAuthority::MODE_HOLDING {
                self.go_on();
            }
            self.nap();
        }
    }

    fn strike(&mut self, fault: &Fault, random: &mut Random) -> Blow {
        self.sleep(random.between(0.0, 0.8));
        if !(self.in_flight() && self.complete()) {
            self.bring_back("an unplanned disturbance");
        }
        let role = ["controller", "estimator"].iter().position(|name| *name == fault.process);
        let lead = role.filter(|_| self.standby).map(|role| (role, self.robot.last.in_charge[role]));
        let process = match lead {
            Some((_, 1)) => format!("{}-b", fault.process),
            _ => fault.process.to_owned(),
        };
        let pid = self.robot.pid(&process);
        self.off_m = None;
        self.poll();
        let (at_ns, cycle, lost) = (clock::now_ns(), self.robot.last.header.cycle, self.robot.last.lost_on_ports());
        match &fault.how {
            How::Box(text, _) => self.robot.fault(text),
            How::Output(text) => self.robot.fault_of(&process, text),
            How::Signal(signal) => self.robot.signal(&process, *signal),
        }
        let bits = fault.row.bits;
        match lead {
            Some((role, slot)) => self.wait(&fault.what, |chaos| chaos.robot.last.in_charge[role] != slot),
            None if bits != 0 => self.wait(&fault.what, |chaos| chaos.robot.last.faults & bits != 0),
            None if fault.row.kind() == "kill" => {
                self.wait(&fault.what, |chaos| chaos.robot.pid(&process).is_some_and(|now| Some(now) != pid));
            }
            None => {}
        }
        self.sleep(fault.lasts_s);
        if fault.row.kind() == "noise" {
            self.wait(&fault.what, |chaos| chaos.robot.last.lost_on_ports() > lost);
        }
        match &fault.how {
            How::Box(_, Some(repair)) => self.robot.fault(repair),
            How::Output(text) => {
                let kind = text.split(' ').next().unwrap();
                self.robot.fault_of(&process, &format!("{kind} off"));
            }
            // A restarted process may have been replaced meanwhile, and the next one may not have started yet.
            How::Signal(Signal::STOP) if self.robot.pid(&process).is_some() => {
                self.robot.signal(&process, Signal::CONT);
            }
            _ => {}
        }
        self.bring_back(&fault.what);
        let by_motion = ["stall", "dead", "slip"].contains(&fault.row.kind());
        let within = match lead {
            Some(_) => Some(TAKEN_OVER_CYCLES),
            None => Some(u64::from(fault.row.cycles)).filter(|cycles| *cycles > 0 && !by_motion),
        };
        Blow {
            what: fault.what.clone(),
            standby: self.standby,
            lead,
            bits,
            within,
            cable: fault.cable,
            runs_away: ["dead", "slip"].contains(&fault.row.kind()),
            breaks: false,
            at_ns,
            cycle,
            back_ns: clock::now_ns(),
            off_m: self.off_m,
        }
    }

    /// Ends a round in flight; returns the fault that ended it, if it is to be judged.
    fn end(&mut self, ending: Ending, complaints: &mut Vec<String>) -> Option<Blow> {
        self.poll();
        let (at_ns, cycle) = (clock::now_ns(), self.robot.last.header.cycle);
        let (what, bits, cable) = match ending {
            Ending::Plain => (String::new(), 0, None),
            Ending::Break(cable) => (format!("break {}", cable + 1), MotorAuthority::FAULT_SLACK, Some(cable)),
            Ending::Supervisor => ("kill nims".to_owned(), MotorAuthority::FAULT_SUPERVISOR_LOST, None),
            Ending::Everything => ("kill everything".to_owned(), 0, None),
        };
        match ending {
            Ending::Plain => {
                let code = self.robot.down(Signal::INT);
                if !matches!(code, Some(0 | 1)) {
                    complaints.push(format!("nims up ended with {code:?}"));
                }
                return None;
            }
            Ending::Break(_) => {
                self.robot.fault(&what);
                self.wait(&what, |chaos| chaos.robot.last.faults & bits != 0);
                self.sleep(2.0);
                self.robot.down(Signal::INT);
            }
            Ending::Supervisor => {
                self.robot.down(Signal::KILL);
                self.wait(&what, |chaos| chaos.robot.last.faults & bits != 0);
                self.sleep(2.0);
            }
            Ending::Everything => self.robot.kill_all(),
        }
        let (standby, within) = (self.standby, None);
        Some(Blow {
            what,
            standby,
            lead: None,
            bits,
            within,
            cable,
            runs_away: false,
            breaks: matches!(ending, Ending::Break(_)),
            at_ns,
            cycle,
            back_ns: 0,
            off_m: None,
        })
    }
}

fn ports(robot: &Robot) -> (Subscriber<TruthNode>, [Subscriber<NodeEstimate>; SLOTS]) {
    let estimate = |slot: &str| robot.bus.deep_subscriber(&format!("node/estimate/{slot}")).unwrap();
    (robot.bus.deep_subscriber("truth/node").unwrap(), [estimate("a"), estimate("b")])
}

/// A finished round: its run folder, and its faults.
struct Flown {
    run: PathBuf,
    blows: Vec<Blow>,
}

/// The robot after all rounds, and the injected faults.
fn fly(rounds: Vec<Round>, random: &mut Random, complaints: &mut Vec<String>) -> (Chaos, Vec<Flown>) {
    let mut flown: Vec<Flown> = Vec::new();
    let mut chaos = Chaos::new(rounds[0].standby);
    for (number, round) in rounds.iter().enumerate() {
        if number > 0 {
            chaos.again(round.standby);
        }
        let mut blows: Vec<Blow> = Vec::new();
        for fault in &round.faults {
            let blow = chaos.strike(fault, random);
            let seconds = (blow.back_ns - blow.at_ns) as f64 * 1e-9;
            println!("{}{}: back after {seconds:.1} s", blow.what, if blow.standby { ", standby" } else { "" });
            blows.push(blow);
        }
        blows.extend(chaos.end(round.ending, complaints));
        println!("round {} of {}: {:?}", number + 1, rounds.len(), round.ending);
        flown.push(Flown { run: chaos.robot.run(), blows });
    }
    (chaos, flown)
}

#[test]
fn whatever_breaks_the_robot_comes_back() {
    // Repeating a long series would take hours; its machine is expected to be quiet.
    if std::env::var_os("NIMS_CHAOS").is_some() {
        return strike_and_judge();
    }
    steadily(strike_and_judge);
}

fn strike_and_judge() {
    let number = |name: &str, or: u64| std::env::var(name).map_or(or, |text| text.parse().unwrap());
    let (count, seed) = (number("NIMS_CHAOS", 4), number("NIMS_CHAOS_SEED", 1));
    let mut random = Random(seed);
    let rounds = plan::rounds(count as usize, &mut random);
    let mut complaints = Vec::new();
    let begun_ns = clock::now_ns();
    let (chaos, flown) = fly(rounds, &mut random, &mut complaints);
    let minutes = (clock::now_ns() - begun_ns) as f64 / 60e9;

    let file = RobotFile::load(&root().join("configs/robots/lab3.toml")).unwrap();
    let [_, limit_n] = file.robot().unwrap().tension_limits_n();
    let mut judged: Vec<(Blow, Verdict)> = Vec::new();
    for Flown { run, blows } in flown {
        let evidence = Evidence::read(&run, &mut complaints);
        evidence.nothing_moves_while_held(&mut complaints);
        let mut blows = blows.into_iter().peekable();
        while let Some(blow) = blows.next() {
            let end_ns = blows.peek().map_or(u64::MAX, |next| next.at_ns);
            let verdict = evidence.judge(&blow, end_ns, limit_n, &mut complaints);
            judged.push((blow, verdict));
        }
    }
    let table = judge::table(&judged);
    println!("{table}\n{} faults in {minutes:.1} min", judged.len());
    if let Ok(path) = std::env::var("NIMS_CHAOS_TABLE") {
        std::fs::write(path, &table).unwrap();
    }
    // While the robot still exists, so that `NIMS_KEEP` keeps its runs.
    assert!(complaints.is_empty(), "{count} faults of seed {seed}:\n{}", complaints.join("\n"));
    drop(chaos);
}
