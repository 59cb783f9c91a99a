//! The demonstration's report against a run that is made here, so that every error in it is known.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use cable_robot::profile::ProfileLimits;
use cable_robot::{Path, Profile, Segment, Vector3};
use messages::{ControlStatus, Message, MotorAuthority, NodeEstimate, PlanMotion, TruthNode};
use nims::counters::Periods;
use nims::demo::analysis::analyse;
use runlog::{ChannelSpec, RunClock, RunWriter};
use service::motion::segment_message;

const PERIOD_NS: u64 = 10_000_000;
/// Estimate and truth are this far beside the setpoint, m.
const ESTIMATE_OFF_M: f64 = 0.003;
const TRUTH_OFF_M: f64 = 0.004;

fn stamped<T: Message>(mut sample: T, cycle: u64, stamp_ns: u64) -> T {
    let header = sample.header_mut();
    (header.cycle, header.seq, header.stamp_ns) = (cycle, cycle, stamp_ns);
    sample
}

#[test]
fn errors_are_measured_over_moving_cycles_at_the_time_of_each_sample() {
    let folder = tempfile::tempdir().unwrap();
    let mut writer =
        RunWriter::create(&folder.path().join("run.mcap"), RunClock::now(), &Default::default(), &[]).unwrap();
    let channels = [
        writer.add_channel(&ChannelSpec::of::<PlanMotion>("plan/motion")).unwrap(),
        writer.add_channel(&ChannelSpec::of::<MotorAuthority>("motor/authority")).unwrap(),
        writer.add_channel(&ChannelSpec::of::<NodeEstimate>("node/estimate/a")).unwrap(),
        writer.add_channel(&ChannelSpec::of::<TruthNode>("truth/node")).unwrap(),
        writer.add_channel(&ChannelSpec::of::<ControlStatus>("control/status/a")).unwrap(),
    ];
    let path = Path::line(Vector3::new(4.0, 3.0, 0.5), Vector3::new(5.0, 3.0, 0.5));
    let profile = Profile::plan(&path, &ProfileLimits::rest_to_rest(0.2, 0.4)).unwrap();
    let segment = Segment { id: 7, path, profile, start_s: 1.0 };
    let motion = PlanMotion { current: segment_message(&segment), motion: 1, ..Default::default() };
    let mut write = |channel: usize, stamp_ns: u64, sample: &[u8]| {
        writer.write(channels[channel], 1, stamp_ns, stamp_ns, sample).unwrap();
    };
    write(0, 1, bytemuck::bytes_of(&stamped(motion, 1, 1)));

    // One second at rest before, and one after: what is wrong then does not count.
    let cycles = ((profile.duration() + 2.0) * 100.0) as u64;
    let mut moving = 0;
    for cycle in 1..=cycles {
        let stamp = cycle * PERIOD_NS;
        let plan_time_s = cycle as f64 * 0.01;
        let target = segment.setpoint(plan_time_s);
        let counts = !target.at_rest && target.velocity.norm() > 1e-3;
        moving += u64::from(counts);
        let authority = MotorAuthority {
            plan_time_s,
            plan_rate: 1.0,
            period_s: 0.01,
            mode: MotorAuthority::MODE_FOLLOWING,
            motion: 1,
            periods: 6,
            lost_answer: 1,
            lost_computer: 2,
            lost_resync: 3,
            ..Default::default()
        };
        write(1, stamp, bytemuck::bytes_of(&stamped(authority, cycle, stamp)));
        let off = if counts { ESTIMATE_OFF_M } else { 1.0 };
        let position = target.position + Vector3::new(0.0, off, 0.0);
        let estimate = NodeEstimate { position_m: position.into(), valid: 1, ..Default::default() };
        write(2, stamp, bytemuck::bytes_of(&stamped(estimate, cycle, stamp)));
        let chosen = ControlStatus { tension_n: [10.0; 8], valid: 1, cable_count: 3, ..Default::default() };
        write(4, stamp, bytemuck::bytes_of(&stamped(chosen, cycle, stamp)));
        // Truth comes in the middle between two cycles, when the setpoint is half a cycle further.
        let between = segment.setpoint(plan_time_s + 0.005).position + Vector3::new(0.0, 0.0, TRUTH_OFF_M);
        let mut truth = TruthNode { position_m: between.into(), cable_count: 3, ..Default::default() };
        truth.tension_n[..3].copy_from_slice(&[10.0, 11.9, if cycle % 2 == 0 { 8.1 } else { 7.9 }]);
        write(3, stamp + 5_000_000, bytemuck::bytes_of(&stamped(truth, 0, stamp + 5_000_000)));
    }
    writer.finish(&Default::default()).unwrap();

    let found = analyse(folder.path()).unwrap();
    assert_eq!(found.cycles, cycles);
    let wanted = Periods { computer: 2, resync: 3, answer: 1, ..Periods::default() };
    assert_eq!((found.periods, found.periods.unsteered(), found.periods.all()), (wanted, 6, 6));
    assert_eq!(found.estimate.samples as u64, moving);
    let close = |found: f64, wanted: f64| (found - wanted).abs() < 1e-6;
    assert!(close(found.estimate.rms_m, ESTIMATE_OFF_M) && close(found.estimate.max_m, ESTIMATE_OFF_M));
    let truth = found.truth.unwrap();
    assert_eq!(truth.samples as u64, moving);
    assert!(close(truth.rms_m, TRUTH_OFF_M) && close(truth.max_m, TRUTH_OFF_M), "{truth:?}");
    let tensions = found.tensions.unwrap();
    assert!((tensions.as_chosen - 0.5).abs() < 0.01, "every other sample is 2.1 N off");
    assert!(close(tensions.worst_n, 2.1) && tensions.least_n == 7.9 && tensions.greatest_n == 11.9);
}

#[test]
fn a_run_in_which_nothing_moved_is_said_to_be_one() {
    let folder = tempfile::tempdir().unwrap();
    let mut writer =
        RunWriter::create(&folder.path().join("run.mcap"), RunClock::now(), &Default::default(), &[]).unwrap();
    let channel = writer.add_channel(&ChannelSpec::of::<MotorAuthority>("motor/authority")).unwrap();
    let rest = stamped(MotorAuthority { period_s: 0.01, ..Default::default() }, 1, PERIOD_NS);
    writer.write(channel, 1, 1, 1, bytemuck::bytes_of(&rest)).unwrap();
    writer.finish(&Default::default()).unwrap();
    let sentence = analyse(folder.path()).unwrap_err().to_string();
    assert!(sentence.contains("nothing moved"), "{sentence}");
}
