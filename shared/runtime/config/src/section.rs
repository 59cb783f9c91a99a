//! Sections of configuration files: each key stands once, with its type, its default, its documentation and the values
//! that it accepts. The checks of files, `nims set` and the table of `docs/tuning.md` follow from this.

use crate::number::Given;
use crate::problem::Problem;
use std::fmt;

/// A key of a section.
#[derive(Debug, Clone, Copy)]
pub struct Key {
    /// Name in the file.
    pub name: &'static str,
    /// Documentation.
    pub about: &'static str,
    /// The accepted values, if they do not depend on other keys.
    pub accepted: Option<&'static Accepted>,
}

impl Key {
    /// Returns the first sentence of the documentation, without its full stop.
    #[must_use]
    pub fn summary(&self) -> &'static str {
        let about = self.about.trim();
        about.split(". ").next().unwrap_or(about).trim_end_matches('.')
    }
}

/// The values that a key accepts.
///
/// ```
/// use config::section::{above, between};
/// assert_eq!(between(0.05, 60.0, "s").to_string(), "0.05 to 60 s");
/// assert_eq!(above(0.0, 1.0, "m").to_string(), "above 0, at most 1 m");
/// assert_eq!(between(0.0, 0.5, "s").each("two times").to_string(), "two times of 0 to 0.5 s");
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Accepted {
    bounds: Bounds,
    unit: &'static str,
    entries: &'static str,
    live: bool,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Bounds {
    Between(f64, f64),
    Above(f64, f64),
    Switch,
}

/// Accepts numbers from `low` to `high`.
#[must_use]
pub const fn between(low: f64, high: f64, unit: &'static str) -> Accepted {
    Accepted { bounds: Bounds::Between(low, high), unit, entries: "", live: false }
}

/// Accepts numbers above `low`, at most `high`.
#[must_use]
pub const fn above(low: f64, high: f64, unit: &'static str) -> Accepted {
    Accepted { bounds: Bounds::Above(low, high), unit, entries: "", live: false }
}

/// Accepts `true` and `false`.
#[must_use]
pub const fn switch() -> Accepted {
    Accepted { bounds: Bounds::Switch, unit: "", entries: "", live: false }
}

impl Accepted {
    /// Accepts a list of these values; `entries` is its description, e.g. "two times".
    #[must_use]
    pub const fn each(self, entries: &'static str) -> Self {
        Self { entries, ..self }
    }

    /// Lets `nims set` change the key while the robot runs. The processes apply `[controller]` and `[estimator]` only.
    #[must_use]
    pub const fn live(self) -> Self {
        Self { live: true, ..self }
    }

    /// Returns whether `nims set` changes the key while the robot runs.
    #[must_use]
    pub const fn is_live(&self) -> bool {
        self.live
    }

    /// Returns whether the number is accepted.
    #[must_use]
    pub fn contains(&self, value: f64) -> bool {
        match self.bounds {
            Bounds::Between(low, high) => (low..=high).contains(&value),
            Bounds::Above(low, high) => value > low && value <= high,
            Bounds::Switch => true,
        }
    }

    /// Checks each number of a key.
    ///
    /// # Errors
    /// The first number that is not accepted, at the key of this table; an empty `table` stands for none.
    pub fn check(&self, table: &str, key: &str, value: &impl Numbers) -> Result<(), Problem> {
        let mut wrong = None;
        value.numbers(&mut |number| {
            if !self.contains(number) {
                wrong.get_or_insert(number);
            }
        });
        match wrong {
            None => Ok(()),
            Some(number) => {
                let key = if table.is_empty() { key.to_owned() } else { format!("{table}.{key}") };
                Err(Problem::with_clause(key, format!("is {}; accepted: {self}", Given(number))))
            }
        }
    }
}

impl fmt::Display for Accepted {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if !self.entries.is_empty() {
            write!(f, "{} of ", self.entries)?;
        }
        match self.bounds {
            Bounds::Between(low, high) => write!(f, "{} to {}", Given(low), Given(high))?,
            Bounds::Above(low, high) => write!(f, "above {}, at most {}", Given(low), Given(high))?,
            Bounds::Switch => f.write_str("true or false")?,
        }
        if self.unit.is_empty() { Ok(()) } else { write!(f, " {}", self.unit) }
    }
}

/// The numbers of a value.
pub trait Numbers {
    /// Calls `number` with each number of the value.
    fn numbers(&self, number: &mut dyn FnMut(f64));
}

macro_rules! integers {
    ($($integer:ty)+) => {
        $(impl Numbers for $integer {
            fn numbers(&self, number: &mut dyn FnMut(f64)) {
                number(*self as f64);
            }
        })+
    };
}

integers!(u8 u32 u64 usize);

impl Numbers for f64 {
    fn numbers(&self, number: &mut dyn FnMut(f64)) {
        number(*self);
    }
}

impl Numbers for bool {
    fn numbers(&self, _number: &mut dyn FnMut(f64)) {}
}

impl<T: Numbers> Numbers for Option<T> {
    fn numbers(&self, number: &mut dyn FnMut(f64)) {
        self.iter().for_each(|value| value.numbers(number));
    }
}

impl<T: Numbers> Numbers for Vec<T> {
    fn numbers(&self, number: &mut dyn FnMut(f64)) {
        self.iter().for_each(|value| value.numbers(number));
    }
}

impl<T: Numbers, const N: usize> Numbers for [T; N] {
    fn numbers(&self, number: &mut dyn FnMut(f64)) {
        self.iter().for_each(|value| value.numbers(number));
    }
}

/// Declares a section of a configuration file.
///
/// Each key has its documentation, its type, its default after `=`, and after `=>` the values that it accepts. A
/// section whose keys have no `=` has its own attributes of serde instead of a `Default`. The first sentence of the
/// documentation describes the key in the help of `nims set`.
///
/// ```
/// use config::section::{Key, above, between};
/// config::section! {
///     /// `[brake]`.
///     pub struct BrakeSection {
///         /// Time until the brake closes, s. The data sheet has it.
///         pub close_s: f64 = 0.1 => between(0.01, 2.0, "s").live(),
///         /// Name of its output.
///         pub output: String = "gpio4".to_owned(),
///     }
/// }
/// let section: BrakeSection = toml::from_str("close_s = 9.0").unwrap();
/// let problem = section.check_ranges("brake").unwrap_err();
/// assert_eq!(problem.to_string(), "`brake.close_s` is 9; accepted: 0.01 to 2 s");
/// assert_eq!(BrakeSection::KEYS[0].summary(), "Time until the brake closes, s");
/// assert!(BrakeSection::default().check_ranges("brake").is_ok());
/// ```
#[macro_export]
macro_rules! section {
    ($(#[$about:meta])* pub struct $section:ident {
        $($(#[doc = $doc:literal])+ $(#[serde($($serde:tt)*)])*
          pub $key:ident: $type:ty = $default:expr $(=> $accepted:expr)?,)+
    }) => {
        $(#[$about])*
        #[derive(Debug, Clone, PartialEq, ::serde::Deserialize, ::serde::Serialize)]
        #[serde(deny_unknown_fields, default)]
        pub struct $section {
            $($(#[doc = $doc])+ $(#[serde($($serde)*)])* pub $key: $type,)+
        }

        impl ::std::default::Default for $section {
            fn default() -> Self {
                Self { $($key: $default,)+ }
            }
        }

        $crate::section!(@keys $section { $($key [$($doc)+] [$($accepted)?])+ });
    };
    ($(#[$about:meta])* pub struct $section:ident {
        $($(#[doc = $doc:literal])+ $(#[serde($($serde:tt)*)])* pub $key:ident: $type:ty $(=> $accepted:expr)?,)+
    }) => {
        $(#[$about])*
        #[derive(Debug, Clone, ::serde::Deserialize)]
        #[serde(deny_unknown_fields)]
        pub struct $section {
            $($(#[doc = $doc])+ $(#[serde($($serde)*)])* pub $key: $type,)+
        }

        $crate::section!(@keys $section { $($key [$($doc)+] [$($accepted)?])+ });
    };
    (@keys $section:ident { $($key:ident [$($doc:literal)+] [$($accepted:expr)?])+ }) => {
        impl $section {
            /// Every key.
            pub const KEYS: &'static [$crate::section::Key] = &[$($crate::section::Key {
                name: stringify!($key),
                about: concat!($($doc),+),
                accepted: $crate::section!(@one $($accepted)?),
            },)+];

            /// Checks the values that do not depend on other keys; `table` is the name of the section.
            ///
            /// # Errors
            /// A value out of range.
            pub fn check_ranges(&self, table: &str) -> ::std::result::Result<(), $crate::Problem> {
                let _ = table;
                $($({
                    const ACCEPTED: $crate::section::Accepted = $accepted;
                    ACCEPTED.check(table, stringify!($key), &self.$key)?;
                })?)+
                Ok(())
            }
        }
    };
    (@one) => { ::std::option::Option::None };
    (@one $accepted:expr) => { ::std::option::Option::Some(&const { $accepted }) };
}
