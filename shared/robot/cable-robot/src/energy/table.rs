//! Winch current, measured while raising and lowering known loads (the paper's lookup tables, Fig. 11).
//!
//! Speeds in m/s, reeling in positive, tensions in N, currents in A, a row per speed. Points outside the measured range
//! are a [`TableError`]; nothing is extrapolated.

use super::current::{Current, TableError};
use crate::MAX_CABLES;
use crate::drum::Drum;
use crate::motor::Motor;

/// Measured current over speed and tension, with bilinear interpolation between the points.
///
/// ```
/// use cable_robot::energy::{Current, CurrentTable};
/// let table = CurrentTable::new(
///     vec![-0.2, 0.0, 0.2],
///     vec![0.0, 20.0],
///     &[vec![-0.1, 0.0], vec![0.0, 0.5], vec![0.2, 1.1]],
///     1.2,
/// )?;
/// assert!((table.current_a(10.0, 0.1)? - 0.45).abs() < 1e-12);
/// assert!(table.current_a(21.0, 0.1).is_err());
/// # Ok::<(), cable_robot::energy::TableError>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct CurrentTable {
    speeds_m_s: Vec<f64>,
    tensions_n: Vec<f64>,
    /// Row-major, a row per speed.
    currents_a: Vec<f64>,
    resistance_ohm: f64,
}

impl CurrentTable {
    /// Builds a table from rising reel-in speeds (m/s, negative pays out), rising tensions (N) and a row of
    /// currents (A) per speed.
    pub fn new(
        speeds_m_s: Vec<f64>,
        tensions_n: Vec<f64>,
        currents_a: &[Vec<f64>],
        resistance_ohm: f64,
    ) -> Result<Self, TableError> {
        let refuse = |what: String| Err(TableError::Shape { what });
        for (name, axis) in [("speeds_m_s", &speeds_m_s), ("tensions_n", &tensions_n)] {
            if axis.len() < 2 {
                return refuse(format!("{name} has {} values", axis.len()));
            }
            if !axis.iter().all(|v| v.is_finite()) || !axis.windows(2).all(|pair| pair[0] < pair[1]) {
                return refuse(format!("{name} is not a rising sequence of finite numbers"));
            }
        }
        if currents_a.len() != speeds_m_s.len() {
            return refuse(format!("currents_a has {} rows for {} speeds", currents_a.len(), speeds_m_s.len()));
        }
        if let Some(i) = currents_a.iter().position(|row| row.len() != tensions_n.len()) {
            let (given, wanted) = (currents_a[i].len(), tensions_n.len());
            return refuse(format!("row {} of currents_a has {given} values for {wanted} tensions", i + 1));
        }
        if !currents_a.iter().flatten().all(|v| v.is_finite()) {
            return refuse("a current is not a finite number".to_owned());
        }
        if !(resistance_ohm.is_finite() && resistance_ohm >= 0.0) {
            return refuse(format!("resistance_ohm is {resistance_ohm}"));
        }
        Ok(Self { speeds_m_s, tensions_n, currents_a: currents_a.concat(), resistance_ohm })
    }
}

impl Current for CurrentTable {
    fn current_a(&self, tension_n: f64, reel_in_m_s: f64) -> Result<f64, TableError> {
        let columns = self.tensions_n.len();
        let at = |i: usize, j: usize| self.currents_a[i * columns + j];
        bilinear(&self.speeds_m_s, &self.tensions_n, at, tension_n, reel_in_m_s)
    }

    fn resistance_ohm(&self) -> f64 {
        self.resistance_ohm
    }
}

/// The motors of a robot: one measured table for all, one per cable, or none, which is the friction model for all.
///
/// A table stays in memory until the program ends, because a robot is `Copy` and eight tables in place would make it
/// four times as large. A program creates the robot of a file once.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Motors {
    model: Motor,
    tables: [Option<&'static MotorTable>; MAX_CABLES],
    drums: [Drum; MAX_CABLES],
}

impl Motors {
    /// Creates the motors of `cables` cables; `tables` has no, one or `cables` tables.
    ///
    /// # Errors
    /// Another number of tables, or a table with too many points.
    pub fn new(model: Motor, tables: &[CurrentTable], cables: usize) -> Result<Self, TableError> {
        if !(tables.len() <= 1 || tables.len() == cables) {
            let what =
                format!("there are {} tables for {cables} motors, not one for all or one for each", tables.len());
            return Err(TableError::Shape { what });
        }
        let mut of_cables: [Option<&'static MotorTable>; MAX_CABLES] = [None; MAX_CABLES];
        for (kept, table) in of_cables.iter_mut().zip(tables) {
            *kept = Some(Box::leak(Box::new(MotorTable::new(table)?)));
        }
        if tables.len() == 1 {
            let table = of_cables[0];
            of_cables[..cables].fill(table);
        }
        Ok(Self { model, tables: of_cables, drums: [Drum::default(); MAX_CABLES] })
    }

    /// The same motors on these drums.
    #[must_use]
    pub fn on(self, drums: [Drum; MAX_CABLES]) -> Self {
        Self { drums, ..self }
    }

    /// The measured table of the motor of a cable, counted from 0, if there is one.
    pub fn table(&self, cable: usize) -> Option<&MotorTable> {
        *self.tables.get(cable)?
    }
}

/// Without a cable: the motor of the first one.
impl Current for Motors {
    fn current_a(&self, tension_n: f64, reel_in_m_s: f64) -> Result<f64, TableError> {
        self.current_of_a(0, tension_n, reel_in_m_s)
    }

    fn current_of_a(&self, cable: usize, tension_n: f64, reel_in_m_s: f64) -> Result<f64, TableError> {
        match self.table(cable) {
            Some(table) => table.current_a(tension_n, reel_in_m_s),
            None => Ok(self.model.current_a(tension_n, reel_in_m_s)),
        }
    }

    fn drum(&self, cable: usize) -> Drum {
        self.drums.get(cable).copied().unwrap_or_default()
    }

    fn resistance_ohm(&self) -> f64 {
        self.table(0).map_or(self.model.resistance_ohm, MotorTable::resistance_ohm)
    }
}

/// Largest number of speeds of a [`MotorTable`]: both directions, closer together where friction changes its sign.
pub const MAX_SPEEDS: usize = 24;

/// Largest number of tensions of a [`MotorTable`]; the current is nearly linear in tension.
pub const MAX_TENSIONS: usize = 16;

/// A [`CurrentTable`] of bounded size that is `Copy`: the motors of a [`Robot`](crate::Robot).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MotorTable {
    speeds_m_s: [f64; MAX_SPEEDS],
    tensions_n: [f64; MAX_TENSIONS],
    currents_a: [[f64; MAX_TENSIONS]; MAX_SPEEDS],
    /// Number of speeds and of tensions.
    counts: [usize; 2],
    resistance_ohm: f64,
}

impl MotorTable {
    /// Copies a table. Fails if it has more points than [`MAX_SPEEDS`] and [`MAX_TENSIONS`].
    pub fn new(table: &CurrentTable) -> Result<Self, TableError> {
        let counts = [table.speeds_m_s.len(), table.tensions_n.len()];
        if counts[0] > MAX_SPEEDS || counts[1] > MAX_TENSIONS {
            let what = format!(
                "the table has {} speeds and {} tensions, and a robot holds at most {MAX_SPEEDS} and {MAX_TENSIONS}",
                counts[0], counts[1]
            );
            return Err(TableError::Shape { what });
        }
        let mut result = Self {
            speeds_m_s: [0.0; MAX_SPEEDS],
            tensions_n: [0.0; MAX_TENSIONS],
            currents_a: [[0.0; MAX_TENSIONS]; MAX_SPEEDS],
            counts,
            resistance_ohm: table.resistance_ohm,
        };
        result.speeds_m_s[..counts[0]].copy_from_slice(&table.speeds_m_s);
        result.tensions_n[..counts[1]].copy_from_slice(&table.tensions_n);
        for (row, given) in result.currents_a.iter_mut().zip(table.currents_a.chunks(counts[1])) {
            row[..counts[1]].copy_from_slice(given);
        }
        Ok(result)
    }

    /// Measured reel-in speeds, m/s, rising.
    pub fn speeds_m_s(&self) -> &[f64] {
        &self.speeds_m_s[..self.counts[0]]
    }

    /// Measured tensions, N, rising.
    pub fn tensions_n(&self) -> &[f64] {
        &self.tensions_n[..self.counts[1]]
    }
}

impl Current for MotorTable {
    fn current_a(&self, tension_n: f64, reel_in_m_s: f64) -> Result<f64, TableError> {
        bilinear(self.speeds_m_s(), self.tensions_n(), |i, j| self.currents_a[i][j], tension_n, reel_in_m_s)
    }

    fn resistance_ohm(&self) -> f64 {
        self.resistance_ohm
    }
}

/// Interpolates between the four points of a table around a speed and a tension; `at` returns the
/// entry of their indices.
fn bilinear(
    speeds_m_s: &[f64],
    tensions_n: &[f64],
    at: impl Fn(usize, usize) -> f64,
    tension_n: f64,
    reel_in_m_s: f64,
) -> Result<f64, TableError> {
    let (i, u) = locate(speeds_m_s, reel_in_m_s, "speed", "m/s")?;
    let (j, w) = locate(tensions_n, tension_n, "tension", "N")?;
    let (slow, fast) = (at(i, j) * (1.0 - w) + at(i, j + 1) * w, at(i + 1, j) * (1.0 - w) + at(i + 1, j + 1) * w);
    Ok(slow * (1.0 - u) + fast * u)
}

/// Returns the interval of an axis that contains a value, and the fraction within it; tolerates rounding at the ends.
pub fn locate(axis: &[f64], value: f64, what: &'static str, unit: &'static str) -> Result<(usize, f64), TableError> {
    let (low, high) = (axis[0], axis[axis.len() - 1]);
    let rounding = 1e-12 * (high - low);
    // Also true for NaN.
    if !(value >= low - rounding && value <= high + rounding) {
        return Err(TableError::OutOfRange { what, value, unit, low, high });
    }
    let value = value.clamp(low, high);
    let i = axis.partition_point(|v| *v <= value).clamp(1, axis.len() - 1) - 1;
    Ok((i, (value - axis[i]) / (axis[i + 1] - axis[i])))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::motor::Motor;
    use proptest::prelude::*;

    fn sampled(motor: &Motor) -> CurrentTable {
        let speeds: Vec<f64> = (-40..=40).map(|i| f64::from(i) * 0.01).collect();
        let tensions: Vec<f64> = (0..=20).map(|i| f64::from(i) * 5.0).collect();
        let rows: Vec<Vec<f64>> =
            speeds.iter().map(|v| tensions.iter().map(|t| motor.current_a(*t, *v)).collect()).collect();
        CurrentTable::new(speeds, tensions, &rows, motor.resistance_ohm).unwrap()
    }

    proptest! {
        #[test]
        fn a_sampled_motor_is_given_back(t in 0.0..100.0f64, v in 0.1..0.4f64, lower in any::<bool>()) {
            let motor = Motor::default();
            let v = if lower { -v } else { v };
            let read = sampled(&motor).current_a(t, v).unwrap();
            prop_assert!((read - motor.current_a(t, v)).abs() < 1e-3, "{read}");
        }

        #[test]
        fn at_a_measured_point_it_is_the_measurement(i in -40i32..=40, j in 0i32..=20) {
            let motor = Motor::default();
            let (v, t) = (f64::from(i) * 0.01, f64::from(j) * 5.0);
            prop_assert!((sampled(&motor).current_a(t, v).unwrap() - motor.current_a(t, v)).abs() < 1e-12);
        }
    }

    #[test]
    fn by_value_it_is_the_same_table() {
        let motor = Motor::default();
        let speeds: Vec<f64> = (-10..=10).map(|i| f64::from(i) * 0.04).collect();
        let tensions: Vec<f64> = (0..=10).map(|i| f64::from(i) * 10.0).collect();
        let rows: Vec<Vec<f64>> =
            speeds.iter().map(|v| tensions.iter().map(|t| motor.current_a(*t, *v)).collect()).collect();
        let table = CurrentTable::new(speeds, tensions, &rows, 1.2).unwrap();
        let copy = MotorTable::new(&table).unwrap();
        for (t, v) in [(0.0, -0.4), (100.0, 0.4), (33.3, 0.123), (5.0, -0.01), (101.0, 0.0), (1.0, 0.41)] {
            assert_eq!(copy.current_a(t, v), table.current_a(t, v));
        }
        assert_eq!(copy.resistance_ohm(), 1.2);
        let refused = MotorTable::new(&sampled(&motor)).unwrap_err();
        let TableError::Shape { what } = refused else { panic!("{refused}") };
        assert!(what.contains("81") && what.contains(&MAX_SPEEDS.to_string()), "{what}");
    }

    #[test]
    fn nothing_is_extrapolated() {
        let table = sampled(&Motor::default());
        for (t, v) in [(-0.1, 0.0), (100.1, 0.0), (10.0, 0.41), (10.0, -0.41), (f64::NAN, 0.0), (10.0, f64::NAN)] {
            assert_eq!(table.current_a(t, v).unwrap_err().kind(), "out_of_range");
        }
        assert!(table.current_a(100.0, 0.4).is_ok() && table.current_a(0.0, -0.4).is_ok());
    }

    #[test]
    fn what_is_no_table_is_refused() {
        let rows = |n: usize, m: usize| vec![vec![1.0; m]; n];
        for (speeds, tensions, currents) in [
            (vec![0.0], vec![0.0, 1.0], rows(1, 2)),
            (vec![0.0, 0.0], vec![0.0, 1.0], rows(2, 2)),
            (vec![0.0, 1.0], vec![1.0, 0.0], rows(2, 2)),
            (vec![0.0, f64::NAN], vec![0.0, 1.0], rows(2, 2)),
            (vec![0.0, 1.0], vec![0.0, 1.0], rows(3, 2)),
            (vec![0.0, 1.0], vec![0.0, 1.0], rows(2, 3)),
            (vec![0.0, 1.0], vec![0.0, 1.0], vec![vec![f64::INFINITY; 2]; 2]),
        ] {
            assert_eq!(CurrentTable::new(speeds, tensions, &currents, 1.0).unwrap_err().kind(), "invalid_argument");
        }
        assert!(CurrentTable::new(vec![0.0, 1.0], vec![0.0, 1.0], &rows(2, 2), -1.0).is_err());
    }
}
