//! One question at a time: the measurements so far and what is open of them. No input and output; the state is the measurements file.

use super::numbers::{self, excerpt};
use super::question::{self, POINTS, Question, pulleys};
use super::shape;
use super::text::metres;
use super::undo::undo;
use crate::calibrate::{Doubt, File, HeightBy, HeightEntry, PointEntry, RangeEntry, Setup};
use calibration::{CalibrationError, DEFAULT_SIGMA_LENGTH_M, Method, calibrate};

/// Standard deviation of a distance, m, written into a new file: a tape over ten metres between plumb lines, or a laser in hands that
/// are new to it.
const SIGMA_RANGE_M: f64 = 0.005;

/// Least and most points of a plan.
const FEWEST: usize = 3;
const MOST: usize = 60;

/// A length is spoken of that is off by more than this share of what was expected, and by more than [`FAR_M`].
const FAR_SHARE: f64 = 0.2;
/// As far as people stand beside a place, and a guessed height is off, m.
const FAR_M: f64 = 1.0;

/// Two lines may be too short to meet by so many standard deviations of a length.
const SHORT: f64 = 6.0;

/// What follows an answer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Then {
    /// The next question, or the same again.
    Ask,
    /// All is measured, and the calibration wanted.
    Finish,
    /// Nobody wants to go on now.
    Leave,
}

/// What becomes of an answer.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Reply {
    /// What to say; may be empty.
    pub said: String,
    /// The measurements changed and have to be kept.
    pub changed: bool,
    /// What follows.
    pub then: Then,
}

/// The measurements and the pending question.
#[derive(Debug, Clone, PartialEq)]
pub struct Guide {
    file: File,
    question: Question,
}

impl Default for Guide {
    fn default() -> Self {
        let file = File { setup: Some(Setup::default()), sigma_range_m: Some(SIGMA_RANGE_M), ..File::default() };
        Self { question: Question::next(&file), file }
    }
}

impl Guide {
    /// Goes on with measurements that were begun.
    ///
    /// # Errors
    /// One clause, without the file's name: why they cannot be gone on with.
    pub fn resume(file: File) -> Result<Self, String> {
        let Some(setup) = &file.setup else {
            return Err("it has no [setup], so nims setup has not begun it and would lose the comments in it; name a new file, \
                        or take this one to nims calibrate"
                .to_owned());
        };
        let count = setup.pulleys.unwrap_or(0);
        if setup.pulleys.is_some_and(|count| !(3..=cable_robot::MAX_CABLES).contains(&count)) {
            return Err(format!("pulleys is {count}; accepted: 3 to {}", cable_robot::MAX_CABLES));
        }
        let named = file.range.iter().flat_map(|r| [r.from, r.to]).chain(file.height.iter().map(|h| h.anchor));
        let plans = setup.skipped.iter().flatten().chain(&setup.unmeasured).copied();
        if let Some(other) = named.chain(plans).find(|pulley| !(1..=count).contains(pulley)) {
            return Err(format!("it names pulley {other}; there are {count}"));
        }
        if file.point.iter().any(|point| point.lengths_m.len() != count) || setup.lengths_so_far_m.len() > count {
            return Err(format!("a [[point]] does not have one length for each of the {count} pulleys"));
        }
        let points = file.point.len();
        let odd = |doubt: &Doubt| !(1..=doubt.after).contains(&doubt.point) || doubt.after > points;
        if file.doubt.iter().any(odd) || setup.plan.iter().any(|plan| plan[0] > points || plan[1] > 2 * MOST) {
            return Err("a [[doubt]] or the plan is about points that are not there".to_owned());
        }
        if count > 0 {
            let measured = file.measurements(Method::Survey)?;
            let question =
                Question::next(&File { setup: Some(Setup { plan: Vec::new(), ..setup.clone() }), ..file.clone() });
            let placed = !matches!(question, Question::Pulleys | Question::Distance { .. } | Question::Side { .. });
            if placed {
                shape::survey(&file, count)?;
            }
            // Points before the pulleys have a place cannot be made sense of.
            if !matches!(question, Question::Points) && (points > 0 || !setup.plan.is_empty()) {
                return Err("it has points, but not all that is asked before them".to_owned());
            }
            if points > 0
                && let Err(error @ CalibrationError::InvalidArgument(_)) = calibrate(&measured, Method::Survey)
            {
                return Err(error.to_string());
            }
        }
        Ok(Self { question: Question::next(&file), file })
    }

    /// The pending question, in words.
    pub fn question(&self) -> String {
        self.question.text(&self.file)
    }

    /// The pending question.
    #[cfg(test)]
    pub fn pending(&self) -> &Question {
        &self.question
    }

    /// The measurements so far.
    pub fn file(&self) -> &File {
        &self.file
    }

    /// Takes a line that somebody typed.
    pub fn answer(&mut self, line: &str) -> Reply {
        let line = line.trim();
        match line.to_lowercase().as_str() {
            "quit" | "exit" => return Reply { said: String::new(), changed: false, then: Then::Leave },
            "undo" => {
                return match undo(&mut self.file) {
                    Some(what) => self.changed(format!("Taken back: {what}.")),
                    None => refused("There is nothing to take back.".to_owned()),
                };
            }
            "help" | "?" => return refused(HELP.to_owned()),
            _ => {}
        }
        if self.question == Question::Finish && line.is_empty() {
            return match crate::calibrate::judge(&self.file, Method::Survey) {
                Ok(_) => Reply { said: String::new(), changed: false, then: Then::Finish },
                Err(_) => refused("There is no calibration yet: say how many more points you will measure.".to_owned()),
            };
        }
        // An answer is tried on a copy, so that one that is refused leaves nothing behind.
        let mut tried = self.file.clone();
        match take(&mut tried, &self.question, line) {
            Ok(said) => {
                self.file = tried;
                self.changed(said)
            }
            Err(why) => refused(sentence(&why)),
        }
    }

    /// The measurements changed: what is asked next, and how well the anchors are known where points are being measured.
    fn changed(&mut self, said: String) -> Reply {
        self.question = Question::next(&self.file);
        let whole = told_by_points(&self.file) && matches!(self.question, Question::Lengths { .. });
        let progress = if whole { progress(&self.file) } else { None };
        let said: Vec<String> = [Some(said), progress].into_iter().flatten().filter(|said| !said.is_empty()).collect();
        Reply { said: said.join("\n"), changed: true, then: Then::Ask }
    }
}

/// What can be typed at any time.
const HELP: &str = "Answer the question; lengths as 12.43, 12,43, 12.43 m or 1243 cm. undo takes back the last answer, done ends the \
                    points, quit stops: everything is kept, and the same command goes on.";

fn refused(said: String) -> Reply {
    Reply { said, changed: false, then: Then::Ask }
}

/// With a capital letter and a full stop.
fn sentence(clause: &str) -> String {
    let mut letters = clause.chars();
    let begun: String = letters.next().into_iter().flat_map(char::to_uppercase).chain(letters).collect();
    if begun.ends_with(['.', '?', '!']) { begun } else { begun + "." }
}

/// Points are there, and no point is half told.
fn told_by_points(file: &File) -> bool {
    !file.point.is_empty() && file.setup.as_ref().is_some_and(|setup| setup.lengths_so_far_m.is_empty())
}

/// How well the anchors are known by the points so far, in a line; none while nothing is determined.
fn progress(file: &File) -> Option<String> {
    let measured = file.measurements(Method::Survey).ok()?;
    match calibrate(&measured, Method::Survey) {
        Ok(found) => {
            let (anchor, axis, std) = found.covariance.worst();
            Some(format!(
                "So far every pulley is known to ±{std:.3} m or better ({} of pulley {} least).",
                ["x", "y", "the height"][axis],
                anchor + 1
            ))
        }
        Err(_) if measured.lengths_m.len() < FEWEST => None,
        Err(error) => Some(sentence(&format!("not determined yet: {error}"))),
    }
}

/// Puts an answer into the measurements and says what is to be said about it.
fn take(file: &mut File, question: &Question, line: &str) -> Result<String, String> {
    let done = line.eq_ignore_ascii_case("done");
    if done && !matches!(question, Question::Lengths { .. }) {
        return Err(match question {
            Question::Finish => "that is all already: press Enter to write the calibration".to_owned(),
            Question::Doubt { .. } => "answer keep or again first".to_owned(),
            _ => "done ends the points, and they come after this question".to_owned(),
        });
    }
    match question {
        Question::Pulleys => {
            let most = cable_robot::MAX_CABLES;
            let count =
                whole(line, 3, most).ok_or_else(|| format!("`{}` is not a number from 3 to {most}", excerpt(line)))?;
            file.setup.get_or_insert_default().pulleys = Some(count);
            Ok(String::new())
        }
        Question::Distance { from, to, needed } => distance(file, (*from, *to), *needed, line),
        Question::Side { pulley, .. } => {
            let side = match line.to_lowercase().as_str() {
                "l" | "left" => 1,
                "r" | "right" => -1,
                _ => return Err(format!("`{}` is no side; write l for left or r for right", excerpt(line))),
            };
            if let Some(range) = file.range.iter_mut().rfind(|range| range.from.max(range.to) == *pulley) {
                range.side = Some(side);
            }
            Ok(String::new())
        }
        Question::Height { pulley } => {
            if line.is_empty() {
                file.setup.get_or_insert_default().unmeasured.push(*pulley);
                return Ok(String::new());
            }
            let m = numbers::length(line, numbers::HEIGHT)?;
            file.height.push(HeightEntry { anchor: *pulley, m, sigma_m: None, by: Some(HeightBy::Tape) });
            Ok(String::new())
        }
        Question::About => {
            if line.is_empty() {
                return Err("a guess is needed, to show what the lines will read; e.g. 3".to_owned());
            }
            file.setup.get_or_insert_default().about_m = Some(numbers::length(line, numbers::HEIGHT)?);
            Ok(String::new())
        }
        Question::Points => {
            let count = if line.is_empty() { Some(POINTS) } else { whole(line, FEWEST, MOST) };
            let count = count.ok_or_else(|| {
                format!(
                    "`{}` is not a number from {FEWEST} to {MOST}; fewer than {FEWEST} points tell nothing",
                    excerpt(line)
                )
            })?;
            let points = file.point.len();
            file.setup.get_or_insert_default().plan.push([points, count]);
            Ok("A step beside a place does no harm: the node has to touch the floor, and all lines have to be taut."
                .to_owned())
        }
        Question::Lengths { .. } if done => end_early(file),
        Question::Lengths { place } => lengths(file, *place, line),
        Question::Doubt { doubtful, .. } => {
            let used = match line.to_lowercase().as_str() {
                "keep" | "k" => true,
                "again" | "a" => false,
                _ => return Err(format!("`{}` is neither keep nor again", excerpt(line))),
            };
            file.doubt.push(Doubt { point: doubtful.point, used, after: file.point.len() });
            Ok(String::new())
        }
        Question::Finish => {
            let used = file.used(Method::Survey).len();
            let more = whole(line, 1, MOST.saturating_sub(used).max(1)).ok_or_else(|| {
                format!("`{}` is neither Enter nor a number of further points (up to {MOST} in all)", excerpt(line))
            })?;
            let points = file.point.len();
            file.setup.get_or_insert_default().plan.push([points, used + more]);
            Ok(String::new())
        }
    }
}

/// A whole number between two.
fn whole(text: &str, least: usize, most: usize) -> Option<usize> {
    let digits = text.len() <= 3 && !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit());
    text.parse().ok().filter(|number| digits && (least..=most).contains(number))
}

fn distance(file: &mut File, (from, to): (usize, usize), needed: bool, line: &str) -> Result<String, String> {
    if line.is_empty() {
        if needed {
            return Err(format!("without the distance {from}-{to} nobody knows where pulley {to} is; measure it"));
        }
        file.setup.get_or_insert_default().skipped.push([from, to]);
    } else {
        let m = numbers::length(line, numbers::DISTANCE)?;
        file.range.push(RangeEntry { from, to, m, sigma_m: None, side: None });
        shape::check_triangles(file, from, to)?;
    }
    // The last distance to a pulley settles where it is.
    let complete = to >= 3 && !matches!(Question::next(file), Question::Distance { to: next, .. } if next == to);
    if !complete {
        return Ok(String::new());
    }
    let survey = shape::survey(file, to)?;
    Ok(shape::contradiction(file, &survey, to).unwrap_or_default())
}

fn lengths(file: &mut File, place: usize, line: &str) -> Result<String, String> {
    let count = pulleys(file);
    let so_far = file.setup.get_or_insert_default().lengths_so_far_m.clone();
    let open = count - so_far.len().min(count);
    if line.is_empty() {
        return Err("read the lines and type their lengths; done ends the points, quit stops for now".to_owned());
    }
    let read = numbers::lengths(line, numbers::LENGTH)?;
    if read.len() != 1 && read.len() != open {
        return Err(format!("`{}` is {} lengths; type {open}, or one at a time", excerpt(line), read.len()));
    }
    let all: Vec<f64> = so_far.into_iter().chain(read).collect();
    let sigma_m = file.sigma_length_m.unwrap_or(DEFAULT_SIGMA_LENGTH_M);
    if let Some(anchors) = question::anchors(file) {
        shape::check_lengths(&anchors, &all, SHORT * sigma_m)?;
    }
    if all.len() < count {
        file.setup.get_or_insert_default().lengths_so_far_m = all;
        return Ok(String::new());
    }
    let hint = question::expected(file, place).and_then(|expected| far(&expected.lengths_m, &all));
    file.setup.get_or_insert_default().lengths_so_far_m.clear();
    file.point.push(PointEntry { lengths_m: all, gps_m: None });
    Ok(hint.unwrap_or_default())
}

/// A word about a length that is far from what was expected: perhaps two lines were taken for each other.
fn far(expected_m: &[f64], read_m: &[f64]) -> Option<String> {
    let off = |(expected, read): &(&f64, &f64)| (*read - *expected).abs() > FAR_M.max(FAR_SHARE * **expected);
    let (line, (expected, read)) = expected_m.iter().zip(read_m).enumerate().find(|(_, pair)| off(pair))?;
    Some(format!(
        "Line {} was expected to show about {} there, not {}: if it was misread, or lines were taken for each other, type undo.",
        line + 1,
        metres(*expected),
        metres(*read)
    ))
}

fn end_early(file: &mut File) -> Result<String, String> {
    if file.setup.as_ref().is_some_and(|setup| !setup.lengths_so_far_m.is_empty()) {
        return Err("this point is told in part: type the other lengths, or take it back with undo".to_owned());
    }
    let measured = file.measurements(Method::Survey)?;
    if let Err(error) = calibrate(&measured, Method::Survey) {
        return Err(format!("that is not enough yet: {error}"));
    }
    let (points, used) = (file.point.len(), file.used(Method::Survey).len());
    file.setup.get_or_insert_default().plan.push([points, used]);
    Ok(String::new())
}
