//! What a calibration states of the lengths of its robot, compared with robots that are drawn, measured and calibrated.

use super::stand_in::*;
use cable_robot::pulley::Pulley;
use cable_robot::{CableVec, Vector3};
use calibration::{Measurements, Method, Range, calibrate};

const READING_M: f64 = 0.006;
const FLOOR_M: f64 = 0.008;
const RANGE_M: f64 = 0.003;
const RADIUS_M: f64 = 0.001;
const SCALE: f64 = 0.0005;
const TIE_M: f64 = 0.005;
const ZERO_M: f64 = 0.005;

/// Radius as stated, m.
const STATED_M: f64 = 0.03;

/// A robot that differs from what its team states.
struct Truth {
    anchors_m: Vec<[f64; 3]>,
    radius_m: f64,
    scales: Vec<f64>,
    ties_m: Vec<Vector3<f64>>,
    zeros_m: Vec<f64>,
}

impl Truth {
    fn draw(anchors_m: &[[f64; 3]], random: &mut Random) -> Self {
        let n = anchors_m.len();
        Self {
            anchors_m: anchors_m.to_vec(),
            radius_m: STATED_M + random.normal(RADIUS_M),
            scales: (0..n).map(|_| 1.0 + random.normal(SCALE)).collect(),
            ties_m: (0..n).map(|_| Vector3::from_fn(|_, _| random.normal(TIE_M))).collect(),
            zeros_m: (0..n).map(|_| random.normal(ZERO_M)).collect(),
        }
    }

    /// The length that the robot shows, m.
    fn shown_m(&self, i: usize, node: Vector3<f64>) -> f64 {
        let pulley = Pulley::new(Vector3::from(self.anchors_m[i]), self.radius_m);
        self.scales[i] * pulley.length_m(&(node + self.ties_m[i])) + self.zeros_m[i]
    }

    fn measure(&self, count: usize, random: &mut Random) -> Measurements {
        let n = self.anchors_m.len();
        let mut ranges = Vec::new();
        for from in 0..n {
            for to in from + 1..n {
                let [a, b] = [from, to].map(|i| self.anchors_m[i]);
                let m = (a[0] - b[0]).hypot(a[1] - b[1]) + random.normal(RANGE_M);
                ranges.push(Range { from, to, m, sigma_m: RANGE_M });
            }
        }
        let lengths_m = (0..count)
            .map(|_| {
                let [x, y] = random.point_within(&self.anchors_m);
                let node = Vector3::new(x, y, random.normal(FLOOR_M));
                CableVec::from_fn(n, |i| self.shown_m(i, node) + random.normal(READING_M))
            })
            .collect();
        Measurements {
            ranges,
            lengths_m,
            pulley_radius_m: vec![STATED_M; n],
            sigma_pulley_radius_m: Some(RADIUS_M),
            sigma_cable_scale: Some(SCALE),
            sigma_attachment_m: Some(TIE_M),
            sigma_offset_m: Some(ZERO_M),
            sigma_floor_m: Some(FLOOR_M),
            sigma_length_m: READING_M.hypot(FLOOR_M),
            ..Measurements::new(n)
        }
    }
}

/// The calibrated robot is zeroed at one place, where it is known to be, and goes to another. How far its lengths are
/// off there agrees with what the calibration states: for each cable, and for all together, in which the errors that
/// they share count.
#[test]
fn lengths_beyond_the_zero_are_off_as_stated() {
    for anchors in [three(), four()] {
        let n = anchors.len();
        let (mut each, mut together, mut whole, mut draws) = (0.0, 0.0, 0.0, 0.0);
        for seed in 0..300 {
            let mut random = Random(0x1e57_0000 + seed);
            let truth = Truth::draw(&anchors, &mut random);
            let found = calibrate(&truth.measure(12, &mut random), Method::Joint).unwrap();
            let rows = found.lengths.as_ref().unwrap().rows();
            let zero = Vector3::new(4.9, 4.0, 0.9);
            let place = Vector3::new(6.4, 2.8, 0.4);
            let model = |i: usize, at: Vector3<f64>| {
                let pulley = Pulley::new(Vector3::from(found.anchors_m[i]), found.pulley_radius_m[i]);
                let wider = Pulley { radius_m: pulley.radius_m + 1e-5, ..pulley };
                let u = pulley.direction(&at).unwrap();
                let length_m = pulley.length_m(&at);
                (length_m, [-u.x, -u.y, -u.z, length_m, (wider.length_m(&at) - length_m) / 1e-5])
            };
            let (mut off_m, mut by) = (vec![0.0; n], vec![0.0; 5 * n]);
            for i in 0..n {
                let ((there_m, there), (here_m, here)) = (model(i, zero), model(i, place));
                let counted_m = truth.shown_m(i, place) - truth.shown_m(i, zero);
                off_m[i] = here_m - there_m - counted_m / found.scale;
                for k in 0..5 {
                    by[5 * i + k] = here[k] - there[k];
                }
            }
            let variance = |weight: &dyn Fn(usize) -> f64, by: &[f64]| {
                let w = |a: usize| weight(a / 5) * by[a];
                (0..5 * n)
                    .flat_map(|a| (0..5 * n).map(move |b| (a, b)))
                    .map(|(a, b)| w(a) * w(b) * rows[a][b])
                    .sum::<f64>()
            };
            draws += 1.0;
            for i in 0..n {
                let of = |j: usize| if i == j { 1.0 } else { 0.0 };
                each += off_m[i] * off_m[i] / variance(&of, &by) / n as f64;
            }
            // The sum of all cables, for example, is mostly the height of the node.
            let sum_m: f64 = off_m.iter().sum();
            together += sum_m * sum_m / variance(&|_| 1.0, &by);
            let mut at_place = vec![0.0; 5 * n];
            (0..n).for_each(|i| at_place[5 * i..5 * i + 5].copy_from_slice(&model(i, place).1));
            whole += sum_m * sum_m / variance(&|_| 1.0, &at_place);
        }
        let (each, together, whole) = (each / draws, together / draws, whole / draws);
        println!("{n} cables: mean square of each {each:.2}, of the sum {together:.2}, {whole:.3} without the zero");
        // 300 draws show a variance to 8 %.
        assert!((0.75..1.3).contains(&each) && (0.75..1.3).contains(&together), "{n}: {each} {together}");
        assert!(whole < 0.5, "{n}: {whole}");
    }
}

#[test]
fn without_scales_and_ties_nothing_is_stated() {
    let mut random = Random(7);
    let truth = Truth::draw(&four(), &mut random);
    let measured = truth.measure(12, &mut random);
    for without in [
        Measurements { sigma_cable_scale: None, ..measured.clone() },
        Measurements { sigma_attachment_m: None, ..measured.clone() },
    ] {
        assert_eq!(calibrate(&without, Method::Joint).unwrap().lengths, None);
    }
    let stated = calibrate(&measured, Method::Joint).unwrap().lengths.unwrap();
    let (rows, others) = (stated.rows(), stated.without_scales().rows());
    assert!((0..4).all(|i| rows[5 * i + 3][5 * i + 3] > 0.0 && others[5 * i + 3].iter().all(|v| *v == 0.0)));
    assert_eq!(rows[0][5], others[0][5]);
}
