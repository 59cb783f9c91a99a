//! What is asked next: the first thing that the measurements so far leave open.

use super::doubt::{self, Doubtful};
use super::shape;
use super::text::{listed, metres};
use crate::calibrate;
use crate::calibrate::{File, Setup, places};
use calibration::{Method, calibrate};
use std::fmt::Write as _;

/// How many points are proposed: three rounds of the corners of three pulleys.
pub const POINTS: usize = 9;

/// A question.
#[derive(Debug, Clone, PartialEq)]
pub enum Question {
    /// How many pulleys.
    Pulleys,
    /// How far the plumb lines of two pulleys are apart.
    Distance {
        /// The lower number, from 1.
        from: usize,
        /// The higher one.
        to: usize,
        /// Without it the shape is not fixed.
        needed: bool,
    },
    /// On which side of the way from one pulley to another this one stands.
    Side {
        /// Which, from 1.
        pulley: usize,
        /// From where one looks.
        from: usize,
        /// To where.
        to: usize,
    },
    /// How high a pulley is, if that was measured.
    Height {
        /// Which, from 1.
        pulley: usize,
    },
    /// About how high all are.
    About,
    /// At how many points the node is held.
    Points,
    /// The lengths at one place.
    Lengths {
        /// Which of the planned places, from 0.
        place: usize,
    },
    /// Whether a point that does not fit counts.
    Doubt {
        /// Which of the planned places, from 0.
        place: usize,
        /// The point.
        doubtful: Doubtful,
    },
    /// Whether that is all.
    Finish,
}

/// What has been told beside measurements.
pub fn told(file: &File) -> Setup {
    file.setup.clone().unwrap_or_default()
}

/// How many pulleys there are; 0 if nobody has said it.
pub fn pulleys(file: &File) -> usize {
    file.setup.as_ref().and_then(|setup| setup.pulleys).unwrap_or(0)
}

/// How many points are wanted in all.
pub fn wanted(file: &File) -> Option<usize> {
    file.setup.as_ref().and_then(|setup| setup.plan.last()).map(|plan| plan[1])
}

/// Which point of the file stands for each planned place: every point took the first place that was free when it was measured.
pub fn at_places(file: &File) -> Vec<Option<usize>> {
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
    /// The first thing that is open.
    pub fn next(file: &File) -> Self {
        let setup = told(file);
        let Some(count) = setup.pulleys else { return Self::Pulleys };
        for to in 2..=count {
            if let Some(question) = Self::about_place(file, &setup, to) {
                return question;
            }
        }
        let known =
            |pulley: usize| file.height.iter().any(|h| h.anchor == pulley) || setup.unmeasured.contains(&pulley);
        if let Some(pulley) = (1..=count).find(|pulley| !known(*pulley)) {
            return Self::Height { pulley };
        }
        if file.height.is_empty() && setup.about_m.is_none() {
            return Self::About;
        }
        let Some(wanted) = wanted(file) else { return Self::Points };
        let places = at_places(file);
        if setup.lengths_so_far_m.is_empty()
            && let Some(doubtful) = doubt::find(file)
        {
            let place = places.iter().position(|point| *point == Some(doubtful.point - 1)).unwrap_or(0);
            return Self::Doubt { place, doubtful };
        }
        if places.iter().flatten().count() >= wanted {
            return Self::Finish;
        }
        Self::Lengths { place: places.iter().position(Option::is_none).unwrap_or(places.len()) }
    }

    /// What is open of where one pulley stands, if anything.
    fn about_place(file: &File, setup: &Setup, to: usize) -> Option<Self> {
        let skipped = |from: usize| setup.skipped.contains(&[from, to]);
        let open = |from: &usize| shape::distance(file, *from, to).is_none() && !skipped(*from);
        if let Some(from) = (1..to).find(open) {
            let left = to - 1 - (1..to).filter(|from| skipped(*from)).count();
            return Some(Self::Distance { from, to, needed: left <= 2 });
        }
        let said = file.range.iter().any(|r| r.from.max(r.to) == to && r.side.is_some()) || file.side.is_some();
        match shape::reached(file, to).as_slice() {
            [from, other] if !said => Some(Self::Side { pulley: to, from: *from, to: *other }),
            _ => None,
        }
    }

    /// The question in words.
    pub fn text(&self, file: &File) -> String {
        match self {
            Self::Pulleys => "How many pulleys are there (3 to 8)?".to_owned(),
            Self::Distance { from, to, needed } => {
                let level = if (*from, *to) == (1, 2) { " (measured on the level)" } else { "" };
                let skip = if *needed { "" } else { " (Enter: not measured)" };
                format!("How far apart are the plumb lines of pulleys {from} and {to}{level}?{skip}")
            }
            Self::Side { pulley, from, to } => format!(
                "Stand at pulley {from} and look towards pulley {to}: is pulley {pulley} to the left or to the right (l or r)?"
            ),
            Self::Height { pulley } => {
                format!("How high above the floor is pulley {pulley}, if somebody measured it (Enter: not measured)?")
            }
            Self::About => {
                "About how high are the pulleys above the floor (a guess is enough: it is for the plan only)?"
                    .to_owned()
            }
            Self::Points => {
                format!(
                    "At how many points will the node be held on the floor (Enter: {POINTS}; more points tell more)?"
                )
            }
            Self::Lengths { place } => lengths_text(file, *place),
            Self::Doubt { place, doubtful } => format!(
                "Point {} does not fit the others: {}.\nShall it count all the same (keep), or be measured once more (again)?",
                place + 1,
                doubtful.how
            ),
            Self::Finish => match calibrate::judge(file, Method::Survey) {
                Ok(judged) => format!(
                    "\n{}\nPress Enter to write the calibration, or say how many more points you will measure:",
                    judged.words.trim_end()
                ),
                Err(why) => format!(
                    "These measurements do not tell where the pulleys are: {why}. Say how many more points you will measure, or \
                     take back what is wrong with undo."
                ),
            },
        }
    }
}

fn lengths_text(file: &File, place: usize) -> String {
    let (setup, count) = (told(file), pulleys(file));
    let so_far = setup.lengths_so_far_m.len();
    if so_far > 0 {
        return format!("Point {}: how long is line {}?", place + 1, so_far + 1);
    }
    let mut text = format!("Point {} of {}", place + 1, wanted(file).unwrap_or(0).max(place + 1));
    if let Some(expected) = expected(file, place) {
        let _ = write!(
            text,
            ": hold the node on the floor, {} from the foot of pulley {} towards the middle of the site.\nThe lines show about {} m \
             there",
            metres(expected.from_foot_m),
            expected.pulley,
            listed(&expected.lengths_m)
        );
    }
    let _ = write!(text, ". How long are lines 1 to {count}?");
    text
}

/// A planned place of the node.
#[derive(Debug, Clone, PartialEq)]
pub struct Place {
    /// By whose foot, from 1.
    pub pulley: usize,
    /// How far from it, towards the middle of all feet, m.
    pub from_foot_m: f64,
    /// What the lines show there, m.
    pub lengths_m: Vec<f64>,
}

/// Where the pulleys are as far as is known: by the points if they tell it, else with the heights that were measured or guessed.
pub fn anchors(file: &File) -> Option<Vec<[f64; 3]>> {
    let measured = file.measurements(Method::Survey).ok()?;
    if let Ok(found) = calibrate(&measured, Method::Survey) {
        return Some(found.anchors_m);
    }
    let survey = shape::survey(file, pulleys(file)).ok()?;
    let known: f64 = measured.heights.iter().map(|h| h.m).sum();
    let about = told(file).about_m.unwrap_or(known / measured.heights.len().max(1) as f64);
    let height = |i: usize| measured.heights.iter().find(|h| h.anchor == i).map_or(about, |h| h.m);
    Some(survey.anchors_xy_m.iter().enumerate().map(|(i, [x, y])| [*x, *y, height(i)]).collect())
}

/// What is to be expected at a planned place.
pub fn expected(file: &File, place: usize) -> Option<Place> {
    let anchors = anchors(file)?;
    let at = places::spots(&anchors, place + 1).pop()?;
    let foot = place % anchors.len();
    let from_foot_m = (anchors[foot][0] - at[0]).hypot(anchors[foot][1] - at[1]);
    Some(Place { pulley: foot + 1, from_foot_m, lengths_m: places::lengths(&anchors, &at) })
}
