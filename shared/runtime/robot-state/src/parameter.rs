//! Parameters of reasons: how each type stands in the numbers, values and texts of a sample.

use std::fmt::{self, Display, Formatter};

use arrayvec::ArrayString;
use messages::faults::Faults;
use messages::{DETAIL_BYTES, MORE, RequestAnswer, Slot, SlotRole, parted, put_sentence, text_of};

use crate::sentences::StandbyRefusal;

/// Text parameter of a reason.
pub type Detail = ArrayString<DETAIL_BYTES>;

/// Text of a reason or of its parameter, in a fixed place: nothing is allocated. A text that does not fit loses what
/// stands before its cure: see [`parted`].
#[must_use]
pub fn detail(text: impl Display) -> Detail {
    use fmt::Write;
    struct Cut<'a>(&'a mut ArrayString<{ 4 * DETAIL_BYTES }>);
    impl Write for Cut<'_> {
        fn write_str(&mut self, text: &str) -> fmt::Result {
            let mut end = text.len().min(self.0.remaining_capacity());
            while !text.is_char_boundary(end) {
                end -= 1;
            }
            self.0.push_str(&text[..end]);
            Ok(())
        }
    }
    let mut draft = ArrayString::new();
    // Cut never fails.
    let _ = write!(Cut(&mut draft), "{text}");
    within(&draft, DETAIL_BYTES)
}

/// Text of at most `room` bytes, which are at most [`DETAIL_BYTES`].
fn within(text: &str, room: usize) -> Detail {
    let mut detail = Detail::new();
    let (end, from) = if text.len() > room { parted(text, room) } else { (text.len(), text.len()) };
    let parts = [&text[..end], if from > end { MORE } else { "" }, &text[from..]];
    // They fit: `parted` leaves room for all three.
    parts.iter().for_each(|part| detail.push_str(part));
    detail
}

/// Texts with separators in at most `room` bytes: if they do not fit, each gets the same share.
fn texts_within(texts: &str, room: usize) -> Detail {
    if texts.len() <= room {
        return within(texts, room);
    }
    let count = texts.split(SEPARATOR).count();
    let share = (room + 1) / count - 1;
    let mut shortened = Detail::new();
    for (i, text) in texts.split(SEPARATOR).enumerate() {
        if i > 0 {
            shortened.push(SEPARATOR);
        }
        shortened.push_str(&within(text, share));
    }
    shortened
}

/// A parameter of a reason, as it stands in the sample.
pub(crate) trait Parameter: Sized {
    fn encode(&self, into: &mut Writer<'_>);
    fn decode(from: &mut Reader<'_>) -> Option<Self>;
    #[cfg(test)]
    fn example() -> Self;
}

/// Separates the texts of a reason with several: ASCII's own character for that.
const SEPARATOR: char = '\u{1f}';

/// Writes parameters in their order.
pub(crate) struct Writer<'a> {
    answer: &'a mut RequestAnswer,
    /// Counts of the parameters written so far.
    pub(crate) numbers: usize,
    pub(crate) values: usize,
    texts: usize,
    text: Detail,
}

impl<'a> Writer<'a> {
    pub(crate) fn new(answer: &'a mut RequestAnswer) -> Self {
        Self { answer, numbers: 0, values: 0, texts: 0, text: Detail::new() }
    }

    fn number(&mut self, number: u64) {
        if let Some(place) = self.answer.number.get_mut(self.numbers) {
            *place = number;
        }
        self.numbers += 1;
    }

    fn value(&mut self, value: f64) {
        if let Some(place) = self.answer.value.get_mut(self.values) {
            *place = value;
        }
        self.values += 1;
    }
}

/// Reads parameters in their order.
pub(crate) struct Reader<'a> {
    answer: &'a RequestAnswer,
    numbers: usize,
    values: usize,
    texts: usize,
}

impl<'a> Reader<'a> {
    pub(crate) fn new(answer: &'a RequestAnswer) -> Self {
        Self { answer, numbers: 0, values: 0, texts: 0 }
    }

    fn number(&mut self) -> Option<u64> {
        self.numbers += 1;
        self.answer.number.get(self.numbers - 1).copied()
    }

    fn value(&mut self) -> Option<f64> {
        self.values += 1;
        self.answer.value.get(self.values - 1).copied()
    }
}

macro_rules! number {
    ($($type:ty),*) => { $(impl Parameter for $type {
        fn encode(&self, into: &mut Writer<'_>) {
            into.number(*self as u64);
        }
        fn decode(from: &mut Reader<'_>) -> Option<Self> {
            Self::try_from(from.number()?).ok()
        }
        #[cfg(test)]
        fn example() -> Self {
            3
        }
    })* };
}
number!(u8, u32, u64, usize);

impl Parameter for bool {
    fn encode(&self, into: &mut Writer<'_>) {
        into.number(u64::from(*self));
    }
    fn decode(from: &mut Reader<'_>) -> Option<Self> {
        from.number().map(|number| number == 1)
    }
    #[cfg(test)]
    fn example() -> Self {
        true
    }
}

impl Parameter for f64 {
    fn encode(&self, into: &mut Writer<'_>) {
        into.value(*self);
    }
    fn decode(from: &mut Reader<'_>) -> Option<Self> {
        from.value()
    }
    #[cfg(test)]
    fn example() -> Self {
        0.25
    }
}

impl Parameter for [f64; 3] {
    fn encode(&self, into: &mut Writer<'_>) {
        self.iter().for_each(|value| into.value(*value));
    }
    fn decode(from: &mut Reader<'_>) -> Option<Self> {
        Some([from.value()?, from.value()?, from.value()?])
    }
    #[cfg(test)]
    fn example() -> Self {
        [1.0, -2.5, 0.75]
    }
}

/// A number, 1 if the parameter exists, and then the parameter.
impl<T: Parameter> Parameter for Option<T> {
    fn encode(&self, into: &mut Writer<'_>) {
        self.is_some().encode(into);
        self.iter().for_each(|value| value.encode(into));
    }
    fn decode(from: &mut Reader<'_>) -> Option<Self> {
        if bool::decode(from)? { T::decode(from).map(Some) } else { Some(None) }
    }
    #[cfg(test)]
    fn example() -> Self {
        Some(T::example())
    }
}

impl<A: Parameter, B: Parameter> Parameter for (A, B) {
    fn encode(&self, into: &mut Writer<'_>) {
        self.0.encode(into);
        self.1.encode(into);
    }
    fn decode(from: &mut Reader<'_>) -> Option<Self> {
        Some((A::decode(from)?, B::decode(from)?))
    }
    #[cfg(test)]
    fn example() -> Self {
        (A::example(), B::example())
    }
}

/// Parameters that are recorded as their index in `ALL`; each with its example for tests.
macro_rules! by_index {
    ($($kind:ident: $example:ident),+) => {$(
        impl Parameter for $kind {
            fn encode(&self, into: &mut Writer<'_>) {
                self.index().encode(into);
            }
            fn decode(from: &mut Reader<'_>) -> Option<Self> {
                Self::ALL.get(usize::decode(from)?).copied()
            }
            #[cfg(test)]
            fn example() -> Self {
                Self::$example
            }
        }
    )+};
}

by_index!(SlotRole: Estimator, Slot: B);

/// The bits, and the cables and units as masks.
impl Parameter for Faults {
    fn encode(&self, into: &mut Writer<'_>) {
        let mask = |named: &[bool]| named.iter().rev().fold(0_u64, |mask, named| mask << 1 | u64::from(*named));
        self.bits.encode(into);
        into.number(mask(&self.cables));
        into.number(mask(&self.units));
    }
    fn decode(from: &mut Reader<'_>) -> Option<Self> {
        let bits = u32::decode(from)?;
        let (cables, units) = (from.number()?, from.number()?);
        let named = |mask: u64| std::array::from_fn(|i| mask >> i & 1 == 1);
        Some(Self { bits, cables: named(cables), units: named(units), ..Self::default() })
    }
    #[cfg(test)]
    fn example() -> Self {
        let mut faults = Self::default();
        faults.cable(messages::MotorAuthority::FAULT_SLACK, 2);
        faults.unit(messages::MotorAuthority::FAULT_SUPPLY, 1);
        faults
    }
}

impl Parameter for StandbyRefusal {
    fn encode(&self, into: &mut Writer<'_>) {
        self.role.encode(into);
        self.phase.encode(into);
        self.cause.encode(into);
        self.verdict.encode(into);
        self.well_s.encode(into);
        self.qualify_s.encode(into);
        self.moves_off.encode(into);
    }
    fn decode(from: &mut Reader<'_>) -> Option<Self> {
        Some(Self {
            role: usize::decode(from)?,
            phase: u8::decode(from)?,
            cause: u8::decode(from)?,
            verdict: u8::decode(from)?,
            well_s: f64::decode(from)?,
            qualify_s: f64::decode(from)?,
            moves_off: Parameter::decode(from)?,
        })
    }
    #[cfg(test)]
    fn example() -> Self {
        let phase = messages::MotorSlots::PHASE_SHADOW;
        Self { role: 1, phase, cause: 4, verdict: 2, well_s: 0.0, qualify_s: 1.0, moves_off: Some((0.5, 2.0)) }
    }
}

/// A text without the separator of texts.
struct OneText<'a>(&'a str);

impl Display for OneText<'_> {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        self.0.split(SEPARATOR).try_for_each(|part| f.write_str(part))
    }
}

/// The texts of a reason stand one after the other.
impl Parameter for Detail {
    fn encode(&self, into: &mut Writer<'_>) {
        let text = detail(OneText(self));
        into.text = match into.texts {
            0 => text,
            _ => {
                const ROOM: usize = DETAIL_BYTES - SEPARATOR.len_utf8();
                // The last text usually has the cause and the cure: it gets at least half.
                let before = texts_within(&into.text, ROOM.saturating_sub(text.len()).max(ROOM / 2));
                let text = within(&text, ROOM - before.len());
                detail(format_args!("{before}{SEPARATOR}{text}"))
            }
        };
        into.texts += 1;
        put_sentence(&mut into.answer.detail, &into.text);
    }
    fn decode(from: &mut Reader<'_>) -> Option<Self> {
        from.texts += 1;
        text_of(&from.answer.detail).split(SEPARATOR).nth(from.texts - 1).map(detail)
    }
    #[cfg(test)]
    fn example() -> Self {
        detail("this is why; do that")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn several_texts_travel_in_one_field() {
        let mut answer = RequestAnswer::default();
        let texts = ["one", "", "th\u{1f}ree"].map(detail);
        texts.iter().fold(Writer::new(&mut answer), |mut into, text| {
            text.encode(&mut into);
            into
        });
        let mut from = Reader::new(&answer);
        let decoded: Vec<Option<Detail>> = (0..4).map(|_| Detail::decode(&mut from)).collect();
        assert_eq!(decoded, [Some(detail("one")), Some(detail("")), Some(detail("three")), None]);
    }

    #[test]
    fn long_texts_are_shortened_and_none_is_lost() {
        for lengths in [[400, 400, 0], [400, 3, 400], [3, 500, 500], [512, 512, 512]] {
            let mut answer = RequestAnswer::default();
            let texts = lengths.map(|length| detail("word ".repeat(length / 5 + 1)));
            texts.iter().fold(Writer::new(&mut answer), |mut into, text| {
                text.encode(&mut into);
                into
            });
            let mut from = Reader::new(&answer);
            for text in texts {
                let decoded = Detail::decode(&mut from).unwrap();
                let start = decoded.trim_end_matches(MORE).trim_end();
                assert!(text.starts_with(start) && start.len() >= text.len().min(60) - 5, "{lengths:?}: {decoded}");
            }
        }
    }

    #[test]
    fn a_long_sentence_ends_at_a_word_or_at_least_a_character() {
        let words = detail(format!("{} end.", "word ".repeat(200)));
        assert!(words.ends_with("word ...") && words.len() > DETAIL_BYTES - 10, "{words}");
        assert!(detail("ü".repeat(400)).ends_with("ü ..."));
        let whole = "x".repeat(DETAIL_BYTES);
        assert_eq!(detail(&whole).as_str(), whole);
    }
}
