//! Process of the planner: answers requests, publishes `plan/motion` and `plan/status`.

use bus::{Bus, Newest, clock::now_ns};
use messages::{
    FieldMap, MotorAuthority, MotorState, NodeEstimate, PlanMotion, PlanStatus, Rule, SLOT_NAMES, blended_estimate,
    newer,
};
use runtime::Chassis;
use std::path::Path;

use crate::progress::{Progress, ProgressWriter};
use crate::{Inputs, Planner, PlannerConfig, requests};

/// Map that the planner waits for, with its newest sample.
struct Map {
    name: String,
    /// `None` if it could not be opened: the mission that waits for it ends with a reason.
    channel: Option<Newest<FieldMap>>,
    newest: Option<Box<FieldMap>>,
}

impl Map {
    fn open(bus: &Bus, name: &str) -> Self {
        let channel = bus.newest(&format!("map/{name}")).inspect_err(|error| tracing::warn!("{error}")).ok();
        Self { name: name.to_owned(), channel, newest: None }
    }

    fn poll(&mut self) -> anyhow::Result<Option<&FieldMap>> {
        if let Some(channel) = &mut self.channel
            && let Some(map) = channel.latest()?
        {
            self.newest = Some(Box::new(map));
        }
        Ok(self.newest.as_deref())
    }
}

/// Runs until the chassis ends. `run_folder` holds the missions of the run.
///
/// # Errors
/// Errors of the files and of the bus.
pub fn run(chassis: &mut Chassis, run_folder: &Path) -> anyhow::Result<()> {
    let file = chassis.system_file()?.clone();
    let mut planner = Planner::new(PlannerConfig::from_files(&file, file.robot_file()?.robot()?));
    let (folder, name) = (file.state_folder(), file.state_name(chassis.bus().domain().name()));
    let rule = Rule::Live { ttl_cycles: file.estimator.ttl_cycles };
    match Progress::load(&folder, &name) {
        Ok(progress) => progress.into_iter().for_each(|progress| planner.remember(progress)),
        Err(error) => tracing::warn!("{error}"),
    }
    // Without it missions are flown, but cannot be continued.
    let mut keeper = ProgressWriter::start(&folder, &name).inspect_err(|error| tracing::warn!("{error}")).ok();
    let bus = chassis.bus();
    let mut authorities = bus.newest::<MotorAuthority>("motor/authority")?;
    let mut states = bus.newest::<MotorState>("motor/state")?;
    let [a, b] = SLOT_NAMES.map(|slot| bus.newest::<NodeEstimate>(&format!("node/estimate/{slot}")));
    let mut estimates = [a?, b?];
    let mut motions = bus.publisher::<PlanMotion>("plan/motion")?;
    let mut statuses = bus.publisher::<PlanStatus>("plan/status")?;
    let mut state = 0;
    let mut publish = |planner: &mut Planner, seen: &Inputs<'_>| -> anyhow::Result<()> {
        let (mut motion, mut status) = planner.step(seen);
        motions.send(&mut motion)?;
        statuses.send(&mut status)?;
        if status.state != state {
            state = status.state;
            tracing::info!("mission \"{}\" {}", messages::text_of(&status.mission), crate::state_text(&status));
        }
        Ok(())
    };
    let mut server = bus.server(chassis.name())?;
    let mut waiter = chassis.waiter(&[server.event()])?;
    let mut maps: Option<Map> = None;
    let (mut authority, mut newest) = (None::<MotorAuthority>, [None::<NodeEstimate>; 2]);
    let mut due_ns = now_ns();
    chassis.ready()?;
    while chassis.running() {
        chassis.wait(&mut waiter, Some(due_ns))?;
        authority = newer(authority, authorities.latest()?);
        states.latest()?.iter().for_each(|state| planner.follow_zero(state));
        for (newest, estimates) in newest.iter_mut().zip(&mut estimates) {
            // The newest that arrived: the rule below leaves out an invalid one, which the next one replaces.
            *newest = estimates.latest()?.or(*newest);
        }
        let estimate = blended_estimate(authority.as_ref(), [newest[0].as_ref(), newest[1].as_ref()], rule);
        if planner.wants_map() != maps.as_ref().map(|map| map.name.as_str()) {
            maps = planner.wants_map().map(|name| Map::open(chassis.bus(), name));
        }
        let map = maps.as_mut().map(Map::poll).transpose()?.flatten();
        let seen = Inputs { now_ns: now_ns(), authority: authority.as_ref(), estimate: estimate.as_ref(), map };
        chassis.pass_begin();
        let mut call = server.try_next()?;
        // First the end of a motion that motor-io has ended: a stop and the next motion may come in one pass.
        publish(&mut planner, &seen)?;
        let asked = call.is_some();
        while let Some(one) = call {
            let (request, awaited) = (&one.request, || one.is_awaited());
            let reason = requests::answer(&mut planner, request, awaited, run_folder, &seen);
            tracing::info!("{reason}");
            one.answer(&reason.answer())?;
            call = server.try_next()?;
        }
        if asked {
            publish(&mut planner, &seen)?;
        }
        if let Some(keeper) = &mut keeper {
            keeper.store(planner.progress(), seen.now_ns);
        }
        chassis.pass_end();
        due_ns = now_ns() + planner.pause_ns(authority.as_ref());
    }
    Ok(())
}
