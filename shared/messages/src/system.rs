//! Requests of the operator, life signs, the log, and the state of the recording.

use crate::message::{Header, message};

message! {
    /// A request of the operator and, when `answered` is 1, its answer. On `operator/request` both are published.
    pub struct OperatorRequest {
        header: Header,
        id: u64,
        /// By verb. ZERO_AT: x, y, z. ZERO_LENGTHS: lengths. JOG: cable (from 1), metres. SPEED: fraction. GOTO: x, y, z, speed m/s (0: default), path (0 line, 1 parabola).
        args: [f64; 8],
        pid: u32,
        verb: u8 {
            VERB_NONE = 0, VERB_ARM = 1, VERB_DISARM = 2, VERB_HOLD = 3, VERB_STOP = 4, VERB_ESTOP = 5, VERB_RESET = 6, VERB_ZERO_AT = 7,
            VERB_ZERO_LENGTHS = 8, VERB_CONFIRM_POSITION = 9, VERB_JOG = 10, VERB_PAUSE = 11, VERB_RESUME = 12, VERB_SPEED = 13,
            VERB_GOTO = 20, VERB_RUN = 21, VERB_FAULT = 30,
        },
        answered: u8,
        accepted: u8,
        pad0: [u8; 1],
        /// RUN: path of the mission file.
        text: [u8; 512],
        /// One sentence.
        answer: [u8; 512],
    }
}

message! {
    /// `system/heartbeat/NAME`: a process is alive, and how its loop keeps time.
    pub struct Heartbeat {
        header: Header,
        /// Increases with every beat.
        beat: u64,
        /// Passes through the loop, and their duration: median, 99th percentile, maximum, ns, since start.
        passes: u64,
        busy_p50_ns: u64,
        busy_p99_ns: u64,
        busy_max_ns: u64,
        /// Samples lost on the way to this process, over all its inputs.
        lost: u64,
        pid: u32,
        incarnation: u32,
        state: u8 { STATE_STARTING = 1, STATE_READY = 2, STATE_STOPPING = 3 },
        /// 1: SCHED_FIFO, locked memory, chosen processor as configured.
        realtime: u8,
        locked: u8,
        pinned: u8,
        pad0: [u8; 4],
        name: [u8; 32],
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
    /// `system/process`: one row of the supervisor's table; every row once a second and on change.
    pub struct ProcessState {
        header: Header,
        started_ns: u64,
        pid: u32,
        restarts: u32,
        exit_code: i32,
        signal: i32,
        state: u8 { STATE_STOPPED = 0, STATE_STARTING = 1, STATE_READY = 2, STATE_STOPPING = 3, STATE_DIED = 4, STATE_SILENT = 5, STATE_GAVE_UP = 6 },
        pad0: [u8; 7],
        name: [u8; 32],
        role: [u8; 32],
        /// One sentence on why it is in this state.
        reason: [u8; 192],
    }
}

message! {
    /// `recorder/status`, once a second: a row per channel.
    pub struct RecorderStatus {
        header: Header,
        messages: u64,
        bytes: u64,
        /// Samples missing by sequence number.
        lost: u64,
        gaps: u64,
        total_messages: u64,
        total_bytes: u64,
        disk_free_bytes: u64,
        /// Longest time between taking a sample and having it in the file's buffer, ns.
        worst_lag_ns: u64,
        state: u8 { STATE_RECORDING = 1, STATE_DISK_FULL = 2, STATE_FAILED = 3 },
        pad0: [u8; 7],
        channel: [u8; 64],
        file: [u8; 128],
    }
}
