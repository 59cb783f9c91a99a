//! Heartbeats, the log, the process table, and the state of the recording.

use crate::{Header, message};

message! {
    /// `system/heartbeat/NAME`: heartbeat of a process, with the timing of its loop.
    pub struct Heartbeat {
        header: Header,
        /// Increases with every beat.
        beat: u64,
        /// Passes through the loop since start.
        passes: u64,
        /// Median duration of a pass, ns.
        busy_p50_ns: u64,
        /// 99th percentile of the duration, ns.
        busy_p99_ns: u64,
        /// Longest duration, ns.
        busy_max_ns: u64,
        /// Samples lost before they reached this process, over all its inputs.
        lost: u64,
        /// Process id.
        pid: u32,
        /// Non-zero random number of the process.
        incarnation: u32,
        /// State of the process.
        state: u8 { STATE_STARTING = 1, STATE_READY = 2, STATE_STOPPING = 3 },
        /// 1: runs with SCHED_FIFO.
        realtime: u8,
        /// 1: its memory is locked.
        locked: u8,
        /// 1: it runs on the configured processor only.
        pinned: u8,
        pad0: [u8; 4],
        /// Name of the process.
        name: [u8; 32],
        /// Version and build profile of the program.
        version: [u8; 32],
    }
}

message! {
    /// `system/log/NAME`: one tracing event.
    pub struct LogEvent {
        header: Header,
        /// Process id.
        pid: u32,
        /// Severity.
        level: u8 { LEVEL_TRACE = 1, LEVEL_DEBUG = 2, LEVEL_INFO = 3, LEVEL_WARN = 4, LEVEL_ERROR = 5 },
        pad0: [u8; 3],
        /// Name of the process.
        process: [u8; 32],
        /// Module that wrote it.
        target: [u8; 64],
        /// The text.
        text: [u8; 512],
    }
}

message! {
    /// `system/process`: one row of the process table; every row once a second and on change.
    pub struct ProcessState {
        header: Header,
        /// When it was started, CLOCK_MONOTONIC, ns; 0: not started.
        started_ns: u64,
        /// Process id; 0: it does not run.
        pid: u32,
        /// Restarts so far.
        restarts: u32,
        /// Exit code of the last end.
        exit_code: i32,
        /// Signal that ended it; 0: none.
        signal: i32,
        /// RUNNING: runs without heartbeats. GAVE_UP: died too often to be restarted. GONE: removed from the table.
        state: u8 {
            STATE_STOPPED = 0, STATE_STARTING = 1, STATE_READY = 2, STATE_STOPPING = 3, STATE_DIED = 4, STATE_SILENT = 5, STATE_GAVE_UP = 6,
            STATE_RUNNING = 7, STATE_GONE = 8,
        },
        /// Slot of a controller or an estimator: 1 for a, 2 for b; otherwise 0.
        slot: u8,
        pad0: [u8; 6],
        /// Name of the process.
        name: [u8; 32],
        /// Its role in the system.
        role: [u8; 32],
        /// Law, where it is not the configured one, or name in the system file.
        law: [u8; 32],
        /// Cause of the state, in one sentence.
        reason: [u8; 192],
    }
}

message! {
    /// `recorder/status`, once a second: a row per channel.
    pub struct RecorderStatus {
        header: Header,
        /// Recorded samples of this channel.
        messages: u64,
        /// Their bytes.
        bytes: u64,
        /// Samples missing by their sequence numbers.
        lost: u64,
        /// Gaps in their sequence numbers.
        gaps: u64,
        /// Recorded samples of all channels.
        total_messages: u64,
        /// Bytes of all samples.
        total_bytes: u64,
        /// Free space of the disk, bytes.
        disk_free_bytes: u64,
        /// Longest time from receiving a sample to writing it into the buffer of the file, ns.
        worst_lag_ns: u64,
        /// State of the recording.
        state: u8 { STATE_RECORDING = 1, STATE_DISK_FULL = 2, STATE_FAILED = 3 },
        /// 1: the file or its folder was removed, so what was recorded is lost.
        removed: u8,
        pad0: [u8; 6],
        /// Name of the channel.
        channel: [u8; 64],
        /// Path of the file.
        file: [u8; 128],
        /// Why nothing is being recorded and what to do, in one sentence; empty while recording.
        reason: [u8; 192],
    }
}

message! {
    /// In run files, on `recorder/gap`: samples of a channel that are missing between two others. The recorder writes
    /// it at that place of the file; it does not travel in shared memory.
    pub struct RecorderGap {
        header: Header,
        /// Number of samples that are missing.
        missing: u64,
        /// Number of the sample before the gap; 0: none.
        last_seq: u64,
        /// Number of the sample after the gap.
        next_seq: u64,
        /// Time of publication of the sample before the gap, CLOCK_MONOTONIC, ns.
        last_ns: u64,
        /// The same of the sample after it.
        next_ns: u64,
        /// OVERFLOW: the buffer overflowed before the recorder read it. DISK_FULL, FAILED: no file could be written.
        cause: u8 { CAUSE_OVERFLOW = 1, CAUSE_DISK_FULL = 2, CAUSE_FAILED = 3 },
        pad0: [u8; 7],
        /// Name of the channel.
        channel: [u8; 64],
    }
}
