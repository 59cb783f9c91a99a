//! Flights that differ only in their worlds, as one line.

use lockstep::Flight;
use serde_json::{Value, json};

use crate::fly::{Ended, Flown, is_completed};
use crate::variants::Variant;

/// Heads of the columns after the name of the group.
pub(crate) const HEADS: [&str; 5] = ["completed", "tracking RMS, mm", "truth RMS, mm", "step, mm/s", "energy, J"];
/// What the columns are.
pub(crate) const LEGEND: &str = "over the worlds: median / largest of the completed flights.";

/// Flights in several worlds.
pub(crate) struct Group<'a> {
    name: String,
    rows: Vec<&'a (&'a Variant, &'a Flown)>,
}

/// Returns the groups of flights in more than one world.
pub(crate) fn groups<'a>(rows: &'a [(&'a Variant, &'a Flown)]) -> Vec<Group<'a>> {
    // Worlds vary fastest.
    let alike = rows.chunk_by(|(a, _), (b, _)| a.label() == b.label());
    let groups = alike.filter_map(|rows| {
        let (first, _) = rows.first()?;
        Some(Group { name: first.label(), rows: rows.iter().collect() })
    });
    groups.filter(|group| group.rows.len() > 1).collect()
}

impl Group<'_> {
    /// Median and largest value of the completed flights; `None` without one.
    fn spread(&self, figure: fn(&Flight) -> f64) -> Option<[f64; 2]> {
        let mut values: Vec<f64> = self.completed().map(figure).collect();
        values.sort_by(f64::total_cmp);
        let middle = values.len() / 2;
        let median = match values.len() % 2 {
            0 => 0.5 * (values.get(middle.checked_sub(1)?)? + values.get(middle)?),
            _ => *values.get(middle)?,
        };
        Some([median, *values.last()?])
    }

    fn completed(&self) -> impl Iterator<Item = &Flight> {
        self.rows.iter().filter_map(|(_, flown)| match &flown.ended {
            Ended::Done(flight) if is_completed(flight) => Some(flight.as_ref()),
            _ => None,
        })
    }

    /// Returns the line of the table.
    pub(crate) fn line(&self) -> Vec<String> {
        let spread = |figure: fn(&Flight) -> f64, factor: f64, digits: usize| match self.spread(figure) {
            Some([median, most]) => format!("{:.digits$} / {:.digits$}", median * factor, most * factor),
            None => "-".to_owned(),
        };
        vec![
            if self.name.is_empty() { "as configured".to_owned() } else { self.name.clone() },
            format!("{} of {}", self.completed().count(), self.rows.len()),
            spread(|flight| flight.estimate.rms_m, 1e3, 2),
            spread(|flight| flight.truth.rms_m, 1e3, 2),
            spread(|flight| flight.step_m_s, 1e3, 1),
            spread(|flight| flight.energy_j, 1.0, 1),
        ]
    }

    /// Returns the group as JSON.
    pub(crate) fn json(&self) -> Value {
        let spread = |figure: fn(&Flight) -> f64| {
            self.spread(figure).map(|[median, most]| json!({ "median": median, "max": most }))
        };
        let numbers: Vec<usize> = self.rows.iter().map(|(variant, _)| variant.number).collect();
        json!({
            "name": self.name,
            "flights": numbers,
            "completed": self.completed().count(),
            "tracking_rms_m": spread(|flight| flight.estimate.rms_m),
            "truth_rms_m": spread(|flight| flight.truth.rms_m),
            "step_m_s": spread(|flight| flight.step_m_s),
            "energy_j": spread(|flight| flight.energy_j),
        })
    }
}
