//! Flights whose cable velocities another program gives, cycle by cycle, over standard input and output.
//!
//! A request is a line of JSON. `{"reset": {"seed": 3}}` begins a flight, in a drawn world if it has a seed, and is
//! answered by an [`Opened`] line and one observation. `{"step": 20}` is followed by the velocities of so many cycles
//! and answered by a [`Stepped`] line and the observation after each cycle that was flown. Velocities and observations
//! are 64-bit numbers, little-endian, without anything between them. A request that cannot be carried out is answered
//! by `{"failed": "why"}`.

use std::io::{BufRead, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use command::{Answer, Failure};
use config::SystemFile;
use controller::Controller;
use lockstep::{Chain, Cycle, Lockstep};
use messages::{MotorAuthority, PlanStatus};
use serde::{Deserialize, Serialize};

use crate::args::Args;
use crate::fly;
use crate::observation::{Fields, FollowedLaw, Wishes, fields, observe};
use crate::tape::Tape;
use crate::variants::{last_flight, product};

/// Most cycles of one request: an hour at 100 Hz.
const MOST_CYCLES: usize = 360_000;

#[derive(Debug, Clone, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Request {
    Reset {
        #[serde(default)]
        seed: Option<u64>,
    },
    Step(usize),
}

/// The beginning of a flight.
#[derive(Debug, Clone, Serialize)]
struct Opened {
    cables: usize,
    period_s: f64,
    /// Most that a cable may move, m/s.
    cable_speed_limit_m_s: f64,
    /// Names and counts of the numbers of an observation, in their order.
    fields: Fields,
    /// Folder with the files of the flight.
    folder: PathBuf,
}

/// What became of the cycles.
#[derive(Debug, Clone, Default, Serialize)]
struct Stepped {
    steps: usize,
    /// Why the flight is over: `done`, `aborted`, `fault` or `longest`.
    #[serde(skip_serializing_if = "Option::is_none")]
    ended: Option<&'static str>,
    /// The same as a sentence.
    #[serde(skip_serializing_if = "Option::is_none")]
    why: Option<String>,
}

/// A flight under way.
struct Session {
    lockstep: Lockstep,
    wishes: Wishes,
    tape: Option<Tape>,
    last: Cycle,
    cables: usize,
    longest: u64,
    flown: u64,
    ended: bool,
}

/// Answers requests until standard input ends.
///
/// # Errors
/// A request that is none of this protocol, or a stream that fails.
pub(crate) fn serve(args: &Args, folder: &Path, input: impl BufRead, output: impl Write) -> Answer {
    try_serve(args, folder, input, output).map_err(|error| Failure::NotNow(format!("{error:#}")))
}

fn try_serve(args: &Args, folder: &Path, mut input: impl BufRead, mut output: impl Write) -> Result<()> {
    let (mut session, mut line) = (None::<Session>, String::new());
    // An earlier program may have left flights in the folder.
    let mut number = last_flight(folder).map_or(0, |(number, _)| number);
    let mut numbers: Vec<f64> = Vec::new();
    loop {
        line.clear();
        if input.read_line(&mut line)? == 0 {
            break;
        }
        let request = serde_json::from_str(&line)
            .with_context(|| format!("{} is no request; accepted: reset, step", line.trim()))?;
        numbers.clear();
        let answer = match request {
            Request::Reset { seed } => {
                // A flight that was left is closed before the next one begins.
                session.take().map_or(Ok(()), Session::close)?;
                number += 1;
                open(args, folder, number, seed).and_then(|(opened, begun)| {
                    begun.observe(&mut numbers);
                    session = Some(begun);
                    Ok(serde_json::to_value(opened)?)
                })
            }
            Request::Step(cycles) => {
                ensure!(cycles <= MOST_CYCLES, "step is {cycles} cycles; accepted: at most {MOST_CYCLES}");
                let session = session.as_mut().context("step comes before the first reset; reset first")?;
                let mut bytes = vec![0; 8 * cycles * session.cables];
                input.read_exact(&mut bytes)?;
                let velocities: Vec<f64> =
                    bytes.as_chunks::<8>().0.iter().map(|bytes| f64::from_le_bytes(*bytes)).collect();
                let stepped = session.step(&velocities, &mut numbers);
                stepped.and_then(|stepped| Ok(serde_json::to_value(stepped)?))
            }
        };
        let answer = answer.unwrap_or_else(|error| {
            numbers.clear();
            serde_json::json!({ "failed": format!("{error:#}") })
        });
        writeln!(output, "{answer}")?;
        for number in &numbers {
            output.write_all(&number.to_le_bytes())?;
        }
        output.flush()?;
    }
    session.take().map_or(Ok(()), Session::close)
}

/// Begins the flight of that number: at rest, armed, with the first segment of the mission.
fn open(args: &Args, out: &Path, number: usize, seed: Option<u64>) -> Result<(Opened, Session)> {
    let seeds: Vec<u64> = seed.into_iter().collect();
    let mut variants = product(&args.all_sets(), &[], &seeds, args.weather());
    let variant = variants.first_mut().context("no flight")?;
    variant.number = number;
    let source = SystemFile::load(&args.system)?;
    let folder = variant.prepare(&args.system, &source.robot, out)?;
    let system = folder.join("system.toml");
    let file = SystemFile::load(&system)?;
    let (scenario, mut chain) = (fly::scenario(&file, args)?, Chain::from_file(&file)?);
    let (mission, period_s, cables) = (scenario.mission.clone(), scenario.period_s, scenario.robot.cable_count());
    let longest = (scenario.longest_s / period_s) as u64;
    let wishes = Wishes::default();
    let config = *chain.controller.config();
    chain.controller = Controller::with_law(config, Box::new(FollowedLaw(wishes.clone())));
    let mut tape = match args.out {
        Some(_) => Some(Tape::new(&folder.join("run.mcap"), &system)?),
        None => None,
    };
    let mut lockstep = Lockstep::with(scenario, chain)?;
    lockstep.zero_and_arm_observed(&mut |seen| tape.as_mut().map_or(Ok(()), |tape| fly::record(tape, seen)))?;
    lockstep.run(&mission).context("the planner rejected the mission")?;
    let last = lockstep.cycle()?;
    let opened = Opened {
        cables,
        period_s,
        cable_speed_limit_m_s: config.cable_speed_limit_m_s,
        fields: fields(cables),
        folder: std::path::absolute(&folder)?,
    };
    Ok((opened, Session { lockstep, wishes, tape, last, cables, longest, flown: 0, ended: false }))
}

impl Session {
    fn observe(&self, numbers: &mut Vec<f64>) {
        observe(&self.last, &self.wishes, self.cables, numbers);
    }

    /// Answers the last cycle with each row of velocities in turn, and flies the cycle in which it acts.
    fn step(&mut self, velocities: &[f64], numbers: &mut Vec<f64>) -> Result<Stepped> {
        if self.ended {
            bail!("the flight is over; reset begins the next one");
        }
        let mut stepped = Stepped::default();
        for row in velocities.chunks_exact(self.cables) {
            let valid = row.iter().all(|velocity| velocity.is_finite());
            self.lockstep.slots_mut().alter_command(0, |command| {
                command.velocity_m_s[..row.len()].copy_from_slice(row);
                command.valid[0] = u8::from(valid);
            });
            self.record()?;
            self.last = self.lockstep.cycle()?;
            self.flown += 1;
            stepped.steps += 1;
            self.observe(numbers);
            if let Some((ended, why)) = self.end() {
                self.ended = true;
                (stepped.ended, stepped.why) = (Some(ended), Some(why));
                break;
            }
        }
        Ok(stepped)
    }

    /// Why the flight is over, if it is.
    fn end(&self) -> Option<(&'static str, String)> {
        let authority = &self.last.authority;
        if matches!(authority.mode, MotorAuthority::MODE_FAULTED | MotorAuthority::MODE_EMERGENCY_STOP) {
            return Some(("fault", robot_state::sentences::faults_of(authority).join("; ")));
        }
        match self.last.plan.state {
            PlanStatus::STATE_DONE => Some(("done", "the mission is flown".to_owned())),
            PlanStatus::STATE_ABORTED => Some(("aborted", "the mission was given up".to_owned())),
            _ if self.flown >= self.longest => {
                Some(("longest", "the longest flight is over; see --longest".to_owned()))
            }
            _ => None,
        }
    }

    /// Records the last cycle with the command that answers it.
    fn record(&mut self) -> Result<()> {
        let seen = lockstep::Observed { cycle: &self.last, slots: self.lockstep.slots() };
        self.tape.as_mut().map_or(Ok(()), |tape| fly::record(tape, &seen))
    }

    fn close(mut self) -> Result<()> {
        self.record()?;
        self.tape.map_or(Ok(()), |tape| tape.finish().map(|_| ()))
    }
}
