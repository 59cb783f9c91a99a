//! Estimates of the node, the status of its control, and readings of its sensors.

use crate::{CABLES, Header, SLOTS, message};

message! {
    /// `node/estimate/a` and `/b`: position and tensions from the measured lengths.
    pub struct NodeEstimate {
        header: Header,
        /// Position of the node, m.
        position_m: [f64; 3],
        /// Velocity of the node, m/s.
        velocity_m_s: [f64; 3],
        /// Position covariance, row by row, m²: of the lengths, the robot file and the swing.
        covariance_m2: [f64; 9],
        /// Unstretched lengths as measured, m.
        measured_m: [f64; CABLES],
        /// Unstretched lengths as predicted for this cycle, m.
        predicted_m: [f64; CABLES],
        /// Predicted cable velocity, m/s.
        cable_velocity_m_s: [f64; CABLES],
        /// Motor model (18): v(n+1) = phi1 v_desired(n) + phi2 v(n).
        phi1: [f64; CABLES],
        /// The other coefficient of the motor model (18).
        phi2: [f64; CABLES],
        /// From the elastic equilibrium; for rigid cables from (15), N.
        tension_n: [f64; CABLES],
        /// Misfit of the lengths, m: of rigid cables their root mean square; of elastic ones, which always fit, the
        /// residual force of the equilibrium as stretch.
        residual_m: f64,
        /// Amplitude of the node's swing about the position of rest, as the motions of the robot excite it, m; part of
        /// the covariance. The encoders do not measure it; wind and hands excite more.
        swing_m: f64,
        /// Cycle of the motor/authority it was computed with, beside the motor/state of its own cycle; 0: none.
        based_on_authority: u64,
        /// Epoch of motor/authority that it was computed in.
        epoch: u32,
        /// Non-zero random number of the process.
        incarnation: u32,
        /// 1 for each cable without tension.
        slack: [u8; CABLES],
        /// 1: the estimate may be used.
        valid: u8,
        /// Number of cables.
        cable_count: u8,
        /// Filter of the lengths.
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
        /// Setpoint at the instant of the estimate, m.
        setpoint_m: [f64; 3],
        /// Its velocity, m/s.
        setpoint_velocity_m_s: [f64; 3],
        /// Setpoint minus estimate, m.
        error_m: [f64; 3],
        /// Distance of estimate and setpoint, m.
        error_norm_m: f64,
        /// Largest cable velocity over its limit; above 1 it was scaled.
        saturation: f64,
        /// Chosen tension distribution at the setpoint, N.
        tension_n: [f64; CABLES],
        /// Unstretched length error of the redundant mode, m.
        redundant_m: f64,
        /// Inputs of the answer: cycle of the newest estimate of each slot; 0: none.
        based_on_estimate: [u64; SLOTS],
        /// Cycle of motor/authority.
        based_on_authority: u64,
        /// Cycle of motor/state.
        based_on_state: u64,
        /// Beat of plan/motion.
        based_on_motion: u64,
        /// Horizon of the law, cycles.
        horizon: u32,
        /// Segment being followed; 0: none.
        segment: u32,
        /// Non-zero random number of the process.
        incarnation: u32,
        /// Law that computed the answer; preview falls back on lq-endpoint.
        law: u8 { LAW_LQ_ENDPOINT = 1, LAW_PREVIEW = 2, LAW_P_FEEDFORWARD = 3, LAW_OTHER = 255 },
        /// The configured law, numbered as `law`.
        chosen_law: u8,
        /// 1: the command is a valid answer.
        valid: u8,
        /// Number of cables.
        cable_count: u8,
    }
}

message! {
    /// `truth/node`, from the virtual box only, for evaluation: nothing in the loop may read it.
    pub struct TruthNode {
        header: Header,
        /// True position of the node, m.
        position_m: [f64; 3],
        /// True velocity of the node, m/s.
        velocity_m_s: [f64; 3],
        /// True tensions, N.
        tension_n: [f64; CABLES],
        /// Unstretched cable paid out beyond the routed part, m.
        length_m: [f64; CABLES],
        /// True motor currents, A.
        current_a: [f64; CABLES],
        /// 1 for each cable without tension.
        slack: [u8; CABLES],
        /// Number of cables.
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
        /// Readings published since the start of the driver.
        frames: u64,
        /// Frames rejected since the start of the driver.
        bad_frames: u64,
        /// Number of values.
        count: u8,
        /// DOUBTFUL: reported by the device, e.g. a weak signal. INVALID: no value.
        quality: u8 { QUALITY_GOOD = 0, QUALITY_DOUBTFUL = 1, QUALITY_STALE = 2, QUALITY_INVALID = 3 },
        pad0: [u8; 6],
        /// Quantity of each value, separated by commas.
        quantity: [u8; 64],
        /// Unit of each value, separated by commas.
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
        /// Position of the sensor, m.
        position_m: [f64; 3],
        /// Its standard deviation per axis, m.
        position_std_m: [f64; 3],
        /// The first `count` are valid.
        value: [f64; 8],
        /// `seq` of the reading on `sensor/NAME`.
        reading_seq: u64,
        /// Number of values.
        count: u8,
        /// As in [`Reading`]; stale readings are not published.
        quality: u8,
        pad0: [u8; 6],
        /// As in [`Reading`]; for a sensor with its own type the names of its fields, without units.
        quantity: [u8; 64],
        /// Unit of each value, separated by commas.
        unit: [u8; 32],
    }
}

message! {
    /// `flag/NAME`: values of a sensor that are doubtful by themselves, in the manner of QARTOD.
    ///
    /// What lasts is published twice: when it is found, with `end_ns` 0, and when it ends. `stamp_ns` is the time at
    /// which it was found.
    pub struct SensorFlag {
        header: Header,
        /// Time of measurement of the first value concerned; of the last value before a gap.
        begin_ns: u64,
        /// Time of the last one; of the first value after a gap. 0: it lasts.
        end_ns: u64,
        /// Of a gap or a flat line its duration so far, s; of a spike and of a value beyond the range its distance from
        /// what is believable, in the unit of the value.
        size: f64,
        /// Flags of this kind and value since the sensor logger started, this one included.
        count: u64,
        /// GAP: no value for more than five usual intervals. FLAT: the same value for a minute or longer. SPIKE: far
        /// from both neighbours. RANGE: outside the range that the system file states.
        kind: u8 { KIND_GAP = 0, KIND_FLAT = 1, KIND_SPIKE = 2, KIND_RANGE = 3 },
        /// Number of the value, from 1.
        number: u8,
        pad0: [u8; 6],
        /// Quantity of the value, or the name of its field.
        quantity: [u8; 64],
        /// Unit of the value.
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
        /// Corner with the lowest x and y, m.
        origin_m: [f64; 2],
        /// Side of a cell, m.
        cell_m: f64,
        /// Radius in which a sample influences the map, m.
        reach_m: f64,
        /// Samples in the map.
        samples: u64,
        /// Samples outside of the map.
        outside: u64,
        /// Cells in x.
        columns: u32,
        /// Cells in y.
        rows: u32,
        /// Value at the centre of each cell.
        value: [f32; FieldMap::CELLS],
        /// Standard deviation of each cell.
        sigma: [f32; FieldMap::CELLS],
        /// Quantity of the values.
        quantity: [u8; 64],
        /// Unit of the values.
        unit: [u8; 32],
    }
}

impl FieldMap {
    /// Most columns, and most rows.
    pub const SIDE: usize = 64;
    /// Most cells.
    pub const CELLS: usize = Self::SIDE * Self::SIDE;
}
