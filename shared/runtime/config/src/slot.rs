//! Slots and roles with slots in files and on the command line. The types are those of the samples.

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use messages::{Slot, SlotRole};
use serde::{Deserialize, Deserializer, Serialize, Serializer, de::Error};

use crate::{Role, UnknownChoice};

impl From<SlotRole> for Role {
    fn from(role: SlotRole) -> Self {
        match role {
            SlotRole::Controller => Self::Controller,
            SlotRole::Estimator => Self::Estimator,
        }
    }
}

/// Parses the slot of a command-line argument: `#[arg(value_parser = config::slot_argument())]`.
#[must_use]
pub fn slot_argument() -> impl TypedValueParser<Value = Slot> {
    let help = |slot| match slot {
        Slot::A => "First slot",
        Slot::B => "Second slot",
    };
    one_of(Slot::ALL.map(|slot| (slot, slot.name(), help(slot))))
}

/// Parses the role of a command-line argument: `#[arg(value_parser = config::slot_role_argument())]`.
#[must_use]
pub fn slot_role_argument() -> impl TypedValueParser<Value = SlotRole> {
    let help = |role| match role {
        SlotRole::Controller => "The controller: position and motion to cable velocities",
        SlotRole::Estimator => "The estimator: cable lengths to position",
    };
    one_of(SlotRole::ALL.map(|role| (role, Role::from(role).name(), help(role))))
}

fn one_of<T: Copy + Send + Sync + 'static>(
    choices: [(T, &'static str, &'static str); 2],
) -> impl TypedValueParser<Value = T> {
    PossibleValuesParser::new(choices.map(|(_, name, help)| PossibleValue::new(name).help(help))).map(move |given| {
        let [(first, name, _), (second, ..)] = choices;
        if given == name { first } else { second }
    })
}

/// The key `slot` of `[[process]]`, read.
pub(crate) fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<Slot>, D::Error> {
    let Some(given) = Option::<String>::deserialize(deserializer)? else { return Ok(None) };
    let known = Slot::ALL.into_iter().find(|slot| slot.name() == given);
    let unknown = || UnknownChoice { given, accepted: Slot::ALL.map(Slot::name).to_vec() };
    known.map(Some).ok_or_else(|| D::Error::custom(unknown()))
}

/// The key `slot` of `[[process]]`, written.
pub(crate) fn serialize<S: Serializer>(slot: &Option<Slot>, serializer: S) -> Result<S::Ok, S::Error> {
    slot.map(Slot::name).serialize(serializer)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Debug, serde::Deserialize, serde::Serialize)]
    struct Section {
        #[serde(default, with = "super")]
        slot: Option<Slot>,
    }

    #[test]
    fn a_slot_is_read_and_written_by_its_name() {
        for (text, slot) in [("", None), ("slot = \"a\"\n", Some(Slot::A)), ("slot = \"b\"\n", Some(Slot::B))] {
            let section: Section = toml::from_str(text).unwrap();
            assert_eq!(section.slot, slot);
            assert_eq!(toml::to_string(&section).unwrap(), text);
        }
        let refused = toml::from_str::<Section>("slot = \"c\"").unwrap_err();
        let unknown = UnknownChoice { given: "c".into(), accepted: vec!["a", "b"] };
        assert_eq!(refused.message(), unknown.to_string());
    }

    #[test]
    fn arguments_accept_exactly_the_names() {
        let command = clap::Command::new("x")
            .arg(clap::Arg::new("role").value_parser(slot_role_argument()))
            .arg(clap::Arg::new("slot").value_parser(slot_argument()));
        for role in SlotRole::ALL {
            for slot in Slot::ALL {
                let given = command.clone().get_matches_from(["x", Role::from(role).name(), slot.name()]);
                assert_eq!(given.get_one::<SlotRole>("role"), Some(&role));
                assert_eq!(given.get_one::<Slot>("slot"), Some(&slot));
            }
        }
        assert!(command.clone().try_get_matches_from(["x", "planner"]).is_err());
        assert!(command.try_get_matches_from(["x", "controller", "c"]).is_err());
    }
}
