//! Choices: keys whose value is one of a few names. Each choice is one enum, which is the only definition of its names.

/// Jaro similarity above which the error suggests an accepted name; the threshold that clap uses.
const SIMILAR: f64 = 0.7;

/// Start of the clause about a name that is not accepted; a clause with this start directly follows the key.
pub(crate) const IS: &str = "is ";

/// A name that is not accepted. The message is a clause that follows the key.
///
/// ```
/// let error = "previw".parse::<config::ControlLaw>().unwrap_err();
/// let sentence = r#"is "previw"; accepted: lq-endpoint, preview, p-feedforward; did you mean preview?"#;
/// assert_eq!(error.to_string(), sentence);
/// ```
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{IS}\"{given}\"; accepted: {}{}", accepted.join(", "), self.suggestion())]
pub struct UnknownChoice {
    /// The name in the file.
    pub given: String,
    /// The accepted names.
    pub accepted: Vec<&'static str>,
}

impl UnknownChoice {
    fn suggestion(&self) -> String {
        let similarity = |name: &&'static str| (strsim::jaro(&self.given, name), *name);
        let nearest = self.accepted.iter().map(similarity).max_by(|one, other| one.0.total_cmp(&other.0));
        nearest
            .filter(|(similarity, _)| *similarity > SIMILAR)
            .map_or_else(String::new, |(_, name)| format!("; did you mean {name}?"))
    }
}

/// Declares a choice: an enum with a name for each value, for files, sentences and the process table.
///
/// ```
/// config::choice! {
///     /// Side on which the cable leaves its pulley.
///     pub enum Exit {
///         /// Over the top.
///         Top = "top",
///         /// From below.
///         Bottom = "bottom",
///     }
/// }
/// assert_eq!("top".parse(), Ok(Exit::Top));
/// assert_eq!(Exit::NAMES, ["top", "bottom"]);
/// assert_eq!(Exit::Bottom.name(), "bottom");
/// ```
#[macro_export]
macro_rules! choice {
    ($(#[$about:meta])* pub enum $choice:ident { $($(#[$value_about:meta])* $value:ident = $name:literal,)+ }) => {
        $(#[$about])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq, ::serde::Deserialize, ::serde::Serialize)]
        #[serde(try_from = "::std::string::String")]
        pub enum $choice {
            $($(#[$value_about])* #[serde(rename = $name)] $value,)+
        }

        impl $choice {
            /// Every value.
            pub const ALL: &'static [Self] = &[$(Self::$value),+];
            /// The name of every value, in the same order.
            pub const NAMES: &'static [&'static str] = &[$($name),+];

            /// Returns the name in configuration files.
            #[must_use]
            pub const fn name(self) -> &'static str {
                match self {
                    $(Self::$value => $name,)+
                }
            }
        }

        impl ::std::fmt::Display for $choice {
            fn fmt(&self, f: &mut ::std::fmt::Formatter<'_>) -> ::std::fmt::Result {
                f.write_str(self.name())
            }
        }

        impl ::std::str::FromStr for $choice {
            type Err = $crate::UnknownChoice;

            fn from_str(name: &str) -> ::std::result::Result<Self, Self::Err> {
                let known = Self::ALL.iter().find(|value| value.name() == name);
                known.copied().ok_or_else(|| $crate::UnknownChoice { given: name.to_owned(), accepted: Self::NAMES.to_vec() })
            }
        }

        impl ::std::convert::TryFrom<::std::string::String> for $choice {
            type Error = $crate::UnknownChoice;

            fn try_from(name: ::std::string::String) -> ::std::result::Result<Self, Self::Error> {
                name.parse()
            }
        }
    };
}
