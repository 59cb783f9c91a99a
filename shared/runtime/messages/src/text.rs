//! Short texts in fixed arrays: UTF-8, padded with zeros.

/// Writes as much of `text` as fits, cut at a character boundary, the rest zero.
pub fn put_text(into: &mut [u8], text: &str) {
    let mut end = text.len().min(into.len());
    while !text.is_char_boundary(end) {
        end -= 1;
    }
    into.fill(0);
    into[..end].copy_from_slice(&text.as_bytes()[..end]);
}

/// Mark of the place where a sentence was shortened.
pub const MORE: &str = " ...";

/// Returns the number of bytes of whole words of a text within `room` bytes; of one long word, of whole characters.
#[must_use]
pub fn words_within(text: &str, room: usize) -> usize {
    let space = text.bytes().take(room + 1).rposition(|byte| byte == b' ' || byte == b'\n');
    space.or_else(|| (0..=room).rev().find(|end| text.is_char_boundary(*end))).unwrap_or(0)
}

/// Returns where a sentence of more than `room` bytes is shortened: the text before the first number and from the
/// second one on is kept, with [`MORE`] between them.
///
/// A sentence ends with its cure, behind the last `; ` or `: `. The end is therefore kept as far as it fits into two
/// thirds of the room. Of a sentence without such a mark the beginning is kept.
#[must_use]
pub fn parted(text: &str, room: usize) -> (usize, usize) {
    let most = (room * 2 / 3).min(room.saturating_sub(MORE.len()));
    let tail = |mark: &str| text.match_indices(mark).map(|(at, _)| at).find(|at| text.len() - at <= most);
    let from = tail("; ").or_else(|| tail(": ")).unwrap_or(text.len());
    let end = words_within(text, room.saturating_sub(MORE.len() + text.len() - from));
    (end, from)
}

/// Writes a sentence: whole if it fits, otherwise its beginning, [`MORE`], and its end with the cure; see [`parted`].
pub fn put_sentence(into: &mut [u8], text: &str) {
    if text.len() <= into.len() || into.len() < MORE.len() {
        return put_text(into, text);
    }
    let (end, from) = parted(text, into.len());
    put_text(into, &text[..end]);
    let rest = &text.as_bytes()[from..];
    into[end..end + MORE.len()].copy_from_slice(MORE.as_bytes());
    into[end + MORE.len()..end + MORE.len() + rest.len()].copy_from_slice(rest);
}

/// Returns the text up to the first zero; invalid UTF-8 is replaced.
#[must_use]
pub fn text_of(from: &[u8]) -> String {
    let end = from.iter().position(|byte| *byte == 0).unwrap_or(from.len());
    String::from_utf8_lossy(&from[..end]).into_owned()
}

/// Returns the name of one of several values from names separated by commas; a single name is that of each value.
///
/// ```
/// assert_eq!(messages::name_at("humidity, temperature", 1), "temperature");
/// assert_eq!(messages::name_at("m", 2), "m");
/// assert_eq!(messages::name_at("humidity, temperature", 2), "");
/// ```
#[must_use]
pub fn name_at(names: &str, index: usize) -> &str {
    let only = names.split_once(',').is_none().then_some(names);
    only.or_else(|| names.split(',').nth(index)).unwrap_or_default().trim()
}

/// Returns two lower-case hexadecimal digits for each byte.
///
/// ```
/// assert_eq!(messages::hex(&[0x00, 0x1f, 0xe0]), "001fe0");
/// ```
#[must_use]
pub fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
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

    #[test]
    fn a_sentence_is_never_cut_before_its_cure() {
        for (text, room, is) in [
            ("the file of the run cannot be written at all; make room", 36, "the file of the run ...; make room"),
            (
                "the disk is full: make room, and it goes on by itself; ask again",
                40,
                "the disk is full: make ...; ask again",
            ),
            ("ab cd ef gh ij kl mn: do this", 22, "ab cd ef ...: do this"),
            // A cure that exceeds its share is shortened like any other text.
            ("short; a cure that is longer than all of the room here", 20, "short; a cure ..."),
        ] {
            let mut field = vec![b'x'; room];
            put_sentence(&mut field, text);
            assert_eq!(text_of(&field), is, "{text} in {room}");
        }
    }

    #[test]
    fn no_sentence_is_longer_than_its_field() {
        let text = "Süß: ein; zwei drei; ".repeat(20);
        for room in 4..text.len() {
            let mut field = vec![b'x'; room];
            put_sentence(&mut field, &text);
            assert!(!text_of(&field).contains('\u{fffd}'), "{room}");
        }
    }
}
