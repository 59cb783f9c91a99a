//! Where the node is, how well it follows, and what its sensors say.

use crate::{CABLES, Header, SLOTS, message};

message! {
    /// `node/estimate/a` and `/b`: position and tensions from the measured lengths.
    pub struct NodeEstimate {
        header: Header,
        position_m: [f64; 3],
        velocity_m_s: [f64; 3],
        /// Position covariance, row by row, m².
        covariance_m2: [f64; 9],
        /// Unstretched lengths: as measured, and as predicted for this cycle with phi.
        measured_m: [f64; CABLES],
        predicted_m: [f64; CABLES],
        /// Predicted cable velocity, m/s.
        cable_velocity_m_s: [f64; CABLES],
        /// Motor model (18): v(n+1) = phi1 v_desired(n) + phi2 v(n).
        phi1: [f64; CABLES],
        phi2: [f64; CABLES],
        /// From the elastic equilibrium; for rigid lines from (15).
        tension_n: [f64; CABLES],
        residual_m: f64,
        /// Cycle of the motor/authority it was made with; 0: none yet. With the motor/state of its own cycle that is all it rests on.
        seen_authority: u64,
        epoch: u32,
        incarnation: u32,
        slack: [u8; CABLES],
        valid: u8,
        cable_count: u8,
        method: u8 { METHOD_PHI = 1, METHOD_KALMAN = 2 },
        pad0: [u8; 1],
        /// Kernel's number of the thread that answers; 0: unknown.
        thread: u32,
    }
}

message! {
    /// `control/status/a` and `/b`: how a controller fares.
    pub struct ControlStatus {
        header: Header,
        setpoint_m: [f64; 3],
        setpoint_velocity_m_s: [f64; 3],
        error_m: [f64; 3],
        error_norm_m: f64,
        /// Largest cable velocity over its limit; above 1 it was scaled.
        saturation: f64,
        /// Chosen tension distribution at the setpoint, N.
        tension_n: [f64; CABLES],
        /// Unstretched length error of the redundant mode, m.
        redundant_m: f64,
        /// What the answer rests on: cycle of the newest estimate of each slot, of motor/authority and of motor/state, beat of
        /// plan/motion; 0: none yet.
        seen_estimate: [u64; SLOTS],
        seen_authority: u64,
        seen_state: u64,
        seen_motion: u64,
        horizon: u32,
        segment: u32,
        incarnation: u32,
        /// The law that answered, and the one that was chosen: preview falls back on lq-endpoint.
        law: u8 { LAW_LQ_ENDPOINT = 1, LAW_PREVIEW = 2, LAW_P_FEEDFORWARD = 3, LAW_OTHER = 255 },
        chosen_law: u8,
        valid: u8,
        cable_count: u8,
    }
}

message! {
    /// `truth/node`, from the virtual box only, for evaluation: nothing in the loop may read it.
    pub struct TruthNode {
        header: Header,
        position_m: [f64; 3],
        velocity_m_s: [f64; 3],
        tension_n: [f64; CABLES],
        /// Unstretched line paid out beyond the routed part, m.
        length_m: [f64; CABLES],
        current_a: [f64; CABLES],
        slack: [u8; CABLES],
        cable_count: u8,
        pad0: [u8; 7],
    }
}

message! {
    /// `sensor/NAME`: the standard reading, for sensors that need no type of their own.
    ///
    /// `stamp_ns` is when it arrived, `oldest_input_ns` when it was true: `latency_s` earlier. Without a new one a driver repeats the last
    /// one as stale, with the times of then, so that silence and old values are told apart.
    pub struct Reading {
        header: Header,
        /// The first `count` count; NaN where the device says that it has no value.
        value: [f64; 8],
        /// From the event to `stamp_ns`, s, as far as it is known.
        latency_s: f64,
        /// Where the sensor is on the node, seen from the node's position, in the site's axes, m.
        lever_m: [f64; 3],
        /// Since the driver began: readings that were good enough to be published, and frames that were not.
        frames: u64,
        bad_frames: u64,
        count: u8,
        /// Doubtful: by the device's own account, e.g. too weak a signal. Invalid: it has no value.
        quality: u8 { QUALITY_GOOD = 0, QUALITY_DOUBTFUL = 1, QUALITY_STALE = 2, QUALITY_INVALID = 3 },
        pad0: [u8; 6],
        /// What is measured, and in which unit: one word for each value, separated by commas.
        quantity: [u8; 64],
        unit: [u8; 32],
    }
}

message! {
    /// `sample/NAME`: a reading with the place of the sensor at the reading's own time, which is `stamp_ns`.
    ///
    /// The place is that of the node between two estimates, and the sensor's lever. Its standard deviation holds those of the estimate,
    /// its anchors included, of its residual, and of the instant.
    pub struct Sample {
        header: Header,
        position_m: [f64; 3],
        position_std_m: [f64; 3],
        /// The first `count` count.
        value: [f64; 8],
        /// `seq` of the reading on `sensor/NAME`.
        reading_seq: u64,
        count: u8,
        /// As in [`Reading`]; stale readings are left out.
        quality: u8,
        pad0: [u8; 6],
        /// As in [`Reading`]; of a type of its own the names of its fields, without units.
        quantity: [u8; 64],
        unit: [u8; 32],
    }
}

message! {
    /// `map/NAME`: what the samples of a sensor say so far about the field it measures, over the plane.
    ///
    /// Cells are squares, row by row from the lowest y, in a row from the lowest x; the first `columns` x `rows` count. NaN is unknown.
    pub struct FieldMap {
        header: Header,
        /// Corner with the lowest x and y, and side of a cell, m.
        origin_m: [f64; 2],
        cell_m: f64,
        /// How far a sample speaks for its surroundings, m.
        reach_m: f64,
        /// Samples in the map, and those outside of it.
        samples: u64,
        outside: u64,
        columns: u32,
        rows: u32,
        /// At the centres of the cells, and the standard deviation there.
        value: [f32; FieldMap::CELLS],
        sigma: [f32; FieldMap::CELLS],
        quantity: [u8; 64],
        unit: [u8; 32],
    }
}

impl FieldMap {
    /// Columns at most, and rows.
    pub const SIDE: usize = 64;
    /// Cells at most.
    pub const CELLS: usize = Self::SIDE * Self::SIDE;
}
