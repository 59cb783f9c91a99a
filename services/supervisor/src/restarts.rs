//! Whether and when a process that died is restarted.

/// Longest pause, ns.
const PAUSE_MAX_NS: u64 = 30_000_000_000;

/// Restart policy of a process, from the system file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Policy {
    /// Whether it is restarted.
    pub again: bool,
    /// First pause before a restart, ns; each further pause is twice as long, so that a recurring fault does not load
    /// the machine.
    pub pause_ns: u64,
    /// Most restarts in a row.
    pub limit: u32,
    /// A process that was ready for this long has its count of restarts in a row reset, ns.
    pub forgiven_ns: u64,
}

/// Decision after a death.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// The policy allows no restart.
    Never,
    /// Restart after this pause, ns.
    After(u64),
    /// The limit of restarts in a row is reached.
    GaveUp,
}

/// Restart counts of one process.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Restarts {
    /// Restarts since it last ran for [`Policy::forgiven_ns`].
    in_a_row: u32,
    /// Restarts since its first start.
    pub total: u32,
}

impl Restarts {
    /// Decides after a death; `ready_ns` is how long it had been ready (0: never).
    pub fn decide(&mut self, policy: &Policy, ready_ns: u64) -> Verdict {
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

    /// Counts a restart.
    pub fn record_restart(&mut self) {
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
        let verdicts: Vec<Verdict> = (0..4).map(|_| restarts.decide(&POLICY, 0)).collect();
        assert_eq!(
            verdicts,
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
            assert!(matches!(restarts.decide(&patient, 0), Verdict::After(pause) if pause <= PAUSE_MAX_NS));
        }
    }

    #[test]
    fn without_a_limit_it_is_always_restarted() {
        let endless = Policy { limit: u32::MAX, ..POLICY };
        let mut restarts = Restarts::default();
        assert!((0..10_000).all(|_| matches!(restarts.decide(&endless, 0), Verdict::After(_))));
    }

    #[test]
    fn a_minute_in_state_ready_resets_the_count() {
        let mut restarts = Restarts::default();
        for _ in 0..50 {
            assert_eq!(restarts.decide(&POLICY, POLICY.forgiven_ns), Verdict::After(500_000_000));
        }
        for _ in 0..2 {
            assert!(matches!(restarts.decide(&POLICY, POLICY.forgiven_ns - 1), Verdict::After(_)));
        }
        assert_eq!(restarts.decide(&POLICY, 0), Verdict::GaveUp);
    }

    #[test]
    fn a_policy_without_restart_never_restarts() {
        assert_eq!(Restarts::default().decide(&Policy { again: false, ..POLICY }, u64::MAX), Verdict::Never);
    }
}
