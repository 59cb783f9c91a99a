//! A run as one record per cable.

use std::collections::BTreeMap;
use std::path::Path;

use command::{Answer, Failure};
use identification::Record;
use messages::{CABLES, MotorAuthority, MotorInput, MotorState, NodeEstimate};

use crate::report;

/// Most cycles that are used: ten minutes at 100 Hz say as much as an hour.
const MOST_CYCLES: usize = 60_000;

/// What is used of a run.
pub(crate) struct Recorded {
    pub cables: Vec<Record>,
    pub used_s: f64,
    /// By the run's robot file, kg.
    pub node_mass_kg: Option<f64>,
}

/// Samples of a cycle.
#[derive(Default)]
struct Row {
    begin_ns: Option<u64>,
    state: Option<Box<MotorState>>,
    mode: Option<(u8, f64)>,
    tension_n: Option<[f64; CABLES]>,
}

/// Reads a run.
///
/// # Errors
/// It cannot be read, or has no flight.
pub(crate) fn read(run: &Path) -> Answer<Recorded> {
    let mut reader = runlog::RunReader::open(run).map_err(Failure::bad)?;
    let mut rows: BTreeMap<(u64, u64), Row> = BTreeMap::new();
    let mut flown = 0;
    while let Some(sample) = reader.next_sample().map_err(Failure::not_now)? {
        match sample.channel.name.as_str() {
            "motor/input" => {
                let Some(input) = sample.decode::<MotorInput>() else { continue };
                rows.entry((input.header.life, input.header.cycle)).or_default().begin_ns = Some(input.begin_ns);
            }
            "motor/state" => {
                let Some(state) = sample.decode::<MotorState>() else { continue };
                rows.entry((state.header.life, state.header.cycle)).or_default().state = Some(Box::new(state));
            }
            "motor/authority" => {
                let Some(authority) = sample.decode::<MotorAuthority>() else { continue };
                flown += usize::from(authority.mode == MotorAuthority::MODE_FOLLOWING);
                let place = (authority.header.life, authority.header.cycle);
                rows.entry(place).or_default().mode = Some((authority.mode, authority.period_s));
            }
            "node/estimate/a" => {
                let Some(estimate) = sample.decode::<NodeEstimate>() else { continue };
                let place = (estimate.header.life, estimate.header.cycle);
                rows.entry(place).or_default().tension_n = (estimate.valid == 1).then_some(estimate.tension_n);
            }
            _ => {}
        }
        if flown > MOST_CYCLES {
            break;
        }
    }
    // The reader has the attachments of a file once it has read its beginning.
    let robot = report::load_robot_file(run, reader.attachments());
    let cables = longest(&rows);
    let used_s = cables.first().map_or(0.0, |record| record.len() as f64 * record.period_s);
    if cables.is_empty() {
        let what = "no flight with a known position, or motor/input, motor/state or motor/authority was not recorded";
        return Err(Failure::BadInput(format!("{} has {what}", run.display())));
    }
    Ok(Recorded {
        cables,
        used_s,
        node_mass_kg: robot.and_then(|robot| robot.robot().ok()).map(|robot| robot.node_mass_kg()),
    })
}

/// The longest stretch of complete consecutive cycles.
fn longest(rows: &BTreeMap<(u64, u64), Row>) -> Vec<Record> {
    let (mut best, mut now) = (Vec::new(), Vec::<Record>::new());
    let mut last = None;
    for (place, row) in rows {
        let (life, cycle) = *place;
        let follows = last == Some((life, cycle.wrapping_sub(1)));
        let complete = (row.begin_ns, row.state.as_deref().filter(|state| state.position_known > 0), row.mode);
        let (Some(begin_ns), Some(state), Some((mode, period_s))) = complete else {
            last = None;
            continue;
        };
        if !follows {
            keep_longer(&mut best, std::mem::take(&mut now));
            let record = || Record { period_s, ..Record::default() };
            now = (0..usize::from(state.cable_count).min(CABLES)).map(|_| record()).collect();
        }
        last = Some(*place);
        for (cable, record) in now.iter_mut().enumerate() {
            push(record, cable, begin_ns, state, mode, row.tension_n);
        }
    }
    keep_longer(&mut best, now);
    best
}

fn keep_longer(best: &mut Vec<Record>, other: Vec<Record>) {
    if other.first().map_or(0, Record::len) > best.first().map_or(0, Record::len) {
        *best = other;
    }
}

fn push(
    record: &mut Record,
    cable: usize,
    begin_ns: u64,
    state: &MotorState,
    mode: u8,
    tension_n: Option<[f64; CABLES]>,
) {
    record.sent_s.push(begin_ns as f64 * 1e-9);
    record.command_m_s.push(state.command_m_s[cable]);
    record.read_s.push(state.sampled_ns[cable] as f64 * 1e-9);
    record.length_m.push(state.length_m[cable]);
    record.duty.push(state.duty[cable]);
    record.current_a.push(state.current_a[cable]);
    // Two motors on a unit; a run with one per unit states the supply of each.
    let unit = if state.unit_count == state.cable_count { cable } else { cable / 2 };
    record.supply_v.push(state.supply_v[unit.min(state.supply_v.len() - 1)]);
    record.tension_n.push(tension_n.map_or(f64::NAN, |tension_n| tension_n[cable]));
    let speeds = [
        MotorAuthority::MODE_HOLDING,
        MotorAuthority::MODE_JOGGING,
        MotorAuthority::MODE_FOLLOWING,
        MotorAuthority::MODE_STOPPING,
    ];
    record.is_flown.push(speeds.contains(&mode));
}
