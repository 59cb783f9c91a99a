//! Messages that a program outside of the robot declares for its sensor.

use crate::schema::{Schema, SchemaError, without_comments};
use crate::{CHANNELS, Header, hash_of};

/// Largest sample of a declared message, bytes: a picture of 64 x 64 in four colours has as many beside its header.
const BYTES: usize = 64 << 10;
/// Longest definition with its comments, bytes. A channel stores a little more.
const TEXT_BYTES: usize = 32_000;
/// Most lines of a definition without its comments, and most fields after nested types are laid out: what a constant
/// names is stored for each field.
const LINES: usize = 512;
/// Longest line of a definition without its comments, bytes.
const LINE_BYTES: usize = 160;
/// Longest name of a message, characters: its type name fits into one of a channel.
const NAME_BYTES: usize = 64;

/// A declared message: the same type as a struct of these fields in Rust or in Python on shared memory.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Declaration {
    type_name: String,
    definition: String,
    size: usize,
}

/// Why a message cannot be declared.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum DeclarationError {
    /// Its name is none of a type.
    #[error("the message is called `{}`; accepted: 1 to {NAME_BYTES} letters and digits in CamelCase", shown(.0))]
    Name(String),
    /// A message of the robot itself has the name.
    #[error("`{0}` is a message of the robot itself; give the message of the sensor another name")]
    OfTheRobot(String),
    /// The definition is too long.
    #[error("the definition has {0} bytes; accepted: at most {TEXT_BYTES}; shorten its comments, or leave fields out")]
    TooLong(usize),
    /// It has too many lines, or one that is too long.
    #[error(
        "the definition has {lines} lines, the longest of {longest} bytes; accepted: {LINES} lines of {LINE_BYTES} bytes, without comments"
    )]
    Lines {
        /// Number of lines without comments.
        lines: usize,
        /// Bytes of the longest one.
        longest: usize,
    },
    /// A reader would not accept the definition, or would misread it.
    #[error(transparent)]
    Definition(SchemaError),
    /// The header is missing.
    #[error("the message does not begin with `nims_msgs/Header header`; put this field first")]
    NoHeader,
    /// The end of the struct is hidden padding.
    #[error("a sample has {} bytes, no multiple of 8; add a field `uint8[{}] pad0` at the end", .0, 8 - .0 % 8)]
    Unpadded(usize),
    /// The samples are too large.
    #[error("a sample has {0} bytes; accepted: at most {BYTES}; send less at once, or use shared memory")]
    TooLarge(usize),
}

/// The beginning of a text of any length.
fn shown(text: &str) -> String {
    text.chars().take(NAME_BYTES).collect()
}

impl Declaration {
    /// Checks a message of this name, e.g. `Soil`, and its complete ROS 2 definition, nested types included.
    ///
    /// # Errors
    /// What is wrong, in one sentence.
    pub fn new(message: &str, definition: &str) -> Result<Self, DeclarationError> {
        let camel = message.starts_with(|c: char| c.is_ascii_uppercase())
            && message.chars().all(|c| c.is_ascii_alphanumeric())
            && message.len() <= NAME_BYTES;
        if !camel {
            return Err(DeclarationError::Name(message.to_owned()));
        }
        let of_the_robot = |name: &str| name.split('/').nth(1) == Some(message);
        if message == "Header" || CHANNELS.iter().filter_map(|row| row.type_name).any(|name| of_the_robot(name())) {
            return Err(DeclarationError::OfTheRobot(message.to_owned()));
        }
        if definition.len() > TEXT_BYTES {
            return Err(DeclarationError::TooLong(definition.len()));
        }
        let plain = without_comments(definition);
        let (lines, longest) = (plain.lines().count(), plain.lines().map(str::len).max().unwrap_or(0));
        if lines > LINES || longest > LINE_BYTES {
            return Err(DeclarationError::Lines { lines, longest });
        }
        let schema = Schema::parse_within(definition, LINES).map_err(DeclarationError::Definition)?;
        if !schema.has_header() || !plain.starts_with("nims_msgs/Header header\n") {
            return Err(DeclarationError::NoHeader);
        }
        let size = schema.size();
        if size > BYTES {
            return Err(DeclarationError::TooLarge(size));
        }
        if !size.is_multiple_of(align_of::<Header>()) {
            return Err(DeclarationError::Unpadded(size));
        }
        let type_name = format!("nims_msgs/{message}/{:08x}", hash_of(&plain));
        Ok(Self { type_name, definition: definition.to_owned(), size })
    }

    /// The type name that peers compare.
    #[must_use]
    pub fn type_name(&self) -> &str {
        &self.type_name
    }

    /// The definition with its comments.
    #[must_use]
    pub fn definition(&self) -> &str {
        &self.definition
    }

    /// Size of a sample with its header, bytes.
    #[must_use]
    pub fn size(&self) -> usize {
        self.size
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::message;
    use proptest::prelude::*;

    message! {
        /// A probe in the ground.
        pub struct Soil {
            header: Header,
            /// Water by volume, %.
            moisture_percent: f64,
            /// Counts of the four channels.
            counts: [u16; 4],
        }
    }

    #[test]
    fn a_declared_message_is_the_type_of_the_same_struct() {
        use crate::Message;
        let declared = Declaration::new("Soil", Soil::schema()).unwrap();
        assert_eq!((declared.type_name(), declared.size()), (Soil::type_name(), size_of::<Soil>()));
        assert!(declared.definition().contains("# Water by volume, %.\nfloat64 moisture_percent\n"));
        // Comments are no part of the type.
        let plain = Declaration::new("Soil", &without_comments(Soil::schema())).unwrap();
        assert_eq!(plain.type_name(), Soil::type_name());
    }

    #[test]
    fn what_is_no_message_of_a_sensor_is_refused_in_one_sentence() {
        use crate::Message;
        let good = Soil::schema();
        let with = |from: &str, to: &str| {
            assert!(good.contains(from));
            good.replace(from, to)
        };
        let own = |name: &str, text: &str| Declaration::new(name, text).unwrap_err();
        for name in ["", "soil", "So il", "Soil/1", &"S".repeat(65), "Söil"] {
            assert!(matches!(own(name, good), DeclarationError::Name(_)), "{name}");
        }
        for name in ["Reading", "MotorCommand", "Header", "MarkerArray"] {
            assert!(matches!(own(name, good), DeclarationError::OfTheRobot(_)), "{name}");
        }
        let headless = with("nims_msgs/Header header\n", "");
        for (text, is) in [
            ("float64 value\n".to_owned(), DeclarationError::NoHeader),
            (headless.split("====").next().unwrap().to_owned(), DeclarationError::NoHeader),
            (with("uint16[4] counts", "uint16[3] counts"), DeclarationError::Unpadded(62)),
            (with("uint16[4] counts", "uint16[40000] counts"), DeclarationError::TooLarge(80_056)),
            (with("# Counts", &"#".repeat(40_000)), DeclarationError::TooLong(good.len() + 39_992)),
        ] {
            assert_eq!(Declaration::new("Soil", &text), Err(is));
        }
        let long = with("counts", &"c".repeat(200));
        for text in [with("uint16[4] counts", &"uint8 A=1\n".repeat(600)), long] {
            assert!(matches!(own("Soil", &text), DeclarationError::Lines { .. }), "{text}");
        }
        for text in [with("float64 ", "string "), with("uint16[4]", "uint16[]"), with("counts", "class"), String::new()]
        {
            assert!(matches!(own("Soil", &text), DeclarationError::Definition(_)), "{text}");
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 512, failure_persistence: None, ..ProptestConfig::default() })]

        /// No declaration is a panic; what is refused is so in one sentence that ends, and what is accepted can be laid
        /// out in shared memory.
        #[test]
        fn hostile_declarations_are_refused_in_one_sentence(
            name in "(Soil|Reading|[A-Za-z0-9/ ]{0,70}|\\PC{0,5})",
            head in "(nims_msgs/Header header\n)?",
            lines in "((uint8|int64|float32|bool|string|nims_msgs/Header|nims_msgs/In)(\\[[0-9]{0,6}\\])? (a|b|c|class|pad0)\n|# \\PC{0,20}\n|uint8 A=[0-9]{1,3}\n){0,6}",
            tail in any::<bool>(),
        ) {
            use crate::Message;
            let (_, nested) = Soil::schema().split_once("====").unwrap();
            let text = format!("{head}{lines}{}", if tail { format!("===={nested}") } else { String::new() });
            match Declaration::new(&name, &text) {
                Ok(declared) => {
                    prop_assert!(declared.size() <= BYTES && declared.size() % 8 == 0 && declared.size() >= 48);
                    prop_assert!(declared.type_name().len() < 128 && declared.type_name().is_ascii());
                    prop_assert!(tail && !head.is_empty());
                }
                Err(error) => {
                    let sentence = error.to_string();
                    prop_assert!(sentence.lines().count() == 1 && sentence.len() < 400, "{sentence}");
                }
            }
        }
    }
}
