//! The sequence of questions: the measurements so far and the open question. No input and output; the state is the
//! measurements file.

use super::captured::CapturedLengths;
use super::numbers::{self, excerpt};
use super::question::{self, POINTS, Question, pulleys};
use super::text::listed;
use super::undo::undo;
use super::{shape, tape};
use crate::calibrate::{HeightBy, HeightEntry, MeasurementsFile, PointDecision, PointEntry, RangeEntry, Setup};
use calibration::{CalibrationError, DEFAULT_SIGMA_LENGTH_M, calibrate};
use config::PulleyKind;

/// Standard deviation of a distance, m, written into a new file: a tape over ten metres between plumb lines, or a laser
/// meter used by beginners.
const SIGMA_RANGE_M: f64 = 0.005;
/// The same for a laser meter: ±1.5 mm, and plumb lines that never hang quite still.
const SIGMA_LASER_M: f64 = 0.003;

/// Standard deviation of the zeros of captured lengths, m: `nims zero` at a place that is known to a few centimetres.
const SIGMA_ZERO_M: f64 = 0.05;

/// Minimum number of points of a plan.
const FEWEST: usize = 3;
/// Maximum number of points of a plan.
const MOST: usize = 60;

/// Standard deviation of a radius, m: half of a diameter measured with a ruler.
const SIGMA_RADIUS_M: f64 = 0.001;
/// Standard deviation of the scale of each cable, as a share: a check over five metres, good to 2.5 mm.
const SIGMA_CABLE_SCALE: f64 = 0.0005;
/// Standard deviation of the zero of a cable whose lengths are typed, m: where a tape begins, and poles that yield.
const SIGMA_TYPED_ZERO_M: f64 = 0.005;
/// Standard deviation of the point where a cable is tied, m: a ring at the node.
const SIGMA_ATTACHMENT_M: f64 = 0.005;

/// Standard deviation of the floor, m: a lawn. It is the greater part of that of a length, 10 mm.
const SIGMA_FLOOR_M: f64 = 0.008;

/// Amount by which two cables may be too short to meet, in standard deviations of a length.
const SHORT_SIGMAS: f64 = 6.0;

/// What the caller does after an answer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NextStep {
    /// Ask the next question, or the same one again.
    Ask,
    /// Write the calibration: the measurements are complete and confirmed.
    Finish,
    /// Leave the program.
    Leave,
}

/// Reply to an answer.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Reply {
    /// Message to print; may be empty.
    pub message: String,
    /// Whether the measurements changed and must be saved.
    pub changed: bool,
    /// What the caller does next.
    pub next_step: NextStep,
}

/// The measurements and the open question.
#[derive(Debug, Clone, PartialEq)]
pub struct Guide {
    file: MeasurementsFile,
    question: Question,
}

impl Default for Guide {
    fn default() -> Self {
        let file = MeasurementsFile {
            setup: Some(Setup::default()),
            sigma_range_m: Some(SIGMA_RANGE_M),
            ..MeasurementsFile::default()
        };
        Self { question: Question::next(&file), file }
    }
}

impl Guide {
    /// Continues with existing measurements.
    ///
    /// # Errors
    /// One clause without the file name: why they cannot be continued.
    pub fn resume(file: MeasurementsFile) -> Result<Self, String> {
        let Some(setup) = &file.setup else {
            return Err(say!(
                "it has no [setup], so `nims setup` did not create it and would drop its comments; name a new file, \
                        or pass this one to `nims calibrate`"
            ));
        };
        let count = setup.pulleys.unwrap_or(0);
        if setup.pulleys.is_some_and(|count| !(3..=cable_robot::MAX_CABLES).contains(&count)) {
            return Err(say!("pulleys is {count}; accepted: 3 to {}", cable_robot::MAX_CABLES));
        }
        let named = file.range.iter().flat_map(|r| [r.from, r.to]).chain(file.height.iter().map(|h| h.anchor));
        let plans = setup.skipped.iter().flatten().chain(&setup.unmeasured).copied();
        if let Some(other) = named.chain(plans).find(|pulley| !(1..=count).contains(pulley)) {
            return Err(say!("it names pulley {other}; there are {count} pulleys"));
        }
        if file.point.iter().any(|point| point.lengths_m.len() != count) || setup.lengths_so_far_m.len() > count {
            return Err(say!("a [[point]] does not have one length for each of the {count} pulleys"));
        }
        let points = file.point.len();
        let odd = |doubt: &PointDecision| !(1..=doubt.after).contains(&doubt.point) || doubt.after > points;
        if file.doubt.iter().any(odd) || setup.plan.iter().any(|plan| plan[0] > points || plan[1] > 2 * MOST) {
            return Err(say!("a [[doubt]] or the plan refers to points that do not exist"));
        }
        if count > 0 {
            let method = file.usual_method();
            let measured = file.measurements(method)?;
            let question = Question::next(&MeasurementsFile {
                setup: Some(Setup { plan: Vec::new(), ..setup.clone() }),
                ..file.clone()
            });
            let placed = !matches!(question, Question::Pulleys | Question::Distance { .. } | Question::Side { .. });
            if placed {
                shape::survey(&file, count)?;
            }
            // Points need the positions of the pulleys, so an earlier question must not be open.
            // A file from before the question of the pulleys may have points.
            if !matches!(question, Question::Points | Question::PulleyRadius | Question::PulleyTurn)
                && (points > 0 || !setup.plan.is_empty())
            {
                return Err(say!("it has points, but an answer that is asked before them is missing"));
            }
            if points > 0
                && let Err(error @ CalibrationError::InvalidArgument(_)) = calibrate(&measured, method)
            {
                return Err(error.to_string());
            }
        }
        Ok(Self { question: Question::next(&file), file })
    }

    /// Returns the text of the open question.
    pub fn question(&self) -> String {
        self.question.text(&self.file)
    }

    /// Returns the open question.
    pub fn pending(&self) -> &Question {
        &self.question
    }

    /// Returns the measurements so far.
    pub fn file(&self) -> &MeasurementsFile {
        &self.file
    }

    /// Applies a typed line.
    pub fn answer(&mut self, line: &str) -> Reply {
        let line = line.trim();
        match line.to_lowercase().as_str() {
            "quit" | "exit" => return Reply { message: String::new(), changed: false, next_step: NextStep::Leave },
            "undo" => {
                return match undo(&mut self.file) {
                    Some(what) => self.changed(say!("Taken back: {what}.")),
                    None => refused(say!("There is no answer to take back.")),
                };
            }
            "help" | "?" => return refused(help()),
            _ => {}
        }
        if self.question == Question::Finish && line.is_empty() {
            return match crate::calibrate::judge(&self.file, self.file.usual_method()) {
                Ok(_) => Reply { message: String::new(), changed: false, next_step: NextStep::Finish },
                Err(_) => refused(say!(
                    "There is no calibration yet: type the number of further points that you will measure."
                )),
            };
        }
        let typed = line.starts_with(|c: char| c.is_ascii_digit());
        if typed && matches!(self.question, Question::Lengths { .. } | Question::Confirmation { .. }) {
            if self.file.counts_per_m.is_some() && !self.file.point.is_empty() {
                return refused(say!(
                    "The points so far were captured, and typed lengths have other zeros: type capture."
                ));
            }
            if self.file.counts_per_m.take().is_some() {
                self.file.sigma_offset_m = (self.file.pulley == Some(PulleyKind::Swivel)).then_some(SIGMA_TYPED_ZERO_M);
            }
        }
        self.apply(line)
    }

    /// Applies an answer to a copy, so that a rejected one changes nothing.
    fn apply(&mut self, line: &str) -> Reply {
        let mut tried = self.file.clone();
        match apply_answer(&mut tried, &self.question, line) {
            Ok(message) => {
                self.file = tried;
                self.changed(message)
            }
            Err(why) => refused(sentence(&why)),
        }
    }

    /// Returns whether this line asks for the lengths of the running robot at a point.
    pub fn takes_capture(&self, line: &str) -> bool {
        line.trim().eq_ignore_ascii_case("capture")
            && matches!(self.question, Question::Lengths { .. } | Question::Confirmation { .. })
    }

    /// Returns whether this line asks for the lengths at which the running robot touches the floor with the node.
    pub fn takes_touch_down(&self, line: &str) -> bool {
        line.trim().eq_ignore_ascii_case("touch")
            && matches!(self.question, Question::Lengths { .. } | Question::Confirmation { .. })
    }

    /// Applies lengths of the running robot to the open point.
    pub fn capture(&mut self, captured: &CapturedLengths) -> Reply {
        let count = pulleys(&self.file);
        if captured.lengths_m.len() != count {
            let cables = captured.lengths_m.len();
            return refused(say!("The running robot has {cables} cables, and this site has {count} pulleys."));
        }
        let same = self.file.counts_per_m.as_ref().is_none_or(|counts| *counts == captured.counts_per_m);
        if !same || (self.file.counts_per_m.is_none() && !self.file.point.is_empty()) {
            return refused(say!(
                "The points so far have lengths of another source, whose zeros differ; go on in the same way, or take them back with undo."
            ));
        }
        let before = self.clone();
        self.file.counts_per_m = Some(captured.counts_per_m.clone());
        self.file.sigma_offset_m = Some(SIGMA_ZERO_M);
        self.file.setup.get_or_insert_default().lengths_so_far_m.clear();
        self.question = Question::next(&self.file);
        let typed: Vec<String> = captured.lengths_m.iter().map(|m| format!("{m:.4}")).collect();
        let mut reply = self.apply(&typed.join(" "));
        if reply.changed {
            let captured = say!("Captured {} m.", listed(&captured.lengths_m));
            reply.message = format!("{captured}\n{}", reply.message).trim_end().to_owned();
        } else {
            *self = before;
        }
        reply
    }

    /// Determines the next question and, while points are measured, the accuracy of the anchors so far.
    fn changed(&mut self, message: String) -> Reply {
        self.question = Question::next(&self.file);
        let whole = points_complete(&self.file) && matches!(self.question, Question::Lengths { .. });
        let progress = if whole { progress(&self.file) } else { None };
        let message: Vec<String> =
            [Some(message), progress].into_iter().flatten().filter(|message| !message.is_empty()).collect();
        Reply { message: message.join("\n"), changed: true, next_step: NextStep::Ask }
    }
}

/// Text for `help`.
fn help() -> String {
    say!(
        "Answer the question; lengths as 12.43, 12,43, 12.43 m or 1243 cm. undo takes back the last answer, done ends the \
                    points, quit stops. capture takes the lengths of the running robot, and touch those at which it sets the node down. All answers are saved, and the same command continues."
    )
}

/// A reply that changes nothing and asks again.
#[must_use]
pub fn refused(message: String) -> Reply {
    Reply { message, changed: false, next_step: NextStep::Ask }
}

/// Adds a capital letter and a full stop.
#[must_use]
pub fn sentence(clause: &str) -> String {
    let mut letters = clause.chars();
    let begun: String = letters.next().into_iter().flat_map(char::to_uppercase).chain(letters).collect();
    if begun.ends_with(['.', '?', '!']) { begun } else { begun + "." }
}

/// Returns whether the file has points and none of them is incomplete.
fn points_complete(file: &MeasurementsFile) -> bool {
    !file.point.is_empty() && file.setup.as_ref().is_some_and(|setup| setup.lengths_so_far_m.is_empty())
}

/// Returns the accuracy of the anchors from the points so far as one line; `None` if too few points exist.
fn progress(file: &MeasurementsFile) -> Option<String> {
    let measured = file.measurements(file.usual_method()).ok()?;
    match crate::calibrate::honest_calibration(&measured, file.usual_method()) {
        Ok(found) => {
            let (anchor, axis, std) = found.covariance.worst();
            Some(say!(
                "So far every pulley is known to ±{std:.3} m or better ({} of pulley {} least).",
                [say!("x"), say!("y"), say!("the height")][axis],
                anchor + 1
            ))
        }
        Err(_) if measured.lengths_m.len() < FEWEST => None,
        Err(error) => Some(sentence(&say!("not determined yet: {error}"))),
    }
}

/// Applies an answer to the measurements and returns the message to print.
fn apply_answer(file: &mut MeasurementsFile, question: &Question, line: &str) -> Result<String, String> {
    let done = line.eq_ignore_ascii_case("done");
    if done && !matches!(question, Question::Lengths { .. }) {
        return Err(match question {
            Question::Finish => say!("the points are complete: press Enter to write the calibration"),
            Question::PointDecision { .. } => say!("answer keep or again first"),
            Question::Confirmation { .. } => say!("press Enter, or type the lengths of this point again, first"),
            _ => say!("done ends the points, which come after this question"),
        });
    }
    match question {
        Question::Pulleys => {
            let most = cable_robot::MAX_CABLES;
            let count =
                whole(line, 3, most).ok_or_else(|| say!("`{}` is not a number from 3 to {most}", excerpt(line)))?;
            file.setup.get_or_insert_default().pulleys = Some(count);
            Ok(String::new())
        }
        Question::Distance { .. } if instrument(file, line).is_some() => Ok(instrument(file, line).unwrap_or_default()),
        Question::Distance { from, to, needed } => distance(file, (*from, *to), *needed, line),
        Question::Side { pulley, .. } => side(file, *pulley, line),
        Question::Height { pulley } => {
            if line.is_empty() {
                file.setup.get_or_insert_default().unmeasured.push(*pulley);
                return Ok(String::new());
            }
            let m = numbers::length(line, numbers::HEIGHT)?;
            file.height.push(HeightEntry { anchor: *pulley, m, sigma_m: None, by: Some(HeightBy::Tape) });
            Ok(String::new())
        }
        Question::ApproximateHeight => {
            if line.is_empty() {
                return Err(say!("a guess is needed to predict the cable lengths; e.g. 3"));
            }
            file.setup.get_or_insert_default().about_m = Some(numbers::length(line, numbers::HEIGHT)?);
            Ok(String::new())
        }
        Question::PulleyRadius => pulley_radius(file, line),
        Question::PulleyTurn => pulley_turn(file, line),
        Question::Points => number_of_points(file, line),
        Question::Lengths { .. } if done => end_early(file),
        Question::Lengths { place } => lengths(file, *place, line),
        Question::Confirmation { .. } if line.is_empty() => Ok(add_point(file)),
        Question::Confirmation { place } => {
            file.setup.get_or_insert_default().lengths_so_far_m.clear();
            let open = pulleys(file);
            let message = lengths(file, *place, line)?;
            if points_complete(file) || file.setup.as_ref().is_some_and(|setup| setup.lengths_so_far_m.len() == open) {
                return Ok(message);
            }
            Err(say!("type all {open} lengths again, or press Enter"))
        }
        Question::PointDecision { doubtful, .. } => point_decision(file, doubtful.point, line),
        Question::Tape { cable } => tape::answer(file, pulleys(file), *cable, line),
        Question::TapeDecision { doubted } => tape::confirm(file, pulleys(file), doubted, line),
        Question::Finish => further_points(file, line),
    }
}

fn point_decision(file: &mut MeasurementsFile, point: usize, line: &str) -> Result<String, String> {
    let used = match line.to_lowercase().as_str() {
        "keep" | "k" => true,
        "again" | "a" => false,
        _ => return Err(say!("`{}` is neither keep nor again", excerpt(line))),
    };
    file.doubt.push(PointDecision { point, used, after: file.point.len() });
    Ok(String::new())
}

fn further_points(file: &mut MeasurementsFile, line: &str) -> Result<String, String> {
    let used = file.used(file.usual_method()).len();
    let more = whole(line, 1, MOST.saturating_sub(used).max(1)).ok_or_else(|| {
        say!("`{}` is neither Enter nor a number of further points (up to {MOST} in all)", excerpt(line))
    })?;
    let points = file.point.len();
    file.setup.get_or_insert_default().plan.push([points, used + more]);
    Ok(String::new())
}

fn side(file: &mut MeasurementsFile, pulley: usize, line: &str) -> Result<String, String> {
    let side = match line.to_lowercase().as_str() {
        "l" | "left" => 1,
        "r" | "right" => -1,
        _ => return Err(say!("`{}` is not a side; type l for left or r for right", excerpt(line))),
    };
    if let Some(range) = file.range.iter_mut().rfind(|range| range.from.max(range.to) == pulley) {
        range.side = Some(side);
    }
    Ok(String::new())
}

fn number_of_points(file: &mut MeasurementsFile, line: &str) -> Result<String, String> {
    let count = if line.is_empty() { Some(POINTS) } else { whole(line, FEWEST, MOST) };
    let count = count.ok_or_else(|| {
        say!(
            "`{}` is not a number from {FEWEST} to {MOST}; fewer than {FEWEST} points determine nothing",
            excerpt(line)
        )
    })?;
    let points = file.point.len();
    file.setup.get_or_insert_default().plan.push([points, count]);
    Ok(say!("A step beside a place does no harm. The node must touch the floor, and all cables must be taut."))
}

/// Parses a whole number within a range.
fn whole(text: &str, least: usize, most: usize) -> Option<usize> {
    let digits = text.len() <= 3 && !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit());
    text.parse().ok().filter(|number| digits && (least..=most).contains(number))
}

fn distance(
    file: &mut MeasurementsFile,
    (from, to): (usize, usize),
    needed: bool,
    line: &str,
) -> Result<String, String> {
    if line.is_empty() {
        if needed {
            return Err(say!("the position of pulley {to} needs the distance {from}-{to}; measure it"));
        }
        file.setup.get_or_insert_default().skipped.push([from, to]);
    } else {
        let m = numbers::length(line, numbers::DISTANCE)?;
        file.range.push(RangeEntry { from, to, m, sigma_m: None, side: None });
        shape::check_triangles(file, from, to)?;
    }
    // The last distance to a pulley determines its position.
    let complete = to >= 3 && !matches!(Question::next(file), Question::Distance { to: next, .. } if next == to);
    if !complete {
        return Ok(String::new());
    }
    let survey = shape::survey(file, to)?;
    Ok(shape::contradiction(file, &survey, to).unwrap_or_default())
}

fn lengths(file: &mut MeasurementsFile, place: usize, line: &str) -> Result<String, String> {
    let count = pulleys(file);
    let so_far = file.setup.get_or_insert_default().lengths_so_far_m.clone();
    let open = count - so_far.len().min(count);
    if line.is_empty() {
        return Err(say!("read the cables and type their lengths; done ends the points, quit stops for now"));
    }
    let read = numbers::lengths(line, numbers::LENGTH)?;
    if read.len() != 1 && read.len() != open {
        return Err(say!("`{}` is {} lengths; type {open}, or one at a time", excerpt(line), read.len()));
    }
    let all: Vec<f64> = so_far.into_iter().chain(read).collect();
    let sigma_m = file.sigma_length_m.unwrap_or(DEFAULT_SIGMA_LENGTH_M);
    if let Some(anchors) = question::anchors(file) {
        shape::check_lengths(&anchors, &all, SHORT_SIGMAS * sigma_m)?;
    }
    if all.len() < count {
        file.setup.get_or_insert_default().lengths_so_far_m = all;
        return Ok(String::new());
    }
    let unexpected = question::unexpected(file, place, &all).is_some();
    file.setup.get_or_insert_default().lengths_so_far_m = all;
    Ok(if unexpected { String::new() } else { add_point(file) })
}

/// Makes the lengths that were typed a point.
fn add_point(file: &mut MeasurementsFile) -> String {
    let lengths_m = std::mem::take(&mut file.setup.get_or_insert_default().lengths_so_far_m);
    file.point.push(PointEntry { lengths_m, gps_m: None });
    String::new()
}

fn pulley_radius(file: &mut MeasurementsFile, line: &str) -> Result<String, String> {
    if line.is_empty() {
        file.pulley = Some(PulleyKind::Eye);
        let seen = file.height.len() == pulleys(file);
        let message = || {
            say!(
                "Points alone can hardly tell eyes from wheels, so the calibration will state large deviations. With the height \
                       of every pulley, by a tape or a laser, they are small: undo goes back to these questions."
            )
        };
        return Ok(if seen { String::new() } else { message() });
    }
    let radius_m = 0.5 * numbers::small(&say!("what a wheel measures across"), line, numbers::ACROSS)?;
    file.pulley = Some(PulleyKind::Swivel);
    file.pulley_radius_m = vec![radius_m; pulleys(file)];
    file.sigma_pulley_radius_m = Some(SIGMA_RADIUS_M);
    file.sigma_cable_scale = Some(SIGMA_CABLE_SCALE);
    file.sigma_attachment_m = Some(SIGMA_ATTACHMENT_M);
    file.sigma_offset_m = Some(SIGMA_TYPED_ZERO_M);
    file.sigma_floor_m = Some(SIGMA_FLOOR_M);
    Ok(String::new())
}

/// The second measurement of the wheels: a radius in place of a diameter is a mistake that no point reveals.
fn pulley_turn(file: &mut MeasurementsFile, line: &str) -> Result<String, String> {
    file.pulley_turn_m = Some(numbers::small(&say!("the cable of one turn"), line, numbers::TURN)?);
    if let Err(why) = file.measurements(file.usual_method()) {
        return Err(say!("{why}; type the turn again, or undo and what the wheel measures across"));
    }
    Ok(String::new())
}

/// The instrument of the distances, which says how good they are.
fn instrument(file: &mut MeasurementsFile, line: &str) -> Option<String> {
    let (name, sigma_m) = match line.to_lowercase().as_str() {
        "laser" => (say!("a laser meter"), SIGMA_LASER_M),
        "tape" => (say!("a tape"), SIGMA_RANGE_M),
        _ => return None,
    };
    file.sigma_range_m = Some(sigma_m);
    Some(say!("Then the distances are good to {:.0} mm, as by {name}.", 1e3 * sigma_m))
}

fn end_early(file: &mut MeasurementsFile) -> Result<String, String> {
    if file.setup.as_ref().is_some_and(|setup| !setup.lengths_so_far_m.is_empty()) {
        return Err(say!("this point is incomplete: type the other lengths, or take it back with undo"));
    }
    let measured = file.measurements(file.usual_method())?;
    if let Err(error) = calibrate(&measured, file.usual_method()) {
        return Err(say!("the points are not enough yet: {error}"));
    }
    let (points, used) = (file.point.len(), file.used(file.usual_method()).len());
    file.setup.get_or_insert_default().plan.push([points, used]);
    Ok(String::new())
}
