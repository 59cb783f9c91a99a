//! Prints how the preview law follows, as ratios to the paper's law in the same run: with delay and lag identified in
//! flight, known exactly, and off by 10 %, by 30 % and by a factor of 2, the last with and without the fallback.
//! `CASES=1` flies only the first case.

use nims_tests::{laws, scenarios};

fn main() -> anyhow::Result<()> {
    let cases = std::env::var("CASES").ok().map(|text| text.parse()).transpose()?.unwrap_or(usize::MAX);
    println!("{}", laws::HEADING);
    for case in scenarios::all().iter().take(cases) {
        println!("{}", laws::compare(case, &laws::all())?.row(case));
    }
    Ok(())
}
