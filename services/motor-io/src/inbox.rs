//! Collects what arrives between two cycles into the [`MotorInput`] that the core receives.

use crate::core::REQUESTS;
use crate::odometry::Position;
use crate::setpoint::Setpoints;
use messages::{
    CABLES, MotorCommand, MotorInput, NodeEstimate, OperatorRequest, PlanMotion, PlanSegment, Request, RequestBody,
    SLOTS, UNITS,
};

/// ```
/// use motor_io::Inbox;
/// let mut inbox = Inbox::new(3, 2);
/// inbox.request(7, &messages::Request::Arm.body());
/// let input = inbox.begin(1, 10_000_000, 10_050_000); // then core.decide(input)
/// input.unit[0] = messages::MotorInput::UNIT_OK; //        the drives' replies, then core.observe(input)
/// inbox.finish();
/// ```
#[derive(Debug, Clone)]
pub struct Inbox {
    input: MotorInput,
    setpoints: Setpoints,
    requests: usize,
}

impl Inbox {
    /// For a robot with this many cables and drive units.
    #[must_use]
    pub fn new(cables: usize, units: usize) -> Self {
        let mut input = MotorInput { cable_count: cables as u8, unit_count: units as u8, ..MotorInput::default() };
        // NaN: not read yet.
        input.supply_v = [f64::NAN; UNITS];
        Self { input, setpoints: Setpoints::default(), requests: 0 }
    }

    /// Sets the life that begins; every sample of the control chain carries it.
    #[must_use]
    pub fn of_life(mut self, life: u64) -> Self {
        self.input.header.life = life;
        self
    }

    /// Sets the input of the first cycle: the epoch, and the position stored by the previous life.
    pub fn first(&mut self, epoch: u32, restored: Option<Position>) {
        self.input.first_epoch = epoch;
        if let Some(position) = restored {
            self.input.restored = 1;
            self.input.restored_m = position.lengths_m;
            self.input.restored_counts = position.counts;
            self.input.restored_zeroed_m = position.zeroed_m;
        }
    }

    /// Adds a controller's command; the newest one of a cycle counts.
    pub fn command(&mut self, slot: usize, command: &MotorCommand) {
        self.input.command[slot] = *command;
        self.input.command_arrived[slot] = 1;
    }

    /// Adds an estimate. One of another life does not replace one of this life.
    pub fn estimate(&mut self, slot: usize, estimate: &NodeEstimate) {
        let life = self.input.header.life;
        if estimate.header.life != life && self.input.estimate_life[slot] == life {
            return;
        }
        self.input.estimate_cycle[slot] = estimate.header.cycle;
        self.input.estimate_life[slot] = estimate.header.life;
        self.input.estimate_valid[slot] = estimate.valid;
        self.input.estimate_incarnation[slot] = estimate.incarnation;
        self.input.estimate_position_m[slot * 3..][..3].copy_from_slice(&estimate.position_m);
        self.input.estimate_tension_n[slot * CABLES..][..CABLES].copy_from_slice(&estimate.tension_n);
    }

    /// Adds the planner's motion; `following` is the number of the motion that the robot follows, 0: none.
    pub fn motion(&mut self, motion: &PlanMotion, following: u32) {
        self.setpoints.update(motion, following);
        let end = |segment: &PlanSegment| segment.start_s + segment.duration_s;
        let carried = if motion.next.id == 0 { &motion.current } else { &motion.next };
        self.input.motion = motion.motion;
        self.input.motion_life = motion.header.life;
        self.input.motion_asked_ns = motion.asked_ns;
        self.input.motion_epoch = motion.epoch;
        self.input.mission = motion.mission;
        self.input.motion_segment = motion.current.id;
        self.input.motion_start_s = motion.current.start_s;
        self.input.motion_end_s = motion.end_s;
        self.input.motion_known_s = end(carried);
        self.input.planner_beat = motion.beat;
    }

    /// Sets the setpoint at the present plan time, by which the core judges.
    pub fn judge_at(&mut self, plan_time_s: f64) {
        self.setpoints.write(plan_time_s, &mut self.input);
    }

    /// Adds the supervisor's beat.
    pub fn supervisor(&mut self, beat: u64) {
        self.input.supervisor_beat = beat;
    }

    /// Adds a request; false if this cycle has no room for it.
    pub fn request(&mut self, id: u64, body: &RequestBody) -> bool {
        self.request_made(id, body, 0)
    }

    /// Adds a request that was made at `stamp_ns`; false if this cycle has no room for it.
    pub fn request_made(&mut self, id: u64, body: &RequestBody, stamp_ns: u64) -> bool {
        let i = self.requests;
        if i == REQUESTS {
            return false;
        }
        self.input.request_id[i] = id;
        self.input.request[i] = *body;
        self.input.request_stamp_ns[i] = stamp_ns;
        self.requests += 1;
        true
    }

    /// Adds emergency stops, which arrive before all other requests; the newest was made at `newest_ns`. One request is
    /// enough for the robot.
    pub fn emergency(&mut self, stops: usize, first: &OperatorRequest, newest_ns: u64) {
        self.input.estops = stops as u32;
        self.request_made(first.id, &Request::Estop.body(), newest_ns);
    }

    /// True if this cycle has room for another request.
    #[must_use]
    pub fn has_room(&self) -> bool {
        self.requests < REQUESTS
    }

    /// Begins the cycle: closes the input, with room for the drives' replies.
    pub fn begin(&mut self, cycle: u64, tick_ns: u64, begin_ns: u64) -> &mut MotorInput {
        debug_assert!(cycle > self.input.header.cycle, "cycle {cycle} after {}", self.input.header.cycle);
        debug_assert!(begin_ns >= self.input.begin_ns, "a cycle begins before the one before it");
        self.input.header.cycle = cycle;
        self.input.header.stamp_ns = begin_ns;
        self.input.header.oldest_input_ns = begin_ns;
        self.input.tick_ns = tick_ns;
        self.input.begin_ns = begin_ns;
        self.input.end_ns = begin_ns;
        self.input.unit = [MotorInput::UNIT_ABSENT; UNITS];
        self.input.slow_fresh = [0; UNITS];
        &mut self.input
    }

    /// Input of the present cycle.
    #[must_use]
    pub fn input(&self) -> &MotorInput {
        &self.input
    }

    /// Input of the present cycle, for the drives' replies.
    pub fn input_mut(&mut self) -> &mut MotorInput {
        &mut self.input
    }

    /// Ends the cycle: clears what it has used.
    pub fn finish(&mut self) {
        self.requests = 0;
        self.input.estops = 0;
        self.input.request_id = [0; REQUESTS];
        self.input.request = [RequestBody::default(); REQUESTS];
        self.input.request_stamp_ns = [0; REQUESTS];
        self.input.command_arrived = [0; SLOTS];
        self.input.first_epoch = 0;
        self.input.restored = 0;
        self.input.restored_m = [0.0; CABLES];
        self.input.restored_counts = [0; CABLES];
        self.input.restored_zeroed_m = [0.0; CABLES];
    }
}
