//! The sensors on serial ports, on simulated devices of the virtual motor box: their values are the truth at their time
//! stamps, and noise, silence and a pulled plug end nothing.

use crate::robot::{Robot, THREE_CABLES, root, steadily};
use bus::{Subscriber, clock};
use messages::{MotorAuthority, Reading, TruthNode, text_of};
use motor_box::GroundFile;
use std::time::Duration;

/// Text after the section [motor_box] of the system file. Ports are numbered after those of the drives: 2, 3 and 4.
const DEVICES: &str = r#"
ground = "../ground/fig10.toml"

[[motor_box.device]]
name = "rangefinder"
kind = "tfmini"
rate_hz = 100.0
latency_s = 0.01
lever_m = [0.1, 0.0, -0.05]
noise = 0.001

[[motor_box.device]]
name = "wind"
kind = "line"
baud = 4800
rate_hz = 5.0
template = "$WIMWV,{1},R,{0},M,A"
[[motor_box.device.value]]
base = 2.0
slope_per_m = [0.1, 0.0, 1.0]
[[motor_box.device.value]]
base = 120.0

[[motor_box.device]]
name = "co2"
kind = "modbus"
baud = 9600
rate_hz = 20.0
[[motor_box.device.value]]
base = 400.0
peak = { at_m = [5.2, 3.4, 0.5], height = 100.0, radius_m = 0.5 }
[[motor_box.device.value]]
base = 21.5

[[process]]
name = "rangefinder"
command = ["sensor", "rangefinder.toml"]
[[process]]
name = "wind"
command = ["sensor", "../sensors/wind.toml"]
[[process]]
name = "co2"
command = ["sensor", "../sensors/co2.toml"]
"#;

/// The example, with the lever of the device.
fn rangefinder() -> String {
    let text = std::fs::read_to_string(root().join("configs/sensors/tfmini.toml")).unwrap();
    text.replace("# lever_m = [0.0, 0.0, 0.0]", "lever_m = [0.1, 0.0, -0.05]")
}

/// True position of the sensor within a few hundredths of a second of `at_ns`.
fn places(truths: &[TruthNode], at_ns: u64, lever_m: [f64; 3]) -> impl Iterator<Item = [f64; 3]> {
    let near = move |truth: &&TruthNode| truth.header.stamp_ns.abs_diff(at_ns) <= 30_000_000;
    truths.iter().filter(near).map(move |truth| std::array::from_fn(|axis| truth.position_m[axis] + lever_m[axis]))
}

/// The share of good readings that agree with `truly` there, and their number.
fn share(readings: &[Reading], truths: &[TruthNode], within: f64, truly: impl Fn([f64; 3]) -> f64) -> (f64, usize) {
    let good: Vec<&Reading> = readings.iter().filter(|reading| reading.quality == Reading::QUALITY_GOOD).collect();
    let agrees = |reading: &&&Reading| {
        let mut near = places(truths, reading.header.oldest_input_ns, reading.lever_m);
        near.any(|place| (truly(place) - reading.value[0]).abs() <= within)
    };
    (good.iter().filter(agrees).count() as f64 / good.len().max(1) as f64, good.len())
}

fn wait_for(readings: &mut Subscriber<Reading>, what: &str, wanted: impl Fn(&Reading) -> bool) -> Reading {
    let give_up = clock::now_ns() + 20_000_000_000;
    loop {
        while let Some(reading) = readings.receive().unwrap() {
            if wanted(&reading) {
                return reading;
            }
        }
        assert!(clock::now_ns() < give_up, "timeout: {what}");
        std::thread::sleep(Duration::from_millis(5));
    }
}

#[test]
fn they_say_the_truth_and_survive_what_happens_to_ports() {
    steadily(|| {
        let mut robot = Robot::up_with(THREE_CABLES, DEVICES, |configs| {
            std::fs::write(configs.join("systems/rangefinder.toml"), rangefinder()).unwrap()
        });
        robot.arm();
        let open = |name: &str| robot.bus.subscriber::<Reading>(&format!("sensor/{name}")).unwrap();
        let (mut range, mut wind, mut co2) = (open("rangefinder"), open("wind"), open("co2"));
        wait_for(&mut range, "a distance", |reading| reading.quality == Reading::QUALITY_GOOD);
        wait_for(&mut wind, "a wind", |reading| reading.quality == Reading::QUALITY_GOOD);
        let first = wait_for(&mut co2, "a concentration", |reading| reading.quality == Reading::QUALITY_GOOD);
        assert_eq!((text_of(&first.quantity), text_of(&first.unit)), ("co2,temperature".into(), "ppm,degC".into()));
        assert_eq!(first.value[1], 21.5);

        // One move over the edge of a prism, up and through the peak.
        let mut nodes = robot.bus.subscriber::<TruthNode>("truth/node").unwrap();
        robot.fly();
        // A channel keeps a third of a second for this test; earlier samples have no truth to compare with.
        for readings in [&mut range, &mut wind, &mut co2] {
            readings.latest().unwrap();
        }
        let passed_by = (range.lost(), wind.lost(), co2.lost());
        let mut truths = Vec::new();
        let mut said: [Vec<Reading>; 3] = Default::default();
        let enough = robot.last.header.cycle + 600;
        while robot.last.mode == MotorAuthority::MODE_FOLLOWING && robot.last.header.cycle < enough {
            robot.poll();
            truths.extend(std::iter::from_fn(|| nodes.receive().unwrap()));
            for (said, readings) in said.iter_mut().zip([&mut range, &mut wind, &mut co2]) {
                said.extend(std::iter::from_fn(|| readings.receive().unwrap()));
            }
            std::thread::sleep(Duration::from_millis(10));
        }
        let ground =
            motor_box::settings::ground_of(&GroundFile::load(&root().join("configs/ground/fig10.toml")).unwrap());
        // It counts in centimetres; if this machine stood still, a stamp is late.
        let ranges = share(&said[0], &truths, 0.01, |place| ground.distance_m(place, 0.0));
        let winds = share(&said[1], &truths, 0.01, |[x, _, z]| 2.0 + 0.1 * x + z);
        // By its file the probe is read 0.5 s late, but it is not: the error shows the effect of a wrong latency.
        let peak = |place: [f64; 3]| {
            let square: f64 = place.iter().zip([5.2, 3.4, 0.5]).map(|(at, top)| (at - top) * (at - top)).sum();
            400.0 + 100.0 * (-square / 0.5).exp()
        };
        for reading in &mut said[2] {
            reading.header.oldest_input_ns += 500_000_000;
        }
        let peaks = share(&said[2], &truths, 2.0, peak);
        println!("share that agrees with the truth, of how many: {ranges:?} {winds:?} {peaks:?}");
        for (what, (share, count), least) in [("ranges", ranges, 150), ("winds", winds, 8), ("peaks", peaks, 8)] {
            assert!(share >= 0.9 && count >= least, "{what}: {share} of {count}");
        }
        assert_eq!((range.lost(), wind.lost(), co2.lost()), passed_by);

        // Noise on the wire is counted, and hardly ever accepted: the checksum of a frame is the only protection of
        // this device.
        let before = wait_for(&mut range, "a distance", |_| true).bad_frames;
        robot.fault("noise 2 0.02 for 1");
        wait_for(&mut range, "bad frames", |reading| reading.bad_frames > before);
        // Silence is marked, with the last value; so is a pulled plug, and the device is found again.
        let good = |reading: &Reading| reading.quality == Reading::QUALITY_GOOD;
        for (fault, repair, port) in [
            ("silence 3", "silence 3 off", &mut wind),
            ("unplug 2", "plug 2", &mut range),
            ("unplug 4", "plug 4", &mut co2),
        ] {
            robot.fault(fault);
            let stale = wait_for(port, "a stale mark", |reading| reading.quality == Reading::QUALITY_STALE);
            assert!(stale.header.oldest_input_ns < stale.header.stamp_ns && stale.value[0].is_finite());
            robot.fault(repair);
            let again = wait_for(port, "a good one", good);
            assert!(again.header.oldest_input_ns > stale.header.oldest_input_ns);
        }
        robot.poll();
        assert_eq!(robot.last.faults & messages::faults::HARD, 0, "{:#x}", robot.last.faults);
    });
}
