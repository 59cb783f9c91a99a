//! Cyclone DDS, one of those under ROS 2: best effort, over UDP on the loopback interface, without shared memory.
//!
//! Its types come from a compiler of its own for C; the one here is written by hand.
#![allow(unsafe_code)]

use super::{BYTES, Receiver, Sender, filled, time_of};
use anyhow::{Result, bail};
use cyclors::{
    DDS_ANY_STATE, dds_create_domain, dds_create_participant, dds_create_qos, dds_create_readcondition,
    dds_create_reader, dds_create_topic, dds_create_waitset, dds_create_writer, dds_delete, dds_delete_qos,
    dds_durability_kind_DDS_DURABILITY_VOLATILE, dds_entity_t, dds_history_kind_DDS_HISTORY_KEEP_LAST, dds_log_data_t,
    dds_qos_t, dds_qset_durability, dds_qset_history, dds_qset_reliability,
    dds_reliability_kind_DDS_RELIABILITY_BEST_EFFORT, dds_return_t, dds_sample_info_t, dds_set_log_sink,
    dds_stream_opcode_DDS_OP_ADR, dds_stream_opcode_DDS_OP_RTS, dds_stream_typecode_primary_DDS_OP_TYPE_ARR,
    dds_stream_typecode_subtype_DDS_OP_SUBTYPE_1BY, dds_strretcode, dds_take, dds_topic_descriptor, dds_type_meta_ser,
    dds_waitset_attach, dds_waitset_wait, dds_write,
};
use std::ffi::{CStr, CString, c_void};
use std::mem::MaybeUninit;
use std::ptr::{null, null_mut};

/// A DDS domain that little else uses, and not that of the other DDS.
const DOMAIN: u32 = 78;
/// The loopback interface has no multicast, so the ends find each other by the ports of this machine. The environment
/// (`CYCLONEDDS_URI`) changes nothing.
const CONFIG: &CStr = c"<CycloneDDS><Domain>\
    <General>\
    <Interfaces><NetworkInterface address=\"127.0.0.1\"/></Interfaces>\
    <AllowMulticast>false</AllowMulticast>\
    </General>\
    <Discovery>\
    <ParticipantIndex>auto</ParticipantIndex>\
    <Peers><Peer address=\"127.0.0.1\"/></Peers>\
    </Discovery>\
    </Domain></CycloneDDS>";
/// No end of a wait: `DDS_INFINITY`, a macro.
const FOREVER: i64 = i64::MAX;
/// How a sample is written and read: an array of bytes at offset 0, and the end.
static OPERATIONS: [u32; 4] = [
    dds_stream_opcode_DDS_OP_ADR
        | dds_stream_typecode_primary_DDS_OP_TYPE_ARR
        | dds_stream_typecode_subtype_DDS_OP_SUBTYPE_1BY,
    0,
    BYTES as u32,
    dds_stream_opcode_DDS_OP_RTS,
];

fn checked(code: dds_return_t, what: &str) -> Result<dds_return_t> {
    if code >= 0 {
        return Ok(code);
    }
    // SAFETY: for every code the text is a constant of the library, which ends in a zero.
    let why = unsafe { CStr::from_ptr(dds_strretcode(code)) };
    bail!("{what}: {}", why.to_string_lossy())
}

/// Two measurements do not share a topic.
fn topic_name() -> Result<CString> {
    let parent = rustix::process::getppid().map_or(0, |parent| parent.as_raw_nonzero().get());
    Ok(CString::new(format!("State{parent}"))?)
}

/// A domain of this process with a participant and the topic; all that is in it ends with it.
struct Domain {
    domain: dds_entity_t,
    participant: dds_entity_t,
    topic: dds_entity_t,
}

impl Domain {
    fn open() -> Result<Self> {
        // SAFETY: the configuration is a text that ends in a zero.
        let domain = checked(unsafe { dds_create_domain(DOMAIN, CONFIG.as_ptr()) }, "the domain")?;
        let mut opened = Self { domain, participant: 0, topic: 0 };
        // SAFETY: null stands for the defaults.
        opened.participant = checked(unsafe { dds_create_participant(DOMAIN, null(), null()) }, "the participant")?;
        let none = dds_type_meta_ser { data: null(), sz: 0 };
        let descriptor = dds_topic_descriptor {
            m_size: BYTES as u32,
            m_align: 1,
            m_flagset: 0,
            m_nkeys: 0,
            m_typename: c"Bytes".as_ptr(),
            m_keys: null(),
            m_nops: OPERATIONS.len() as u32,
            m_ops: OPERATIONS.as_ptr(),
            m_meta: c"".as_ptr(),
            type_information: none,
            type_mapping: none,
            restrict_data_representation: 0,
        };
        let name = topic_name()?;
        // SAFETY: name, descriptor and all that it points to live until the call has copied them. The operations end as
        // such do, and stay within `m_size`: an array of as many bytes at offset 0.
        let topic =
            unsafe { dds_create_topic(opened.participant, &raw const descriptor, name.as_ptr(), null(), null()) };
        opened.topic = checked(topic, "the topic")?;
        Ok(opened)
    }
}

impl Drop for Domain {
    fn drop(&mut self) {
        // SAFETY: an entity is a number, and one that is no longer there is refused.
        unsafe { dds_delete(self.domain) };
    }
}

/// Best effort, the newest sample, nothing kept for a late reader: as for the newest value of a control cycle.
struct Quality(*mut dds_qos_t);

impl Quality {
    fn new() -> Self {
        // SAFETY: the library returns what it allocated, or ends the process.
        let qos = unsafe { dds_create_qos() };
        // SAFETY: what was just created, and values that each policy has.
        unsafe {
            dds_qset_reliability(qos, dds_reliability_kind_DDS_RELIABILITY_BEST_EFFORT, 0);
            dds_qset_history(qos, dds_history_kind_DDS_HISTORY_KEEP_LAST, 1);
            dds_qset_durability(qos, dds_durability_kind_DDS_DURABILITY_VOLATILE);
        }
        Self(qos)
    }
}

impl Drop for Quality {
    fn drop(&mut self) {
        // SAFETY: created above, and deleted once.
        unsafe { dds_delete_qos(self.0) };
    }
}

unsafe extern "C" fn drop_line(_: *mut c_void, _: *const dds_log_data_t) {}

pub struct CycloneSender {
    writer: dds_entity_t,
    _domain: Domain,
}

impl CycloneSender {
    pub fn open() -> Result<Self> {
        // The standard error has the result; a receiver says what is wrong with the configuration.
        // SAFETY: the function ignores what it is given.
        unsafe { dds_set_log_sink(Some(drop_line), null_mut()) };
        let domain = Domain::open()?;
        let quality = Quality::new();
        // SAFETY: the quality lives until the call has copied it; null stands for no listener.
        let writer = unsafe { dds_create_writer(domain.participant, domain.topic, quality.0, null()) };
        Ok(Self { writer: checked(writer, "the writer")?, _domain: domain })
    }
}

impl Sender for CycloneSender {
    fn send(&mut self, sent_ns: u64) -> Result<()> {
        let bytes = filled(sent_ns);
        // SAFETY: the memory has the size of the type of the topic, and the call keeps no pointer to it.
        checked(unsafe { dds_write(self.writer, bytes.as_ptr().cast()) }, "a sample")?;
        Ok(())
    }
}

pub struct CycloneReceiver {
    reader: dds_entity_t,
    waits: dds_entity_t,
    _domain: Domain,
}

impl CycloneReceiver {
    pub fn open() -> Result<Self> {
        let domain = Domain::open()?;
        let quality = Quality::new();
        // SAFETY: the quality lives until the call has copied it; null stands for no listener.
        let reader = unsafe { dds_create_reader(domain.participant, domain.topic, quality.0, null()) };
        let reader = checked(reader, "the reader")?;
        // SAFETY: entities are numbers, and a wrong one is refused.
        let (condition, waits) =
            unsafe { (dds_create_readcondition(reader, DDS_ANY_STATE), dds_create_waitset(domain.participant)) };
        let (condition, waits) = (checked(condition, "the condition")?, checked(waits, "the wait set")?);
        // SAFETY: as above.
        checked(unsafe { dds_waitset_attach(waits, condition, 0) }, "the wait")?;
        Ok(Self { reader, waits, _domain: domain })
    }
}

impl Receiver for CycloneReceiver {
    fn receive(&mut self) -> Result<u64> {
        let mut bytes = [0_u8; BYTES];
        let mut about = MaybeUninit::<dds_sample_info_t>::uninit();
        loop {
            // SAFETY: the call has no place to write to.
            checked(unsafe { dds_waitset_wait(self.waits, null_mut(), 0, FOREVER) }, "a wait")?;
            let mut place: *mut c_void = bytes.as_mut_ptr().cast();
            // SAFETY: one sample is taken at most. It is copied to memory of the size of its type, since `place` is not
            // null, and what is said about it to memory of that type.
            let taken = unsafe { dds_take(self.reader, &raw mut place, about.as_mut_ptr(), 1, 1) };
            // SAFETY: written, as a sample was taken.
            if checked(taken, "a sample")? == 1 && unsafe { about.assume_init_ref() }.valid_data {
                return time_of(&bytes);
            }
        }
    }
}
