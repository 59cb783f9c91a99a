//! Chooses the schema under which a channel is written, so that every reader of the file can decode it.

use std::borrow::Cow;
use std::collections::{BTreeMap, HashMap};

use messages::blob::BlobType;
use messages::ros::Payload;
use messages::schema::{Schema, SchemaError, is_type_name, split, without_comments};
use messages::{hash_of, ros, schema_name};

/// A channel as discovered on the bus.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ChannelSpec {
    /// e.g. `motor/state`; the topic in the file is `/motor/state`.
    pub name: String,
    /// e.g. `nims_msgs/MotorState/1a2b3c4d`.
    pub type_name: String,
    /// Complete definition; empty if the channel has none.
    pub schema: String,
    /// Bytes of each sample; of blobs the most.
    pub size: usize,
}

impl ChannelSpec {
    /// Returns whether samples of the channel may have so many bytes.
    #[must_use]
    pub fn accepts(&self, bytes: usize) -> bool {
        bytes == self.size || BlobType::of_name(&self.type_name).is_some()
    }

    /// The channel `name` with a type of this build.
    #[must_use]
    pub fn for_type<T: Payload>(name: &str) -> Self {
        Self { name: name.into(), type_name: T::type_name().into(), schema: T::schema().into(), size: size_of::<T>() }
    }
}

/// The definition of a channel as it is given to readers, in a file or live.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Definition {
    /// `pkg/msg/Type`.
    pub schema_name: String,
    /// Complete ROS 2 definition of `schema_name`.
    pub text: String,
    /// Channel metadata: its `type`; where the text was replaced, also `original_schema` and the reason in `refused`.
    pub metadata: BTreeMap<String, String>,
}

/// Type names used in one file or one connection. Each may stand for one text only, nested types included.
#[derive(Debug, Default)]
pub struct Definitions {
    texts: HashMap<String, String>,
}

/// The lines of a type without comments: what two texts of one name are compared by.
fn plain(lines: &str) -> String {
    without_comments(lines).trim_end().to_owned()
}

/// Limit of renaming rounds: more than any text has types.
const ROUNDS: usize = 64;

impl Definitions {
    /// The schema of a channel: its own, its own under another name, or plain bytes.
    pub fn definition_of(&mut self, spec: &ChannelSpec) -> Definition {
        match check(spec) {
            Ok(name) => self.unique(spec, name),
            Err(why) => opaque(spec, &why),
        }
    }

    /// Renames types whose name already stands for another text in this file.
    fn unique(&mut self, spec: &ChannelSpec, name: String) -> Definition {
        let (mut own, mut text) = (name, Cow::Borrowed(spec.schema.as_str()));
        for _ in 0..ROUNDS {
            // from the innermost type outwards, because the name of a type depends on the names in its text
            let clash = split(&text).into_iter().rev().find_map(|(name, lines)| {
                let known = self.texts.get(if name.is_empty() { own.as_str() } else { name })?;
                (*known != plain(lines)).then(|| (name.to_owned(), format!("X{:08x}", hash_of(&plain(lines)))))
            });
            match clash {
                None => break,
                Some((name, ending)) if name.is_empty() => own.push_str(&ending),
                Some((name, ending)) => text = Cow::Owned(rename(&text, &name, &format!("{name}{ending}"))),
            }
        }
        for (name, lines) in split(&text) {
            let name = if name.is_empty() { own.as_str() } else { name };
            self.texts.entry(name.to_owned()).or_insert_with(|| plain(lines));
        }
        let mut metadata = BTreeMap::from([("type".to_owned(), spec.type_name.clone())]);
        if text != spec.schema {
            metadata.insert("original_schema".to_owned(), spec.schema.clone());
        }
        Definition { schema_name: own.replacen('/', "/msg/", 1), text: text.into_owned(), metadata }
    }
}

/// Why a channel is recorded as plain bytes.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum SchemaRefusal {
    /// Some readers do not accept the type name.
    #[error("the type name `{0}` is not `package/Type/hash`")]
    TypeName(String),
    /// There is no definition.
    #[error("the channel has no definition")]
    NoDefinition,
    /// The definition is outside the subset that every reader decodes identically.
    #[error(transparent)]
    Schema(#[from] SchemaError),
    /// The definition does not describe all bytes of the sample.
    #[error("the definition describes {described} bytes, a sample has {sample}: is there hidden padding?")]
    Size {
        /// Bytes the definition describes.
        described: usize,
        /// Bytes of a sample.
        sample: usize,
    },
}

/// The two-part type name, if every reader decodes the definition and it describes exactly the sample's bytes.
fn check(spec: &ChannelSpec) -> Result<String, SchemaRefusal> {
    let name = schema_name(&spec.type_name)
        .map(|name| name.replacen("/msg/", "/", 1))
        .filter(|name| is_type_name(name))
        .ok_or_else(|| SchemaRefusal::TypeName(spec.type_name.clone()))?;
    if spec.schema.is_empty() {
        return Err(SchemaRefusal::NoDefinition);
    }
    let of_blobs = || BlobType::of_name(&spec.type_name).map(BlobType::schema);
    if ros::schema_of(&spec.type_name).or_else(of_blobs).is_some_and(|known| known == spec.schema) {
        return Ok(name); // has strings and sequences, which every reader decodes
    }
    let schema = Schema::parse(&spec.schema)?;
    if schema.size() != spec.size {
        return Err(SchemaRefusal::Size { described: schema.size(), sample: spec.size });
    }
    Ok(name)
}

fn opaque(spec: &ChannelSpec, why: &SchemaRefusal) -> Definition {
    Definition {
        schema_name: format!("nims_msgs/msg/Opaque{}", spec.size),
        text: format!("uint8[{}] data\n", spec.size.max(1)),
        metadata: BTreeMap::from([
            ("type".to_owned(), spec.type_name.clone()),
            ("original_schema".to_owned(), spec.schema.clone()),
            ("refused".to_owned(), why.to_string()),
        ]),
    }
}

/// Renames a nested type in its definition and in all uses.
fn rename(text: &str, from: &str, to: &str) -> String {
    let mut renamed = String::with_capacity(text.len() + 64);
    for line in text.split_inclusive('\n') {
        let (head, rest) = match line.strip_prefix("MSG: ") {
            Some(rest) => ("MSG: ", rest),
            None => ("", line),
        };
        let used = rest.strip_prefix(from).filter(|rest| rest.starts_with([' ', '\t', '[', '\n']) || rest.is_empty());
        match used {
            Some(rest) => renamed.extend([head, to, rest]),
            None => renamed.push_str(line),
        }
    }
    renamed
}

#[cfg(test)]
mod tests {
    use super::*;
    use messages::{MotorCommand, MotorInput, MotorState};

    fn foreign(type_name: &str, schema: &str, size: usize) -> ChannelSpec {
        ChannelSpec { name: "sensor/x".into(), type_name: type_name.into(), schema: schema.into(), size }
    }

    #[test]
    fn known_types_keep_their_text_also_where_they_are_nested() {
        let mut definitions = Definitions::default();
        for spec in [
            ChannelSpec::for_type::<MotorInput>("motor/input"),
            ChannelSpec::for_type::<MotorCommand>("motor/command/a"),
            ChannelSpec::for_type::<MotorCommand>("motor/command/b"),
            ChannelSpec::for_type::<MotorState>("motor/state"),
        ] {
            let definition = definitions.definition_of(&spec);
            assert_eq!(definition.text, spec.schema);
            assert_eq!(definition.schema_name, schema_name(&spec.type_name).unwrap());
            assert!(!definition.metadata.contains_key("refused"));
        }
    }

    #[test]
    fn one_name_stands_for_one_text() {
        let separator = "=".repeat(80);
        let mut definitions = Definitions::default();
        definitions.definition_of(&ChannelSpec::for_type::<MotorState>("motor/state"));
        let text = format!(
            "nims_msgs/Header header\nnims_msgs/Header[2] more\n{separator}\nMSG: nims_msgs/Header\nuint64 other\n"
        );
        let definition = definitions.definition_of(&foreign("nims_msgs/MotorState/00000000", &text, 24));
        assert!(definition.schema_name.starts_with("nims_msgs/msg/MotorStateX"), "{}", definition.schema_name);
        assert_eq!(definition.metadata["original_schema"], text);
        let nested = split(&definition.text)[1].0.to_owned();
        assert!(nested.starts_with("nims_msgs/HeaderX"), "{nested}");
        assert!(definition.text.contains(&format!("{nested}[2] more\n")));
        let parsed = Schema::parse(&definition.text).unwrap();
        assert_eq!(parsed.size(), 24);
        assert!(is_type_name(&nested));
        // the same type again gets the same names
        assert_eq!(definitions.definition_of(&foreign("nims_msgs/MotorState/00000000", &text, 24)), definition);
    }

    #[test]
    fn a_definition_that_is_wrong_becomes_plain_bytes_with_the_reason() {
        let mut definitions = Definitions::default();
        let string = Schema::parse("string x\n").unwrap_err();
        for (spec, why) in [
            (foreign("wind", "float64 x\n", 8), SchemaRefusal::TypeName("wind".into())),
            (foreign("my-pkg/Wind/1", "float64 x\n", 8), SchemaRefusal::TypeName("my-pkg/Wind/1".into())),
            (foreign("my_pkg/Wind/1", "", 8), SchemaRefusal::NoDefinition),
            (foreign("my_pkg/Wind/1", "string x\n", 8), SchemaRefusal::Schema(string)),
            (foreign("my_pkg/Wind/1", "float64 x\nuint8 y\n", 16), SchemaRefusal::Size { described: 9, sample: 16 }),
        ] {
            let definition = definitions.definition_of(&spec);
            assert_eq!(definition.schema_name, format!("nims_msgs/msg/Opaque{}", spec.size));
            assert_eq!(definition.text, format!("uint8[{}] data\n", spec.size));
            assert_eq!(check(&spec).as_ref(), Err(&why));
            assert_eq!(definition.metadata["refused"], why.to_string());
            assert_eq!(definition.metadata["original_schema"], spec.schema);
        }
    }
}
