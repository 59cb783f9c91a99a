//! Prints how exactly robots with three and four cables follow the spiral and the piecewise-linear path, with and
//! without correction for stretch. For example, `HORIZON=20` sets the law's horizon in cycles for all flights.

use nims_tests::{lockstep, scenarios};

fn main() -> anyhow::Result<()> {
    let horizon = std::env::var("HORIZON").ok().map(|text| text.parse()).transpose()?;
    let started = std::time::Instant::now();
    let mut flown_s = 0.0;
    println!("{}", scenarios::HEADING);
    for case in scenarios::all() {
        for stretch in [true, false] {
            let mut scenario = case.scenario(stretch)?;
            scenario.horizon = horizon.unwrap_or(scenario.horizon);
            let period_s = scenario.period_s;
            let flight = lockstep::fly(scenario)?;
            flown_s += flight.cycles as f64 * period_s;
            println!("{}", scenarios::row(&case, stretch, &flight));
        }
    }
    let took_s = started.elapsed().as_secs_f64();
    println!("{flown_s:.0} s flown in {took_s:.1} s: {:.0} times real time", flown_s / took_s);
    Ok(())
}
