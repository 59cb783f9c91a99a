//! Settings that each drive family accepts, and the time that it needs on the wire.

use std::ops::RangeInclusive;

crate::choice! {
    /// The drive families that motor-io has a driver for.
    pub enum DriveProtocol {
        /// RoboClaw packet serial.
        Roboclaw = "roboclaw",
        /// moteus over fdcanusb text lines.
        Moteus = "moteus",
        /// ODrive ASCII protocol, firmware 0.5.
        Odrive = "odrive",
        /// Roboteq text protocol.
        Roboteq = "roboteq",
    }
}

crate::choice! {
    /// How the units of a port are connected to it.
    pub enum Wire {
        /// A serial wire: bytes take their time by the baud rate.
        Serial = "serial",
        /// A USB adapter with a bus of its own behind it.
        Usb = "usb",
    }
}

/// What a builder does about a unit that cannot be used, in the words of the maker's program.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Remedies {
    /// It does not answer.
    pub silent: &'static str,
    /// Something else answers, or not legibly.
    pub foreign: &'static str,
    /// Only what was sent comes back.
    pub echo: &'static str,
    /// It does not keep the watchdog.
    pub watchdog: &'static str,
    /// It answers what the robot cannot use: a mode, a setting, a firmware.
    pub settings: &'static str,
}

/// The usual cause of an echo.
const ECHO: &str = "connect and switch on the unit, and remove a loopback plug or the adapter's local echo";

/// Properties of a drive family that configuration depends on.
#[derive(Debug, Clone, PartialEq)]
pub struct DriveFamily {
    /// Baud rates.
    pub bauds: &'static [u32],
    /// Addresses of units.
    pub addresses: RangeInclusive<u8>,
    /// The same in messages.
    pub addresses_in_words: &'static str,
    /// Shortest and longest watchdog time, s.
    pub watchdog_s: [f64; 2],
    /// Step of watchdog times, s.
    pub watchdog_step_s: f64,
    /// Whether they take torque.
    pub torque: bool,
    /// Motors of a unit.
    pub motors: usize,
    /// Inputs at which a unit can have the second encoder of its one cable; `None`: its driver reads none.
    pub second_encoders: Option<RangeInclusive<u8>>,
    /// Counts in which its reading repeats; a motion of half of them between two cycles cannot be told from one back.
    pub second_turn: Option<f64>,
    /// Bytes that it adds to a cycle of a unit.
    pub second_bytes: f64,
    /// What a builder sets before the first use, in the words of the maker's program.
    pub set: &'static str,
    /// What to do about units that cannot be used.
    pub remedies: Remedies,
    /// Most units on a serial wire, and on a USB adapter.
    pub units: [usize; 2],
    /// Time of one cycle over a USB adapter besides the units', and for each unit, s; `None`: the family has no such
    /// adapter.
    pub usb_s: Option<[f64; 2]>,
    /// Bytes of one cycle on the wire for a unit, with answers.
    pub unit_bytes: f64,
    /// Exchanges of one cycle for a unit.
    pub unit_exchanges: f64,
    /// Bytes of the one slow reading of a cycle.
    pub slow_bytes: f64,
}

/// Cost of an exchange besides its bytes on a native serial port, s: unit and host together.
const TURNAROUND_S: f64 = 0.000_3;

impl DriveFamily {
    /// Time of one cycle with so many units, on a native serial port of this baud rate or over a USB adapter, s.
    #[must_use]
    pub fn cycle_s(&self, units: usize, baud: u32, wire: Wire) -> f64 {
        let units = units as f64;
        if let (Wire::Usb, Some([fixed_s, unit_s])) = (wire, self.usb_s) {
            return fixed_s + units * unit_s;
        }
        (units * self.unit_bytes + self.slow_bytes) * 10.0 / f64::from(baud)
            + (units * self.unit_exchanges + 1.0) * TURNAROUND_S
    }
}

impl DriveFamily {
    /// The same with a second encoder at every unit.
    #[must_use]
    pub fn with_second_encoders(self) -> Self {
        Self { unit_bytes: self.unit_bytes + self.second_bytes, ..self }
    }
}

/// The default is the family that was supported first.
impl Default for DriveProtocol {
    fn default() -> Self {
        DriveProtocol::Roboclaw
    }
}

const ROBOCLAW: DriveFamily = DriveFamily {
    // The rates that the units' set-up program offers.
    bauds: &[2400, 9600, 19_200, 38_400, 57_600, 115_200, 230_400, 460_800],
    addresses: 0x80..=0x87,
    addresses_in_words: "128 to 135 (0x80 to 0x87)",
    // A byte of tenths; 0 switches the watchdog off.
    watchdog_s: [0.1, 25.5],
    watchdog_step_s: 0.1,
    torque: false,
    motors: 2,
    second_encoders: None,
    second_turn: None,
    second_bytes: 0.0,
    set: "in Motion Studio: packet serial mode, address and baud rate of the system file, and multi-unit mode if a bus has \
          several units; the speed loop, tuned with the cable's load on the drum; motor leads such that a positive speed \
          makes the count rise; a current limit, and the E-stop input if a button is wired to it",
    remedies: Remedies {
        silent: "switch its supply on, and check address and baud rate in Motion Studio",
        foreign: "check that it is the units' port, and in Motion Studio packet serial mode and this baud rate",
        echo: ECHO,
        watchdog: "update the unit's firmware in Motion Studio",
        settings: "look for a second unit with the same address",
    },
    units: [8, 0],
    usb_s: None,
    // Speeds, encoders, currents.
    unit_bytes: 13.0 + 12.0 + 8.0,
    unit_exchanges: 3.0,
    slow_bytes: 8.0,
};

const MOTEUS: DriveFamily = DriveFamily {
    // 921600 is the firmware's default, and `aux1.uart.baud_rate` or `aux2.uart.baud_rate` another one. The firmware
    // receives and sends by DMA, and halves the oversampling for high rates (fw/uart_fdcanusb_micro_server.h and
    // fw/stm32_serial.h of mjbots/moteus). 3 Mbaud is the highest rate of the UARTs of a Raspberry Pi (48 MHz / 16).
    bauds: &[115_200, 230_400, 460_800, 921_600, 3_000_000],
    addresses: 1..=126,
    addresses_in_words: "1 to 126",
    // The time limit of a command: 16 bits of milliseconds.
    watchdog_s: [0.02, 30.0],
    watchdog_step_s: 0.001,
    torque: true,
    motors: 1,
    // A UART has no addresses on the wire.
    // Sources of the maker's `motor_position`; the register's name and value, in hexadecimal.
    second_encoders: Some(0..=2),
    // A turn of the encoder.
    second_turn: Some(100_000.0),
    second_bytes: 4.0 + 8.0,
    set: "with moteus_tool: --calibrate for each motor, and another id.id for each unit on an adapter; in tview: \
          servopos.position_min and position_max to nan, motor_position such that a positive velocity makes the position \
          rise, the gains of servo.pid_position and servo.max_current_A with the cable's load on the drum, and \
          servo.timeout_mode 12",
    remedies: Remedies {
        silent: "switch its supply on, check id.id with moteus_tool --info, and that wire is usb for a fdcanusb and \
                 serial for a UART",
        foreign: "check that it is the port of the fdcanusb (wire usb) or of the UART (wire serial, with the baud rate \
                  of aux1.uart or aux2.uart: 921600, unless it was changed)",
        echo: ECHO,
        watchdog: "update the unit's firmware with moteus_tool --flash, and let no other program command it",
        settings: "update the unit's firmware with moteus_tool --flash, and check motor_position in tview",
    },
    units: [1, 8],
    // Two round trips of a USB frame each. For each unit four frames of at most 64 bytes at 1 and 5 Mbit/s,
    // and their text lines at 12 Mbit/s; estimated, not measured.
    usb_s: Some([0.002, 0.001]),
    // Command and position: 75 and 81 bytes; supply, current and status: 50 and 93, in hexadecimal.
    unit_bytes: 75.0 + 81.0 + 50.0 + 93.0,
    unit_exchanges: 1.0,
    slow_bytes: 0.0,
};

const ODRIVE: DriveFamily = DriveFamily {
    bauds: &[115_200, 230_400, 460_800, 921_600],
    addresses: 0..=127,
    addresses_in_words: "0 to 127, a name for messages: the protocol has none",
    watchdog_s: [0.02, 30.0],
    watchdog_step_s: 0.001,
    torque: true,
    motors: 2,
    second_encoders: None,
    second_turn: None,
    second_bytes: 0.0,
    set: "in odrivetool: motor and encoder calibration of each axis with startup_closed_loop_control off, on a UART the \
          ASCII protocol alone with the baud rate of the system file, input_mode pass-through, vel_limit above the \
          fastest command, current_lim and the gains of the velocity loop with the cable's load on the drum, and a \
          direction in which a positive velocity makes the position rise; then save it",
    remedies: Remedies {
        silent: "switch its supply on, and check config.uart_a_baudrate in odrivetool: 921600 for two axes at 100 Hz",
        foreign: "check that it is the board's port, and in odrivetool config.uart_a_baudrate and that only the ASCII \
                  protocol is on",
        echo: ECHO,
        watchdog: "check that the board's firmware is 0.5, and let no other program write config.watchdog_timeout",
        settings: "check that the board's firmware is 0.5, and calibrate motor and encoder in odrivetool",
    },
    units: [1, 1],
    // Two round trips of a USB frame each, and the board's own time; estimated, not measured.
    usb_s: Some([0.002, 0.001]),
    // Two axes: velocities, their read-backs, states and positions: 200 bytes; errors, currents and supply:
    // 216. Answers arrive meanwhile, but for the last one of each batch.
    unit_bytes: 200.0 + 26.0 + 216.0 + 26.0,
    unit_exchanges: 1.0,
    slow_bytes: 0.0,
};

const ROBOTEQ: DriveFamily = DriveFamily {
    // The rates of its serial port.
    bauds: &[9600, 19_200, 38_400, 57_600, 115_200],
    addresses: 0..=127,
    addresses_in_words: "0 to 127, a name for messages: the protocol has none",
    watchdog_s: [0.02, 65.0],
    watchdog_step_s: 0.001,
    torque: false,
    motors: 2,
    second_encoders: None,
    second_turn: None,
    second_bytes: 0.0,
    set: "in Roborun+: MMOD 1 for each channel with a cable, EPPR and the encoder as feedback of its channel, MXRPM a \
          little above the fastest command, MAC and MDEC above the accelerations of the robot, ALIM, a direction in which \
          a positive command makes the count rise, the stop button as an emergency stop, and no script; then save it to \
          the controller",
    remedies: Remedies {
        // An echo is part of this protocol, so a loopback looks like silence.
        silent: "switch its supply on, remove a loopback plug, and check its cable and that its port has 115200 \
                 baud",
        foreign: "check that it is the controller's port at 115200 baud, and that no script prints",
        echo: "connect and switch on the controller, and remove a loopback plug; nims switches the controller's own \
               echo off",
        watchdog: "remove the script that sets RWD, in Roborun+",
        settings: "set MMOD 1, MXRPM and EPPR of each channel in Roborun+, and save them to the controller",
    },
    units: [1, 1],
    // One round trip of USB frames, and the controller's own time; estimated, not measured.
    usb_s: Some([0.002, 0.001]),
    // Until the last answer: a number, twice two counters of six digits, an acknowledgement and two
    // commands read back; then flags and one of currents, outputs and voltages. Other questions are sent
    // meanwhile.
    unit_bytes: 16.0 + 36.0 + 2.0 + 15.0,
    unit_exchanges: 1.0,
    slow_bytes: 16.0,
};

impl DriveProtocol {
    /// Properties of this family.
    #[must_use]
    pub const fn family(self) -> DriveFamily {
        match self {
            DriveProtocol::Roboclaw => ROBOCLAW,
            DriveProtocol::Moteus => MOTEUS,
            DriveProtocol::Odrive => ODRIVE,
            DriveProtocol::Roboteq => ROBOTEQ,
        }
    }
}
