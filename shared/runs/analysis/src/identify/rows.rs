//! A run as one record per cable.

use std::collections::BTreeMap;
use std::path::Path;

use cable_robot::RobotParts;
use command::{Answer, Failure};
use identification::Record;
use messages::{CABLES, MotorAuthority, MotorInput, MotorState, NodeEstimate};
use runlog::{Attachment, RecordedSample, RunReader};

use super::stretch::{Row, Stretches};
use crate::drive_units::drive_units;
use crate::report;

/// Cycles whose samples are awaited: those of one cycle are within milliseconds of each other in the file, in no
/// particular order.
const AWAITED_CYCLES: usize = 512;

/// What is used of a run.
pub(crate) struct Recorded {
    pub cables: Vec<Record>,
    pub used_s: f64,
    /// By the run's robot file.
    pub robot: Option<RobotParts>,
}

/// Reads a run.
///
/// # Errors
/// It cannot be read, or has no flight.
pub(crate) fn read(run: &Path) -> Answer<Recorded> {
    let mut reader = RunReader::open(run).map_err(Failure::bad)?;
    // The attachments precede the first sample.
    reader.next_sample().map_err(Failure::not_now)?;
    let robot = report::load_robot_file(run, reader.attachments())?;
    let mut stretches = Stretches::new(unit_of_cable(run, reader.attachments()));
    let mut reader = RunReader::open(run).map_err(Failure::bad)?;
    let mut awaited = Awaited::default();
    while let Some(sample) = reader.next_sample().map_err(Failure::not_now)? {
        awaited.add(&sample);
        if awaited.rows.len() > AWAITED_CYCLES {
            awaited.pop(&mut stretches);
        }
        if stretches.are_full() {
            break;
        }
    }
    while awaited.pop(&mut stretches) {}
    let cables = stretches.longest();
    if cables.is_empty() {
        let what = "no flight with a known position, or motor/input, motor/state or motor/authority was not recorded";
        return Err(Failure::BadInput(format!("{} has {what}", run.display())));
    }
    Ok(Recorded {
        used_s: cables.first().map_or(0.0, |record| record.len() as f64 * record.period_s),
        cables,
        robot: robot.and_then(|robot| robot.parts().ok()),
    })
}

/// Rows of the newest cycles, by life and cycle.
#[derive(Default)]
struct Awaited {
    rows: BTreeMap<(u64, u64), Row>,
    popped: Option<(u64, u64)>,
}

impl Awaited {
    fn add(&mut self, sample: &RecordedSample<'_>) {
        match sample.channel.name.as_str() {
            "motor/input" => {
                let Some(input) = sample.decode::<MotorInput>() else { return };
                self.fill((input.header.life, input.header.cycle), |row| row.begin_ns = Some(input.begin_ns));
            }
            "motor/state" => {
                let Some(state) = sample.decode::<MotorState>() else { return };
                self.fill((state.header.life, state.header.cycle), |row| row.state = Some(Box::new(state)));
            }
            "motor/authority" => {
                let Some(authority) = sample.decode::<MotorAuthority>() else { return };
                let mode = (authority.mode, authority.period_s);
                self.fill((authority.header.life, authority.header.cycle), |row| row.mode = Some(mode));
            }
            "node/estimate/a" => {
                let Some(estimate) = sample.decode::<NodeEstimate>() else { return };
                let tension_n = (estimate.valid == 1).then_some(estimate.tension_n);
                self.fill((estimate.header.life, estimate.header.cycle), |row| row.tension_n = tension_n);
            }
            _ => {}
        }
    }

    fn fill(&mut self, place: (u64, u64), fill: impl FnOnce(&mut Row)) {
        // What comes later than all others would be a cycle of its own, and end the stretch.
        if self.popped.is_none_or(|popped| place > popped) {
            fill(self.rows.entry(place).or_default());
        }
    }

    /// Passes on the oldest row; false if there is none.
    fn pop(&mut self, stretches: &mut Stretches) -> bool {
        let Some((place, row)) = self.rows.pop_first() else { return false };
        self.popped = Some(place);
        stretches.add(place, &row);
        true
    }
}

/// The drive unit of each cable by the run's system file, counted as motor-io does; `None`: unknown.
fn unit_of_cable(run: &Path, inside: &[Attachment]) -> [Option<usize>; CABLES] {
    let mut unit_of_cable = [None; CABLES];
    for (unit, its) in drive_units(run, inside).into_iter().enumerate() {
        for cable in its.cables {
            if let Some(of_cable) = cable.checked_sub(1).and_then(|cable| unit_of_cable.get_mut(cable)) {
                *of_cable = Some(unit);
            }
        }
    }
    unit_of_cable
}
