//! Blobs in run files: all of them, or those around a stop.

#![allow(clippy::unwrap_used, clippy::expect_used)]

mod rig;

use std::collections::BTreeMap;
use std::fs;

use bus::clock::{Pacer, now_ns};
use bus::{Bus, Domain};
use config::RecorderSection;
use messages::blob::{BlobType, compressed_image};
use messages::{Header, OperatorRequest, RequestBody};
use recorder::{Recorder, Row, Settings};
use runlog::RunReader;
use rustix::process::Signal;
use tempfile::TempDir;

use rig::{Recording, until};

/// The picture with a number.
fn picture(number: u64) -> Vec<u8> {
    let file: Vec<u8> = (0..1000 + 37 * number).map(|at| (at * number) as u8).collect();
    let mut body = Vec::new();
    compressed_image(&mut body, number, "node", "jpeg", &file);
    body
}

/// Records pictures 10 ms apart, with a stop after a third of them; returns the numbers of those in the file.
fn recorded(more: &str, count: u64) -> Vec<u64> {
    let (domain, folder) = (Domain::for_test(), TempDir::new().unwrap());
    let bus = Bus::join(&domain, "camera").unwrap();
    let configs = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs");
    let text = fs::read_to_string(configs.join("systems/demo3.toml")).unwrap();
    let text = text.replace("\"../", &format!("\"{}/", configs.display()));
    let (system, run) = (folder.path().join("system.toml"), folder.path().join("run"));
    fs::write(&system, format!("{text}\n{more}")).unwrap();
    fs::create_dir(&run).unwrap();
    let mut recording = Recording::start_with(&domain, &run, &bus, &["--system", system.to_str().unwrap()]);
    let mut requests = bus.publisher::<OperatorRequest>("operator/request").unwrap();
    let mut out = bus.blob_publisher("blob/camera", BlobType::CompressedImage, 20_000, 100.0).unwrap();
    until("the recorder subscribes", || bus.ports("blob/camera").unwrap().1 > 0);
    let mut pacer = Pacer::new(10_000_000);
    for number in 1..=count {
        pacer.next();
        out.send(Header::at(now_ns()), &picture(number)).unwrap();
        if number == count / 3 {
            let mut stop = OperatorRequest::default();
            stop.body.verb = RequestBody::VERB_STOP;
            requests.send(&mut stop).unwrap();
        }
    }
    assert_eq!(recording.signal(Signal::TERM), Some(0));
    let (mut reader, mut numbers) = (RunReader::open(&run).unwrap(), Vec::new());
    while let Some(sample) = reader.next_sample().unwrap() {
        if sample.channel.name == "blob/camera" {
            let number = u64::from(u32::from_le_bytes(sample.sample[4..8].try_into().unwrap()));
            assert_eq!(sample.sample, picture(number), "picture {number}");
            assert_eq!(sample.channel.schema_name, "sensor_msgs/msg/CompressedImage");
            assert_eq!(u64::from(sample.sequence), number, "the number of the publisher");
            numbers.push(number);
        }
    }
    assert!(reader.damage().is_empty());
    let report = runlog::info(&run).unwrap();
    let lost: u64 = report.channels.iter().map(|channel| channel.lost).sum();
    assert_eq!(lost, 0, "{report:?}");
    numbers
}

#[test]
fn every_blob_is_in_the_file_as_it_was_sent() {
    assert_eq!(recorded("", 300), (1..=300).collect::<Vec<_>>());
}

#[test]
fn only_blobs_around_a_stop_are_in_the_file_if_these_are_wanted() {
    let numbers = recorded("[recorder]\nblobs_around_s = [0.5, 0.3]\n", 300);
    let (first, last) = (numbers[0], *numbers.last().unwrap());
    assert_eq!(numbers, (first..=last).collect::<Vec<_>>(), "one piece, in order");
    // Pictures are 10 ms apart or more, when the machine stands still.
    assert!((50..=100).contains(&first) && (100..=131).contains(&last), "{first} to {last}");
}

/// Pictures that come faster than they are written must not keep the recorder from its other channels, its heartbeat
/// and its end.
#[test]
fn a_poll_ends_while_pictures_are_left_and_no_channel_waits_for_another() {
    const PICTURES: u64 = 9;
    let (domain, folder) = (Domain::for_test(), TempDir::new().unwrap());
    let [camera, bus] = ["camera", "recorder"].map(|name| Bus::join(&domain, name).unwrap());
    let settings = Settings::new(&RecorderSection::default(), folder.path().to_owned(), BTreeMap::new());
    let mut recorder = Recorder::open(&bus, settings, Vec::new()).unwrap();
    let mut cameras = ["blob/a", "blob/b"]
        .map(|name| camera.blob_publisher(name, BlobType::CompressedImage, 1_000_000, 4.0).unwrap());
    recorder.poll(&bus, true).unwrap();
    let mut body = Vec::new();
    compressed_image(&mut body, 1, "node", "jpeg", &vec![7; 900_000]);
    for _ in 0..PICTURES {
        cameras.iter_mut().for_each(|out| out.send(Header::at(now_ns()), &body).unwrap());
    }
    let recorded = |recorder: &Recorder| {
        let rows = recorder.session().rows().iter().filter(|row| row.spec().name.starts_with("blob/"));
        rows.map(Row::messages).collect::<Vec<_>>()
    };
    let mut polls = 0;
    while recorded(&recorder) != [PICTURES; 2] {
        recorder.poll(&bus, false).unwrap();
        polls += 1;
        let count = recorded(&recorder);
        if polls == 1 {
            assert!(count.len() == 2 && count.iter().all(|count| (1..PICTURES).contains(count)), "{count:?}");
            assert!(recorder.next_poll_ns() <= now_ns(), "the rest waits for nothing");
        }
        assert!(polls < 10, "{count:?}");
    }
    assert_eq!(recorder.lost(), 0);
}
