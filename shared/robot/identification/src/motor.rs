//! Constants of a motor, its friction, and the load, from duty, current and velocity.

use crate::drive::{Fitted, MODEL};
use crate::linear::{Equations, Instrumented, Spread, part_of};
use crate::record::Record;
use crate::value::Value;

/// Duration of a window, s: long compared with an encoder step and the drives' own averaging, short compared with a
/// change of speed.
const WINDOW_S: f64 = 0.1;
/// Speed over which friction changes its sign, m/s: that of the robot file's default.
const TRANSITION_M_S: f64 = 0.02;
/// Least number of windows.
const LEAST_WINDOWS: usize = 200;

/// A motor and what it carries, seen from the cable; as `[motor]` of the robot file.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Motor {
    /// Armature resistance, ohm.
    pub resistance_ohm: Value,
    /// Tension per ampere, N/A.
    pub force_constant_n_a: Value,
    /// Inertia of rotor and gear as a mass at the cable, kg.
    pub inertia_kg: Value,
    /// The tension that truly acts, as a share of that of the robot's model: above 1, the node is heavier.
    pub load_share: Value,
    /// Friction in proportion to the tension.
    pub gear_friction: Value,
    /// Friction that does not depend on the tension, N.
    pub coulomb_n: Value,
    /// Friction that grows with speed, N s/m.
    pub viscous_n_s_m: Value,
    /// Friction of raising, at the mean tension and speed of the record, N: better known than its parts.
    pub friction_n: Value,
    /// Mean tension of the record by the robot's model, N.
    pub tension_n: f64,
}

/// A motor, and the frequency of the speed loop that follows from it.
pub(crate) struct Found {
    pub motor: Motor,
    pub loop_rad_s: Option<Spread>,
}

/// Means over a window.
struct Window {
    velocity_m_s: f64,
    reference_m_s: f64,
    acceleration_m_s2: f64,
    current_a: f64,
    voltage_v: f64,
    supply_v: f64,
    tension_n: f64,
}

fn windows(record: &Record, fitted: &Fitted) -> Vec<Window> {
    let long = ((WINDOW_S / record.period_s).round() as usize).max(2);
    let (length, read, reference) = (&record.length_m, &record.read_s, &fitted.simulated.reference_m_s);
    let mut out = Vec::new();
    let mut begin = 1;
    while begin + long < record.len() {
        let all = begin..begin + long;
        let mean = |of: &dyn Fn(usize) -> f64| all.clone().map(of).sum::<f64>() / long as f64;
        let slope = |values: &[f64], k: usize| (values[k + 1] - values[k - 1]) / (read[k + 1] - read[k - 1]);
        let window = Window {
            velocity_m_s: mean(&|k| slope(length, k)),
            reference_m_s: mean(&|k| reference[k]),
            // Of the reference, which has no encoder steps.
            acceleration_m_s2: mean(&|k| slope(reference, k)),
            current_a: mean(&|k| record.current_a[k]),
            voltage_v: mean(&|k| record.duty[k] * record.supply_v[k]),
            supply_v: mean(&|k| record.supply_v[k]),
            tension_n: mean(&|k| record.tension_n[k]),
        };
        let Window { velocity_m_s, reference_m_s, acceleration_m_s2, current_a, voltage_v, supply_v, tension_n } =
            window;
        let numbers = [velocity_m_s, reference_m_s, acceleration_m_s2, current_a, voltage_v, supply_v, tension_n];
        if record.is_flown[all].iter().all(|flown| *flown) && numbers.iter().all(|number| number.is_finite()) {
            out.push(window);
        }
        begin += long;
    }
    out
}

/// `duty = c + a reference + g (commanded - length)` within each block.
fn gain(record: &Record, fitted: &Fitted) -> Option<Equations> {
    let (simulated, blocks) = (&fitted.simulated, &fitted.blocks);
    let duty = blocks.centred(|k| record.duty[k]);
    let reference = blocks.centred(|k| simulated.reference_m_s[k]);
    let behind = blocks.centred(|k| simulated.commanded_m[k] - record.length_m[k]);
    let mut equations = Equations::new(2);
    for (k, value) in duty.iter().enumerate() {
        if !value.is_finite() {
            return None;
        }
        equations.add(part_of(k, duty.len()), &[reference[k], behind[k]], *value);
    }
    Some(equations)
}

/// `supply duty = resistance current + force constant velocity`. The speed loop answers each step of the encoder with a
/// ripple of the current that is as large as the current itself, and of which the drive reports an average where the
/// duty is that of an instant. What moves the current otherwise, load, friction and acceleration of the reference, has
/// no ripple and takes its place.
fn electrical(windows: &[Window]) -> Instrumented {
    let mut equations = Instrumented::new(5, 2);
    for (k, window) in windows.iter().enumerate() {
        let sign = libm::tanh(window.reference_m_s / TRANSITION_M_S);
        let Window { tension_n, reference_m_s, acceleration_m_s2, .. } = *window;
        let instruments = [acceleration_m_s2, tension_n, tension_n * sign, sign, reference_m_s];
        // The duty is positive where it pays out, the current where it reels in.
        let row = [-window.current_a, window.velocity_m_s];
        equations.add(part_of(k, windows.len()), &instruments, &row, window.voltage_v);
    }
    equations
}

/// Fits the motor; `None` where too little was recorded.
pub(crate) fn fit(record: &Record, fitted: &Fitted) -> Option<Found> {
    let windows = windows(record, fitted);
    if windows.len() < LEAST_WINDOWS {
        return None;
    }
    let electrical = electrical(&windows);
    let mut mechanical = Equations::new(5);
    for (k, window) in windows.iter().enumerate() {
        let reel_in_m_s = -window.velocity_m_s;
        let sign = libm::tanh(reel_in_m_s / TRANSITION_M_S);
        let row = [-window.acceleration_m_s2, window.tension_n, window.tension_n * sign, sign, reel_in_m_s];
        mechanical.add(part_of(k, windows.len()), &row, window.current_a);
    }
    // Per ampere, so that the force constant of the same parts multiplies it.
    let constant = |part| Some(electrical.solve(part)?[1]);
    let resistance = |part| Some(electrical.solve(part)?[0]);
    let term = |index: usize, part: Option<usize>| Some(mechanical.solve(part)?[index] * constant(part)?);
    let with_share = |share: f64, compute: &dyn Fn(Option<usize>) -> Option<f64>| {
        let spread = Spread::of(compute)?;
        let sigma = (spread.sigma().powi(2) + (share * spread.all).powi(2)).sqrt();
        Some(Value { value: spread.all, sigma })
    };
    let value = |compute: &dyn Fn(Option<usize>) -> Option<f64>| with_share(MODEL.motor_share, compute);
    let mean = |of: &dyn Fn(&Window) -> f64| windows.iter().map(of).sum::<f64>() / windows.len() as f64;
    let (tension_n, supply_v) = (mean(&|window| window.tension_n), mean(&|window| window.supply_v));
    let speed_m_s = mean(&|window| window.velocity_m_s.abs());
    let friction = |part: Option<usize>| {
        let terms = mechanical.solve(part)?;
        Some((terms[2] * tension_n + terms[3] + terms[4] * speed_m_s) * constant(part)?)
    };
    let motor = Motor {
        resistance_ohm: with_share(MODEL.resistance_share, &resistance)?,
        force_constant_n_a: value(&constant)?,
        inertia_kg: value(&|part| term(0, part))?,
        load_share: value(&|part| term(1, part))?,
        gear_friction: value(&|part| term(2, part))?,
        coulomb_n: value(&|part| term(3, part))?,
        viscous_n_s_m: value(&|part| term(4, part))?,
        friction_n: value(&friction)?,
        tension_n,
    };
    let gain = gain(record, fitted);
    let frequency = |part: Option<usize>| {
        let gain = gain.as_ref()?.solve(part)?[1];
        let square = constant(part)? * supply_v * gain / (resistance(part)? * term(0, part)?);
        (square > 0.0 && square.is_finite()).then(|| square.sqrt())
    };
    Some(Found { motor, loop_rad_s: Spread::of(frequency) })
}
