//! The position of a reading: the real estimator's estimates, a sensor with latency, and the truth of the plant.

use config::SensorLoggerSection;
use georeference::{Decoder, Logger, LoggerConfig, unused_readings_sentence};
use messages::{Header, Message, Reading, Sample};
use nims_tests::lockstep::Lockstep;
use nims_tests::scenarios::Case;
use planner::Mission;

const LATENCY_NS: u64 = 100_000_000;
/// Not a multiple of the control period.
const PERIOD_NS: u64 = 13_700_000;
const SPEED_M_S: f64 = 0.4;
const MISSION: &str = "name = \"there and back\"\nspeed_m_s = 0.4\n\
    [[leg]]\nline = { to_m = [6.4, 3.0, 0.6] }\n[[leg]]\nline = { to_m = [4.2, 4.6, 0.9] }\n[[leg]]\nline = { to_m = [4.8, 3.0, 0.3] }\n";

/// Position and velocity of the truth at an instant, and the estimate.
#[derive(Clone, Copy)]
struct Moment {
    stamp_ns: u64,
    position_m: [f64; 3],
    velocity_m_s: [f64; 3],
    estimate_m: [f64; 3],
    valid: bool,
}

/// Cubic interpolation between two moments: reproduces the plant to the micrometre.
fn between(a: &Moment, b: &Moment, time_ns: u64) -> [f64; 3] {
    let length_s = (b.stamp_ns - a.stamp_ns) as f64 * 1e-9;
    let s = (time_ns - a.stamp_ns) as f64 * 1e-9 / length_s;
    let (s2, s3) = (s * s, s * s * s);
    std::array::from_fn(|k| {
        (2.0 * s3 - 3.0 * s2 + 1.0) * a.position_m[k]
            + (s3 - 2.0 * s2 + s) * length_s * a.velocity_m_s[k]
            + (3.0 * s2 - 2.0 * s3) * b.position_m[k]
            + (s3 - s2) * length_s * b.velocity_m_s[k]
    })
}

struct Flown {
    /// Samples of the sensor whose latency is configured, and of the same one without.
    samples: [Vec<Sample>; 2],
    moments: Vec<Moment>,
    readings: u64,
}

/// Flies, and reads a sensor that reports its true position, a tenth of a second late.
fn fly() -> Flown {
    let case = Case { robot: "lab3", mission: "polyline", motor_s: [0.030, 0.040] };
    let mut scenario = case.scenario(true).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("mission.toml");
    std::fs::write(&path, MISSION).unwrap();
    let mission = Mission::read(&path).unwrap();
    scenario.mission = mission.clone();
    let config = LoggerConfig::from_section(&SensorLoggerSection::default(), &scenario.robot);
    let mut logger = Logger::new(&config).unwrap();
    for (name, latency_s) in [("known", None), ("unknown", Some(0.0))] {
        let mut sensor = config.sensor(name).unwrap();
        sensor.section.latency_s = latency_s;
        let decoder = Decoder::new(&sensor, Reading::type_name(), Reading::schema(), size_of::<Reading>()).unwrap();
        logger.sensor(name, &sensor, decoder);
    }
    let mut lockstep = Lockstep::new(scenario).unwrap();
    lockstep.zero_and_arm().unwrap();
    lockstep.run(&mission).unwrap();
    let mut flown = Flown { samples: Default::default(), moments: Vec::new(), readings: 0 };
    let mut next_ns = 0;
    let mut underway: Vec<Reading> = Vec::new();
    for _ in 0..2600 {
        let now = lockstep.cycle().unwrap();
        let stamp_ns = now.estimate.header.stamp_ns;
        let moment = Moment {
            stamp_ns,
            position_m: now.truth_m,
            velocity_m_s: now.truth_m_s,
            estimate_m: now.estimate.position_m,
            valid: now.estimate.valid == 1,
        };
        if let Some(last) = flown.moments.last().copied().filter(|last| last.valid && last.stamp_ns < stamp_ns) {
            next_ns = next_ns.max(last.stamp_ns);
            while next_ns < stamp_ns {
                let [x, y, z] = between(&last, &moment, next_ns);
                let mut header = Header::at(next_ns + LATENCY_NS);
                header.oldest_input_ns = next_ns;
                flown.readings += 1;
                header.seq = flown.readings;
                underway.push(Reading {
                    header,
                    value: [x, y, z, 0.0, 0.0, 0.0, 0.0, 0.0],
                    count: 3,
                    ..Reading::default()
                });
                next_ns += PERIOD_NS;
            }
        }
        flown.moments.push(moment);
        logger.authority(&now.authority);
        logger.estimate(0, &now.estimate);
        while underway.first().is_some_and(|reading| reading.header.stamp_ns <= stamp_ns) {
            let reading = underway.remove(0);
            for sensor in 0..2 {
                logger.reading(sensor, bytemuck::bytes_of(&reading), stamp_ns);
            }
        }
        while let Some((sensor, sample)) = logger.next_sample(stamp_ns) {
            flown.samples[sensor].push(sample);
        }
    }
    flown
}

fn rms(errors: &[f64]) -> f64 {
    (errors.iter().map(|error| error * error).sum::<f64>() / errors.len() as f64).sqrt()
}

fn distance(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum::<f64>().sqrt()
}

#[test]
fn a_late_reading_has_the_place_of_its_own_instant() {
    let flown = fly();
    let [known, unknown] = &flown.samples;
    // all but those that are still under way have arrived
    assert!(known.len() as u64 + 9 > flown.readings, "{} of {}", known.len(), flown.readings);
    assert!(known.windows(2).all(|two| two[1].reading_seq == two[0].reading_seq + 1));
    let fast = |time_ns: u64| {
        let at = flown.moments.partition_point(|moment| moment.stamp_ns < time_ns).min(flown.moments.len() - 1);
        flown.moments[at].velocity_m_s.iter().map(|v| v * v).sum::<f64>().sqrt() > 0.95 * SPEED_M_S
    };
    let placed = |samples: &[Sample], late_ns: u64| -> Vec<f64> {
        let there = samples.iter().filter(|sample| fast(sample.header.stamp_ns - late_ns));
        there.map(|sample| distance(&sample.position_m, &sample.value[..3])).collect()
    };
    let moments = flown.moments.iter().filter(|moment| moment.valid && fast(moment.stamp_ns));
    let own: Vec<f64> = moments.map(|moment| distance(&moment.estimate_m, &moment.position_m)).collect();
    let (with, without) = (placed(known, 0), placed(unknown, LATENCY_NS));
    println!(
        "at {SPEED_M_S} m/s, {} samples: {:.2} mm RMS with the latency known, {:.2} mm without; the estimate itself {:.2} mm",
        with.len(),
        1e3 * rms(&with),
        1e3 * rms(&without),
        1e3 * rms(&own)
    );
    assert!(with.len() > 300);
    assert!(rms(&with) < rms(&own) + 0.002, "{} {}", rms(&with), rms(&own));
    assert!((0.03..0.05).contains(&rms(&without)), "{}", rms(&without));
    // the error along each axis compared with the standard deviation in the sample
    let ratios: Vec<f64> =
        known.iter().flat_map(|s| (0..3).map(|k| (s.position_m[k] - s.value[k]) / s.position_std_m[k])).collect();
    println!("errors are {:.2} of their standard deviations", rms(&ratios));
    assert!((0.02..2.0).contains(&rms(&ratios)));
}

#[test]
fn readings_without_samples_are_reported_once_with_their_cause() {
    let robot = Case { robot: "lab3", mission: "polyline", motor_s: [0.03, 0.04] }.scenario(true).unwrap().robot;
    let config = LoggerConfig::from_section(&SensorLoggerSection::default(), &robot);
    let mut logger = Logger::new(&config).unwrap();
    let sensor = config.sensor("soil").unwrap();
    let decoder = Decoder::new(&sensor, Reading::type_name(), Reading::schema(), size_of::<Reading>()).unwrap();
    let number = logger.sensor("soil", &sensor, decoder);
    let counts = |logger: &Logger| logger.counts().next().unwrap().1;
    let nothing = counts(&logger);
    let stale = Reading { quality: Reading::QUALITY_STALE, ..Reading::default() };
    logger.reading(number, bytemuck::bytes_of(&stale), 1);
    assert_eq!(unused_readings_sentence("soil", &counts(&logger), &nothing), None);
    for _ in 0..3 {
        logger.reading(number, &[0; 7], 2);
    }
    let now = counts(&logger);
    let sentence = unused_readings_sentence("soil", &now, &nothing).unwrap();
    // The channel, and the counts since the last one: 3 of 4, all of them for one cause.
    let numbers: Vec<u32> = sentence.split([' ', '(', ')', ',']).filter_map(|word| word.parse().ok()).collect();
    assert!(sentence.contains("sensor/soil") && numbers == [3, 4, 3], "{sentence}");
    assert_eq!(unused_readings_sentence("soil", &now, &now), None);
}
