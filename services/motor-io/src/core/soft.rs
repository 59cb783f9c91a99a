//! Soft mode: the cables carry the node and yield to a hand, for calibration and for teaching points.
//!
//! Each motor gets the current of the tension that holds the node's weight at its present position, by motor-io's own
//! lengths. Mass, friction and motor constants are never exactly those of the files, so that alone would let the node
//! drift. Two forces on the node are added, and distributed over the cables with its weight:
//!
//! * A dry friction of `HOLD_SHARE` of the load: a spring to where the hand has left the node, which gives way beyond
//!   its largest force. A node that is heavier than the robot file says by less than this share of it does not sink on;
//!   it settles by `HOLD_WAY_M` at most.
//! * A damping of the node on this spring.
//!
//! The currents begin with those that held the node on average, and change to their own within `FADE_S`: what the files
//! do not state shows as slowly as that. The drives' own friction adds to both forces. Borders, a cable that runs away
//! and missing readings end the mode: the cables brake from the velocities that the hand gave them, and then hold. The
//! lengths, which were counted all the time, still tell where the node is.

#![allow(clippy::result_large_err)] // a reason in place: the loop does not allocate, so nothing is boxed

use super::Core;
use super::border::bend_m;
use super::settle::REACTION_S;
use crate::limits::largest;
use crate::mode::{Mode, Soft, Stop};
use cable_robot::rate::COUNTED_PERIOD_S;
use cable_robot::{CableVec, Held, Vector3, tension};
use messages::{CABLES, MotorAuthority, MotorState};
use robot_state::Reason;
use robot_state::answers::detail;

/// Share of the load that the added friction holds: three standard deviations of the node's mass (3 % each) and of the
/// force constants of several motors (5 % each) together, rounded up.
const HOLD_SHARE: f64 = 0.2;
/// Way in which the added friction builds up, m: a hand feels no step, and the force does not shake.
const HOLD_WAY_M: f64 = 0.03;
/// Damping of the node on the spring of the added friction, relative to the critical one.
const DAMPING: f64 = 0.5;
/// Time in which the currents change from those that held the node, s. The node settles by `HOLD_WAY_M` at most
/// meanwhile, so at less than a third of the 0.05 m/s at which it may sink.
const FADE_S: f64 = 2.0;
/// Largest speed of a cable, as a share of the cable's limit in motions.
const FAST_SHARE: f64 = 0.5;
/// Cycles in a row in which a cable may be faster, at more than 250 Hz as long: one may be a late reading.
const FAST_CYCLES: u32 = 3;
/// Cycles in a row in which a unit may not be read: as many as before it counts as lost, and at more than 250 Hz as
/// long.
const UNREAD_CYCLES: u32 = 3;
/// Largest speed of a cable at rest, m/s: a step of a coarse encoder within 50 ms.
const REST_M_S: f64 = 0.003;
/// Weight of the newest difference of lengths in the velocity: about two cycles, and at more than 250 Hz as long,
/// because a step of an encoder is the larger a velocity, the shorter the cycle.
const NEWEST: f64 = 0.5;
/// Shares of the added forces that are tried until the tensions are within their limits.
const SHARES: [f64; 4] = [1.0, 0.5, 0.25, 0.0];

impl Core {
    /// State at the beginning of soft mode, or why it cannot begin here.
    pub(crate) fn soften(&self) -> Result<Soft, Reason> {
        let n = self.config.cable_count();
        if self.odometry.position() != MotorState::POSITION_KNOWN {
            return Err(Reason::NotSoftPosition);
        }
        let at = self.node.position_m().ok_or(Reason::NotSoftPosition)?;
        let held_a = self.still.currents_a(&self.config, &self.watch).ok_or(Reason::NotSoftYet)?;
        if self.unit_trouble || (0..n).any(|i| self.odometry.velocity_m_s(i).abs() > REST_M_S) {
            return Err(Reason::NotSoftYet);
        }
        let weight_n = self.config.robot.wrench_n(&Vector3::zeros());
        let tensions_n = match tension::for_wrench(&self.config.robot, &at, &weight_n, self.config.distribution) {
            Ok(held) => held.tensions_n,
            Err(error) => return Err(Reason::NotSoftTensions { why: detail(error) }),
        };
        let motor = self.config.robot.motor();
        let most_n = self.config.robot.tension_limits_n()[1];
        for (i, tension_n) in tensions_n.iter().enumerate() {
            let ratio = self.odometry.radius_ratio(i);
            let pull_n = (tension_n * ratio + motor.coulomb_n) / ((1.0 - motor.gear_friction).max(0.0) * ratio);
            // Not a number: a gear that holds everything, without a load.
            if pull_n.is_nan() || pull_n > most_n {
                return Err(Reason::NotSoftGear { cable: i + 1, pull_n, most_n });
            }
        }
        let own_a = self.currents_a(&tensions_n);
        let most_a = self.config.current_limit_a;
        let held_a = held_a.map(|current_a| current_a.clamp(0.0, most_a));
        let soft = Soft {
            lengths_m: std::array::from_fn(|i| self.odometry.length_m(i)),
            sampled_ns: std::array::from_fn(|i| self.odometry.sampled_ns(i)),
            velocity_m_s: [0.0; CABLES],
            rest_m: at.into(),
            current_a: held_a,
            begin_a: std::array::from_fn(|i| held_a[i] - own_a[i]),
            begun: 0,
            fast: 0,
            unread: 0,
        };
        if self.at_border(&soft.velocity_m_s, &tensions_n) { Err(Reason::NotSoftBorder) } else { Ok(soft) }
    }

    /// Ends soft mode: the cables come to rest from the velocities that the hand gave them. `cause` 0: on request.
    pub(crate) fn end_soft(&mut self, cause: u32) {
        self.safety.record_stop(cause);
        self.safety.enter(Mode::Stopping(Stop::open()));
        self.safety.start_epoch();
    }

    /// One cycle of soft mode: new currents, or its end.
    pub(super) fn yield_to_hand(&mut self, mut soft: Soft) {
        let lost = self.who_is_lost() & MotorAuthority::FAULT_SUPERVISOR_LOST;
        if lost != 0 {
            return self.end_soft(lost);
        }
        soft.unread = if self.unit_trouble { soft.unread + 1 } else { 0 };
        if soft.unread >= self.config.lasting(UNREAD_CYCLES) {
            return self.end_soft(MotorAuthority::FAULT_LONG_GAP);
        }
        self.read_velocities(&mut soft);
        self.limits.begin(&soft.velocity_m_s);
        let fast = largest(&soft.velocity_m_s) > FAST_SHARE * self.config.cable_speed_m_s;
        soft.fast = if fast { soft.fast + 1 } else { 0 };
        if soft.fast >= self.config.lasting(FAST_CYCLES) {
            return self.end_soft(MotorAuthority::FAULT_SOFT_SPEED);
        }
        let Some(tensions_n) = self.yielding_tensions_n(&mut soft) else {
            return self.end_soft(MotorAuthority::FAULT_BORDER);
        };
        if self.at_border(&soft.velocity_m_s, &tensions_n) {
            return self.end_soft(MotorAuthority::FAULT_BORDER);
        }
        let own_a = self.currents_a(&tensions_n);
        soft.begun = soft.begun.saturating_add(1);
        let left = (1.0 - f64::from(soft.begun) / f64::from(self.config.cycles(FADE_S))).max(0.0);
        // Never less than none: a motor that pays out a slack cable winds it off its drum.
        let most_a = self.config.current_limit_a;
        soft.current_a = std::array::from_fn(|i| (own_a[i] + left * soft.begin_a[i]).clamp(0.0, most_a));
        self.safety.enter(Mode::Soft(soft));
    }

    /// Updates the velocities of the cables that were read in the last cycle.
    fn read_velocities(&self, soft: &mut Soft) {
        let newest = NEWEST * (self.config.period_s / COUNTED_PERIOD_S).min(1.0);
        for i in 0..self.config.cable_count() {
            let (length_m, sampled_ns) = (self.odometry.length_m(i), self.odometry.sampled_ns(i));
            let passed_s = sampled_ns.saturating_sub(soft.sampled_ns[i]) as f64 * 1e-9;
            if passed_s > 0.0 {
                let now_m_s = (length_m - soft.lengths_m[i]) / passed_s;
                soft.velocity_m_s[i] += newest * (now_m_s - soft.velocity_m_s[i]);
                (soft.lengths_m[i], soft.sampled_ns[i]) = (length_m, sampled_ns);
            }
        }
    }

    /// Tensions for the weight, the added friction and the damping; `None` where the node cannot hang.
    fn yielding_tensions_n(&self, soft: &mut Soft) -> Option<CableVec> {
        let robot = &self.config.robot;
        let at = self.node.position_m()?;
        let velocity_m_s = self.node.velocity_of(&soft.velocity_m_s)?;
        let weight_n = robot.wrench_n(&Vector3::zeros());
        let carried = tension::for_wrench(robot, &at, &weight_n, self.config.distribution).ok()?;
        let load_n = carried.tensions_n.iter().fold(weight_n.norm(), |most: f64, t| most.max(*t));
        let spring_n_m = HOLD_SHARE * load_n / HOLD_WAY_M;
        let damping_n_s_m = 2.0 * DAMPING * (spring_n_m * robot.node_mass_kg()).sqrt();
        let mut away = at - Vector3::from(soft.rest_m);
        if away.norm() > HOLD_WAY_M {
            away *= HOLD_WAY_M / away.norm();
            soft.rest_m = (at - away).into();
        }
        let added_n = -away * spring_n_m - velocity_m_s * damping_n_s_m;
        SHARES.iter().find_map(|share| {
            let wrench_n = weight_n + added_n * *share;
            tension::for_wrench(robot, &at, &wrench_n, self.config.distribution).ok().map(|held| held.tensions_n)
        })
    }

    /// Currents of these tensions without friction, which acts against either direction, A.
    fn currents_a(&self, tensions_n: &CableVec) -> [f64; CABLES] {
        let force_constant_n_a = self.config.robot.motor().force_constant_n_a;
        let most_a = self.config.current_limit_a;
        std::array::from_fn(|i| {
            let tension_n = tensions_n.get(i).copied().unwrap_or(0.0);
            (tension_n * self.odometry.radius_ratio(i) / force_constant_n_a).clamp(0.0, most_a)
        })
    }

    /// Whether node or cables come too close to a border before the drives have stopped them: of an obstacle, of a
    /// keep-out box, of the ground or of a cable's length.
    fn at_border(&self, velocity_m_s: &[f64; CABLES], tensions_n: &CableVec) -> bool {
        let robot = &self.config.robot;
        // From then on the node brakes by its own limit or that of the fastest cable.
        let node_m_s = self.node.velocity_of(velocity_m_s).map_or(0.0, |v| v.norm());
        let brakes_s = node_m_s / self.config.node_acceleration_m_s2;
        let brakes_s = brakes_s.max(largest(velocity_m_s) / self.config.cable_acceleration_m_s2);
        let way_s = REACTION_S + 2.0 * self.config.period_s + 0.5 * brakes_s;
        let way_m = velocity_m_s.map(|v| v * way_s);
        for (i, [low, high]) in robot.length_limits_m().iter().enumerate() {
            let (length, way) = (self.odometry.length_m(i), way_m[i]);
            if (way > 0.0 && length + way > *high) || (way < 0.0 && length + way < *low) {
                return true;
            }
        }
        let Some(way) = self.node.way(&way_m) else { return true };
        let ((from_m, _), (to_m, _)) = (&way.from, &way.to);
        if to_m.z < robot.ground_m() && to_m.z < from_m.z {
            return true;
        }
        if robot.keep_out().is_empty() && robot.obstacles().next().is_none() {
            return false;
        }
        let bend = (0..robot.cable_count()).map(|cable| bend_m(robot, cable, from_m, to_m)).fold(0.0, f64::max);
        let held = |position_m: &Vector3<f64>| Held { position_m: *position_m, tensions_n };
        robot.approached(&held(from_m), &held(to_m), bend).is_some()
    }
}
