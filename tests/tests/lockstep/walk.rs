//! A random walk: operator commands, lives and deaths of processes, motions. After each cycle the node's speed and
//! acceleration are within the bound of the mode by truth, the node stays near the setpoint, every refusal names its
//! cure, and these cures always bring the robot back to a finished motion.
//!
//! `NIMS_WALKS=2000 cargo test -p nims-tests --test lockstep -- walk:: --nocapture` does more walks; `NIMS_SEED=17`
//! repeats one.

use messages::MotorAuthority;
use nims_tests::lockstep::core_config;
use nims_tests::scenarios::Case;
use nims_tests::walk::checks::{Bound, Bounds};
use nims_tests::walk::{Tally, Walk};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::time::Instant;

const STEPS: u64 = 200;

/// Factor by which the elasticity of the cables and the drives' loops increase the commanded acceleration, which
/// motor-io bounds: measured up to 2.3 times.
const SPRING: f64 = 2.5;
/// Acceleration of a node that sinks with its drives off and is caught by drives that hold at once, m/s².
const CAUGHT_M_S2: f64 = 10.0;
/// Amplitude with which the node swings on its cables after its drives have stopped at once, m.
const SWING_M: f64 = 0.02;
/// Speed of the node on its cables a second after the last command, m/s: one that was stopped at once, or caught while
/// it sank, swings for many seconds, measured up to 0.238 m/s.
const REST: (f64, f64) = (1.0, 0.25);
/// A law that overshoots excites the cables with every command, within motor-io's limits: measured up to 1.23 times the
/// bound of the speed, and 0.39 m/s at rest afterwards.
const SHAKEN: (f64, f64) = (1.4, 0.45);

/// Bounds of motor-io by its configuration: the table in ARCHITECTURE.md.
fn bounds(case: &Case) -> Bounds {
    let core = core_config(&case.scenario(true).unwrap()).unwrap();
    let [delay_s, lag_s] = case.motor_s;
    let speed_m_s = core.node_speed_m_s();
    let of = |acceleration_m_s2, travel_m| Bound { speed_m_s, acceleration_m_s2, travel_m };
    let mut of_mode = [of(CAUGHT_M_S2, f64::INFINITY); 7];
    for mode in [MotorAuthority::MODE_JOGGING, MotorAuthority::MODE_FOLLOWING, MotorAuthority::MODE_STOPPING] {
        of_mode[usize::from(mode)] = of(SPRING * core.node_acceleration_m_s2, f64::INFINITY);
    }
    // A command under way, the drive's delay and its lag, at the highest speed; then the node swings on its cables.
    let at_once_m = speed_m_s * (2.0 * core.period_s + delay_s + lag_s) + SWING_M;
    of_mode[usize::from(MotorAuthority::MODE_EMERGENCY_STOP)].travel_m = at_once_m;
    // A drive without commands from motor-io continues until its watchdog acts.
    of_mode[usize::from(MotorAuthority::MODE_FAULTED)].travel_m = at_once_m + speed_m_s * core.watchdog_s;
    // While motor-io waits, and until the drives have stopped; commands may differ from the setpoint's velocity by this
    // much.
    let led_away_m = core.correction_limit_m_s * (core.divergence_s + 2.0 * core.period_s + delay_s + lag_s) + SWING_M;
    let (from_setpoint_m, watchdog_s) = (core.divergence_m, core.watchdog_s);
    Bounds { of_mode, from_setpoint_m, led_away_m, watchdog_s, rest: REST, shaken: SHAKEN }
}

fn case(seed: u64) -> Case {
    let robot = if seed.is_multiple_of(2) { "lab3" } else { "lab4" };
    let motor_s = if seed % 4 < 2 { [0.030, 0.040] } else { [0.060, 0.100] };
    Case { robot, mission: "polyline", motor_s }
}

/// Does one walk; the error names what does not hold, with the last steps.
fn walk(seed: u64, steps: u64, tally: &mut Tally) -> Result<(), String> {
    let mut walk = Walk::new(&case(seed), seed, bounds(&case(seed))).unwrap();
    let outcome = catch_unwind(AssertUnwindSafe(|| walk.walk(steps)));
    tally.add(&walk.tally);
    let wrong = match outcome {
        Ok(Ok(())) => return Ok(()),
        Ok(Err(error)) => format!("{error:#}"),
        Err(_) => "a panic".to_owned(),
    };
    Err(format!("{}\nNIMS_SEED={seed}, step {}: {wrong}\n", walk.story(), walk.tally.steps))
}

#[test]
fn nothing_moves_the_wrong_way_and_every_refusal_names_its_cure() {
    let number = |name: &str| std::env::var(name).ok().map(|text| text.parse::<u64>().unwrap());
    let seeds = match number("NIMS_SEED") {
        Some(seed) => seed..=seed,
        None => 1..=number("NIMS_WALKS").unwrap_or(40),
    };
    let (mut tally, mut failed, mut walks, begun) = (Tally::default(), Vec::new(), 0, Instant::now());
    for seed in seeds {
        walks += 1;
        failed.extend(walk(seed, STEPS, &mut tally).err());
    }
    println!("{walks} walks, {} failed, {:.0} s: {tally:#?}", failed.len(), begun.elapsed().as_secs_f64());
    for story in failed.iter().take(3) {
        println!("{story}");
    }
    let told: Vec<&str> = failed.iter().filter_map(|story| story.lines().last()).collect();
    assert!(failed.is_empty(), "{} of {walks} walks failed:\n{}", failed.len(), told.join("\n"));
}
