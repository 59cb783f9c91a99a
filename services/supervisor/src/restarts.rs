//! Whether and when a process that died is started again.

/// Longest pause, ns.
const PAUSE_MAX_NS: u64 = 30_000_000_000;

/// What the system file says.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Policy {
    /// Start it again at all.
    pub again: bool,
    /// The first pause, ns; each following one is twice as long. A fault that comes back at once must not fill the machine.
    pub pause_ns: u64,
    /// How often in a row.
    pub limit: u32,
    /// A process that was ready for this long begins to count anew, ns: what killed it before is over.
    pub forgiven_ns: u64,
}

/// What is done about a death.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// It stays dead.
    Never,
    /// It is started again after this pause, ns.
    After(u64),
    /// It has died too often.
    GaveUp,
}

/// Deaths of one process.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Restarts {
    /// Since it was last well for long enough.
    in_a_row: u32,
    /// Since it was first started.
    pub total: u32,
}

impl Restarts {
    /// It died, after it had been ready for so long (0: it never was).
    pub fn died(&mut self, policy: &Policy, ready_ns: u64) -> Verdict {
        if ready_ns >= policy.forgiven_ns {
            self.in_a_row = 0;
        }
        if !policy.again {
            return Verdict::Never;
        }
        if self.in_a_row >= policy.limit {
            return Verdict::GaveUp;
        }
        let doubled = policy.pause_ns.saturating_mul(1 << self.in_a_row.min(20));
        self.in_a_row += 1;
        Verdict::After(doubled.min(PAUSE_MAX_NS))
    }

    /// It is started again.
    pub fn again(&mut self) {
        self.total += 1;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const POLICY: Policy = Policy { again: true, pause_ns: 500_000_000, limit: 3, forgiven_ns: 60_000_000_000 };

    #[test]
    fn the_pauses_double_and_end_at_the_cap() {
        let mut restarts = Restarts::default();
        let seen: Vec<Verdict> = (0..4).map(|_| restarts.died(&POLICY, 0)).collect();
        assert_eq!(
            seen,
            [
                Verdict::After(500_000_000),
                Verdict::After(1_000_000_000),
                Verdict::After(2_000_000_000),
                Verdict::GaveUp
            ]
        );
        let patient = Policy { limit: 1000, ..POLICY };
        let mut restarts = Restarts::default();
        for _ in 0..100 {
            assert!(matches!(restarts.died(&patient, 0), Verdict::After(pause) if pause <= PAUSE_MAX_NS));
        }
    }

    #[test]
    fn without_a_limit_it_is_started_again_for_ever() {
        let endless = Policy { limit: u32::MAX, ..POLICY };
        let mut restarts = Restarts::default();
        assert!((0..10_000).all(|_| matches!(restarts.died(&endless, 0), Verdict::After(_))));
    }

    #[test]
    fn a_minute_of_health_is_forgiveness() {
        let mut restarts = Restarts::default();
        for _ in 0..50 {
            assert_eq!(restarts.died(&POLICY, POLICY.forgiven_ns), Verdict::After(500_000_000));
        }
        for _ in 0..2 {
            assert!(matches!(restarts.died(&POLICY, POLICY.forgiven_ns - 1), Verdict::After(_)));
        }
        assert_eq!(restarts.died(&POLICY, 0), Verdict::GaveUp);
    }

    #[test]
    fn who_is_not_to_be_started_again_is_not() {
        assert_eq!(Restarts::default().died(&Policy { again: false, ..POLICY }, u64::MAX), Verdict::Never);
    }
}
