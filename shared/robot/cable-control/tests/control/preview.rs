//! The preview law compared with a solution of the whole problem at once, and on simulated winches.
#![allow(clippy::needless_range_loop)]

use cable_control::drive_lag::{CommandHistory, CycleModel, DriveLag, Winch};
use cable_control::preview::{DriveObserver, LeadFilter, PreviewError, PreviewGain};
use cable_robot::CableVec;
use proptest::prelude::*;

const PERIOD_S: f64 = 0.01;

/// Gaussian elimination with partial pivoting.
fn solve(mut a: Vec<Vec<f64>>) -> Vec<f64> {
    let n = a.len();
    for c in 0..n {
        let pivot = (c..n).max_by(|x, y| a[*x][c].abs().total_cmp(&a[*y][c].abs())).unwrap();
        a.swap(c, pivot);
        for row in c + 1..n {
            let f = a[row][c] / a[c][c];
            for k in c..=n {
                a[row][k] -= f * a[c][k];
            }
        }
    }
    let mut x = vec![0.0; n];
    for c in (0..n).rev() {
        x[c] = (a[c][n] - (c + 1..n).map(|k| a[c][k] * x[k]).sum::<f64>()) / a[c][c];
    }
    x
}

/// The whole problem with all delayed commands as one least-squares system over `cycles` commands. Lengths come from
/// simulating the winch with unit commands; shares no code with the recursion or the prediction.
fn brute_force(
    lag: &DriveLag,
    penalty: f64,
    now: Winch,
    past: &[f64],
    reference: impl Fn(usize) -> f64,
    cycles: usize,
) -> f64 {
    let model = CycleModel::new(lag, PERIOD_S, 0.0).unwrap();
    let d = model.delay_cycles();
    // past[0] is the newest command; the first free command belongs to cycle 0.
    let simulate = |winch: Winch, past: &dyn Fn(usize) -> f64, free: &dyn Fn(usize) -> f64| {
        let command = |j: i64| if j >= 0 { free(j as usize) } else { past((-j - 1) as usize) };
        let mut at = winch;
        (0..cycles + d)
            .map(|j| {
                let j = j as i64;
                at = model.step(at, command(j - d as i64 - 1), command(j - d as i64));
                at.length_m
            })
            .collect::<Vec<f64>>()
    };
    let base = simulate(now, &|ago| past[ago], &|_| 0.0);
    let unit = simulate(Winch::default(), &|_| 0.0, &|j| if j == 0 { 1.0 } else { 0.0 });
    let r = penalty / (PERIOD_S * PERIOD_S);
    let mut a = vec![vec![0.0; cycles + 1]; cycles];
    for end in d..cycles + d {
        let missing = reference(end) - base[end];
        for i in 0..cycles.min(end + 1) {
            a[i][cycles] += unit[end - i] * missing;
            for k in 0..cycles.min(end + 1) {
                a[i][k] += unit[end - i] * unit[end - k];
            }
        }
    }
    for j in 0..cycles {
        a[j][j] += r;
        if j > 0 {
            a[j - 1][j - 1] += r;
            a[j][j - 1] -= r;
            a[j - 1][j] -= r;
        } else {
            a[0][cycles] += r * past[0];
        }
    }
    solve(a)[0]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]

    #[test]
    fn the_first_command_is_that_of_the_whole_problem(
        delay_s in 0.0..0.06f64, lag_s in 0.0..0.1f64, penalty_log in -6.0..-4.0f64, v in -0.3..0.3f64, l in 3.0..9.0f64,
        past in proptest::collection::vec(-0.3..0.3f64, 10), bend in proptest::collection::vec(-2.0..2.0f64, 30),
    ) {
        let lag = DriveLag::new(delay_s, lag_s).unwrap();
        let penalty = libm::pow(10.0, penalty_log);
        let horizon = bend.len();
        let gain = PreviewGain::new(&lag, PERIOD_S, horizon, penalty).unwrap();
        let d = gain.delay_cycles();
        // Arbitrary lengths over the preview, then a ramp.
        let mut wanted = vec![l + 0.004];
        let mut speed = 0.1;
        for a in &bend[1..] {
            wanted.push(wanted.last().unwrap() + speed * PERIOD_S);
            speed += a * PERIOD_S;
        }
        let last = wanted[horizon - 1] - wanted[horizon - 2];
        let reference = |end: usize| {
            let j = end - d;
            if j < horizon { wanted[j] } else { wanted[horizon - 1] + last * (j + 1 - horizon) as f64 }
        };
        let now = Winch { length_m: l, velocity_m_s: v };
        let expected = brute_force(&lag, penalty, now, &past, reference, 150);
        // The law: predict over the whole cycles of delay, then one product.
        let model = CycleModel::new(&lag, PERIOD_S, 0.0).unwrap();
        let mut there = now;
        for ago in (0..d).rev() {
            there = model.step(there, past[ago + 1], past[ago]);
        }
        let u = gain.command(there, past[0], wanted.iter().copied());
        prop_assert!((u - expected).abs() < 1e-6 * (1.0 + expected.abs()), "{u} {expected}");
    }

    #[test]
    fn a_modelled_winch_converges_to_the_reference(delay_s in 0.0..0.12f64, lag_s in 0.0..0.2f64, reading_s in 0.0..0.01f64) {
        let lag = DriveLag::new(delay_s, lag_s).unwrap();
        let (gain, mut observer) = (PreviewGain::new(&lag, PERIOD_S, 60, 1e-5).unwrap(), DriveObserver::new(&lag, PERIOD_S).unwrap());
        let worst = follow(&gain, &mut observer, &lag, reading_s, 0.003, 500);
        // Starts 3 mm off; the reference oscillates by ±0.2 m once in two seconds. The move penalty costs (3.1 / 18)⁴
        // of it, 0.2 mm, and three times that with the slowest winches.
        prop_assert!(worst < 7e-4, "{worst} m");
    }
}

/// Follows an oscillating reference with a winch of lag `truth`, starting `off_m` from it; largest error
/// over the last half, m.
fn follow(
    gain: &PreviewGain,
    observer: &mut DriveObserver,
    truth: &DriveLag,
    reading_s: f64,
    off_m: f64,
    cycles: u64,
) -> f64 {
    let reference = |t: f64| 6.0 + 0.2 * libm::sin(core::f64::consts::PI * t);
    let model = CycleModel::new(truth, PERIOD_S, 0.0).unwrap();
    let reading = CycleModel::new(truth, PERIOD_S, PERIOD_S - reading_s).unwrap();
    let mut sent = CommandHistory::new();
    // Two states of the same winch: at the beginnings of cycles and at the readings.
    let mut at_tick = Winch { length_m: 6.0 + off_m, velocity_m_s: 0.0 };
    let mut at_reading = at_tick;
    let (mut u, mut worst) = (0.0, 0.0f64);
    for k in 1..=cycles {
        sent.record(k, &CableVec::repeat(1, u));
        let command = |ago: usize| sent.delayed(ago)[0];
        at_reading = reading.step(at_reading, command(reading.delay_cycles() + 1), command(reading.delay_cycles()));
        at_tick = model.step(at_tick, command(model.delay_cycles() + 1), command(model.delay_cycles()));
        let measured = CableVec::repeat(1, (at_reading.length_m * 1e4).round() * 1e-4);
        observer.correct(k, reading_s, &measured, &CableVec::repeat(1, 0.0), &sent);
        let there = observer.at_next_command(&sent)[0];
        let first = (k + 1) as f64 + gain.delay_cycles() as f64;
        let ahead = (1..=gain.horizon()).map(|j| reference((first + j as f64) * PERIOD_S));
        u = gain.command(there, command(0), ahead);
        if 2 * k > cycles {
            worst = worst.max((at_tick.length_m - reference((k + 1) as f64 * PERIOD_S)).abs());
        }
    }
    worst
}

#[test]
fn the_observer_bridges_ten_cycles_and_above_250_hz_their_time() {
    for (rate_hz, bridged) in [(100.0, 10), (250.0, 10), (500.0, 20)] {
        for missed in [bridged, bridged + 1] {
            let (period_s, lag) = (1.0 / rate_hz, DriveLag::new(0.0, 0.04).unwrap());
            let (mut observer, mut sent) = (DriveObserver::new(&lag, period_s).unwrap(), CommandHistory::new());
            let speed = CableVec::repeat(1, 0.2);
            sent.record(1, &speed);
            observer.correct(1, 0.0, &[6.0], &[0.2], &sent);
            let now = 2 + missed;
            (2..=now).for_each(|cycle| sent.record(cycle, &speed));
            // A restart takes the velocity that it is given.
            observer.correct(now, 0.0, &[6.0 + 0.2 * period_s * (now - 1) as f64], &[0.0], &sent);
            let kept = observer.velocities_m_s(1)[0] > 0.15;
            assert_eq!(kept, missed == bridged, "{rate_hz} Hz, {missed} cycles");
        }
    }
}

#[test]
fn a_better_model_follows_better_and_a_third_of_error_is_tolerated() {
    let truth = DriveLag::new(0.06, 0.1).unwrap();
    let worst = |factor: f64| {
        let lag = truth.scaled(factor);
        let gain = PreviewGain::new(&lag, PERIOD_S, 60, 1e-5).unwrap();
        follow(&gain, &mut DriveObserver::new(&lag, PERIOD_S).unwrap(), &truth, 0.004, 0.0, 600)
    };
    let [exact, tenth, third] = [1.0, 1.1, 1.3].map(worst);
    assert!(exact < tenth && tenth < third && third < 0.03, "{exact} {tenth} {third}");
}

/// A trapezoid of speed, 0.3 m/s² up to 0.2 m/s and down again, from 6 m; at time t.
fn trapezoid(t: f64) -> f64 {
    let (ramp, a) = (2.0 / 3.0, 0.3);
    let up = |t: f64| 0.5 * a * t * t;
    let t = t.max(0.0);
    6.0 + match t {
        t if t < ramp => up(t),
        t if t < 2.0 => up(ramp) + 0.2 * (t - ramp),
        t if t < 2.0 + ramp => up(ramp) + 0.2 * (t - ramp) - up(t - 2.0),
        _ => 0.4,
    }
}

/// Largest error of a modelled winch, driven open loop by the lead alone, on a trapezoid, m.
fn lead_error(lag: &DriveLag) -> f64 {
    let (mut lead, model) = (LeadFilter::new(lag, PERIOD_S, 40).unwrap(), CycleModel::new(lag, PERIOD_S, 0.0).unwrap());
    let mut sent = CommandHistory::new();
    let (mut winch, mut worst) = (Winch { length_m: 6.0, velocity_m_s: 0.0 }, 0.0f64);
    for k in 0..500u64 {
        // The command of cycle k takes effect `whole` cycles later.
        let first = k + lead_cycles(lag);
        let ahead: Vec<CableVec> =
            (1..=40).map(|j| CableVec::repeat(1, trapezoid((first + j) as f64 * PERIOD_S - 1.0))).collect();
        let led = lead.step(k, &ahead);
        assert_eq!(lead.step(k, &ahead), led, "a second step in the same cycle changes nothing");
        sent.record(k, &led.command_m_s);
        winch = model.step(winch, sent.delayed(model.delay_cycles() + 1)[0], sent.delayed(model.delay_cycles())[0]);
        worst = worst.max((winch.length_m - trapezoid((k + 1) as f64 * PERIOD_S - 1.0)).abs());
    }
    worst
}

fn lead_cycles(lag: &DriveLag) -> u64 {
    CycleModel::new(lag, PERIOD_S, 0.0).unwrap().delay_cycles() as u64
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn the_lead_follows_the_reference_with_any_drives(delay_s in 0.0..0.12f64, lag_s in 0.0..0.2f64) {
        // A step to 0.3 m/s² has an error of about 0.3 / 56², 0.1 mm; without preview it would be 0.2 (delay + lag).
        let worst = lead_error(&DriveLag::new(delay_s, lag_s).unwrap());
        prop_assert!(worst < 1.5e-4, "{worst} m");
    }
}

#[test]
fn after_a_jump_or_a_gap_the_lead_restarts_on_the_desired_lengths() {
    let mut lead = LeadFilter::new(&DriveLag::new(0.03, 0.04).unwrap(), PERIOD_S, 40).unwrap();
    let still = |at: f64| vec![CableVec::repeat(2, at); 40];
    lead.step(1, &still(6.0));
    for (cycle, at) in [(2, 6.02), (9, 6.021), (10, f64::NAN), (11, 6.021)] {
        let led = lead.step(cycle, &still(at));
        if at.is_finite() {
            assert!(
                (led.winches[1].length_m - at).abs() < 1e-12 && led.command_m_s.max_abs() < 1e-9,
                "{cycle} {led:?}"
            );
        }
    }
    assert_eq!(lead.step(12, &[]).command_m_s.len(), 0);
}

#[test]
fn at_rest_on_the_reference_nothing_is_commanded() {
    let gain = PreviewGain::new(&DriveLag::new(0.034, 0.05).unwrap(), PERIOD_S, 40, 1e-5).unwrap();
    let winch = Winch { length_m: 7.123_456_7, velocity_m_s: 0.0 };
    assert_eq!(gain.command(winch, 0.0, std::iter::repeat_n(winch.length_m, 40)), 0.0);
    assert!((1.0..30.0).contains(&gain.rate()), "{}", gain.rate());
}

#[test]
fn bad_parameters_are_refused() {
    let lag = DriveLag::new(0.03, 0.04).unwrap();
    assert!(DriveLag::new(f64::NAN, 0.0).is_err() && DriveLag::new(0.0, -0.1).is_err());
    assert_eq!(PreviewGain::new(&lag, PERIOD_S, 1, 1e-5).unwrap_err(), PreviewError::Horizon(1));
    assert_eq!(PreviewGain::new(&lag, PERIOD_S, 40, 0.0).unwrap_err(), PreviewError::MovePenalty(0.0));
    // A period of 0, and a delay of too many cycles: 0.5 s with cycles of 0.0015 s.
    let range = |lag: &DriveLag, period_s| match PreviewGain::new(lag, period_s, 40, 1e-5).unwrap_err() {
        PreviewError::Range(error) => error.value,
        other => panic!("{other}"),
    };
    let long = DriveLag::new(0.5, 0.0).unwrap();
    assert_eq!((range(&lag, 0.0), range(&long, 0.0015)), (0.0, 333.0));
}
