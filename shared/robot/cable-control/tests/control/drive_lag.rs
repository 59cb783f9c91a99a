//! Delay and lag from records, and the misfit of wrong models.

use cable_control::drive_lag::{
    CommandHistory, CycleModel, DriveLag, IdentifyError, MAX_DELAY_S, MAX_RECORD, MisfitMeter, Record, Winch, identify,
};
use cable_robot::CableVec;
use proptest::prelude::*;

const PERIOD_S: f64 = 0.01;
/// 10,865 counts per metre.
const STEP_M: f64 = 1.0 / 10_865.0;

/// Forward Euler in 10 µs steps with a separate delay line: mean velocities between readings with encoder steps.
fn winch(lag: [f64; 2], reading_s: f64, commands: &[f64]) -> Vec<f64> {
    const H: f64 = 1e-5;
    let per_cycle = (PERIOD_S / H).round() as usize;
    let (late, reading) = ((lag[0] / H).round() as usize, (reading_s / H).round() as usize);
    let (mut v, mut l, mut seen) = (0.0, 0.0f64, 0.0);
    let mut velocities = Vec::new();
    for step in 0..commands.len() * per_cycle {
        let u = step.checked_sub(late).map_or(commands[0], |at| commands[at / per_cycle]);
        if step % per_cycle == reading {
            let counted = (l / STEP_M).floor() * STEP_M;
            velocities.push((counted - seen) / PERIOD_S);
            seen = counted;
        }
        v += H / lag[1] * (u - v);
        l += H * v;
    }
    velocities
}

fn trapezoid(top: f64, acceleration: f64, cruise: usize, k: usize) -> f64 {
    let ramp = (top / (acceleration * PERIOD_S)) as usize;
    let k = k.saturating_sub(10);
    let speed = |k: usize| (k as f64 * acceleration * PERIOD_S).min(top);
    if k < ramp + cruise { speed(k) } else { (top - speed(k - ramp - cruise)).max(0.0) }
}

fn columns(values: &[Vec<f64>]) -> Vec<CableVec> {
    (0..values[0].len()).map(|k| CableVec::from_fn(values.len(), |i| values[i][k])).collect()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn the_start_of_a_mission_identifies_delay_and_lag(
        delay_s in 0.005..0.15f64, lag_s in 0.01..0.25f64, readings in [0.0..0.009f64, 0.0..0.009], share in -1.0..1.0f64,
    ) {
        let first: Vec<f64> = (0..200).map(|k| trapezoid(0.2, 0.3, 80, k)).collect();
        let second: Vec<f64> = first.iter().map(|u| share * u).collect();
        let commands = columns(&[first.clone(), second.clone()]);
        let velocities = columns(&[winch([delay_s, lag_s], readings[0], &first), winch([delay_s, lag_s], readings[1], &second)]);
        let reading_s = CableVec::from_slice(&readings).unwrap();
        let found = identify(&Record { period_s: PERIOD_S, reading_s, commands_m_s: &commands, velocities_m_s: &velocities, ignored: 0 }).unwrap();
        let (delay, lag) = (found.lag.delay_s(), found.lag.lag_s());
        prop_assert!((delay + lag - delay_s - lag_s).abs() < 0.001, "{found:?} {delay_s} {lag_s}");
        prop_assert!((delay - delay_s).abs() < 0.006 && (lag - lag_s).abs() < 0.006, "{found:?} {delay_s} {lag_s}");
        prop_assert!(found.misfit < 0.05 && found.residual_m < STEP_M, "{found:?}");
    }

    #[test]
    fn a_record_during_motion_identifies_their_sum(delay_s in 0.01..0.08f64, lag_s in 0.02..0.12f64, from in 30usize..80) {
        let whole: Vec<f64> = (0..400).map(|k| trapezoid(0.2, 0.3, 60, k)).collect();
        let velocities = winch([delay_s, lag_s], 0.004, &whole);
        let (commands, velocities) = (columns(&[whole]), columns(&[velocities]));
        let (commands_m_s, velocities_m_s) = (&commands[from..from + 200], &velocities[from..from + 200]);
        let reading_s = CableVec::repeat(1, 0.004);
        let found = identify(&Record { period_s: PERIOD_S, reading_s, commands_m_s, velocities_m_s, ignored: 60 }).unwrap();
        prop_assert!((found.lag.total_s() - delay_s - lag_s).abs() < 0.003, "{found:?} {delay_s} {lag_s}");
        prop_assert!(found.misfit < 0.1, "{found:?}");
    }

    #[test]
    fn a_jog_of_one_cable_identifies_their_sum(delay_s in 0.01..0.08f64, lag_s in 0.02..0.12f64) {
        let jog: Vec<f64> = (0..150).map(|k| trapezoid(0.05, 0.5, 80, k)).collect();
        let still = vec![0.0; 150];
        let commands = columns(&[still.clone(), jog.clone()]);
        let velocities = columns(&[still, winch([delay_s, lag_s], 0.004, &jog)]);
        let found = identify(&Record { period_s: PERIOD_S, reading_s: CableVec::repeat(2, 0.004), commands_m_s: &commands, velocities_m_s: &velocities, ignored: 0 }).unwrap();
        prop_assert!((found.lag.total_s() - delay_s - lag_s).abs() < 0.05 * (delay_s + lag_s), "{found:?} {delay_s} {lag_s}");
        prop_assert!(found.misfit < 0.1, "{found:?}");
    }

    #[test]
    fn the_misfit_is_the_relative_error_of_the_model(factor in 0.3..2.5f64, delay_s in 0.02..0.08f64, lag_s in 0.03..0.1f64) {
        let commands: Vec<f64> = (0..400).map(|k| 0.2 * libm::sin(0.02 * k as f64)).collect();
        let velocities = winch([delay_s, lag_s], 0.004, &commands);
        let lag = DriveLag::new(delay_s, lag_s).unwrap().scaled(factor);
        let (mut meter, mut sent) = (MisfitMeter::new(), CommandHistory::new());
        for (k, (u, v)) in commands.iter().zip(&velocities).enumerate() {
            sent.record(k as u64 + 1, &CableVec::repeat(1, *u));
            meter.record(&lag, PERIOD_S, &[0.004], &[v * PERIOD_S], &sent);
        }
        let misfit = meter.misfit().unwrap();
        prop_assert!((misfit - (1.0 - factor).abs()).abs() < 0.05 + 0.2 * (1.0 - factor).abs(), "{misfit} {factor}");
    }
}

#[test]
fn a_winch_of_another_kind_has_a_misfit() {
    // A lightly damped oscillator of 2 Hz: it lags and then overshoots.
    let commands: Vec<f64> = (0..300).map(|k| trapezoid(0.2, 1.0, 120, k)).collect();
    let (mut v, mut a) = (0.0f64, 0.0f64);
    let velocities: Vec<f64> = commands
        .iter()
        .map(|u| {
            let mut mean = 0.0;
            for _ in 0..100 {
                a += 1e-4 * (158.0 * (u - v) - 1.2 * a);
                v += 1e-4 * a;
                mean += v / 100.0;
            }
            mean
        })
        .collect();
    let (commands, velocities) = (columns(&[commands]), columns(&[velocities]));
    let record = Record {
        period_s: PERIOD_S,
        reading_s: CableVec::repeat(1, 0.0),
        commands_m_s: &commands,
        velocities_m_s: &velocities,
        ignored: 0,
    };
    let found = identify(&record).unwrap();
    assert!(found.misfit > 0.35, "{found:?}");
}

/// The longest delay of a winch, and the second and a half that the controller records, have their places at 500 Hz.
#[test]
fn delays_and_records_are_as_long_at_500_hz() {
    let period_s = 0.002;
    let longest = CycleModel::new(&DriveLag::new(MAX_DELAY_S, 0.04).unwrap(), period_s, 0.5 * period_s).unwrap();
    assert_eq!(longest.delay_cycles(), 250);
    let cycles = 750;
    assert!(cycles <= MAX_RECORD);
    let truth = DriveLag::new(0.3, 0.05).unwrap();
    let model = CycleModel::new(&truth, period_s, period_s).unwrap();
    let (mut sent, mut winch) = (CommandHistory::new(), Winch::default());
    let (mut commands, mut velocities) = (Vec::new(), Vec::new());
    for cycle in 0..cycles {
        let command = CableVec::repeat(1, if (50..500).contains(&cycle) { 0.1 } else { 0.0 });
        sent.record(cycle as u64, &command);
        let next = model.step(winch, sent.delayed(model.delay_cycles() + 1)[0], sent.delayed(model.delay_cycles())[0]);
        velocities.push(CableVec::repeat(1, (next.length_m - winch.length_m) / period_s));
        commands.push(command);
        winch = next;
    }
    let reading_s = CableVec::repeat(1, 0.0);
    let record = Record { period_s, reading_s, commands_m_s: &commands, velocities_m_s: &velocities, ignored: 0 };
    let found = identify(&record).unwrap();
    assert!((found.lag.delay_s() - 0.3).abs() < 1e-3 && (found.lag.lag_s() - 0.05).abs() < 1e-3, "{found:?}");
}

#[test]
fn records_without_information_are_refused() {
    let record = |commands: &[CableVec], velocities: &[CableVec]| {
        let reading_s = CableVec::repeat(1, 0.004);
        identify(&Record {
            period_s: PERIOD_S,
            reading_s,
            commands_m_s: commands,
            velocities_m_s: velocities,
            ignored: 0,
        })
    };
    let flat = |value: f64, n: usize| vec![CableVec::repeat(1, value); n];
    let still = record(&flat(0.0, 100), &flat(0.0, 100)).unwrap_err();
    assert_eq!(still, IdentifyError::NotExcited { naive_m: 0.0 });
    assert!(matches!(record(&flat(0.1, 100), &flat(0.1, 100)), Err(IdentifyError::NotExcited { .. })));
    assert!(matches!(record(&flat(0.1, 10), &flat(0.1, 10)), Err(IdentifyError::WrongCount { cycles: 10, .. })));
    assert!(matches!(record(&flat(0.1, 100), &flat(0.1, 99)), Err(IdentifyError::WrongCount { .. })));
    assert!(matches!(record(&flat(f64::NAN, 100), &flat(0.1, 100)), Err(IdentifyError::NotFinite { cycle: 0 })));
    assert!(matches!(record(&flat(0.1, 100), &vec![CableVec::zeros(0); 100]), Err(IdentifyError::NotFinite { .. })));
}

#[test]
fn the_history_handles_gaps_and_restarts() {
    let mut sent = CommandHistory::new();
    assert_eq!(sent.delayed(3)[0], 0.0);
    for (cycle, u) in [(10, 0.1), (11, 0.2), (14, 0.3)] {
        sent.record(cycle, &CableVec::repeat(1, u));
    }
    let seen: Vec<f64> = (0..6).map(|ago| sent.delayed(ago)[0]).collect();
    assert_eq!(seen, [0.3, 0.2, 0.2, 0.2, 0.1, 0.1]);
    sent.record(2, &CableVec::repeat(1, 0.5));
    assert_eq!((sent.newest(), sent.delayed(0)[0], sent.delayed(5)[0]), (2, 0.5, 0.5));
    // Longer than any gap allowed, and once around the ring.
    for cycle in 1000..1400 {
        sent.record(cycle, &CableVec::repeat(1, cycle as f64));
    }
    assert_eq!((sent.delayed(0)[0], sent.delayed(100)[0]), (1399.0, 1299.0));
}

#[test]
fn the_model_is_the_winch() {
    // Compared with small Euler steps, over cycles that begin before their command.
    let lag = DriveLag::new(0.037, 0.05).unwrap();
    let model = CycleModel::new(&lag, PERIOD_S, 0.006).unwrap();
    let commands: Vec<f64> = (0..300).map(|k| trapezoid(0.2, 0.5, 100, k)).collect();
    let mut at = Winch::default();
    let mut euler = 0.0;
    for (k, v) in winch([0.037, 0.05], 0.004, &commands).iter().enumerate() {
        let command = |ago: usize| commands[k.saturating_sub(ago)];
        at = model.step(at, command(model.delay_cycles() + 1), command(model.delay_cycles()));
        euler += v * PERIOD_S;
        assert!((at.length_m - euler).abs() < 1.5 * STEP_M, "{k}: {} {euler}", at.length_m);
    }
}
