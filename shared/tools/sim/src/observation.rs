//! What a program sees of a cycle, as a row of numbers.

use std::sync::{Arc, Mutex};

use cable_robot::CableVec;
use controller::{CableLaw, LawInput};
use lockstep::Cycle;

/// Names and counts of numbers.
pub(crate) type Fields = Vec<(&'static str, usize)>;

/// What the controller wished for in its last cycle.
#[derive(Debug, Clone, Copy, Default)]
struct Wish {
    setpoint_m_s2: [f64; 3],
    ahead_m: [f64; 3],
    ahead_m_s: [f64; 3],
    lengths_m: Option<CableVec>,
    velocities_m_s: Option<CableVec>,
}

/// The same, shared with the law that notes it.
#[derive(Debug, Clone, Default)]
pub(crate) struct Wishes(Arc<Mutex<Wish>>);

/// Stands in for the program: its answer is replaced by that of the program.
pub(crate) struct FollowedLaw(pub Wishes);

impl CableLaw for FollowedLaw {
    fn velocity(&mut self, input: &LawInput<'_>) -> Option<CableVec> {
        let wish = Wish {
            setpoint_m_s2: input.now.acceleration.into(),
            ahead_m: input.ahead.position.into(),
            ahead_m_s: input.ahead.velocity.into(),
            lengths_m: input.desired_lengths_m(),
            velocities_m_s: input.desired_velocities_m_s(),
        };
        if let Ok(mut last) = self.0.0.lock() {
            *last = wish;
        }
        wish.velocities_m_s
    }

    fn parameters(&self) -> String {
        "program = \"steps\"\n".to_owned()
    }
}

/// The numbers of an observation of a robot with so many cables.
pub(crate) fn fields(cables: usize) -> Fields {
    vec![
        ("cycle", 1),
        ("t_s", 1),
        ("mode", 1),
        ("plan_time_s", 1),
        ("position_m", 3),
        ("velocity_m_s", 3),
        ("lengths_m", cables),
        ("tensions_n", cables),
        ("setpoint_m", 3),
        ("setpoint_m_s", 3),
        ("setpoint_m_s2", 3),
        ("ahead_m", 3),
        ("ahead_m_s", 3),
        ("desired_lengths_m", cables),
        ("desired_velocities_m_s", cables),
        ("sent_m_s", cables),
        ("energy_j", 1),
        ("truth_m", 3),
        ("truth_m_s", 3),
        ("truth_tensions_n", cables),
    ]
}

/// Appends the observation of a cycle, in the order of [`fields`]. What the cables cannot hold is not a number.
pub(crate) fn observe(cycle: &Cycle, wishes: &Wishes, cables: usize, into: &mut Vec<f64>) {
    let wish = wishes.0.lock().map(|wish| *wish).unwrap_or_default();
    let (estimate, control, authority) = (&cycle.estimate, &cycle.control, &cycle.authority);
    let wished = |into: &mut Vec<f64>, values: &Option<CableVec>| match values {
        Some(values) => into.extend(values.iter()),
        None => into.extend(std::iter::repeat_n(f64::NAN, cables)),
    };
    let time_s = cycle.state.header.stamp_ns as f64 * 1e-9;
    into.extend([authority.header.cycle as f64, time_s, f64::from(authority.mode), authority.plan_time_s]);
    into.extend(estimate.position_m.iter().chain(&estimate.velocity_m_s));
    into.extend(&estimate.predicted_m[..cables]);
    into.extend(&estimate.tension_n[..cables]);
    into.extend(control.setpoint_m.iter().chain(&control.setpoint_velocity_m_s));
    into.extend(wish.setpoint_m_s2.iter().chain(&wish.ahead_m).chain(&wish.ahead_m_s));
    wished(into, &wish.lengths_m);
    wished(into, &wish.velocities_m_s);
    into.extend(&cycle.sent_m_s[..cables]);
    into.push(cycle.energy.energy_j.iter().sum());
    into.extend(cycle.truth_m.iter().chain(&cycle.truth_m_s));
    into.extend(cycle.truth_n.iter());
}
