//! The file of `nims identify --out`: the identified values under the keys of the configuration files.

use std::fmt::Write as _;
use std::path::Path;

use calibration::Found;
use config::section::Key;
use config::{IdentifiedCable, IdentifiedFile, IdentifiedMotor};
use identification::{Identified, Motor, Value};

use super::findings::Findings;

/// Mean over the cables, with the larger of the spread and the stated deviation.
fn overall(found: &Findings, of: &dyn Fn(&Identified) -> Option<Value>) -> Option<Value> {
    let all: Vec<Value> = found.cables.iter().flatten().filter_map(of).collect();
    let count = all.len() as f64;
    let mean = all.iter().map(|one| one.value).sum::<f64>() / count;
    let stated = all.iter().map(|one| one.sigma.powi(2)).sum::<f64>() / count;
    let spread = all.iter().map(|one| (one.value - mean).powi(2)).sum::<f64>() / count;
    (count > 0.0).then(|| Value { value: mean, sigma: stated.max(spread).sqrt() })
}

/// A text line of the file.
struct Entry {
    line: String,
    /// Why the reader of the file would refuse it.
    refused: Option<String>,
}

/// The entry of a key, rounded; `keys`: those of its section, with the values that each accepts.
fn entry(keys: &[Key], name: &str, Value { value, sigma }: Value, decimals: usize) -> Entry {
    // A value that rounds to zero has no sign.
    let text = format!("{value:.decimals$}");
    let rounded = text.parse::<f64>().unwrap_or(f64::NAN);
    let text = if rounded == 0.0 { format!("{:.decimals$}", 0.0) } else { text };
    let accepted = keys.iter().find(|key| key.name == name).and_then(|key| key.accepted);
    let refused =
        accepted.filter(|accepted| !accepted.contains(rounded)).map(|accepted| format!("accepted: {accepted}"));
    Entry { line: format!("{name} = {text}   # +- {sigma:.decimals$}"), refused }
}

/// Writes an entry, or leaves it out with a comment if the reader of the file would refuse it.
fn put(text: &mut String, Entry { line, refused }: &Entry) {
    let _ = match refused {
        None => writeln!(text, "{line}"),
        Some(why) => writeln!(text, "# left out: {line}; {why}"),
    };
}

/// The text of the file; a comment states each deviation. The reader accepts every value: those which it would refuse
/// are comments.
pub(super) fn text(run: &Path, found: &Findings) -> String {
    let name = run.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    let mut text = format!("# Identified by nims identify from {name:?}; +- is one standard deviation.\n");
    let of_drive = |name: &str, of: &dyn Fn(&Identified) -> Option<Value>| {
        overall(found, of).map(|value| entry(IdentifiedFile::KEYS, name, value, 4))
    };
    let delay = of_drive("delay_s", &|one| Some(one.drive.delay_s));
    let lag = of_drive("lag_s", &|one| Some(one.drive.lag_s));
    if let (Some(mut delay), Some(mut lag)) = (delay, lag) {
        // The reader accepts both or none.
        let pairs = [(&mut delay, "lag_s"), (&mut lag, "delay_s")];
        if pairs.iter().any(|(one, _)| one.refused.is_some()) {
            for (one, other) in pairs {
                one.refused.get_or_insert_with(|| format!("{other} is left out"));
            }
        }
        put(&mut text, &delay);
        put(&mut text, &lag);
    }
    if let Some(mass) = found.mass_kg {
        put(&mut text, &entry(IdentifiedFile::KEYS, "node_mass_kg", mass, 4));
    }
    match &found.stiffness.stiffness_n {
        Found::Determined { value, std } => {
            let value = Value { value: *value, sigma: *std };
            put(&mut text, &entry(IdentifiedFile::KEYS, "stiffness_n", value, 0));
        }
        Found::Undetermined(why) => {
            let _ = writeln!(text, "# stiffness_n: {}", why.replace('\n', " "));
        }
    }
    motor(&mut text, found);
    cables(&mut text, found);
    text
}

fn motor(text: &mut String, found: &Findings) {
    let _ = writeln!(text, "\n# Keys of [motor] in a robot file, as the mean of all cables.\n[motor]");
    let mut key = |name: &str, of: &dyn Fn(&Motor) -> Value, decimals: usize| {
        if let Some(Value { value, sigma }) = overall(found, &|one| one.motor.as_ref().map(of)) {
            // Friction below zero is none.
            let value = if value < 0.0 { 0.0 } else { value };
            put(text, &entry(IdentifiedMotor::KEYS, name, Value { value, sigma }, decimals));
        }
    };
    key("force_constant_n_a", &|motor| motor.force_constant_n_a, 2);
    key("resistance_ohm", &|motor| motor.resistance_ohm, 3);
    key("gear_friction", &|motor| motor.gear_friction, 3);
    key("coulomb_n", &|motor| motor.coulomb_n, 2);
    key("viscous_n_s_m", &|motor| motor.viscous_n_s_m, 1);
}

/// Writes `[[cable]]` for every cable: the reader counts them.
fn cables(text: &mut String, found: &Findings) {
    for (index, one) in found.cables.iter().enumerate() {
        let _ = writeln!(text, "\n[[cable]]   # {}", index + 1);
        let drive = match one {
            Ok(Identified { drive, .. }) => drive,
            Err(why) => {
                let _ = writeln!(text, "# not identified: {}", why.replace('\n', " "));
                continue;
            }
        };
        for (name, value) in [("delay_s", drive.delay_s), ("lag_s", drive.lag_s), ("delay_and_lag_s", drive.total_s)] {
            put(text, &entry(IdentifiedCable::KEYS, name, value, 4));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use calibration::flight::FlightStiffness;
    use identification::Drive;

    /// Findings in which each value is this one.
    fn all(value: f64, motor: bool) -> Identified {
        let one = Value { value, sigma: 0.001 };
        let drive = Drive { delay_s: one, lag_s: one, total_s: one, loop_rad_s: None, residual_m: 1e-4 };
        let motor = motor.then_some(Motor {
            resistance_ohm: one,
            force_constant_n_a: one,
            inertia_kg: one,
            load_share: one,
            gear_friction: one,
            coulomb_n: one,
            viscous_n_s_m: one,
            friction_n: one,
            tension_n: 5.0,
        });
        Identified { drive, motor }
    }

    fn stiffness(value_n: f64) -> FlightStiffness {
        let stiffness_n = Found::Determined { value: value_n, std: 300.0 };
        FlightStiffness { stiffness_n, left: 0.05, estimate_n: value_n }
    }

    fn load(text: &str) -> IdentifiedFile {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("identified.toml");
        std::fs::write(&path, text).unwrap();
        IdentifiedFile::load(&path).unwrap_or_else(|error| panic!("{error}\n{text}"))
    }

    #[test]
    fn every_file_that_is_written_loads() {
        let large = [0.5, 0.50004, 0.50006, 0.7, 1.0, 1.5, 100.0, 1e3, 1e4, 1e5, 1e6, 1e9, 1e300, f64::MAX];
        let small = [0.0, 1e-9, 4e-5, 4e-4, 6e-4, 4e-3, 6e-3, 0.04, f64::INFINITY, f64::NAN];
        let values: Vec<f64> = large.into_iter().chain(small).flat_map(|value| [value, -value]).collect();
        for &first in &values {
            for &second in &values {
                let failed = Err("too little\nmotion".to_owned());
                let mut mixed = all(first, true);
                mixed.drive.lag_s.value = second;
                let mass_kg = Some(Value { value: second, sigma: 0.1 });
                let cables = vec![Ok(mixed), failed, Ok(all(second, false))];
                let found = Findings { cables, mass_kg, stiffness: stiffness(first), used_s: 60.0 };
                let file = load(&super::text(Path::new("runs/one"), &found));
                assert_eq!(file.cable.len(), 3);
            }
        }
    }

    #[test]
    fn what_the_reader_would_refuse_is_a_comment() {
        let cables = vec![Ok(all(0.04, true)), Err("too little motion".to_owned())];
        let mass_kg = Some(Value { value: 1.2, sigma: 0.1 });
        let found = Findings { cables, mass_kg, stiffness: stiffness(5500.4), used_s: 60.0 };
        let text = super::text(Path::new("runs/one"), &found);
        let file = load(&text);
        assert_eq!((file.drive_lag_s(), file.node_mass_kg), (Some([0.04, 0.04]), Some(1.2)));
        assert_eq!((file.motor.force_constant_n_a, file.stiffness_n), (Some(0.04), Some(5500.0)));
        assert!(text.contains("# not identified: too little motion") && !text.contains("left out"), "{text}");

        let mut one = all(0.0, true);
        one.drive.delay_s.value = -0.0004;
        let why = "this run does not\ntell".to_owned();
        let stiffness = FlightStiffness { stiffness_n: Found::Undetermined(why), ..stiffness(6000.0) };
        let found = Findings { cables: vec![Ok(one)], mass_kg: None, stiffness, used_s: 60.0 };
        let text = super::text(Path::new("runs/one"), &found);
        let file = load(&text);
        assert_eq!((file.delay_s, file.lag_s, file.motor.force_constant_n_a), (None, None, None));
        assert!(file.stiffness_n.is_none() && text.contains("# stiffness_n: this run does not tell\n"), "{text}");
        for left_out in ["delay_s = -0.0004", "lag_s = 0.0000", "force_constant_n_a = 0.00"] {
            assert!(text.contains(&format!("# left out: {left_out} ")), "{left_out}: {text}");
        }
    }
}
