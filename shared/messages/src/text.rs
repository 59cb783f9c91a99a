//! Short texts in fixed arrays: UTF-8, filled up with zeros.

/// Writes as much of `text` as fits, cut at a character boundary, the rest zero.
pub fn put_text(into: &mut [u8], text: &str) {
    let mut end = text.len().min(into.len());
    while !text.is_char_boundary(end) {
        end -= 1;
    }
    into.fill(0);
    into[..end].copy_from_slice(&text.as_bytes()[..end]);
}

/// What stands at the end of a sentence that was cut.
pub const MORE: &str = " ...";

/// How many bytes of a text longer than `room` bytes are whole words within them; of one long word, whole characters.
#[must_use]
pub fn words_within(text: &str, room: usize) -> usize {
    let space = text.bytes().take(room + 1).rposition(|byte| byte == b' ' || byte == b'\n');
    space.or_else(|| (0..=room).rev().find(|end| text.is_char_boundary(*end))).unwrap_or(0)
}

/// Writes a sentence for people: whole if it fits, otherwise as many of its words as fit and [`MORE`].
pub fn put_sentence(into: &mut [u8], text: &str) {
    if text.len() <= into.len() || into.len() < MORE.len() {
        return put_text(into, text);
    }
    let end = words_within(text, into.len() - MORE.len());
    put_text(into, &text[..end]);
    into[end..end + MORE.len()].copy_from_slice(MORE.as_bytes());
}

/// The text up to the first zero; damaged UTF-8 is replaced, never refused.
#[must_use]
pub fn text_of(from: &[u8]) -> String {
    let end = from.iter().position(|byte| *byte == 0).unwrap_or(from.len());
    String::from_utf8_lossy(&from[..end]).into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sentence_that_is_too_long_ends_at_a_word_and_says_so() {
        for (text, room, is) in [
            ("all of it", 9, "all of it"),
            ("all of it, and more", 12, "all of ..."),
            ("all of it, and more", 14, "all of it, ..."),
            ("Süßwasserfluss", 8, "Sü ..."),
            ("long", 3, "lon"),
        ] {
            let mut field = vec![b'x'; room];
            put_sentence(&mut field, text);
            assert_eq!(text_of(&field), is, "{text} in {room}");
        }
    }
}
