//! `[motor_io]`: drives and safety limits.

use crate::drive_family::DriveFamily;
use crate::number::number;
use crate::ports::{self, PortSection};
use crate::problem::Problem;
use crate::section::{above, between};

crate::section! {
    /// `[motor_io]`.
    pub struct MotorIoSection {
        /// Serial ports with their drive units.
        pub ports: Vec<PortSection> = Vec::new(),
        /// Encoder counts per metre of cable, one value per cable, with `[drum]` of the robot file those of the bare
        /// drum; negative if the count decreases while the cable pays out. A calibration with the robot's encoders,
        /// named in the robot file, replaces them when the file is loaded.
        pub counts_per_m: Vec<f64> = Vec::new(),
        /// Counts of a second encoder per metre of cable, one value per cable, with the signs of those encoders; on
        /// drums those of the bare drum. Empty: no second encoders. The two are compared, see `slip_m`; `[drum]` of the
        /// robot file says which of them are on drums.
        pub second_counts_per_m: Vec<f64> = Vec::new(),
        /// Cable by which the two encoders of a cable may disagree beyond what the model explains before it is a fault,
        /// m: the play of the gear, and what is not modelled.
        pub slip_m: f64 = 0.02 => between(0.001, 1.0, "m"),
        /// Share of its motion by which they may disagree, for the errors of drum and wheel: five standard deviations
        /// of a diameter that is known to 1 %.
        pub slip_share: f64 = 0.05 => between(0.0, 0.5, ""),
        /// Time without a packet after which the drives stop their motors, s; in steps of 0.1.
        pub watchdog_s: f64 = 0.3,
        /// Number of consecutive cycles without a command after which the robot stops and holds; until then the last
        /// command applies.
        pub ttl_cycles: u32 = 3 => between(1.0, 50.0, ""),
        /// Time in which pause, hold and resume ramp the plan clock between rest and full rate, s.
        pub ramp_s: f64 = 0.5 => between(0.05, 10.0, "s"),
        /// Cable velocity of jogging, m/s.
        pub jog_speed_m_s: f64 = 0.05 => between(0.001, 0.5, "m/s"),
        /// Estimated tension below which a cable is slack, N.
        pub slack_n: f64 = 0.5 => between(0.0, 100.0, "N"),
        /// Cycles after which a slack cable is a fault; above 250 Hz the time of as many at 250 Hz.
        pub slack_cycles: u32 = 30 => between(1.0, 10_000.0, ""),
        /// Drive output above which a cable that hardly moves is stalled or slipping.
        pub stall_duty: f64 = 0.6 => above(0.0, 1.0, ""),
        /// Cycles after which a stall or a runaway is a fault; above 250 Hz the time of as many at 250 Hz.
        pub stall_cycles: u32 = 20 => between(1.0, 10_000.0, ""),
        /// Lowest supply voltage, V: below it the robot warns, and the planner rejects what the motors cannot do at it
        /// less 5 %. 0 for neither.
        pub supply_min_v: f64 = 10.0 => between(0.0, 60.0, "V"),
        /// Fraction by which the node may exceed the robot's speed limit.
        pub node_speed_margin: f64 = 0.1 => between(0.0, 1.0, ""),
        /// Largest acceleration of the node, m/s²; default: four times the robot's acceleration limit.
        pub node_acceleration_limit_m_s2: Option<f64> = None => between(0.001, 100.0, "m/s²"),
        /// Largest velocity that a controller may add to that of the setpoint, m/s; default: half the robot's speed
        /// limit.
        pub correction_limit_m_s: Option<f64> = None => between(0.001, 10.0, "m/s"),
        /// Largest distance from the node to the start of a motion, m; motions that start farther away are rejected.
        pub start_bound_m: f64 = 0.05 => between(0.001, 10.0, "m"),
        /// Distance from the setpoint beyond which commands that lead away from it for `divergence_s` are a fault, m.
        pub divergence_m: f64 = 0.1 => between(0.001, 10.0, "m"),
        /// Time for which commands may lead away from the setpoint beyond `divergence_m`, s.
        pub divergence_s: f64 = 0.1 => between(0.01, 10.0, "s"),
    }
}

/// Checks the section for a robot with so many cables.
pub(crate) fn check(section: &MotorIoSection, cables: usize, rate_hz: f64) -> Result<(), Problem> {
    if section.counts_per_m.len() != cables {
        let values = section.counts_per_m.len();
        let clause = format!("has {values} values for {cables} cables; accepted: one value per cable");
        return Err(Problem::with_clause("motor_io.counts_per_m", clause));
    }
    for value in &section.counts_per_m {
        number("motor_io.counts_per_m", *value, "100 to 1e7 counts per metre, positive or negative", |v| {
            (100.0..=1e7).contains(&v.abs())
        })?;
    }
    second_encoders(section, cables)?;
    ports::check(&section.ports, cables)?;
    let period = 1.0 / rate_hz;
    for port in &section.ports {
        watchdog(section.watchdog_s, &port.protocol.family())?;
    }
    if section.watchdog_s < 3.0 * period {
        let clause = format!("is {}; accepted: at least three periods of {period} s", section.watchdog_s);
        return Err(Problem::with_clause("motor_io.watchdog_s", clause));
    }
    section.check_ranges("motor_io")
}

/// Checks that every cable has a second encoder, or none.
fn second_encoders(section: &MotorIoSection, cables: usize) -> Result<(), Problem> {
    const KEY: &str = "motor_io.second_counts_per_m";
    let values = section.second_counts_per_m.len();
    if !(values == 0 || values == cables) {
        let clause = format!("has {values} values for {cables} cables; accepted: one value per cable, or none");
        return Err(Problem::with_clause(KEY, clause));
    }
    for value in &section.second_counts_per_m {
        number(KEY, *value, "100 to 1e7 counts per metre, positive or negative", |v| (100.0..=1e7).contains(&v.abs()))?;
    }
    for unit in section.ports.iter().flat_map(|port| &port.units) {
        let given = unit.second_encoder.is_some();
        if given != (values > 0) {
            let (has, other) = if given { ("has", "no") } else { ("has no", "there are") };
            let clause = format!(
                "is for every unit or for none: unit {} {has} `second_encoder`, and {other} `second_counts_per_m`",
                unit.address
            );
            return Err(Problem::with_clause(KEY, clause));
        }
    }
    Ok(())
}

/// Checks that the drives of a port can be set to this watchdog time.
fn watchdog(seconds: f64, family: &DriveFamily) -> Result<(), Problem> {
    let ([shortest_s, longest_s], step_s) = (family.watchdog_s, family.watchdog_step_s);
    let accepted = format!("{shortest_s} to {longest_s} s in steps of {step_s}");
    number("motor_io.watchdog_s", seconds, &accepted, |v| {
        let steps = v / step_s;
        (shortest_s..=longest_s).contains(&v) && (steps.round() - steps).abs() < 1e-6
    })
}
