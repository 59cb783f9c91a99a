//! Heartbeats, the log, the process table, and the state of the recording.

use crate::{Header, message};

message! {
    /// `system/heartbeat/NAME`: heartbeat of a process, with the timing of its loop.
    pub struct Heartbeat {
        header: Header,
        /// Increases with every beat.
        beat: u64,
        /// Passes through the loop, and their duration: median, 99th percentile, maximum, ns, since start.
        passes: u64,
        busy_p50_ns: u64,
        busy_p99_ns: u64,
        busy_max_ns: u64,
        /// Samples lost before they reached this process, over all its inputs.
        lost: u64,
        pid: u32,
        incarnation: u32,
        state: u8 { STATE_STARTING = 1, STATE_READY = 2, STATE_STOPPING = 3 },
        /// 1: runs with SCHED_FIFO, locked memory, and the configured processor.
        realtime: u8,
        locked: u8,
        pinned: u8,
        pad0: [u8; 4],
        name: [u8; 32],
        /// Version and build profile of the program.
        version: [u8; 32],
    }
}

message! {
    /// `system/log/NAME`: one tracing event.
    pub struct LogEvent {
        header: Header,
        pid: u32,
        level: u8 { LEVEL_TRACE = 1, LEVEL_DEBUG = 2, LEVEL_INFO = 3, LEVEL_WARN = 4, LEVEL_ERROR = 5 },
        pad0: [u8; 3],
        process: [u8; 32],
        target: [u8; 64],
        text: [u8; 512],
    }
}

message! {
    /// `system/process`: one row of the process table; every row once a second and on change.
    pub struct ProcessState {
        header: Header,
        started_ns: u64,
        pid: u32,
        restarts: u32,
        exit_code: i32,
        signal: i32,
        /// RUNNING: runs without heartbeats. GAVE_UP: died too often to be restarted. GONE: removed from the table.
        state: u8 {
            STATE_STOPPED = 0, STATE_STARTING = 1, STATE_READY = 2, STATE_STOPPING = 3, STATE_DIED = 4, STATE_SILENT = 5, STATE_GAVE_UP = 6,
            STATE_RUNNING = 7, STATE_GONE = 8,
        },
        /// Slot of a controller or an estimator: 1 for a, 2 for b; otherwise 0.
        slot: u8,
        pad0: [u8; 6],
        name: [u8; 32],
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
        messages: u64,
        bytes: u64,
        /// Samples missing by their sequence numbers.
        lost: u64,
        gaps: u64,
        total_messages: u64,
        total_bytes: u64,
        disk_free_bytes: u64,
        /// Longest time from receiving a sample to writing it into the buffer of the file, ns.
        worst_lag_ns: u64,
        state: u8 { STATE_RECORDING = 1, STATE_DISK_FULL = 2, STATE_FAILED = 3 },
        /// 1: the file or its folder was removed, so what was recorded is lost.
        removed: u8,
        pad0: [u8; 6],
        channel: [u8; 64],
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
        missing: u64,
        /// Numbers of the samples before and after the gap, and their times of publication, CLOCK_MONOTONIC, ns; 0:
        /// none before.
        last_seq: u64,
        next_seq: u64,
        last_ns: u64,
        next_ns: u64,
        /// OVERFLOW: the buffer overflowed before the recorder read it. DISK_FULL, FAILED: no file could be written.
        cause: u8 { CAUSE_OVERFLOW = 1, CAUSE_DISK_FULL = 2, CAUSE_FAILED = 3 },
        pad0: [u8; 7],
        channel: [u8; 64],
    }
}
