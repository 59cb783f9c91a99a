//! The motion that the robot follows, and when it ends.

use messages::MotorInput;

/// State of the motion that the robot follows or can resume.
#[derive(Debug, Clone, Default)]
pub struct Motion {
    id: u32,
    end_s: f64,
    known_s: f64,
    segment: u32,
    planner_gone: bool,
    orphaned: u32,
    beat: u64,
    finished: Option<(u32, f64)>,
}

impl Motion {
    /// Number of the motion; 0: none.
    #[must_use]
    pub fn id(&self) -> u32 {
        self.id
    }

    /// Segment of the last command used; 0: none.
    #[must_use]
    pub fn segment(&self) -> u32 {
        self.segment
    }

    /// Reads plan/motion of this cycle: the end may move, as the planner adds segments.
    pub fn update(&mut self, input: &MotorInput) {
        if self.id == 0 {
            return;
        }
        // A planner that restarts counting its beats is another one, whatever the number of its motion.
        if input.planner_beat < self.beat {
            self.beat = u64::MAX; // for the rest of this motion
        }
        let other = input.motion != self.id || input.motion_life != input.header.life;
        self.planner_gone = other || input.planner_beat < self.beat;
        self.orphaned = if self.planner_gone { self.orphaned.saturating_add(1) } else { 0 };
        if !self.planner_gone {
            self.beat = input.planner_beat;
        }
        if !self.planner_gone && input.motion_end_s.is_finite() && input.motion_known_s.is_finite() {
            self.end_s = input.motion_end_s;
            self.known_s = input.motion_known_s;
        }
    }

    /// Returns true if plan/motion offers a motion from rest that is not done yet, in this epoch, at this plan time.
    #[must_use]
    pub fn is_offered(&self, input: &MotorInput, epoch: u32, plan_time_s: f64, tolerance_s: f64) -> bool {
        let finite =
            input.motion_start_s.is_finite() && input.motion_end_s.is_finite() && input.motion_known_s.is_finite();
        let fresh = match self.finished {
            Some((id, at_s)) => input.motion != id || input.motion_start_s >= at_s,
            None => true,
        };
        self.id == 0
            && input.motion != 0
            && input.motion_segment != 0
            && input.motion_epoch == epoch
            && input.motion_life == input.header.life
            && finite
            && fresh
            && input.motion_start_s >= plan_time_s - tolerance_s
    }

    /// Begins the offered motion.
    pub fn begin(&mut self, input: &MotorInput) {
        debug_assert!(self.id == 0, "motion {} begins before motion {} is over", input.motion, self.id);
        debug_assert!(input.motion != 0 && input.motion_segment != 0, "a motion or a segment has no number");
        self.id = input.motion;
        self.segment = input.motion_segment;
        self.beat = input.planner_beat;
        self.update(input);
    }

    /// Returns true if a command for this segment belongs to this motion.
    #[must_use]
    pub fn has(&self, segment: u32) -> bool {
        // The controller keeps the motion it follows when its planner is gone. A planner numbers the segments of a
        // motion consecutively; a restarted one uses other numbers, and commands for those are rejected.
        segment != 0
            && (!self.planner_gone || segment == self.segment || segment == self.segment.wrapping_add(1).max(1))
    }

    /// Cycles since plan/motion last held this motion.
    #[must_use]
    pub fn cycles_without_plan(&self) -> u32 {
        self.orphaned
    }

    /// Records the segment of the command in use.
    pub fn follow(&mut self, segment: u32) {
        debug_assert!(segment != 0, "a command without a segment is followed");
        self.segment = segment;
    }

    /// Returns true once the known part of the motion is over: the setpoint is at rest.
    #[must_use]
    pub fn is_over(&self, plan_time_s: f64) -> bool {
        plan_time_s >= self.end_s.min(self.known_s)
    }

    /// Returns true if the motion ended early, because the planner did not continue it.
    #[must_use]
    pub fn cut_short(&self, tolerance_s: f64) -> bool {
        self.known_s + tolerance_s < self.end_s
    }

    /// Ends the motion, or gives it up, at this plan time.
    pub fn finish(&mut self, plan_time_s: f64) {
        if self.id != 0 {
            // A motion that starts before this plan time is the same one.
            self.finished = Some((self.id, plan_time_s));
        }
        self.id = 0;
        self.segment = 0;
        self.planner_gone = false;
        self.orphaned = 0;
    }
}
