//! Blobs: samples of different lengths arrive whole, with their header, and are counted like others.
#![allow(clippy::unwrap_used)]

use bus::clock::now_ns;
use bus::{Bus, BusError, ChannelWatch, Domain};
use messages::blob::{BlobType, compressed_image};
use messages::{Header, quality_of_blobs};

const MOST: usize = 100_000;

/// A picture of so many bytes that follow from a number.
fn picture(number: u64, bytes: usize) -> Vec<u8> {
    let file: Vec<u8> = (0..bytes).map(|at| (at as u64).wrapping_mul(number) as u8).collect();
    let mut body = Vec::new();
    compressed_image(&mut body, number, "camera", "jpeg", &file);
    body
}

#[test]
fn blobs_of_every_length_arrive_whole_with_their_header() {
    let domain = Domain::for_test();
    let (camera, recorder) = (Bus::join(&domain, "camera").unwrap(), Bus::join(&domain, "recorder").unwrap());
    let mut out = camera.blob_publisher("blob/camera", BlobType::CompressedImage, MOST, 30.0).unwrap();
    let found = ChannelWatch::new().new_channels(&recorder).unwrap();
    let [info] = &found[..] else { panic!("{found:?}") };
    assert_eq!((info.name.as_str(), info.size, info.is_blob), ("blob/camera", MOST, true));
    assert_eq!(info.schema.as_deref(), Some(BlobType::CompressedImage.schema()));
    assert_eq!(BlobType::of_name(&info.type_name), Some(BlobType::CompressedImage));
    let mut tap = recorder.tap_with_history("blob/camera").unwrap();
    assert!(tap.has_header());
    for number in 1..=200_u64 {
        let body = picture(number, (number as usize * 7919) % (MOST - 100));
        let stamp_ns = now_ns();
        out.send(Header::at(stamp_ns), &body).unwrap();
        let (bytes, header) = tap.receive(|raw| (raw.bytes.to_vec(), raw.header)).unwrap().unwrap();
        assert_eq!(bytes, body, "blob {number}");
        assert_eq!((header.seq, header.stamp_ns), (number, stamp_ns));
        assert!(header.published_ns >= stamp_ns);
    }
    assert_eq!((tap.lost(), tap.received()), (0, 200));
}

#[test]
fn a_blob_that_is_too_long_is_refused_and_the_next_one_is_sent() {
    let domain = Domain::for_test();
    let bus = Bus::join(&domain, "camera").unwrap();
    let mut out = bus.blob_publisher("blob/camera", BlobType::Image, 1000, 10.0).unwrap();
    let mut tap = bus.tap("blob/camera").unwrap();
    for wrong in [0, 1001] {
        let error = out.send(Header::default(), &vec![0; wrong]).unwrap_err().to_string();
        assert!(error.contains(&format!("{wrong} bytes; accepted: 1 to 1000")), "{error}");
    }
    out.send(Header::default(), &[7; 1000]).unwrap();
    assert_eq!(tap.receive(|raw| (raw.bytes.len(), raw.header.seq)).unwrap(), Some((1000, 1)));
}

#[test]
fn a_slow_reader_of_blobs_loses_the_oldest_and_counts_them() {
    let domain = Domain::for_test();
    let bus = Bus::join(&domain, "camera").unwrap();
    let mut out = bus.blob_publisher("blob/camera", BlobType::Image, 4 << 20, 30.0).unwrap();
    let mut tap = bus.tap_with_history("blob/camera").unwrap();
    let kept = quality_of_blobs(4 << 20).buffer;
    assert_eq!(kept, 8, "32 MB");
    let mut next = |number: u8, tap: &mut bus::Tap| {
        out.send(Header::default(), &[number; 100]).unwrap();
        (number == 0 || number == 20).then(|| tap.receive(|raw| (raw.header.seq, raw.missing)).unwrap().unwrap())
    };
    let received: Vec<(u64, u64)> = (0..=20).filter_map(|number| next(number, &mut tap)).collect();
    assert_eq!(received, [(1, 0), (14, 12)]);
    assert_eq!(tap.lost(), 12);
}

#[test]
fn the_memory_of_a_blob_channel_is_reserved_when_its_publisher_is_created() {
    let domain = Domain::for_test();
    let bus = Bus::join(&domain, "camera").unwrap();
    let before = domain.memory();
    let _out = bus.blob_publisher("blob/camera", BlobType::CompressedImage, 400_000, 30.0).unwrap();
    let after = domain.memory();
    let taken = after.used - before.used;
    assert!((32 << 20..40 << 20).contains(&taken), "{taken}");
    assert_eq!(after.unreserved, 0);
    let huge = bus.blob_publisher("blob/other", BlobType::CompressedImage, usize::MAX / 1024, 30.0);
    assert!(matches!(huge, Err(BusError::NoMemory { .. })), "{huge:?}");
}

#[test]
fn only_channels_of_blobs_carry_blobs() {
    let domain = Domain::for_test();
    let bus = Bus::join(&domain, "camera").unwrap();
    for name in ["sensor/camera", "motor/command/a"] {
        assert!(bus.blob_publisher(name, BlobType::Image, 100, 1.0).is_err(), "{name}");
    }
}
