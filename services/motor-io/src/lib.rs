//! The clock of the robot and the only process that moves it.
