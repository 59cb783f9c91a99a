//! Faults on request, and the text of a request.

use std::str::FromStr;

use thiserror::Error;

/// A fault or its repair. Ports and cables are numbered from 0 here, and from 1 in requests.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum BoxFault {
    /// A fault of motors, cables, encoders or supply.
    Plant(plant::Fault),
    /// Unplugs a port: its name disappears.
    Unplug {
        /// Index of the port.
        port: usize,
    },
    /// Plugs a port in again.
    Plug {
        /// Index of the port.
        port: usize,
    },
    /// Inverts bits on a port's wire.
    Noise {
        /// Index of the port.
        port: usize,
        /// Probability for each byte; 0: no fault.
        probability: f64,
    },
    /// Drops all answers of the units on a port.
    Silence {
        /// Index of the port.
        port: usize,
        /// True: silent.
        on: bool,
    },
    /// Delays the answers of the units on a port.
    Late {
        /// Index of the port.
        port: usize,
        /// Delay, s; 0: no fault.
        delay_s: f64,
    },
    /// A unit loses its supply for a while and restarts with its encoders at zero.
    Reboot {
        /// Index of the port.
        port: usize,
        /// Address of the unit.
        address: u8,
        /// Duration, s.
        for_s: f64,
    },
    /// Drops the answers of a unit for a while; it still executes commands.
    Mute {
        /// Index of the port.
        port: usize,
        /// Address of the unit.
        address: u8,
        /// Duration, s.
        for_s: f64,
    },
    /// Presses the stop button on a unit's own input: the unit releases its motors and reports it in its status.
    Estop {
        /// Index of the port.
        port: usize,
        /// Address of the unit.
        address: u8,
        /// True: pressed.
        on: bool,
    },
}

/// One kind of fault in requests.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Kind {
    /// First word of the request.
    pub name: &'static str,
    /// Arguments.
    pub arguments: &'static str,
    /// Effect, for the help text.
    pub what: &'static str,
}

/// Every kind. Cables, ports and units are numbered as in the system file.
pub const KINDS: [Kind; 14] = [
    kind("noise", "PORT PROBABILITY", "inverts a bit of each byte, in both directions, with this probability"),
    kind("silence", "PORT", "drops all answers of the units on the port; they still receive commands"),
    kind("late", "PORT SECONDS", "delays the answers of the units on the port by this time"),
    kind("mute", "PORT ADDRESS", "drops the answers of one unit for half a second or the given time"),
    kind("unplug", "PORT", "unplugs the port: its device name disappears"),
    kind("plug", "PORT", "plugs the port in again"),
    kind(
        "reboot",
        "PORT ADDRESS",
        "a unit loses its supply for half a second or the given time and restarts with its encoders at zero",
    ),
    kind(
        "estop",
        "PORT ADDRESS",
        "presses the stop button on a unit's own input: the unit releases its motors and reports it in its status",
    ),
    kind("supply", "VOLTS", "sets the no-load voltage of the supply"),
    kind("stall", "CABLE", "jams the motor"),
    kind(
        "slip",
        "CABLE SHARE",
        "this share of the cable's motion slips over the idler wheel and is not measured; with `drum` as the last word, this \
         share of the drum's motion does not move the cable",
    ),
    kind("dead", "CABLE", "stops the encoder's count"),
    kind("jump", "CABLE COUNTS", "the encoder's count jumps by this amount"),
    kind("break", "CABLE", "breaks the cable"),
];

const fn kind(name: &'static str, arguments: &'static str, what: &'static str) -> Kind {
    Kind { name, arguments, what }
}

/// Default duration of a unit's fault, s: longer than the time after which a unit counts as lost.
const AWAY_S: f64 = 0.5;

/// Longest duration of a fault, s.
const LONGEST_S: f64 = 3600.0;

/// A request that is not a fault.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error(
    "\"{text}\" is not a fault of the motor box: write one of {}; for most of them, `off` as the last word ends the \
         fault at once, `for SECONDS` after that time; cables and ports count from 1",
    forms()
)]
pub struct UnknownFault {
    text: String,
}

fn forms() -> String {
    KINDS.map(|kind| format!("{} {}", kind.name, kind.arguments)).join(", ")
}

/// A fault with its duration.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FaultRequest {
    /// The fault or repair.
    pub fault: BoxFault,
    /// Time after which it is repaired, s.
    pub for_s: Option<f64>,
}

impl FromStr for FaultRequest {
    type Err = UnknownFault;

    fn from_str(text: &str) -> Result<Self, UnknownFault> {
        let words: Vec<&str> = text.split_whitespace().collect();
        parse(&words).ok_or_else(|| UnknownFault { text: text.to_owned() })
    }
}

impl BoxFault {
    /// Repair of the fault, in a box with this supply, V. `None` for a momentary fault or a repair.
    #[must_use]
    pub fn repair(&self, supply_v: f64) -> Option<Self> {
        use plant::Fault;
        Some(match *self {
            Self::Plant(fault) => Self::Plant(match fault {
                Fault::Stall { cable, on: true } => Fault::Stall { cable, on: false },
                Fault::EncoderDead { cable, on: true } => Fault::EncoderDead { cable, on: false },
                Fault::BrokenLine { cable, on: true } => Fault::BrokenLine { cable, on: false },
                Fault::IdlerSlip { cable, .. } => Fault::IdlerSlip { cable, share: 0.0 },
                Fault::DrumSlip { cable, .. } => Fault::DrumSlip { cable, share: 0.0 },
                Fault::Supply { .. } => Fault::Supply { voltage_v: supply_v },
                _ => return None,
            }),
            Self::Unplug { port } => Self::Plug { port },
            Self::Noise { port, .. } => Self::Noise { port, probability: 0.0 },
            Self::Silence { port, on: true } => Self::Silence { port, on: false },
            Self::Late { port, .. } => Self::Late { port, delay_s: 0.0 },
            Self::Estop { port, address, on: true } => Self::Estop { port, address, on: false },
            _ => return None,
        })
    }
}

fn parse(words: &[&str]) -> Option<FaultRequest> {
    let (words, for_s) = match words {
        [words @ .., "for", seconds] => (words, Some(amount(seconds).filter(|s| *s > 0.0 && *s <= LONGEST_S)?)),
        words => (words, None),
    };
    let away_s = for_s.unwrap_or(AWAY_S);
    let fault = match *words {
        ["reboot", port, address] => {
            BoxFault::Reboot { port: index(port)?, address: address_of(address)?, for_s: away_s }
        }
        ["mute", port, address] => BoxFault::Mute { port: index(port)?, address: address_of(address)?, for_s: away_s },
        ref words => parse_one(words)?,
    };
    match fault {
        // These end on their own.
        BoxFault::Reboot { .. } | BoxFault::Mute { .. } => Some(FaultRequest { fault, for_s: None }),
        // Only a fault with a repair can have a duration.
        _ if for_s.is_some() && fault.repair(0.0).is_none() => None,
        _ => Some(FaultRequest { fault, for_s }),
    }
}

fn parse_one(words: &[&str]) -> Option<BoxFault> {
    use plant::Fault;
    Some(match *words {
        ["stall", cable, ref on @ ..] => BoxFault::Plant(Fault::Stall { cable: index(cable)?, on: switch(on)? }),
        ["slip", cable, "off"] => BoxFault::Plant(Fault::IdlerSlip { cable: index(cable)?, share: 0.0 }),
        ["slip", cable, share] => BoxFault::Plant(Fault::IdlerSlip { cable: index(cable)?, share: fraction(share)? }),
        ["slip", cable, "off", "drum"] => BoxFault::Plant(Fault::DrumSlip { cable: index(cable)?, share: 0.0 }),
        ["slip", cable, share, "drum"] => {
            BoxFault::Plant(Fault::DrumSlip { cable: index(cable)?, share: fraction(share)? })
        }
        ["jump", cable, counts] => {
            // A jump cannot exceed the encoder's register.
            let counts = i64::from(counts.parse::<i32>().ok()?);
            BoxFault::Plant(Fault::EncoderJump { cable: index(cable)?, counts })
        }
        ["dead", cable, ref on @ ..] => BoxFault::Plant(Fault::EncoderDead { cable: index(cable)?, on: switch(on)? }),
        ["break", cable, ref on @ ..] => BoxFault::Plant(Fault::BrokenLine { cable: index(cable)?, on: switch(on)? }),
        ["supply", volts] => BoxFault::Plant(Fault::Supply { voltage_v: amount(volts)? }),
        ["unplug", port] => BoxFault::Unplug { port: index(port)? },
        ["unplug", port, "off"] | ["plug", port] => BoxFault::Plug { port: index(port)? },
        ["noise", port, "off"] => BoxFault::Noise { port: index(port)?, probability: 0.0 },
        ["noise", port, probability] => BoxFault::Noise { port: index(port)?, probability: fraction(probability)? },
        ["silence", port, ref on @ ..] => BoxFault::Silence { port: index(port)?, on: switch(on)? },
        ["estop", port, address, ref on @ ..] => {
            BoxFault::Estop { port: index(port)?, address: address_of(address)?, on: switch(on)? }
        }
        ["late", port, "off"] => BoxFault::Late { port: index(port)?, delay_s: 0.0 },
        ["late", port, delay] => BoxFault::Late { port: index(port)?, delay_s: amount(delay).filter(|s| *s <= 10.0)? },
        _ => return None,
    })
}

/// Converts a number that counts from 1.
fn index(word: &str) -> Option<usize> {
    word.parse::<usize>().ok()?.checked_sub(1)
}

/// Parses `on` or `off`; the default is on.
fn switch(words: &[&str]) -> Option<bool> {
    match words {
        [] | ["on"] => Some(true),
        ["off"] => Some(false),
        _ => None,
    }
}

fn fraction(word: &str) -> Option<f64> {
    word.parse().ok().filter(|value| (0.0..=1.0).contains(value))
}

/// Parses volts or seconds, 0 to 1000.
fn amount(word: &str) -> Option<f64> {
    word.parse().ok().filter(|value| (0.0..=1000.0).contains(value))
}

/// Parses an address, 128 or 0x80.
fn address_of(word: &str) -> Option<u8> {
    match word.strip_prefix("0x") {
        Some(digits) => u8::from_str_radix(digits, 16).ok(),
        None => word.parse().ok(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use plant::Fault;

    #[test]
    fn every_form_is_parsed() {
        let cases = [
            ("stall 2", BoxFault::Plant(Fault::Stall { cable: 1, on: true })),
            ("stall 2 off", BoxFault::Plant(Fault::Stall { cable: 1, on: false })),
            ("slip 1 0.3", BoxFault::Plant(Fault::IdlerSlip { cable: 0, share: 0.3 })),
            ("slip 1 0.3 drum", BoxFault::Plant(Fault::DrumSlip { cable: 0, share: 0.3 })),
            ("slip 1 off drum", BoxFault::Plant(Fault::DrumSlip { cable: 0, share: 0.0 })),
            ("slip 1 off", BoxFault::Plant(Fault::IdlerSlip { cable: 0, share: 0.0 })),
            ("jump 3 -500", BoxFault::Plant(Fault::EncoderJump { cable: 2, counts: -500 })),
            ("dead 1 off", BoxFault::Plant(Fault::EncoderDead { cable: 0, on: false })),
            ("break 4 on", BoxFault::Plant(Fault::BrokenLine { cable: 3, on: true })),
            ("supply 9.5", BoxFault::Plant(Fault::Supply { voltage_v: 9.5 })),
            ("unplug 1", BoxFault::Unplug { port: 0 }),
            ("plug 2", BoxFault::Plug { port: 1 }),
            ("noise 1 0.01", BoxFault::Noise { port: 0, probability: 0.01 }),
            ("silence 1 on", BoxFault::Silence { port: 0, on: true }),
            ("late 1 0.004", BoxFault::Late { port: 0, delay_s: 0.004 }),
            ("late 1 off", BoxFault::Late { port: 0, delay_s: 0.0 }),
            ("estop 1 129", BoxFault::Estop { port: 0, address: 129, on: true }),
            ("estop 1 0x81 off", BoxFault::Estop { port: 0, address: 0x81, on: false }),
            ("reboot 1 0x81", BoxFault::Reboot { port: 0, address: 0x81, for_s: 0.5 }),
            ("reboot 1 0x81 for 0.2", BoxFault::Reboot { port: 0, address: 0x81, for_s: 0.2 }),
            ("  mute 1  128 for 2 ", BoxFault::Mute { port: 0, address: 128, for_s: 2.0 }),
        ];
        for (text, fault) in cases {
            assert_eq!(text.parse(), Ok(FaultRequest { fault, for_s: None }), "{text}");
        }
        let timed = FaultRequest { fault: BoxFault::Silence { port: 0, on: true }, for_s: Some(1.5) };
        assert_eq!("silence 1 for 1.5".parse(), Ok(timed));
    }

    #[test]
    fn every_kind_has_a_form_that_is_parsed() {
        let values = [("CABLE", "1"), ("PORT", "1"), ("ADDRESS", "128"), ("SHARE", "0.5"), ("PROBABILITY", "0.5")];
        let more = [("SECONDS", "0.1"), ("COUNTS", "50"), ("VOLTS", "9")];
        for kind in KINDS {
            let words = kind.arguments.split(' ').map(|word| {
                values.iter().chain(&more).find(|(name, _)| *name == word).map_or(word, |(_, value)| value)
            });
            let text = [kind.name].into_iter().chain(words).collect::<Vec<_>>().join(" ");
            assert!(text.parse::<FaultRequest>().is_ok(), "{text}");
        }
    }

    #[test]
    fn every_lasting_fault_has_a_repair() {
        for text in [
            "stall 1",
            "slip 1 0.5",
            "dead 1",
            "break 1",
            "supply 3",
            "unplug 1",
            "noise 1 0.1",
            "silence 1",
            "late 1 1",
            "estop 1 128",
        ] {
            let fault = text.parse::<FaultRequest>().expect(text).fault;
            let repair = fault.repair(24.0).expect(text);
            assert!(repair != fault, "{text}");
            assert!(repair.repair(24.0).is_none_or(|again| again == repair), "{text}");
        }
        assert_eq!(
            "supply 3".parse::<FaultRequest>().expect("known").fault.repair(24.0),
            Some(BoxFault::Plant(Fault::Supply { voltage_v: 24.0 }))
        );
    }

    #[test]
    fn invalid_requests_are_rejected_with_the_accepted_forms() {
        for text in [
            "",
            "stall",
            "stall 0",
            "stall 1 perhaps",
            "slip 1 1.5",
            "supply NaN",
            "noise 1 inf",
            "explode 1",
            "jump 1 9e99",
            "jump 1 50 for 2",
            "stall 1 off for 2",
            "stall 1 for 0",
            "stall 1 for -1",
            "late 1 60",
        ] {
            let error = text.parse::<FaultRequest>().expect_err(text).to_string();
            let form = |kind: &Kind| format!("{} {}", kind.name, kind.arguments);
            assert!(KINDS.iter().all(|kind| error.contains(&form(kind))), "{error}");
            assert!(error.contains(text), "{error}");
        }
    }
}
