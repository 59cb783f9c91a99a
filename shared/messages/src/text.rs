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

/// The text up to the first zero; damaged UTF-8 is replaced, never refused.
#[must_use]
pub fn text_of(from: &[u8]) -> String {
    let end = from.iter().position(|byte| *byte == 0).unwrap_or(from.len());
    String::from_utf8_lossy(&from[..end]).into_owned()
}
