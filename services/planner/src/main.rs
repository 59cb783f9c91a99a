//! The planner: answers requests, publishes `plan/motion` and `plan/status`.

use std::process::ExitCode;

use bus::{Bus, Subscriber, clock::now_ns};
use messages::{FieldMap, MotorAuthority, NodeEstimate, PlanMotion, PlanStatus, SLOT_NAMES};
use planner::progress::{Keeper, Progress};
use planner::{Planner, PlannerConfig, Seen, requests};
use service::{Args, Chassis};

/// Twenty times a second, so that a slide to the next segment is seen long before the one after it is needed.
const PERIOD_NS: u64 = 50_000_000;

fn main() -> ExitCode {
    service::main("planner", run)
}

/// The map that the planner waits for, and the newest of it.
struct Map {
    name: String,
    channel: Subscriber<FieldMap>,
    newest: Option<Box<FieldMap>>,
}

impl Map {
    fn of(bus: &Bus, name: &str) -> anyhow::Result<Self> {
        Ok(Self { name: name.to_owned(), channel: bus.subscriber(&format!("map/{name}"))?, newest: None })
    }

    fn look(&mut self) -> anyhow::Result<Option<&FieldMap>> {
        if let Some(map) = self.channel.latest()? {
            self.newest = Some(Box::new(map));
        }
        Ok(self.newest.as_deref())
    }
}

fn run(_args: &Args, chassis: &mut Chassis) -> anyhow::Result<()> {
    let file = chassis.box_file()?.clone();
    let mut planner = Planner::new(PlannerConfig::of(&file, file.robot_file()?.robot()?));
    let (folder, name) = (file.state_folder(), file.state_name(chassis.bus().domain().name()));
    let missions = file.planner.missions.as_path();
    match Progress::load(&folder, &name) {
        Ok(progress) => progress.into_iter().for_each(|progress| planner.remember(progress)),
        Err(error) => tracing::warn!("{error}"),
    }
    // Without it missions are flown as well, only not continued.
    let mut keeper = Keeper::start(&folder, &name).inspect_err(|error| tracing::warn!("{error}")).ok();
    let bus = chassis.bus();
    let mut authorities = bus.subscriber::<MotorAuthority>("motor/authority")?;
    let [a, b] = SLOT_NAMES.map(|slot| bus.subscriber::<NodeEstimate>(&format!("node/estimate/{slot}")));
    let mut estimates = [a?, b?];
    let mut motions = bus.publisher::<PlanMotion>("plan/motion")?;
    let mut statuses = bus.publisher::<PlanStatus>("plan/status")?;
    let mut server = bus.server(chassis.name())?;
    let mut waiter = chassis.waiter(&[server.event()])?;
    let mut maps: Option<Map> = None;
    let (mut authority, mut newest, mut state) = (None::<MotorAuthority>, [None::<NodeEstimate>; 2], 0);
    let mut due_ns = now_ns();
    chassis.ready()?;
    while chassis.running() {
        chassis.wait(&mut waiter, Some(due_ns))?;
        authority = authorities.latest()?.or(authority);
        for (newest, estimates) in newest.iter_mut().zip(&mut estimates) {
            *newest = estimates.latest()?.or(*newest);
        }
        let estimate = messages::blended_estimate(authority.as_ref(), [newest[0].as_ref(), newest[1].as_ref()]);
        if planner.wants_map() != maps.as_ref().map(|map| map.name.as_str()) {
            maps = planner.wants_map().map(|name| Map::of(chassis.bus(), name)).transpose()?;
        }
        let map = maps.as_mut().map(Map::look).transpose()?.flatten();
        let seen = Seen { now_ns: now_ns(), authority: authority.as_ref(), estimate: estimate.as_ref(), map };
        let mut asked = false;
        while let Some(call) = server.try_next()? {
            let (request, awaited) = (&call.request, || call.is_awaited());
            let (accepted, sentence) = requests::answer(&mut planner, request, awaited, missions, &seen);
            tracing::info!("{sentence}");
            call.answer(accepted, &sentence)?;
            asked = true;
        }
        if asked || now_ns() >= due_ns {
            chassis.pass_begin();
            let (mut motion, mut status) = planner.step(&seen);
            motions.send(&mut motion)?;
            statuses.send(&mut status)?;
            if let Some(keeper) = &mut keeper {
                keeper.keep(planner.progress(), seen.now_ns);
            }
            chassis.pass_end();
            if status.state != state {
                state = status.state;
                tracing::info!("mission \"{}\" {}", messages::text_of(&status.mission), planner::state_text(&status));
            }
            due_ns = now_ns() + PERIOD_NS;
        }
        chassis.report_lost(authorities.lost() + estimates[0].lost() + estimates[1].lost());
    }
    Ok(())
}
