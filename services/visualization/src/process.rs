//! The visualization process: subscribes to the robot's channels and publishes drawings.

use std::collections::BTreeMap;

use bus::clock::{SECOND_NS, WallClock, now_ns};
use bus::{Bus, BusError, CHANNELS_EVENT, ChannelWatch, Publisher, Tap};
use messages::ros::{Log, MarkerArray, OccupancyGrid, Path, PointCloud2, PoseStamped, TfMessage};
use runtime::Chassis;

use crate::{Drawing, Kind, Visualization};

/// Time between two frames, ns: 25 per second look smooth.
const FRAME_NS: u64 = 40_000_000;
/// Time between two frames of the slowly changing drawings, ns.
const SLOW_NS: u64 = SECOND_NS / 2;

/// A publisher for one kind of drawing.
enum Port {
    Tf(Publisher<TfMessage>),
    Pose(Publisher<PoseStamped>),
    Path(Publisher<Path>),
    Markers(Publisher<MarkerArray>),
    Cloud(Publisher<PointCloud2>),
    Grid(Publisher<OccupancyGrid>),
    Log(Publisher<Log>),
}

impl Port {
    fn open(bus: &Bus, channel: &str, kind: Kind) -> Result<Self, BusError> {
        Ok(match kind {
            Kind::Tf => Self::Tf(bus.publisher(channel)?),
            Kind::Pose => Self::Pose(bus.publisher(channel)?),
            Kind::Path => Self::Path(bus.publisher(channel)?),
            Kind::Markers => Self::Markers(bus.publisher(channel)?),
            Kind::Cloud => Self::Cloud(bus.publisher(channel)?),
            Kind::Grid => Self::Grid(bus.publisher(channel)?),
            Kind::Log => Self::Log(bus.publisher(channel)?),
        })
    }

    /// Publishes a body; ignores one of wrong length, which the tests exclude.
    fn send(&mut self, body: &[u8]) -> Result<(), BusError> {
        macro_rules! send {
            ($port:expr, $kind:ty) => {
                match <$kind>::from_body(body) {
                    Some(mut sample) => $port.send(&mut sample).map(|_| ()),
                    None => Ok(()),
                }
            };
        }
        match self {
            Self::Tf(port) => send!(port, TfMessage),
            Self::Pose(port) => send!(port, PoseStamped),
            Self::Path(port) => send!(port, Path),
            Self::Markers(port) => send!(port, MarkerArray),
            Self::Cloud(port) => send!(port, PointCloud2),
            Self::Grid(port) => send!(port, OccupancyGrid),
            Self::Log(port) => send!(port, Log),
        }
    }
}

/// The open publishers.
#[derive(Default)]
struct Ports {
    open: BTreeMap<String, Port>,
    /// Whether a lack of memory was reported.
    reported: bool,
}

impl Ports {
    fn send(&mut self, bus: &Bus, drawing: &Drawing) -> Result<(), BusError> {
        if !self.open.contains_key(&drawing.channel) {
            match Port::open(bus, &drawing.channel, drawing.kind) {
                Ok(port) => {
                    self.open.insert(drawing.channel.clone(), port);
                }
                // Retried with the next frame.
                Err(error @ BusError::NoMemory { .. }) => {
                    if !std::mem::replace(&mut self.reported, true) {
                        tracing::warn!("{error}");
                    }
                    return Ok(());
                }
                Err(error) => return Err(error),
            }
        }
        self.open.get_mut(&drawing.channel).map_or(Ok(()), |port| port.send(&drawing.body))
    }
}

/// Runs until the end of the process is requested.
///
/// # Errors
/// The system file or the domain cannot be used.
pub fn run(chassis: &mut Chassis) -> anyhow::Result<()> {
    let robot = chassis.system_file()?.robot_file()?.robot()?;
    let clock = chassis.bus().domain().wall_clock().unwrap_or_else(WallClock::now);
    let mut visualization = Visualization::new(&robot, clock.offset_ns());
    let (mut watch, mut taps, mut ports) = (ChannelWatch::new(), Vec::<Tap>::new(), Ports::default());
    let mut waiter = chassis.waiter(&[CHANNELS_EVENT])?;
    let (mut frame_ns, mut slow_ns, mut search_ns) = (0, 0, 0);
    chassis.ready()?;
    while chassis.running() {
        let wake = chassis.wait(&mut waiter, Some(frame_ns))?;
        chassis.pass_begin();
        let now = now_ns();
        if wake.channel(0) || now >= search_ns {
            search_ns = now + SECOND_NS;
            for info in watch.new_channels(chassis.bus())?.into_iter().filter(|info| Visualization::wants(&info.name)) {
                match chassis.bus().tap(&info.name) {
                    Ok(tap) => {
                        // A channel that was created again, perhaps with another type, replaces the old one.
                        taps.retain(|old| old.info().name != info.name);
                        taps.push(tap);
                    }
                    Err(BusError::NoChannel { .. }) => {}
                    Err(error) => tracing::warn!("channel {} is not drawn: {error}", info.name),
                }
            }
        }
        for tap in &mut taps {
            let (name, type_name) = (tap.info().name.clone(), tap.info().type_name.clone());
            while let Some(drawn) = tap.receive(|raw| visualization.record(&name, &type_name, raw.bytes))? {
                if let Some(drawing) = drawn {
                    ports.send(chassis.bus(), &drawing)?;
                }
            }
        }
        if now >= frame_ns {
            frame_ns = now + FRAME_NS;
            for drawing in visualization.frame() {
                ports.send(chassis.bus(), &drawing)?;
            }
        }
        if now >= slow_ns {
            slow_ns = now + SLOW_NS;
            for drawing in visualization.slow_frame() {
                ports.send(chassis.bus(), &drawing)?;
            }
        }
        chassis.pass_end();
        chassis.report_lost(taps.iter().map(Tap::lost).sum());
    }
    Ok(())
}
