//! What every drive family must do: one suite over [`drives::DriveBus`], run against the family's virtual units on a
//! wire with a virtual clock.
//!
//! A family implements [`Family`] for its driver and [`VirtualUnits`] for its virtual units, in its own tests, and
//! writes `drive_conformance::conformance!(MyFamily);`. Each case becomes a test. The suite does not depend on the
//! protocol: it commands the bus, compares with what the virtual motors do, and disturbs the wire between them.
//!
//! The encoders of the virtual units show the time ([`Clockwork`]): 1 count per microsecond. Each sample therefore
//! states when it was taken, and a stale one cannot pass for a new one.
//!
//! ```no_run
//! # use drive_conformance::{Clockwork, Family, VirtualUnits};
//! # use drives::{AXES, Command, DriveBus};
//! # use serial::{Device, Pipe, WireQueue};
//! # struct MyUnits;
//! # impl Device for MyUnits { fn receive(&mut self, _: u64, _: u8, _: &mut WireQueue) {} }
//! # impl VirtualUnits for MyUnits {
//! #     fn measure(&mut self, _: usize, _: [i64; AXES], _: [f64; AXES]) {}
//! #     fn drive(&self, _: usize, _: usize) -> Command { Command::Release }
//! #     fn restart(&mut self, _: usize, _: u64) {}
//! #     fn mute(&mut self, _: usize, _: bool) {}
//! #     fn press_stop(&mut self, _: usize, _: bool) {}
//! #     fn keep_watchdog(&mut self, _: usize, _: u32) {}
//! # }
//! # struct MyFamily;
//! # impl Family for MyFamily {
//! #     type Units = MyUnits;
//! #     type Bus = Box<dyn DriveBus>;
//! #     const BAUD: u32 = 115_200;
//! #     const MOTORS: usize = 1;
//! #     const ANSWER_NS: u64 = 5_000_000;
//! #     fn units(_: usize) -> MyUnits { MyUnits }
//! #     fn bus(_: Pipe<Clockwork<MyUnits>>, _: usize) -> Box<dyn DriveBus> { todo!() }
//! #     fn pipe(_: &mut Box<dyn DriveBus>) -> &mut Pipe<Clockwork<MyUnits>> { todo!() }
//! # }
//! drive_conformance::conformance!(MyFamily);
//! ```
//!
//! A case panics with what the family did instead. This crate is for tests only.
#![forbid(unsafe_code)]
#![allow(clippy::unwrap_used, clippy::expect_used)]

pub mod cases;
mod clockwork;
mod family;
mod robot;
mod virtual_units;

pub use clockwork::Clockwork;
pub use family::{BOUND, Family, WATCHDOG_MS};
pub use robot::{BUDGET_NS, MS, PERIOD_NS, Robot};
pub use virtual_units::VirtualUnits;

/// A test for each case of the suite, for one [`Family`]. With `in packets`, without the cases in which bytes are lost
/// or changed, for a wire that does not let that happen.
#[macro_export]
macro_rules! conformance {
    ($family:ty) => {
        $crate::conformance!($family, in packets);
        /// Takes up to three minutes.
        #[test]
        #[ignore = "two hours of traffic: `cargo test -p FAMILY two_hours -- --ignored --nocapture`"]
        fn two_hours_of_traffic() {
            $crate::cases::two_hours_of_traffic::<$family>();
        }
        $crate::conformance!($family:
            bytes_that_answer_nothing_are_discarded,
            a_lost_answer_costs_few_cycles,
            torques_and_speeds_are_told_apart,
            byte_errors_neither_acknowledge_nor_age
        );
    };
    ($family:ty, in packets) => {
        $crate::conformance!($family:
            commands_reach_the_motors,
            a_command_that_the_family_lacks_is_refused,
            a_number_that_is_no_speed_moves_nothing,
            readings_are_fresh_and_complete,
            a_second_encoder_is_read_with_the_first,
            nothing_is_sent_after_the_deadline,
            a_late_unit_leaves_no_late_command,
            a_status_is_read_where_no_cycle_leaves_time,
            a_unit_is_used_only_with_its_watchdog_read_back,
            a_unit_that_keeps_another_watchdog_is_refused,
            motors_stop_by_the_watchdog_when_commands_cease,
            an_emergency_stop_is_reported_and_stops_the_motors,
            a_restart_is_counted_and_interlocked,
            a_restart_around_a_refused_watchdog_is_counted,
            a_late_answer_never_answers_a_later_question,
            swapped_answers_are_told_apart,
            a_silent_unit_costs_the_others_little,
            a_unit_that_is_not_heard_stops_in_its_watchdogs_time,
            a_unit_that_stood_unheard_moves_only_after_a_command_to_hold,
            an_unplugged_port_is_lost_at_once_and_comes_back_interlocked,
            a_restart_behind_an_unplugged_port_is_counted,
            counts_continue_when_the_counter_wraps,
            a_unit_that_moves_at_the_start_is_interlocked_and_counted
        );
    };
    ($family:ty: $($case:ident),+) => {
        $(
            #[test]
            fn $case() {
                $crate::cases::$case::<$family>();
            }
        )+
    };
}
