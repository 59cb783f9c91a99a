//! Invariants after each cycle, by the truth.

use crate::lockstep::Cycle;
use cable_robot::Vector3;
use messages::MotorAuthority;
use segments::motion_of;
use std::collections::VecDeque;

/// A cable with less tension counts as slack, N.
const SLACK_N: f64 = 0.5;
/// Longer than one swing of the node on its cables, s; motion not seen within this time is no swing.
const SWING_S: f64 = 0.6;

/// Time after a controller fault in which the node swings more, s.
const SHAKEN_S: f64 = 15.0;
/// Time that the next controller needs to bring the node back, s.
const LED_AWAY_S: f64 = 1.0;

/// Bounds on the node while the robot is in a mode; speed in m/s, acceleration in m/s².
///
/// They hold for a node that hung still. A node that still swings on its cables when its motion begins, because it was
/// stopped at once before, is bounded by the sum of both.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bound {
    /// Largest speed.
    pub speed_m_s: f64,
    /// Largest change of velocity per time, over a cycle.
    pub acceleration_m_s2: f64,
    /// Largest distance of the node from its position when the mode ended its motion, m.
    pub travel_m: f64,
}

/// The bounds of all modes, by their number.
#[derive(Debug, Clone, Copy)]
pub struct Bounds {
    /// See `MotorAuthority::MODE_*`.
    pub of_mode: [Bound; 7],
    /// Largest distance of the node from the setpoint while it follows, m.
    pub from_setpoint_m: f64,
    /// Additional distance with a controller that leads it away, before motor-io stops it, m.
    pub led_away_m: f64,
    /// Time without commands after which the drives stop by themselves, s.
    pub watchdog_s: f64,
    /// Time in which the node comes to rest after the last command, s; and its largest speed afterwards, m/s.
    pub rest: (f64, f64),
    /// Factor on the bounds of all modes after a controller fault, and the largest speed of the node at rest
    /// afterwards, m/s.
    pub shaken: (f64, f64),
}

/// Largest values seen, by mode.
#[derive(Debug, Clone, Copy, Default)]
pub struct Inputs {
    /// Speed, m/s.
    pub speed_m_s: [f64; 7],
    /// Acceleration, m/s².
    pub acceleration_m_s2: [f64; 7],
    /// Distance to the setpoint while following, m.
    pub from_setpoint_m: f64,
    /// The same with a faulty controller, m.
    pub led_away_m: f64,
    /// Distance from the position where a mode ended the motion, m.
    pub travel_m: [f64; 7],
    /// Distance since motor-io died, m.
    pub alone_m: f64,
    /// Speed where the node should be at rest, m/s.
    pub resting_m_s: f64,
    /// Speed above the bound of the mode of a node that already swung, m/s.
    pub swing_m_s: f64,
    /// The same for its acceleration, m/s².
    pub swing_m_s2: f64,
}

/// Compares each cycle with the one before.
#[derive(Debug, Clone)]
pub struct Checks {
    bounds: Bounds,
    period_s: f64,
    before: Option<(Vector3<f64>, u8)>,
    /// Distance to the setpoint in the cycle before, m.
    off_m: Option<f64>,
    /// Position of the node when its motion was ended.
    halted: Option<Vector3<f64>>,
    /// Time since the last command, s.
    resting_s: f64,
    /// Time since a controller in use became faulty, s.
    sound_s: f64,
    swing: Swing,
    /// Largest values so far.
    pub seen: Inputs,
}

impl Checks {
    /// Creates a check without samples.
    pub fn new(bounds: Bounds, period_s: f64) -> Self {
        let (resting_s, sound_s, swing, seen) = (0.0, f64::INFINITY, Swing::default(), Inputs::default());
        Self { bounds, period_s, before: None, off_m: None, halted: None, resting_s, sound_s, swing, seen }
    }

    /// Starts a new life of motor-io: later cycles are not compared with earlier ones.
    pub fn begin(&mut self) {
        (self.before, self.off_m, self.halted, self.resting_s) = (None, None, None, 0.0);
    }

    /// Checks a period without motor-io, in which the drives' watchdog stops the node; returns what is wrong. Later
    /// cycles are not compared with earlier ones.
    pub fn without_motor_io(&mut self, truth_m: [f64; 3], truth_m_s: [f64; 3], held: bool) -> Option<String> {
        if self.before.is_some() {
            self.begin();
        }
        let here = Vector3::from(truth_m);
        let from = *self.halted.get_or_insert(here);
        let mode = usize::from(MotorAuthority::MODE_FAULTED);
        let bound = self.bounds.of_mode[mode];
        let (speed_m_s, travel_m) = (Vector3::from(truth_m_s).norm(), (here - from).norm());
        self.resting_s += self.period_s;
        self.swing.at_rest(self.period_s, speed_m_s, 0.0);
        // From then on the cables are released, and the node sinks as fast as unpowered motors turn.
        let driven = held && self.resting_s <= self.bounds.watchdog_s;
        self.seen.alone_m = if driven { self.seen.alone_m.max(travel_m) } else { self.seen.alone_m };
        (speed_m_s > bound.speed_m_s || driven && travel_m > bound.travel_m)
            .then(|| format!("without motor-io the node moves at {speed_m_s:.3} m/s and has gone {travel_m:.3} m"))
    }

    /// Returns what is wrong in this cycle. `held`: every cable is held by its drive; `astray`: the controller in use
    /// is faulty.
    pub fn cycle(&mut self, cycle: &Cycle, held: bool, astray: bool) -> Option<String> {
        let mode = usize::from(cycle.authority.mode).min(6);
        let velocity = Vector3::from(cycle.truth_m_s);
        let speed_m_s = velocity.norm();
        let (was, before) = match self.before.replace((velocity, cycle.authority.mode)) {
            Some((before, was)) => (usize::from(was).min(6), before),
            None => (mode, velocity),
        };
        let acceleration_m_s2 = (velocity - before).norm() / self.period_s;
        // A mode affects the node one drive delay later, so the wider of both bounds holds.
        let (one, other) = (self.bounds.of_mode[mode], self.bounds.of_mode[was]);
        let commanded = cycle.sent_m_s.iter().any(|v| *v != 0.0);
        // A node that hangs from fewer cables than it should swings as a pendulum.
        let swings = cycle.truth_n.iter().any(|tension_n| *tension_n < SLACK_N);
        self.resting_s = if commanded || !held || swings { 0.0 } else { self.resting_s + self.period_s };
        let seen = &mut self.seen;
        seen.speed_m_s[mode] = seen.speed_m_s[mode].max(speed_m_s);
        seen.acceleration_m_s2[mode] = seen.acceleration_m_s2[mode].max(acceleration_m_s2);
        if !commanded {
            self.swing.at_rest(self.period_s, speed_m_s, acceleration_m_s2);
        }
        self.sound_s = if astray { 0.0 } else { self.sound_s + self.period_s };
        let (factor, resting_m_s) =
            if self.sound_s < SHAKEN_S { self.bounds.shaken } else { (1.0, self.bounds.rest.1) };
        let faster_m_s = speed_m_s - factor * one.speed_m_s.max(other.speed_m_s);
        let harder_m_s2 = acceleration_m_s2 - factor * one.acceleration_m_s2.max(other.acceleration_m_s2);
        seen.swing_m_s = seen.swing_m_s.max(faster_m_s);
        seen.swing_m_s2 = seen.swing_m_s2.max(harder_m_s2);
        // Swinging without commands is judged below.
        let (swing_m_s, swing_m_s2) = if commanded { self.swing.largest() } else { (0.0, 0.0) };
        if faster_m_s > swing_m_s {
            return Some(format!(
                "the node moves at {speed_m_s:.3} m/s in mode {mode}, and swung at {swing_m_s:.3} m/s"
            ));
        }
        if harder_m_s2 > swing_m_s2 {
            return Some(format!(
                "the node is accelerated by {acceleration_m_s2:.2} m/s² in mode {mode}, and swung with {swing_m_s2:.2} m/s²"
            ));
        }
        let here = Vector3::from(cycle.truth_m);
        let began = one.travel_m.is_finite() && other.travel_m.is_infinite() && mode != was;
        self.halted = self.halted.or(began.then_some(here)).filter(|_| one.travel_m.is_finite() && held && !swings);
        if let Some(halted) = self.halted {
            let travel_m = (here - halted).norm();
            seen.travel_m[mode] = seen.travel_m[mode].max(travel_m);
            if travel_m > factor * one.travel_m {
                return Some(format!("the node has gone {travel_m:.3} m since mode {mode} ended its motion"));
            }
        }
        if self.resting_s > self.bounds.rest.0 {
            seen.resting_m_s = seen.resting_m_s.max(speed_m_s);
            if speed_m_s > resting_m_s {
                return Some(format!("the node moves at {speed_m_s:.3} m/s where it should be at rest"));
            }
        }
        self.setpoint(cycle)
    }

    fn setpoint(&mut self, cycle: &Cycle) -> Option<String> {
        let authority = &cycle.authority;
        let since_s = (cycle.state.header.stamp_ns - cycle.input.begin_ns) as f64 * 1e-9;
        let time_s = authority.plan_time_s + authority.plan_rate * since_s;
        let followed = authority.mode == MotorAuthority::MODE_FOLLOWING && cycle.motion.motion == authority.motion;
        let setpoint = motion_of(&cycle.motion).filter(|_| followed).map(|motion| motion.setpoint(time_s));
        let off_m = setpoint.map(|setpoint| (Vector3::from(cycle.truth_m) - setpoint.position).norm());
        let before_m = self.off_m;
        self.off_m = off_m;
        let off_m = off_m?;
        let (seen_m, bound_m) = if self.sound_s < LED_AWAY_S {
            (&mut self.seen.led_away_m, self.bounds.from_setpoint_m + self.bounds.led_away_m)
        } else {
            (&mut self.seen.from_setpoint_m, self.bounds.from_setpoint_m)
        };
        *seen_m = seen_m.max(off_m);
        let away = before_m.is_some_and(|before_m| off_m > before_m);
        (off_m > bound_m && away).then(|| format!("the node is {off_m:.3} m from the setpoint and moves away from it"))
    }
}

/// How much the node swung on its cables in the last period without commands.
#[derive(Debug, Clone, Default)]
struct Swing {
    /// Speeds, m/s, and accelerations, m/s², of the last [`SWING_S`].
    last: VecDeque<(f64, f64)>,
}

impl Swing {
    /// Adds a period without a command.
    fn at_rest(&mut self, period_s: f64, speed_m_s: f64, acceleration_m_s2: f64) {
        self.last.push_back((speed_m_s, acceleration_m_s2));
        if self.last.len() as f64 * period_s > SWING_S {
            self.last.pop_front();
        }
    }

    fn largest(&self) -> (f64, f64) {
        self.last.iter().fold((0.0, 0.0), |(v, a), at| (at.0.max(v), at.1.max(a)))
    }
}
