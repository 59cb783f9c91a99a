//! The process: finds sensors as they come, and publishes samples and maps.

use bus::clock::{SECOND_NS, now_ns};
use bus::{BusError, CHANNELS_EVENT, ChannelInfo, ChannelWatch, Publisher, Subscriber, Tap};
use messages::{FieldMap, MotorAuthority, NodeEstimate, Sample};
use runtime::Chassis;

use georeference::{Counts, Decoder, Logger, LoggerConfig, SensorMap, complaint};

/// Between two looks at the channels: soon for whoever watches, and far less than what a channel holds. Nothing is woken per reading.
const PASS_NS: u64 = 20_000_000;
/// Shared memory for the samples and the map of a sensor.
const OUTLET_BYTES: usize = 4 << 20;
/// What of each map's period is spent at most on making maps, so that many of them cannot hold up the samples.
const MAP_SHARE: u64 = 10;
/// Between two words about readings without a place.
const COMPLAIN_NS: u64 = 10 * SECOND_NS;

/// What belongs to one sensor.
struct Sensor {
    tap: Tap,
    /// Its number with the logger.
    number: usize,
}

/// What goes out for one sensor, by the logger's number.
struct Outlet {
    samples: Publisher<Sample>,
    map: Option<(SensorMap, Publisher<FieldMap>)>,
    due_ns: u64,
}

/// Everything of the process but its chassis.
struct Desk {
    config: LoggerConfig,
    logger: Logger,
    authorities: Subscriber<MotorAuthority>,
    estimates: [Subscriber<NodeEstimate>; 2],
    sensors: Vec<Sensor>,
    outlets: Vec<Outlet>,
    /// By the logger's number: what was said of.
    said: Vec<Counts>,
    /// Channels that could not be listened to, and are tried again.
    again: Vec<ChannelInfo>,
}

/// Runs until it is told to stop.
///
/// # Errors
/// A system file that cannot be used, or a domain that cannot.
pub fn run(chassis: &mut Chassis) -> anyhow::Result<()> {
    let file = chassis.system_file()?;
    let config = LoggerConfig::of(&file.sensor_logger, &file.robot_file()?.robot()?);
    let bus = chassis.bus();
    let mut desk = Desk {
        logger: Logger::new(&config)?,
        config,
        authorities: bus.deep_subscriber("motor/authority")?,
        estimates: [bus.deep_subscriber("node/estimate/a")?, bus.deep_subscriber("node/estimate/b")?],
        sensors: Vec::new(),
        outlets: Vec::new(),
        said: Vec::new(),
        again: Vec::new(),
    };
    let mut watch = ChannelWatch::new();
    let mut waiter = chassis.waiter(&[CHANNELS_EVENT])?;
    let mut map = Box::<FieldMap>::default();
    let (mut search_ns, mut complain_ns, mut map_ns) = (0, now_ns() + COMPLAIN_NS, 0);
    chassis.ready()?;
    while chassis.running() {
        let wake = chassis.wait(&mut waiter, Some(now_ns() + PASS_NS))?;
        chassis.pass_begin();
        let now = now_ns();
        if wake.channel(0) || now >= search_ns {
            search_ns = now + SECOND_NS;
            let failed = std::mem::take(&mut desk.again);
            let new = watch.new_channels(chassis.bus())?;
            // one that was made anew meanwhile is among the new ones
            for info in failed.iter().filter(|old| new.iter().all(|info| info.name != old.name)) {
                desk.meet(chassis, info, false)?;
            }
            for info in &new {
                desk.meet(chassis, info, true)?;
            }
        }
        desk.take()?;
        if now >= map_ns {
            let begun = now_ns();
            desk.send_map(begun, &mut map)?;
            map_ns = now_ns() + MAP_SHARE * (now_ns() - begun);
        }
        if now >= complain_ns {
            complain_ns = now + COMPLAIN_NS;
            desk.complain();
        }
        chassis.pass_end();
        let heard: u64 = desk.sensors.iter().map(|sensor| sensor.tap.lost()).sum();
        chassis.report_lost(heard + desk.estimates.iter().map(Subscriber::lost).sum::<u64>());
    }
    desk.complain();
    Ok(())
}

impl Desk {
    /// A channel that has appeared: a sensor, or nothing of ours.
    fn meet(&mut self, chassis: &Chassis, info: &ChannelInfo, first: bool) -> Result<(), BusError> {
        let Some(name) = info.name.strip_prefix("sensor/") else { return Ok(()) };
        let Some(config) = self.config.sensor(name) else { return Ok(()) };
        let schema = info.schema.as_deref().unwrap_or_default();
        let decoder = match Decoder::of(&config, &info.type_name, schema, info.size) {
            Ok(decoder) => decoder,
            Err(why) => {
                tracing::warn!("{} gets no samples: {why}", info.name);
                return Ok(());
            }
        };
        // What it takes to listen, and to say what comes of it.
        let tap = match chassis
            .bus()
            .room_for(OUTLET_BYTES, name)
            .and_then(|()| chassis.bus().tap_with_history(&info.name))
        {
            Ok(tap) => tap,
            // it went away again: if it comes back, it is new
            Err(BusError::NoChannel { .. }) => return Ok(()),
            Err(error) => {
                if first {
                    tracing::warn!("{} gets no samples yet, and is tried again: {error}", info.name);
                }
                self.again.push(info.clone());
                return Ok(());
            }
        };
        let number = self.logger.sensor(name, &config, decoder);
        // one that was made again takes the place of the old one
        self.sensors.retain(|sensor| sensor.number != number);
        self.sensors.push(Sensor { tap, number });
        if number == self.outlets.len() {
            let maps = self.outlets.iter().filter(|outlet| outlet.map.is_some()).count();
            let map = if maps < self.config.section.maps {
                SensorMap::new(&self.config, &config, FieldMap::SIDE).unwrap_or_else(|error| {
                    tracing::warn!("{} gets no map: {error}", info.name);
                    None
                })
            } else {
                None
            };
            let map = match map {
                Some(map) => Some((map, chassis.bus().publisher(&format!("map/{name}"))?)),
                None => None,
            };
            let samples = chassis.bus().publisher(&format!("sample/{name}"))?;
            self.outlets.push(Outlet { samples, map, due_ns: 0 });
            tracing::info!("{} is georeferenced", info.name);
        }
        Ok(())
    }

    /// What has come since the last pass becomes samples. Readings first: the estimates that are read after them are newer.
    fn take(&mut self) -> Result<(), BusError> {
        for Sensor { tap, number } in &mut self.sensors {
            let logger = &mut self.logger;
            while tap.receive(|raw| logger.reading(*number, raw.bytes, now_ns()))?.is_some() {}
        }
        while let Some(authority) = self.authorities.receive()? {
            self.logger.authority(&authority);
        }
        for (slot, estimates) in self.estimates.iter_mut().enumerate() {
            while let Some(estimate) = estimates.receive()? {
                self.logger.estimate(slot, &estimate);
            }
        }
        while let Some((number, mut sample)) = self.logger.next_sample(now_ns()) {
            if let Some(outlet) = self.outlets.get_mut(number) {
                outlet.samples.send(&mut sample)?;
                if let Some((map, _)) = &mut outlet.map {
                    map.add(&sample);
                }
            }
        }
        Ok(())
    }

    /// The map that is due for longest, if one is.
    fn send_map(&mut self, now: u64, into: &mut FieldMap) -> Result<(), BusError> {
        let period_ns = (self.config.section.map_period_s * 1e9) as u64;
        let outlets = self.outlets.iter_mut().filter(|outlet| outlet.map.is_some() && outlet.due_ns <= now);
        let Some(outlet) = outlets.min_by_key(|outlet| outlet.due_ns) else { return Ok(()) };
        outlet.due_ns = now + period_ns;
        if let Some((map, publisher)) = &mut outlet.map
            && map.publishable(into)
        {
            publisher.send(into)?;
        }
        Ok(())
    }

    /// Says for each sensor how many readings became no samples since the last word, and why.
    fn complain(&mut self) {
        for (number, (name, counts)) in self.logger.counts().enumerate() {
            if self.said.len() <= number {
                self.said.push(Counts::default());
            }
            if let Some(sentence) = complaint(name, &counts, &self.said[number]) {
                tracing::warn!("{sentence}");
            }
            self.said[number] = counts;
        }
    }
}
