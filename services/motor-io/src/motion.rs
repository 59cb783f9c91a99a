//! Which motion is being followed, and when it is over.

use messages::MotorInput;

/// The motion that the robot follows, or could go on with.
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
    /// 0: none.
    #[must_use]
    pub fn id(&self) -> u32 {
        self.id
    }

    /// Segment of the last command used; 0: none.
    #[must_use]
    pub fn segment(&self) -> u32 {
        self.segment
    }

    /// What plan/motion says this cycle: the end may move, as the planner adds segments.
    pub fn note(&mut self, input: &MotorInput) {
        if self.id == 0 {
            return;
        }
        // A planner that counts its beats anew is another one, whatever number its motion has.
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

    /// True if plan/motion holds a motion from rest that is still to be made, in this epoch, at this plan time.
    #[must_use]
    pub fn offered(&self, input: &MotorInput, epoch: u32, plan_time_s: f64, tolerance_s: f64) -> bool {
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

    /// The offered motion is the robot's from now on.
    pub fn begin(&mut self, input: &MotorInput) {
        self.id = input.motion;
        self.segment = input.motion_segment;
        self.beat = input.planner_beat;
        self.note(input);
    }

    /// True if a command for this segment belongs to this motion.
    #[must_use]
    pub fn has(&self, segment: u32) -> bool {
        // The controller keeps the motion it follows when its planner is gone. A planner numbers the segments of a motion one after the
        // other; one that was started anew has others, and whoever follows those is not heard.
        segment != 0
            && (!self.planner_gone || segment == self.segment || segment == self.segment.wrapping_add(1).max(1))
    }

    /// Cycles since plan/motion last held this motion.
    #[must_use]
    pub fn orphaned(&self) -> u32 {
        self.orphaned
    }

    /// A command for this segment is used.
    pub fn follow(&mut self, segment: u32) {
        self.segment = segment;
    }

    /// True once everything that is known of it has been flown: the setpoint is at rest.
    #[must_use]
    pub fn ended(&self, plan_time_s: f64) -> bool {
        plan_time_s >= self.end_s.min(self.known_s)
    }

    /// It ended before its end: the planner did not go on.
    #[must_use]
    pub fn cut_short(&self, tolerance_s: f64) -> bool {
        self.known_s + tolerance_s < self.end_s
    }

    /// It is over, or given up, at this plan time.
    pub fn finish(&mut self, plan_time_s: f64) {
        if self.id != 0 {
            // Whatever starts before this moment of the plan clock is part of it.
            self.finished = Some((self.id, plan_time_s));
        }
        self.id = 0;
        self.segment = 0;
        self.planner_gone = false;
        self.orphaned = 0;
    }
}
