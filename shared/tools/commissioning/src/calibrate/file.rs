//! The measurements file: what `nims calibrate` reads and `nims setup` writes. Lengths in m; anchors and points count from 1 in the
//! file.

use cable_robot::CableVec;
use calibration::{DirectHeight, Loss, Measurements, Method, Range, Side};
use serde::{Deserialize, Serialize};

/// Standard deviation of a range where none is stated, m: a laser of ±1.5 mm, and a plumb line that is never quite still.
const DEFAULT_SIGMA_RANGE_M: f64 = 0.003;

/// Standard deviation of a directly measured height where none is stated, m: the floor below the pulley is not quite the
/// reference plane.
const DEFAULT_SIGMA_HEIGHT_M: f64 = 0.01;

/// The measurements file.
#[derive(Debug, Clone, Default, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct File {
    /// Side of the line from anchor 1 to 2 on which anchor 3 stands, and any other anchor that has no side of its own:
    /// 1 left (default), -1 right.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub side: Option<i64>,
    /// Standard deviation of a length, m.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sigma_length_m: Option<f64>,
    /// Of a range that has none of its own, m.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sigma_range_m: Option<f64>,
    /// Of each coordinate of a known position, m.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sigma_gps_m: Option<f64>,
    /// How far off the scale of the lengths may be; none: exactly 1.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sigma_scale: Option<f64>,
    /// How far off the zeros of the lengths may be, m; none: exactly 0.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sigma_offset_m: Option<f64>,
    /// What the robot reckoned the lengths with, if they are its own.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub counts_per_m: Option<Vec<f64>>,
    /// How much lengths that do not fit count.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub loss: Option<LossName>,
    /// An answer with a coordinate less certain than this is refused, m.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub refuse_above_std_m: Option<f64>,
    /// How far `nims setup` has come with what is not a measurement.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub setup: Option<Setup>,
    /// Between plumb lines.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub range: Vec<RangeEntry>,
    /// Heights measured directly.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub height: Vec<HeightEntry>,
    /// Points of the reference plane.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub point: Vec<PointEntry>,
    /// Points that did not fit, and what was decided about them.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub doubt: Vec<Doubt>,
}

/// What `nims setup` was told beside measurements; nothing else reads it but for `pulleys`.
#[derive(Debug, Clone, Default, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Setup {
    /// How many pulleys there are.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pulleys: Option<usize>,
    /// About how high they are, m: a guess, for the plan.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub about_m: Option<f64>,
    /// Pairs of pulleys, lower number first, whose distance nobody measured.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub skipped: Vec<[usize; 2]>,
    /// Pulleys whose height nobody measured.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub unmeasured: Vec<usize>,
    /// How many points are wanted in all, each time it was said: [number of points then in the file, points wanted].
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub plan: Vec<[usize; 2]>,
    /// The lengths of a point of which some are still to come, m.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub lengths_so_far_m: Vec<f64>,
}

/// What was decided about a point that did not fit the others.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Doubt {
    /// Which.
    pub point: usize,
    /// Whether it counts.
    #[serde(rename = "use")]
    pub used: bool,
    /// How many points there were when that was decided.
    pub after: usize,
}

/// How much lengths that do not fit count.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum LossName {
    /// As all others.
    Squared,
    /// Less, the less they fit.
    Huber,
    /// Hardly.
    Cauchy,
}

/// A distance between two plumb lines.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct RangeEntry {
    /// One anchor.
    pub from: usize,
    /// The other.
    pub to: usize,
    /// The distance, m.
    pub m: f64,
    /// Its standard deviation, m.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sigma_m: Option<f64>,
    /// Of the anchor with the higher number.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub side: Option<i64>,
}

/// A place of the node on the reference plane.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct PointEntry {
    /// One per line, m.
    pub lengths_m: Vec<f64>,
    /// Where it was, if that is known, m.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gps_m: Option<[f64; 3]>,
}

/// A height measured directly.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct HeightEntry {
    /// Whose.
    pub anchor: usize,
    /// Above the reference plane, m.
    pub m: f64,
    /// Its standard deviation, m.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sigma_m: Option<f64>,
    /// With what; none: with the line.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub by: Option<HeightBy>,
}

/// With what a height was measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum HeightBy {
    /// The line itself, let out until it touches the floor.
    Line,
    /// A tape.
    Tape,
    /// A laser.
    Laser,
}

impl File {
    /// Which points count for this method, from 0: the GPS method takes those whose place is known, and none takes those that were
    /// decided against.
    #[must_use]
    pub fn used(&self, method: Method) -> Vec<usize> {
        let counts = |k: &usize| {
            let against = self.doubt.iter().any(|doubt| doubt.point == k + 1 && !doubt.used);
            !against && (method != Method::Gps || self.point[*k].gps_m.is_some())
        };
        (0..self.point.len()).filter(counts).collect()
    }

    /// Everything measured, for a calibration by this method.
    ///
    /// # Errors
    /// One clause, without the file's name: what cannot be used, where, what to do.
    pub fn measurements(&self, method: Method) -> Result<Measurements, String> {
        let said = self.setup.iter().filter_map(|setup| setup.pulleys);
        let named = self.range.iter().flat_map(|r| [r.from, r.to]).chain(self.height.iter().map(|h| h.anchor));
        let cables = named.chain(self.point.iter().map(|p| p.lengths_m.len())).chain(said).max().unwrap_or(0);
        if cables == 0 {
            return Err("it holds no measurements; give [[range]], [[point]] and [[height]] entries".to_owned());
        }
        let index = |what: &str, anchor: usize| {
            anchor.checked_sub(1).ok_or_else(|| format!("{what} names anchor 0; anchors count from 1"))
        };
        let mut measured = Measurements::new(cables);
        if cables > cable_robot::MAX_CABLES {
            return Err(format!("it names {cables} anchors; a robot has at most {}", cable_robot::MAX_CABLES));
        }
        let side = self.side.map(Side::from_sign).transpose().map_err(|e| e.to_string())?;
        measured.sides = vec![side; cables];
        for (k, r) in self.range.iter().enumerate() {
            let what = format!("[[range]] number {}", k + 1);
            let (from, to) = (index(&what, r.from)?, index(&what, r.to)?);
            if let Some(sign) = r.side {
                measured.sides[from.max(to)] = Some(Side::from_sign(sign).map_err(|e| format!("{what}: {e}"))?);
            }
            let sigma_m = r.sigma_m.or(self.sigma_range_m).unwrap_or(DEFAULT_SIGMA_RANGE_M);
            measured.ranges.push(Range { from, to, m: r.m, sigma_m });
        }
        if let Some(doubt) = self.doubt.iter().find(|doubt| !(1..=self.point.len()).contains(&doubt.point)) {
            return Err(format!("a [[doubt]] is about point {}; there are {}", doubt.point, self.point.len()));
        }
        for k in self.used(method) {
            let p = &self.point[k];
            measured
                .lengths_m
                .push(CableVec::from_slice(&p.lengths_m).map_err(|e| format!("[[point]] number {}: {e}", k + 1))?);
            measured.gps_m.extend(p.gps_m);
        }
        for (k, h) in self.height.iter().enumerate() {
            measured.heights.push(DirectHeight {
                anchor: index(&format!("[[height]] number {}", k + 1), h.anchor)?,
                m: h.m,
                sigma_m: h.sigma_m.unwrap_or(DEFAULT_SIGMA_HEIGHT_M),
                by_line: h.by.unwrap_or(HeightBy::Line) == HeightBy::Line,
            });
        }
        if let Some(counts) = &self.counts_per_m
            && (counts.len() != cables || counts.iter().any(|counts| !counts.is_finite() || *counts == 0.0))
        {
            return Err(format!(
                "counts_per_m is {counts:?}; accepted: one value for each of the {cables} lines, as in the system file; no key where the lengths are not the robot's own"
            ));
        }
        let set = |key: &mut f64, value: Option<f64>| *key = value.unwrap_or(*key);
        set(&mut measured.sigma_length_m, self.sigma_length_m);
        set(&mut measured.sigma_gps_m, self.sigma_gps_m);
        set(&mut measured.refuse_above_std_m, self.refuse_above_std_m);
        measured.sigma_scale = self.sigma_scale;
        measured.sigma_offset_m = self.sigma_offset_m;
        measured.loss = match self.loss {
            Some(LossName::Squared) => Loss::Squared,
            Some(LossName::Cauchy) => Loss::Cauchy,
            // A field team's data hold an outlier sooner or later, and without one this costs 5 %.
            Some(LossName::Huber) | None => Loss::Huber,
        };
        Ok(measured)
    }
}
