//! Model of a motor drive: command delay and lag, and a speed loop on encoder counts.
//!
//! The speed loop is that of typical two-channel drives: gains are numbers near one, the output is scaled by the speed
//! at full duty, and it runs 300 times per second:
//!
//! `duty = (r + P e + I Σe + D Δe) / full speed`, with `e` the error in counts per second at each sample.
//!
//! Manufacturers do not publish their scaling. With this one the common factory gains (P 1, I 0.5, D 0.25) give a
//! well-damped loop of 100 rad/s on the default motor, so they have approximately the expected effect.

use crate::error::{PlantError, check};

/// Samples of the speed loop per second.
pub const LOOP_HZ: u64 = 300;

/// Time between two samples of the speed loop, ns.
const LOOP_PERIOD_NS: u64 = 1_000_000_000 / LOOP_HZ;

/// Weight of the newest sample in the averaged speed: an average over about 30 ms.
const SPEED_SMOOTHING: f64 = 0.1;

/// Largest number of delayed commands; one per control cycle of 2 ms for 2 s.
const IN_FLIGHT: usize = 1024;

/// Command of a drive for one motor. Positive pays out cable.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum MotorInput {
    /// Closed loop: encoder counts per second.
    Speed(f64),
    /// Open loop: share of the supply voltage, -1 to 1. Zero shorts the motor's leads.
    Duty(f64),
    /// Closed loop: motor current, A. Current loops are a hundred times as fast as speed loops, so it has no delay
    /// here.
    Current(f64),
}

impl MotorInput {
    /// The motor is not driven; its leads are shorted.
    pub const RELEASED: Self = Self::Duty(0.0);
}

/// Gains of the speed loop.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SpeedGains {
    /// Proportional.
    pub p: f64,
    /// Integral, per sample.
    pub i: f64,
    /// Differential, per sample.
    pub d: f64,
    /// Counts per second at full duty.
    pub full_speed_counts_s: f64,
}

/// Settings of the drives.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DriveConfig {
    /// Speed loop; `None`: P 1, I 0.25, D 0 and the full speed that results from motor, supply and encoder. These make
    /// the loop critically damped at 67 rad/s on the default motor.
    pub gains: Option<SpeedGains>,
    /// Time from a speed command to its effect on the reference, s.
    pub delay_s: f64,
    /// Time constant of the reference after the delay, s.
    pub lag_s: f64,
}

impl Default for DriveConfig {
    fn default() -> Self {
        Self { gains: None, delay_s: 0.030, lag_s: 0.040 }
    }
}

impl DriveConfig {
    pub(crate) fn validate(&self) -> Result<(), PlantError> {
        check("delay_s", self.delay_s, "zero to 2 s", |x| (0.0..=2.0).contains(&x))?;
        check("lag_s", self.lag_s, "zero to 10 s", |x| (0.0..=10.0).contains(&x))?;
        self.gains.map_or(Ok(()), |gains| gains.validate())
    }
}

impl SpeedGains {
    pub(crate) fn validate(&self) -> Result<(), PlantError> {
        check("p", self.p, "zero or more", |x| x >= 0.0)?;
        check("i", self.i, "zero or more", |x| x >= 0.0)?;
        check("d", self.d, "zero or more", |x| x >= 0.0)?;
        check("full_speed_counts_s", self.full_speed_counts_s, "one or more counts per second", |x| x >= 1.0)
    }
}

/// One channel of a drive.
#[derive(Debug, Clone, PartialEq)]
pub struct Drive {
    gains: SpeedGains,
    delay_ns: u64,
    lag_s: f64,
    input: MotorInput,
    in_flight: [(u64, f64); IN_FLIGHT],
    first: usize,
    queued: usize,
    target_counts_s: f64,
    reference_counts_s: f64,
    next_sample_ns: u64,
    last_sample_ns: u64,
    last_counts: i64,
    measured_counts_s: f64,
    averaged_counts_s: f64,
    error_sum: f64,
    last_error: f64,
    duty: f64,
}

impl Drive {
    /// A drive without any command: the motor is released.
    pub fn new(config: DriveConfig, gains: SpeedGains) -> Self {
        Self {
            gains,
            delay_ns: (config.delay_s * 1e9).round() as u64,
            lag_s: config.lag_s,
            input: MotorInput::RELEASED,
            in_flight: [(0, 0.0); IN_FLIGHT],
            first: 0,
            queued: 0,
            target_counts_s: 0.0,
            reference_counts_s: 0.0,
            next_sample_ns: LOOP_PERIOD_NS,
            last_sample_ns: 0,
            last_counts: 0,
            measured_counts_s: 0.0,
            averaged_counts_s: 0.0,
            error_sum: 0.0,
            last_error: 0.0,
            duty: 0.0,
        }
    }

    /// Receives a command at `now_ns`.
    pub fn command(&mut self, now_ns: u64, input: MotorInput) {
        if input == self.input {
            return;
        }
        match input {
            MotorInput::Speed(speed) => {
                if let MotorInput::Duty(_) | MotorInput::Current(_) = self.input {
                    self.close_loop();
                }
                if self.queued == IN_FLIGHT {
                    // The buffer is full: the oldest command takes effect early.
                    self.target_counts_s = self.in_flight[self.first].1;
                    self.first = (self.first + 1) % IN_FLIGHT;
                    self.queued -= 1;
                }
                self.in_flight[(self.first + self.queued) % IN_FLIGHT] = (now_ns + self.delay_ns, speed);
                self.queued += 1;
            }
            MotorInput::Duty(_) | MotorInput::Current(_) => {
                self.queued = 0;
                self.target_counts_s = 0.0;
                self.reference_counts_s = 0.0;
                if let MotorInput::Duty(duty) = input {
                    self.duty = duty.clamp(-1.0, 1.0);
                }
            }
        }
        self.input = input;
    }

    /// Starts the loop from standstill: no integral, no reference.
    fn close_loop(&mut self) {
        self.queued = 0;
        self.target_counts_s = 0.0;
        self.reference_counts_s = 0.0;
        self.error_sum = 0.0;
        self.last_error = 0.0;
        self.duty = 0.0;
    }

    /// Advances to `now_ns`, `h` seconds after the last call, with `smoothing` = 1 - exp(-h / lag); samples
    /// the loop when due.
    pub fn advance(&mut self, now_ns: u64, smoothing: f64, counts: i64) {
        while self.queued > 0 && self.in_flight[self.first].0 <= now_ns {
            self.target_counts_s = self.in_flight[self.first].1;
            self.first = (self.first + 1) % IN_FLIGHT;
            self.queued -= 1;
        }
        self.reference_counts_s += smoothing * (self.target_counts_s - self.reference_counts_s);
        if now_ns < self.next_sample_ns {
            return;
        }
        self.next_sample_ns += LOOP_PERIOD_NS;
        let elapsed_s = (now_ns - self.last_sample_ns) as f64 * 1e-9;
        self.measured_counts_s = (counts - self.last_counts) as f64 / elapsed_s;
        self.averaged_counts_s += SPEED_SMOOTHING * (self.measured_counts_s - self.averaged_counts_s);
        self.last_counts = counts;
        self.last_sample_ns = now_ns;
        if let MotorInput::Speed(_) = self.input {
            self.sample();
        }
    }

    fn sample(&mut self) {
        let SpeedGains { p, i, d, full_speed_counts_s } = self.gains;
        let error = self.reference_counts_s - self.measured_counts_s;
        let sum = self.error_sum + error;
        let wanted =
            (self.reference_counts_s + p * error + i * sum + d * (error - self.last_error)) / full_speed_counts_s;
        // Anti-windup: do not integrate while the duty is saturated and the error has the same direction.
        if wanted.abs() <= 1.0 || wanted * error < 0.0 {
            self.error_sum = sum;
        }
        self.last_error = error;
        self.duty = wanted.clamp(-1.0, 1.0);
    }

    /// 1 - exp(-h / lag): the relative change of the reference in `h` seconds.
    pub fn smoothing(&self, h: f64) -> f64 {
        if self.lag_s > 0.0 { 1.0 - libm::exp(-h / self.lag_s) } else { 1.0 }
    }

    /// Changes the gains of the loop.
    pub fn set_gains(&mut self, gains: SpeedGains) {
        self.gains = gains;
    }

    /// Gains of the loop.
    pub fn gains(&self) -> SpeedGains {
        self.gains
    }

    /// Share of the supply voltage on the motor, -1 to 1; positive pays out.
    pub fn duty(&self) -> f64 {
        self.duty
    }

    /// Current that was commanded, A; positive pays out; `None` in the other kinds of command.
    pub fn commanded_a(&self) -> Option<f64> {
        if let MotorInput::Current(current_a) = self.input { Some(current_a) } else { None }
    }

    /// Sets the share of the supply voltage that the current loop needs.
    pub fn needs_duty(&mut self, duty: f64) {
        self.duty = duty.clamp(-1.0, 1.0);
    }

    /// True if the motor's leads are shorted.
    pub fn released(&self) -> bool {
        self.input == MotorInput::RELEASED
    }

    /// Speed over the last sample of the loop, counts per second.
    pub fn measured_counts_s(&self) -> f64 {
        self.measured_counts_s
    }

    /// Speed averaged over about 30 ms, counts per second.
    pub fn averaged_counts_s(&self) -> f64 {
        self.averaged_counts_s
    }

    /// Current reference of the speed loop, after delay and lag, counts per second.
    pub fn reference_counts_s(&self) -> f64 {
        self.reference_counts_s
    }
}
