//! Node estimate and motion to cable velocities.
