//! Keep-out boxes, which the node may not enter.

use nalgebra::Vector3;

/// Largest number of keep-out boxes of a robot.
pub const MAX_KEEP_OUT: usize = 8;

/// An axis-aligned box that the node may not enter, m.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct KeepOut {
    /// Lower corner.
    pub min: Vector3<f64>,
    /// Upper corner.
    pub max: Vector3<f64>,
}

impl KeepOut {
    /// True if the straight line from `a` to `b` touches the box.
    pub fn touches(&self, a: &Vector3<f64>, b: &Vector3<f64>) -> bool {
        let (mut enter, mut leave) = (0.0f64, 1.0f64);
        for k in 0..3 {
            let d = b[k] - a[k];
            if d == 0.0 {
                if a[k] < self.min[k] || a[k] > self.max[k] {
                    return false;
                }
                continue;
            }
            let (t0, t1) = ((self.min[k] - a[k]) / d, (self.max[k] - a[k]) / d);
            enter = enter.max(t0.min(t1));
            leave = leave.min(t0.max(t1));
        }
        enter <= leave
    }

    /// Computes the distance from a position to the box, m; 0 inside.
    pub fn distance_m(&self, position: &Vector3<f64>) -> f64 {
        let nearest = position.sup(&self.min).inf(&self.max);
        (position - nearest).norm()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_box_is_touched_by_lines_through_it_only() {
        let b = KeepOut { min: Vector3::new(0.0, 0.0, 0.0), max: Vector3::new(1.0, 1.0, 1.0) };
        let at = |x: f64, y: f64, z: f64| Vector3::new(x, y, z);
        assert!(b.touches(&at(-1.0, 0.5, 0.5), &at(2.0, 0.5, 0.5)));
        assert!(b.touches(&at(0.5, 0.5, 0.5), &at(0.5, 0.5, 0.5)));
        assert!(!b.touches(&at(-1.0, 1.5, 0.5), &at(2.0, 1.5, 0.5)));
        assert!(!b.touches(&at(-1.0, 0.5, 0.5), &at(-0.1, 0.5, 0.5)));
        assert!(b.touches(&at(-0.1, 0.9, 0.5), &at(0.2, 1.05, 0.5)));
    }
}
