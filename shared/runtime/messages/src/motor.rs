//! Samples of the control cycle.

use crate::{CABLES, ROLE_SLOTS, ROLES, SLOTS, UNITS};
use crate::{Header, RequestBody, message};

message! {
    /// `motor/state`, each cycle: readings of drives and encoders. Cable velocities are dL/dt: positive pays cable out.
    pub struct MotorState {
        header: Header,
        /// When each encoder was read, CLOCK_MONOTONIC, ns.
        sampled_ns: [u64; CABLES],
        /// Encoder counts since start, 64 bit.
        counts: [i64; CABLES],
        /// Unstretched cable paid out beyond the routed part, m.
        length_m: [f64; CABLES],
        /// The lengths as the operator set them last, perhaps in an earlier life, m; NaN: unknown.
        zeroed_m: [f64; CABLES],
        /// Measured cable velocity, m/s; over the last 50 ms, because one encoder step in one cycle is a large
        /// velocity.
        velocity_m_s: [f64; CABLES],
        /// Motor current, A; positive where it pulls the cable in, as a tension does.
        current_a: [f64; CABLES],
        /// Drive output, -1 to 1; positive where it pays the cable out, as a velocity does.
        duty: [f64; CABLES],
        /// Cable velocity sent in this cycle, m/s.
        command_m_s: [f64; CABLES],
        /// Cable that the second encoder counted more than the first one, beyond what drum, stretch and resolution
        /// explain, m; a fault from `slip_m` on. NaN: the cable has one encoder.
        slip_m: [f64; CABLES],
        /// Supply voltage per unit, V.
        supply_v: [f64; UNITS],
        /// Position of the node computed from the lengths, m; NaN: unknown.
        node_m: [f64; 3],
        /// Velocity of the node by the command of this cycle, m/s; NaN: unknown.
        node_command_m_s: [f64; 3],
        /// Bound on the node's speed in this cycle, m/s; infinite: only the cables' limits apply.
        node_bound_m_s: f64,
        /// Distance of the node from the setpoint, m; NaN: no setpoint.
        setpoint_distance_m: f64,
        /// Conditions per unit, the same bits for every drive family: bit 0 emergency stop (also of a stop button on
        /// the unit's port); bits 0 to 15 and 26 to 28 are errors, at which the drive stops; the others are warnings
        /// and inputs. `DriveStatus` of the crate `drives` names each bit. Runs recorded before there were other
        /// families have the same bits.
        status: [u32; UNITS],
        /// 1: the reading of this cable is from this cycle.
        fresh: [u8; CABLES],
        /// 1: this unit answered in this cycle.
        unit_ok: [u8; UNITS],
        /// Number of cables; later entries of arrays by cable are not used.
        cable_count: u8,
        /// Number of drive units; later entries of arrays by unit are not used.
        unit_count: u8,
        /// RESTORED: read from the file of the last life, so the node may have moved since.
        position_known: u8 { POSITION_UNKNOWN = 0, POSITION_RESTORED = 1, POSITION_KNOWN = 2 },
        pad0: [u8; 5],
    }
}

message! {
    /// `motor/command/a` and `/b`: a controller's answer to one cycle, one row per estimate slot.
    pub struct MotorCommand {
        header: Header,
        /// The motor/state cycle this answers.
        based_on_cycle: u64,
        /// Cable velocity, m/s; row 0 from node/estimate/a, row 1 from /b.
        velocity_m_s: [f64; 16],
        /// The epoch of motor/authority that this was computed in.
        epoch: u32,
        /// Non-zero random number of the process.
        incarnation: u32,
        /// Segment of plan/motion being followed; 0: none.
        segment: u32,
        /// Cycles for which the command may be used.
        ttl_cycles: u32,
        /// 1: the row is a valid answer.
        valid: [u8; SLOTS],
        pad0: [u8; 2],
        /// Kernel's id of the answering thread, with which motor-io reads how long it waited for a processor; 0:
        /// unknown.
        thread: u32,
    }
}

message! {
    /// `motor/authority`, each cycle: mode, faults, slots in charge, plan clock and timing.
    pub struct MotorAuthority {
        header: Header,
        /// Time on the plan clock, s; advances by rate x period with every applied cycle.
        plan_time_s: f64,
        /// Present rate of the plan clock, 0 to 1.
        plan_rate: f64,
        /// The rate it ramps to.
        plan_rate_target: f64,
        /// Period of the control cycle, s.
        period_s: f64,
        /// Factor by which the commanded velocities were scaled to keep the limits; 1: not scaled.
        scale: f64,
        /// Periods of wall-clock time with a mission since this life began, those that never ran included: the sum of
        /// `steered`, `paused` and the four `lost_..`.
        periods: u64,
        /// Periods in which a fresh command, the answer to the previous cycle, reached every drive.
        steered: u64,
        /// Periods at rest because an operator paused.
        paused: u64,
        /// Periods without a fresh command because this program or its peers did not get the processor, by evidence of
        /// the kernel.
        lost_computer: u64,
        /// Periods lost because a unit did not answer in time.
        lost_drive: u64,
        /// Periods lost because a serial port was being resynchronised.
        lost_resync: u64,
        /// Periods lost for all other reasons.
        lost_answer: u64,
        /// Duration of the exchange with the drives, ns.
        bus_ns: u64,
        /// From the due time of the cycle to its wake-up, ns.
        wake_ns: u64,
        /// Age of the applied command when it was sent: since the oldest encoder reading it is based on, ns.
        command_age_ns: u64,
        /// Per role (controller, estimator): progress of the cross-fade to the slot in charge, 0 to 1; 1: no
        /// cross-fade.
        fade: [f64; ROLES],
        /// Causes of a fault or a stop; latched until reset.
        faults: u32 {
            FAULT_LOST_UNIT = 1, FAULT_UNIT_REBOOT = 2, FAULT_STALL = 4, FAULT_SLACK = 8, FAULT_OVER_TENSION = 16,
            FAULT_OVER_CURRENT = 32, FAULT_RUNAWAY = 64, FAULT_ENCODER_JUMP = 128, FAULT_DRIVE_ERROR = 256,
            FAULT_COMMAND_LOST = 512, FAULT_LENGTH_LIMIT = 1024, FAULT_ESTIMATE_LOST = 2048, FAULT_SUPPLY = 4096,
            FAULT_LONG_GAP = 8192, FAULT_EMERGENCY_INPUT = 16384, FAULT_SUPERVISOR_LOST = 32768, FAULT_PLANNER_LOST = 65536,
            FAULT_COMMAND_REFUSED = 131072,
            /// Commands moved the node away from its setpoint.
            FAULT_DIVERGING = 262144,
            /// This program, the estimator or the controller did not get the processor.
            FAULT_COMPUTER = 524288,
            /// The offered motion does not begin at the position of the node.
            FAULT_OFF_START = 1048576,
            /// A jog or soft mode ended at a border: of an obstacle, a keep-out box, the ground or a cable's length.
            FAULT_BORDER = 2097152,
            /// The two encoders of a cable disagree, or the second one is not read any more.
            FAULT_SLIP = 4194304,
            /// A cable ran faster than it may in soft mode: the node was led too fast, or a cable broke.
            FAULT_SOFT_SPEED = 8388608,
        },
        /// Incremented on arm, stop, fault, reset and zero; older commands are rejected.
        epoch: u32,
        /// Segment being followed; 0: none.
        segment: u32,
        /// Motion (plan/motion) being followed; 0: none.
        motion: u32,
        /// Mode of the safety machine.
        mode: u8 { MODE_DISARMED = 0, MODE_HOLDING = 1, MODE_JOGGING = 2, MODE_FOLLOWING = 3, MODE_STOPPING = 4, MODE_FAULTED = 5, MODE_EMERGENCY_STOP = 6, MODE_SOFT = 7 },
        /// Slot whose command is used in this cycle.
        active_controller: u8,
        /// Slot whose estimate is used in this cycle.
        active_estimator: u8,
        /// Per role: the slot in charge. The command of the other slot may replace one that it misses.
        in_charge: [u8; ROLES],
        /// Last verdict on each controller slot's command.
        verdict: [u8; SLOTS] {
            VERDICT_NONE = 0, VERDICT_ACCEPTED = 1, VERDICT_STALE = 2, VERDICT_EPOCH = 3, VERDICT_INCARNATION = 4, VERDICT_NOT_FINITE = 5,
            VERDICT_OUT_OF_LIMITS = 6, VERDICT_NO_ESTIMATE = 7, VERDICT_ABSENT = 8,
            VERDICT_SEGMENT = 9,
            /// The command belongs to another life of motor-io.
            VERDICT_LIFE = 10,
        },
        /// As in motor/state.
        position_known: u8,
        /// 1 for each cable that a fault names.
        fault_cable: [u8; CABLES],
        /// 1 for each unit that a fault names.
        fault_unit: [u8; UNITS],
        /// Number of cables.
        cable_count: u8,
        /// Class of this period.
        period: u8 {
            PERIOD_NO_MISSION = 0, PERIOD_STEERED = 1, PERIOD_PAUSED = 2, PERIOD_LOST_COMPUTER = 3, PERIOD_LOST_DRIVE = 4,
            PERIOD_LOST_RESYNC = 5, PERIOD_LOST_ANSWER = 6,
        },
        pad0: [u8; 2],
        /// Current mission, as in plan/motion; 0: none.
        mission: u32,
    }
}

message! {
    /// `motor/slots`, each cycle: trust in each controller and estimator, and the progress of a swap.
    pub struct MotorSlots {
        header: Header,
        /// Per role (controller, estimator): the cycle in which an announced swap takes effect; 0: none.
        commit_cycle: [u64; ROLES],
        /// As in motor/authority.
        fade: [f64; ROLES],
        /// Per role and slot (controller a, b, estimator a, b): difference from the slot in charge. Controllers: m/s of
        /// the cable that differs most; estimators: m. Negative: nothing to compare.
        deviation: [f64; ROLE_SLOTS],
        /// Per role and slot: consecutive cycles with a good answer beside the slot in charge; `qualify_cycles` make it
        /// a standby.
        good_cycles: [u32; ROLE_SLOTS],
        /// Good cycles that make a standby.
        qualify_cycles: u32,
        /// Per role and slot: phase of qualification.
        phase: [u8; ROLE_SLOTS] {
            PHASE_EMPTY = 0, PHASE_ATTACHED = 1, PHASE_SHADOW = 2, PHASE_QUALIFIED = 3, PHASE_SWITCHING = 4, PHASE_ACTIVE = 5,
            PHASE_PROBATION = 6, PHASE_QUARANTINED = 7,
        },
        /// Per role and slot: cause of the last loss of trust.
        cause: [u8; ROLE_SLOTS] {
            CAUSE_NONE = 0, CAUSE_ABSENT = 1, CAUSE_RESTARTED = 2, CAUSE_NOT_FINITE = 3, CAUSE_OUT_OF_LIMITS = 4, CAUSE_DEVIATION = 5,
            CAUSE_NOT_VALID = 6, CAUSE_PROBATION = 7,
        },
        /// Per role and slot: losses of trust without a period of good answers between them.
        failures: [u8; ROLE_SLOTS],
        /// As in motor/authority.
        in_charge: [u8; ROLES],
        pad0: [u8; 6],
    }
}

message! {
    /// `motor/input`, each cycle: the complete input of the step of motor-io, from which a replay computes the same
    /// bits.
    pub struct MotorInput {
        header: Header,
        /// When this cycle was due, ns.
        tick_ns: u64,
        /// When this cycle began, ns.
        begin_ns: u64,
        /// When the bus exchange ended, ns.
        end_ns: u64,
        /// Evidence of the computer, all cumulative: time for which this thread was ready to run and had no processor,
        /// ns.
        run_delay_ns: u64,
        /// The same of controllers a, b and estimators a, b, ns; 0: unknown.
        chain_delay_ns: [u64; ROLE_SLOTS],
        /// Time for which any task of the computer waited for a processor, us; 0: unknown.
        pressure_us: u64,
        /// Time that the virtual motor box left out, ns.
        box_left_out_ns: u64,
        /// Setpoint at the plan time of this cycle, for the checks of motor-io, m.
        setpoint_m: [f64; 3],
        /// Velocity of the setpoint at rate 1, m/s.
        setpoint_velocity_m_s: [f64; 3],
        /// Where the offered motion starts, m.
        motion_start_m: [f64; 3],
        /// Life for which plan/motion was made.
        motion_life: u64,
        /// When the offered motion was asked for, ns; 0: unknown.
        motion_asked_ns: u64,
        /// Life of the last estimate of each slot.
        estimate_life: [u64; SLOTS],
        /// Last beat received of the supervisor.
        supervisor_beat: u64,
        /// Last beat received of the planner.
        planner_beat: u64,
        /// Requests of this cycle; verb 0: none.
        request: [RequestBody; 4],
        /// Number of each request.
        request_id: [u64; 4],
        /// When each request was made, ns; 0: unknown.
        request_stamp_ns: [u64; 4],
        /// Start of the current segment of plan/motion, s on the plan clock.
        motion_start_s: f64,
        /// End of the motion, s on the plan clock.
        motion_end_s: f64,
        /// End of the segments that plan/motion carries, s on the plan clock.
        motion_known_s: f64,
        /// In the first cycle, if `restored` is 1: lengths of the last life, m.
        restored_m: [f64; CABLES],
        /// Encoder counts of the last life.
        restored_counts: [i64; CABLES],
        /// The lengths as the operator set them last, m; NaN: unknown.
        restored_zeroed_m: [f64; CABLES],
        /// Tensions of the last estimate, row 0 from node/estimate/a, row 1 from /b.
        estimate_tension_n: [f64; 16],
        /// Position of the last estimate, m, row by row.
        estimate_position_m: [f64; 6],
        /// Replies of the drives: when each encoder was read, CLOCK_MONOTONIC, ns.
        sampled_ns: [u64; CABLES],
        /// Encoder counts.
        counts: [i64; CABLES],
        /// Counts of second encoders, read with the first ones.
        second_counts: [i64; CABLES],
        /// Motor currents, A, as in motor/state.
        current_a: [f64; CABLES],
        /// Drive outputs, -1 to 1, as in motor/state.
        duty: [f64; CABLES],
        /// Supply voltage per unit, V.
        supply_v: [f64; UNITS],
        /// As in `motor/state`.
        status: [u32; UNITS],
        /// Motion of plan/motion.
        motion: u32,
        /// Epoch for which it was planned.
        motion_epoch: u32,
        /// Its current segment.
        motion_segment: u32,
        /// In the first cycle: the first epoch, so that no life takes up the motion of another.
        first_epoch: u32,
        /// Incarnation of the process that made the last estimate of each slot.
        estimate_incarnation: [u32; SLOTS],
        /// Commands that arrived for this cycle.
        command: [MotorCommand; SLOTS],
        /// Per node/estimate slot: the cycle of the last estimate.
        estimate_cycle: [u64; SLOTS],
        /// 1: the last estimate of the slot is valid.
        estimate_valid: [u8; SLOTS],
        /// 1: the command of the slot arrived for this cycle.
        command_arrived: [u8; SLOTS],
        /// Per unit: result of the exchange.
        unit: [u8; UNITS] {
            UNIT_ABSENT = 0, UNIT_OK = 1, UNIT_RESYNC = 2, UNIT_LOST = 3, UNIT_REBOOTED = 4, UNIT_LATE = 5,
            /// No byte was received in time.
            UNIT_SILENT = 6,
        },
        /// Per unit: which of the slowly read values are new in this cycle.
        slow_fresh: [u8; UNITS] { SLOW_SUPPLY = 1, SLOW_STATUS = 2, SLOW_CURRENT = 4, SLOW_DUTY = 8, SLOW_ALL = 15 },
        /// 1: the unit was already running at the first exchange, so its encoders kept counting.
        unit_alive: [u8; UNITS],
        /// Per cable: what `second_counts` is.
        second: [u8; CABLES] {
            SECOND_ABSENT = 0, SECOND_CONTINUED = 1,
            /// Unrelated to earlier counts.
            SECOND_RESTARTED = 2,
        },
        /// Number of cables.
        cable_count: u8,
        /// Number of drive units.
        unit_count: u8,
        /// 1: `restored_m`, `restored_counts` and `restored_zeroed_m` are valid.
        restored: u8,
        /// 1: `setpoint_m` and `setpoint_velocity_m_s` are valid.
        setpoint_known: u8,
        /// 1: `motion_start_m` is valid.
        motion_start_known: u8,
        pad0: [u8; 7],
        /// Mission of plan/motion; 0: none.
        mission: u32,
        /// Emergency stops of this cycle, which do not arrive as requests.
        estops: u32,
    }
}

message! {
    /// `energy`: electrical power and I²R loss per cable, and their integrals since start.
    pub struct Energy {
        header: Header,
        /// Electrical power of each motor, W; negative where it feeds back.
        power_w: [f64; CABLES],
        /// Loss I²R in each winding, W.
        loss_w: [f64; CABLES],
        /// Integral of `power_w` since start, J.
        energy_j: [f64; CABLES],
        /// Integral of `loss_w` since start, J.
        loss_j: [f64; CABLES],
        /// Number of cables.
        cable_count: u8,
        pad0: [u8; 7],
    }
}

impl MotorAuthority {
    /// Periods of missions that were not steered, pauses excluded.
    #[must_use]
    pub fn unsteered(&self) -> u64 {
        self.periods.saturating_sub(self.steered).saturating_sub(self.paused)
    }

    /// Periods lost to the drives and their serial ports.
    #[must_use]
    pub fn lost_on_ports(&self) -> u64 {
        self.lost_drive.saturating_add(self.lost_resync)
    }
}
