//! Points in files and on the command line: `[x, y, z]` in space, `[x, z]` for a planar robot.

use crate::section::Numbers;
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::ops::Deref;

/// A point in a file or on the command line, m.
///
/// ```
/// use config::Point;
/// assert_eq!(Point::from_numbers(&[1.0, 2.0])?.resolve(true)?, [1.0, 0.0, 2.0]);
/// assert!(Point::from_numbers(&[1.0, 2.0])?.resolve(false).is_err());
/// # Ok::<(), String>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Point {
    /// [x, y, z], with y = 0 if it was written as [x, z].
    pub position_m: [f64; 3],
    /// Whether it was written as [x, z].
    pub planar: bool,
}

impl Point {
    /// Creates a point from two numbers [x, z] or three numbers [x, y, z].
    ///
    /// # Errors
    /// Another number of numbers.
    pub fn from_numbers(numbers: &[f64]) -> Result<Self, String> {
        match *numbers {
            [x, z] => Ok(Self { position_m: [x, 0.0, z], planar: true }),
            [x, y, z] => Ok([x, y, z].into()),
            _ => Err(format!("it has {} numbers; accepted: x, y and z, or x and z for a planar robot", numbers.len())),
        }
    }

    /// Returns the position [x, y, z] for a planar or a spatial robot. A planar robot accepts [x, 0, z] too.
    ///
    /// # Errors
    /// The point is of the other kind: one clause.
    pub fn resolve(&self, planar: bool) -> Result<[f64; 3], String> {
        match (self.position_m, self.planar, planar) {
            ([x, _, z], true, false) => {
                Err(format!("[{x}, {z}] is a point of a plane, and this robot moves in space; give x, y and z"))
            }
            ([x, y, z], _, true) if y != 0.0 => {
                Err(format!("[{x}, {y}, {z}] is outside the plane y = 0 in which this robot moves; give x and z"))
            }
            (position_m, ..) => Ok(position_m),
        }
    }
}

impl From<[f64; 3]> for Point {
    fn from(position_m: [f64; 3]) -> Self {
        Self { position_m, planar: false }
    }
}

impl<'de> Deserialize<'de> for Point {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let numbers = Vec::<f64>::deserialize(deserializer)?;
        Self::from_numbers(&numbers).map_err(serde::de::Error::custom)
    }
}

impl Serialize for Point {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let [x, y, z] = self.position_m;
        if self.planar { [x, z].serialize(serializer) } else { [x, y, z].serialize(serializer) }
    }
}

/// Points of one kind: all `[x, y, z]`, or all `[x, z]`. A robot with anchors of the second kind is planar.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Points {
    positions_m: Vec<[f64; 3]>,
    planar: bool,
}

impl Points {
    /// Returns whether the points were written as [x, z].
    #[must_use]
    pub fn is_planar(&self) -> bool {
        self.planar
    }

    /// Returns the points with other positions, of the same kind.
    #[must_use]
    pub fn moved_to(&self, positions_m: Vec<[f64; 3]>) -> Self {
        Self { positions_m, planar: self.planar }
    }
}

impl Serialize for Points {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_seq(self.positions_m.iter().map(|&position_m| Point { position_m, planar: self.planar }))
    }
}

impl From<Vec<[f64; 3]>> for Points {
    fn from(positions_m: Vec<[f64; 3]>) -> Self {
        Self { positions_m, planar: false }
    }
}

/// The positions [x, y, z], with y = 0 if the points were written as [x, z].
impl Deref for Points {
    type Target = [[f64; 3]];
    fn deref(&self) -> &[[f64; 3]] {
        &self.positions_m
    }
}

impl<'de> Deserialize<'de> for Points {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let points = Vec::<Point>::deserialize(deserializer)?;
        let planar = points.first().is_some_and(|point| point.planar);
        if let Some(other) = points.iter().position(|point| point.planar != planar) {
            let problem = format!("point {} has another number of coordinates than point 1", other + 1);
            return Err(serde::de::Error::custom(format!("{problem}; accepted: all [x, y, z], or all [x, z]")));
        }
        Ok(Self { positions_m: points.iter().map(|point| point.position_m).collect(), planar })
    }
}

impl Numbers for Point {
    fn numbers(&self, number: &mut dyn FnMut(f64)) {
        self.position_m.numbers(number);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Debug, Deserialize)]
    struct File {
        anchors_m: Points,
    }

    #[test]
    fn two_numbers_mean_a_planar_robot_and_a_mixture_is_rejected() {
        let read = |text: &str| toml::from_str::<File>(text).map(|file| file.anchors_m);
        let planar = read("anchors_m = [[0, 4], [6.0, 4.0]]").unwrap();
        assert!(planar.is_planar());
        assert_eq!(planar[..], [[0.0, 0.0, 4.0], [6.0, 0.0, 4.0]]);
        let space = read("anchors_m = [[0, 1, 4]]").unwrap();
        assert!(!space.is_planar());
        // The error contains the index of the point, or the number of its coordinates.
        for (text, number) in [("[[0, 1], [1, 2, 3]]", " 2 "), ("[[0, 1, 2, 3]]", " 4 "), ("[[0]]", " 1 ")] {
            let error = read(&format!("anchors_m = {text}")).unwrap_err();
            assert!(error.message().contains(number), "{error}");
        }
    }

    #[test]
    fn the_error_for_a_point_of_the_other_kind_contains_its_coordinates() {
        let (flat, space) = (Point::from_numbers(&[1.0, 2.0]).unwrap(), Point::from([1.0, 0.0, 2.0]));
        assert_eq!((flat.resolve(true), space.resolve(true)), (Ok([1.0, 0.0, 2.0]), Ok([1.0, 0.0, 2.0])));
        assert_eq!(space.resolve(false), Ok([1.0, 0.0, 2.0]));
        assert!(flat.resolve(false).unwrap_err().contains("[1, 2]"));
        assert!(Point::from([1.0, 0.5, 2.0]).resolve(true).unwrap_err().contains("[1, 0.5, 2]"));
    }
}
