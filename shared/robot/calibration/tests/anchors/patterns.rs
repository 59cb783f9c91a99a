//! Which errors of the model the residuals reveal, and how often honest measurements are refused.

use cable_robot::pulley::Pulley;
use cable_robot::{CableVec, Vector3};
use calibration::{Effect, Measurements, Method, calibrate, misfit, placement, unstated_pulleys};

use super::stand_in::*;

/// Measures at the places that `nims calibrate --plan` proposes, over pulleys of this radius.
fn measure(anchors: &[[f64; 3]], count: usize, radius_m: f64, noise: &Noise, seed: u64) -> Measurements {
    let mut random = Random(seed);
    let mut points = placement::corners(&flat(anchors), count, 0.9);
    for c in &mut points {
        // People stand beside the place.
        *c = c.map(|v| v + random.normal(0.02 * anchors[1][0]));
    }
    let mut measured = noise.measure(&mut random, anchors, &points);
    for (l, c) in measured.lengths_m.iter_mut().zip(&points) {
        let straight = lengths_to(anchors, *c);
        *l = CableVec::from_fn(anchors.len(), |i| {
            let pulley = Pulley { anchor: anchors[i].into(), radius_m, planar: false };
            l[i] + pulley.length_m(&Vector3::new(c[0], c[1], 0.0)) - straight[i]
        });
    }
    measured
}

fn scaled(anchors: &[[f64; 3]], by: f64, height: f64) -> Vec<[f64; 3]> {
    anchors.iter().map(|a| [by * a[0], by * a[1], height * a[2]]).collect()
}

#[test]
fn explore() {
    for (name, anchors) in
        [("lab3", three()), ("lab4", four()), ("30 m", scaled(&four(), 3.0, 2.0)), ("80 m", scaled(&four(), 8.0, 3.0))]
    {
        for radius in [0.0, 0.04] {
            for count in [9, 15, 25] {
                for (what, method, sigma_scale, sigma_offset_m) in [
                    ("survey", Method::Survey, None, None),
                    ("joint", Method::Joint, None, None),
                    ("scale", Method::Joint, Some(0.01), None),
                    ("scale+zeros", Method::Joint, Some(0.01), Some(0.02)),
                ] {
                    let (mut refused, mut asked, mut error, mut stated, mut calibrated) = (0, 0, 0.0, 0.0, 0);
                    let mut by = std::collections::BTreeMap::new();
                    for seed in 0..40 {
                        let measured = Measurements {
                            sigma_scale,
                            sigma_offset_m,
                            ..measure(&anchors, count, radius, &Noise::plain(0.005, 0.003), 0xca1 + seed)
                        };
                        let Ok(found) = calibrate(&measured, method) else { continue };
                        calibrated += 1;
                        let pattern = misfit(&measured, &found);
                        if let Some(m) = &pattern {
                            *by.entry(format!("{:?}", m.effect)).or_insert(0) += 1;
                        }
                        refused += u32::from(pattern.is_some());
                        asked += u32::from(pattern.is_none() && unstated_pulleys(&measured, &found).is_some());
                        error += found
                            .anchors_m
                            .iter()
                            .zip(&anchors)
                            .map(|(a, b)| (Vector3::from(*a) - Vector3::from(*b)).norm())
                            .fold(0.0, f64::max)
                            / 40.0;
                        stated += found.covariance.worst().2 / 40.0;
                    }
                    println!(
                        "{name} r {radius} {count} {what}: calibrated {calibrated} refused {refused} asked {asked} error {error:.3} stated {stated:.3} {by:?}"
                    );
                }
            }
        }
    }
}
