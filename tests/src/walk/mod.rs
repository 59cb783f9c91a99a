//! A random walk in lockstep: operator commands, deaths and lives of processes, and motions, with invariants checked
//! after each cycle; and the recovery of a motion only by the cures that refusals name.

mod astray;
pub mod checks;
pub mod cures;
pub mod random;
mod recover;
mod steps;

use anyhow::{Context, Result, anyhow, bail};
use cable_control::law::PFeedforward;
use config::{EstimatorMethod, EstimatorSection, PlannerSection};
use controller::{ControllerConfig, Law};
use estimator::{EstimatorConfig, Method};
use messages::{Request, SLOTS};
use motor_io::CoreConfig;
use planner::PlannerConfig;
use std::collections::VecDeque;

use crate::lockstep::{Chain, Cycle, Lockstep, core_config};
use crate::scenarios::Case;
use astray::Astray;
use checks::{Bounds, Checks};
use cures::{cures, is_settled};
use random::Random;

/// Number of last steps that a failure lists.
const TOLD: usize = 60;
/// Steps between two recoveries of the robot.
const EPISODE: u64 = 20;

/// Result of walks.
#[derive(Debug, Clone, Copy, Default)]
pub struct Tally {
    /// Steps: commands, deaths, lives, forged samples, waits.
    pub steps: u64,
    /// Cycles that were checked.
    pub cycles: u64,
    /// Refusals; each names its cure.
    pub refusals: u64,
    /// Times that the robot was recovered to a finished motion.
    pub returns: u64,
    /// Cures that were applied for that.
    pub cures: u64,
    /// Lives of motor-io that began.
    pub lives: u64,
    /// Forged samples.
    pub forged: u64,
    /// Controllers that became faulty.
    pub astray: u64,
    /// Motions that began.
    pub motions: u64,
    /// Largest values.
    pub seen: checks::Inputs,
}

impl Tally {
    /// Adds the results of another walk.
    pub fn add(&mut self, other: &Self) {
        self.steps += other.steps;
        self.cycles += other.cycles;
        self.refusals += other.refusals;
        self.returns += other.returns;
        self.cures += other.cures;
        self.lives += other.lives;
        self.forged += other.forged;
        self.astray += other.astray;
        self.motions += other.motions;
        let (a, b) = (&mut self.seen, &other.seen);
        for mode in 0..7 {
            a.speed_m_s[mode] = a.speed_m_s[mode].max(b.speed_m_s[mode]);
            a.acceleration_m_s2[mode] = a.acceleration_m_s2[mode].max(b.acceleration_m_s2[mode]);
            a.travel_m[mode] = a.travel_m[mode].max(b.travel_m[mode]);
        }
        a.from_setpoint_m = a.from_setpoint_m.max(b.from_setpoint_m);
        a.led_away_m = a.led_away_m.max(b.led_away_m);
        a.alone_m = a.alone_m.max(b.alone_m);
        a.resting_m_s = a.resting_m_s.max(b.resting_m_s);
        a.swing_m_s = a.swing_m_s.max(b.swing_m_s);
        a.swing_m_s2 = a.swing_m_s2.max(b.swing_m_s2);
    }
}

/// Configuration from which processes are created.
struct Parts {
    core: CoreConfig,
    controller: ControllerConfig,
    estimator: EstimatorConfig,
    planner: PlannerConfig,
    laws: [Law; 3],
    methods: [Method; 2],
}

impl Parts {
    fn new(case: &Case) -> Result<Self> {
        let scenario = case.scenario(true)?;
        let chain = Chain::new(&scenario)?;
        let section = EstimatorSection { method: EstimatorMethod::Kalman, ..EstimatorSection::default() };
        let PlannerSection { speed_m_s, acceleration_m_s2, check_step_m, swing_limit_m, .. } =
            PlannerSection::default();
        let [delay_s, lag_s] = case.motor_s;
        let lag = cable_control::drive_lag::DriveLag::new(delay_s, lag_s).map_err(|error| anyhow!("{error:?}"))?;
        let laws = [scenario.law, Law::PFeedforward(PFeedforward::new(2.0)?), crate::laws::law(Some(lag), true)?];
        Ok(Self {
            core: core_config(&scenario)?,
            controller: *chain.controller.config(),
            estimator: EstimatorConfig::from_section(&section, scenario.robot, 1)?,
            planner: PlannerConfig {
                robot: scenario.robot,
                distribution: scenario.distribution,
                speed_m_s,
                acceleration_m_s2,
                check_step_m,
                swing_limit_m,
            },
            laws,
            methods: [scenario.method, Method::from_section(&section)?],
        })
    }
}

/// State of one walk.
pub struct Walk {
    // On the heap: with their robots, both are large for the stack of a thread.
    robot: Box<Lockstep>,
    parts: Box<Parts>,
    random: Random,
    checks: Checks,
    last: Option<Cycle>,
    /// Faulty controllers, by slot.
    astray: [Option<Astray>; SLOTS],
    log: VecDeque<String>,
    /// Whether the drives were without power: the counts then miss the motion of the cables, so the position must be
    /// set again.
    powered_off: bool,
    /// Result so far.
    pub tally: Tally,
}

impl Walk {
    /// Starts with the robot armed, at a known position.
    ///
    /// # Errors
    /// If the scenario is invalid.
    pub fn new(case: &Case, seed: u64, bounds: Bounds) -> Result<Self> {
        let scenario = case.scenario(true)?;
        let checks = Checks::new(bounds, scenario.period_s);
        let mut robot = Box::new(Lockstep::new(scenario)?);
        robot.supervise(true);
        robot.zero_and_arm()?;
        let (parts, random) = (Box::new(Parts::new(case)?), Random::new(seed));
        let (last, log, tally) = (None, VecDeque::new(), Tally::default());
        let astray = [None; SLOTS];
        Ok(Self { robot, parts, random, checks, last, astray, log, powered_off: false, tally })
    }

    /// Does so many steps, with a recovery now and then and at the end.
    ///
    /// # Errors
    /// If an invariant does not hold, with the last steps.
    pub fn walk(&mut self, steps: u64) -> Result<()> {
        for step in 1..=steps {
            self.step().and_then(|()| self.come_back(step % EPISODE == 0 || step == steps))?;
        }
        Ok(())
    }

    /// The last steps, for the failure message.
    pub fn story(&self) -> String {
        let mut story = self.log.iter().map(String::as_str).collect::<Vec<_>>().join("\n");
        if let Some(Cycle { authority, slots, motion, estimate, .. }) = &self.last {
            story += &format!(
                "\n{authority:?}\n{slots:?}\nmotion {} epoch {} beat {} header {:?}, from {} s\n{estimate:?}",
                motion.motion, motion.epoch, motion.beat, motion.header, motion.current.start_s
            );
        }
        story
    }

    fn come_back(&mut self, now: bool) -> Result<()> {
        if now { self.recover() } else { Ok(()) }
    }

    fn record(&mut self, text: String) {
        if self.log.len() == TOLD {
            self.log.pop_front();
        }
        let at = self
            .last
            .map_or((0, 0, 0), |last| (last.authority.header.cycle, last.authority.mode, last.authority.faults));
        self.log.push_back(format!("cycle {} mode {} faults {:#x}: {text}", at.0, at.1, at.2));
    }

    /// Runs and checks one period.
    fn period(&mut self) -> Result<()> {
        self.tally.cycles += 1;
        if !self.robot.motor_io_lives() {
            self.robot.pass_without_motor_io()?;
            let (truth_m, truth_m_s) = (self.robot.plant().position_m(), self.robot.plant().velocity_m_s());
            let wrong = self.checks.without_motor_io(truth_m, truth_m_s, !self.robot.releases_a_cable());
            self.tally.seen = self.checks.seen;
            return wrong.map_or(Ok(()), |wrong| bail!("{wrong}"));
        }
        let cycle = self.robot.cycle()?;
        for (slot, astray) in self.astray.iter_mut().enumerate() {
            if let Some(astray) = astray {
                self.robot.slots_mut().alter_command(slot, |command| astray.alter(command));
            }
        }
        let astray = self.astray[usize::from(cycle.authority.active_controller).min(SLOTS - 1)].is_some();
        let wrong = self.checks.cycle(&cycle, !self.robot.releases_a_cable(), astray);
        self.tally.seen = self.checks.seen;
        self.last = Some(cycle);
        match wrong {
            Some(wrong) => bail!("cycle {}: {wrong}", cycle.authority.header.cycle),
            None => Ok(()),
        }
    }

    fn periods(&mut self, count: usize) -> Result<()> {
        (0..count).try_for_each(|_| self.period())
    }

    /// A request to motor-io and its answer: accepted or refused. `None` without motor-io.
    fn ask(&mut self, request: Request) -> Result<Option<std::result::Result<String, String>>> {
        if !self.robot.motor_io_lives() {
            return Ok(None);
        }
        let asked = format!("{request:?}");
        self.robot.request(request);
        self.period()?;
        let answer = *self.robot.answers().first().context("a request was not answered")?;
        let sentence = answer.sentence().to_string();
        self.record(format!("{asked}: {} {sentence}", answer.is_accepted()));
        Ok(Some(if answer.is_accepted() { Ok(sentence) } else { Err(self.refusal(sentence)?) }))
    }

    /// A refusal must name a cure.
    fn refusal(&mut self, sentence: String) -> Result<String> {
        self.tally.refusals += 1;
        if cures(&sentence).is_empty() && !is_settled(&sentence) {
            bail!("a refusal names no cure: {sentence}");
        }
        Ok(sentence)
    }

    /// Zeroes at the position of the node, at rest.
    fn zero(&mut self) -> Result<Option<std::result::Result<String, String>>> {
        for _ in 0..300 {
            let speed_m_s = cable_robot::Vector3::from(self.robot.plant().velocity_m_s()).norm();
            if speed_m_s < 1e-3 {
                break;
            }
            self.period()?;
        }
        let [x, y, z] = self.robot.plant().position_m();
        let answer = self.ask(Request::ZeroAt { position_m: [x, y, z] })?;
        if matches!(answer, Some(Ok(_))) {
            self.powered_off = false;
        }
        Ok(answer)
    }
}
