//! Where the node is, how well it follows, and what its sensors say.

use crate::CABLES;
use crate::message::{Header, message};

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
        epoch: u32,
        incarnation: u32,
        slack: [u8; CABLES],
        valid: u8,
        cable_count: u8,
        pad0: [u8; 6],
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
        horizon: u32,
        segment: u32,
        incarnation: u32,
        law: u8 { LAW_LQ_ENDPOINT = 1, LAW_PREVIEW = 2, LAW_P_FEEDFORWARD = 3, LAW_OTHER = 255 },
        valid: u8,
        cable_count: u8,
        pad0: [u8; 1],
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
    pub struct Reading {
        header: Header,
        value: [f64; 8],
        /// Delay from the event to `stamp_ns`, s, as far as it is known.
        latency_s: f64,
        count: u8,
        quality: u8 { QUALITY_GOOD = 0, QUALITY_DOUBTFUL = 1, QUALITY_STALE = 2 },
        pad0: [u8; 6],
        /// What is measured, and in which unit.
        quantity: [u8; 32],
        unit: [u8; 16],
    }
}

message! {
    /// `sample/NAME`: a reading with the position of the node at the reading's own time.
    pub struct Sample {
        header: Header,
        position_m: [f64; 3],
        position_std_m: [f64; 3],
        value: [f64; 8],
        reading_seq: u64,
        count: u8,
        quality: u8,
        pad0: [u8; 6],
    }
}
