//! What can be broken on request, and how the request is written.

use std::str::FromStr;

use thiserror::Error;

/// Something that breaks, or is put right. Ports and cables are numbered from 0 here, and from 1 where people write them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum BoxFault {
    /// Motors, lines, encoders, supply.
    Plant(plant::Fault),
    /// A port's plug is pulled: its name goes away.
    Unplug {
        /// Which port.
        port: usize,
    },
    /// It is plugged in again.
    Plug {
        /// Which port.
        port: usize,
    },
    /// Bits turn over on a port's wire.
    Noise {
        /// Which port.
        port: usize,
        /// Probability for each byte; 0 puts it right.
        probability: f64,
    },
    /// Nothing that the units on a port say gets through.
    Silence {
        /// Which port.
        port: usize,
        /// Silent, or right again.
        on: bool,
    },
    /// A unit loses its supply for a while and begins again, its encoders at zero.
    Reboot {
        /// Which port.
        port: usize,
        /// Which unit on it.
        address: u8,
        /// For how long, s.
        for_s: f64,
    },
    /// What a unit answers is lost for a while; it still does what it is told.
    Mute {
        /// Which port.
        port: usize,
        /// Which unit on it.
        address: u8,
        /// For how long, s.
        for_s: f64,
    },
}

/// How faults are written.
const FORMS: &str = "stall CABLE on|off, slip CABLE SHARE, jump CABLE COUNTS, dead CABLE on|off, break CABLE on|off, supply VOLTS, \
                     unplug PORT, plug PORT, noise PORT PROBABILITY, silence PORT on|off, reboot PORT ADDRESS SECONDS, \
                     mute PORT ADDRESS SECONDS";

/// A request that is no fault.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("\"{text}\" is not a fault of the motor box: write one of {FORMS}; cables and ports count from 1")]
pub struct UnknownFault {
    text: String,
}

impl FromStr for BoxFault {
    type Err = UnknownFault;

    fn from_str(text: &str) -> Result<Self, UnknownFault> {
        let words: Vec<&str> = text.split_whitespace().collect();
        parse(&words).ok_or_else(|| UnknownFault { text: text.to_owned() })
    }
}

fn parse(words: &[&str]) -> Option<BoxFault> {
    use plant::Fault;
    Some(match *words {
        ["stall", cable, on] => BoxFault::Plant(Fault::Stall { cable: index(cable)?, on: switch(on)? }),
        ["slip", cable, share] => BoxFault::Plant(Fault::IdlerSlip { cable: index(cable)?, share: fraction(share)? }),
        ["jump", cable, counts] => {
            // No encoder of this size counts further than its register in one jump.
            let counts = i64::from(counts.parse::<i32>().ok()?);
            BoxFault::Plant(Fault::EncoderJump { cable: index(cable)?, counts })
        }
        ["dead", cable, on] => BoxFault::Plant(Fault::EncoderDead { cable: index(cable)?, on: switch(on)? }),
        ["break", cable, on] => BoxFault::Plant(Fault::BrokenLine { cable: index(cable)?, on: switch(on)? }),
        ["supply", volts] => BoxFault::Plant(Fault::Supply { voltage_v: amount(volts)? }),
        ["unplug", port] => BoxFault::Unplug { port: index(port)? },
        ["plug", port] => BoxFault::Plug { port: index(port)? },
        ["noise", port, probability] => BoxFault::Noise { port: index(port)?, probability: fraction(probability)? },
        ["silence", port, on] => BoxFault::Silence { port: index(port)?, on: switch(on)? },
        ["reboot", port, address, for_s] => {
            BoxFault::Reboot { port: index(port)?, address: address_of(address)?, for_s: amount(for_s)? }
        }
        ["mute", port, address, for_s] => {
            BoxFault::Mute { port: index(port)?, address: address_of(address)?, for_s: amount(for_s)? }
        }
        _ => return None,
    })
}

/// Counted from 1 by people.
fn index(word: &str) -> Option<usize> {
    word.parse::<usize>().ok()?.checked_sub(1)
}

fn switch(word: &str) -> Option<bool> {
    match word {
        "on" => Some(true),
        "off" => Some(false),
        _ => None,
    }
}

fn fraction(word: &str) -> Option<f64> {
    word.parse().ok().filter(|value| (0.0..=1.0).contains(value))
}

/// Zero to a thousand: volts or seconds.
fn amount(word: &str) -> Option<f64> {
    word.parse().ok().filter(|value| (0.0..=1000.0).contains(value))
}

/// 128, or 0x80.
fn address_of(word: &str) -> Option<u8> {
    match word.strip_prefix("0x") {
        Some(digits) => u8::from_str_radix(digits, 16).ok(),
        None => word.parse().ok(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_form_is_understood() {
        let cases = [
            ("stall 2 on", BoxFault::Plant(plant::Fault::Stall { cable: 1, on: true })),
            ("slip 1 0.3", BoxFault::Plant(plant::Fault::IdlerSlip { cable: 0, share: 0.3 })),
            ("jump 3 -500", BoxFault::Plant(plant::Fault::EncoderJump { cable: 2, counts: -500 })),
            ("dead 1 off", BoxFault::Plant(plant::Fault::EncoderDead { cable: 0, on: false })),
            ("break 4 on", BoxFault::Plant(plant::Fault::BrokenLine { cable: 3, on: true })),
            ("supply 9.5", BoxFault::Plant(plant::Fault::Supply { voltage_v: 9.5 })),
            ("unplug 1", BoxFault::Unplug { port: 0 }),
            ("plug 2", BoxFault::Plug { port: 1 }),
            ("noise 1 0.01", BoxFault::Noise { port: 0, probability: 0.01 }),
            ("silence 1 on", BoxFault::Silence { port: 0, on: true }),
            ("reboot 1 0x81 0.5", BoxFault::Reboot { port: 0, address: 0x81, for_s: 0.5 }),
            ("  mute 1  128 2 ", BoxFault::Mute { port: 0, address: 128, for_s: 2.0 }),
        ];
        for (text, fault) in cases {
            assert_eq!(text.parse(), Ok(fault), "{text}");
        }
    }

    #[test]
    fn anything_else_is_refused_with_the_forms() {
        for text in [
            "",
            "stall",
            "stall 0 on",
            "stall 1",
            "slip 1 1.5",
            "supply NaN",
            "noise 1 inf",
            "explode 1",
            "jump 1 9e99",
        ] {
            let error = text.parse::<BoxFault>().expect_err(text).to_string();
            assert!(error.contains("stall CABLE on|off"), "{error}");
        }
    }
}
