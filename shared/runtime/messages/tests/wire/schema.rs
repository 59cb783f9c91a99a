//! The parser of definitions: agrees with every sample's own layout, and refuses what some reader would misread.

use messages::schema::{Flaw, Number, Schema, SchemaError, Value, is_same, is_type_name, split, without_comments};
use messages::*;
use proptest::prelude::*;

fn agrees<T: Message>() {
    let schema = Schema::parse(T::schema()).unwrap_or_else(|error| panic!("{}: {error}", T::NAME));
    assert_eq!(schema.size(), size_of::<T>(), "{}", T::NAME);
    assert!(schema.has_header(), "{}", T::NAME);
    let mut end = 0;
    for field in schema.fields() {
        assert_eq!(field.offset, end, "{}.{}: fields follow each other without a gap", T::NAME, field.path);
        end += field.size();
    }
    assert_eq!(end, size_of::<T>());
    // every byte of a sample comes out once, in order
    let bytes: Vec<u8> = (0..size_of::<T>()).map(|at| (at * 7 % 251) as u8).collect();
    let mut back = Vec::new();
    for (field, value) in schema.decode(&bytes) {
        for number in value.numbers() {
            match number {
                Number::Unsigned(value) => back.extend(&value.to_le_bytes()[..field.primitive.size()]),
                Number::Signed(value) => back.extend(&value.to_le_bytes()[..field.primitive.size()]),
                Number::Float32(value) => back.extend(value.to_bits().to_le_bytes()),
                Number::Float64(value) => back.extend(value.to_bits().to_le_bytes()),
            }
        }
    }
    assert_eq!(back, bytes, "{}", T::NAME);
}

#[test]
fn every_sample_is_read_back_from_its_own_text() {
    agrees::<MotorState>();
    agrees::<MotorCommand>();
    agrees::<MotorAuthority>();
    agrees::<MotorSlots>();
    agrees::<MotorInput>();
    agrees::<Energy>();
    agrees::<PlanMotion>();
    agrees::<PlanStatus>();
    agrees::<NodeEstimate>();
    agrees::<ControlStatus>();
    agrees::<TruthNode>();
    agrees::<Reading>();
    agrees::<Sample>();
    agrees::<OperatorRequest>();
    agrees::<Heartbeat>();
    agrees::<LogEvent>();
    agrees::<SystemConfig>();
    agrees::<ProcessState>();
    agrees::<RecorderStatus>();
}

#[test]
fn offsets_names_and_texts_are_those_of_the_struct() {
    let mut input = MotorInput::default();
    input.command[1].epoch = 77;
    input.unit[2] = MotorInput::UNIT_LOST;
    let schema = Schema::parse(MotorInput::schema()).unwrap();
    let bytes = bytemuck::bytes_of(&input);
    let epoch = schema.field("command[1].epoch").unwrap();
    assert_eq!(
        epoch.offset,
        std::mem::offset_of!(MotorInput, command)
            + size_of::<MotorCommand>()
            + std::mem::offset_of!(MotorCommand, epoch)
    );
    assert_eq!(Value::read(epoch, bytes).unwrap().number(), Some(Number::Unsigned(77)));
    let unit = schema.field("unit").unwrap();
    let third = Value::read(unit, bytes).unwrap().numbers().nth(2).unwrap();
    assert_eq!(unit.name_of(third), Some("UNIT_LOST"));

    let mut log = LogEvent::default();
    put_text(&mut log.text, "höhe 3 m");
    let schema = Schema::parse(LogEvent::schema()).unwrap();
    let text = Value::read(schema.field("text").unwrap(), bytemuck::bytes_of(&log)).unwrap();
    assert_eq!(text.text().as_deref(), Some("höhe 3 m"));
    assert_eq!(schema.decode(&bytemuck::bytes_of(&log)[..32]).count(), 4, "a short sample gives what it has");
    assert_eq!(Value::read(schema.field("level").unwrap(), bytemuck::bytes_of(&log)).unwrap().to_string(), "0");
}

#[test]
fn signed_numbers_keep_their_sign() {
    let schema = Schema::parse("int64 a\nint32 b\nint16 c\nint8 d\nbool e\nfloat64[2] f\n").unwrap();
    let mut bytes = (-5_i64).to_le_bytes().to_vec();
    bytes.extend((-6_i32).to_le_bytes());
    bytes.extend((-7_i16).to_le_bytes());
    bytes.extend([(-8_i8) as u8, 1]);
    bytes.extend(0.1_f64.to_le_bytes());
    bytes.extend(f64::NAN.to_le_bytes());
    let values: Vec<String> = schema.decode(&bytes).map(|(_, value)| value.to_string()).collect();
    assert_eq!(values, ["-5", "-6", "-7", "-8", "1", "[0.1, NaN]"]);
}

#[test]
fn what_a_reader_would_misread_is_refused_with_its_line() {
    let separator = "=".repeat(80);
    let of = str::to_owned;
    let value = |value| Flaw::ConstantValue { value: of(value), kind: of("uint8"), name: of("X") };
    for (text, line, what) in [
        ("".to_owned(), 1, Flaw::Empty),
        ("uint8 a\nfloat64 b\n".to_owned(), 2, Flaw::Unaligned { path: of("b"), offset: 1 }),
        (
            format!("t/In[2] a\n{separator}\nMSG: t/In\nfloat64 x\nuint8 y\n"),
            4,
            Flaw::Unaligned { path: of("a[1].x"), offset: 9 },
        ),
        ("uint8 a\r\n".to_owned(), 1, Flaw::CarriageReturn),
        ("float64[] a\n".to_owned(), 1, Flaw::Array(of("float64[]"))),
        ("float64[<=4] a\n".to_owned(), 1, Flaw::Array(of("float64[<=4]"))),
        ("float64[0] a\n".to_owned(), 1, Flaw::Array(of("float64[0]"))),
        ("float64[3][3] a\n".to_owned(), 1, Flaw::Array(of("float64[3][3]"))),
        ("string a\n".to_owned(), 1, Flaw::FieldType(of("string"))),
        ("char[4] a\n".to_owned(), 1, Flaw::FieldType(of("char"))),
        ("uint8 Big\n".to_owned(), 1, Flaw::FieldName(of("Big"))),
        ("uint8 a__b\n".to_owned(), 1, Flaw::FieldName(of("a__b"))),
        ("uint8 a_\n".to_owned(), 1, Flaw::FieldName(of("a_"))),
        ("uint8 _pad\n".to_owned(), 1, Flaw::FieldName(of("_pad"))),
        ("uint8 lambda\n".to_owned(), 1, Flaw::FieldName(of("lambda"))),
        ("float64 w 1\n".to_owned(), 1, Flaw::FieldName(of("w 1"))),
        ("uint8 a\nuint8 a\n".to_owned(), 2, Flaw::FieldTwice(of("a"))),
        ("uint8 X=0x10\nuint8 a\n".to_owned(), 1, value("0x10")),
        ("uint8 X=256\nuint8 a\n".to_owned(), 1, value("256")),
        ("uint8 X=+1\nuint8 a\n".to_owned(), 1, value("+1")),
        ("uint8 low=1\nuint8 a\n".to_owned(), 1, Flaw::ConstantName(of("low"))),
        ("float64 X=1\nuint8 a\n".to_owned(), 1, Flaw::ConstantType { name: of("X"), kind: of("float64") }),
        ("t/In a\n".to_owned(), 1, Flaw::Undefined(of("t/In"))),
        ("t/msg/In a\n".to_owned(), 1, Flaw::FieldType(of("t/msg/In"))),
        (format!("uint8 a\n{}\nMSG: t/In\nuint8 x\n", "=".repeat(79)), 2, Flaw::Separator),
        (format!("uint8 a\n{separator}\nMSG: In\nuint8 x\n"), 3, Flaw::NoHead(of("MSG: In"))),
        (format!("uint8 a\n{separator}"), 2, Flaw::EndsBehindSeparator),
        (format!("t/In a\n{separator}\nMSG: t/In\nt/In x\n"), 3, Flaw::TooDeep),
        (
            format!("t/In a\n{separator}\nMSG: t/In\nuint8 x\n{separator}\nMSG: t/In\nuint8 x\n"),
            6,
            Flaw::TypeTwice(of("t/In")),
        ),
        (format!("uint8 a\n{separator}\nMSG: t/In\n"), 3, Flaw::Empty),
        ("uint8\n".to_owned(), 1, Flaw::NotAMember(of("uint8"))),
        ("float64[99999999999] a\n".to_owned(), 1, Flaw::TooLarge { fields: 65_536 }),
    ] {
        let error = Schema::parse(&text).expect_err(&text);
        assert_eq!(error, SchemaError { line, what }, "{text}: {error}");
    }
}

#[test]
fn comments_and_blank_lines_are_allowed() {
    let schema = Schema::parse("# höhe\n\nuint8 A=1 # eins\nuint8 B=2\nuint8 a # in µm\nuint8 b\n").unwrap();
    assert_eq!(schema.fields()[0].constants, [("A".to_owned(), 1), ("B".to_owned(), 2)]);
    assert!(schema.fields()[1].constants.is_empty());
    assert!(!schema.has_header());
}

#[test]
fn definitions_are_split_with_their_names() {
    let parts = split(MotorInput::schema());
    let names: Vec<&str> = parts.iter().map(|(name, _)| *name).collect();
    assert_eq!(names, ["", "nims_msgs/Header", "nims_msgs/RequestBody", "nims_msgs/MotorCommand"]);
    assert!(without_comments(parts[1].1).starts_with("uint64 life\nuint64 cycle\n"));
    assert!(is_type_name("nims_msgs/MotorState"));
    for bad in ["MotorState", "a/b", "a-b/T", "A/T", "a/msg/T", "a/T_x"] {
        assert!(!is_type_name(bad), "{bad}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 256, failure_persistence: None, ..ProptestConfig::default() })]

    /// No text, however broken, makes the parser panic; neither does decoding bytes of any length with what it
    /// accepted.
    #[test]
    fn no_text_is_a_panic(text in "(uint8|float64|int16|t/In|=|MSG: t/In|[a-z]{1,3}|[A-Z]=?[0-9]{0,3}|\\[[0-9]{1,2}\\]|\n| |#){0,40}", bytes in proptest::collection::vec(any::<u8>(), 0..64)) {
        if let Ok(schema) = Schema::parse(&text) {
            for (_, value) in schema.decode(&bytes) {
                prop_assert!(!value.to_string().is_empty());
                let _ = value.text();
            }
        }
    }
}

#[test]
fn comments_end_a_line_or_are_one() {
    let text = "# about\nuint8 a # unit\n\n  # more\nuint8 B=1\nuint8 b\n";
    assert_eq!(without_comments(text), "uint8 a\n\nuint8 B=1\nuint8 b\n");
    assert!(is_same(text, "uint8 a\n\nuint8 B=1\nuint8 b # other words\n"));
    assert!(!is_same(text, "uint8 a\nuint8 b\n"));
}
