//! Typed access to the arguments of a request; errors name the key and the accepted values.

use super::error::SolveError;
use cable_robot::anchors::RADII_M;
use cable_robot::energy::CurrentTable;
use cable_robot::kinematics::LONGEST_M;
use cable_robot::motor::Motor;
use cable_robot::pulley::Pulley;
use cable_robot::{Anchors, Distribution, MAX_CABLES, STANDARD_GRAVITY, Vector3};
use serde_json::{Map, Value};

type ArgResult<T> = Result<T, SolveError>;

/// Arguments of one request.
pub struct Args<'a>(&'a Map<String, Value>);

/// Points in space or in the x-z plane.
pub struct Points {
    /// The points; planar ones have y = 0.
    pub points: Vec<Vector3<f64>>,
    /// Whether the points have two coordinates, [x, z].
    pub planar: bool,
    /// Radius of the pulley at each anchor, m; 0 for an eye.
    pub radii_m: Vec<f64>,
}

impl Points {
    /// Returns the eye or pulley at each point.
    pub fn pulleys(&self) -> impl Iterator<Item = Pulley> + '_ {
        let pulley = |(anchor, radius_m): (&Vector3<f64>, &f64)| Pulley {
            anchor: *anchor,
            radius_m: *radius_m,
            planar: self.planar,
        };
        self.points.iter().zip(&self.radii_m).map(pulley)
    }

    /// Returns whether any cable runs over a pulley.
    pub fn have_pulleys(&self) -> bool {
        self.radii_m.iter().any(|radius| *radius != 0.0)
    }

    /// Returns whether there are only as many cables as dimensions.
    pub fn are_minimal(&self) -> bool {
        self.points.len() == if self.planar { 2 } else { 3 }
    }

    /// Returns distinct anchors with their pulleys.
    pub fn checked(&self) -> ArgResult<Anchors> {
        let points: Vec<[f64; 3]> = self.points.iter().map(|p| (*p).into()).collect();
        let anchors = if self.planar { Anchors::in_plane(&points) } else { Anchors::new(&points) };
        let anchors = anchors.and_then(|anchors| anchors.with_pulleys(&self.radii_m));
        anchors.map_err(|error| SolveError::invalid(error.to_string()))
    }
}

impl<'a> Args<'a> {
    /// Wraps the object of a request.
    pub fn new(object: &'a Map<String, Value>) -> Self {
        Self(object)
    }

    /// Returns a value that is not null.
    pub fn get(&self, key: &str) -> Option<&'a Value> {
        self.0.get(key).filter(|value| !value.is_null())
    }

    fn required(&self, key: &str) -> ArgResult<&'a Value> {
        self.get(key).ok_or_else(|| SolveError::invalid(format!("{key} is missing; this op requires it")))
    }

    /// Returns a string.
    pub fn text(&self, key: &str) -> ArgResult<&'a str> {
        self.required(key)?.as_str().ok_or_else(|| invalid_value(key, "not a string", "a string"))
    }

    /// Returns a finite number.
    pub fn number(&self, key: &str) -> ArgResult<f64> {
        number(key, self.required(key)?)
    }

    /// Returns a finite number, if given.
    pub fn optional(&self, key: &str) -> ArgResult<Option<f64>> {
        self.get(key).map(|value| number(key, value)).transpose()
    }

    /// Returns a finite number that is not negative.
    pub fn not_negative(&self, key: &str) -> ArgResult<f64> {
        let value = self.number(key)?;
        if value >= 0.0 { Ok(value) } else { Err(invalid_value(key, &value.to_string(), "0 or more")) }
    }

    /// Returns a finite number above zero.
    pub fn positive(&self, key: &str) -> ArgResult<f64> {
        let value = self.number(key)?;
        if value > 0.0 { Ok(value) } else { Err(invalid_value(key, &value.to_string(), "a number above 0")) }
    }

    /// Returns a boolean; default: false.
    pub fn flag(&self, key: &str) -> ArgResult<bool> {
        match self.get(key) {
            None => Ok(false),
            Some(value) => value.as_bool().ok_or_else(|| invalid_value(key, "not a boolean", "true or false")),
        }
    }

    /// Returns a whole number that is not negative.
    pub fn count(&self, key: &str) -> ArgResult<usize> {
        let value = self.number(key)?;
        if (0.0..=1e9).contains(&value) && value.fract() == 0.0 {
            return Ok(value as usize);
        }
        Err(invalid_value(key, &value.to_string(), "a whole number of 0 or more"))
    }

    /// Returns the side from +1 or -1, if given.
    pub fn side(&self) -> ArgResult<Option<calibration::Side>> {
        match self.optional("side")? {
            None => Ok(None),
            Some(value) if value.abs() == 1.0 => Ok(Some(calibration::Side::from_sign(value as i64)?)),
            Some(value) => Err(invalid_value("side", &value.to_string(), "1 (left) or -1 (right)")),
        }
    }

    /// Returns a list of finite numbers.
    pub fn numbers(&self, key: &str) -> ArgResult<Vec<f64>> {
        numbers(key, self.required(key)?)
    }

    /// Returns rows of finite numbers of equal length; at least one row with at least one number.
    pub fn matrix(&self, key: &str) -> ArgResult<Vec<Vec<f64>>> {
        matrix(key, self.required(key)?)
    }

    /// Returns a list of exactly N numbers.
    pub fn exactly<const N: usize>(&self, key: &str) -> ArgResult<[f64; N]> {
        let values = self.numbers(key)?;
        let given = values.len();
        values.try_into().map_err(|_| invalid_value(key, &format!("{given} numbers"), &format!("{N} numbers")))
    }

    /// Returns rows of exactly N numbers.
    pub fn rows<const N: usize>(&self, key: &str) -> ArgResult<Vec<[f64; N]>> {
        let rows = self.matrix(key)?.into_iter();
        let row = |row: Vec<f64>| {
            let given = row.len();
            row.try_into()
                .map_err(|_| invalid_value(key, &format!("a row of {given}"), &format!("rows of {N} numbers")))
        };
        rows.map(row).collect()
    }

    /// Returns anchors [x, y, z], or [x, z] in the plane: at least as many as dimensions, at most eight. The optional
    /// `pulley_radius_m` means what it means in a robot file with `pulley = "swivel"`; also one number for all cables.
    pub fn anchors(&self) -> ArgResult<Points> {
        let mut anchors = self.points("anchors_m")?;
        let least = if anchors.planar { 2 } else { 3 };
        let given = anchors.points.len();
        if !(least..=MAX_CABLES).contains(&given) {
            return Err(invalid_value(
                "anchors_m",
                &format!("{given} points"),
                &format!("{least} to {MAX_CABLES} points"),
            ));
        }
        anchors.radii_m = self.radii(given)?;
        Ok(anchors)
    }

    /// Returns the optional `pulley_radius_m` of each cable: one number for all or a list, m; default 0, an eye.
    pub fn radii(&self, cables: usize) -> ArgResult<Vec<f64>> {
        const KEY: &str = "pulley_radius_m";
        let Some(value) = self.get(KEY) else { return Ok(vec![0.0; cables]) };
        let radii_m = if value.is_array() { self.per_cable(KEY, cables)? } else { vec![self.number(KEY)?; cables] };
        match radii_m.iter().find(|r| !RADII_M.contains(*r)) {
            Some(radius) => Err(invalid_value(KEY, &radius.to_string(), "radii of 0 (an eye) to 0.5 m")),
            None => Ok(radii_m),
        }
    }

    /// Returns points [x, y, z], or [x, z] in the plane.
    pub fn points(&self, key: &str) -> ArgResult<Points> {
        let rows = self.matrix(key)?;
        let planar = rows[0].len() == 2;
        let points = rows.iter().map(|row| point(key, row, planar)).collect::<ArgResult<Vec<_>>>()?;
        let radii_m = vec![0.0; points.len()];
        Ok(Points { points, planar, radii_m })
    }

    /// Returns a point or vector of the given dimension.
    pub fn vector(&self, key: &str, planar: bool) -> ArgResult<Vector3<f64>> {
        point(key, &self.numbers(key)?, planar)
    }

    /// Returns a point whose dimension determines that of the other arguments.
    pub fn first_point(&self, key: &str) -> ArgResult<(Vector3<f64>, bool)> {
        let values = self.numbers(key)?;
        let planar = values.len() == 2;
        Ok((point(key, &values, planar)?, planar))
    }

    /// Returns one number per cable.
    pub fn per_cable(&self, key: &str, cables: usize) -> ArgResult<Vec<f64>> {
        let values = self.numbers(key)?;
        if values.len() != cables {
            return Err(invalid_value(key, &format!("{} numbers for {cables} cables", values.len()), "one per cable"));
        }
        Ok(values)
    }

    /// Returns [min, max]; null as the upper limit means no limit.
    pub fn limits(&self) -> ArgResult<[f64; 2]> {
        const KEY: &str = "limits_n";
        let accepted = "[min, max] with 0 <= min <= max, or null for no upper limit";
        let Some(pair) = self.required(KEY)?.as_array().filter(|pair| pair.len() == 2) else {
            return Err(invalid_value(KEY, "not a pair", accepted));
        };
        let low = if pair[0].is_null() { 0.0 } else { number(KEY, &pair[0])? };
        let open = pair[1].is_null() || pair[1].as_str() == Some("Infinity");
        let high = if open { f64::INFINITY } else { number(KEY, &pair[1])? };
        if 0.0 <= low && low <= high {
            Ok([low, high])
        } else {
            Err(invalid_value(KEY, &format!("[{low}, {high}]"), accepted))
        }
    }

    /// Returns the tension distribution.
    pub fn method(&self) -> ArgResult<Distribution> {
        let name = self.text("method")?;
        name.parse().map_err(|_| invalid_value("method", &format!("{name:?}"), "unique, least_norm, min_sum or safest"))
    }

    /// Returns the acceleration of gravity; default: standard gravity.
    pub fn gravity(&self) -> ArgResult<f64> {
        Ok(self.optional("gravity_m_s2")?.unwrap_or(STANDARD_GRAVITY))
    }

    /// Returns an n x n matrix, given as such or as a number for a multiple of the identity.
    pub fn weight(&self, key: &str, n: usize) -> ArgResult<Vec<Vec<f64>>> {
        let value = self.required(key)?;
        if value.is_array() {
            let rows = matrix(key, value)?;
            if rows.len() != n || rows[0].len() != n {
                let given = format!("{} x {}", rows.len(), rows[0].len());
                return Err(invalid_value(key, &given, &format!("a number, or {n} x {n}")));
            }
            return Ok(rows);
        }
        let scalar = number(key, value)?;
        Ok((0..n).map(|i| (0..n).map(|j| if i == j { scalar } else { 0.0 }).collect()).collect())
    }

    /// Returns the motor from the keys of the robot file's `[motor]`, with its defaults.
    pub fn motor(&self) -> ArgResult<Motor> {
        let inner = self.object("motor")?;
        let fill = Motor::default();
        let value = |key: &str, default: f64| -> ArgResult<f64> { Ok(inner.optional(key)?.unwrap_or(default)) };
        let motor = Motor {
            force_constant_n_a: value("force_constant_n_a", fill.force_constant_n_a)?,
            resistance_ohm: value("resistance_ohm", fill.resistance_ohm)?,
            gear_friction: value("gear_friction", fill.gear_friction)?,
            coulomb_n: value("coulomb_n", fill.coulomb_n)?,
            viscous_n_s_m: value("viscous_n_s_m", fill.viscous_n_s_m)?,
            transition_m_s: value("transition_m_s", fill.transition_m_s)?,
        };
        motor.check().map_err(|error| SolveError::invalid(format!("motor: {error}")))?;
        Ok(motor)
    }

    /// Returns a measured motor table, if given.
    pub fn table(&self, resistance_ohm: f64) -> ArgResult<Option<CurrentTable>> {
        if self.get("table").is_none() {
            return Ok(None);
        }
        let inner = self.object("table")?;
        let (speeds, tensions) = (inner.numbers("speeds_m_s")?, inner.numbers("tensions_n")?);
        let currents = inner.matrix("currents_a")?;
        Ok(Some(CurrentTable::new(speeds, tensions, &currents, resistance_ohm)?))
    }

    fn object(&self, key: &str) -> ArgResult<Args<'a>> {
        self.required(key)?.as_object().map(Args).ok_or_else(|| invalid_value(key, "not an object", "an object"))
    }
}

/// Creates the error for a key with a wrong value.
pub fn invalid_value(key: &str, given: &str, accepted: &str) -> SolveError {
    SolveError::invalid(format!("{key} is {given}; accepted: {accepted}"))
}

fn number(key: &str, value: &Value) -> ArgResult<f64> {
    match value.as_f64() {
        Some(number) if number.is_finite() => Ok(number),
        _ => {
            let text: String = value.to_string().chars().take(40).collect();
            Err(invalid_value(key, &text, "finite numbers"))
        }
    }
}

fn numbers(key: &str, value: &Value) -> ArgResult<Vec<f64>> {
    let list = value.as_array().ok_or_else(|| invalid_value(key, "not a list", "a list of finite numbers"))?;
    list.iter().map(|value| number(key, value)).collect()
}

fn matrix(key: &str, value: &Value) -> ArgResult<Vec<Vec<f64>>> {
    let accepted = "a list of rows of equal length, at least one";
    let list = value.as_array().ok_or_else(|| invalid_value(key, "not a list", accepted))?;
    let rows: Vec<Vec<f64>> = list.iter().map(|row| numbers(key, row)).collect::<ArgResult<_>>()?;
    match rows.first() {
        Some(first) if !first.is_empty() && rows.iter().all(|row| row.len() == first.len()) => Ok(rows),
        _ => Err(invalid_value(key, "empty or of unequal rows", accepted)),
    }
}

fn point(key: &str, values: &[f64], planar: bool) -> ArgResult<Vector3<f64>> {
    if let Some(value) = values.iter().find(|v| v.abs() > LONGEST_M) {
        return Err(invalid_value(key, &value.to_string(), "coordinates up to 1e5"));
    }
    match (values, planar) {
        ([x, z], true) => Ok(Vector3::new(*x, 0.0, *z)),
        ([x, y, z], false) => Ok(Vector3::new(*x, *y, *z)),
        _ => {
            let wanted = if planar { "[x, z] like the other points" } else { "[x, y, z], or [x, z] for all points" };
            Err(invalid_value(key, &format!("a point of {} numbers", values.len()), wanted))
        }
    }
}
