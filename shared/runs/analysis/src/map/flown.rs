//! The flown path for a picture, in bounded memory.

/// Least distance of two points at first, m. It doubles when there are too many points.
const FIRST_STEP_M: f64 = 0.01;
/// Largest number of points: half a kilometre at the first distance, and far more than a picture has pixels.
const MOST_POINTS: usize = 50_000;

/// Points of a path that are some distance apart.
#[derive(Debug, Clone)]
pub(super) struct FlownPath {
    points: Vec<[f64; 3]>,
    step_m: f64,
}

impl FlownPath {
    pub(super) fn new() -> Self {
        Self { points: Vec::new(), step_m: FIRST_STEP_M }
    }

    /// Adds a point if it is far enough from the last one.
    pub(super) fn add(&mut self, point: [f64; 3]) {
        self.push(point);
        if self.points.len() > MOST_POINTS {
            self.step_m *= 2.0;
            std::mem::take(&mut self.points).into_iter().for_each(|point| self.push(point));
        }
    }

    fn push(&mut self, point: [f64; 3]) {
        if self.points.last().is_none_or(|last| distance(last, &point) > self.step_m) {
            self.points.push(point);
        }
    }

    pub(super) fn points(&self) -> &[[f64; 3]] {
        &self.points
    }
}

fn distance(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum::<f64>().sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_path_of_any_length_has_a_bounded_number_of_points_without_gaps() {
        let mut path = FlownPath::new();
        // Ten kilometres around a circle of a metre, in steps of 4 mm.
        let at = |i: u32| {
            let angle = f64::from(i) * 0.004;
            [libm::cos(angle), libm::sin(angle), 0.5]
        };
        (0..2_500_000).for_each(|i| path.add(at(i)));
        assert!((MOST_POINTS / 4..=MOST_POINTS).contains(&path.points.len()), "{}", path.points.len());
        assert_eq!(path.points[0], at(0));
        let steps = || path.points.windows(2).map(|two| distance(&two[0], &two[1]));
        assert!(steps().all(|step| step > path.step_m && step < 2.0 * path.step_m + 0.004), "{}", path.step_m);
        // A robot at rest adds nothing.
        let before = path.points.len();
        (0..1000).for_each(|_| path.add(path.points[before - 1]));
        assert_eq!(path.points.len(), before);
    }
}
