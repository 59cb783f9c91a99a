//! The decoders accept any bytes, resynchronise at the next whole frame, and decode known frames as documented by the
//! makers of the devices.

#![allow(clippy::unwrap_used, clippy::expect_used)]

use messages::{Reading, text_of};
use proptest::prelude::*;
use sensor::{Sensor, SensorFile};

const MS: u64 = 1_000_000;

fn sensor(text: &str) -> Sensor {
    let file = tempfile::NamedTempFile::new().unwrap();
    std::fs::write(file.path(), format!("port = \"/dev/null\"\nlatency_s = 0.02\n{text}")).unwrap();
    let mut sensor = Sensor::new(&SensorFile::load(file.path()).unwrap(), 0).unwrap();
    sensor.connected();
    sensor
}

fn tfmini() -> Sensor {
    sensor("[tfmini]\n")
}

const WIND: &str = "[line]\nformat = \"nmea\"\nsentence = \"MWV\"\nvalid = { field = 5, is = \"A\" }\n\
    [[value]]\nquantity = \"speed\"\nunit = \"m/s\"\nfield = 3\n[[value]]\nquantity = \"angle\"\nunit = \"deg\"\nfield = 1\n";
const COLUMNS: &str = "[line]\nformat = \"csv\"\nseparator = \";\"\n[[value]]\nquantity = \"x\"\nunit = \"1\"\nfield = 2\nscale = 0.1\noffset = 5.0\n";
const NAMED: &str = "[line]\nformat = \"key-value\"\n[[value]]\nquantity = \"t\"\nunit = \"degC\"\nkey = \"T\"\n";
const REGISTERS: &str = "[modbus]\nunit_id = 17\n[[value]]\nquantity = \"a\"\nunit = \"1\"\nregister = 107\n\
    [[value]]\nquantity = \"b\"\nunit = \"1\"\nregister = 108\nnumber = \"i16\"\n[[value]]\nquantity = \"c\"\nunit = \"1\"\nregister = 109\n";

/// The example of the specification (Modbus application protocol 1.1b3, 6.3) as sent over a serial port: registers 107
/// to 109 of unit 17 contain 555, 0 and 100.
const ANSWER: [u8; 11] = [0x11, 0x03, 0x06, 0x02, 0x2B, 0x00, 0x00, 0x00, 0x64, 0xC8, 0xBA];

fn decode(sensor: &mut Sensor, bytes: &[u8], now_ns: u64) -> Vec<Reading> {
    bytes.iter().filter_map(|byte| sensor.push(*byte, now_ns)).collect()
}

/// A rangefinder frame with a distance in centimetres.
fn frame(distance: u16, strength: u16) -> [u8; 9] {
    let ([d0, d1], [s0, s1]) = (distance.to_le_bytes(), strength.to_le_bytes());
    let mut frame = [0x59, 0x59, d0, d1, s0, s1, 0xF8, 0x08, 0];
    frame[8] = frame[..8].iter().map(|byte| u32::from(*byte)).sum::<u32>() as u8;
    frame
}

/// An NMEA sentence with this body.
fn sentence(body: &str) -> Vec<u8> {
    format!("${body}*{:02x}\r\n", body.bytes().fold(0, |sum, byte| sum ^ byte)).into_bytes()
}

#[test]
fn rangefinder_frames_are_decoded() {
    let mut sensor = tfmini();
    let readings =
        decode(&mut sensor, &[frame(256, 1200), frame(310, 60), frame(0xFFFF, 3), frame(1, 0xFFFF)].concat(), 100 * MS);
    let qualities: Vec<u8> = readings.iter().map(|reading| reading.quality).collect();
    let [good, doubtful, invalid] = [Reading::QUALITY_GOOD, Reading::QUALITY_DOUBTFUL, Reading::QUALITY_INVALID];
    assert_eq!(qualities, [good, doubtful, invalid, doubtful]);
    assert!((readings[0].value[0] - 2.56).abs() < 1e-12 && readings[0].value[1] == 1200.0);
    assert!(readings[2].value[0].is_nan());
    let first = readings[0];
    assert_eq!((first.header.stamp_ns, first.header.oldest_input_ns), (100 * MS, 80 * MS));
    assert_eq!(
        (text_of(&first.quantity), text_of(&first.unit), first.count),
        ("distance,strength".into(), "m,1".into(), 2)
    );
    assert_eq!(sensor.counts(), (4, 0));
}

#[test]
fn opening_a_port_within_a_frame_causes_no_bad_frame_and_a_wrong_baud_rate_does() {
    let mut sensor = tfmini();
    let stream = [frame(100, 900), frame(200, 900)].concat();
    assert_eq!(decode(&mut sensor, &stream[5..], MS).len(), 1);
    assert_eq!(sensor.counts(), (1, 0));
    assert!(decode(&mut sensor, &[0x80; 90], MS).is_empty());
    assert!((9..=10).contains(&sensor.counts().1), "{:?}", sensor.counts());
}

#[test]
fn text_lines_are_decoded() {
    let mut wind = sensor(WIND);
    // The port was opened within a sentence whose rest looks whole.
    assert!(decode(&mut wind, b"4.8,R,9.1,M,A*28\r\n", MS).is_empty());
    let good = decode(&mut wind, &sentence("WIMWV,214.8,R,0.1,M,A"), MS);
    assert_eq!((good[0].value[..2].to_vec(), good[0].quality), (vec![0.1, 214.8], Reading::QUALITY_GOOD));
    assert_eq!(decode(&mut wind, &sentence("WIMWV,214.8,R,0.1,M,V"), MS)[0].quality, Reading::QUALITY_INVALID);
    let empty = decode(&mut wind, &sentence("WIMWV,,R,,M,A"), MS)[0];
    assert!(empty.value[0].is_nan() && empty.quality == Reading::QUALITY_INVALID);
    // Other sentences of the same talker are ignored and are not bad.
    assert!(decode(&mut wind, &sentence("WIXDR,C,19.5,C,AIRT"), MS).is_empty());
    assert_eq!(wind.counts(), (3, 0));
    for bad in [
        &b"$WIMWV,214.8,R,0.1,M,A*29\r\n"[..],
        b"$WIMWV,214.8,R,0.1,M,A\r\n",
        b"garbage\r\n",
        b"\xff\xfe\r\n",
        &sentence("WIMWV,1,R"),
    ] {
        assert!(decode(&mut wind, bad, MS).is_empty());
    }
    assert_eq!(wind.counts(), (3, 5));

    let mut columns = sensor(COLUMNS);
    assert_eq!(
        decode(&mut columns, b"\n1; 40 ;x\r\n1;a\n\n2;-50\n", MS).iter().map(|r| r.value[0]).collect::<Vec<_>>(),
        [9.0, 0.0]
    );
    assert_eq!(columns.counts(), (2, 1));
    let mut named = sensor(NAMED);
    assert_eq!(decode(&mut named, b"\nRT=1,T=21.5C;T2=3\n", MS)[0].value[0], 21.5);
}

#[test]
fn registers_are_decoded() {
    let mut sensor = sensor(REGISTERS);
    assert!(decode(&mut sensor, &ANSWER, 0).is_empty(), "no request was sent");
    // As in the specification: read three holding registers from 107 (0x6b) on.
    assert_eq!(sensor.request(1000 * MS).unwrap(), [0x11, 0x03, 0x00, 0x6B, 0x00, 0x03, 0x76, 0x87]);
    assert!(sensor.request(1500 * MS).is_none(), "once a second");
    let reading = decode(&mut sensor, &ANSWER, 1510 * MS)[0];
    assert_eq!((reading.value[..3].to_vec(), reading.quality), (vec![555.0, 0.0, 100.0], Reading::QUALITY_GOOD));
    assert_eq!(sensor.counts(), (1, 0));
    // An exception response (illegal address), then no response.
    sensor.request(2500 * MS).unwrap();
    assert!(decode(&mut sensor, &[0x11, 0x83, 0x02, 0xC1, 0x34], 2510 * MS).is_empty());
    assert_eq!(sensor.counts(), (1, 1));
    sensor.request(4000 * MS).unwrap();
    sensor.request(5000 * MS).unwrap();
    assert_eq!(sensor.counts(), (1, 2));
}

#[test]
fn a_stale_reading_has_the_last_value_and_its_time() {
    let mut sensor = sensor("stale_s = 0.5\n[tfmini]\n");
    assert!(sensor.stale_reading(499 * MS).is_none());
    let never = sensor.stale_reading(500 * MS).unwrap();
    assert!(never.quality == Reading::QUALITY_STALE && never.value[0].is_nan() && never.header.oldest_input_ns == 0);
    decode(&mut sensor, &frame(150, 900), 600 * MS);
    assert!(sensor.stale_reading(1099 * MS).is_none());
    for now in [1100, 1600] {
        let stale = sensor.stale_reading(now * MS).unwrap();
        assert_eq!((stale.value[0], stale.quality), (1.5, Reading::QUALITY_STALE));
        assert_eq!((stale.header.stamp_ns, stale.header.oldest_input_ns), (now * MS, 580 * MS));
        assert!(sensor.stale_reading((now + 499) * MS).is_none());
    }
}

#[test]
fn an_invalid_file_is_rejected_with_one_sentence() {
    let value = "[[value]]\nquantity = \"a\"\nunit = \"1\"\n";
    let cases = [
        (String::new(), "[tfmini] [line] [modbus]"),
        ("[tfmini]\n[modbus]\n".to_owned(), "[tfmini] [line] [modbus]"),
        (format!("[tfmini]\n{value}"), "`value`"),
        ("[tfmini]\nresolution_m = 0.5\n".to_owned(), "`tfmini.resolution_m`"),
        ("stale_s = nan\n[tfmini]\n".to_owned(), "`stale_s`"),
        ("[line]\nformat = \"nmea\"\nsentence = \"MWV\"\n".to_owned(), "[[value]]"),
        (format!("[line]\nformat = \"nmea\"\n{value}field = 1\n"), "`line.sentence`"),
        (format!("[line]\nformat = \"csv\"\n{value}"), "`field`"),
        (format!("[line]\nformat = \"csv\"\n{value}field = 0\n"), "`field`"),
        (format!("[line]\nformat = \"key-value\"\n{value}field = 1\n"), "`key`"),
        (format!("[modbus]\n{value}"), "`register`"),
        (format!("[modbus]\nunit_id = 0\n{value}register = 1\n"), "`modbus.unit_id`"),
        (format!("[modbus]\n{value}register = 65535\nnumber = \"f32\"\n"), "`register`"),
        (format!("[modbus]\n{value}register = 0\n{value}register = 200\n"), "`register`"),
    ];
    for (text, keys) in cases {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), format!("port = \"/dev/null\"\n{text}")).unwrap();
        let sentence = SensorFile::load(file.path()).expect_err(&text).to_string();
        let named = keys.split(' ').all(|key| sentence.contains(key));
        assert!(named && sentence.lines().count() == 1, "{text}: {sentence}");
    }
}

/// Arbitrary bytes, with a preference for those that the decoders look for.
fn garbage() -> impl Strategy<Value = Vec<u8>> {
    let byte = prop_oneof![
        any::<u8>(),
        Just(0x59),
        Just(b'$'),
        Just(b'*'),
        Just(b','),
        Just(b'\n'),
        Just(0x11),
        Just(0x03),
        Just(0x06)
    ];
    proptest::collection::vec(byte, 0..300)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(256))]

    /// Arbitrary bytes cause no panic, and after them at the latest the second whole frame is decoded: they can absorb
    /// the first one into an apparent frame.
    #[test]
    fn whole_frames_after_arbitrary_bytes_are_decoded(garbage in garbage(), distance in 1_u16..1200) {
        let mut range = tfmini();
        decode(&mut range, &garbage, MS);
        let readings = decode(&mut range, &frame(distance, 900).repeat(2), MS);
        prop_assert!(readings.iter().any(|reading| reading.value[0] == f64::from(distance) * 0.01), "{readings:?}");

        for (text, line) in [
            (WIND, sentence("WIMWV,214.8,R,7.5,M,A")), (COLUMNS, b"0;25\n".to_vec()), (NAMED, b"T=7.5\n".to_vec()),
        ] {
            let mut lines = sensor(text);
            decode(&mut lines, &garbage, MS);
            decode(&mut lines, b"\n", MS);
            let readings = decode(&mut lines, &line, MS);
            prop_assert_eq!(readings.len(), 1);
            prop_assert_eq!(readings[0].value[0], 7.5);
        }

        let mut registers = sensor(REGISTERS);
        registers.request(1000 * MS).unwrap();
        decode(&mut registers, &garbage, MS);
        // The next request clears the received bytes.
        registers.request(2000 * MS).unwrap();
        prop_assert_eq!(decode(&mut registers, &ANSWER, MS).len(), 1);
    }

    /// A flipped bit in a frame with a CRC or XOR checksum, or a truncated frame, never results in a value.
    #[test]
    fn a_frame_with_a_flipped_bit_is_rejected(bit in 0_usize..88, at in 0_usize..11) {
        let mut registers = sensor(REGISTERS);
        registers.request(1000 * MS).unwrap();
        let mut damaged = ANSWER;
        damaged[bit / 8] ^= 1 << (bit % 8);
        prop_assert!(decode(&mut registers, &damaged, MS).is_empty());
        registers.request(2000 * MS).unwrap();
        prop_assert!(decode(&mut registers, &ANSWER[..at], MS).is_empty());

        let whole = sentence("WIMWV,214.8,R,0.1,M,A");
        let mut wind = sensor(WIND);
        decode(&mut wind, b"\n", MS);
        let mut damaged = whole.clone();
        // Between `$` and the checksum, because a checksum in capital letters is valid too.
        let place = 1 + bit % (whole.len() - 6);
        damaged[place] ^= 1 << (at % 7);
        prop_assert!(decode(&mut wind, &damaged, MS).is_empty() || damaged[place] == b'\n');
    }
}
