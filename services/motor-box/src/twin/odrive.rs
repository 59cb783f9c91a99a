//! Boards of ODrive.

use odrive::unit::{Board, BoardOptions, Measured, Target};
use plant::{MotorInput, Plant};
use serial::{Device, WireQueue};

use super::interface::{MOTORS, Readings, Twin, Winch};
use crate::BoxError;
use crate::settings::PortConfig;

/// The board of one port.
#[derive(Debug, Clone)]
pub(crate) struct OdriveTwin(Vec<Board>);

impl OdriveTwin {
    pub(crate) fn new(port: &PortConfig, turnaround_ns: u64) -> Self {
        let board = |address| {
            let options = BoardOptions::new(address);
            let torque_constant_n_m_a = port.torque_constant_n_m_a.unwrap_or(options.torque_constant_n_m_a);
            Board::new(BoardOptions { turnaround_ns, torque_constant_n_m_a, ..options })
        };
        // One at most: the protocol has no addresses.
        Self(port.units.iter().take(1).map(|config| board(config.address)).collect())
    }
}

impl Device for OdriveTwin {
    fn receive(&mut self, now_ns: u64, byte: u8, reply: &mut WireQueue) {
        self.0.iter_mut().for_each(|board| board.receive(now_ns, byte, reply));
    }

    fn advance(&mut self, now_ns: u64) {
        self.0.iter_mut().for_each(|board| board.advance(now_ns));
    }
}

impl Twin for OdriveTwin {
    fn copy(&self) -> Box<dyn Twin> {
        Box::new(self.clone())
    }

    fn device(&mut self) -> &mut dyn Device {
        self
    }

    /// The loops of a calibrated board follow; their gains are none of the wire's.
    fn commission(&mut self, _: &Plant, _: &[[Option<Winch>; MOTORS]], _: f64) {}

    fn measure(&mut self, unit: usize, readings: &Readings) {
        let measured = Measured {
            counts: readings.counts,
            speeds_counts_s: readings.speeds_counts_s,
            currents_a: readings.currents_a,
            supply_v: readings.supply_v,
            stopped: readings.stopped,
        };
        if let Some(board) = self.0.get_mut(unit) {
            board.measure(&measured);
        }
    }

    fn target(&self, unit: usize, motor: usize) -> MotorInput {
        match self.0.get(unit).map(|board| board.target(motor)) {
            Some(Target::Velocity(counts_s)) => MotorInput::Speed(counts_s),
            Some(Target::Current(current_a)) => MotorInput::Current(current_a),
            Some(Target::Released) | None => MotorInput::RELEASED,
        }
    }

    fn apply_settings(&mut self, _: &mut Plant, _: &[[Option<Winch>; MOTORS]]) -> Result<(), BoxError> {
        Ok(())
    }

    fn reboot(&mut self, unit: usize, for_ns: u64) {
        if let Some(board) = self.0.get_mut(unit) {
            board.reboot(for_ns);
        }
    }

    fn mute_until(&mut self, unit: usize, until_ns: u64) {
        if let Some(board) = self.0.get_mut(unit) {
            board.mute_until(until_ns);
        }
    }
}
