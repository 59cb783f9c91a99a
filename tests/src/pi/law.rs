use cable_robot::CableVec;
use controller::{CableLaw, LawInput};

const P_PER_S: f64 = 1.5;
const I_PER_S2: f64 = 0.5;

#[derive(Default)]
pub struct MyLaw {
    sums_m_s: [Option<CableVec>; 2],
}

impl CableLaw for MyLaw {
    fn velocity(&mut self, asked: &LawInput<'_>) -> Option<CableVec> {
        let (speed, desired, lengths) =
            (asked.desired_velocities_m_s()?, asked.desired_lengths_m()?, asked.lengths_m());
        let old = self.sums_m_s[asked.slot].unwrap_or_else(|| CableVec::zeros(lengths.len()));
        let sums = CableVec::from_fn(lengths.len(), |i| old[i] + (desired[i] - lengths[i]) * asked.period_s);
        self.sums_m_s[asked.slot] = Some(sums);
        Some(CableVec::from_fn(lengths.len(), |i| speed[i] + P_PER_S * (desired[i] - lengths[i]) + I_PER_S2 * sums[i]))
    }
}
