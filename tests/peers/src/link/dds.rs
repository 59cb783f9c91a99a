//! A DDS: best effort, as for the newest value of a control cycle.

use super::{Receiver, Sender, filled, time_of};
use anyhow::{Result, anyhow};
use dust_dds::domain::domain_participant::DomainParticipant;
use dust_dds::domain::domain_participant_factory::DomainParticipantFactory;
use dust_dds::infrastructure::error::DdsError;
use dust_dds::infrastructure::listener::NO_LISTENER;
use dust_dds::infrastructure::qos::{DataReaderQos, DataWriterQos, QosKind};
use dust_dds::infrastructure::qos_policy::{ReliabilityQosPolicy, ReliabilityQosPolicyKind};
use dust_dds::infrastructure::status::{NO_STATUS, StatusKind};
use dust_dds::infrastructure::time::{Duration, DurationKind};
use dust_dds::infrastructure::type_support::DdsType;
use dust_dds::publication::data_writer::DataWriter;
use dust_dds::subscription::data_reader::DataReader;
use dust_dds::wait_set::{Condition, WaitSet};

/// A DDS domain that little else uses.
const DOMAIN: i32 = 77;
const BEST_EFFORT: ReliabilityQosPolicy =
    ReliabilityQosPolicy { kind: ReliabilityQosPolicyKind::BestEffort, max_blocking_time: DurationKind::Infinite };

#[derive(DdsType)]
struct Bytes(Vec<u8>);

fn failed(error: DdsError) -> anyhow::Error {
    anyhow!("{error:?}")
}

fn participant() -> Result<DomainParticipant> {
    let factory = DomainParticipantFactory::get_instance();
    factory.create_participant(DOMAIN, QosKind::Default, NO_LISTENER, NO_STATUS).map_err(failed)
}

/// Two measurements do not share a topic.
fn topic_name() -> String {
    let parent = rustix::process::getppid().map_or(0, |parent| parent.as_raw_nonzero().get());
    format!("State{parent}")
}

pub struct DdsSender {
    writer: DataWriter<Bytes>,
    _participant: DomainParticipant,
}

impl DdsSender {
    pub fn open() -> Result<Self> {
        let participant = participant()?;
        let topic = participant
            .create_topic::<Bytes>(&topic_name(), "Bytes", QosKind::Default, NO_LISTENER, NO_STATUS)
            .map_err(failed)?;
        let publisher = participant.create_publisher(QosKind::Default, NO_LISTENER, NO_STATUS).map_err(failed)?;
        let qos = QosKind::Specific(DataWriterQos { reliability: BEST_EFFORT, ..DataWriterQos::default() });
        let writer = publisher.create_datawriter::<Bytes>(&topic, qos, NO_LISTENER, NO_STATUS).map_err(failed)?;
        Ok(Self { writer, _participant: participant })
    }
}

impl Sender for DdsSender {
    fn send(&mut self, sent_ns: u64) -> Result<()> {
        self.writer.write(Bytes(filled(sent_ns).to_vec()), None).map_err(failed)
    }
}

pub struct DdsReceiver {
    reader: DataReader<Bytes>,
    waits: WaitSet,
    _participant: DomainParticipant,
}

impl DdsReceiver {
    pub fn open() -> Result<Self> {
        let participant = participant()?;
        let topic = participant
            .create_topic::<Bytes>(&topic_name(), "Bytes", QosKind::Default, NO_LISTENER, NO_STATUS)
            .map_err(failed)?;
        let subscriber = participant.create_subscriber(QosKind::Default, NO_LISTENER, NO_STATUS).map_err(failed)?;
        let qos = QosKind::Specific(DataReaderQos { reliability: BEST_EFFORT, ..DataReaderQos::default() });
        let reader = subscriber.create_datareader::<Bytes>(&topic, qos, NO_LISTENER, NO_STATUS).map_err(failed)?;
        let condition = reader.get_statuscondition();
        condition.set_enabled_statuses(&[StatusKind::DataAvailable]).map_err(failed)?;
        let mut waits = WaitSet::new();
        waits.attach_condition(Condition::StatusCondition(condition)).map_err(failed)?;
        Ok(Self { reader, waits, _participant: participant })
    }
}

impl Receiver for DdsReceiver {
    fn receive(&mut self) -> Result<u64> {
        loop {
            self.waits.wait(Duration::new(3600, 0)).map_err(failed)?;
            if let Ok(sample) = self.reader.take_next_sample()
                && let Some(Bytes(bytes)) = sample.data
            {
                return time_of(&bytes);
            }
        }
    }
}
