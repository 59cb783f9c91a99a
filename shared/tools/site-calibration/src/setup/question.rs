//! The next question: the first item that the measurements so far leave open.

use super::doubt::{self, DoubtfulPoint};
use super::text::{listed, metres};
use super::{shape, tape};
use crate::calibrate;
use crate::calibrate::{MeasurementsFile, Setup, TapeEntry, places};
use calibration::calibrate;
use config::PulleyKind;

/// Proposed number of points: three at each corner of three pulleys.
pub const POINTS: usize = 9;

/// A question.
#[derive(Debug, Clone, PartialEq)]
pub enum Question {
    /// Number of pulleys.
    Pulleys,
    /// Distance between the plumb lines of two pulleys.
    Distance {
        /// The lower number, from 1.
        from: usize,
        /// The higher number.
        to: usize,
        /// Whether the shape is undetermined without it.
        needed: bool,
    },
    /// Side on which a pulley stands, seen from one pulley towards another.
    Side {
        /// The pulley, from 1.
        pulley: usize,
        /// The pulley to stand at.
        from: usize,
        /// The pulley to look towards.
        to: usize,
    },
    /// Height of a pulley, if it was measured.
    Height {
        /// The pulley, from 1.
        pulley: usize,
    },
    /// Approximate height of all pulleys.
    ApproximateHeight,
    /// How far the pulleys are across.
    PulleyRadius,
    /// Cable that passes in one turn of a pulley.
    PulleyTurn,
    /// Number of points at which the node is held.
    Points,
    /// Cable lengths at one place.
    Lengths {
        /// Planned place, from 0.
        place: usize,
    },
    /// Whether lengths far from the expected ones are right.
    Confirmation {
        /// Planned place, from 0.
        place: usize,
    },
    /// Whether to use a point that does not fit.
    PointDecision {
        /// Planned place, from 0.
        place: usize,
        /// The point.
        doubtful: DoubtfulPoint,
    },
    /// Length by the robot and by a tape.
    Tape {
        /// The cable, from 1.
        cable: usize,
    },
    /// Whether a reading far from the length by the robot is right.
    TapeDecision {
        /// The reading.
        doubted: TapeEntry,
    },
    /// Confirmation that the measurements are complete.
    Finish,
}

/// Returns the answers that are not measurements.
pub fn setup_answers(file: &MeasurementsFile) -> Setup {
    file.setup.clone().unwrap_or_default()
}

/// Returns the number of pulleys; 0 if it has not been answered.
pub fn pulleys(file: &MeasurementsFile) -> usize {
    file.setup.as_ref().and_then(|setup| setup.pulleys).unwrap_or(0)
}

/// Returns the total number of points wanted.
pub fn wanted(file: &MeasurementsFile) -> Option<usize> {
    file.setup.as_ref().and_then(|setup| setup.plan.last()).map(|plan| plan[1])
}

/// Returns which point of the file belongs to each planned place: each point took the first place that was free when it
/// was measured.
pub fn points_at_places(file: &MeasurementsFile) -> Vec<Option<usize>> {
    let mut places: Vec<Option<usize>> = Vec::new();
    for point in 0..file.point.len() {
        match places.iter_mut().find(|place| place.is_none()) {
            Some(free) => *free = Some(point),
            None => places.push(Some(point)),
        }
        for doubt in file.doubt.iter().filter(|doubt| doubt.after == point + 1 && !doubt.used) {
            places.iter_mut().filter(|place| **place == Some(doubt.point - 1)).for_each(|place| *place = None);
        }
    }
    places
}

impl Question {
    /// Returns the first open question.
    pub fn next(file: &MeasurementsFile) -> Self {
        let setup = setup_answers(file);
        let Some(count) = setup.pulleys else { return Self::Pulleys };
        for to in 2..=count {
            if let Some(question) = Self::position_question(file, &setup, to) {
                return question;
            }
        }
        let known =
            |pulley: usize| file.height.iter().any(|h| h.anchor == pulley) || setup.unmeasured.contains(&pulley);
        if let Some(pulley) = (1..=count).find(|pulley| !known(*pulley)) {
            return Self::Height { pulley };
        }
        if file.height.is_empty() && setup.about_m.is_none() {
            return Self::ApproximateHeight;
        }
        if file.pulley.is_none() {
            return Self::PulleyRadius;
        }
        if file.pulley == Some(PulleyKind::Swivel) && file.pulley_turn_m.is_none() {
            return Self::PulleyTurn;
        }
        let Some(wanted) = wanted(file) else { return Self::Points };
        let places = points_at_places(file);
        if setup.lengths_so_far_m.is_empty()
            && let Some(doubtful) = doubt::find(file)
        {
            let place = places.iter().position(|point| *point == Some(doubtful.point - 1)).unwrap_or(0);
            return Self::PointDecision { place, doubtful };
        }
        if places.iter().flatten().count() >= wanted {
            return match (tape::doubted(file), tape::open_cable(file, count)) {
                (Some(doubted), _) => Self::TapeDecision { doubted },
                (None, Some(cable)) => Self::Tape { cable },
                (None, None) => Self::Finish,
            };
        }
        let place = places.iter().position(Option::is_none).unwrap_or(places.len());
        if setup.lengths_so_far_m.len() >= count { Self::Confirmation { place } } else { Self::Lengths { place } }
    }

    /// Returns the open question about the position of one pulley, if any.
    fn position_question(file: &MeasurementsFile, setup: &Setup, to: usize) -> Option<Self> {
        let skipped = |from: usize| setup.skipped.contains(&[from, to]);
        let open = |from: &usize| shape::distance(file, *from, to).is_none() && !skipped(*from);
        if let Some(from) = (1..to).find(open) {
            let left = to - 1 - (1..to).filter(|from| skipped(*from)).count();
            return Some(Self::Distance { from, to, needed: left <= 2 });
        }
        let message = file.range.iter().any(|r| r.from.max(r.to) == to && r.side.is_some()) || file.side.is_some();
        match shape::reached(file, to).as_slice() {
            [from, other] if !message => Some(Self::Side { pulley: to, from: *from, to: *other }),
            _ => None,
        }
    }

    /// Returns the text of the question.
    pub fn text(&self, file: &MeasurementsFile) -> String {
        match self {
            Self::Pulleys => say!("How many pulleys are there (3 to 8)?"),
            Self::Distance { from, to, needed } => {
                if (*from, *to) == (1, 2) {
                    say!(
                        "How far apart are the plumb lines of pulleys {from} and {to} (measured on the level; with a laser meter, type laser \
                         first)?"
                    )
                } else if *needed {
                    say!("How far apart are the plumb lines of pulleys {from} and {to}?")
                } else {
                    say!("How far apart are the plumb lines of pulleys {from} and {to}? (Enter: not measured)")
                }
            }
            Self::Side { pulley, from, to } => say!(
                "Stand at pulley {from} and look towards pulley {to}: is pulley {pulley} to the left or to the right (l or r)?"
            ),
            Self::Height { pulley } => {
                say!("How high above the floor is pulley {pulley} (Enter: not measured)?")
            }
            Self::ApproximateHeight => {
                say!("About how high are the pulleys above the floor (a guess is enough; only the plan uses it)?")
            }
            Self::PulleyRadius => {
                say!(
                    "Do the cables leave over wheels that swivel? Type how far a wheel is across at the bottom of its groove, plus one thickness of the cable, \
                 like 50 mm (Enter: eyes, no wheels)."
                )
            }
            Self::PulleyTurn => {
                say!(
                    "Mark a cable at its wheel and pull it until the wheel has turned once. How far has the mark moved, like 157 mm?"
                )
            }
            Self::Points => {
                say!(
                    "At how many points will the node be held on the floor (Enter: {POINTS}; more points are more accurate)?"
                )
            }
            Self::Lengths { place } => lengths_text(file, *place),
            Self::Confirmation { place } => confirmation_text(file, *place),
            Self::PointDecision { place, doubtful } => say!(
                "Point {} does not fit the others: {}.\nUse it anyway (keep), or measure it again (again)?",
                place + 1,
                doubtful.description
            ),
            Self::Tape { cable } => tape::text(*cable),
            Self::TapeDecision { doubted } => tape::doubt_text(doubted),
            Self::Finish => match calibrate::judge(file, file.usual_method()) {
                Ok(judged) => say!(
                    "\n{}\nPress Enter to write the calibration, or type the number of further points that you will measure:",
                    judged.words.trim_end()
                ),
                Err(why) => say!(
                    "There is no calibration yet: {why}. Type the number of further points that you will measure, or \
                     take back a wrong answer with undo."
                ),
            },
        }
    }
}

fn lengths_text(file: &MeasurementsFile, place: usize) -> String {
    let (setup, count) = (setup_answers(file), pulleys(file));
    let so_far = setup.lengths_so_far_m.len();
    if so_far > 0 {
        return say!("Point {}: how long is cable {}?", place + 1, so_far + 1);
    }
    let (point, of) = (place + 1, wanted(file).unwrap_or(0).max(place + 1));
    let Some(Place { pulley, from_foot_m, lengths_m }) = expected(file, place) else {
        return say!("Point {point} of {of}. How long are cables 1 to {count}?");
    };
    say!(
        "Point {point} of {of}: hold the node on the floor, {} from the foot of pulley {pulley} towards the middle of the site.\nThe \
         cables show about {} m there. How long are cables 1 to {count}?",
        metres(from_foot_m),
        listed(&lengths_m)
    )
}

/// Difference from the expected length that is asked about, m: a misread decimetre is more likely than a team that
/// stands so far from the place.
const ASKED_M: f64 = 0.3;

/// Returns the cable, from 0, whose length is farthest from the expected one, with both, if the difference is worth a
/// question.
pub fn unexpected(file: &MeasurementsFile, place: usize, lengths_m: &[f64]) -> Option<(usize, f64, f64)> {
    let expected = expected(file, place)?.lengths_m;
    let pairs = expected.into_iter().zip(lengths_m.iter().copied()).enumerate();
    let (cable, (expected, read)) = pairs.max_by(|a, b| (a.1.0 - a.1.1).abs().total_cmp(&(b.1.0 - b.1.1).abs()))?;
    ((expected - read).abs() > ASKED_M).then_some((cable, expected, read))
}

fn confirmation_text(file: &MeasurementsFile, place: usize) -> String {
    let lengths_m = setup_answers(file).lengths_so_far_m;
    let Some((cable, expected, read)) = unexpected(file, place, &lengths_m) else {
        return say!(
            "The cables show {} m. Press Enter if this is right, or type all lengths again:",
            listed(&lengths_m)
        );
    };
    say!(
        "Cable {} was expected to show about {} at the place, and {} was typed ({} {}). Press Enter if it is right and the node is \
         elsewhere, or type all lengths again:",
        cable + 1,
        metres(expected),
        metres(read),
        metres((read - expected).abs()),
        if read > expected { say!("more") } else { say!("less") }
    )
}

/// A planned place of the node.
#[derive(Debug, Clone, PartialEq)]
pub struct Place {
    /// The pulley near whose foot it is, from 1.
    pub pulley: usize,
    /// Distance from that foot towards the middle of all feet, m.
    pub from_foot_m: f64,
    /// Expected cable lengths, m.
    pub lengths_m: Vec<f64>,
}

/// Estimates the anchors: from the points where they determine it, otherwise with the measured or guessed heights.
pub fn anchors(file: &MeasurementsFile) -> Option<Vec<[f64; 3]>> {
    let measured = file.measurements(file.usual_method()).ok()?;
    if let Ok(found) = calibrate(&measured, file.usual_method()) {
        return Some(found.anchors_m);
    }
    let survey = shape::survey(file, pulleys(file)).ok()?;
    let known: f64 = measured.heights.iter().map(|h| h.m).sum();
    let about = setup_answers(file).about_m.unwrap_or(known / measured.heights.len().max(1) as f64);
    let height = |i: usize| measured.heights.iter().find(|h| h.anchor == i).map_or(about, |h| h.m);
    Some(survey.anchors_xy_m.iter().enumerate().map(|(i, [x, y])| [*x, *y, height(i)]).collect())
}

/// Returns the expectation for a planned place.
pub fn expected(file: &MeasurementsFile, place: usize) -> Option<Place> {
    let anchors = anchors(file)?;
    let at = places::spots(&anchors, place + 1).pop()?;
    let foot = place % anchors.len();
    let from_foot_m = (anchors[foot][0] - at[0]).hypot(anchors[foot][1] - at[1]);
    Some(Place { pulley: foot + 1, from_foot_m, lengths_m: places::lengths(&anchors, &file.pulley_radius_m, &at) })
}
