//! Samples of the slot that is not in charge change no bit of the answer to the slot in charge.

use cable_control::law::PFeedforward;
use cable_robot::profile::ProfileLimits;
use cable_robot::{Path, Profile, Robot, RobotParts, Segment, Vector3, elastic};
use config::{ControlLaw, ControllerSection};
use controller::{Controller, ControllerConfig, Inputs, Law};
use messages::{ESTIMATORS, Header, MotorAuthority, MotorCommand, MotorState, NodeEstimate, PlanMotion};
use proptest::prelude::*;
use segments::segment_message;

const PERIOD_NS: u64 = 10_000_000;
const LIFE: u64 = 7;
const CYCLES: u64 = 160;

fn robot() -> Robot {
    Robot::new(RobotParts {
        anchors_m: vec![[0.0, 0.0, 3.05], [9.9, 0.1, 3.10], [9.8, 8.9, 2.98], [0.1, 9.0, 3.02]],
        node_mass_kg: 1.2,
        tension_limits_n: [1.0, 60.0],
        speed_limit_m_s: 0.4,
        acceleration_limit_m_s2: 0.5,
        stiffness_n: Some(6000.0),
        routed_length_m: Some(vec![6.0; 4]),
        ..RobotParts::default()
    })
    .unwrap()
}

fn laws() -> [Law; 3] {
    let preview = ControllerSection {
        law: ControlLaw::Preview,
        drive_lag_s: Some([0.03, 0.04]),
        identify: false,
        misfit_limit: f64::INFINITY,
        ..ControllerSection::default()
    };
    [
        Law::lq_endpoint(0.0, 1.0).unwrap(),
        Law::PFeedforward(PFeedforward::new(2.5).unwrap()),
        Law::from_section(&preview).unwrap(),
    ]
}

fn controller(law: Law) -> Controller {
    let robot = robot();
    Controller::new(ControllerConfig {
        robot,
        law,
        horizon: 20,
        distribution: robot.default_distribution(),
        redundant_s: 0.3,
        cable_speed_limit_m_s: 0.8,
        error_limit_m: 0.25,
        ttl_cycles: 3,
        estimate_ttl_cycles: 3,
        thread: 0,
        incarnation: 9,
    })
}

fn segment() -> Segment {
    let path = Path::line(Vector3::new(4.8, 3.0, 0.6), Vector3::new(5.2, 3.3, 0.9));
    let profile = Profile::plan(&path, &ProfileLimits::rest_to_rest(0.2, 0.3)).unwrap();
    Segment { id: 5, path, profile, start_s: 0.2 }
}

/// The samples of one cycle.
struct CycleSamples {
    authority: MotorAuthority,
    state: MotorState,
    estimate: NodeEstimate,
}

/// The samples of a flight in which the node follows its path with a small error.
fn flight(lead: usize) -> Vec<CycleSamples> {
    let (robot, segment) = (robot(), segment());
    let mut before: Option<[f64; 8]> = None;
    (1..=CYCLES)
        .map(|cycle| {
            let (begun_ns, time_s) = (cycle * PERIOD_NS, cycle as f64 * 0.01);
            let at = segment.setpoint(time_s).position + Vector3::new(0.002, -0.001, 0.001) * (time_s * 9.0).sin();
            let held = elastic::realise(&robot, &at, &Vector3::zeros(), robot.default_distribution()).unwrap();
            let length_m = held.unstretched_m.to_array8();
            let velocity_m_s = std::array::from_fn(|i| (length_m[i] - before.unwrap_or(length_m)[i]) / 0.01);
            before = Some(length_m);
            let header = |stamp_ns| Header { life: LIFE, cycle, seq: cycle, ..Header::at(stamp_ns) };
            let authority = MotorAuthority {
                header: header(begun_ns + 3_000_000),
                bus_ns: 3_000_000,
                plan_time_s: time_s,
                plan_rate: 1.0,
                plan_rate_target: 1.0,
                period_s: 0.01,
                epoch: 4,
                motion: 1,
                mode: MotorAuthority::MODE_FOLLOWING,
                active_estimator: lead as u8,
                in_charge: [0, lead as u8],
                ..MotorAuthority::default()
            };
            let state = MotorState {
                header: header(begun_ns + 2_000_000),
                length_m,
                velocity_m_s,
                command_m_s: velocity_m_s,
                sampled_ns: [begun_ns + 2_000_000; 8],
                fresh: [1; 8],
                cable_count: 4,
                ..MotorState::default()
            };
            let estimate = NodeEstimate {
                header: header(begun_ns + 2_000_000),
                position_m: at.into(),
                predicted_m: length_m,
                // Some estimates are not valid.
                valid: u8::from(cycle % 37 != 0),
                cable_count: 4,
                incarnation: 3,
                ..NodeEstimate::default()
            };
            CycleSamples { authority, state, estimate }
        })
        .collect()
}

/// A forged sample of the other slot, with the moment of a cycle at which it arrives: before the authority, before the
/// estimate in charge, or after it.
#[derive(Debug, Clone)]
struct Forged {
    cycle: u64,
    moment: usize,
    life: u64,
    /// Cycle of its header; relative to the present cycle if `relative`.
    header_cycle: u64,
    relative: bool,
    stamp_ns: u64,
    value: f64,
    valid: u8,
    cables: u8,
}

fn forged() -> impl Strategy<Value = Forged> {
    let life = prop_oneof![6 => Just(LIFE), 1 => Just(0), 1 => Just(u64::MAX), 1 => any::<u64>()];
    let header_cycle = prop_oneof![
        8 => (0..6_u64).prop_map(|ahead| (ahead, true)),
        1 => Just((1 << 63, false)), 1 => Just((u64::MAX, false)), 1 => any::<u64>().prop_map(|cycle| (cycle, false))
    ];
    let stamp = prop_oneof![4 => 0..3 * PERIOD_NS, 1 => any::<u64>()];
    let value = prop_oneof![6 => 0.2..6.0, 1 => Just(f64::NAN), 1 => Just(f64::INFINITY), 1 => Just(-1e300)];
    let valid = prop_oneof![8 => Just(1_u8), 1 => any::<u8>()];
    let cables = prop_oneof![8 => Just(4_u8), 1 => any::<u8>()];
    ((1..=CYCLES, 0..3_usize), life, header_cycle, stamp, value, valid, cables).prop_map(
        |((cycle, moment), life, (header_cycle, relative), stamp_ns, value, valid, cables)| Forged {
            cycle,
            moment,
            life,
            header_cycle,
            relative,
            stamp_ns,
            value,
            valid,
            cables,
        },
    )
}

impl Forged {
    fn sample(&self, now: &CycleSamples) -> NodeEstimate {
        let header = now.estimate.header;
        // Relative cycles are from two cycles behind to three ahead.
        let cycle =
            if self.relative { (header.cycle + self.header_cycle).saturating_sub(2) } else { self.header_cycle };
        let stamp_ns = if self.relative { header.stamp_ns + self.stamp_ns } else { self.stamp_ns };
        NodeEstimate {
            header: Header { life: self.life, cycle, stamp_ns, ..header },
            position_m: if self.value < 0.5 { now.estimate.position_m } else { [self.value; 3] },
            predicted_m: [self.value; 8],
            valid: self.valid,
            cable_count: self.cables,
            ..now.estimate
        }
    }
}

/// The row of the estimate in charge that motor-io uses: that of the last answer to this cycle.
fn row(commands: &[MotorCommand], cycle: u64, lead: usize) -> Option<(u8, u32, u32, [u64; 8])> {
    let of_cycle = commands.iter().rfind(|command| command.based_on_cycle == cycle && command.header.life == LIFE)?;
    let bits = std::array::from_fn(|i| of_cycle.velocity_m_s[8 * lead + i].to_bits());
    Some((of_cycle.valid[lead], of_cycle.epoch, of_cycle.segment, bits))
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 48, failure_persistence: None, ..ProptestConfig::default() })]
    #[test]
    fn the_slot_in_charge_is_answered_the_same(
        lead in 0..2_usize,
        law in 0..3_usize,
        mut forgeries in prop::collection::vec(forged(), 1..120),
    ) {
        forgeries.sort_by_key(|forged| (forged.cycle, forged.moment));
        let law = laws()[law];
        let (mut alone, mut beside) = (controller(law), controller(law));
        let segment = segment();
        let mut motion = PlanMotion {
            current: segment_message(&segment),
            end_s: segment.end_s(),
            motion: 1,
            epoch: 4,
            beat: 1,
            ..PlanMotion::default()
        };
        motion.header.life = LIFE;
        let flight = flight(lead);
        // The newest estimates of the slots in each controller process.
        let (mut newest, mut own) = ([None::<NodeEstimate>; 2], None);
        let mut answered = 0;
        for (i, now) in flight.iter().enumerate() {
            let cycle = now.estimate.header.cycle;
            let earlier = &flight[i.saturating_sub(1)].authority;
            let mut commands = Vec::new();
            for (moment, authority) in [earlier, &now.authority, &now.authority].into_iter().enumerate() {
                if moment == 2 {
                    (newest[lead], own) = (Some(now.estimate), Some(now.estimate));
                    commands.push(step(&mut beside, newest, &motion, authority, &now.state));
                }
                for forged in forgeries.iter().filter(|forged| (forged.cycle, forged.moment) == (cycle, moment)) {
                    newest[1 - lead] = Some(forged.sample(now));
                    commands.push(step(&mut beside, newest, &motion, authority, &now.state));
                }
            }
            let mut only = [None; 2];
            only[lead] = own;
            let alone = [step(&mut alone, only, &motion, &now.authority, &now.state)];
            let expected = row(&alone, cycle, lead);
            prop_assert!(expected.is_some());
            prop_assert_eq!(row(&commands, cycle, lead), expected, "cycle {}", cycle);
            answered += u64::from(expected.is_some_and(|(valid, ..)| valid == 1));
        }
        prop_assert!(answered > CYCLES * 9 / 10, "{} answers", answered);
        prop_assert_eq!(flight[0].authority.in_charge[ESTIMATORS], lead as u8);
    }
}

fn step(
    controller: &mut Controller,
    estimates: [Option<NodeEstimate>; 2],
    motion: &PlanMotion,
    authority: &MotorAuthority,
    state: &MotorState,
) -> MotorCommand {
    let [a, b] = &estimates;
    let estimates = [a.as_ref(), b.as_ref()];
    controller.step(&Inputs { estimates, motion: Some(motion), authority: Some(authority), state: Some(state) }).0
}
