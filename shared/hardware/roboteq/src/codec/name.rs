//! Names of readings and settings.

/// A reading or a setting of a controller.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Name {
    /// Motor currents, A times ten.
    Amps,
    /// Encoder counters.
    Counts,
    /// Commands as received over the serial port, thousandths of full speed.
    Command,
    /// Fault flags, see [`fault`](super::fault).
    Faults,
    /// Status flags of each motor, see [`motor_fault`](super::motor_fault).
    MotorFaults,
    /// Status flags of the controller.
    Status,
    /// Firmware, text.
    Firmware,
    /// Control unit and model, text.
    Model,
    /// Commands as applied, thousandths.
    Applied,
    /// Drive outputs, thousandths.
    Power,
    /// Speeds of the encoders, turns per minute.
    Speed,
    /// Internal voltage and supply, V times ten; 5 V output, mV.
    Volts,
    /// A user variable.
    Variable,
    /// Setting: time without a command after which the motors stop, ms; 0: never.
    Watchdog,
    /// Setting: operating mode, see [`mode`](super::mode).
    Mode,
    /// Setting: speed of a command of 1000, turns per minute.
    MaxRpm,
    /// Setting: pulses of the encoder per turn.
    Pulses,
    /// Setting: 1 where received bytes are not sent back.
    EchoOff,
}

impl Name {
    /// Every name.
    pub const ALL: [Name; 18] = [
        Name::Amps,
        Name::Counts,
        Name::Command,
        Name::Faults,
        Name::MotorFaults,
        Name::Status,
        Name::Firmware,
        Name::Model,
        Name::Applied,
        Name::Power,
        Name::Speed,
        Name::Volts,
        Name::Variable,
        Name::Watchdog,
        Name::Mode,
        Name::MaxRpm,
        Name::Pulses,
        Name::EchoOff,
    ];

    /// The name on the wire.
    #[must_use]
    pub const fn text(self) -> &'static str {
        match self {
            Name::Amps => "A",
            Name::Counts => "C",
            Name::Command => "CIS",
            Name::Faults => "FF",
            Name::MotorFaults => "FM",
            Name::Status => "FS",
            Name::Firmware => "FID",
            Name::Model => "TRN",
            Name::Applied => "M",
            Name::Power => "P",
            Name::Speed => "S",
            Name::Volts => "V",
            Name::Variable => "VAR",
            Name::Watchdog => "RWD",
            Name::Mode => "MMOD",
            Name::MaxRpm => "MXRPM",
            Name::Pulses => "EPPR",
            Name::EchoOff => "ECHOF",
        }
    }

    /// True for a setting.
    #[must_use]
    pub const fn is_setting(self) -> bool {
        matches!(self, Name::Watchdog | Name::Mode | Name::MaxRpm | Name::Pulses | Name::EchoOff)
    }

    /// True for a reading that is a text.
    #[must_use]
    pub const fn is_text(self) -> bool {
        matches!(self, Name::Firmware | Name::Model)
    }

    /// The reading or setting of this name, in any case.
    #[must_use]
    pub fn named(text: &str) -> Option<Name> {
        Name::ALL.into_iter().find(|name| name.text().eq_ignore_ascii_case(text))
    }
}
