//! Energy-saving paths, flown by the whole control chain against the plant: as exactly as straight lines, and with less
//! loss by the plant's balance, with which the `energy` channel agrees.

use cable_robot::Vector3;
use messages::{MotorAuthority, PlanSegment, PlanStatus};
use nims_tests::lockstep::Lockstep;
use nims_tests::scenarios::Case;
use planner::Mission;
use segments::motion_of;

/// Start and end of the moves, m: in the upper region, where the cables carry much.
const FROM_M: [f64; 3] = [3.3, 1.6, 2.2];
const TO_M: [f64; 3] = [6.6, 1.9, 2.2];

/// A flown move.
struct Flown {
    kind: u8,
    /// Root mean square and maximum of truth against setpoint, m.
    off_m: [f64; 2],
    /// By truth, over the move: heat of all armatures and electrical work, J.
    loss_j: f64,
    electrical_j: f64,
    /// Heat by the current as the drives average it.
    averaged_loss_j: f64,
    /// Heat and work by the `energy` channel.
    metered_loss_j: f64,
    metered_j: f64,
    duration_s: f64,
}

fn fly(path: &str) -> Flown {
    let mut scenario = Case { robot: "lab3", mission: "demo", motor_s: [0.030, 0.040] }.scenario(true).unwrap();
    scenario.plant.start_m = FROM_M;
    let [x, y, z] = TO_M;
    let mission =
        Mission::parse(&format!("name = \"move\"\npath = \"{path}\"\n[[leg]]\nline = {{ to_m = [{x}, {y}, {z}] }}\n"))
            .unwrap();
    let mut lockstep = Lockstep::new(scenario).unwrap();
    lockstep.zero_and_arm().unwrap();
    lockstep.run(&mission).unwrap();
    let truth = |lockstep: &Lockstep| {
        let sum = |of: Vec<f64>| of.iter().sum::<f64>();
        let plant = lockstep.plant();
        [sum(plant.losses_j()), sum(plant.electrical_j()), sum(plant.averaged_losses_j())]
    };
    let mut kind = PlanSegment::KIND_NONE;
    let (mut squares, mut worst, mut count) = (0.0, 0.0f64, 0);
    let mut first = None;
    loop {
        let before = truth(&lockstep);
        let cycle = lockstep.cycle().unwrap();
        assert_eq!(cycle.authority.unsteered(), 0);
        if matches!(cycle.plan.state, PlanStatus::STATE_DONE | PlanStatus::STATE_ABORTED) {
            assert_eq!(cycle.plan.state, PlanStatus::STATE_DONE);
            let (before, metered, start) = first.unwrap();
            let after = truth(&lockstep);
            let metered: Vec<f64> = [cycle.energy.loss_j, cycle.energy.energy_j]
                .into_iter()
                .zip(metered)
                .map(|(now, then): ([f64; 8], f64)| now.iter().sum::<f64>() - then)
                .collect();
            let before: [f64; 3] = before;
            return Flown {
                kind,
                off_m: [(squares / f64::from(count)).sqrt(), worst],
                loss_j: after[0] - before[0],
                electrical_j: after[1] - before[1],
                averaged_loss_j: after[2] - before[2],
                metered_loss_j: metered[0],
                metered_j: metered[1],
                duration_s: cycle.authority.plan_time_s - start,
            };
        }
        let since_s = (cycle.state.header.stamp_ns - cycle.input.begin_ns) as f64 * 1e-9;
        let time_s = cycle.authority.plan_time_s + cycle.authority.plan_rate * since_s;
        let Some(setpoint) = motion_of(&cycle.motion).map(|motion| motion.setpoint(time_s)) else { continue };
        if cycle.authority.mode != MotorAuthority::MODE_FOLLOWING || setpoint.at_rest {
            continue;
        }
        kind = cycle.motion.current.kind;
        let metered = [cycle.energy.loss_j.iter().sum(), cycle.energy.energy_j.iter().sum()];
        first.get_or_insert((before, metered, cycle.authority.plan_time_s));
        let off = (Vector3::from(cycle.truth_m) - setpoint.position).norm();
        (squares, worst, count) = (squares + off * off, worst.max(off), count + 1);
    }
}

#[test]
fn parabolas_and_lateral_paths_are_flown_as_exactly_as_lines_and_lose_less() {
    let [line, parabola, lateral] = ["line", "parabola", "lateral"].map(fly);
    println!(
        "| path | truth - setpoint, mm rms / max | loss, J | share | time, s | metered loss, J | electrical, J | metered, J |"
    );
    for (name, flown) in [("line", &line), ("parabola", &parabola), ("lateral", &lateral)] {
        println!(
            "| {name} | {:.2} / {:.2} | {:.2} | {:.3} | {:.1} | {:.2} | {:.2} | {:.2} | {:.2} |",
            1e3 * flown.off_m[0],
            1e3 * flown.off_m[1],
            flown.loss_j,
            flown.loss_j / line.loss_j,
            flown.duration_s,
            flown.averaged_loss_j,
            flown.metered_loss_j,
            flown.electrical_j,
            flown.metered_j,
        );
    }
    for (name, flown) in [("line", &line), ("parabola", &parabola), ("lateral", &lateral)] {
        assert!(flown.off_m[0] <= 0.010 && flown.off_m[1] <= 0.020, "{name}: {:?}", flown.off_m);
        // motor-io sums the drives' averages a hundred times a second without loss.
        assert!((flown.metered_loss_j / flown.averaged_loss_j - 1.0).abs() < 0.02, "{name}");
        // Ripple adds heat that no drive reports: the same power on every path, because it comes from the encoder's
        // steps.
        let ripple_j = flown.loss_j - flown.averaged_loss_j;
        assert!((0.3..1.2).contains(&(ripple_j / flown.duration_s)), "{name}: {ripple_j} J");
        assert!((flown.metered_j / (flown.electrical_j - ripple_j) - 1.0).abs() < 0.03, "{name}");
        assert!(flown.electrical_j > 0.0 && flown.metered_j > 0.0, "a motor that works takes power");
    }
    assert_eq!(
        [line.kind, parabola.kind, lateral.kind],
        [PlanSegment::KIND_LINE, PlanSegment::KIND_PARABOLA, PlanSegment::KIND_LATERAL]
    );
    // By truth, which includes ripple; a slower path has more of it.
    assert!(parabola.loss_j < 0.8 * line.loss_j, "{} of {} J", parabola.loss_j, line.loss_j);
    assert!(lateral.loss_j < 0.95 * parabola.loss_j, "{} of {} J", lateral.loss_j, parabola.loss_j);
    assert!(lateral.averaged_loss_j < 0.85 * parabola.averaged_loss_j, "{} J", lateral.averaged_loss_j);
}
