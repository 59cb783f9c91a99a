//! Simulation speed of the plant relative to real time: `cargo run -p plant --example speed`.

use std::time::Instant;

use plant::{MotorInput, Plant, PlantConfig, PlantError};

fn main() -> Result<(), PlantError> {
    let anchors = vec![[0.0, 0.0, 3.0], [9.0, 0.0, 3.2], [9.2, 8.0, 2.9], [-0.2, 8.1, 3.1]];
    let mut plant = Plant::new(PlantConfig::new(anchors, [4.0, 4.2, 1.1]))?;
    let begin = Instant::now();
    for cycle in 0..6000 {
        let speed = if cycle / 100 % 2 == 0 { 0.02 } else { -0.02 };
        let inputs: [MotorInput; 4] = [plant.speed_input(0, speed); 4];
        plant.step(0.01, &inputs)?;
    }
    let elapsed_s = begin.elapsed().as_secs_f64();
    println!("60 s of four cables in {elapsed_s:.3} s: {:.0} times real time", 60.0 / elapsed_s);
    Ok(())
}
