//! The robot in flight, with standbys: planned swaps, and SIGKILL of the process in charge, at random instants. The
//! results are read from the run file.
//!
//! `NIMS_SWAPS=100 NIMS_RATE_HZ=100 cargo test --workspace --test live swaps::` does each a hundred times at the usual
//! rate.

use crate::counters::counted_alike;
use crate::robot::{Late, Robot, SWAPS, THREE_CABLES, samples_of, steadily};
use messages::{
    CABLES, CONTROLLERS, ESTIMATORS, MotorAuthority, MotorCommand, MotorSlots, NodeEstimate, SLOT_NAMES, SLOTS,
    TruthNode,
};
use robot_state::Periods;
use rustix::process::Signal;
use std::collections::HashMap;
use std::path::Path;
use std::time::Duration;

const ROLES: [&str; 2] = ["controller", "estimator"];
/// Two of each: a second controller with another law, a second estimator with another method; and standbys that qualify
/// sooner and restart at once, so that a second is enough for a death and its consequences.
fn standbys() -> String {
    let mut text = "[arbiter]\nqualify_s = 0.2\nprobation_s = 0.2\nquarantine_falls = 100\n".to_owned();
    let slots = [
        ("controller", "controller", ""),
        ("controller-b", "controller", "standby = true\nlaw = \"p-feedforward\"\n"),
        ("estimator", "estimator", ""),
        ("estimator-b", "estimator", "standby = true\nlaw = \"kalman\"\n"),
    ];
    for (name, role, more) in slots {
        let restart = "restart = true\nrestart_pause_s = 0.1\nrestart_forgive_s = 0.1\n";
        text += &format!("[[process]]\nname = \"{name}\"\nrole = \"{role}\"\n{restart}{more}");
    }
    text
}

/// Above 100 Hz the exchange with two units on one port does not fit into a period.
fn system_and_its_rate() -> (&'static str, &'static str) {
    if rate_hz() > 100.0 { ("fast3", "rate_hz = 200.0") } else { (THREE_CABLES, "rate_hz = 100.0") }
}

/// A processor shared by ten processes and a starting eleventh may delay one for milliseconds. At half the usual rate
/// that does not explain a missing answer; use `NIMS_RATE_HZ=100` on an otherwise idle machine.
fn rate_hz() -> f64 {
    std::env::var("NIMS_RATE_HZ").map_or(50.0, |rate| rate.parse().unwrap())
}

/// Started and on a mission to and fro that is long enough not to end during a test.
fn in_flight(more: &str) -> Robot {
    let (file, rate) = system_and_its_rate();
    let mut robot = Robot::up_with(file, more, |configs| {
        let mut mission = "name = \"to and fro\"\nspeed_m_s = 0.15\n".to_owned();
        for _ in 0..20 {
            mission += "[[leg]]\npolyline = { points_m = [[5.6, 3.4, 0.6], [4.8, 4.0, 0.9], [4.0, 3.4, 0.6], [4.8, 3.0, 0.3]] }\n";
        }
        std::fs::write(configs.join("missions/fro.toml"), mission).unwrap();
        let path = configs.join("systems").join(format!("{file}.toml"));
        let text = std::fs::read_to_string(&path).unwrap();
        assert!(text.contains(rate), "{} does not contain the expected rate", path.display());
        std::fs::write(&path, text.replacen(rate, &format!("rate_hz = {:.1}", rate_hz()), 1)).unwrap();
    });
    robot.arm();
    // A cycle without readings has no estimate, and then the planner has no starting point.
    robot.until_reported("the mission is accepted", |robot| robot.nims(&["run", "fro"]).status.success());
    robot.until("the mission has begun", |robot| robot.last.mode == MotorAuthority::MODE_FOLLOWING);
    robot
}

/// A standby that is late in the announced cycle rightly does not take over, and one that is late just after it rightly
/// loses the place; then it is repeated.
///
/// Returns how often the place changed hands.
fn swap(robot: &mut Robot, role: &str) -> u64 {
    let mut changes = 1;
    for _ in 0..SWAPS {
        let output = robot.nims(&["swap", role]);
        if output.status.success() {
            return changes;
        }
        let why = String::from_utf8_lossy(&output.stderr).into_owned();
        let late = Late::from_refusal(&why);
        assert!(output.status.code() == Some(1) && late.is_some(), "{why}{}", robot.printed());
        changes += 2 * u64::from(late == Some(Late::Probation));
        until_doubled(robot);
    }
    panic!("{SWAPS} times no swap\n{}", robot.printed());
}

/// Whether both roles have a process in charge and a standby.
fn until_doubled(robot: &mut Robot) {
    robot.until("a standby in both roles", |robot| {
        let has = |role: usize, phase: u8| robot.slots.phase[SLOTS * role..][..SLOTS].contains(&phase);
        let role = |role| has(role, MotorSlots::PHASE_ACTIVE) && has(role, MotorSlots::PHASE_QUALIFIED);
        role(CONTROLLERS) && role(ESTIMATORS) && robot.slots.fade == [1.0; 2]
    });
    let MotorAuthority { mode, faults, .. } = robot.last;
    assert_eq!(mode, MotorAuthority::MODE_FOLLOWING, "the robot does not fly, faults {faults:#x}\n{}", robot.printed());
}

fn lead(robot: &Robot, role: usize) -> usize {
    usize::from(robot.slots.in_charge[role])
}

/// The slot in charge of the role.
fn leader(robot: &Robot, role: usize) -> String {
    match SLOT_NAMES[lead(robot, role)] {
        "a" => ROLES[role].to_owned(),
        slot => format!("{}-{slot}", ROLES[role]),
    }
}

/// Ends the robot and computes its run again: every bit of every decision is as recorded. A killed process may have
/// left a last sample without the one that names its inputs.
fn end_and_replay(robot: &mut Robot, kills: u64) {
    robot.down(Signal::INT);
    let replayed = replay::run(&robot.run(), &replay::Changes::default(), &mut |_| {}).unwrap();
    println!("{} samples computed again", replayed.equal());
    assert_eq!(replayed.different(), 0, "{:#?}", replayed.channels);
    for tally in &replayed.channels {
        let left: u64 = tally.not_compared.values().sum();
        assert!(tally.equal > 0 && left <= kills, "{tally:#?}");
    }
}

/// Cycles between a period lost to the computer and a command that is missing because of it: the answer to the cycle
/// before or after it.
const FROZEN_CYCLES: u64 = 5;

/// A timer that wakes a process this late shows that the machine ran another program meanwhile, s; 0.1 ms is usual.
const WOKEN_LATE_S: f64 = 0.001;

#[derive(Debug, Default, PartialEq)]
struct Account {
    /// Periods without an answer and without another explanation.
    unanswered: u64,
    /// Periods without an answer near periods that were lost to the computer.
    frozen: u64,
    /// Periods without an answer while the undisturbed virtual drives were silent, or had just taken half as long again
    /// as usual, or motor-io itself was woken late: the machine ran neither them nor the chain.
    starved: u64,
    /// Number of changes of the slot in charge, per role.
    changes: [u64; 2],
    stops: u64,
    /// Cycles in which motor-io's limiter reduced a change of velocity.
    limited: u64,
    /// Cycles in which a cable's velocity changed by more than acceleration limit x period beyond the change of the
    /// answers themselves.
    steps_beyond: u64,
}

/// The acceleration limit of the robot file, m/s², and the factor of motor-io's limiter.
const ACCELERATION_M_S2: f64 = 0.5;
const LIMITER: f64 = 4.0;

/// Result of the run file from the time `first` on.
fn account(run: &Path, first: u64, last: u64) -> Account {
    let mut samples = samples_of::<MotorAuthority>(run, "motor/authority");
    samples.retain(|sample| (first..=last).contains(&sample.header.cycle));
    let states = runlog::read_channel::<messages::MotorState>(run, "motor/state").unwrap();
    assert!(samples.len() as u64 > (last - first) * 95 / 100, "the run file lacks cycles");
    let grows = |count: fn(&MotorAuthority) -> u64| -> Vec<u64> {
        samples.windows(2).filter(|two| count(&two[1]) > count(&two[0])).map(|two| two[1].header.cycle).collect()
    };
    let mut took_ns: Vec<u64> = samples.iter().map(|sample| sample.bus_ns).collect();
    took_ns.sort_unstable();
    let usual_ns = took_ns[took_ns.len() / 2];
    let (late, silent) = (grows(|sample| sample.lost_computer), grows(|sample| sample.lost_on_ports()));
    let (from, to) = (Periods::from_authority(&samples[0]), Periods::from_authority(&samples[samples.len() - 1]));
    println!("from {} to {}", from.summary(), to.summary());
    let mut account = Account::default();
    for two in samples.windows(2) {
        let (before, now) = (&two[0], &two[1]);
        let lost = now.lost_answer - before.lost_answer;
        if late.iter().any(|late| late.abs_diff(now.header.cycle) <= FROZEN_CYCLES) {
            account.frozen += lost;
        } else if silent.contains(&now.header.cycle)
            || 2 * before.bus_ns > 3 * usual_ns
            || before.wake_ns.max(now.wake_ns) as f64 > WOKEN_LATE_S * 1e9
        {
            account.starved += lost;
        } else {
            account.unanswered += lost;
            if lost > 0 {
                let MotorAuthority { header, verdict, active_controller, active_estimator, wake_ns, .. } = now;
                println!(
                    "cycle {} without an answer: verdicts {verdict:?}, last used {active_controller} on {active_estimator}, woken after {wake_ns} ns, \
                     {} lost on the ports in this cycle; the drives took {} ns before, usually {usual_ns} ns",
                    header.cycle,
                    now.lost_on_ports() - before.lost_on_ports(),
                    before.bus_ns
                );
            }
        }
        for role in 0..2 {
            account.changes[role] += u64::from(now.in_charge[role] != before.in_charge[role]);
        }
        account.stops += u64::from(now.mode != MotorAuthority::MODE_FOLLOWING);
    }
    // If no answer came in time the next one catches up.
    let undisturbed = |cycle: u64| {
        let unanswered = grows(|sample| sample.lost_answer);
        !late
            .iter()
            .chain(&silent)
            .chain(&unanswered)
            .any(|then| (0..=FROZEN_CYCLES).contains(&cycle.saturating_sub(*then)) && *then <= cycle)
    };
    let answers = Answers::from_run(run);
    let (step_m_s, mut most, mut most_alone) = (ACCELERATION_M_S2 / rate_hz(), 0.0f64, 0.0f64);
    for two in states.windows(2) {
        let (before, now) = (&two[0].1, &two[1].1);
        let cycle = now.header.cycle;
        if cycle != before.header.cycle + 1 || !(first..=last).contains(&cycle) || !undisturbed(cycle) {
            continue;
        }
        for (cable, (v, w)) in now.command_m_s.iter().zip(&before.command_m_s).enumerate() {
            let step = (v - w).abs();
            let alone = answers.own_step_m_s(cycle, cable);
            account.limited += u64::from(step >= LIMITER * step_m_s - 1e-9);
            account.steps_beyond += u64::from(step > alone + step_m_s);
            (most, most_alone) = (most.max((step - alone) / step_m_s), most_alone.max(alone / step_m_s));
        }
    }
    println!(
        "shares of acceleration limit x period: {most:.3} at most beyond the answers' own steps of at most {most_alone:.3}"
    );
    account
}

/// Cycles after a change of the slot in charge for which the estimate is judged separately, the quarter of a second of
/// the fade at 100 Hz.
const SWITCH_CYCLES: u64 = 25;

/// Prints the error of the estimate in charge against the truth, at the switches and elsewhere.
fn print_truth(run: &Path, first: u64, last: u64) {
    let truth: Vec<TruthNode> = samples_of(run, "truth/node");
    let estimates = SLOT_NAMES.map(|slot| -> HashMap<u64, NodeEstimate> {
        let samples = samples_of::<NodeEstimate>(run, &format!("node/estimate/{slot}"));
        samples.into_iter().filter(|sample| sample.valid == 1).map(|sample| (sample.header.cycle, sample)).collect()
    });
    let (mut at_switches, mut elsewhere, mut since, mut before) = (0.0f64, 0.0f64, u64::MAX, None);
    for authority in samples_of::<MotorAuthority>(run, "motor/authority") {
        let cycle = authority.header.cycle;
        if !(first..=last).contains(&cycle) {
            continue;
        }
        let changed = before.replace(authority.in_charge).is_some_and(|before| before != authority.in_charge);
        since = if changed { 0 } else { since.saturating_add(1) };
        let Some(estimate) = estimates[usize::from(authority.in_charge[ESTIMATORS])].get(&cycle) else { continue };
        let next = truth.partition_point(|sample| sample.header.stamp_ns < estimate.header.stamp_ns);
        let Some(at) = truth.get(next) else { continue };
        let later_s = (at.header.stamp_ns - estimate.header.stamp_ns) as f64 * 1e-9;
        let square = (0..3).map(|i| at.position_m[i] - later_s * at.velocity_m_s[i] - estimate.position_m[i]);
        let off_m = square.map(|d| d * d).sum::<f64>().sqrt();
        let most = if since < SWITCH_CYCLES { &mut at_switches } else { &mut elsewhere };
        *most = most.max(off_m);
    }
    println!(
        "estimate in charge against truth: at most {:.2} mm at switches, {:.2} mm elsewhere",
        1e3 * at_switches,
        1e3 * elsewhere
    );
}

/// Answers of the controllers, by their cycle.
struct Answers(Vec<HashMap<u64, MotorCommand>>);

impl Answers {
    fn from_run(run: &Path) -> Self {
        let by_cycle = |slot: &&str| {
            let samples = runlog::read_channel::<MotorCommand>(run, &format!("motor/command/{slot}")).unwrap();
            samples.into_iter().map(|(_, command)| (command.based_on_cycle + 1, command)).collect()
        };
        Self(SLOT_NAMES.iter().map(by_cycle).collect())
    }

    /// Largest change of the answers themselves between one cycle and the next, m/s, over all slots with both.
    fn own_step_m_s(&self, cycle: u64, cable: usize) -> f64 {
        let rows = self.0.iter().flat_map(|slot| {
            let two = slot.get(&cycle).zip(slot.get(&(cycle - 1)));
            two.into_iter().flat_map(move |(now, before)| {
                let both = |row: &usize| now.valid[*row] == 1 && before.valid[*row] == 1;
                let at = move |row: usize| row * CABLES + cable;
                (0..SLOTS).filter(both).map(move |row| (now.velocity_m_s[at(row)] - before.velocity_m_s[at(row)]).abs())
            })
        });
        rows.fold(0.0, f64::max)
    }
}

#[test]
fn swaps_and_deaths_at_random_instants_cost_no_cycle() {
    let rounds: u64 = std::env::var("NIMS_SWAPS").map_or(20, |count| count.parse().unwrap());
    steadily(|| {
        let mut robot = in_flight(&standbys());
        until_doubled(&mut robot);
        let first = robot.last.header.cycle;
        // Knuth's multiplier; the instants must be irregular, not unpredictable.
        let mut random = 20u64;
        let mut pause = || {
            random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            std::thread::sleep(Duration::from_millis((random >> 33) % 400));
        };
        let mut changes = [0; 2];
        for round in 0..rounds {
            until_doubled(&mut robot);
            let role = (round % 2) as usize;
            let before = lead(&robot, role);
            pause();
            // Without a name: the present standby takes over, and the old one becomes the standby.
            changes[role] += swap(&mut robot, ROLES[role]);
            robot.until("the standby is in charge", |robot| lead(robot, role) == 1 - before);

            // Both that are in charge die, at independent instants.
            until_doubled(&mut robot);
            let before = [CONTROLLERS, ESTIMATORS].map(|role| lead(&robot, role));
            let names = [CONTROLLERS, ESTIMATORS].map(|role| leader(&robot, role));
            let first = (round / 2 % 2) as usize;
            for role in [first, 1 - first] {
                pause();
                robot.signal(&names[role], Signal::KILL);
            }
            robot.until("the standbys are in charge", |robot| {
                [0, 1].map(|role| lead(robot, role)) == before.map(|lead| 1 - lead)
            });
            changes = changes.map(|count| count + 1);
        }
        until_doubled(&mut robot);
        let last = robot.last.header.cycle;
        end_and_replay(&mut robot, 2 * rounds);
        counted_alike(&robot);
        print_truth(&robot.run(), first, last);
        let account = account(&robot.run(), first, last);
        println!("{rounds} rounds, cycles {first} to {last}: {account:?}");
        let Account { frozen, starved, .. } = account;
        assert_eq!(account, Account { changes, frozen, starved, ..Account::default() });
    });
}

#[test]
fn another_law_is_started_and_takes_over_in_flight() {
    steadily(|| {
        let mut robot = in_flight("");
        for role in ROLES {
            // The swap starts and ends no process.
            let before = robot.slots.phase;
            let code = robot.refused(&["swap", role, "no-such-law"], &["no-such-law", "accepted"]);
            assert_eq!((code, robot.slots.phase), (Some(2), before), "{role}");
        }
        for (role, law, keep) in [("controller", "p-feedforward", false), ("estimator", "kalman", true)] {
            let mut args = vec!["swap", role, law];
            if keep {
                args.push("--keep");
            }
            let sentence = robot.swapped(&args);
            assert!(sentence.contains(&format!("{role}-b")), "{sentence}");
        }
        robot.until("the slots in charge are published", |robot| robot.slots.in_charge == [1, 1]);
        robot.until("the old controller has ended, the old estimator is a standby", |robot| {
            robot.slots.phase[..3] == [MotorSlots::PHASE_EMPTY, MotorSlots::PHASE_ACTIVE, MotorSlots::PHASE_QUALIFIED]
        });
        assert_eq!(robot.last.mode, MotorAuthority::MODE_FOLLOWING);
        assert_eq!(robot.refused(&["swap", "controller", "lq-endpoint", "--slot", "b"], &[]), Some(2));
        end_and_replay(&mut robot, 0);
    });
}
