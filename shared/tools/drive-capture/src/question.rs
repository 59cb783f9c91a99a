//! Which bytes of a program a drive answers, and which of its bytes begin the answer.
//!
//! A program sends several questions together, and a drive answers the first of them while the others are still on the
//! wire. So the time of an answer counts from the end of the first question that has one.

/// Commands of ODrive that its firmware executes in silence.
const SILENT: [&[u8]; 12] = [b"p", b"q", b"v", b"c", b"t", b"u", b"w", b"sc", b"sr", b"ss", b"se", b"sb"];
/// Begin of what the adapter of a moteus passes on to a unit, and of what the unit answers. The adapter's own word
/// before it says nothing about the unit.
const PASSED_ON: &[u8] = b"can send";
const RECEIVED: &[u8] = b"rcv";
/// Fewer bytes that are the same as those of the question may be an answer.
const LEAST_ECHO: usize = 4;

/// What a program sent before the drive said something.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Asked {
    /// Commands that no drive answers.
    Nothing,
    /// A question that ends before the byte at `end`; its answer begins with `answer`.
    Question { end: usize, answer: &'static [u8] },
}

/// Finds the first question that a drive answers. Bytes that are no text are one question, as a packet is.
pub(crate) fn first_question(bytes: &[u8]) -> Asked {
    let is_text = |byte: &u8| byte.is_ascii_graphic() || byte.is_ascii_whitespace();
    let whole = Asked::Question { end: bytes.len(), answer: b"" };
    if !bytes.iter().all(is_text) {
        return whole;
    }
    let mut begin = 0;
    while let Some(length) = bytes[begin..].iter().position(|byte| matches!(byte, b'\r' | b'\n')) {
        let line = bytes[begin..begin + length].trim_ascii();
        begin += length + 1;
        if !line.is_empty() && !is_silent(line) {
            let answer = if line.starts_with(PASSED_ON) { RECEIVED } else { b"" };
            return Asked::Question { end: begin, answer };
        }
    }
    // A question that is cut off, as by a recorder that was ended.
    if bytes[begin..].trim_ascii().is_empty() { Asked::Nothing } else { whole }
}

/// True for a command without an answer. A Roboteq answers every line but those about its history.
fn is_silent(line: &[u8]) -> bool {
    let word = line.split(u8::is_ascii_whitespace).next().unwrap_or_default();
    SILENT.contains(&word) || line.starts_with(b"#")
}

/// Place of the first byte of the answer that begins with `start`, in what came after `question`. An echo is none.
pub(crate) fn begin_of(came: &[u8], question: &[u8], start: &[u8]) -> Option<usize> {
    let same = came.iter().zip(question).take_while(|(came, sent)| came == sent).count();
    let echoed = if same < LEAST_ECHO { 0 } else { same };
    let answer = &came[echoed..];
    let place = if start.is_empty() { 0 } else { answer.windows(start.len()).position(|window| window == start)? };
    (place < answer.len()).then_some(echoed + place)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_question_with_an_answer_is_found() {
        let ends =
            |bytes: &[u8], end| assert_eq!(first_question(bytes), Asked::Question { end, answer: b"" }, "{bytes:?}");
        // RoboClaw: a packet, whatever bytes are in it.
        ends(&[0x80, 0x0d, 0x0a, 0x31], 4);
        // ODrive: commands are silent.
        ends(b"f 77*63\nr axis0.error*12\n", 8);
        ends(b"v 0 1.5*11\nw axis0.error 0\nr vbus_voltage\nr axis0.error\n", 40 + 2);
        assert_eq!(first_question(b"v 0 1.5\nu 0\n"), Asked::Nothing);
        // Roboteq: commands are answered too.
        ends(b"!M 10 0\r?C\r", 8);
        ends(b"# C\r?V\r", 7);
        // moteus: the unit answers, not its adapter.
        let frame = b"can send 8001 01000A E B F\ncan send 8002 11\n";
        assert_eq!(first_question(frame), Asked::Question { end: 27, answer: RECEIVED });
        ends(b"can on\ncan send 8001 11\n", 7);
        let begin = |came: &[u8], start| begin_of(came, b"^ECHOF 1\r?C\r", start);
        assert_eq!(begin(b"OK\r\nrcv 0180 23\r\n", RECEIVED), Some(4));
        assert_eq!((begin(b"OK\r\nrc", RECEIVED), begin(b"", b""), begin(b"x", b"")), (None, None, Some(0)));
        // An echo comes while the question goes out.
        assert_eq!((begin(b"^ECHOF 1\r+\r", b""), begin(b"^ECHO", b""), begin(b"^E", b"")), (Some(9), None, Some(0)));
        // The end of a line, and one that is cut off.
        assert_eq!(first_question(b"\r\n"), Asked::Nothing);
        ends(b"v 0 1\r\nr vbus", 13);
    }
}
