//! Every sample is its own CDR body: an independent walk over the schema text gives the struct's size, without a gap.

use messages::schema::{is_same, without_comments};
use messages::*;

/// Size and alignment by CDR rules (each primitive at a multiple of its size) from the schema text alone, constants
/// skipped.
fn cdr_size(own: &str, all: &str, start: usize) -> usize {
    let mut offset = start;
    for line in own.lines().filter(|line| !line.contains('=')) {
        let (kind, _) = line.split_once(' ').unwrap();
        let (base, count) = match kind.split_once('[') {
            Some((base, rest)) => (base, rest.trim_end_matches(']').parse::<usize>().unwrap()),
            None => (kind, 1),
        };
        let size = match base {
            "uint8" | "int8" => 1,
            "uint16" | "int16" => 2,
            "uint32" | "int32" | "float32" => 4,
            "uint64" | "int64" | "float64" => 8,
            nested => {
                let body = all
                    .split(&"=".repeat(80))
                    .find_map(|part| part.trim_start().strip_prefix(&format!("MSG: {nested}\n")))
                    .unwrap();
                for _ in 0..count {
                    offset = cdr_size(body, all, offset);
                }
                continue;
            }
        };
        assert_eq!(offset % size, 0, "`{line}` stands at {offset}: hidden padding");
        offset += size * count;
    }
    offset
}

fn check<T: Message>() {
    let documented = T::schema();
    assert!(is_same(documented, &without_comments(documented)) && documented.starts_with('#'), "{}", T::NAME);
    let text = &without_comments(documented)[..];
    let own = text.split(&"=".repeat(80)).next().unwrap();
    assert_eq!(cdr_size(own, text, 0), size_of::<T>(), "{}", T::NAME);
    assert_eq!(size_of::<T>() % 8, 0, "{}: an array of it must not need padding", T::NAME);
    // Longer texts need services of their own, which costs every process that opens the channel: two types are
    // worth it.
    let room = if ["MotorAuthority", "MotorInput"].contains(&T::NAME) { 2 * 1750 } else { 1750 };
    assert!(text.len() <= room, "{}: schema text of {} bytes does not fit a channel's attributes", T::NAME, text.len());
    assert!(text.is_ascii());
    for line in text.lines().filter(|line| !line.contains('=') && !line.starts_with("MSG: ")) {
        let field = line.split(' ').nth(1).unwrap();
        assert!(
            field.starts_with(|c: char| c.is_ascii_lowercase()) && !field.ends_with('_') && !field.contains("__"),
            "{field}"
        );
        assert!(
            !["class", "lambda", "from", "import", "global", "pass", "is", "in", "as", "def"].contains(&field),
            "{field}: a Python keyword"
        );
    }
    assert_eq!(T::type_name(), format!("nims_msgs/{}/{:08x}", T::NAME, hash_of(text)));
    assert_eq!(schema_name(T::type_name()).unwrap(), format!("nims_msgs/msg/{}", T::NAME));
}

#[test]
fn every_sample_is_its_own_cdr_body() {
    check::<MotorState>();
    check::<MotorCommand>();
    check::<MotorAuthority>();
    check::<MotorSlots>();
    check::<MotorInput>();
    check::<Energy>();
    check::<PlanMotion>();
    check::<PlanStatus>();
    check::<NodeEstimate>();
    check::<ControlStatus>();
    check::<TruthNode>();
    check::<Reading>();
    check::<Sample>();
    check::<SensorFlag>();
    check::<FieldMap>();
    check::<OperatorRequest>();
    check::<Heartbeat>();
    check::<LogEvent>();
    check::<SystemConfig>();
    check::<ProcessState>();
    check::<RecorderStatus>();
    check::<RecorderGap>();
}

message! {
    /// As an author outside of this project declares it.
    pub struct Soil {
        header: Header,
        temperature_c: f64,
        /// By depth.
        counts: [u32; 3],
        state: u8 {
            STATE_DRY = 0,
            /// Above the field capacity.
            STATE_WET = 1,
        },
        pad0: [u8; 3],
    }
}

/// The same by another author.
mod other {
    use messages::{Header, message};

    message! {
        /// In other words.
        pub struct Soil {
            header: Header,
            /// At a depth of 10 cm.
            temperature_c: f64,
            counts: [u32; 3],
            state: u8 { STATE_DRY = 0, STATE_WET = 1 },
            pad0: [u8; 3],
        }
    }
}

#[test]
fn a_message_of_ones_own_is_one_struct() {
    check::<Soil>();
    let text = "# As an author outside of this project declares it.\nnims_msgs/Header header\nfloat64 temperature_c\n\
                # By depth.\nuint32[3] counts\nuint8 STATE_DRY=0\n# Above the field capacity.\nuint8 STATE_WET=1\nuint8 state\n";
    assert!(Soil::schema().starts_with(text), "{}", Soil::schema());
    // Two builds that explain a type in other words exchange its samples.
    assert!(Soil::type_name() == other::Soil::type_name() && Soil::schema() != other::Soil::schema());
    assert_eq!(Soil { header: Header::at(7), ..Soil::default() }.header().oldest_input_ns, 7);
    assert_eq!(Soil::STATE_WET, 1);
}

#[test]
fn the_channel_table_has_one_row_per_name() {
    for name in ["motor/state", "motor/command/a", "system/heartbeat/motor-io", "sensor/wind", "truth/node"] {
        let row = channel_of(name).unwrap();
        assert_eq!(CHANNELS.iter().filter(|other| other.pattern == row.pattern).count(), 1);
        assert_eq!(quality_of(name), row.quality);
    }
    assert!(channel_of("sensor/").is_none());
    assert!(channel_of("motor/unknown").is_none());
    // Once in each control cycle: 2.5 s of them at 250 Hz, and at 500 Hz more than the second in which a recorder is
    // replaced.
    let each_cycle = ["motor/", "node/estimate/", "control/status/"];
    for row in CHANNELS.iter().filter(|row| each_cycle.iter().any(|start| row.pattern.starts_with(start))) {
        assert!(row.quality.buffer as f64 >= 2.5 * 250.0, "{}", row.pattern);
        assert!((500..row.quality.buffer).contains(&row.quality.history), "{}", row.pattern);
        assert_eq!(row.quality.publishers, 1, "{}: one publisher is the lease", row.pattern);
    }
}

#[test]
fn large_samples_are_kept_by_bytes_and_small_ones_by_time() {
    for row in CHANNELS {
        assert_eq!(row.quality.sized(1_000), row.quality, "{}", row.pattern);
        for bytes in [0, 1, 4_000, 100_000, 1_000_000, 30_000_000, usize::MAX] {
            let fitted = row.quality.sized(bytes);
            assert!(fitted.buffer >= 4 && fitted.history <= fitted.buffer && fitted.late <= fitted.history);
            assert!(fitted.buffer <= row.quality.buffer && fitted.subscribers <= row.quality.subscribers);
            assert!(fitted.buffer == 4 || fitted.buffer.saturating_mul(bytes) <= Quality::BYTES, "{}", row.pattern);
        }
    }
    let picture = quality_for("sensor/camera", 1_000_000);
    assert!(picture.samples(1, 1) * 1_000_000 < 20_000_000, "{picture:?}");
    assert_eq!(quality_of("sensor/x").at_rate(1.0).buffer, 4);
    assert_eq!(quality_of("sensor/x").at_rate(1e6), quality_of("sensor/x"));
    assert!(quality_of("sensor/x").at_rate(f64::NAN).buffer >= 4);
}

#[test]
fn texts_are_cut_at_a_character_and_read_back() {
    let mut field = [1_u8; 8];
    put_text(&mut field, "höhenmeß");
    assert_eq!(text_of(&field), "höhenme");
    put_text(&mut field, "");
    assert_eq!(text_of(&field), "");
    assert_eq!(text_of(&[0xff, b'a', 0, b'b']), "\u{fffd}a");
}
