//! The stated uncertainty compared with robots that are drawn from it and solved as a whole.

use cable_robot::{CableVec, PulleyKind, Robot, RobotParts, Uncertainty, Vector3, elastic};
use proptest::prelude::Rng;
use proptest::test_runner::{RngAlgorithm, TestRng};

fn parts() -> RobotParts {
    RobotParts {
        anchors_m: vec![[0.0, 0.0, 6.0], [30.0, 0.4, 6.6], [14.6, 20.3, 6.0]],
        pulley: PulleyKind::Swivel,
        pulley_radius_m: Some(vec![0.03; 3]),
        node_mass_kg: 2.5,
        tension_limits_n: [5.0, 200.0],
        speed_limit_m_s: 0.5,
        acceleration_limit_m_s2: 0.5,
        stiffness_n: Some(27_000.0),
        routed_length_m: Some(vec![22.0; 3]),
        ..RobotParts::default()
    }
}

/// One normal number.
fn normal(random: &mut TestRng) -> f64 {
    let [a, b] = [random.next_u32(), random.next_u32()].map(|x: u32| f64::from(x) / f64::from(u32::MAX));
    (-2.0 * (1.0 - 0.999_999 * a).ln()).sqrt() * (2.0 * std::f64::consts::PI * b).cos()
}

/// Which source errs in a drawn robot.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Source {
    Anchors,
    Radius,
    Scale,
    Stiffness,
    Weight,
    Expansion,
    /// Anchors, scales and radius by the two patterns of [`patterns`].
    Calibration,
}

/// Two errors of a calibration by one standard deviation each, in the order of `length_covariance`.
fn patterns(size: f64) -> [[f64; 15]; 2] {
    let first = [0.9, -0.3, 1.8, 0.02, 0.4, 0.2, 0.5, 2.1, -0.03, 0.4, -0.6, 0.1, 1.6, 0.01, 0.4];
    let second = [-0.4, 0.7, -0.8, 0.04, -0.3, 1.1, -0.2, 0.6, 0.05, -0.3, 0.1, -0.9, 0.3, -0.06, -0.3];
    [first, second].map(|pattern| pattern.map(|x| size * x))
}

/// Displacement of the node of a drawn robot from where the model has it: its lengths were set at `zero`, where the
/// node truly was, and it was moved until the model had it at `place`.
fn displacement_m(
    source: Source,
    size: f64,
    zero: &Vector3<f64>,
    place: &Vector3<f64>,
    random: &mut TestRng,
) -> Vector3<f64> {
    let (model, mut given) = (Robot::new(parts()).unwrap(), parts());
    let mut scales = [1.0; 3];
    let mut warm = 1.0;
    match source {
        Source::Anchors => given.anchors_m.iter_mut().flatten().for_each(|x| *x += size * normal(random)),
        Source::Radius => {
            let error_m = size * normal(random);
            given.pulley_radius_m.iter_mut().flatten().for_each(|radius_m| *radius_m += error_m);
        }
        Source::Scale => scales.iter_mut().for_each(|scale| *scale += size * normal(random)),
        Source::Stiffness => given.stiffness_n = given.stiffness_n.map(|ea| ea * (1.0 + size * normal(random))),
        Source::Weight => given.node_mass_kg *= 1.0 + size * normal(random),
        Source::Expansion => warm += size * normal(random),
        Source::Calibration => {
            for pattern in patterns(size) {
                // The model is wrong by this, so the truth is not.
                let error = normal(random);
                for (i, of) in pattern.chunks(5).enumerate() {
                    (0..3).for_each(|k| given.anchors_m[i][k] -= error * of[k]);
                    scales[i] += error * of[3];
                }
                given.pulley_radius_m.iter_mut().flatten().for_each(|radius_m| *radius_m -= error * pattern[4]);
            }
        }
    }
    let truth = Robot::new(given).unwrap();
    let lengths_m = |robot: &Robot, at: &Vector3<f64>| {
        let held = elastic::realise(robot, at, &Vector3::zeros(), robot.default_distribution()).unwrap();
        held.unstretched_m
    };
    // The true cable of the moment of zeroing, and what the model counts from there on.
    let (true_zero_m, model_zero_m, model_m) =
        (lengths_m(&truth, zero), lengths_m(&model, zero), lengths_m(&model, place));
    let routed_m = truth.routed_length_m();
    let true_m = CableVec::from_fn(3, |i| {
        let paid_out_m = true_zero_m[i] + (model_m[i] - model_zero_m[i]) * scales[i];
        (paid_out_m + routed_m[i]) * warm - routed_m[i]
    });
    elastic::equilibrium(&truth, &true_m, &Vector3::zeros(), Some(place)).unwrap().position - place
}

fn stated(source: Source, size: f64) -> Uncertainty {
    let mut stated = Uncertainty::default();
    match source {
        Source::Anchors => stated.anchors_m = size,
        Source::Radius => stated.pulley_radius_m = size,
        Source::Scale => stated.cable_scale = size,
        Source::Stiffness => stated.stiffness = size,
        Source::Weight => stated.node_weight = size,
        Source::Expansion => stated.expansion = size,
        // The covariance of the calibration counts in place of these.
        Source::Calibration => (stated.anchors_m, stated.cable_scale, stated.pulley_radius_m) = (1.0, 1.0, 1.0),
    }
    stated
}

/// The standard deviation along each axis agrees with that of 400 drawn robots, within what so few can show.
#[test]
fn drawn_robots_deviate_as_stated() {
    let mut random = TestRng::deterministic_rng(RngAlgorithm::ChaCha);
    let (zero, place) = (Vector3::new(14.0, 5.0, 1.0), Vector3::new(19.0, 9.0, 2.2));
    let at = |robot: &Robot, position: &Vector3<f64>| {
        let realised =
            elastic::realise(robot, position, &Vector3::zeros(), robot.default_distribution()).unwrap().unstretched_m;
        elastic::equilibrium(robot, &realised, &Vector3::zeros(), Some(position)).unwrap()
    };
    for (source, size) in [
        (Source::Anchors, 0.005),
        (Source::Radius, 0.005),
        (Source::Scale, 0.001),
        (Source::Stiffness, 0.05),
        (Source::Weight, 0.03),
        (Source::Expansion, 1e-4),
        (Source::Calibration, 0.005),
    ] {
        let uncertainty = stated(source, size);
        let mut given = parts();
        if source == Source::Calibration {
            let [a, b] = patterns(size);
            let entry = |i: usize, j: usize| a[i] * a[j] + b[i] * b[j];
            given.length_covariance = Some((0..15).map(|i| (0..15).map(|j| entry(i, j)).collect()).collect());
            given.anchor_covariance_m2 = Some(vec![vec![1.0; 9]; 9]);
        }
        let robot = Robot::new(given).unwrap();
        let errors = uncertainty.length_errors(&robot, &at(&robot, &zero));
        let covariance_m2 = uncertainty.covariance_m2(&robot, &at(&robot, &place), Some(&errors));
        let draws: Vec<_> = (0..400).map(|_| displacement_m(source, size, &zero, &place, &mut random)).collect();
        let largest_m = (0..3).map(|k| covariance_m2[(k, k)].sqrt()).fold(0.0, f64::max);
        for k in 0..3 {
            let drawn_m = (draws.iter().map(|d| d[k] * d[k]).sum::<f64>() / draws.len() as f64).sqrt();
            let stated_m = covariance_m2[(k, k)].sqrt();
            assert!(
                (drawn_m - stated_m).abs() < 0.12 * stated_m + 0.05 * largest_m,
                "{source:?}, axis {k}: drawn {drawn_m}, stated {stated_m} m"
            );
        }
        // Where the lengths were set, nothing is wrong but what changes with time.
        let there_m2 = uncertainty.covariance_m2(&robot, &at(&robot, &zero), Some(&errors)).trace();
        assert!(source == Source::Expansion || there_m2 < 1e-16, "{source:?}: {there_m2}");
        // Without a known zero every error counts.
        assert!(uncertainty.covariance_m2(&robot, &at(&robot, &zero), None).trace() > 0.0, "{source:?}");
    }
}

/// The margin of obstacles contains the deviation of drawn robots, from where their lengths were set or from anywhere.
#[test]
fn the_margin_of_obstacles_contains_the_deviation() {
    let mut random = TestRng::deterministic_rng(RngAlgorithm::ChaCha);
    let (zero, place) = (Vector3::new(14.0, 5.0, 1.0), Vector3::new(19.0, 9.0, 2.2));
    let certain = Robot::new(parts()).unwrap();
    let margin_m = |robot: &Robot| robot.obstacle_margin_m(&place, robot.default_distribution()) - robot.clearance_m();
    assert_eq!(margin_m(&certain), 0.0);
    for (source, size) in
        [(Source::Anchors, 0.005), (Source::Radius, 0.005), (Source::Scale, 0.001), (Source::Weight, 0.03)]
    {
        let robot = Robot::new(RobotParts { uncertainty: stated(source, size), ..parts() }).unwrap();
        let (known_m, unknown_m) = (margin_m(&robot.with_lengths_set_at(Some(&zero))), margin_m(&robot));
        let draws = (0..400).map(|_| displacement_m(source, size, &zero, &place, &mut random).norm());
        let mut draws: Vec<f64> = draws.collect();
        draws.sort_by(f64::total_cmp);
        // An upper bound that is not wide: it uses the largest axis for all three.
        assert!(draws[380] < known_m && known_m < 3.0 * draws[380], "{source:?}: {known_m} {}", draws[380]);
        assert!(known_m < unknown_m, "{source:?}: {known_m} {unknown_m}");
        assert_eq!(margin_m(&robot.with_lengths_set_at(None)), unknown_m);
        // Where the node cannot hang, nothing is known.
        let outside = Vector3::new(-50.0, 0.0, 1.0);
        assert_eq!(margin_m(&robot.with_lengths_set_at(Some(&outside))), unknown_m);
    }
}
