use super::role::{GONE_CYCLES, Phase};
use super::*;
use crate::settings::tests::small_robot;

const EPOCH: u32 = 5;

fn config() -> CoreConfig {
    small_robot(100.0).unwrap()
}

/// Two controllers and two estimators that answer well, with changes by the test.
struct Table {
    arbiter: Arbiter,
    input: MotorInput,
    sent: [f64; CABLES],
    moving: bool,
    starved: bool,
}

impl Table {
    fn new() -> Self {
        let mut input = MotorInput::default();
        for slot in 0..SLOTS {
            input.command_arrived[slot] = 1;
            input.estimate_valid[slot] = 1;
            input.estimate_incarnation[slot] = 50 + slot as u32;
            let command = &mut input.command[slot];
            command.epoch = EPOCH;
            command.incarnation = 70 + slot as u32;
            command.segment = 1;
            command.valid = [1, 1];
            command.velocity_m_s = [0.1 + 0.01 * slot as f64; 16];
        }
        input.header.cycle = 1;
        Self { arbiter: Arbiter::new(&config()), input, sent: [0.1; CABLES], moving: false, starved: false }
    }

    /// In flight, slot a in charge in both roles, slot b its standby.
    fn flying() -> Self {
        let mut table = Self::new();
        table.cycles(5);
        table.moving = true;
        table.cycles(150);
        assert_eq!(table.phases(), [Phase::Active, Phase::Qualified, Phase::Active, Phase::Qualified]);
        table
    }

    fn cycle(&mut self) -> Option<ChosenCommand> {
        self.input.header.cycle += 1;
        for slot in 0..SLOTS {
            self.input.estimate_cycle[slot] = self.input.header.cycle - 1;
        }
        self.cycle_as_it_is()
    }

    fn cycle_as_it_is(&mut self) -> Option<ChosenCommand> {
        let mut input = self.input;
        for command in &mut input.command {
            command.based_on_cycle = command.based_on_cycle.wrapping_add(input.header.cycle - 1);
        }
        let context = ArbiterInput {
            epoch: EPOCH,
            moving: self.moving,
            sent_m_s: self.sent,
            starved: [self.starved; ROLE_SLOTS],
        };
        let chosen = self.arbiter.choose(&input, &context, |segment| segment == 1);
        if let Some(chosen) = chosen {
            self.sent = chosen.velocity_m_s;
        }
        chosen
    }

    fn cycles(&mut self, count: u32) {
        for _ in 0..count {
            assert!(self.cycle().is_some());
        }
    }

    /// Slots that were used.
    fn used(&mut self) -> Option<(usize, usize)> {
        self.cycle().map(|chosen| (chosen.controller, chosen.estimator))
    }

    fn phases(&self) -> [Phase; 4] {
        std::array::from_fn(|seat| self.arbiter.slot(seat / 2, seat % 2).phase())
    }
}

#[test]
fn the_first_good_pair_is_used() {
    let mut table = Table::new();
    assert_eq!(table.cycle().unwrap().velocity_m_s[..4], [0.1, 0.1, 0.1, 0.0]);
    table.input.command[0].valid = [0, 1];
    assert_eq!(table.used(), Some((0, 1)));
    table.input.command[0].valid = [0, 0];
    assert_eq!(table.used(), Some((1, 0)));
    assert_eq!(table.arbiter.verdict(), [MotorAuthority::VERDICT_NO_ESTIMATE, MotorAuthority::VERDICT_ACCEPTED]);
}

#[test]
fn commands_that_are_old_not_finite_or_beyond_limits_are_rejected_with_the_verdict() {
    type Spoil = fn(&mut MotorCommand);
    let cases: [(u8, Spoil); 9] = [
        (MotorAuthority::VERDICT_STALE, |c| c.based_on_cycle = u64::MAX),
        (MotorAuthority::VERDICT_STALE, |c| c.based_on_cycle = 1),
        (MotorAuthority::VERDICT_EPOCH, |c| c.epoch = 4),
        (MotorAuthority::VERDICT_INCARNATION, |c| c.incarnation = 0),
        (MotorAuthority::VERDICT_NOT_FINITE, |c| c.velocity_m_s[2] = f64::NAN),
        (MotorAuthority::VERDICT_NOT_FINITE, |c| c.velocity_m_s = [f64::INFINITY; 16]),
        (MotorAuthority::VERDICT_OUT_OF_LIMITS, |c| c.velocity_m_s[0] = 3.3),
        (MotorAuthority::VERDICT_NO_ESTIMATE, |c| c.valid = [2, 3]),
        (MotorAuthority::VERDICT_SEGMENT, |c| c.segment = 2),
    ];
    for (verdict, spoil) in cases {
        for moving in [false, true] {
            let mut table = Table::flying();
            table.moving = moving;
            table.input.command_arrived[1] = 0;
            spoil(&mut table.input.command[0]);
            if [MotorAuthority::VERDICT_NOT_FINITE, MotorAuthority::VERDICT_OUT_OF_LIMITS].contains(&verdict) {
                table.input.command[0].valid = [1, 0];
            }
            let chosen = table.cycle();
            if verdict == MotorAuthority::VERDICT_SEGMENT && !moving {
                assert!(chosen.is_some(), "at rest there is no motion to follow");
            } else {
                assert_eq!(chosen, None, "verdict {verdict}");
                assert_eq!(table.arbiter.verdict(), [verdict, MotorAuthority::VERDICT_ABSENT]);
            }
        }
    }
}

#[test]
fn a_restarted_controller_is_rejected_while_the_robot_moves() {
    let mut table = Table::new();
    table.input.command_arrived[1] = 0;
    table.cycles(5);
    table.moving = true;
    table.input.command[0].incarnation = 78;
    for _ in 0..300 {
        assert_eq!(table.cycle(), None);
    }
    assert_eq!(table.arbiter.verdict()[0], MotorAuthority::VERDICT_INCARNATION);
    table.moving = false;
    assert!(table.cycle().is_some());
    table.moving = true;
    table.cycles(10);
}

#[test]
fn a_new_process_is_used_in_flight_only_after_it_has_qualified() {
    let mut table = Table::new();
    table.input.command_arrived[1] = 0;
    table.cycles(5);
    table.moving = true;
    table.input.command_arrived[1] = 1;
    for well in 0..config().cycles(1.0) {
        let mut dead = Table { arbiter: table.arbiter.clone(), ..table };
        dead.input.command_arrived[0] = 0;
        assert_eq!(dead.used(), None, "after {well} cycles");
        table.cycles(1);
    }
    table.cycles(5);
    table.input.command_arrived[0] = 0;
    assert_eq!(table.used(), Some((1, 0)));
}

#[test]
fn a_failover_loses_no_cycle_and_one_missed_cycle_causes_no_failover() {
    type Kill = fn(&mut MotorInput, bool);
    let kills: [(Kill, usize); 2] = [
        (|input, dead| input.command_arrived[0] = u8::from(!dead), CONTROLLERS),
        (
            |input, dead| {
                input.estimate_valid[0] = u8::from(!dead);
                input.command.iter_mut().for_each(|command| command.valid[0] = u8::from(!dead));
            },
            ESTIMATORS,
        ),
    ];
    for (kill, role) in kills {
        for cycles in 1..=2 * GONE_CYCLES {
            let mut table = Table::flying();
            kill(&mut table.input, true);
            let standby = if role == CONTROLLERS { (1, 0) } else { (0, 1) };
            for _ in 0..cycles {
                assert_eq!(table.used(), Some(standby));
            }
            kill(&mut table.input, false);
            let hiccup = cycles <= GONE_CYCLES;
            assert_eq!(table.used(), Some(if hiccup { (0, 0) } else { standby }), "role {role}, {cycles} cycles");
        }
    }
}

#[test]
fn at_500_hz_a_standby_bridges_a_hiccup_as_long_as_at_250_hz() {
    let quick = CoreConfig { period_s: 0.002, ..config() };
    for cycles in [2 * GONE_CYCLES, 2 * GONE_CYCLES + 1] {
        let mut table = Table { arbiter: Arbiter::new(&quick), ..Table::new() };
        table.cycles(5);
        table.moving = true;
        table.cycles(600);
        table.input.command_arrived[0] = 0;
        for _ in 0..cycles {
            assert_eq!(table.used(), Some((1, 0)));
        }
        table.input.command_arrived[0] = 1;
        let hiccup = cycles == 2 * GONE_CYCLES;
        assert_eq!(table.used(), Some((usize::from(!hiccup), 0)), "{cycles} cycles");
    }
}

#[test]
fn invalid_commands_of_the_slot_in_charge_cause_a_failover_at_once() {
    let mut table = Table::flying();
    table.input.command[0].velocity_m_s[1] = f64::NAN;
    table.input.command[0].valid = [1, 0];
    assert_eq!(table.used(), Some((1, 0)));
    assert_eq!(table.phases()[..2], [Phase::Attached, Phase::Active]);
    table.input.command[0].velocity_m_s[1] = 0.1;
    assert_eq!(table.used(), Some((1, 0)));
    assert_eq!(table.arbiter.slot(0, 0).cause(), MotorSlots::CAUSE_NOT_FINITE);
}

#[test]
fn a_swap_is_announced_takes_effect_in_that_cycle_and_fades() {
    for role in 0..ROLES {
        let mut table = Table::flying();
        if role == ESTIMATORS {
            table.input.command.iter_mut().for_each(|command| command.velocity_m_s[CABLES..].fill(0.13));
            table.cycles(30);
        }
        let commit = table.arbiter.announce(role, 1, table.input.header.cycle).unwrap();
        assert_eq!(table.arbiter.announce(role, 1, table.input.header.cycle), Err(Refusal::UnderWay));
        assert_eq!(table.arbiter.announce(1 - role, 1, table.input.header.cycle), Err(Refusal::UnderWay));
        let mut last = table.sent[0];
        let mut authority = MotorAuthority::default();
        while table.input.header.cycle + 1 < commit {
            assert_eq!(table.used(), Some((0, 0)));
            assert_eq!(table.arbiter.slot(role, 1).phase(), Phase::Switching);
        }
        let goal = if role == CONTROLLERS { 0.11 } else { 0.13 };
        let slow = (goal - last) / 25.0;
        for fade in 1..=25 {
            let chosen = table.cycle().unwrap();
            assert_eq!((chosen.controller, chosen.estimator), if role == CONTROLLERS { (1, 0) } else { (0, 1) });
            assert!((chosen.velocity_m_s[0] - last - slow).abs() < 1e-9, "{last} {chosen:?}");
            last = chosen.velocity_m_s[0];
            table.arbiter.describe(&mut authority);
            assert!((authority.fade[role] - f64::from(fade) / 25.0).abs() < 1e-9 || fade == 25);
            assert_eq!(authority.fade[1 - role], 1.0);
            assert_eq!(table.arbiter.slot(role, 0).phase(), Phase::Probation);
        }
        assert_eq!(last, goal);
        table.cycles(80);
        assert_eq!([0, 1].map(|slot| table.arbiter.slot(role, slot).phase()), [Phase::Qualified, Phase::Active]);
    }
}

#[test]
fn in_probation_the_first_missed_cycle_reinstates_the_old_process() {
    let mut table = Table::flying();
    let commit = table.arbiter.announce(CONTROLLERS, 1, table.input.header.cycle).unwrap();
    while table.input.header.cycle < commit + 5 {
        table.cycles(1);
    }
    table.input.command_arrived[1] = 0;
    assert_eq!(table.used(), Some((0, 0)));
    table.input.command_arrived[1] = 1;
    assert_eq!(table.used(), Some((0, 0)));
    assert_eq!(table.arbiter.slot(CONTROLLERS, 1).cause(), MotorSlots::CAUSE_PROBATION);
}

#[test]
fn in_probation_the_old_process_bridges_a_cycle_without_a_processor() {
    for role in [CONTROLLERS, ESTIMATORS] {
        let mut table = Table::flying();
        let commit = table.arbiter.announce(role, 1, table.input.header.cycle).unwrap();
        while table.input.header.cycle < commit + 5 {
            table.cycles(1);
        }
        let answers = |table: &mut Table, there: bool| match role {
            CONTROLLERS => table.input.command_arrived[1] = u8::from(there),
            _ => table.input.estimate_valid[1] = u8::from(there),
        };
        let [old, new] = if role == CONTROLLERS { [(0, 0), (1, 0)] } else { [(0, 0), (0, 1)] };
        table.starved = true;
        for _ in 0..GONE_CYCLES {
            answers(&mut table, false);
            assert_eq!(table.used(), Some(old));
        }
        answers(&mut table, true);
        assert_eq!(table.used(), Some(new));
        // Not for ever: by then it counts as gone, whatever the cause.
        answers(&mut table, false);
        for _ in 0..=GONE_CYCLES {
            assert_eq!(table.used(), Some(old));
        }
        answers(&mut table, true);
        assert_eq!(table.used(), Some(old));
        assert_eq!(table.arbiter.slot(role, 1).cause(), MotorSlots::CAUSE_PROBATION);
    }
}

#[test]
fn a_swap_waits_for_a_process_that_had_no_processor_in_the_announced_cycle() {
    for missed in [GONE_CYCLES, GONE_CYCLES + 1] {
        let mut table = Table::flying();
        let commit = table.arbiter.announce(CONTROLLERS, 1, table.input.header.cycle).unwrap();
        while table.input.header.cycle + 1 < commit {
            table.cycles(1);
        }
        (table.starved, table.input.command_arrived[1]) = (true, 0);
        table.cycles(missed);
        table.input.command_arrived[1] = 1;
        assert_eq!(table.used(), Some((usize::from(missed == GONE_CYCLES), 0)));
    }
}

#[test]
fn a_law_of_zeros_that_misses_some_cycles_does_not_qualify() {
    let mut table = Table::new();
    for command in &mut table.input.command {
        command.velocity_m_s = [0.11; 16];
    }
    table.input.command[1].velocity_m_s = [0.0; 16];
    table.cycles(5);
    table.moving = true;
    for cycle in 0..600 {
        table.input.command_arrived[1] = u8::from(cycle % 15 != 0);
        table.cycles(1);
        assert_ne!(table.phases()[1], Phase::Qualified, "cycle {cycle}");
    }
}

#[test]
fn a_swap_is_rejected_with_its_reason() {
    let mut table = Table::new();
    table.input.command_arrived[1] = 0;
    table.input.command[1].velocity_m_s = [0.5; 16];
    table.cycles(5);
    let ask = |table: &mut Table, slot| table.arbiter.announce(CONTROLLERS, slot, table.input.header.cycle);
    assert_eq!(ask(&mut table, 0), Err(Refusal::InCharge));
    assert_eq!(ask(&mut table, 1), Err(Refusal::NotQualified(Phase::Empty)));
    table.input.command_arrived[1] = 1;
    table.cycles(200);
    assert_eq!(ask(&mut table, 1), Err(Refusal::NotQualified(Phase::Shadow)));
    assert_eq!(table.arbiter.slot(CONTROLLERS, 1).cause(), MotorSlots::CAUSE_DEVIATION);
    // First its average deviation has to decay, then it has to answer well for the whole time.
    table.input.command[1].velocity_m_s = [0.1; 16];
    table.cycles(100);
    assert_eq!(ask(&mut table, 1), Err(Refusal::NotQualified(Phase::Shadow)));
    table.cycles(100);
    assert!(ask(&mut table, 1).is_ok());
}

#[test]
fn a_swap_to_a_process_that_is_absent_in_the_announced_cycle_is_cancelled() {
    let mut table = Table::flying();
    let commit = table.arbiter.announce(CONTROLLERS, 1, table.input.header.cycle).unwrap();
    while table.input.header.cycle + 1 < commit {
        table.cycles(1);
    }
    table.input.command_arrived[1] = 0;
    assert_eq!(table.used(), Some((0, 0)));
    table.input.command_arrived[1] = 1;
    table.cycles(50);
    assert_eq!(table.phases()[..2], [Phase::Active, Phase::Qualified]);
}

#[test]
fn a_slot_that_fails_repeatedly_is_quarantined_until_it_is_admitted() {
    let mut table = Table::flying();
    for fall in 1..=config().quarantine_falls {
        assert_eq!(table.phases()[1], Phase::Qualified, "before fall {fall}");
        table.input.command_arrived[1] = 0;
        table.cycles(10);
        table.input.command_arrived[1] = 1;
        table.input.command[1].incarnation += 1;
        table.cycles(150);
    }
    assert_eq!(table.phases()[1], Phase::Quarantined);
    table.cycles(5000);
    table.input.command_arrived[0] = 0;
    assert_eq!(table.used(), None, "one that is set aside is not used");
    table.input.command_arrived[0] = 1;
    assert_eq!(table.arbiter.announce(CONTROLLERS, 1, 1), Err(Refusal::NotQualified(Phase::Quarantined)));
    table.arbiter.admit(CONTROLLERS, 1).unwrap();
    table.cycles(150);
    assert_eq!(table.phases()[1], Phase::Qualified);
}

#[test]
fn answers_missing_from_both_slots_are_no_failure() {
    let mut table = Table::flying();
    // The drives are silent for a while, so there is no estimate and nothing to answer.
    table.input.estimate_valid = [0, 0];
    table.input.command.iter_mut().for_each(|command| command.valid = [0, 0]);
    for _ in 0..50 {
        assert_eq!(table.cycle(), None);
    }
    table.input.estimate_valid = [1, 1];
    table.input.command.iter_mut().for_each(|command| command.valid = [1, 1]);
    table.cycles(1);
    assert_eq!(table.phases(), [Phase::Active, Phase::Qualified, Phase::Active, Phase::Qualified]);
}

#[test]
fn samples_of_an_earlier_life_are_not_mixed_in() {
    let mut table = Table::flying();
    let commit = table.arbiter.announce(CONTROLLERS, 1, table.input.header.cycle).unwrap();
    while table.input.header.cycle < commit + 3 {
        table.cycles(1);
    }
    // The old one restarts in the middle of the fade, without a state.
    table.input.command[0].incarnation += 1;
    table.input.command[0].velocity_m_s = [-0.5; 16];
    let mut last = table.sent[0];
    for _ in 0..22 {
        let now = table.cycle().unwrap().velocity_m_s[0];
        assert!((now - last).abs() < 0.002, "{last} to {now}");
        last = now;
    }
    assert_eq!(last, 0.11);
}

#[test]
fn a_swap_is_accepted_while_a_failover_still_fades() {
    let mut table = Table::flying();
    table.input.command[1].velocity_m_s[CABLES..].fill(0.13);
    table.input.command_arrived[0] = 0;
    assert_eq!(table.used(), Some((1, 0)));
    let commit = table.arbiter.announce(ESTIMATORS, 1, table.input.header.cycle).unwrap();
    assert!(commit < table.input.header.cycle + 24, "it takes effect in the middle of the fade");
    let mut last = table.sent[0];
    while table.input.header.cycle < commit + 30 {
        let now = table.cycle().unwrap().velocity_m_s[0];
        assert!((now - last).abs() < 0.002, "{last} to {now}");
        last = now;
    }
    assert_eq!((last, table.used()), (0.13, Some((1, 1))));
}
