//! The process: discovers sensors, and publishes samples and maps.

use bus::clock::{SECOND_NS, now_ns};
use bus::{BusError, CHANNELS_EVENT, ChannelInfo, ChannelWatch, Publisher, Raw, Subscriber, Tap};
use messages::{FieldMap, MotorAuthority, NodeEstimate, Sample, SensorFlag};
use runtime::Chassis;

use georeference::{
    Counts, Decoder, Logger, LoggerConfig, SensorConfig, SensorMap, flag_sentence, unused_readings_sentence,
};

/// Time between two polls of the channels, ns: short for observers, and far shorter than the time in which a buffer
/// fills. Readings do not wake the process.
const PASS_NS: u64 = 20_000_000;
/// Shared memory for the samples and the map of a sensor, bytes.
const OUTPUT_BYTES: usize = 4 << 20;
/// Pause after a map as a multiple of the time for computing it, so that many maps do not delay the samples.
const MAP_PAUSE_FACTOR: u64 = 10;
/// Time between two warnings about readings without a position, ns.
const WARN_NS: u64 = 10 * SECOND_NS;

/// Subscription to one sensor.
struct Sensor {
    tap: Tap,
    /// Index of the sensor in the logger.
    number: usize,
}

/// Publishers for one sensor; their index is that of the sensor in the logger.
struct SensorOutput {
    samples: Publisher<Sample>,
    flags: Publisher<SensorFlag>,
    /// Kinds of flags that were logged since the last warning, one bit for each.
    logged: u8,
    map: Option<(SensorMap, Publisher<FieldMap>)>,
    due_ns: u64,
}

/// The sensor logger without its chassis.
struct SensorLogger {
    config: LoggerConfig,
    logger: Logger,
    authorities: Subscriber<MotorAuthority>,
    estimates: [Subscriber<NodeEstimate>; 2],
    sensors: Vec<Sensor>,
    outputs: Vec<SensorOutput>,
    /// Counts of each sensor at the last warning, by its index in the logger.
    reported: Vec<Counts>,
    /// Channels that could not be opened and are retried.
    retried: Vec<ChannelInfo>,
}

/// Runs until the end of the process is requested.
///
/// # Errors
/// The system file or the domain cannot be used.
pub fn run(chassis: &mut Chassis) -> anyhow::Result<()> {
    let file = chassis.system_file()?;
    let config = LoggerConfig::from_section(&file.sensor_logger, &file.robot_file()?.robot()?);
    let bus = chassis.bus();
    let mut sensor_logger = SensorLogger {
        logger: Logger::new(&config)?,
        config,
        authorities: bus.deep_subscriber("motor/authority")?,
        estimates: [bus.deep_subscriber("node/estimate/a")?, bus.deep_subscriber("node/estimate/b")?],
        sensors: Vec::new(),
        outputs: Vec::new(),
        reported: Vec::new(),
        retried: Vec::new(),
    };
    let mut watch = ChannelWatch::new();
    let mut waiter = chassis.waiter(&[CHANNELS_EVENT])?;
    let mut map = Box::<FieldMap>::default();
    let (mut search_ns, mut warn_ns, mut map_ns) = (0, now_ns() + WARN_NS, 0);
    chassis.ready()?;
    while chassis.running() {
        let wake = chassis.wait(&mut waiter, Some(now_ns() + PASS_NS))?;
        chassis.pass_begin();
        let now = now_ns();
        if wake.channel(0) || now >= search_ns {
            search_ns = now + SECOND_NS;
            let failed = std::mem::take(&mut sensor_logger.retried);
            let new = watch.new_channels(chassis.bus())?;
            // A channel that was created again meanwhile is among the new ones.
            for info in failed.iter().filter(|old| new.iter().all(|info| info.name != old.name)) {
                sensor_logger.add_channel(chassis, info, false)?;
            }
            for info in &new {
                sensor_logger.add_channel(chassis, info, true)?;
            }
            // Flags are rare: who subscribes after one would wait for the next.
            sensor_logger.outputs.iter_mut().for_each(|output| output.flags.update_connections());
        }
        sensor_logger.process_samples()?;
        if now >= map_ns {
            let begun = now_ns();
            sensor_logger.send_map(begun, &mut map)?;
            map_ns = now_ns() + MAP_PAUSE_FACTOR * (now_ns() - begun);
        }
        if now >= warn_ns {
            warn_ns = now + WARN_NS;
            sensor_logger.warn();
        }
        chassis.pass_end();
        let readings: u64 = sensor_logger.sensors.iter().map(|sensor| sensor.tap.lost()).sum();
        chassis.report_lost(readings + sensor_logger.estimates.iter().map(Subscriber::lost).sum::<u64>());
    }
    sensor_logger.warn();
    Ok(())
}

impl SensorLogger {
    /// Subscribes to a new channel if it is that of a sensor, and creates its publishers.
    fn add_channel(&mut self, chassis: &Chassis, info: &ChannelInfo, first: bool) -> Result<(), BusError> {
        let Some(("sensor" | "blob", name)) = info.name.split_once('/') else { return Ok(()) };
        let Some(config) = self.config.sensor(name) else { return Ok(()) };
        let decoder = match self.decoder(info, name, &config) {
            Ok(decoder) => decoder,
            Err(why) => {
                tracing::warn!("{}: no samples: {why}", info.name);
                return Ok(());
            }
        };
        // Check first that there is enough memory for the subscription and for the publishers.
        let tap = match chassis
            .bus()
            .room_for(OUTPUT_BYTES, name)
            .and_then(|()| chassis.bus().tap_with_history(&info.name))
        {
            Ok(tap) => tap,
            // The channel was removed. If it is created again, it is a new one.
            Err(BusError::NoChannel { .. }) => return Ok(()),
            Err(error) => {
                if first {
                    tracing::warn!("{}: no samples yet, retrying: {error}", info.name);
                }
                self.retried.push(info.clone());
                return Ok(());
            }
        };
        let number = self.logger.sensor(name, &config, decoder);
        // A channel that was created again replaces the old one.
        self.sensors.retain(|sensor| sensor.number != number);
        self.sensors.push(Sensor { tap, number });
        if number == self.outputs.len() {
            let maps = self.outputs.iter().filter(|output| output.map.is_some()).count();
            let map = if maps < self.config.section.maps && !info.is_blob {
                SensorMap::new(&self.config, &config, FieldMap::SIDE).unwrap_or_else(|error| {
                    tracing::warn!("{}: no map: {error}", info.name);
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
            let flags = chassis.bus().publisher(&format!("flag/{name}"))?;
            self.outputs.push(SensorOutput { samples, flags, logged: 0, map, due_ns: 0 });
            tracing::info!("{} is georeferenced", info.name);
        }
        Ok(())
    }

    fn decoder(&self, info: &ChannelInfo, name: &str, config: &SensorConfig) -> Result<Decoder, String> {
        let same = |sensor: &&Sensor| sensor.tap.info().name.split_once('/').is_some_and(|(_, other)| other == name);
        if let Some(other) = self.sensors.iter().find(same).filter(|other| other.tap.info().name != info.name) {
            return Err(format!("{} has the same name; give one of them another", other.tap.info().name));
        }
        if info.is_blob {
            return Ok(Decoder::for_blobs(config, &info.type_name));
        }
        Decoder::new(config, &info.type_name, info.schema.as_deref().unwrap_or_default(), info.size)
    }

    /// Receives readings and estimates, and publishes samples. Readings are received first, so that the estimates
    /// received after them are newer.
    fn process_samples(&mut self) -> Result<(), BusError> {
        for Sensor { tap, number } in &mut self.sensors {
            let logger = &mut self.logger;
            let is_blob = tap.info().is_blob;
            let mut read = |raw: Raw<'_>| match is_blob {
                true => logger.blob(*number, &raw.header, now_ns()),
                false => logger.reading(*number, raw.bytes, now_ns()),
            };
            while tap.receive(&mut read)?.is_some() {}
        }
        self.logger.silence(now_ns());
        while let Some((number, mut flag)) = self.logger.next_flag() {
            let Some(output) = self.outputs.get_mut(number) else { continue };
            output.flags.send(&mut flag)?;
            if output.logged & 1 << flag.kind == 0 {
                output.logged |= 1 << flag.kind;
                let channel =
                    self.sensors.iter().find(|sensor| sensor.number == number).map(|one| &one.tap.info().name);
                tracing::warn!("{}", flag_sentence(channel.map_or("a sensor", String::as_str), &flag));
            }
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
            if let Some(output) = self.outputs.get_mut(number) {
                output.samples.send(&mut sample)?;
                if let Some((map, _)) = &mut output.map {
                    map.add(&sample);
                }
            }
        }
        Ok(())
    }

    /// Publishes the map that is overdue for the longest time, if any.
    fn send_map(&mut self, now: u64, into: &mut FieldMap) -> Result<(), BusError> {
        let period_ns = (self.config.section.map_period_s * 1e9) as u64;
        let due = self.outputs.iter_mut().filter(|output| output.map.is_some() && output.due_ns <= now);
        let Some(output) = due.min_by_key(|output| output.due_ns) else { return Ok(()) };
        output.due_ns = now + period_ns;
        if let Some((map, publisher)) = &mut output.map
            && map.publishable(into)
        {
            publisher.send(into)?;
        }
        Ok(())
    }

    /// Logs for each sensor how many readings gave no sample since the last warning, and why; flags are logged again.
    fn warn(&mut self) {
        self.outputs.iter_mut().for_each(|output| output.logged = 0);
        for (number, (name, counts)) in self.logger.counts().enumerate() {
            if self.reported.len() <= number {
                self.reported.push(Counts::default());
            }
            if let Some(sentence) = unused_readings_sentence(name, &counts, &self.reported[number]) {
                tracing::warn!("{sentence}");
            }
            self.reported[number] = counts;
        }
    }
}
