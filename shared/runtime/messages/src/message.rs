//! Traits and macros of samples: the schema text of a struct, and the type name that ends in its hash.

use bytemuck::Pod;

/// Type of a field: a number, a fixed array, or a struct of fields.
pub trait Field: Pod {
    /// Type of one element and of its constants.
    type Element;
    /// The ROS 2 name of one element, e.g. `float64` or `nims_msgs/Header`.
    const ROS: &'static str;
    /// Array length; `None` for a single value.
    const LENGTH: Option<usize> = None;
    /// Appends the definitions of nested types, each once, in order of first use.
    fn dependencies(_into: &mut Vec<(&'static str, String)>) {}
}

macro_rules! number {
    ($($rust:ty => $ros:literal),*) => { $(impl Field for $rust {
        type Element = $rust;
        const ROS: &'static str = $ros;
    })* };
}
number!(u8 => "uint8", i8 => "int8", u16 => "uint16", i16 => "int16", u32 => "uint32", i32 => "int32", u64 => "uint64",
        i64 => "int64", f32 => "float32", f64 => "float64");

impl<T: Field, const N: usize> Field for [T; N] {
    type Element = T::Element;
    const ROS: &'static str = T::ROS;
    const LENGTH: Option<usize> = Some(N);
    fn dependencies(into: &mut Vec<(&'static str, String)>) {
        T::dependencies(into);
    }
}

/// Sample of a channel.
pub trait Message: Field + Send + Sync {
    /// Name of the struct, e.g. `MotorState`.
    const NAME: &'static str;
    /// The complete ROS 2 definition, nested types included, with the documentation as comments.
    fn schema() -> &'static str;
    /// `nims_msgs/NAME/hash`: what peers compare before they connect. Comments do not change the hash.
    fn type_name() -> &'static str;
    /// The header at the beginning of the sample.
    fn header(&self) -> &Header;
    /// The header, to be filled in before the sample is published.
    fn header_mut(&mut self) -> &mut Header;
}

/// 32-bit FNV-1a hash of a text. Type names end in that of their definition without comments
/// ([`schema::without_comments`](crate::schema::without_comments)), as eight hexadecimal digits.
#[must_use]
pub fn hash_of(schema: &str) -> u32 {
    schema.bytes().fold(0x811c_9dc5, |hash, byte| (hash ^ u32::from(byte)).wrapping_mul(0x0100_0193))
}

/// Returns `pkg/msg/Type`, the name of the schema in a run file, for a type name `pkg/Type/hash` or `pkg/Type`; `None`
/// for other names.
#[must_use]
pub fn schema_name(type_name: &str) -> Option<String> {
    let mut parts = type_name.split('/');
    let (package, name) = (parts.next()?, parts.next()?);
    (!package.is_empty() && !name.is_empty() && parts.count() <= 1).then(|| format!("{package}/msg/{name}"))
}

/// Parts that the macros below expand to; not for direct use.
#[doc(hidden)]
pub mod expanded {
    pub use bytemuck;

    use super::Field;

    /// Appends the lines of a field: its documentation, its constants with theirs, and the field itself.
    pub fn line<T: Field>(text: &mut String, docs: &[&str], field: &str, constants: &[(&[&str], &str, u64)]) {
        comment(text, docs);
        for (docs, name, value) in constants {
            comment(text, docs);
            text.push_str(&format!("{} {name}={value}\n", T::ROS));
        }
        match T::LENGTH {
            Some(length) => text.push_str(&format!("{}[{length}] {field}\n", T::ROS)),
            None => text.push_str(&format!("{} {field}\n", T::ROS)),
        }
    }

    /// Appends documentation as comments.
    pub fn comment(text: &mut String, docs: &[&str]) {
        for line in docs {
            text.push('#');
            text.push_str(line);
            text.push('\n');
        }
    }

    /// Returns the complete text: own lines, then every nested definition behind a separator of 80 `=`.
    #[must_use]
    pub fn complete(own: &str, dependencies: &[(&'static str, String)]) -> String {
        let mut text = own.to_owned();
        for (name, lines) in dependencies {
            text.push_str(&format!("{}\nMSG: {name}\n{lines}", "=".repeat(80)));
        }
        text
    }
}

/// Declares a struct of fields: layout, schema lines and constants from one text. Doc comments become comments of the
/// definition, which readers of run files show.
///
/// Constants follow the field they belong to: `mode: u8 { MODE_DISARMED = 0, MODE_HOLDING = 1 }`. A crate that uses it
/// depends on this crate by the name `messages`. A struct with hidden padding does not compile: put wide fields first,
/// or add `pad0: [u8; 6]`.
#[macro_export]
macro_rules! layout {
    ($(#[doc = $outer:literal])* pub struct $name:ident { $( $(#[doc = $inner:literal])* $field:ident : $type:ty $({ $($(#[doc = $cdoc:literal])* $constant:ident = $value:literal),* $(,)? })? ),* $(,)? }) => {
        $(#[doc = $outer])*
        #[repr(C)]
        #[derive(Debug, Clone, Copy, PartialEq, $crate::expanded::bytemuck::Pod, $crate::expanded::bytemuck::Zeroable)]
        #[bytemuck(crate = "::messages::expanded::bytemuck")]
        #[allow(missing_docs)] // name and unit suffix are the documentation; other fields have a comment
        pub struct $name { $( $(#[doc = $inner])* pub $field: $type ),* }

        #[allow(missing_docs)] // choices of a field: the names are the documentation
        impl $name {
            $( $( $( $(#[doc = $cdoc])* pub const $constant: <$type as $crate::Field>::Element = $value; )* )? )*

            fn own_lines() -> String {
                let mut text = String::new();
                $crate::expanded::comment(&mut text, &[$( $outer ),*]);
                $( $crate::expanded::line::<$type>(&mut text, &[$( $inner ),*], stringify!($field), &[$( $( (&[$( $cdoc ),*] as &[&str], stringify!($constant), u64::from(Self::$constant)) ),* )?]); )*
                text
            }
        }

        impl Default for $name {
            fn default() -> Self { $crate::expanded::bytemuck::Zeroable::zeroed() }
        }

        impl $crate::Field for $name {
            type Element = Self;
            const ROS: &'static str = concat!("nims_msgs/", stringify!($name));
            fn dependencies(into: &mut Vec<(&'static str, String)>) {
                if into.iter().all(|(name, _)| *name != Self::ROS) {
                    into.push((Self::ROS, Self::own_lines()));
                    $( <$type as $crate::Field>::dependencies(into); )*
                }
            }
        }
    };
}

/// Declares a sample: a [`layout!`](crate::layout) whose first field is `header: Header`. A new type needs nothing
/// else.
///
/// ```
/// use messages::{Header, Message};
///
/// messages::message! {
///     /// Reading of a soil probe.
///     pub struct Soil {
///         header: Header,
///         temperature_c: f64,
///         moisture: [f64; 3],
///         state: u8 { STATE_DRY = 0, STATE_WET = 1 },
///         pad0: [u8; 7],
///     }
/// }
/// assert!(Soil::type_name().starts_with("nims_msgs/Soil/"));
/// assert!(Soil::schema().starts_with("# Reading of a soil probe.\nnims_msgs/Header header\n"));
/// assert!(Soil::schema().contains("float64[3] moisture\nuint8 STATE_DRY=0\n"));
/// ```
#[macro_export]
macro_rules! message {
    ($(#[doc = $outer:literal])* pub struct $name:ident { $($body:tt)* }) => {
        $crate::layout! { $(#[doc = $outer])* pub struct $name { $($body)* } }

        impl $crate::Message for $name {
            const NAME: &'static str = stringify!($name);
            fn schema() -> &'static str {
                static TEXT: std::sync::OnceLock<String> = std::sync::OnceLock::new();
                TEXT.get_or_init(|| {
                    let mut dependencies = Vec::new();
                    <Self as $crate::Field>::dependencies(&mut dependencies);
                    dependencies.remove(0);
                    $crate::expanded::complete(&Self::own_lines(), &dependencies)
                })
            }
            fn type_name() -> &'static str {
                static NAME: std::sync::OnceLock<String> = std::sync::OnceLock::new();
                NAME.get_or_init(|| {
                    let hash = $crate::hash_of(&$crate::schema::without_comments(Self::schema()));
                    format!("nims_msgs/{}/{hash:08x}", stringify!($name))
                })
            }
            fn header(&self) -> &$crate::Header { &self.header }
            fn header_mut(&mut self) -> &mut $crate::Header { &mut self.header }
        }
    };
}

layout! {
    /// Beginning of every sample.
    pub struct Header {
        /// Start of the motor-io that the sample belongs to, CLOCK_MONOTONIC, ns; 0 outside the control chain. A later
        /// life is a larger number. Cycles are compared only within a life.
        life: u64,
        /// Control cycle of the sample; 0 outside the control chain.
        cycle: u64,
        /// Number of the sample, counted per publisher; a step of more than one is a loss.
        seq: u64,
        /// Time at which the content was true, CLOCK_MONOTONIC, ns.
        stamp_ns: u64,
        /// Time of publication, CLOCK_MONOTONIC, ns; filled in by the publisher.
        published_ns: u64,
        /// Time of the oldest measurement that the content is based on, CLOCK_MONOTONIC, ns.
        oldest_input_ns: u64,
    }
}

impl Header {
    /// Header of a sample outside the control chain that is based on nothing older than `stamp_ns` (CLOCK_MONOTONIC).
    #[must_use]
    pub fn at(stamp_ns: u64) -> Self {
        Self { stamp_ns, oldest_input_ns: stamp_ns, ..Self::default() }
    }

    /// Copies the fields that the publisher fills in: number and time of publication.
    pub fn take_over_publication(&mut self, other: &Self) {
        (self.seq, self.published_ns) = (other.seq, other.published_ns);
    }
}
