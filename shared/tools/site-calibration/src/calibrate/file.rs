//! The measurements file that `nims calibrate` reads and `nims setup` writes. Lengths are in m; anchors and points
//! count from 1 in the file.

use super::tape::{self, TapeEntry};
use cable_robot::CableVec;
use cable_robot::anchors::RADII_M;
use calibration::{DirectHeight, Loss, Measurements, Method, Range, Side};
use config::PulleyKind;
use serde::{Deserialize, Serialize};

/// Default standard deviation of a range, m: a laser of ±1.5 mm, and a plumb line that never hangs quite still.
const DEFAULT_SIGMA_RANGE_M: f64 = 0.003;

/// Default standard deviation of a directly measured height, m: the floor below the pulley deviates from the reference
/// plane.
const DEFAULT_SIGMA_HEIGHT_M: f64 = 0.01;

/// Largest difference between the cable that passes in one turn and the turn of the stated radius, as a share: a mark
/// on a cable, counted by eye. A diameter in place of a radius differs by half.
const TURN_SHARE: f64 = 0.15;

/// The measurements file.
#[derive(Debug, Clone, Default, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct MeasurementsFile {
    /// Side of the line from anchor 1 to 2 on which anchor 3 stands, and any other anchor without its own side: 1 left
    /// (default), -1 right.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub side: Option<i64>,
    /// Standard deviation of a cable length, m.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sigma_length_m: Option<f64>,
    /// Standard deviation of a range without its own, m.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sigma_range_m: Option<f64>,
    /// Standard deviation of each coordinate of a known position, m.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sigma_gps_m: Option<f64>,
    /// Standard deviation of the scale of the lengths from 1; without it the scale is exactly 1.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sigma_scale: Option<f64>,
    /// Standard deviation of the zero offsets of the lengths, m; without it they are exactly 0.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sigma_offset_m: Option<f64>,
    /// What the cables leave from, as in the robot file; without it the calibration asks for it where it matters.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pulley: Option<PulleyKind>,
    /// Radius of each pulley to the middle of the cable, m per cable; 0 for an eye. With `pulley = "swivel"` only.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub pulley_radius_m: Vec<f64>,
    /// Cable that passes in one turn of a pulley, m: a second measurement of its size, which no slip between radius
    /// and diameter survives.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pulley_turn_m: Option<f64>,
    /// Standard deviation of a common deviation of the radii, m; without it they are exact.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sigma_pulley_radius_m: Option<f64>,
    /// Standard deviation of the scale of each cable about the common one; without it there is no difference.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sigma_cable_scale: Option<f64>,
    /// Standard deviation, per axis, of the point where each cable is tied to the node, m; without it all meet exactly.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sigma_attachment_m: Option<f64>,
    /// The part of `sigma_length_m` that is the height of the floor at a point, m: the same for all cables of the
    /// point.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sigma_floor_m: Option<f64>,
    /// Encoder counts per metre with which the robot computed the lengths, if the robot measured them.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub counts_per_m: Option<Vec<f64>>,
    /// Weight of lengths that do not fit.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub loss: Option<LossName>,
    /// Reject a result in which the standard deviation of a coordinate exceeds this, m.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub refuse_above_std_m: Option<f64>,
    /// Answers in `nims setup` that are not measurements.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub setup: Option<Setup>,
    /// Distances between plumb lines.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub range: Vec<RangeEntry>,
    /// Directly measured heights.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub height: Vec<HeightEntry>,
    /// Points on the reference plane.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub point: Vec<PointEntry>,
    /// Marks on cables that moved along a tape.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub tape: Vec<TapeEntry>,
    /// Decisions about points that do not fit.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub doubt: Vec<PointDecision>,
}

/// Answers in `nims setup` that are not measurements; other commands read only `pulleys`.
#[derive(Debug, Clone, Default, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Setup {
    /// Number of pulleys.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pulleys: Option<usize>,
    /// Approximate height of the pulleys, m: a guess for planning points.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub about_m: Option<f64>,
    /// Pairs of pulleys whose distance was not measured, lower number first.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub skipped: Vec<[usize; 2]>,
    /// Pulleys whose height was not measured.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub unmeasured: Vec<usize>,
    /// Total number of points wanted, at each time it was answered: [number of points in the file at that time, points
    /// wanted].
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub plan: Vec<[usize; 2]>,
    /// Lengths of an incomplete point, m.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub lengths_so_far_m: Vec<f64>,
    /// Reading of a tape that is far from what the robot counted, until it is confirmed.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tape_so_far: Option<TapeEntry>,
}

/// Decision about a point that does not fit the others.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct PointDecision {
    /// Number of the point, from 1.
    pub point: usize,
    /// Whether the point is used.
    #[serde(rename = "use")]
    pub used: bool,
    /// Number of points in the file at the time of the decision.
    pub after: usize,
}

/// Loss function for lengths that do not fit.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum LossName {
    /// Full weight.
    Squared,
    /// Weight decreases with the residual.
    Huber,
    /// Nearly no weight for large residuals.
    Cauchy,
}

/// A distance between two plumb lines.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct RangeEntry {
    /// First anchor.
    pub from: usize,
    /// Second anchor.
    pub to: usize,
    /// Distance, m.
    pub m: f64,
    /// Standard deviation, m.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sigma_m: Option<f64>,
    /// Side on which the anchor with the higher number stands: 1 left, -1 right.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub side: Option<i64>,
}

/// A position of the node on the reference plane.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct PointEntry {
    /// Lengths, one per cable, m.
    pub lengths_m: Vec<f64>,
    /// Position, if it is known, m.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gps_m: Option<[f64; 3]>,
}

/// A directly measured height.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct HeightEntry {
    /// Anchor number.
    pub anchor: usize,
    /// Height above the reference plane, m.
    pub m: f64,
    /// Standard deviation, m.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sigma_m: Option<f64>,
    /// Instrument; default: the cable.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub by: Option<HeightBy>,
}

/// Instrument with which a height was measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum HeightBy {
    /// The cable itself, unwound until it touches the floor.
    Line,
    /// Tape measure.
    Tape,
    /// Laser distance meter.
    Laser,
}

impl MeasurementsFile {
    /// Returns the points that a method uses, from 0: the GPS method uses points with a known position; no method uses
    /// rejected points.
    #[must_use]
    pub fn used(&self, method: Method) -> Vec<usize> {
        let counts = |k: &usize| {
            let against = self.doubt.iter().any(|doubt| doubt.point == k + 1 && !doubt.used);
            !against && (method != Method::Gps || self.point[*k].gps_m.is_some())
        };
        (0..self.point.len()).filter(counts).collect()
    }

    /// Converts the file to measurements for this method.
    ///
    /// # Errors
    /// One clause without the file name: what cannot be used, where, and what to do.
    pub fn measurements(&self, method: Method) -> Result<Measurements, String> {
        let said = self.setup.iter().filter_map(|setup| setup.pulleys);
        let named = self.range.iter().flat_map(|r| [r.from, r.to]).chain(self.height.iter().map(|h| h.anchor));
        let cables = named.chain(self.point.iter().map(|p| p.lengths_m.len())).chain(said).max().unwrap_or(0);
        if cables == 0 {
            return Err("it has no measurements; add [[range]], [[point]] and [[height]] entries".to_owned());
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
            return Err(format!("a [[doubt]] refers to point {}; there are {} points", doubt.point, self.point.len()));
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
                "counts_per_m is {counts:?}; accepted: one value for each of the {cables} cables, as in the system file; omit the key if the robot did not measure the lengths"
            ));
        }
        self.correct_counted_lengths(&mut measured, cables)?;
        measured.pulley_radius_m = self.radii(cables)?;
        self.check_turn(&measured.pulley_radius_m)?;
        self.set_options(&mut measured);
        Ok(measured)
    }

    /// Divides every length that the robot counted by its cable's scale from the tape.
    fn correct_counted_lengths(&self, measured: &mut Measurements, cables: usize) -> Result<(), String> {
        let scales = tape::scales(&self.tape, self.counts_per_m.as_deref(), cables)?;
        let Some(factors) = tape::factors(&scales) else { return Ok(()) };
        for lengths in &mut measured.lengths_m {
            *lengths = CableVec::from_fn(lengths.len(), |i| lengths[i] / factors.get(i).copied().unwrap_or(1.0));
        }
        for height in measured.heights.iter_mut().filter(|height| height.by_line) {
            height.m /= factors.get(height.anchor).copied().unwrap_or(1.0);
        }
        Ok(())
    }

    /// Compares the stated radii with the cable that passes in one turn.
    fn check_turn(&self, radii_m: &[f64]) -> Result<(), String> {
        let Some(turn_m) = self.pulley_turn_m else { return Ok(()) };
        let wheels: Vec<f64> = radii_m.iter().copied().filter(|r| *r > 0.0).collect();
        if wheels.is_empty() {
            return Err("pulley_turn_m describes pulleys; add pulley = \"swivel\" and pulley_radius_m".to_owned());
        }
        let mean_m = wheels.iter().sum::<f64>() / wheels.len() as f64;
        let expected_m = std::f64::consts::TAU * mean_m;
        if (turn_m / expected_m - 1.0).abs() <= TURN_SHARE {
            return Ok(());
        }
        Err(format!(
            "one turn of a wheel of {:.0} mm radius, {:.0} mm across, passes {:.0} mm of cable, and {:.0} mm was measured: \
             measure both again, the radius is half of what the wheel measures across",
            1e3 * mean_m,
            2e3 * mean_m,
            1e3 * expected_m,
            1e3 * turn_m
        ))
    }

    /// Sets the standard deviations, the limits and the loss that the file states.
    fn set_options(&self, measured: &mut Measurements) {
        measured.sigma_pulley_radius_m = self.sigma_pulley_radius_m;
        measured.sigma_cable_scale = self.sigma_cable_scale;
        measured.sigma_attachment_m = self.sigma_attachment_m;
        measured.sigma_floor_m = self.sigma_floor_m;
        let set = |key: &mut f64, value: Option<f64>| *key = value.unwrap_or(*key);
        set(&mut measured.sigma_length_m, self.sigma_length_m);
        set(&mut measured.sigma_gps_m, self.sigma_gps_m);
        set(&mut measured.refuse_above_std_m, self.refuse_above_std_m);
        measured.sigma_scale = self.sigma_scale;
        measured.sigma_offset_m = self.sigma_offset_m;
        measured.loss = match self.loss {
            Some(LossName::Squared) => Loss::Squared,
            Some(LossName::Cauchy) => Loss::Cauchy,
            // Field data contain an outlier sooner or later; on data without outliers this loss costs 5 % accuracy.
            Some(LossName::Huber) | None => Loss::Huber,
        };
    }

    /// The method where none is asked for: for pulleys the joint one, which alone weighs what is not quite known about
    /// them, and for lengths that `nims setup` captured, whose zeros it determines; for others that of the paper.
    #[must_use]
    pub fn usual_method(&self) -> Method {
        let captured = self.setup.is_some() && self.sigma_offset_m.is_some();
        if captured || self.pulley == Some(PulleyKind::Swivel) { Method::Joint } else { Method::Survey }
    }

    /// The radius of each pulley, m: zeros if the cables leave from eyes, empty if the file does not state it.
    fn radii(&self, cables: usize) -> Result<Vec<f64>, String> {
        let radii_m = &self.pulley_radius_m;
        match self.pulley {
            Some(PulleyKind::Swivel) if radii_m.len() == cables && radii_m.iter().all(|r| RADII_M.contains(r)) => {
                Ok(radii_m.clone())
            }
            Some(PulleyKind::Swivel) => Err(format!(
                "pulley_radius_m is {radii_m:?}; accepted with pulley = \"swivel\": one radius of 0 to {} m for each of the {cables} cables",
                RADII_M.end()
            )),
            kind if radii_m.is_empty() && self.sigma_pulley_radius_m.is_none() => {
                Ok(if kind.is_some() { vec![0.0; cables] } else { Vec::new() })
            }
            _ => Err("pulley_radius_m and sigma_pulley_radius_m describe pulleys; add pulley = \"swivel\"".to_owned()),
        }
    }
}
