//! Simulated robots, and measurements of them with chosen errors.

use cable_robot::{CableVec, Vector3};
use calibration::{CalibrationError, Measurements, Range, Side, Undetermined, survey_anchors};

/// SplitMix64 and Box-Muller: a seeded generator with a fixed sequence.
pub struct Random(pub u64);

impl Random {
    pub fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }

    pub fn normal(&mut self, sigma: f64) -> f64 {
        let radius = (-2.0 * (1.0 - self.uniform()).ln()).sqrt();
        sigma * radius * (std::f64::consts::TAU * self.uniform()).cos()
    }

    /// A random point in the polygon of the anchors, shrunk to 0.9 about their mean: a random triangle of a fan,
    /// then a point in it.
    pub fn point_within(&mut self, anchors: &[[f64; 3]]) -> [f64; 2] {
        let n = anchors.len();
        let mean = [0, 1].map(|k| anchors.iter().map(|a| a[k]).sum::<f64>() / n as f64);
        let pick = 1 + (self.uniform() * (n - 2) as f64) as usize;
        let corner = [anchors[0], anchors[pick], anchors[(pick + 1) % n]];
        let (mut u, mut v) = (self.uniform(), self.uniform());
        if u + v > 1.0 {
            (u, v) = (1.0 - u, 1.0 - v);
        }
        [0, 1].map(|k| {
            let p = corner[0][k] + u * (corner[1][k] - corner[0][k]) + v * (corner[2][k] - corner[0][k]);
            mean[k] + 0.9 * (p - mean[k])
        })
    }
}

/// Spans of about 10 m, heights of about 3 m; replaces the paper's Table I, which is lost.
pub fn three() -> Vec<[f64; 3]> {
    let xy = survey_anchors([9.1, 9.8, 9.4], Side::Left).unwrap();
    [3.20, 3.45, 3.05].iter().zip(xy).map(|(z, [x, y])| [x, y, *z]).collect()
}

pub fn four() -> Vec<[f64; 3]> {
    vec![[0.0, 0.0, 3.20], [9.8, 0.0, 3.45], [10.3, 8.7, 3.05], [-0.4, 9.1, 3.30]]
}

pub fn flat(anchors: &[[f64; 3]]) -> Vec<[f64; 2]> {
    anchors.iter().map(|a| [a[0], a[1]]).collect()
}

pub fn lengths_to(anchors: &[[f64; 3]], c: [f64; 2]) -> CableVec {
    CableVec::from_fn(anchors.len(), |i| {
        let a = anchors[i];
        (Vector3::from(a) - Vector3::new(c[0], c[1], 0.0)).norm()
    })
}

/// Standard deviations of the simulated instruments.
pub struct Noise {
    pub length_m: f64,
    pub range_m: f64,
    pub scale: Option<f64>,
    pub offset_m: Option<f64>,
}

impl Noise {
    pub fn plain(length_m: f64, range_m: f64) -> Self {
        Self { length_m, range_m, scale: None, offset_m: None }
    }

    pub fn measure(&self, random: &mut Random, anchors: &[[f64; 3]], points: &[[f64; 2]]) -> Measurements {
        let n = anchors.len();
        let mut ranges = Vec::new();
        for from in 0..n {
            for to in from + 1..n {
                let d = (anchors[from][0] - anchors[to][0]).hypot(anchors[from][1] - anchors[to][1]);
                ranges.push(Range { from, to, m: d + random.normal(self.range_m), sigma_m: self.range_m });
            }
        }
        let scale = 1.0 + self.scale.map_or(0.0, |s| random.normal(s));
        let offsets: Vec<f64> = (0..n).map(|_| self.offset_m.map_or(0.0, |s| random.normal(s))).collect();
        let lengths_m = points
            .iter()
            .map(|c| {
                let exact = lengths_to(anchors, *c);
                CableVec::from_fn(n, |i| scale * exact[i] + offsets[i] + random.normal(self.length_m))
            })
            .collect();
        Measurements {
            ranges,
            lengths_m,
            sigma_length_m: self.length_m,
            sigma_scale: self.scale,
            sigma_offset_m: self.offset_m,
            ..Measurements::new(n)
        }
    }
}

/// Returns the error after a check of its kind.
pub fn expect_error(found: Result<impl std::fmt::Debug, CalibrationError>, kind: &str) -> CalibrationError {
    let error = found.unwrap_err();
    assert_eq!(error.kind(), kind, "{error}");
    error
}

/// Returns the reason why the measurements do not determine the anchors.
pub fn expect_undetermined(found: Result<impl std::fmt::Debug, CalibrationError>) -> Undetermined {
    match found.unwrap_err() {
        CalibrationError::RankDeficient(why) => why,
        other => panic!("{other}"),
    }
}
