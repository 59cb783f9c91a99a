use cable_robot::CableVec;
use controller::{CableLaw, LawInput};

pub struct MyLaw {
    p_per_s: f64,
    i_per_s2: f64,
    sums_m_s: [Option<CableVec>; 2],
}

fn gain(name: &str, default: f64) -> f64 {
    std::env::var(name).map_or(default, |text| text.parse().unwrap_or_else(|_| panic!("{name}={text} is no number")))
}

impl Default for MyLaw {
    fn default() -> Self {
        Self { p_per_s: gain("P_PER_S", 1.5), i_per_s2: gain("I_PER_S2", 0.5), sums_m_s: [None; 2] }
    }
}

impl CableLaw for MyLaw {
    fn velocity(&mut self, asked: &LawInput<'_>) -> Option<CableVec> {
        let (speed, desired, lengths) =
            (asked.desired_velocities_m_s()?, asked.desired_lengths_m()?, asked.lengths_m());
        let errors = CableVec::from_fn(lengths.len(), |i| desired[i] - lengths[i]);
        let old = self.sums_m_s[asked.slot].unwrap_or_else(|| CableVec::zeros(lengths.len()));
        let sums = CableVec::from_fn(lengths.len(), |i| old[i] + errors[i] * asked.period_s);
        self.sums_m_s[asked.slot] = Some(sums);
        Some(CableVec::from_fn(lengths.len(), |i| speed[i] + self.p_per_s * errors[i] + self.i_per_s2 * sums[i]))
    }

    fn parameters(&self) -> String {
        format!("p_per_s = {:?}\ni_per_s2 = {:?}\n", self.p_per_s, self.i_per_s2)
    }
}
