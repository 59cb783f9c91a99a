//! Prints how exactly three and four lines follow the spiral and the piecewise-linear path.

use nims_tests::scenarios;

fn main() -> anyhow::Result<()> {
    println!("{}", scenarios::HEADING);
    for case in scenarios::all() {
        let started = std::time::Instant::now();
        for stretch in [true, false] {
            let flight = nims_tests::lockstep::fly(case.scenario(stretch)?)?;
            println!("{}", scenarios::row(&case, stretch, &flight));
        }
        eprintln!("{:.2} s", started.elapsed().as_secs_f64());
    }
    Ok(())
}
