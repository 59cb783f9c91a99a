//! Command of one motor: duty, speed, a queue of distances, or a position.

use std::collections::VecDeque;

/// Capacity of a unit's command buffer, from the manual.
const BUFFER: usize = 64;

/// Present target of a motor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Target {
    /// Speed for the unit's velocity loop, counts per second.
    Speed(f64),
    /// Share of the supply, -1 to 1, without a loop.
    Duty(f64),
}

/// A move over a distance or to a position.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Move {
    /// Acceleration, counts per second squared; 0: a step.
    pub(super) ramp: f64,
    /// Deceleration towards the end of a move to a position, counts per second squared.
    pub(super) end_ramp: f64,
    /// Speed, counts per second.
    pub(super) speed: f64,
    pub(super) goal: Goal,
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Goal {
    /// Number of counts from the start; the speed's sign is the direction.
    Distance(f64),
    /// Encoder count of the end.
    Position(f64),
}

#[derive(Debug, Clone)]
pub(super) struct Axis {
    /// Present speed of the ramp, its end, and its acceleration.
    now: Target,
    end: f64,
    ramp: f64,
    /// Active move and the count at its start.
    current: Option<(Move, f64)>,
    queue: VecDeque<Move>,
}

impl Axis {
    pub(super) fn new() -> Axis {
        Axis { now: Target::Duty(0.0), end: 0.0, ramp: 0.0, current: None, queue: VecDeque::with_capacity(BUFFER) }
    }

    pub(super) fn target(&self) -> Target {
        self.now
    }

    /// True where a watchdog would have a motion to stop.
    pub(super) fn is_driven(&self) -> bool {
        self.now != Target::Duty(0.0) || self.current.is_some()
    }

    /// Number of waiting moves; `None` without an active one.
    pub(super) fn waiting(&self) -> Option<usize> {
        self.current.map(|_| self.queue.len())
    }

    pub(super) fn set_duty(&mut self, duty: f64, ramp: f64) {
        self.forget_moves();
        let from = match self.now {
            Target::Duty(from) => from,
            Target::Speed(_) => 0.0,
        };
        self.end = duty.clamp(-1.0, 1.0);
        self.ramp = ramp;
        self.now = Target::Duty(if ramp > 0.0 { from } else { self.end });
    }

    pub(super) fn set_speed(&mut self, speed: f64, ramp: f64, measured_counts_s: f64) {
        self.forget_moves();
        self.head_for(speed, ramp, measured_counts_s);
    }

    fn head_for(&mut self, speed: f64, ramp: f64, measured_counts_s: f64) {
        let from = match self.now {
            Target::Speed(from) => from,
            Target::Duty(_) => measured_counts_s,
        };
        self.end = speed;
        self.ramp = ramp;
        self.now = Target::Speed(if ramp > 0.0 { from } else { speed });
    }

    /// Starts a move now, or queues it. A full buffer rejects it.
    pub(super) fn add_move(&mut self, new: Move, at_once: bool) -> bool {
        if at_once {
            self.forget_moves();
        }
        if self.queue.len() >= BUFFER {
            return false;
        }
        self.queue.push_back(new);
        true
    }

    fn forget_moves(&mut self) {
        self.current = None;
        self.queue.clear();
    }

    pub(super) fn advance(&mut self, step_s: f64, count: i64) {
        let count = count as f64;
        if let Some((made, began)) = self.current {
            let over = match made.goal {
                Goal::Distance(distance) => (count - began).abs() >= distance,
                // A position is held until the next command.
                Goal::Position(_) => !self.queue.is_empty() && self.now == Target::Speed(0.0),
            };
            if over {
                self.current = None;
                if self.queue.is_empty() {
                    self.head_for(0.0, 0.0, 0.0);
                }
            }
        }
        if self.current.is_none()
            && let Some(next) = self.queue.pop_front()
        {
            self.current = Some((next, count));
            self.head_for(if matches!(next.goal, Goal::Position(_)) { 0.0 } else { next.speed }, next.ramp, 0.0);
        }
        if let Some((Move { ramp, end_ramp, speed, goal: Goal::Position(position) }, _)) = self.current {
            let left = position - count;
            // Braking with this ramp ends there; without one, most of the way within a twentieth of a second.
            let brake = if end_ramp > 0.0 { (2.0 * end_ramp * left.abs()).sqrt() } else { left.abs() * 20.0 };
            self.end = if left.abs() < 1.0 { 0.0 } else { speed.abs().min(brake).copysign(left) };
            self.ramp = if self.end.abs() < speed.abs() { 0.0 } else { ramp };
        }
        let (Target::Speed(now) | Target::Duty(now)) = self.now;
        let next = if self.ramp > 0.0 {
            let most = self.ramp * step_s;
            now + (self.end - now).clamp(-most, most)
        } else {
            self.end
        };
        self.now = match self.now {
            Target::Speed(_) => Target::Speed(next),
            Target::Duty(_) => Target::Duty(next),
        };
    }
}
