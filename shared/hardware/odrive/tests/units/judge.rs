//! The virtual board, as a client that others wrote sees it: the crate `odrive-rs`. It sends lines without checksums,
//! adds a feedforward to a velocity, and never asks for the position.

use std::io::{Read, Result, Write};

use odrive::unit::{Board, BoardOptions, Measured};
use odrive_rs::prelude::{AxisID, AxisState, ODrive};
use serial::{Device, WireQueue};

/// A wire to a board, on which each read takes a millisecond.
struct Wire {
    board: Board,
    answers: WireQueue,
    now_ns: u64,
}

impl Write for Wire {
    fn write(&mut self, bytes: &[u8]) -> Result<usize> {
        bytes.iter().for_each(|&byte| self.board.receive(self.now_ns, byte, &mut self.answers));
        Ok(bytes.len())
    }

    fn flush(&mut self) -> Result<()> {
        Ok(())
    }
}

impl Read for Wire {
    fn read(&mut self, buffer: &mut [u8]) -> Result<usize> {
        self.now_ns += 1_000_000;
        self.board.advance(self.now_ns);
        let mut arrived = std::iter::from_fn(|| self.answers.pop(self.now_ns));
        Ok(buffer.iter_mut().zip(&mut arrived).map(|(place, (_, byte))| *place = byte).count())
    }
}

/// A client that owns the wire; the board is seen through its answers.
fn client() -> ODrive<Wire> {
    let mut board = Board::new(BoardOptions::new(0));
    let moving = Measured { counts: [125_000, -50_000], speeds_counts_s: [25_000.0, 0.0], ..Measured::default() };
    board.measure(&moving);
    ODrive::new(Wire { board, answers: WireQueue::new(921_600), now_ns: 0 })
}

fn ask(client: &mut ODrive<Wire>, line: &str) -> String {
    writeln!(client, "{line}").unwrap();
    client.read_string().unwrap().expect("the board answers")
}

#[test]
fn a_client_of_others_commands_and_reads_the_board() {
    let mut client = client();
    assert_eq!(ask(&mut client, "r vbus_voltage"), "24.000000");
    for (axis, turns_s) in [(AxisID::Zero, 1.5), (AxisID::One, -0.25)] {
        let number = axis as usize;
        client.set_velocity(axis, turns_s, None).unwrap();
        assert_eq!(ask(&mut client, &format!("r axis{number}.current_state")), "1", "a velocity does not arm");
        assert!(client.run_state(axis, AxisState::ClosedLoopControl, false).unwrap());
        writeln!(client, "r axis{number}.current_state").unwrap();
        assert_eq!(client.read_int().unwrap(), Some(AxisState::ClosedLoopControl as i32));
        writeln!(client, "r axis{number}.controller.input_vel").unwrap();
        assert_eq!(client.read_float().unwrap(), Some(turns_s));
    }
    assert_eq!(ask(&mut client, "f 0"), "1.250000 0.250000");
    assert_eq!(ask(&mut client, "f 1"), "-0.500000 0.000000");
    // Waits until the axis is idle.
    assert!(client.run_state(AxisID::Zero, AxisState::Idle, true).unwrap());
    // The client's own question has a stray space, which the firmware does not accept either.
    assert_eq!(client.get_velocity(AxisID::One).unwrap(), Some(0.0));
    assert_eq!(ask(&mut client, "r blahblah"), "invalid property");
}
