//! Converts recorded samples to this build's types. If the definition has changed since, fields are copied by name and
//! new fields are zero.

use messages::Message;
use messages::schema::{Schema, SchemaField, Value, is_same};

/// Conversion from the definition in a run file to this build's definition.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Conversion {
    same: bool,
    spans: Vec<Span>,
}

#[derive(Debug, Clone, PartialEq, Eq)]
struct Span {
    from: usize,
    to: usize,
    bytes: usize,
}

/// Fields that had another name in earlier builds.
const RENAMED: [(&str, &str); 7] = [
    ("based_on_authority", "seen_authority"),
    ("based_on_estimate", "seen_estimate"),
    ("based_on_motion", "seen_motion"),
    ("based_on_state", "seen_state"),
    ("deviation", "apart"),
    ("failures", "falls"),
    ("good_cycles", "well_cycles"),
];

fn earlier_name(name: &str) -> Option<&'static str> {
    RENAMED.iter().find(|(now, _)| *now == name).map(|(_, earlier)| *earlier)
}

impl Conversion {
    /// `None` if the type is a different one, or its definition cannot be parsed. `type_name` is e.g.
    /// `nims_msgs/MotorState/1a2b3c4d`.
    #[must_use]
    pub fn new<T: Message>(type_name: &str, schema: &str) -> Option<Self> {
        if is_same(schema, T::schema()) {
            return Some(Self { same: true, spans: Vec::new() });
        }
        let mut names = type_name.split('/');
        if (names.next(), names.next()) != (Some("nims_msgs"), Some(T::NAME)) {
            return None;
        }
        let (was, is) = (Schema::parse(schema).ok()?, Schema::parse(T::schema()).ok()?);
        let span = |field: &SchemaField| {
            let old = was.field(&field.path).or_else(|| was.field(earlier_name(&field.path)?));
            let old = old.filter(|old| old.primitive == field.primitive)?;
            Some(Span { from: old.offset, to: field.offset, bytes: field.size().min(old.size()) })
        };
        Some(Self { same: false, spans: is.fields().iter().filter_map(span).collect() })
    }

    /// True if the recorded definition equals this build's.
    #[must_use]
    pub fn is_same(&self) -> bool {
        self.same
    }

    /// The sample as this build's type; `None` if bytes are missing.
    #[must_use]
    pub fn apply<T: Message>(&self, sample: &[u8]) -> Option<T> {
        if self.same {
            return (sample.len() == size_of::<T>()).then(|| bytemuck::pod_read_unaligned(sample));
        }
        let mut value = T::zeroed();
        let bytes = bytemuck::bytes_of_mut(&mut value);
        for span in &self.spans {
            let from = sample.get(span.from..span.from + span.bytes)?;
            bytes.get_mut(span.to..span.to + span.bytes)?.copy_from_slice(from);
        }
        Some(value)
    }

    /// True if two samples of this build's type agree in all fields that were recorded.
    #[must_use]
    pub fn agree(&self, was: &[u8], is: &[u8]) -> bool {
        if self.same { was == is } else { self.spans.iter().all(|span| span.bytes(was) == span.bytes(is)) }
    }

    /// The first recorded field that differs: its name and both values.
    #[must_use]
    pub fn first_difference<T: Message>(&self, was: &[u8], is: &[u8]) -> Option<(String, String, String)> {
        let schema = Schema::parse(T::schema()).ok()?;
        schema.fields().iter().find_map(|field| {
            if !self.same && !self.spans.iter().any(|span| span.to == field.offset) {
                return None;
            }
            let bytes = field.offset..field.offset + field.size();
            let (old, new) = (was.get(bytes.clone())?, is.get(bytes)?);
            let at =
                old.chunks(field.primitive.size()).zip(new.chunks(field.primitive.size())).position(|(a, b)| a != b)?;
            let shown = |sample| Value::read(field, sample)?.numbers().nth(at).map(|number| number.to_string());
            let name = if field.count.is_some() { format!("{}[{at}]", field.path) } else { field.path.clone() };
            Some((name, shown(was)?, shown(is)?))
        })
    }
}

impl Span {
    fn bytes<'a>(&self, sample: &'a [u8]) -> Option<&'a [u8]> {
        sample.get(self.to..self.to + self.bytes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use messages::{MotorSlots, MotorState};

    /// A definition from a build without `life` and `published_ns` in the header.
    fn before() -> String {
        MotorState::schema().replace("uint64 life\n", "").replace("uint64 published_ns\n", "")
    }

    #[test]
    fn a_sample_with_an_older_header_is_read_by_the_names_of_its_fields() {
        let mut state = MotorState { cable_count: 3, length_m: [1.5; 8], ..MotorState::default() };
        (state.header.cycle, state.header.seq, state.header.oldest_input_ns) = (7, 8, 9);
        // life is the first field of the header, published_ns the fifth
        let bytes = bytemuck::bytes_of(&state);
        let old = [&bytes[8..32], &bytes[40..]].concat();
        let conversion = Conversion::new::<MotorState>("nims_msgs/MotorState/00000000", &before()).unwrap();
        assert!(!conversion.is_same());
        assert_eq!(conversion.apply::<MotorState>(&old), Some(state));
        assert_eq!(conversion.apply::<MotorState>(&old[..40]), None);
    }

    #[test]
    fn a_field_that_was_renamed_is_read_by_its_earlier_name() {
        let earlier = MotorSlots::schema().replace(" deviation\n", " apart\n").replace(" failures\n", " falls\n");
        let conversion = Conversion::new::<MotorSlots>("nims_msgs/MotorSlots/00000000", &earlier).unwrap();
        let slots = MotorSlots { deviation: [0.5; 4], failures: [1, 2, 3, 4], ..MotorSlots::default() };
        assert_eq!(conversion.apply::<MotorSlots>(bytemuck::bytes_of(&slots)), Some(slots));
    }

    #[test]
    fn another_type_is_not_converted() {
        assert_eq!(Conversion::new::<MotorState>("nims_msgs/MotorInput/00000000", &before()), None);
        assert_eq!(Conversion::new::<MotorState>("", &before()), None);
    }
}
