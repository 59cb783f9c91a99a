//! Estimates of the node, the status of its control, and readings of its sensors.

use crate::{CABLES, Header, SLOTS, message};

message! {
    /// `node/estimate/a` and `/b`: position and tensions from the measured lengths.
    pub struct NodeEstimate {
        header: Header,
        position_m: [f64; 3],
        velocity_m_s: [f64; 3],
        /// Position covariance, row by row, m²: of the lengths, the robot file and the swing.
        covariance_m2: [f64; 9],
        /// Unstretched lengths: as measured, and as predicted for this cycle with phi.
        measured_m: [f64; CABLES],
        predicted_m: [f64; CABLES],
        /// Predicted cable velocity, m/s.
        cable_velocity_m_s: [f64; CABLES],
        /// Motor model (18): v(n+1) = phi1 v_desired(n) + phi2 v(n).
        phi1: [f64; CABLES],
        phi2: [f64; CABLES],
        /// From the elastic equilibrium; for rigid cables from (15), N.
        tension_n: [f64; CABLES],
        residual_m: f64,
        /// Amplitude of the node's swing about the position of rest, as the motions of the robot excite it, m; part of
        /// the covariance. The encoders do not measure it; wind and hands excite more.
        swing_m: f64,
        /// Cycle of the motor/authority it was computed with, beside the motor/state of its own cycle; 0: none.
        based_on_authority: u64,
        epoch: u32,
        incarnation: u32,
        slack: [u8; CABLES],
        valid: u8,
        cable_count: u8,
        method: u8 { METHOD_PHI = 1, METHOD_KALMAN = 2 },
        pad0: [u8; 1],
        /// Kernel's id of the answering thread; 0: unknown.
        thread: u32,
    }
}

impl NodeEstimate {
    /// Two standard deviations of the position per axis, m: how far the truth may be.
    #[must_use]
    pub fn two_sigma_m(&self) -> [f64; 3] {
        std::array::from_fn(|axis| 2.0 * self.covariance_m2[4 * axis].sqrt())
    }
}

message! {
    /// `control/status/a` and `/b`: errors and saturation of a controller.
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
        /// Inputs of the answer: cycle of the newest estimate of each slot, of motor/authority and of motor/state, beat
        /// of plan/motion; 0: none.
        based_on_estimate: [u64; SLOTS],
        based_on_authority: u64,
        based_on_state: u64,
        based_on_motion: u64,
        horizon: u32,
        segment: u32,
        incarnation: u32,
        /// Law that computed the answer, and the configured one: preview falls back on lq-endpoint.
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
        /// Unstretched cable paid out beyond the routed part, m.
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
    /// `stamp_ns` is the time of arrival, `oldest_input_ns` the time of the measurement, `latency_s` earlier. Without a
    /// new reading a driver repeats the last one as stale with its old times, so that a silent driver differs from a
    /// silent device.
    pub struct Reading {
        header: Header,
        /// The first `count` are valid; NaN where the device reports no value.
        value: [f64; 8],
        /// From the measurement to `stamp_ns`, s, as far as it is known.
        latency_s: f64,
        /// Position of the sensor relative to the node, in the axes of the site, m.
        lever_m: [f64; 3],
        /// Since the start of the driver: published readings, and rejected frames.
        frames: u64,
        bad_frames: u64,
        count: u8,
        /// DOUBTFUL: reported by the device, e.g. a weak signal. INVALID: no value.
        quality: u8 { QUALITY_GOOD = 0, QUALITY_DOUBTFUL = 1, QUALITY_STALE = 2, QUALITY_INVALID = 3 },
        pad0: [u8; 6],
        /// Quantity and unit of each value, separated by commas.
        quantity: [u8; 64],
        unit: [u8; 32],
    }
}

message! {
    /// `sample/NAME`: a reading with the position of the sensor at the time of the measurement, `stamp_ns`.
    ///
    /// The position is interpolated between two estimates, plus the lever of the sensor. Its standard deviation
    /// includes those of the estimate with its anchors, of the residual, and of the time.
    pub struct Sample {
        header: Header,
        position_m: [f64; 3],
        position_std_m: [f64; 3],
        /// The first `count` are valid.
        value: [f64; 8],
        /// `seq` of the reading on `sensor/NAME`.
        reading_seq: u64,
        count: u8,
        /// As in [`Reading`]; stale readings are not published.
        quality: u8,
        pad0: [u8; 6],
        /// As in [`Reading`]; for a sensor with its own type the names of its fields, without units.
        quantity: [u8; 64],
        unit: [u8; 32],
    }
}

message! {
    /// `map/NAME`: map of the measured field over the plane, from the samples of a sensor so far.
    ///
    /// Cells are squares, row by row from the lowest y, in a row from the lowest x; the first `columns` x `rows` count.
    /// NaN is unknown.
    pub struct FieldMap {
        header: Header,
        /// Corner with the lowest x and y, and side of a cell, m.
        origin_m: [f64; 2],
        cell_m: f64,
        /// Radius in which a sample influences the map, m.
        reach_m: f64,
        /// Samples in the map, and those outside of it.
        samples: u64,
        outside: u64,
        columns: u32,
        rows: u32,
        /// Value at the centre of each cell, and its standard deviation.
        value: [f32; FieldMap::CELLS],
        sigma: [f32; FieldMap::CELLS],
        quantity: [u8; 64],
        unit: [u8; 32],
    }
}

impl FieldMap {
    /// Most columns, and most rows.
    pub const SIDE: usize = 64;
    /// Most cells.
    pub const CELLS: usize = Self::SIDE * Self::SIDE;
}
